//! Connections over loopback, each request answered on a thread of its own.

use std::convert::Infallible;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use http_body_util::{BodyExt, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_TYPE, HeaderName, HeaderValue, SET_COOKIE};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use super::answer::{Answer, Outgoing, line_of};
use super::assets;
use super::guard::{Guard, Token};
use super::refusal::Refusal;
use super::request::{Method, Request, steps, words};

/// Bytes of a body: a pattern of the most cells as JSON, or an image of one.
const MOST_BYTES: usize = 4 << 20;

/// Bytes of the head of a request.
const MOST_HEAD: usize = 16 << 10;

/// Connections at a time; a browser opens six.
const MOST_CONNECTIONS: usize = 64;

/// Requests that are worked on at a time; others wait.
const MOST_AT_WORK: usize = 8;

/// How long the head of a request may take, and how long its body.
const PATIENCE: Duration = Duration::from_secs(10);

/// Between two looks at whether the server is to end.
const PAUSE: Duration = Duration::from_millis(100);

/// A server that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The port is taken, or the system refuses.
    #[error("cannot listen on 127.0.0.1:{port}: {source}")]
    Listen {
        /// The port.
        port: u16,
        /// The system's own message.
        source: io::Error,
    },
    /// There are no random numbers.
    #[error("the system has no random numbers for a token to give")]
    Random,
    /// The system refuses something else.
    #[error("the server cannot run: {0}")]
    Io(#[from] io::Error),
}

/// Answers requests.
pub trait Handler: Send + Sync + 'static {
    /// How many requests for a path are worked on at a time: those that simulate share less than all.
    fn lane(&self, path: &[String]) -> Lane;

    /// The answer, on a thread that may take its time.
    ///
    /// # Errors
    /// When there is none.
    fn answer(&self, request: &Request) -> Result<Answer, Refusal>;
}

/// What requests wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// They read.
    Reading,
    /// They simulate.
    Simulating,
}

/// A server that listens.
pub struct Served {
    listener: TcpListener,
    address: SocketAddr,
    token: Token,
}

impl Served {
    /// Listens on a port of the loopback address; 0 takes one that is free.
    ///
    /// # Errors
    /// When the port is taken, or the system has no random numbers.
    pub fn listen(port: u16) -> Result<Self, ServeError> {
        let token = Token::random().ok_or(ServeError::Random)?;
        let refused = |source| ServeError::Listen { port, source };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        let address = listener.local_addr()?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            address,
            token,
        })
    }

    /// The address to be opened, with the token.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token.text())
    }

    /// The address without the token.
    #[must_use]
    pub fn base(&self) -> String {
        format!("http://{}", self.address)
    }

    /// The token.
    #[must_use]
    pub fn token(&self) -> &Token {
        &self.token
    }

    /// Serves until `stop` is set. What is worked on then is given up.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn run(self, handler: Arc<dyn Handler>, stop: &AtomicBool) -> Result<(), ServeError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(MOST_AT_WORK)
            .thread_name("request")
            .build()?;
        let shared = Arc::new(Shared {
            guard: Guard::new(self.token, self.address.port()),
            handler,
            // One that takes long leaves room for one that does not.
            simulating: Arc::new(Semaphore::new(MOST_AT_WORK / 2)),
        });
        let ended = runtime.block_on(accept(self.listener, shared, stop));
        runtime.shutdown_background();
        Ok(ended?)
    }
}

struct Shared {
    guard: Guard,
    handler: Arc<dyn Handler>,
    simulating: Arc<Semaphore>,
}

async fn accept(listener: TcpListener, shared: Arc<Shared>, stop: &AtomicBool) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    while !stop.load(Ordering::Relaxed) {
        let Ok(accepted) = timeout(PAUSE, listener.accept()).await else {
            continue;
        };
        let Ok((stream, _)) = accepted else {
            // Files are short, or who called is gone: the next call may do better.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            continue;
        };
        // Small answers are not held back for others to join them.
        let _ = stream.set_nodelay(true);
        let shared = Arc::clone(&shared);
        tokio::spawn(async move {
            let service = service_fn(|request| {
                let shared = Arc::clone(&shared);
                async move { Ok::<_, Infallible>(respond(&shared, request).await) }
            });
            let mut builder = http1::Builder::new();
            builder
                .timer(TokioTimer::new())
                .header_read_timeout(PATIENCE)
                .max_buf_size(MOST_HEAD);
            // A connection that breaks concerns nobody else.
            let _ = builder.serve_connection(TokioIo::new(stream), service).await;
            drop(place);
        });
    }
    Ok(())
}

async fn respond(shared: &Arc<Shared>, request: hyper::Request<Incoming>) -> Response<Outgoing> {
    let is_page = request.method() == hyper::Method::GET && !request.uri().path().starts_with("/api/");
    match answered(shared, request).await {
        Ok(answer) => sent(shared, answer),
        Err(refusal) => refused(&refusal, is_page),
    }
}

async fn answered(shared: &Arc<Shared>, request: hyper::Request<Incoming>) -> Result<Answer, Refusal> {
    shared.guard.check(request.headers())?;
    let malformed = || Refusal::bad("the address is malformed");
    let path = steps(request.uri().path()).ok_or_else(malformed)?;
    let query = words(request.uri().query().unwrap_or_default()).ok_or_else(malformed)?;
    let method = match *request.method() {
        hyper::Method::GET => Method::Get,
        hyper::Method::POST => Method::Post,
        hyper::Method::DELETE => Method::Delete,
        _ => return Err(Refusal::not_allowed("GET, POST, DELETE")),
    };
    let at_entrance = path.is_empty() && method == Method::Get;
    if at_entrance && query.get("token").is_some_and(|token| shared.guard.knows(token)) {
        return Ok(Answer::Entrance { admitted: true });
    }
    shared.guard.admit(request.headers())?;
    if at_entrance {
        return Ok(Answer::Entrance { admitted: false });
    }
    let body = Limited::new(request.into_body(), MOST_BYTES).collect();
    let body = match timeout(PATIENCE, body).await {
        Ok(Ok(body)) => body.to_bytes().to_vec(),
        Ok(Err(error)) if error.is::<http_body_util::LengthLimitError>() => {
            return Err(Refusal::new(413, "the body is too long").help(format!("allowed: {MOST_BYTES} bytes")));
        }
        Ok(Err(_)) => return Err(Refusal::bad("the body breaks off")),
        Err(_) => return Err(Refusal::new(408, "the body takes too long")),
    };
    let request = Request {
        method,
        path,
        query,
        body,
    };
    // Who goes away while waiting is not worked for: of the strokes of a pen the latest alone counts.
    let place = match shared.handler.lane(&request.path) {
        Lane::Simulating => Arc::clone(&shared.simulating).acquire_owned().await.ok(),
        Lane::Reading => None,
    };
    let handler = Arc::clone(&shared.handler);
    let work = move || {
        let answer = handler.answer(&request);
        // Held until the work is done, whether or not anybody still waits for it.
        drop(place);
        answer
    };
    let done = tokio::task::spawn_blocking(work).await;
    // A thread that panicked has said so on stderr.
    done.unwrap_or_else(|_| Err(Refusal::new(500, "the server has made a mistake")))
}

fn sent(shared: &Shared, answer: Answer) -> Response<Outgoing> {
    let whole = |bytes: Bytes| Outgoing::Whole(Full::new(bytes));
    let (media, body, policy) = match answer {
        Answer::Document(document) => ("application/json", whole(line_of(&document)), NO_PAGE),
        Answer::Lines(lines) => ("application/x-ndjson", Outgoing::Lines(lines), NO_PAGE),
        Answer::Page(text) => ("text/html; charset=utf-8", whole(text.into()), DRAWN_PAGE),
        Answer::Entrance { admitted } => {
            let mut response = response(200, "text/html; charset=utf-8", whole(assets::INDEX.into()), OWN_PAGE);
            if let Some(cookie) = shared.guard.cookie().filter(|_| admitted) {
                response.headers_mut().insert(SET_COOKIE, cookie);
            }
            return response;
        }
        Answer::Bytes { media, bytes, file } => {
            let mut response = response(200, media, whole(bytes.into()), OWN_PAGE);
            let named = file.and_then(|file| HeaderValue::from_str(&format!("attachment; filename=\"{file}\"")).ok());
            if let Some(named) = named {
                response.headers_mut().insert(CONTENT_DISPOSITION, named);
            }
            return response;
        }
    };
    response(200, media, body, policy)
}

fn refused(refusal: &Refusal, is_page: bool) -> Response<Outgoing> {
    let mut response = match is_page && refusal.status == 401 {
        true => {
            let body = Outgoing::Whole(Full::new(assets::LOCKED.into()));
            response(401, "text/html; charset=utf-8", body, OWN_PAGE)
        }
        false => {
            let body = Outgoing::Whole(Full::new(line_of(&refusal.document())));
            response(refusal.status, "application/json", body, NO_PAGE)
        }
    };
    if let Some(allow) = refusal.allow {
        response.headers_mut().insert(ALLOW, HeaderValue::from_static(allow));
    }
    response
}

/// What the page may load: what comes from this server, and images that it has made itself. No script stands in it.
const OWN_PAGE: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; \
                        frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A page that is drawn in it has styles within and loads nothing.
const DRAWN_PAGE: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; \
                          frame-ancestors 'self'";
/// Nothing of what is no page may become one.
const NO_PAGE: &str = "default-src 'none'; frame-ancestors 'none'; sandbox";

fn response(status: u16, media: &'static str, body: Outgoing, policy: &'static str) -> Response<Outgoing> {
    let mut response = Response::new(body);
    *response.status_mut() = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_TYPE, media),
        (CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("content-security-policy"), policy),
        (HeaderName::from_static("x-content-type-options"), "nosniff"),
        (HeaderName::from_static("referrer-policy"), "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}
