//! The socket of a page, which is read only when there is something to read.
//!
//! The thread of a page waits for changes of images. Another thread waits for bytes of the browser and wakes it, so
//! that a message of the browser is processed at once.

use parking_lot::{Condvar, Mutex};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::Duration;

/// The interval at which the waiting thread checks whether it should end.
const TICK: Duration = Duration::from_secs(1);

/// What the two threads know of the socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Input {
    /// Nothing can be read.
    None,
    /// A read does not wait: there are bytes, the end, or an error.
    Ready,
    /// The socket is dropped.
    Over,
}

#[derive(Debug)]
struct Shared {
    input: Mutex<Input>,
    changed: Condvar,
}

/// A socket whose reads never wait. Without input they fail with [`ErrorKind::WouldBlock`].
#[derive(Debug)]
pub(super) struct Incoming {
    stream: TcpStream,
    shared: Arc<Shared>,
}

impl Incoming {
    /// Returns a socket. `wake` is called when there is input, after [`Incoming::is_ready`] returns true.
    ///
    /// # Errors
    /// Returns the error of the system when the socket or a thread is refused.
    pub(super) fn new(stream: TcpStream, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        stream.set_read_timeout(Some(TICK))?;
        let watched = stream.try_clone()?;
        let shared = Arc::new(Shared { input: Mutex::new(Input::None), changed: Condvar::new() });
        let own = shared.clone();
        let watch = move || own.watch(&watched, &wake);
        std::thread::Builder::new().name("page input".to_owned()).spawn(watch)?;
        Ok(Self { stream, shared })
    }

    /// Returns a function that is true while a read does not wait.
    pub(super) fn readiness(&self) -> impl Fn() -> bool + use<> {
        let shared = self.shared.clone();
        move || *shared.input.lock() == Input::Ready
    }
}

impl Shared {
    /// Waits for input until the socket is dropped.
    fn watch(&self, stream: &TcpStream, wake: &dyn Fn()) {
        loop {
            let seen = stream.peek(&mut [0]);
            let is_later = |kind| matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut);
            let nothing = seen.is_err_and(|e| is_later(e.kind()) || e.kind() == ErrorKind::Interrupted);
            let mut input = self.input.lock();
            if *input == Input::Over {
                return;
            }
            if nothing {
                continue;
            }
            *input = Input::Ready;
            drop(input);
            wake();
            let mut input = self.input.lock();
            while *input == Input::Ready {
                self.changed.wait(&mut input);
            }
        }
    }
}

impl Drop for Incoming {
    fn drop(&mut self) {
        *self.shared.input.lock() = Input::Over;
        self.shared.changed.notify_all();
        // The other thread ends at once. The browser may have closed the connection before.
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}

impl Read for Incoming {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if *self.shared.input.lock() != Input::Ready {
            return Err(ErrorKind::WouldBlock.into());
        }
        let result = self.stream.read(buffer);
        *self.shared.input.lock() = Input::None;
        self.shared.changed.notify_all();
        result
    }
}

impl Write for Incoming {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::sync::mpsc;

    #[test]
    fn input_wakes_and_reads_do_not_wait() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut browser = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (to, woken) = mpsc::channel();
        let mut socket = Incoming::new(listener.accept().unwrap().0, move || _ = to.send(())).unwrap();
        let is_ready = socket.readiness();
        let patience = Duration::from_secs(20);
        let mut buffer = [0; 8];
        assert_eq!(socket.read(&mut buffer).unwrap_err().kind(), ErrorKind::WouldBlock);
        for text in [b"one", b"two"] {
            assert!(!is_ready());
            browser.write_all(text).unwrap();
            woken.recv_timeout(patience).unwrap();
            assert!(is_ready());
            assert_eq!((socket.read(&mut buffer).unwrap(), &buffer[..3]), (3, &text[..]));
            assert_eq!(socket.read(&mut buffer).unwrap_err().kind(), ErrorKind::WouldBlock);
        }
        // What is left of the input wakes again.
        browser.write_all(b"0123456789").unwrap();
        let mut taken = Vec::new();
        while taken.len() < 10 {
            woken.recv_timeout(patience).unwrap();
            let count = socket.read(&mut buffer).unwrap();
            taken.extend_from_slice(&buffer[..count]);
        }
        assert_eq!(taken, b"0123456789");
        // The end is input as well.
        drop(browser);
        woken.recv_timeout(patience).unwrap();
        assert_eq!(socket.read(&mut buffer).unwrap(), 0);
        // The thread ends with the socket, and with it the other end of the channel.
        drop(socket);
        while let Ok(()) = woken.recv_timeout(patience) {}
        assert_eq!(woken.recv_timeout(patience), Err(mpsc::RecvTimeoutError::Disconnected));
    }
}
