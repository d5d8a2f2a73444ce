//! S3-compatible storage over HTTP. Requests are signed URLs (AWS Signature Version 4), so messages must not contain
//! URLs.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::{Duration, Instant, SystemTime};

use rusty_s3::actions::{ListObjectsV2, S3Action};
use rusty_s3::{Bucket as Signed, Credentials, UrlStyle};
use ureq::http::{Request, Response};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body, SendBody};

use super::bucket::{Bucket, BucketObject, UploadNote};
use super::config::{Address, check_endpoint};
use super::credentials::{self, CredentialChain};
use super::error::{RemoteError, is_temporary};
use super::paced::{Paced, SLOW_AFTER, TooSlow};
use super::upload;
use deaflow_base::{InputError, read_bounded};

/// Validity of a signed request, which includes differences between clocks.
const SIGNED_FOR: Duration = Duration::from_secs(900);

/// Timeout of connecting.
const CONNECT: Duration = Duration::from_secs(10);

/// Timeout without any data in either direction.
const SILENCE: Duration = Duration::from_secs(60);

/// Timeout of a whole response; a file is resumed after it.
const MAX_DURATION: Duration = Duration::from_secs(3600);

/// Number of attempts after temporary failures, and the pause before the second one.
const ATTEMPTS: u32 = 5;
const PAUSE: Duration = Duration::from_millis(200);

/// Maximum length of a text response in bytes.
const MAX_TEXT: u64 = 16 << 20;

/// Maximum length of a certificate file in bytes.
const MAX_CERTIFICATES: u64 = 16 << 20;

/// Size of the read buffer in bytes.
const BUFFER: usize = 1 << 17;

/// The body of a request.
#[derive(Clone, Copy)]
pub enum RequestBody<'a> {
    /// No body.
    Empty,
    /// Bytes.
    Bytes(&'a [u8]),
    /// Part of a file.
    File {
        /// Path of the file.
        path: &'a Path,
        /// First byte.
        from: u64,
        /// Number of bytes.
        length: u64,
    },
}

/// A bucket of S3-compatible storage, and a prefix in it.
pub struct S3 {
    agent: Agent,
    bucket: Signed,
    prefix: String,
    /// Host name and port, for messages.
    host: String,
    place: String,
    credentials: CredentialChain,
    /// Time after which the rate of a transfer is checked.
    slow_after: Duration,
    /// Date of the last response, and when it came.
    clock: Mutex<Option<(SystemTime, Instant)>>,
}

impl S3 {
    /// Opens the storage at an address, with defaults from the environment. Sends no request.
    ///
    /// # Errors
    /// Returns an error if the URL is invalid, or the certificates that the environment names cannot be read.
    pub fn open(address: &Address) -> Result<Self, RemoteError> {
        let region = address.region.clone().or_else(credentials::region);
        let region = region.unwrap_or_else(|| "us-east-1".to_owned());
        let given = address.endpoint.clone().or_else(credentials::endpoint);
        // Amazon's certificates cover one label before its own name.
        let style = match given.is_none() && !address.bucket.contains('.') {
            true => UrlStyle::VirtualHost,
            false => UrlStyle::Path,
        };
        let endpoint = given.unwrap_or_else(|| format!("https://s3.{region}.amazonaws.com"));
        check_endpoint(&endpoint)?;
        let wrong = |why: String| InputError::new(format!("{endpoint:?} is not the URL of a server: {why}"));
        let url = endpoint.parse().map_err(|error| wrong(format!("{error}")))?;
        let bucket =
            Signed::new(url, style, address.bucket.clone(), region).map_err(|error| wrong(error.to_string()))?;
        let host = bucket.base_url().host_str().unwrap_or_default().to_owned();
        let host = match bucket.base_url().port() {
            Some(port) => format!("{host}:{port}"),
            None => host,
        };
        Ok(Self {
            agent: agent()?,
            prefix: match address.prefix.as_str() {
                "" => String::new(),
                prefix => format!("{prefix}/"),
            },
            place: address.url(),
            bucket,
            host,
            credentials: CredentialChain::default(),
            slow_after: SLOW_AFTER,
            clock: Mutex::default(),
        })
    }

    /// Returns the name of an object in the bucket.
    pub fn key(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Returns the bucket, to create actions.
    pub fn bucket(&self) -> &Signed {
        &self.bucket
    }

    /// Returns the credentials that sign requests.
    pub fn credentials(&self) -> Option<Credentials> {
        self.credentials.current(&self.agent)
    }

    /// Sends a request, again after temporary failures.
    ///
    /// # Errors
    /// Returns an error if the storage cannot be reached.
    pub fn send<'a, A: S3Action<'a>>(&self, action: &A, body: RequestBody<'_>) -> Result<Response<Body>, RemoteError> {
        let mut attempt = 1;
        loop {
            let response = self.send_once(action, None, body);
            let has_failed = match &response {
                Ok(response) => is_temporary(response.status().as_u16()),
                Err(error) => error.may_be_retried(),
            };
            if !has_failed || attempt == ATTEMPTS {
                return response;
            }
            std::thread::sleep(PAUSE * 2_u32.pow(attempt - 1));
            attempt += 1;
        }
    }

    fn send_once<'a, A: S3Action<'a>>(
        &self,
        action: &A,
        range: Option<String>,
        body: RequestBody<'_>,
    ) -> Result<Response<Body>, RemoteError> {
        let url = action.sign(SIGNED_FOR);
        let mut request = Request::builder().method(method(A::METHOD)).uri(url.as_str());
        if let Some(range) = range {
            request = request.header("range", range);
        }
        let built = |error: ureq::http::Error| self.unreachable(&error.to_string());
        let response = match body {
            RequestBody::Empty if matches!(A::METHOD, rusty_s3::Method::Post | rusty_s3::Method::Put) => {
                self.agent.run(request.body(SendBody::none()).map_err(built)?)
            }
            RequestBody::Empty => self.agent.run(request.body(()).map_err(built)?),
            RequestBody::Bytes(bytes) => self.agent.run(request.body(bytes).map_err(built)?),
            RequestBody::File { path, from, length } => {
                let mut file = File::open(path).map_err(RemoteError::io("open", path))?;
                let there = file.metadata().map_err(RemoteError::io("read", path))?.len();
                if there < from + length {
                    // The server would wait for the missing bytes.
                    return Err(RemoteError::io("read", path)(ErrorKind::UnexpectedEof.into()));
                }
                file.seek(SeekFrom::Start(from))
                    .map_err(RemoteError::io("read", path))?;
                let mut part = Paced::after(file.take(length), self.slow_after);
                let request = request.header("content-length", length.to_string());
                let body = SendBody::from_reader(&mut part);
                self.agent.run(request.body(body).map_err(built)?)
            }
        };
        let response = response.map_err(|error| match error {
            ureq::Error::Io(error) => self.broken(&error),
            error => self.unreachable(&describe(&error)),
        })?;
        self.update_clock(&response);
        Ok(response)
    }

    fn update_clock(&self, response: &Response<Body>) {
        let date = response.headers().get("date").and_then(|date| date.to_str().ok());
        let date = date.and_then(http_date);
        if let Some(date) = date {
            *self.clock.lock().unwrap_or_else(PoisonError::into_inner) = Some((date, Instant::now()));
        }
    }

    /// Reads headers and text of a successful response.
    ///
    /// # Errors
    /// Returns an error if the response is a failure or incomplete.
    pub fn read_success(
        &self,
        response: Response<Body>,
        action: &'static str,
        name: &str,
    ) -> Result<(ureq::http::HeaderMap, String), RemoteError> {
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let bytes = self.read_to_limit(response, MAX_TEXT)?;
        let bytes = bytes.ok_or_else(|| self.too_long(name, MAX_TEXT))?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        match (200..300).contains(&status) {
            true => Ok((headers, text)),
            false => Err(self.refused(action, name, status, &text)),
        }
    }

    /// Reads the body of a response; `None` if it is longer than a limit.
    fn read_to_limit(&self, response: Response<Body>, limit: u64) -> Result<Option<Vec<u8>>, RemoteError> {
        let mut bytes = Vec::new();
        let reader = Paced::after(response.into_body().into_reader(), self.slow_after);
        let read = reader.take(limit + 1).read_to_end(&mut bytes);
        read.map_err(|error| self.broken(&error))?;
        Ok((bytes.len() as u64 <= limit).then_some(bytes))
    }

    /// Returns the error of a response that is a failure.
    fn refused(&self, action: &'static str, name: &str, status: u16, text: &str) -> RemoteError {
        let within = |tag: &str| {
            let rest = text.split_once(&format!("<{tag}>"))?.1;
            let inner = rest.split_once(&format!("</{tag}>"))?.0;
            Some(inner.chars().take(300).collect::<String>())
        };
        let default = match status {
            301 | 307 => "PermanentRedirect",
            403 => "Forbidden",
            404 => "NotFound",
            _ => "",
        };
        RemoteError::Refused {
            host: self.host.clone(),
            action,
            name: name.to_owned(),
            status,
            code: within("Code").map_or_else(|| default.to_owned(), |code| redact(&code)),
            message: within("Message").map_or_else(String::new, |message| redact(&message)),
        }
    }

    fn unreachable(&self, reason: &str) -> RemoteError {
        RemoteError::Unreachable {
            host: self.host.clone(),
            reason: reason.to_owned(),
        }
    }

    /// Returns the error of a connection that broke off or was too slow.
    fn broken(&self, error: &std::io::Error) -> RemoteError {
        match TooSlow::is_cause(error) {
            true => RemoteError::Slow {
                host: self.host.clone(),
                reason: error.to_string(),
            },
            false => self.unreachable(&redact(&error.to_string())),
        }
    }

    /// Returns the error of a response that was not understood.
    pub fn unexpected(&self, action: &'static str, name: &str, reason: &str) -> RemoteError {
        RemoteError::UnexpectedResponse {
            host: self.host.clone(),
            action,
            name: name.to_owned(),
            reason: redact(reason),
        }
    }

    /// Returns an error unless the response says that the object does not exist. A missing bucket is an error.
    fn check_absent(&self, response: Response<Body>, action: &'static str, name: &str) -> Result<(), RemoteError> {
        match self.read_success(response, action, name) {
            Err(RemoteError::Refused { status: 404, code, .. }) if code != "NoSuchBucket" => Ok(()),
            Err(error) => Err(error),
            Ok(_) => Err(self.unexpected(action, name, "neither an object nor an error")),
        }
    }

    fn too_long(&self, name: &str, limit: u64) -> RemoteError {
        self.unexpected("read", name, &format!("it is longer than {limit} bytes"))
    }

    /// Appends the rest of an object to a file that has its beginning. Returns `false` if the object does not exist.
    fn get_rest(&self, name: &str, file: &mut File, target: &Path, limit: u64) -> Result<bool, RemoteError> {
        let cannot_write = || RemoteError::io("write", target);
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.get_object(credentials.as_ref(), &key);
        let start = file.seek(SeekFrom::End(0)).map_err(cannot_write())?;
        let range = (start > 0).then(|| format!("bytes={start}-"));
        let response = self.send_once(&action, range, RequestBody::Empty)?;
        match response.status().as_u16() {
            206 => {}
            200 => {
                file.set_len(0).map_err(cannot_write())?;
                file.seek(SeekFrom::Start(0)).map_err(cannot_write())?;
            }
            status if is_temporary(status) => return Err(self.unreachable(&format!("it returned status {status}"))),
            // The file was complete.
            416 if start > 0 => return Ok(true),
            _ => return self.check_absent(response, "read", name).map(|()| false),
        }
        let mut length = file.stream_position().map_err(cannot_write())?;
        let mut reader = Paced::after(response.into_body().into_reader(), self.slow_after);
        let mut buffer = vec![0; BUFFER];
        loop {
            let count = reader.read(&mut buffer).map_err(|error| self.broken(&error))?;
            if count == 0 {
                return Ok(true);
            }
            length += count as u64;
            if length > limit {
                return Err(self.too_long(name, limit));
            }
            file.write_all(&buffer[..count]).map_err(cannot_write())?;
        }
    }

    /// Writes an object in one request.
    fn put_body(&self, name: &str, body: RequestBody<'_>) -> Result<(), RemoteError> {
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.put_object(credentials.as_ref(), &key);
        let response = self.send(&action, body)?;
        self.read_success(response, "write", name).map(|_| ())
    }
}

impl Bucket for S3 {
    fn place(&self) -> String {
        self.place.clone()
    }

    fn list(&self, prefix: &str) -> Result<Vec<BucketObject>, RemoteError> {
        let whole = self.key(prefix);
        let mut entries = Vec::new();
        let (mut token, mut last): (Option<String>, Option<String>) = (None, None);
        loop {
            let credentials = self.credentials();
            let mut action = self.bucket.list_objects_v2(credentials.as_ref());
            action.with_prefix(whole.as_str());
            if let Some(token) = token.take() {
                action.with_continuation_token(token);
            }
            let response = self.send(&action, RequestBody::Empty)?;
            let (_, text) = self.read_success(response, "list", prefix)?;
            let page = ListObjectsV2::parse_response(&text)
                .map_err(|error| self.unexpected("list", prefix, &error.to_string()))?;
            for object in page.contents {
                let modified = object.last_modified.as_deref();
                let modified = modified.and_then(|date| humantime::parse_rfc3339_weak(date).ok());
                if let Some(name) = object.key.strip_prefix(&self.prefix) {
                    entries.push(BucketObject {
                        name: name.to_owned(),
                        size: object.size.unwrap_or_default(),
                        // Objects without a date must not look old.
                        modified: modified.unwrap_or_else(|| self.now()),
                    });
                }
            }
            match page.next_continuation_token {
                Some(next) if last.as_ref() == Some(&next) => {
                    return Err(self.unexpected("list", prefix, "the next page is the same one"));
                }
                Some(next) => {
                    last = Some(next.clone());
                    token = Some(next);
                }
                None => return Ok(entries),
            }
        }
    }

    fn get(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, RemoteError> {
        let key = self.key(name);
        let mut attempt = 1;
        loop {
            let credentials = self.credentials();
            let action = self.bucket.get_object(credentials.as_ref(), &key);
            let response = self.send(&action, RequestBody::Empty)?;
            if response.status() != 200 {
                return self.check_absent(response, "read", name).map(|()| None);
            }
            match self.read_to_limit(response, limit) {
                Ok(Some(bytes)) => return Ok(Some(bytes)),
                Ok(None) => return Err(self.too_long(name, limit)),
                Err(error) if attempt < ATTEMPTS && error.may_be_retried() => attempt += 1,
                Err(error) => return Err(error),
            }
        }
    }

    fn get_file(&self, name: &str, target: &Path, limit: u64) -> Result<Option<u64>, RemoteError> {
        let mut file = File::create(target).map_err(RemoteError::io("write", target))?;
        let mut attempt = 1;
        loop {
            match self.get_rest(name, &mut file, target, limit) {
                Ok(true) => {
                    let length = file.metadata().map_err(RemoteError::io("write", target))?.len();
                    return Ok(Some(length));
                }
                Ok(false) => return Ok(None),
                Err(error) if attempt < ATTEMPTS && error.may_be_retried() => {
                    std::thread::sleep(PAUSE * 2_u32.pow(attempt));
                    attempt += 1;
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        self.put_body(name, RequestBody::Bytes(bytes))
    }

    fn put_file(&self, name: &str, file: &Path, size: u64, note: &UploadNote<'_>) -> Result<(), RemoteError> {
        if size > upload::MAX_SINGLE {
            return upload::in_parts(self, name, file, size, note);
        }
        let body = RequestBody::File {
            path: file,
            from: 0,
            length: size,
        };
        self.put_body(name, body)
    }

    fn delete(&self, name: &str) -> Result<(), RemoteError> {
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.delete_object(credentials.as_ref(), &key);
        let response = self.send(&action, RequestBody::Empty)?;
        match response.status().is_success() {
            true => self.read_success(response, "remove", name).map(|_| ()),
            false => self.check_absent(response, "remove", name),
        }
    }

    fn now(&self) -> SystemTime {
        let clock = *self.clock.lock().unwrap_or_else(PoisonError::into_inner);
        clock.map_or_else(SystemTime::now, |(then, at)| then + at.elapsed())
    }
}

fn agent() -> Result<Agent, RemoteError> {
    let mut tls = TlsConfig::builder();
    let named = ["AWS_CA_BUNDLE", "SSL_CERT_FILE"]
        .into_iter()
        .filter_map(std::env::var_os);
    if let Some(path) = named.into_iter().find(|path| !path.is_empty()) {
        let path = Path::new(&path).to_owned();
        let bytes = read_bounded(&path, MAX_CERTIFICATES).map_err(RemoteError::io("read the certificates", &path))?;
        let certificates: Vec<_> = parse_pem(&bytes)
            .filter_map(|item| match item {
                Ok(PemItem::Certificate(certificate)) => Some(certificate),
                _ => None,
            })
            .collect();
        if certificates.is_empty() {
            return Err(InputError::new(format!("{} contains no certificate", path.display()))
                .help("set AWS_CA_BUNDLE or SSL_CERT_FILE to a file of certificates in PEM format")
                .into());
        }
        tls = tls.root_certs(RootCerts::new_with_certs(&certificates));
    }
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .max_redirects(0)
        .max_redirects_will_error(false)
        .timeout_connect(Some(CONNECT))
        .timeout_recv_response(Some(SILENCE))
        .timeout_recv_body(Some(MAX_DURATION))
        .timeout_per_read(Some(SILENCE))
        .timeout_per_write(Some(SILENCE))
        .user_agent(concat!("deaflow/", env!("CARGO_PKG_VERSION")))
        .tls_config(tls.build());
    Ok(Agent::new_with_config(config.build()))
}

fn method(method: rusty_s3::Method) -> &'static str {
    match method {
        rusty_s3::Method::Head => "HEAD",
        rusty_s3::Method::Get => "GET",
        rusty_s3::Method::Post => "POST",
        rusty_s3::Method::Put => "PUT",
        rusty_s3::Method::Delete => "DELETE",
    }
}

/// Returns the message of an error without the signed URL.
fn describe(error: &ureq::Error) -> String {
    match error {
        ureq::Error::BadUri(_) => "its URL is invalid".to_owned(),
        error => redact(&error.to_string()),
    }
}

/// Removes the signature and other secret parts of a signed request from a text.
fn redact(text: &str) -> String {
    let mut rest = text;
    let mut clean = String::new();
    while let Some(at) = rest.to_ascii_lowercase().find("x-amz-") {
        clean += &rest[..at];
        clean += "…";
        let secret = &rest[at..];
        let end = secret.find(|c: char| c.is_whitespace() || "&\"'<>".contains(c));
        rest = &secret[end.unwrap_or(secret.len())..];
    }
    clean + rest
}

/// Parses an HTTP date (RFC 9110, section 5.6.7) such as `Sun, 06 Nov 1994 08:49:37 GMT`.
fn http_date(text: &str) -> Option<SystemTime> {
    const MONTHS: [&str; 12] = [
        "Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec",
    ];
    let mut words = text.split_once(", ")?.1.split(' ');
    let (day, month, year, time) = (words.next()?, words.next()?, words.next()?, words.next()?);
    let month = 1 + MONTHS.iter().position(|name| *name == month)?;
    humantime::parse_rfc3339(&format!("{year}-{month:02}-{day:0>2}T{time}Z")).ok()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn a_server_that_drips_is_asked_once() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        let requests = Arc::new(AtomicU32::new(0));
        let count = requests.clone();
        std::thread::spawn(move || {
            for mut stream in listener.incoming().flatten() {
                count.fetch_add(1, Ordering::SeqCst);
                std::thread::spawn(move || {
                    let mut request = [0; 4096];
                    while !request.windows(4).any(|end| end == b"\r\n\r\n") {
                        assert!(stream.read(&mut request).unwrap() > 0);
                    }
                    stream
                        .write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\n")
                        .unwrap();
                    while stream.write_all(b"x").is_ok() {
                        std::thread::sleep(Duration::from_millis(10));
                    }
                });
            }
        });
        let address = Address::parse("s3://lab/store", Some(&endpoint), Some("us-east-1")).unwrap();
        let mut s3 = S3::open(&address).unwrap();
        s3.slow_after = Duration::from_millis(200);
        let folder = tempfile::tempdir().unwrap();
        let failures = [
            s3.get_file("object", &folder.path().join("object"), 1 << 20)
                .unwrap_err(),
            s3.get("record", 1 << 20).unwrap_err(),
            s3.list("objects/").unwrap_err(),
        ];
        for error in failures {
            assert!(matches!(error, RemoteError::Slow { .. }), "{error}");
            assert!(error.is_transient() && !error.may_be_retried());
        }
        assert_eq!(requests.load(Ordering::SeqCst), 3);
    }

    #[test]
    fn signatures_are_removed_from_messages() {
        let text = "no: /lab/x?X-Amz-Credential=A&X-Amz-Signature=3e83d6 is old; x-amz-security-token: S";
        let clean = redact(text);
        assert!(!clean.contains("3e83d6") && !clean.contains("=A"), "{clean}");
        assert!(clean.starts_with("no: /lab/x?…&… is old; …"), "{clean}");
        assert_eq!(redact("plain"), "plain");
    }

    #[test]
    fn the_date_of_a_response_is_read() {
        let date = http_date("Sun, 06 Nov 1994 08:49:37 GMT").unwrap();
        assert_eq!(humantime::format_rfc3339(date).to_string(), "1994-11-06T08:49:37Z");
        assert!(http_date("yesterday").is_none() && http_date("Sun, 06 Brumaire 3 08:49:37 GMT").is_none());
    }
}
