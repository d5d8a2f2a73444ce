//! A tab of a real Chromium, driven over its pipe (Chrome DevTools Protocol): pens, keys, sizes of screens,
//! photographs.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::super::common::readers;

/// How long something on a page may take to be as it should.
const PATIENCE: Duration = Duration::from_secs(180);

/// A browser with one tab.
pub struct Tab {
    child: Child,
    commands: File,
    answers: BufReader<File>,
    session: String,
    next: u64,
    /// What scripts have complained of.
    pub complaints: Vec<String>,
    _profile: tempfile::TempDir,
}

impl Tab {
    /// A tab, where Chromium is installed.
    pub fn open() -> Option<Self> {
        let program = readers::installed("Chromium, which opens what is served", || {
            ["chromium", "chromium-browser", "google-chrome"]
                .into_iter()
                .find(|program| {
                    Command::new(program)
                        .arg("--version")
                        .output()
                        .is_ok_and(|o| o.status.success())
                })
        })?;
        let profile = tempfile::tempdir().unwrap();
        let [to, from] = ["to", "from"].map(|name| profile.path().join(name));
        for pipe in [&to, &from] {
            assert!(Command::new("mkfifo").arg(pipe).status().unwrap().success());
        }
        // It reads commands from file 3 and answers on file 4.
        let child = Command::new("sh")
            .args(["-c", "to=$1; from=$2; shift 2; exec \"$@\" 3<\"$to\" 4>\"$from\"", "sh"])
            .args([to.as_os_str(), from.as_os_str()])
            .args([
                program,
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
            ])
            .args([
                "--disable-quic",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
            ])
            .args(["--hide-scrollbars", "--remote-debugging-pipe"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .env("HOME", profile.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let commands = OpenOptions::new().write(true).open(&to).unwrap();
        let answers = BufReader::new(File::open(&from).unwrap());
        let mut tab = Self {
            child,
            commands,
            answers,
            session: String::new(),
            next: 0,
            complaints: Vec::new(),
            _profile: profile,
        };
        let targets = tab.call("Target.getTargets", json!({}));
        let page = targets["targetInfos"]
            .as_array()
            .unwrap()
            .iter()
            .find(|t| t["type"] == "page")
            .unwrap();
        let attached = tab.call(
            "Target.attachToTarget",
            json!({ "targetId": page["targetId"], "flatten": true }),
        );
        tab.session = attached["sessionId"].as_str().unwrap().to_owned();
        tab.call("Page.enable", json!({}));
        tab.call("Runtime.enable", json!({}));
        tab.call("Log.enable", json!({}));
        Some(tab)
    }

    /// Sends a command and waits for its answer.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        let answer = self.ask(method, parameters);
        answer.unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// The answer to a command, or what the browser has against it.
    fn ask(&mut self, method: &str, parameters: Value) -> Result<Value, Value> {
        self.next += 1;
        let id = self.next;
        let mut message = json!({ "id": id, "method": method, "params": parameters });
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        self.commands.write_all(message.to_string().as_bytes()).unwrap();
        self.commands.write_all(&[0]).unwrap();
        self.commands.flush().unwrap();
        loop {
            let mut bytes = Vec::new();
            let read = self.answers.read_until(0, &mut bytes).unwrap();
            assert!(read > 0, "the browser has ended");
            bytes.pop();
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            self.listen(&answer);
            if answer["id"] == id {
                return match &answer["error"] {
                    Value::Null => Ok(answer["result"].clone()),
                    error => Err(error.clone()),
                };
            }
        }
    }

    fn listen(&mut self, event: &Value) {
        let what = match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => event["params"]["exceptionDetails"].to_string(),
            Some("Log.entryAdded") if event["params"]["entry"]["level"] == "error" => {
                let entry = &event["params"]["entry"];
                // The browser notes every refusal; what a person is told of it is looked for on the page.
                if entry["text"]
                    .as_str()
                    .is_some_and(|text| text.contains("status of 400"))
                {
                    return;
                }
                entry.to_string()
            }
            _ => return,
        };
        self.complaints.push(what);
    }

    /// Goes to an address.
    pub fn go(&mut self, url: &str) {
        self.call("Page.navigate", json!({ "url": url }));
    }

    /// Reads the page again, and waits until the old one is gone, which may answer no question any more.
    pub fn reload(&mut self) {
        self.value("window.isOld = true");
        self.call("Page.reload", json!({}));
        let question = json!({ "expression": "window.isOld !== true", "returnByValue": true });
        let began = Instant::now();
        while !self
            .ask("Runtime.evaluate", question.clone())
            .is_ok_and(|found| found["result"]["value"] == true)
        {
            assert!(began.elapsed() < PATIENCE, "the page is not read again");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The value of an expression, which may be a promise.
    pub fn value(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let found = self.call("Runtime.evaluate", parameters);
        assert!(found["exceptionDetails"].is_null(), "{expression}: {found}");
        found["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn until(&mut self, expression: &str) {
        let began = Instant::now();
        loop {
            let guarded = format!("(() => {{ try {{ return Boolean({expression}) }} catch {{ return false }} }})()");
            if self.value(&guarded) == true {
                return;
            }
            if began.elapsed() > PATIENCE {
                let seen = self.value("document.body.innerText");
                panic!("{expression} does not become true: {seen}\n{:?}", self.complaints);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The text of an element.
    pub fn text(&mut self, selector: &str) -> String {
        let found = self.value(&format!(
            "document.querySelector({})?.textContent ?? null",
            json!(selector)
        ));
        found
            .as_str()
            .unwrap_or_else(|| panic!("there is no {selector}"))
            .to_owned()
    }

    /// The number that an element has in `data-value`.
    pub fn number(&mut self, selector: &str) -> f64 {
        let found = self.value(&format!(
            "Number(document.querySelector({}).dataset.value)",
            json!(selector)
        ));
        found.as_f64().unwrap_or_else(|| panic!("{selector} has no number"))
    }

    /// A screen of a size, light or dark.
    pub fn screen(&mut self, width: u32, height: u32, look: &str) {
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", metrics);
        let feature = json!({ "features": [{ "name": "prefers-color-scheme", "value": look }] });
        self.call("Emulation.setEmulatedMedia", feature);
    }

    /// The pen goes down, moves and comes up; points are shares of an element's width and height from its upper left.
    pub fn stroke(&mut self, selector: &str, points: &[[f64; 2]]) {
        let find = format!(
            "(() => {{ const e = document.querySelector({}); e.scrollIntoView({{ block: 'center' }}); const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height] }})()",
            json!(selector)
        );
        let found = self.value(&find);
        let at = |k: usize| found[k].as_f64().unwrap();
        let [left, top, width, height] = [0, 1, 2, 3].map(at);
        let place = |point: &[f64; 2]| (left + width * point[0], top + height * point[1]);
        let mut event = |kind: &str, point: &[f64; 2], buttons: u32| {
            let (x, y) = place(point);
            self.call(
                "Input.dispatchMouseEvent",
                json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 }),
            );
        };
        event("mousePressed", &points[0], 1);
        points.iter().for_each(|point| event("mouseMoved", point, 1));
        event("mouseReleased", points.last().unwrap(), 0);
    }

    /// A click on the middle of an element.
    pub fn click(&mut self, selector: &str) {
        self.until(&format!("document.querySelector({})", json!(selector)));
        self.value(&format!("document.querySelector({}).click()", json!(selector)));
    }

    /// Writes into a field as a person does who then goes on.
    pub fn write(&mut self, selector: &str, text: &str) {
        self.until(&format!("document.querySelector({})", json!(selector)));
        self.value(&format!(
            "(() => {{ const e = document.querySelector({}); e.value = {}; e.dispatchEvent(new Event('input', {{ bubbles: true }})); e.dispatchEvent(new Event('change', {{ bubbles: true }})) }})()",
            json!(selector),
            json!(text)
        ));
    }

    /// A key, on what has the focus.
    pub fn key(&mut self, key: &str, modifiers: u32) {
        for kind in ["keyDown", "keyUp"] {
            self.call(
                "Input.dispatchKeyEvent",
                json!({ "type": kind, "key": key, "code": key, "modifiers": modifiers }),
            );
        }
    }

    /// How far the page is wider than its screen, in pixels.
    pub fn overflow(&mut self) -> f64 {
        let found = self.value("document.documentElement.scrollWidth - document.documentElement.clientWidth");
        found.as_f64().unwrap()
    }

    /// What is to be hit with a finger and is less than 24 pixels high or wide (WCAG 2.2, 2.5.8): what stands in a line
    /// of text, or is drawn, may be.
    pub fn small_targets(&mut self) -> Value {
        self.value("[...document.querySelectorAll('button, input:not([type=file]), select, summary, nav a')].filter((e) => { const b = e.getBoundingClientRect(); return b.width > 0 && (b.width < 23.9 || b.height < 23.9) }).map((e) => e.outerHTML.slice(0, 90) + ' ' + e.getBoundingClientRect().width + ' x ' + e.getBoundingClientRect().height)")
    }

    /// The page as a PDF, as browsers print it: without backgrounds, unless the page asks for them.
    pub fn print(&mut self) -> Vec<u8> {
        let found = self.call("Page.printToPDF", json!({ "printBackground": false }));
        decoded(found["data"].as_str().unwrap())
    }

    /// Writes an image of the screen.
    pub fn photograph(&mut self, path: &Path) {
        let found = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        std::fs::write(path, decoded(found["data"].as_str().unwrap())).unwrap();
    }
}

impl Drop for Tab {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Base 64 (RFC 4648).
fn decoded(text: &str) -> Vec<u8> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    for four in text.trim_end_matches('=').as_bytes().chunks(4) {
        let bits = four
            .iter()
            .fold(0_u32, |bits, &byte| bits << 6 | u32::from(digit(byte)))
            << (6 * (4 - four.len()));
        bytes.extend(&bits.to_be_bytes()[1..four.len()]);
    }
    bytes
}
