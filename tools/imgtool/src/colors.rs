//! Options of colour spaces.

use crate::parse::Given;
use crate::stack::{Done, Machine};
use crate::table::Action;
use granita_color::{Config, Processor};
use granita_edit::Image;
use granita_view::InputColors;

/// The word for the first display, and for the first view of a display.
const DEFAULT: &str = "default";

/// Carries out an option.
pub(crate) fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    let config = machine.config()?;
    let image = machine.top()?.clone();
    let word = &*given.values[0];
    let image = match given.row.action {
        Action::IsColorSpace => {
            config.processor(word, word)?;
            image.in_space(word)
        }
        Action::ColorConvert => {
            let to = &*given.values[1];
            let strict = given.flag("strict", true)?;
            match config.processor(word, to) {
                Ok(processor) => converted(&image, given, processor, Some(to))?,
                Err(error) if strict => return Err(error.into()),
                Err(error) => {
                    machine.reporter.warning(format!("{}: nothing is converted: {error}", given.typed));
                    image
                }
            }
        }
        Action::ToColorSpace => {
            let processor = from_file(machine, &image, &config, word)?;
            converted(&image, given, processor, Some(word))?
        }
        Action::DisplayView => {
            let display = if word == DEFAULT { config.default_display() } else { word };
            let view = match &*given.values[1] {
                DEFAULT => config.default_view(display),
                view => view,
            };
            let processor = match given.text("from") {
                Some(from) => config.display_processor(from, display, view)?,
                None => {
                    let working = working(&config)?;
                    let to_view = config.display_processor(working, display, view)?;
                    // A view of data shows the stored values.
                    match config.shows_data(display, view) {
                        true => to_view,
                        false => from_file(machine, &image, &config, working)?.then(&to_view),
                    }
                }
            };
            converted(&image, given, processor, None)?
        }
        Action::Look => {
            let working = working(&config)?;
            let from = given.text("from").unwrap_or(working);
            let to = given.text("to").unwrap_or(from);
            let looks = config.look_processor(from, to, word)?;
            let processor = match given.text("from") {
                Some(_) => looks,
                None => from_file(machine, &image, &config, working)?.then(&looks),
            };
            converted(&image, given, processor, Some(to))?
        }
        _ => {
            let processor = config.file_processor(word, given.flag("inverse", false)?)?;
            converted(&image, given, processor, None)?
        }
    };
    machine.replace(1, image);
    Ok(())
}

/// Returns the space of linear light in which looks and views begin.
fn working(config: &Config) -> Result<&str, String> {
    config
        .scene_linear()
        .ok_or_else(|| format!("{} has no role scene_linear; from= names a space", config.place()))
}

/// Returns the processor from the colours that a file describes to a space.
fn from_file(machine: &Machine<'_>, image: &Image, config: &Config, to: &str) -> Done<Processor> {
    let name = machine.stack.last().map_or("", |top| &*top.name);
    let (text, processor) = InputColors::new(config.clone(), to)?.of(image.spec(), name);
    machine.reporter.info(format!("{name}: the colours are {text}"));
    Ok(processor)
}

fn converted(image: &Image, given: &Given, processor: Processor, space: Option<&str>) -> Done<Image> {
    Ok(image.with_colors(processor, given.flag("unpremult", false)?, space))
}
