//! The server with a handler that waits, over real connections.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use serde_json::json;

use super::connections::MAX_CONNECTIONS;
use super::places::PLACES;
use super::{ApiError, Handler, Lane, Request, Response, Server, Token};
use deaflow_base::Interrupt;

/// Time after which a test fails.
const PATIENCE: Duration = Duration::from_secs(60);

/// `/slow` and `/quick` simulate, the former until the client leaves; all else reads.
#[derive(Default)]
struct Waiting {
    at_work: Mutex<usize>,
    changed: Condvar,
    ended: AtomicUsize,
}

impl Waiting {
    /// Waits until a number of slow requests are in progress.
    fn until(&self, count: usize) {
        let at_work = self.at_work.lock().unwrap();
        let waited = self
            .changed
            .wait_timeout_while(at_work, PATIENCE, |at_work| *at_work != count);
        assert_eq!(*waited.unwrap().0, count);
    }

    fn change(&self, by: impl Fn(usize) -> usize) {
        let mut at_work = self.at_work.lock().unwrap();
        *at_work = by(*at_work);
        self.changed.notify_all();
    }
}

impl Handler for Waiting {
    fn lane(&self, request: &Request) -> Lane {
        match request.path.first().map(String::as_str) {
            Some("slow") => Lane::Simulating,
            Some("quick") => Lane::Quick,
            _ => Lane::Reading,
        }
    }

    fn handle(&self, _: &Request, lane: Lane, left: &Interrupt) -> Result<Response, ApiError> {
        if lane == Lane::Simulating {
            self.change(|count| count + 1);
            while !left.is_raised() {
                std::thread::sleep(Duration::from_millis(1));
            }
            self.ended.fetch_add(1, Ordering::Relaxed);
            self.change(|count| count - 1);
        }
        Ok(json!({ "done": true }).into())
    }
}

/// A server that runs while this lives.
struct Running {
    handler: Arc<Waiting>,
    port: u16,
    token: Token,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Running {
    fn start() -> Self {
        let server = Server::listen(0).unwrap();
        let port = server.base().rsplit_once(':').unwrap().1.parse().unwrap();
        let (handler, stop, token) = (Arc::new(Waiting::default()), Arc::default(), server.token().clone());
        let (own, ends): (Arc<Waiting>, Arc<AtomicBool>) = (Arc::clone(&handler), Arc::clone(&stop));
        let thread = std::thread::spawn(move || server.run(own, &ends).unwrap());
        Self {
            handler,
            port,
            token,
            stop,
            thread: Some(thread),
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends the head of a request with the token, and more lines.
    fn ask(&self, path: &str, more: &str) -> TcpStream {
        let mut stream = self.connect();
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nAuthorization: Bearer {}\r\n{more}\r\n",
            self.port,
            self.token.text()
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Reads the status of a response.
fn status(stream: &mut TcpStream) -> String {
    let mut line = [0; 12];
    stream.read_exact(&mut line).unwrap();
    String::from_utf8_lossy(&line[9..]).into_owned()
}

#[test]
fn a_client_that_leaves_ends_its_simulation() {
    let server = Running::start();
    let waiting: Vec<TcpStream> = (0..2 * PLACES).map(|_| server.ask("/slow", "")).collect();
    server.handler.until(PLACES - 1);
    drop(waiting);
    server.handler.until(0);
    assert!(server.handler.ended.load(Ordering::Relaxed) >= PLACES - 1);
    // Their places are free again.
    let one = server.ask("/slow", "");
    server.handler.until(1);
    drop(one);
    server.handler.until(0);
}

#[test]
fn a_quick_simulation_does_not_wait_for_slow_ones() {
    let server = Running::start();
    let slow: Vec<TcpStream> = (0..2 * PLACES).map(|_| server.ask("/slow", "")).collect();
    server.handler.until(PLACES - 1);
    for path in ["/quick", "/quick", "/other"] {
        assert_eq!(status(&mut server.ask(path, "Connection: close\r\n")), "200", "{path}");
    }
    server.handler.until(PLACES - 1);
    drop(slow);
}

#[test]
fn connections_without_the_token_make_room() {
    let server = Running::start();
    let mut strangers: Vec<TcpStream> = (0..2 * MAX_CONNECTIONS).map(|_| server.connect()).collect();
    // An open connection of the owner stays, however many strangers come.
    let mut own = server.ask("/other", "");
    assert_eq!(status(&mut own), "200");
    strangers.extend((0..2 * MAX_CONNECTIONS).map(|_| server.connect()));
    assert_eq!(status(&mut server.ask("/quick", "")), "200");
    // The oldest were closed without a response, and the last was not.
    assert_eq!(strangers[0].read(&mut [0; 16]).unwrap_or(0), 0);
    let last = strangers.last_mut().unwrap();
    last.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    assert_eq!(status(last), "403");
    own.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let mut rest = String::new();
    while !rest.contains("HTTP/1.1 403") {
        let mut some = [0; 1024];
        let read = own.read(&mut some).unwrap();
        assert!(read > 0, "{rest}");
        rest.push_str(&String::from_utf8_lossy(&some[..read]));
    }
}

#[test]
fn a_body_that_is_declared_too_long_is_refused_before_it_is_sent() {
    let server = Running::start();
    let mut large = server.ask("/other", &format!("Content-Length: {}\r\n", (4 << 20) + 1));
    assert_eq!(status(&mut large), "413");
    let mut allowed = server.ask("/other", "Content-Length: 2\r\n");
    allowed.write_all(b"{}").unwrap();
    assert_eq!(status(&mut allowed), "200");
}
