//! The options of an image that is the sum of passes.

use crate::Options;
use granita_session::PassOptions;
use jiff::civil::Time;
use jiff::{ToSpan, Zoned};

/// The errors of the named points, as fractions of the mean of the image: -draft, -review and -final.
const POINTS: [f32; 3] = [0.08, 0.03, 0.01];

/// A time of the day on the clock of this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TimeOfDay(Time);

impl TimeOfDay {
    /// Returns the seconds from `now` to the next such time.
    fn seconds_from(self, now: &Zoned) -> f64 {
        let at = |day: &Zoned| day.with().time(self.0).build().ok().filter(|at| at > now);
        let next = at(now).or_else(|| at(&now.checked_add(1.day()).ok()?));
        next.map_or(0.0, |next| now.duration_until(&next).as_secs_f64())
    }
}

impl Options {
    /// Returns the passes that the options request. The time ends in the same way for `-seconds` and `-until`.
    pub(crate) fn passes(&self) -> PassOptions {
        let points = [self.draft, self.review, self.final_];
        let named = points.iter().zip(POINTS).find(|(is_given, _)| **is_given).map(|(_, error)| error);
        PassOptions {
            passes: self.passes,
            seconds: self.seconds.or_else(|| self.until.map(|until| until.seconds_from(&Zoned::now()))),
            error: self.error.or(named),
            causes: self.causes,
            finer: self.finer,
            larger: self.larger,
        }
    }
}

/// Parses a number of seconds.
pub(crate) fn duration(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e9 => Ok(seconds),
        _ => Err("expected a number of seconds, more than 0".to_owned()),
    }
}

/// Parses how many times as fine surfaces are.
pub(crate) fn finer(word: &str) -> Result<u32, String> {
    match word.parse::<u32>() {
        Ok(finer @ (1 | 2 | 4 | 8 | 16 | 32)) => Ok(finer),
        _ => Err("expected 1, 2, 4, 8, 16 or 32".to_owned()),
    }
}

/// Parses how many times the samples of pixels, and of lights and rays, passes have.
pub(crate) fn larger(word: &str) -> Result<[u32; 2], String> {
    let (pixels, shading) = word.split_once(',').unwrap_or((word, "1"));
    let both = [pixels, shading].map(|factor| factor.trim().parse::<u32>());
    match both {
        [Ok(pixels @ (1 | 4 | 16)), Ok(shading @ (1 | 4 | 16))] => Ok([pixels, shading]),
        _ => Err("expected one or two of 1, 4 and 16, as \"4,1\"".to_owned()),
    }
}

/// Parses a time of the day.
pub(crate) fn time_of_day(word: &str) -> Result<TimeOfDay, String> {
    let parse = || {
        let (hours, minutes) = word.split_once(':')?;
        let is_number =
            |text: &str| (1..=2).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
        let (hour, minute) = (hours.parse().ok()?, minutes.parse().ok()?);
        (is_number(hours) && is_number(minutes)).then(|| Time::new(hour, minute, 0, 0).ok()).flatten()
    };
    parse().map(TimeOfDay).ok_or_else(|| "expected a time of the day, such as 18:30".to_owned())
}

/// Parses an error in percent. The sign is required, because 2 could be meant as 200 %.
pub(crate) fn error(word: &str) -> Result<f32, String> {
    let expected = || "expected an error in percent, more than 0, such as 2%".to_owned();
    let Some(number) = word.trim().strip_suffix('%') else { return Err(expected()) };
    match number.trim().parse::<f32>() {
        Ok(percent) if percent > 0.0 && percent.is_finite() => Ok(percent / 100.0),
        _ => Err(expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_a_sign_of_percent_and_are_more_than_0() {
        assert_eq!(error("2%"), Ok(0.02));
        assert_eq!(error("0.5 %"), Ok(0.005));
        for word in ["2", "0", "0%", "-1%", "nan%", "inf%", "%", ""] {
            assert!(error(word).unwrap_err().contains("such as 2%"), "{word}");
        }
    }

    #[test]
    fn times_are_positive() {
        assert_eq!(duration("0.5"), Ok(0.5));
        for word in ["-1", "0", "nan", "inf", "1e300", "x", ""] {
            assert!(duration(word).unwrap_err().contains("more than 0"), "{word}");
        }
    }

    #[test]
    fn a_time_of_the_day_is_the_next_one() {
        let now: Zoned = "2026-11-27T18:00:00[UTC]".parse().unwrap();
        let seconds = |word: &str| time_of_day(word).unwrap().seconds_from(&now);
        assert_eq!([seconds("18:30"), seconds("18:00"), seconds("7:05")], [1800.0, 86400.0, 47100.0]);
        for word in ["24:00", "12:60", "12", "12:", ":30", "-1:00", "12:30:10", "+1:00", "1:+2"] {
            assert!(time_of_day(word).unwrap_err().contains("18:30"), "{word}");
        }
    }
}
