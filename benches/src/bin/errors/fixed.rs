//! Requested errors and times beside the best fixed settings of frames without passes.

use crate::scenes::{Make, ORDINARY, Quality};

/// The factors of the four numbers that a setting changes. More of one costs more time.
const SAMPLES_OF_A_PIXEL: [u32; 4] = [2, 4, 8, 16];
const SAMPLES: [f32; 4] = [0.25, 1.0, 4.0, 16.0];
const SHADING: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
const MAXERROR: [f32; 3] = [1.0, 0.25, 0.1];

/// What a frame with a setting took.
struct Frame {
    setting: String,
    seconds: f64,
    error: f64,
}

/// The measured frames.
pub(crate) struct Frames(Vec<Frame>);

impl Frames {
    /// Renders a scene with all settings, of which each is at most `most` seconds slower than the slowest that it
    /// refines. `draw` renders a scene and returns the seconds and the error in percent.
    pub(crate) fn new(
        make: Make,
        most: f64,
        draw: impl Fn(Quality, &[&str]) -> Result<(f64, f64), String>,
    ) -> Result<Self, String> {
        let text = |maxerror| make(Quality { maxerror, ..ORDINARY });
        let has_records = text(MAXERROR[0]) != text(MAXERROR[1]);
        let records = if has_records { MAXERROR.len() } else { 1 };
        let (mut frames, mut slow) = (Vec::new(), Vec::new());
        for place in 0..SAMPLES_OF_A_PIXEL.len() * SAMPLES.len() * SHADING.len() * records {
            let (a, rest) = (place % SAMPLES_OF_A_PIXEL.len(), place / SAMPLES_OF_A_PIXEL.len());
            let (b, rest) = (rest % SAMPLES.len(), rest / SAMPLES.len());
            let (c, d) = (rest % SHADING.len(), rest / SHADING.len());
            let at = [a, b, c, d];
            // What refines a setting that is too slow is slower.
            if slow.iter().any(|slow: &[usize; 4]| slow.iter().zip(at).all(|(slow, at)| *slow <= at)) {
                continue;
            }
            let maxerror = if has_records { MAXERROR[d] } else { ORDINARY.maxerror };
            let (n, samples) = (SAMPLES_OF_A_PIXEL[a], SAMPLES[b]);
            let words = [format!("spatialquality={n},{n}"), format!("render:samples={samples}")]; // tidy: attribute: words of a command line
            let quality = Quality { shading: SHADING[c], maxerror };
            let (seconds, error) = draw(quality, &["-set", &words[0], "-set", &words[1]])?;
            if seconds > most {
                slow.push(at);
            }
            let setting =
                format!("{n} x {n}, samples {samples}, shadingquality {}, maxerror {maxerror}", SHADING[c]);
            frames.push(Frame { setting, seconds, error });
        }
        Ok(Self(frames))
    }

    /// Returns a row of the table: of a requested error, and of a requested time, each with its seconds and the error
    /// that was reached.
    pub(crate) fn row(&self, name: &str, asked: &str, [image, timed]: [(f64, f64); 2]) -> String {
        let reach = self.0.iter().filter(|frame| frame.error <= image.1);
        let fastest = reach.min_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let fast = self.0.iter().filter(|frame| frame.seconds <= timed.0);
        let best = fast.min_by(|a, b| a.error.total_cmp(&b.error));
        let mut row = format!("| {name} | {asked} % | {:.2} % | {:.2} s |", image.1, image.0);
        row += &match fastest {
            Some(frame) => format!(" {:.2} s | {:.2} |", frame.seconds, image.0 / frame.seconds),
            None => " none | |".to_owned(),
        };
        row += &match best {
            Some(frame) => {
                format!(" {:.2} % | {:.2} % | {:.2} |", timed.1, frame.error, timed.1 / frame.error)
            }
            None => format!(" {:.2} % | none | |", timed.1),
        };
        let setting = fastest.map_or("", |frame| &*frame.setting);
        format!("{row} {setting} |")
    }
}
