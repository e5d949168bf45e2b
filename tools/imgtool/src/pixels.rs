//! Options that change values, channels and metadata.

use crate::parse::Given;
use crate::shapes::{blur_size, kernel, noise};
use crate::stack::{Done, Machine};
use crate::table::Action;
use granita_edit::{
    Binary, Geometry, Image, append_channels, attribute, binary, multiply_add, numbers, over,
};
use granita_texture::make::Kernel;

/// Returns the operation of an option on two images, or on an image and constants.
fn operation(action: Action) -> Option<Binary> {
    use Action as A;
    Some(match action {
        A::Add | A::AddConstant => Binary::Add,
        A::Subtract | A::SubtractConstant => Binary::Sub,
        A::Multiply | A::MultiplyConstant => Binary::Mul,
        A::Divide | A::DivideConstant => Binary::Div,
        A::AbsoluteDifference | A::AbsoluteDifferenceConstant => Binary::AbsDiff,
        A::Minimum | A::MinimumConstant => Binary::Min,
        A::Maximum | A::MaximumConstant => Binary::Max,
        A::Power | A::PowerConstant => Binary::Pow,
        _ => return None,
    })
}

/// Carries out an option.
pub(crate) fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    let count = given.row.images;
    let images: Vec<Image> =
        machine.stack[machine.stack.len() - count..].iter().map(|entry| entry.image.clone()).collect();
    let image = match &*images {
        [a, b, c] => multiply_add(a, b, c)?,
        [a, b] => match (operation(given.row.action), given.row.action) {
            (Some(operation), _) => binary(operation, a, b)?,
            (None, Action::Over) => over(a, b)?,
            _ => append_channels(a, b)?,
        },
        [image] => one(machine, image, given)?,
        _ => return Err("there is no image".into()),
    };
    machine.replace(count, image);
    Ok(())
}

/// Returns the result of an option on one image.
fn one(machine: &Machine<'_>, image: &Image, given: &Given) -> Done<Image> {
    use Action as A;
    if let Some(operation) = operation(given.row.action) {
        return Ok(image.with_constant(operation, &numbers(&given.values[0])?)?);
    }
    let word = given.values.first().map_or("", |value| &**value);
    Ok(match given.row.action {
        A::Channels => {
            let (image, notes) = image.channels(word)?;
            notes.into_iter().for_each(|note| machine.reporter.warning(format!("{}: {note}", given.typed)));
            image
        }
        A::ChannelNames => image.channel_names(word),
        A::ChannelCount => match given.value(0)? {
            count @ 1..=1024 => image.associated().with_channels(count),
            count => return Err(format!("{count} channels, 1 to 1024 are possible").into()),
        },
        A::ChannelSum => image.channel_sum(&given.text("weight").map_or(Ok(vec![1.0]), numbers)?),
        A::ChannelMaximum => image.channel_maximum(),
        A::ChannelMinimum => image.channel_minimum(),
        A::Saturate => image.saturated(given.value(0)?),
        A::Absolute => image.abs(),
        A::Invert => {
            let (begin, end) = (given.number("chbegin")?, given.number("chend")?);
            let range =
                (begin.is_some() || end.is_some()).then(|| (begin.unwrap_or(0), end.unwrap_or(usize::MAX)));
            image.inverted(range)
        }
        A::Clamp => {
            let limit = |name: &str| given.text(name).map(numbers).transpose();
            let (mut low, mut high) = (limit("min")?, limit("max")?);
            let alpha = given.flag("clampalpha", false)?;
            if low.is_none() && high.is_none() && !alpha {
                (low, high) = (Some(vec![0.0]), Some(vec![1.0]));
            }
            image.clamped(low.as_deref(), high.as_deref(), alpha)?
        }
        A::Premultiply => match image.spec().attributes.int("unassociatedalpha").unwrap_or(0) {
            0 => image.premultiplied(),
            _ => image.associated(),
        },
        A::Unpremultiply => image.unpremultiplied(),
        A::Blur => {
            let kernel = given.text("kernel").map_or(Ok(Kernel::Gaussian), kernel)?;
            image.blurred(blur_size(word)?, kernel)?
        }
        A::Unsharp => {
            let kernel = given.text("kernel").map_or(Ok(Kernel::Gaussian), kernel)?;
            let number = |name: &str, default: f32| given.number(name).map(|v| v.unwrap_or(default));
            image.sharpened(
                number("width", 3.0)?,
                kernel,
                number("contrast", 1.0)?,
                number("threshold", 0.0)?,
            )?
        }
        A::FixNan => match word {
            "none" => image.clone(),
            "black" => image.finite(false),
            "box3" => image.finite(true),
            other => return Err(format!("\"{other}\", none, black and box3 are possible").into()),
        },
        A::Fill => {
            let color = given.text("color").map_or(Ok(vec![1.0]), numbers)?;
            image.filled(&Geometry::parse(word)?.window(&image.data())?, &color)?
        }
        A::Noise => {
            let (noise, mono, seed) = noise(given)?;
            image.with_noise(noise, mono, seed)
        }
        A::Attribute => image.with_attribute(attribute(word, &given.values[1], given.text("type"))?),
        A::TextAttribute => image.with_attribute(attribute(word, &given.values[1], Some("string"))?),
        A::EraseAttribute => image.without_attributes(word)?,
        A::Caption => image.with_caption(word),
        A::Keyword => image.with_keyword(word),
        A::ClearKeywords => image.without_keywords(),
        other => return Err(format!("{other:?} is not an operation on one image").into()),
    })
}
