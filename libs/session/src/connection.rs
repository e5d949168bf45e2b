//! A stream of frames to a program in another process.

use granita_base::report::Message;
use granita_base::{Reporter, Severity};
use granita_pyg::frames::{framed, put_text};
use parking_lot::Mutex;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Sends whole frames to a program from any thread. Clones share the stream.
#[derive(Clone)]
pub struct Connection(Arc<Inner>);

struct Inner {
    to: Mutex<Box<dyn Write + Send>>,
    /// The number of images sent, which gives each its index.
    images: AtomicU32,
}

impl std::fmt::Debug for Connection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Connection")
    }
}

impl Connection {
    /// Returns a connection that writes to `to`.
    pub fn new(to: Box<dyn Write + Send>) -> Self {
        Self(Arc::new(Inner { to: Mutex::new(to), images: AtomicU32::new(0) }))
    }

    /// Sends a frame. Errors are dropped, because a program that has ended cannot receive them.
    pub fn say(&self, kind: u8, parts: &[&[u8]]) {
        if let Ok(frame) = framed(kind, parts) {
            let _ = self.put(&frame);
        }
    }

    /// Sends a text that the program prints.
    pub fn print(&self, text: &str) {
        self.say(b'P', &[text.as_bytes()]);
    }

    /// Returns a reporter that sends messages as frames `M`, and the output of shaders as frames `P`.
    pub fn reporter(&self) -> Reporter {
        let connection = self.clone();
        Reporter::new(Box::new(move |message| match message.severity {
            Severity::Message => connection.print(&message.text),
            _ => connection.say(b'M', &[&message_bytes(message)]),
        }))
    }

    /// Returns the index of the next image that is sent.
    pub(crate) fn image_number(&self) -> u32 {
        self.0.images.fetch_add(1, Ordering::Relaxed)
    }

    fn put(&self, bytes: &[u8]) -> io::Result<()> {
        let mut to = self.0.to.lock();
        to.write_all(bytes)?;
        to.flush()
    }
}

/// Receives whole frames, which `granita_pyg::serve` makes.
impl Write for Connection {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.put(bytes).map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Returns the payload of `M`.
pub(crate) fn message_bytes(message: &Message) -> Vec<u8> {
    let mut out = Vec::new();
    for number in [message.severity.code() as u32, message.at.line, message.at.column] {
        out.extend(number.to_le_bytes());
    }
    put_text(&message.at.file, &mut out);
    put_text(&message.text, &mut out);
    out
}
