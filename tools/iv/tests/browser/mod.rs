//! A headless browser with one page, controlled through its debugging port.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use serde_json::{Value, json};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The longest wait for a browser on a busy machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A process that ends with the test.
pub(crate) struct Running(pub(crate) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Returns the browser of this machine; `None` when there is none.
pub(crate) fn browser() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    std::env::split_paths(&folders).flat_map(|f| names.map(|n| f.join(n))).find(|path| path.is_file())
}

/// A browser with one page.
pub(crate) struct Page {
    web: tungstenite::WebSocket<TcpStream>,
    session: String,
    calls: u64,
    _browser: Running,
}

impl Page {
    /// Opens a page of `size` pixels. The browser keeps its files in a folder.
    pub(crate) fn open(browser: &Path, folder: &Path, url: &str, size: [u32; 2]) -> Self {
        let mut command = Command::new(browser);
        command
            .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--hide-scrollbars", "--no-first-run", "--remote-debugging-port=0"])
            .arg(format!("--user-data-dir={}", folder.display()))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let browser = Running(command.spawn().unwrap());
        let begin = Instant::now();
        let (port, path) = loop {
            let text = std::fs::read_to_string(folder.join("DevToolsActivePort")).unwrap_or_default();
            if let Some((port, path)) = text.split_once('\n').filter(|(_, path)| !path.is_empty()) {
                break (port.parse::<u16>().unwrap(), path.trim().to_owned());
            }
            assert!(begin.elapsed() < PATIENCE, "the browser does not start");
            std::thread::sleep(Duration::from_millis(20));
        };
        let socket = TcpStream::connect(("127.0.0.1", port)).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let (web, _) = tungstenite::client(format!("ws://127.0.0.1:{port}{path}"), socket).unwrap();
        let mut page = Self { web, session: String::new(), calls: 0, _browser: browser };
        let target = page.call("Target.createTarget", json!({"url": url}))["targetId"].clone();
        let session = page.call("Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        page.session = session["sessionId"].as_str().unwrap().to_owned();
        let size = json!({"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": false});
        page.call("Emulation.setDeviceMetricsOverride", size);
        page
    }

    /// Calls a method of the browser's protocol and returns the result.
    pub(crate) fn call(&mut self, method: &str, params: Value) -> Value {
        self.calls += 1;
        let mut call = json!({"id": self.calls, "method": method, "params": params});
        if !self.session.is_empty() {
            call["sessionId"] = json!(self.session);
        }
        self.web.send(tungstenite::Message::text(call.to_string())).unwrap();
        loop {
            let answer: Value = serde_json::from_str(&self.web.read().unwrap().into_text().unwrap()).unwrap();
            if answer["id"] == json!(self.calls) {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }
}
