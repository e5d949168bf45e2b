//! Reads from a process that may be stopped or silent.

use std::io::{self, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// The step in which silence is counted. When this process was stopped together with the other one, that time
/// counts as one step.
const STEP: Duration = Duration::from_millis(100);

/// The interval of the signs of life of a working process.
pub(crate) const PULSE: Duration = Duration::from_millis(500);

/// The shortest patience in seconds, which is a few signs of life.
pub(crate) const LEAST_PATIENCE: f32 = 2.0;

/// The longest silence before a timeout. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Patience(Arc<AtomicU32>);

impl Patience {
    /// Returns a patience of this number of seconds, at least [`LEAST_PATIENCE`].
    pub(crate) fn new(seconds: f32) -> Self {
        let patience = Self(Arc::default());
        patience.set(seconds);
        patience
    }

    pub(crate) fn set(&self, seconds: f32) {
        let steps = seconds.max(LEAST_PATIENCE) / STEP.as_secs_f32();
        self.0.store(steps.ceil() as u32, Ordering::Relaxed);
    }

    fn steps(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Returns the time.
    pub(crate) fn duration(&self) -> Duration {
        STEP * self.steps()
    }

    /// Returns the error of a timeout.
    fn over(&self) -> io::Error {
        let seconds = f64::from(self.steps()) * STEP.as_secs_f64();
        io::Error::new(io::ErrorKind::TimedOut, format!("it has been silent for {seconds} s"))
    }
}

/// Reads the data that a separate thread receives. A read fails when nothing has arrived for too long
/// ([`io::ErrorKind::TimedOut`]).
pub(crate) struct Patient {
    pieces: Receiver<io::Result<Vec<u8>>>,
    piece: Vec<u8>,
    at: usize,
    ended: bool,
    patience: Patience,
    /// The number of steps since something arrived.
    silent: u32,
}

impl Patient {
    pub(crate) fn new(mut from: impl Read + Send + 'static, patience: Patience) -> io::Result<Self> {
        let (sender, pieces) = sync_channel(4);
        std::thread::Builder::new().name("reader".to_owned()).spawn(move || {
            let mut room = vec![0; 1 << 16];
            loop {
                let piece = match from.read(&mut room) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                    Ok(n) => Ok(room[..n].to_vec()),
                    Err(error) => Err(error),
                };
                let ends = piece.as_ref().map_or(true, Vec::is_empty);
                if sender.send(piece).is_err() || ends {
                    return;
                }
            }
        })?;
        Ok(Self { pieces, piece: Vec::new(), at: 0, ended: false, patience, silent: 0 })
    }

    /// Returns how long nothing has arrived while it was waited for.
    pub(crate) fn silence(&self) -> Duration {
        STEP * self.silent
    }

    /// Begins to count silence anew, for a process that is given work.
    pub(crate) fn excuse(&mut self) {
        self.silent = 0;
    }

    /// Takes what has arrived, after [`Patient::wait`]; `None` at the end.
    pub(crate) fn arrived(&mut self) -> Option<Vec<u8>> {
        let piece = std::mem::take(&mut self.piece).split_off(self.at);
        self.at = 0;
        if piece.is_empty() && self.ended { None } else { Some(piece) }
    }

    /// Waits until there is data to read, or its end. Returns false when `gives_up` returns true before. Then the
    /// silence of the next call adds to that of this one.
    pub(crate) fn wait(&mut self, gives_up: &dyn Fn() -> bool) -> io::Result<bool> {
        while self.at == self.piece.len() && !self.ended {
            match self.pieces.recv_timeout(STEP) {
                Ok(Ok(piece)) => {
                    self.ended = piece.is_empty();
                    (self.piece, self.at) = (piece, 0);
                    self.silent = 0;
                }
                Ok(Err(error)) => {
                    self.ended = true;
                    return Err(error);
                }
                Err(RecvTimeoutError::Disconnected) => self.ended = true,
                Err(RecvTimeoutError::Timeout) => {
                    self.silent += 1;
                    if self.silent >= self.patience.steps() {
                        return Err(self.patience.over());
                    }
                    if gives_up() {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(true)
    }
}

impl Read for Patient {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if !into.is_empty() {
            self.wait(&|| false)?;
        }
        let n = into.len().min(self.piece.len() - self.at);
        into[..n].copy_from_slice(&self.piece[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::time::Instant;

    #[test]
    fn silence_is_an_error_and_an_end_is_none() {
        let (from, mut to) = io::pipe().unwrap();
        let mut patient = Patient::new(from, Patience::new(0.0)).unwrap();
        to.write_all(b"abc").unwrap();
        let mut bytes = [0; 2];
        patient.read_exact(&mut bytes).unwrap();
        assert_eq!(&bytes, b"ab");
        let begin = Instant::now();
        assert!(patient.wait(&|| true).unwrap(), "one byte is there");
        patient.read_exact(&mut bytes[..1]).unwrap();
        assert!(!patient.wait(&|| true).unwrap());
        assert!(begin.elapsed() < Duration::from_secs(1));
        let error = patient.read(&mut bytes).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert_eq!(error.to_string(), "it has been silent for 2 s");
        assert!(begin.elapsed() >= Duration::from_secs(2));
        drop(to);
        assert_eq!(patient.read(&mut bytes).unwrap(), 0);
        assert_eq!(patient.read(&mut bytes).unwrap(), 0);
    }
}
