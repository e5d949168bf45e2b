//! Containment of panics of external decoders.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs a decoder of another library. `Err` is the text of its panic.
///
/// Readers return an error for any damage to a file. Where a library panics instead (an unchecked subtraction, an
/// index past the end), this function turns the panic into an error. Data that the closure was filling must be
/// discarded after an `Err`.
///
/// # Errors
/// The text of the panic.
pub fn contained<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(decode)).map_err(|payload| {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
        format!("the decoder failed ({})", text.unwrap_or("no reason given"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_errors() {
        assert_eq!(contained(|| 3), Ok(3));
        let list: Vec<u8> = Vec::new();
        let fault = contained(|| list[std::hint::black_box(1)]).unwrap_err();
        assert!(fault.contains("index out of bounds"), "{fault}");
    }
}
