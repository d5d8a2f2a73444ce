//! A running `deaflow serve`, and requests to it as they go over the wire.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::super::common::{Ended, Workspace};

/// A server, which ends with this.
pub struct Server {
    child: Option<Child>,
    pub url: String,
    pub token: String,
    pub port: u16,
}

/// What came back.
#[derive(Debug)]
pub struct Reply {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Reply {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// The document of a frame, and its numbers.
    pub fn frame(&self) -> (Value, Vec<u8>) {
        let length = u32::from_le_bytes(self.body[..4].try_into().unwrap()) as usize;
        let document = serde_json::from_slice(&self.body[4..4 + length]).unwrap();
        (document, self.body[4 + length..].to_vec())
    }

    /// The numbers of an array of a frame.
    pub fn numbers(&self, name: &str) -> Vec<f32> {
        let (document, data) = self.frame();
        let arrays = document["arrays"].as_array().unwrap();
        let array = arrays.iter().find(|array| array["name"] == name).unwrap();
        let [start, length] = [
            array["start"].as_u64().unwrap() as usize,
            array["shape"]
                .as_array()
                .unwrap()
                .iter()
                .map(|side| side.as_u64().unwrap() as usize)
                .product(),
        ];
        let each = data[start..start + 4 * length].chunks_exact(4);
        each.map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
    }
}

impl Server {
    /// Starts `deaflow` with `--json` and reads where it listens.
    pub fn start(workspace: &Workspace, arguments: &[&str]) -> Self {
        let mut command = workspace.command(&[arguments, &["--json"]].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut text = String::new();
        // One document over several lines.
        while serde_json::from_str::<Value>(&text).is_err() {
            let read = out.read_line(&mut text).unwrap();
            if read == 0 {
                let ended: Ended = child.wait_with_output().unwrap().into();
                panic!("{text}\n{}", ended.stderr);
            }
        }
        let told: Value = serde_json::from_str(&text).unwrap();
        let address = told["address"].as_str().unwrap();
        Self {
            url: told["url"].as_str().unwrap().to_owned(),
            token: told["token"].as_str().unwrap().to_owned(),
            port: address.rsplit_once(':').unwrap().1.parse().unwrap(),
            child: Some(child),
        }
    }

    pub fn get(&self, path: &str) -> Reply {
        self.request("GET", path, &[&self.bearer()], b"")
    }

    pub fn post(&self, path: &str, body: &Value) -> Reply {
        self.request("POST", path, &[&self.bearer()], body.to_string().as_bytes())
    }

    pub fn bearer(&self) -> String {
        format!("Authorization: Bearer {}", self.token)
    }

    /// A request with these lines in its head.
    pub fn request(&self, method: &str, path: &str, lines: &[&str], body: &[u8]) -> Reply {
        let host = format!("Host: 127.0.0.1:{}", self.port);
        let lines: Vec<&str> = match lines.iter().any(|line| line.starts_with("Host:")) {
            true => lines.to_vec(),
            false => [&[host.as_str()], lines].concat(),
        };
        let head = format!(
            "{method} {path} HTTP/1.1\r\n{}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            lines.join("\r\n"),
            body.len()
        );
        self.raw(&[head.as_bytes(), body].concat())
    }

    /// Sends a request, and leaves the response on the connection.
    pub fn begin(&self, path: &str, body: &Value) -> TcpStream {
        let body = body.to_string();
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}\r\nContent-Length: {}\r\n\r\n",
            self.port,
            self.bearer(),
            body.len()
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream.write_all(body.as_bytes()).unwrap();
        stream
    }

    /// Bytes as they are, and what comes back; nothing where the server closes without a word.
    pub fn raw(&self, bytes: &[u8]) -> Reply {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
        // A server that refuses may close before all is sent.
        let _ = stream.write_all(bytes);
        let mut all = Vec::new();
        let _ = stream.read_to_end(&mut all);
        let end = all.windows(4).position(|four| four == b"\r\n\r\n");
        let (head, body) = end.map_or((&all[..], &[][..]), |end| (&all[..end], &all[end + 4..]));
        let head = String::from_utf8_lossy(head).into_owned();
        let status = head
            .split(' ')
            .nth(1)
            .and_then(|status| status.parse().ok())
            .unwrap_or(0);
        let body = match head.to_ascii_lowercase().contains("transfer-encoding: chunked") {
            true => dechunked(body),
            false => body.to_vec(),
        };
        Reply { status, head, body }
    }

    /// Sends a signal, and waits for the end.
    pub fn end(mut self, signal: Signal) -> Ended {
        let child = self.child.take().unwrap();
        kill_process(Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap(), signal).unwrap();
        child.wait_with_output().unwrap().into()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn dechunked(mut rest: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    while let Some(end) = rest.windows(2).position(|two| two == b"\r\n") {
        let size = usize::from_str_radix(std::str::from_utf8(&rest[..end]).unwrap(), 16).unwrap();
        if size == 0 {
            break;
        }
        whole.extend(&rest[end + 2..end + 2 + size]);
        rest = &rest[end + 4 + size..];
    }
    whole
}
