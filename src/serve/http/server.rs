//! Connections on the loopback address. Each request is handled on a thread of its own.

use std::convert::Infallible;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use http_body_util::{BodyExt, Full, Limited};
use hyper::StatusCode;
use hyper::body::{Body, Bytes, Incoming};
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_TYPE, HeaderName, HeaderValue, SET_COOKIE};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::time::timeout;

use super::assets;
use super::connections::Connections;
use super::error::ApiError;
use super::guard::{Guard, Token};
use super::places::{Client, Lane, PLACES, Places};
use super::request::{Method, Request, steps, words};
use super::response::{Response, ResponseBody, line_of};
use deaflow_base::Interrupt;

/// Bytes of a body: the largest pattern as JSON or as an image fits.
const MAX_BODY: usize = 4 << 20;

/// Bytes of the head of a request.
const MAX_HEAD: usize = 16 << 10;

/// Requests that are handled at a time; others wait. At most half of them simulate, so that reading stays fast.
const MAX_REQUESTS: usize = 2 * PLACES;

/// Time limit for the head of a request, and for its body.
const PATIENCE: Duration = Duration::from_secs(10);

/// Time between two checks of the stop flag.
const PAUSE: Duration = Duration::from_millis(100);

/// The server cannot start or run.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The port is in use, or the system refuses to listen.
    #[error("cannot listen on 127.0.0.1:{port}: {source}")]
    Listen {
        /// The port.
        port: u16,
        /// The error of the system.
        source: io::Error,
    },
    /// The system has no random numbers.
    #[error("cannot create a token: the system has no random numbers")]
    Random,
    /// Another error of the system.
    #[error("the server cannot run: {0}")]
    Io(#[from] io::Error),
}

/// Handles requests.
pub trait Handler: Send + Sync + 'static {
    /// Returns the queue of a request.
    fn lane(&self, request: &Request) -> Lane;

    /// Returns the response. It runs on a thread that may block; `left` is raised once the client has left.
    ///
    /// # Errors
    /// If the request cannot be answered.
    fn handle(&self, request: &Request, lane: Lane, left: &Interrupt) -> Result<Response, ApiError>;
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    token: Token,
}

impl Server {
    /// Listens on a port of the loopback address; 0 takes a free one.
    ///
    /// # Errors
    /// If the port is in use, or the system has no random numbers.
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

    /// Returns the URL with the token.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token.text())
    }

    /// Returns the URL without the token.
    #[must_use]
    pub fn base(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Returns the token.
    #[must_use]
    pub fn token(&self) -> &Token {
        &self.token
    }

    /// Serves until `stop` is set. Requests in progress are dropped then.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn run(self, handler: Arc<dyn Handler>, stop: &AtomicBool) -> Result<(), ServeError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(MAX_REQUESTS)
            .thread_name("request")
            .build()?;
        let shared = Arc::new(Shared {
            guard: Guard::new(self.token, self.address.port()),
            handler,
            places: Places::default(),
        });
        let ended = runtime.block_on(accept(self.listener, shared, stop));
        runtime.shutdown_background();
        Ok(ended?)
    }
}

struct Shared {
    guard: Guard,
    handler: Arc<dyn Handler>,
    places: Places,
}

async fn accept(listener: TcpListener, shared: Arc<Shared>, stop: &AtomicBool) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut connections = Connections::default();
    while !stop.load(Ordering::Relaxed) {
        let Ok(accepted) = timeout(PAUSE, listener.accept()).await else {
            continue;
        };
        let Ok((stream, _)) = accepted else {
            // Too many open files, or the client is gone: the next connection may work.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        if !connections.make_room() {
            continue;
        }
        // Small responses are sent at once.
        let _ = stream.set_nodelay(true);
        let shared = Arc::clone(&shared);
        let is_admitted = Arc::new(AtomicBool::new(false));
        let admitted = Arc::clone(&is_admitted);
        let task = tokio::spawn(async move {
            let service = service_fn(|request| {
                let (shared, admitted) = (Arc::clone(&shared), Arc::clone(&admitted));
                async move { Ok::<_, Infallible>(respond(&shared, &admitted, request).await) }
            });
            let mut builder = http1::Builder::new();
            builder
                .timer(TokioTimer::new())
                .header_read_timeout(PATIENCE)
                .max_buf_size(MAX_HEAD);
            // An error of a connection concerns no other one.
            let _ = builder.serve_connection(TokioIo::new(stream), service).await;
        });
        connections.add(task.abort_handle(), is_admitted);
    }
    Ok(())
}

async fn respond(
    shared: &Arc<Shared>,
    admitted: &AtomicBool,
    request: hyper::Request<Incoming>,
) -> hyper::Response<ResponseBody> {
    let is_page = request.method() == hyper::Method::GET && !request.uri().path().starts_with("/api/");
    match handle(shared, admitted, request).await {
        Ok(response) => to_http(shared, response),
        Err(error) => error_to_http(&error, is_page),
    }
}

async fn handle(
    shared: &Arc<Shared>,
    admitted: &AtomicBool,
    request: hyper::Request<Incoming>,
) -> Result<Response, ApiError> {
    shared.guard.check(request.headers())?;
    let malformed = || ApiError::bad_request("the URL is malformed");
    let path = steps(request.uri().path()).ok_or_else(malformed)?;
    let query = words(request.uri().query().unwrap_or_default()).ok_or_else(malformed)?;
    let method = match *request.method() {
        hyper::Method::GET => Method::Get,
        hyper::Method::POST => Method::Post,
        hyper::Method::DELETE => Method::Delete,
        _ => return Err(ApiError::method_not_allowed("GET, POST, DELETE")),
    };
    let is_index = path.is_empty() && method == Method::Get;
    if is_index && query.get("token").is_some_and(|token| shared.guard.is_token(token)) {
        admitted.store(true, Ordering::Relaxed);
        return Ok(Response::Index { has_token: true });
    }
    shared.guard.admit(request.headers())?;
    admitted.store(true, Ordering::Relaxed);
    if is_index {
        return Ok(Response::Index { has_token: false });
    }
    let too_long = || ApiError::new(413, "the body is too long").help(format!("allowed: {MAX_BODY} bytes"));
    // The declared length, without reading the body.
    if request.body().size_hint().lower() > MAX_BODY as u64 {
        return Err(too_long());
    }
    let body = Limited::new(request.into_body(), MAX_BODY).collect();
    let body = match timeout(PATIENCE, body).await {
        Ok(Ok(body)) => body.to_bytes().to_vec(),
        Ok(Err(error)) if error.is::<http_body_util::LengthLimitError>() => {
            return Err(too_long());
        }
        Ok(Err(_)) => return Err(ApiError::bad_request("the connection broke while the body was read")),
        Err(_) => return Err(ApiError::new(408, "timeout while the body was read")),
    };
    let request = Request {
        method,
        path,
        query,
        body,
    };
    // A request whose client leaves while it waits here is dropped: while somebody draws, only the latest one counts.
    let lane = shared.handler.lane(&request);
    let permit = shared.places.take(lane).await;
    let handler = Arc::clone(&shared.handler);
    // This future is dropped when the client leaves.
    let client = Client::default();
    let left = client.left();
    let work = move || {
        let response = match left.is_raised() {
            true => Err(ApiError::new(408, "the client has left")),
            false => handler.handle(&request, lane, &left),
        };
        // Held until the work is done, even if the client is gone.
        drop(permit);
        response
    };
    let response = tokio::task::spawn_blocking(work).await;
    // The message of the panic is on stderr.
    response.unwrap_or_else(|_| {
        Err(ApiError::new(
            500,
            "internal error of the server; its terminal shows more",
        ))
    })
}

fn to_http(shared: &Shared, response: Response) -> hyper::Response<ResponseBody> {
    let full = |bytes: Bytes| ResponseBody::Full(Full::new(bytes));
    let (media, body, policy) = match response {
        Response::Json(document) => ("application/json", full(line_of(&document)), NO_PAGE),
        Response::JsonLines(lines) => ("application/x-ndjson", ResponseBody::Lines(lines), NO_PAGE),
        Response::Html(text) => ("text/html; charset=utf-8", full(text.into()), FIGURE_PAGE),
        Response::Index { has_token } => {
            let mut response = http_response(200, "text/html; charset=utf-8", full(assets::INDEX.into()), OWN_PAGE);
            if let Some(cookie) = shared.guard.cookie().filter(|_| has_token) {
                response.headers_mut().insert(SET_COOKIE, cookie);
            }
            return response;
        }
        Response::Bytes { media, bytes, file } => {
            let mut response = http_response(200, media, full(bytes.into()), OWN_PAGE);
            let named = file.and_then(|file| HeaderValue::from_str(&format!("attachment; filename=\"{file}\"")).ok());
            if let Some(named) = named {
                response.headers_mut().insert(CONTENT_DISPOSITION, named);
            }
            return response;
        }
    };
    http_response(200, media, body, policy)
}

fn error_to_http(error: &ApiError, is_page: bool) -> hyper::Response<ResponseBody> {
    let full = |bytes: Bytes| ResponseBody::Full(Full::new(bytes));
    let mut response = match is_page && error.status == 401 {
        true => http_response(401, "text/html; charset=utf-8", full(assets::LOCKED.into()), OWN_PAGE),
        false => http_response(
            error.status,
            "application/json",
            full(line_of(&error.document())),
            NO_PAGE,
        ),
    };
    if let Some(allow) = error.allow {
        response.headers_mut().insert(ALLOW, HeaderValue::from_static(allow));
    }
    response
}

/// What the main page may load: files of this server, and images that it creates. It has no inline scripts.
const OWN_PAGE: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                        connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; \
                        frame-ancestors 'none'";
/// A page of figures within it has inline styles and loads nothing.
const FIGURE_PAGE: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; \
                           form-action 'none'; frame-ancestors 'self'";
/// Responses that are not pages are never rendered as one.
const NO_PAGE: &str = "default-src 'none'; frame-ancestors 'none'; sandbox";

fn http_response(
    status: u16,
    media: &'static str,
    body: ResponseBody,
    policy: &'static str,
) -> hyper::Response<ResponseBody> {
    let mut response = hyper::Response::new(body);
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
