//! Live images in browsers (`iv -serve`), for machines without a screen.
//!
//! One port serves one page, which is self-contained, and its web socket. Both are found only under a random word in
//! the address, which is printed. A page cannot change anything here, but for images with a panel the edits of its
//! user are passed on to the sender of the image. Pages on other machines only watch. Each page has its own exposure,
//! zoom, position, display and view.

mod blocks;
mod detail;
mod http;
mod incoming;
mod look;
mod message;
mod page;

use crate::listen::{self, NetArgs, files};
use granita_base::{Location, Reporter, Severity};
use granita_cli::Status;
use granita_display::{Place, Places, listen_address};
use granita_image::FormatRegistry;
use granita_view::{Live, Viewing};
use incoming::Incoming;
use look::Look;
use message::Message;
use page::Page;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, WebSocket};

/// The HTML text of the page, with the places of the style and the code of the desk for lighting.
const PAGE: &str = include_str!("page.html");
/// The style and the code of the desk for lighting.
const DESK: [(&str, &str); 2] =
    [("/* desk.css */", include_str!("desk.css")), ("/* desk.js */", include_str!("desk.js"))];
/// The largest number of connections at once. A browser has one or two.
const CONNECTIONS: usize = 64;
/// The largest number of connections of one address at once.
const CONNECTIONS_OF_ADDRESS: usize = 48;
/// The longest time for which a message waits for a browser that does not read.
const STALL: Duration = Duration::from_secs(20);
/// The interval at which the thread of a page checks whether the server ends.
const TICK: Duration = Duration::from_millis(40);

/// A server of pages. It ends when it is dropped.
pub(crate) struct Server {
    address: SocketAddr,
    url: String,
    shared: Arc<Shared>,
}

/// Returns the whole text of the page.
fn page() -> String {
    DESK.iter().fold(PAGE.to_owned(), |page, (place, text)| page.replace(place, text))
}

struct Shared {
    live: Live,
    /// The view through which pages show images at first.
    viewing: Option<Viewing>,
    token: String,
    hosts: http::Hosts,
    places: Arc<Places>,
}

impl Server {
    /// Serves `live` at `address`, also to browsers that request it by one of `names`. Port 0 stands for any free port.
    /// Pages show images through `viewing`, if there is one, until their users choose another display or view.
    ///
    /// # Errors
    /// Returns the error of the system.
    pub(crate) fn start(
        address: SocketAddr,
        names: &[String],
        live: Live,
        viewing: Option<Viewing>,
    ) -> std::io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|e| std::io::Error::other(e.to_string()))?;
        let token: String = random.iter().map(|b| format!("{b:02x}")).collect();
        let url = format!("http://{address}/{token}/");
        let hosts = http::Hosts::new(address.ip(), names);
        let places = Places::new(CONNECTIONS, CONNECTIONS_OF_ADDRESS);
        let shared = Arc::new(Shared { live, viewing, token, hosts, places });
        let own = shared.clone();
        std::thread::Builder::new().name("pages".to_owned()).spawn(move || accept(&own, &listener))?;
        Ok(Self { address, url, shared })
    }

    /// Returns the address of the page.
    pub(crate) fn url(&self) -> &str {
        &self.url
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.places.close(self.address);
    }
}

fn accept(shared: &Arc<Shared>, listener: &TcpListener) {
    for id in 1.. {
        let accepted = listener.accept();
        if shared.places.is_ending() {
            return;
        }
        let Ok((socket, address)) = accepted else {
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let Ok(place) = shared.places.take(id, &socket, address) else { continue };
        let own = shared.clone();
        // When no thread can be started, the connection ends and the browser tries again.
        let _ =
            std::thread::Builder::new().name("page".to_owned()).spawn(move || converse(&own, &place, socket));
    }
}

/// Answers one request.
fn converse(shared: &Shared, place: &Place, mut socket: TcpStream) {
    let _ = socket.set_nodelay(true);
    let Some((request, more)) = http::Request::read(&mut socket) else {
        let _ = http::answer(&mut socket, "400 Bad Request", "text/plain", b"this is not a request\n");
        return;
    };
    let below = request.path.strip_prefix('/').and_then(|path| path.strip_prefix(&*shared.token));
    let is_own = request.header("host").is_some_and(|host| shared.hosts.accept(host));
    let result = match (&*request.method, below) {
        ("GET" | "HEAD", _) if !is_own => {
            let text = b"this is not a name of this server (see iv -servename)\n";
            http::answer(&mut socket, "421 Misdirected Request", "text/plain", text)
        }
        ("GET", Some("/")) => {
            http::answer(&mut socket, "200 OK", "text/html; charset=utf-8", page().as_bytes())
        }
        ("GET", Some("/live")) => {
            match http::upgrade(&mut socket, &request) {
                Some(()) => {
                    // The request contains the random word of the address, so it is trusted.
                    place.heard();
                    show(shared, socket, more);
                }
                None => {
                    let _ = http::answer(
                        &mut socket,
                        "403 Forbidden",
                        "text/plain",
                        b"only the page of this server may connect\n",
                    );
                }
            }
            return;
        }
        ("GET" | "HEAD", _) => http::answer(&mut socket, "404 Not Found", "text/plain", b"not found\n"),
        _ => http::answer(
            &mut socket,
            "405 Method Not Allowed",
            "text/plain",
            b"only GET and HEAD are allowed\n",
        ),
    };
    drop(result);
}

/// Keeps a page up to date until it is closed. `more` holds the bytes that came with its request.
fn show(shared: &Shared, socket: TcpStream, more: Vec<u8>) {
    if socket.set_write_timeout(Some(TICK)).is_err() {
        return;
    }
    // A page on another machine has the address, but lights may be changed from this machine only.
    let may_edit = socket.peer_addr().is_ok_and(|address| address.ip().is_loopback());
    let config = WebSocketConfig::default()
        .max_message_size(Some(1 << 16))
        .max_frame_size(Some(1 << 16))
        .write_buffer_size(0)
        .max_write_buffer_size(64 << 20);
    let live = shared.live.clone();
    let Ok(socket) = Incoming::new(socket, move || live.wake()) else { return };
    let is_ready = socket.readiness();
    let mut web = WebSocket::from_partially_read(socket, more, Role::Server, Some(config));
    let mut page = Page::new(shared.live.clone(), may_edit, Look::new(shared.viewing.clone()));
    while !shared.places.is_ending() {
        let mut answers = page.news();
        loop {
            match web.read() {
                Ok(tungstenite::Message::Text(text)) => answers.extend(page.hear(&text)),
                Ok(tungstenite::Message::Close(_)) => {
                    let _ = web.flush();
                    return;
                }
                Ok(_) => (),
                Err(error) if is_later(&error) => break,
                Err(_) => return,
            }
        }
        for answer in answers {
            let message = match answer {
                Message::Text(text) => tungstenite::Message::text(text),
                Message::Pixels(bytes) => tungstenite::Message::binary(bytes),
            };
            if !send(&mut web, message) {
                return;
            }
        }
        if !page.is_behind() {
            shared.live.wait_unless(page.version(), TICK, &is_ready);
        }
    }
    let _ = web.close(None);
    let _ = web.flush();
}

/// Sends a message, as long as the browser keeps reading. Returns false when the connection is lost.
fn send(web: &mut WebSocket<Incoming>, message: tungstenite::Message) -> bool {
    let begin = Instant::now();
    let mut result = web.write(message);
    loop {
        match result {
            Ok(()) => (),
            Err(ref error) if is_later(error) => (),
            Err(_) => return false,
        }
        match web.flush() {
            Ok(()) => return true,
            Err(error) if is_later(&error) && begin.elapsed() < STALL => result = Ok(()),
            Err(_) => return false,
        }
    }
}

/// True when the error is only an expired time limit.
fn is_later(error: &Error) -> bool {
    matches!(error, Error::Io(e)
        if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted))
}

/// Returns the names that the user gave with -servename and before the port of -serve.
fn names(args: &NetArgs, serve: &str) -> Vec<String> {
    let named = serve.rsplit_once(':').map(|(host, _)| host.to_owned());
    args.servename.iter().cloned().chain(named).collect()
}

/// Runs `-serve`. It returns only when it cannot begin.
pub(crate) fn run(
    args: &NetArgs,
    paths: &[PathBuf],
    viewing: Option<Viewing>,
    formats: &FormatRegistry,
    reporter: &Reporter,
) -> Status {
    let live = Live::default();
    let begun = args.serve.as_deref().map_or(Err("-serve needs a port".to_owned()), |text| {
        let address = listen_address(text).map_err(|e| format!("-serve: {e}"))?;
        Server::start(address, &names(args, text), live.clone(), viewing)
            .map_err(|e| format!("cannot serve pages on {address}: {e}"))
    });
    let server = match begun {
        Ok(server) => server,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    if !server.address.ip().is_loopback() {
        reporter.warning(format!(
            "{} can be reached from other machines; the page is not encrypted",
            server.address
        ));
    }
    let open = args.allowopen.then(|| files::opener(&live, formats, reporter));
    let _listener = match listen::begin(args, true, &live, reporter, open) {
        // No image could ever be shown.
        Ok(None) if paths.is_empty() => return Status::Failed,
        Ok(listener) => listener,
        Err(error) => {
            reporter.error(error.to_string());
            return Status::Failed;
        }
    };
    let text = format!("iv: serving {}\n", server.url());
    reporter.say(Severity::Message, &Location::default(), text);
    for file in paths {
        if let Err(what) = files::read(&live, formats, file) {
            reporter.error(what);
        }
    }
    if args.endwithinput {
        // The program that started this one holds the other end of standard input.
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        return Status::Done;
    }
    loop {
        std::thread::park();
    }
}

#[cfg(test)]
mod tests;
