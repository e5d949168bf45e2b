//! A virtual screen, for programs with windows.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};

/// A screen of Xvfb, which ends when it is dropped.
#[derive(Debug)]
pub struct Screen {
    server: Child,
    /// The output of the server, open as long as the server runs.
    _words: BufReader<ChildStdout>,
    /// The value of `DISPLAY` for programs on it.
    pub name: String,
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Both calls fail when the server has already ended.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Screen {
    /// Starts a screen of a width and a height in pixels.
    ///
    /// # Errors
    /// Returns a message when Xvfb cannot be started.
    pub fn start([width, height]: [u32; 2]) -> Result<Self, String> {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", &format!("{width}x{height}x24"), "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| format!("Xvfb: {e}"))?;
        let mut words = BufReader::new(server.stdout.take().ok_or("Xvfb says nothing")?);
        let mut line = String::new();
        words.read_line(&mut line).map_err(|e| format!("Xvfb: {e}"))?;
        Ok(Self { server, _words: words, name: format!(":{}", line.trim()) })
    }
}
