//! Tests of the server over real sockets, with a client of web sockets in place of a browser.

use super::*;
use granita_image::PixelRect;
use std::io::{Read, Write};

fn serving(live: &Live) -> Server {
    Server::start(([127, 0, 0, 1], 0).into(), &[], live.clone(), None).unwrap()
}

/// Sends bytes. Returns the answer until the connection ends.
fn ask(server: &Server, bytes: &str) -> String {
    let mut socket = TcpStream::connect(server.address).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let _ = socket.write_all(bytes.as_bytes());
    let mut answer = Vec::new();
    let _ = socket.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

fn get(server: &Server, path: &str, headers: &str) -> String {
    ask(server, &format!("GET {path} HTTP/1.1\r\nHost: {}\r\n{headers}\r\n", server.address))
}

#[test]
fn the_page_is_served_only_under_its_token() {
    let live = Live::default();
    let server = serving(&live);
    let token = server.url().split('/').nth(3).unwrap();
    assert_eq!(token.len(), 32);
    assert_ne!(serving(&live).url().split('/').nth(3), Some(token));
    let page = get(&server, &format!("/{token}/"), "");
    assert!(page.starts_with("HTTP/1.1 200 OK\r\n") && page.ends_with("</html>\n"), "{page}");
    assert!(page.contains("Content-Security-Policy: default-src 'none'"));
    // The page does not load anything from other servers.
    for foreign in ["http://", "https://", "src=", "@import", "url("] {
        assert!(!super::page().contains(foreign), "{foreign}");
    }
    let wrong = "0".repeat(32);
    for path in [
        "/",
        "/live",
        &format!("/{wrong}/"),
        &format!("/{wrong}/live"),
        &format!("/{token}"),
        "/../etc/passwd",
    ] {
        assert!(get(&server, path, "").starts_with("HTTP/1.1 404"), "{path}");
    }
    let post = ask(&server, &format!("POST /{token}/ HTTP/1.1\r\nContent-Length: 0\r\n\r\n"));
    assert!(post.starts_with("HTTP/1.1 405"), "{post}");
    for wrong in [
        " \r\n\r\n",
        "GET\r\n\r\n",
        "\u{1}\r\n\r\n",
        &format!("GET / HTTP/1.1\r\nA: {}\r\n\r\n", "x".repeat(40_000)),
    ] {
        let answer = ask(&server, wrong);
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 400"), "{answer}");
    }
    // The socket accepts only the page of this server.
    let asks = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";
    let path = format!("/{token}/live");
    for headers in ["", "Upgrade: websocket\r\n", &format!("{asks}Origin: http://evil.example\r\n")] {
        assert!(get(&server, &path, headers).starts_with("HTTP/1.1 403"), "{headers}");
    }
    // A request with another host name belongs to a page of another origin.
    for host in ["evil.example", "evil.example:80", "10.9.8.7"] {
        for path in [format!("/{token}/"), path.clone()] {
            let answer = ask(&server, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{asks}\r\n"));
            assert!(answer.starts_with("HTTP/1.1 421"), "{answer}");
        }
    }
    let own = ask(&server, &format!("GET /{token}/ HTTP/1.1\r\nHost: localhost:1\r\n\r\n"));
    assert!(own.starts_with("HTTP/1.1 200"), "{own}");
    // The connections end with the server.
    let address = server.address;
    drop(server);
    std::thread::sleep(Duration::from_millis(200));
    assert!(TcpStream::connect(address).is_err());
}

#[test]
fn incomplete_requests_do_not_block_browsers() {
    let live = Live::default();
    let server = serving(&live);
    let mut slow: Vec<TcpStream> = Vec::new();
    for _ in 0..2 * CONNECTIONS {
        let mut socket = TcpStream::connect(server.address).unwrap();
        let _ = socket.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nA: b");
        slow.push(socket);
    }
    let begin = Instant::now();
    let path = server.url().splitn(4, '/').nth(3).unwrap();
    assert!(get(&server, &format!("/{path}"), "").starts_with("HTTP/1.1 200"));
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    let address = server.address;
    drop(server);
    // These connections also end with the server.
    let last = slow.last_mut().unwrap();
    last.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let late = |e: std::io::Error| is_later(&Error::Io(e));
    assert!(!last.read(&mut [0]).is_err_and(late));
    is_closed(address);
}

/// Waits until the address is free.
fn is_closed(address: SocketAddr) {
    let begin = Instant::now();
    while TcpStream::connect(address).is_ok() {
        assert!(begin.elapsed() < Duration::from_secs(5), "{address} is listened on still");
    }
}

#[test]
fn a_server_on_all_addresses_ends() {
    let live = Live::default();
    let server = Server::start(([0, 0, 0, 0], 0).into(), &["box".to_owned()], live, None).unwrap();
    let port = server.address.port();
    drop(server);
    is_closed(([127, 0, 0, 1], port).into());
}

#[test]
fn a_browser_receives_images_and_changes() {
    let live = Live::default();
    let server = serving(&live);
    live.create("a", 40, 30, &["R".to_owned(), "G".to_owned(), "B".to_owned()]).unwrap();
    let socket = TcpStream::connect(server.address).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let url = format!("ws{}live", server.url().strip_prefix("http").unwrap());
    let (mut web, _) = tungstenite::client(url, socket).unwrap();
    let text = |message: tungstenite::Message| message.into_text().unwrap().to_string();
    let list = text(web.read().unwrap());
    assert!(list.contains("\"name\":\"a\"") && list.contains("\"height\":30"), "{list}");
    let id = live.info("a").unwrap().id;
    web.send(tungstenite::Message::text(format!("{{\"show\":{id},\"channels\":[0,1,2]}}"))).unwrap();
    assert!(text(web.read().unwrap()).contains("\"image\":"));
    assert_eq!(web.read().unwrap().into_data().len(), 32 + 40 * 30 * 3 * 2);
    live.mark("a", PixelRect::at(8, 8, 8, 8));
    assert_eq!(text(web.read().unwrap()), "{\"marks\":[[8,8,8,8]]}");
    live.update("a", &[(0, 0, 0), (1, 0, 0), (2, 0, 0)], PixelRect::at(8, 8, 8, 8), &[0.5]).unwrap();
    assert_eq!(text(web.read().unwrap()), "{\"marks\":[]}");
    let pixels = web.read().unwrap().into_data();
    assert_eq!((pixels.len(), &pixels[32..34]), (32 + 64 * 6, &[0x00, 0x38][..]));
    // Invalid messages are ignored. A message that is too large ends the connection.
    web.send(tungstenite::Message::text("{\"show\":")).unwrap();
    web.send(tungstenite::Message::binary(vec![0; 100])).unwrap();
    let detail = format!("{{\"detail\":{id},\"scale\":1,\"rect\":[0,0,9,9]}}");
    web.send(tungstenite::Message::text(detail)).unwrap();
    web.send(tungstenite::Message::text("{\"probe\":[8,8]}")).unwrap();
    assert_eq!(text(web.read().unwrap()), "{\"probe\":[8,8],\"values\":[\"0.5\",\"0.5\",\"0.5\"]}");
    live.close("a");
    assert_eq!(text(web.read().unwrap()), format!("{{\"images\":[],\"shown\":0}}"));
    let _ = web.send(tungstenite::Message::text("x".repeat(1 << 20)));
    assert!((0..10).any(|_| web.read().is_err()), "it is sent away");
}
