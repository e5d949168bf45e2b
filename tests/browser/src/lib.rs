//! A headless browser with one page, for tests of the pages of `iv` and for the benches that measure them.
//!
//! The browser is controlled through its debugging port, which is a web socket of this machine. [`find`] returns the
//! browser of this machine, and [`Page::open`] starts it. Both the browser and its page end when the page is dropped.
//!
//! A web driver is deliberately absent: the tests need no program besides the browser.
//!
//! ```no_run
//! # fn main() -> Result<(), String> {
//! let Some(browser) = granita_browser::find() else { return Ok(()) };
//! let mut page = granita_browser::Page::open(&browser, "profile".as_ref(), "about:blank", [600, 400])?;
//! assert_eq!(page.value("1 + 1")?, 2);
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]

use serde_json::{Value, json};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The longest wait for a browser on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// The interval at which a condition is tested.
const POLL: Duration = Duration::from_millis(30);

/// A process that ends when it is dropped.
#[derive(Debug)]
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        // Both calls fail when the process has already ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Returns the browser of this machine; `None` when there is none.
pub fn find() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    std::env::split_paths(&folders).flat_map(|f| names.map(|n| f.join(n))).find(|path| path.is_file())
}

/// A browser with one page.
#[derive(Debug)]
pub struct Page {
    web: tungstenite::WebSocket<TcpStream>,
    session: String,
    calls: u64,
    _browser: Running,
}

impl Page {
    /// Opens a page of `size` (width and height) pixels. The browser keeps its files in an existing, empty folder.
    ///
    /// # Errors
    /// Returns a message when the browser cannot be started or its port does not answer.
    pub fn open(browser: &Path, folder: &Path, url: &str, size: [u32; 2]) -> Result<Self, String> {
        let name = browser.display();
        let mut command = Command::new(browser);
        command
            .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--hide-scrollbars", "--no-first-run", "--remote-debugging-port=0"])
            .arg(format!("--user-data-dir={}", folder.display()))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let browser = Running(command.spawn().map_err(|e| format!("{name}: {e}"))?);
        let begin = Instant::now();
        let (port, path) = loop {
            let text = std::fs::read_to_string(folder.join("DevToolsActivePort")).unwrap_or_default();
            if let Some((port, path)) = text.split_once('\n').filter(|(_, path)| !path.is_empty()) {
                let port = port.parse::<u16>().map_err(|_| format!("{name}: \"{port}\" is not a port"))?;
                break (port, path.trim().to_owned());
            }
            if begin.elapsed() > PATIENCE {
                return Err(format!("{name}: it did not start within {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(POLL);
        };
        let failed = |error: std::io::Error| format!("{name}, port {port}: {error}");
        let socket = TcpStream::connect(("127.0.0.1", port)).map_err(failed)?;
        socket.set_nodelay(true).map_err(failed)?;
        socket.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        let (web, _) = tungstenite::client(format!("ws://127.0.0.1:{port}{path}"), socket)
            .map_err(|e| format!("{name}, port {port}: {e}"))?;
        let mut page = Self { web, session: String::new(), calls: 0, _browser: browser };
        let target = page.call("Target.createTarget", json!({"url": url}))?["targetId"].clone();
        let attached = page.call("Target.attachToTarget", json!({"targetId": target, "flatten": true}))?;
        page.session = attached["sessionId"].as_str().unwrap_or_default().to_owned();
        let size = json!({"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": false});
        page.call("Emulation.setDeviceMetricsOverride", size)?;
        Ok(page)
    }

    /// Calls a method of the browser's protocol and returns the result.
    ///
    /// # Errors
    /// Returns the error of the browser, or that of the connection.
    pub fn call(&mut self, method: &str, params: Value) -> Result<Value, String> {
        self.calls += 1;
        let mut call = json!({"id": self.calls, "method": method, "params": params});
        if !self.session.is_empty() {
            call["sessionId"] = json!(self.session);
        }
        let failed = |error: tungstenite::Error| format!("{method}: {error}");
        self.web.send(tungstenite::Message::text(call.to_string())).map_err(failed)?;
        loop {
            let text = self.web.read().and_then(tungstenite::Message::into_text).map_err(failed)?;
            let answer: Value = serde_json::from_str(&text).map_err(|e| format!("{method}: {e}: {text}"))?;
            if answer["id"] == json!(self.calls) {
                return match answer.get("error") {
                    None => Ok(answer["result"].clone()),
                    Some(_) => Err(format!("{method}: {answer}")),
                };
            }
        }
    }

    /// Returns the value of an expression of the page.
    ///
    /// # Errors
    /// Returns the errors of [`Page::call`], and the exception that the expression throws.
    pub fn value(&mut self, code: &str) -> Result<Value, String> {
        let result = self.call("Runtime.evaluate", json!({"expression": code, "returnByValue": true}))?;
        match result.get("exceptionDetails") {
            None => Ok(result["result"]["value"].clone()),
            Some(_) => Err(format!("{code}: {result}")),
        }
    }

    /// Waits until an expression of the page is true. An expression that throws is not true.
    ///
    /// # Errors
    /// Returns the errors of [`Page::call`], and the expression when it is not true within [`PATIENCE`].
    pub fn until(&mut self, code: &str) -> Result<(), String> {
        let begin = Instant::now();
        // The page may not be loaded yet.
        let tried = format!("(() => {{ try {{ return !!({code}); }} catch {{ return false; }} }})()");
        while self.value(&tried)? != json!(true) {
            if begin.elapsed() > PATIENCE {
                return Err(format!("not true within {} s: {code}", PATIENCE.as_secs()));
            }
            std::thread::sleep(POLL);
        }
        Ok(())
    }

    /// Sends an event of the mouse (`mousePressed`, `mouseMoved` with the button pressed, or `mouseReleased`) at a
    /// point in pixels of the page.
    ///
    /// # Errors
    /// Returns the errors of [`Page::call`].
    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) -> Result<(), String> {
        let buttons = u8::from(kind != "mouseReleased");
        let event =
            json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
        self.call("Input.dispatchMouseEvent", event).map(drop)
    }

    /// Drags with the primary button from one point to another, in six steps.
    ///
    /// # Errors
    /// Returns the errors of [`Page::call`].
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) -> Result<(), String> {
        self.mouse("mousePressed", from)?;
        for k in 1..=6 {
            let part = f64::from(k) / 6.0;
            self.mouse("mouseMoved", [0, 1].map(|i| from[i] + (to[i] - from[i]) * part))?;
        }
        self.mouse("mouseReleased", to)
    }

    /// Clicks the first element of a selector of CSS.
    ///
    /// # Errors
    /// Returns the errors of [`Page::middle`].
    pub fn click(&mut self, selector: &str) -> Result<(), String> {
        let at = self.middle(selector)?;
        self.mouse("mousePressed", at)?;
        self.mouse("mouseReleased", at)
    }

    /// Returns the middle of the first element of a selector of CSS, in pixels of the page.
    ///
    /// # Errors
    /// Returns the errors of [`Page::call`], and a message when there is no such element.
    pub fn middle(&mut self, selector: &str) -> Result<[f64; 2], String> {
        let code = format!(
            "(() => {{ const r = document.querySelector({selector:?}).getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
        );
        let value = self.value(&code)?;
        match [0, 1].map(|i| value[i].as_f64()) {
            [Some(x), Some(y)] => Ok([x, y]),
            _ => Err(format!("{selector}: the middle is {value}")),
        }
    }
}
