//! S3-compatible storage over HTTP. Requests are signed as URLs (AWS Signature Version 4), which therefore appear in no message.

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

use super::bucket::{Bucket, Entry, Unfinished};
use super::config::{Address, check_endpoint};
use super::credentials::{self, Chain};
use super::error::{RemoteError, is_passing};
use super::upload;
use deaflow_base::{InputError, read_bounded};

/// How long a signed request may be begun after it was signed; clocks may differ by a quarter of an hour anyway.
const SIGNED_FOR: Duration = Duration::from_secs(900);

/// How long a server may take to be there.
const CONNECT: Duration = Duration::from_secs(10);

/// How long nothing may be said on either side.
const SILENCE: Duration = Duration::from_secs(60);

/// Bytes a second that are fewer than any network brings: then the server holds up.
const LEAST_RATE: u64 = 1000;

/// How long an answer may take in all: one that is not there then is gone on with.
const LONGEST: Duration = Duration::from_secs(3600);

/// How often something is tried that may pass, and the pause before the second time.
const TRIES: u32 = 5;
const PAUSE: Duration = Duration::from_millis(200);

/// An answer in words is shorter, bytes.
const MAX_ANSWER: u64 = 16 << 20;

/// A certificate file is shorter, bytes.
const MAX_CERTIFICATES: u64 = 16 << 20;

/// Bytes that are read at a time.
const PIECE: usize = 1 << 17;

/// What is sent with a request.
#[derive(Clone, Copy)]
pub enum Sent<'a> {
    /// Nothing.
    Nothing,
    /// Bytes.
    Bytes(&'a [u8]),
    /// Bytes of a file.
    File {
        /// Which.
        path: &'a Path,
        /// From where.
        from: u64,
        /// How many.
        length: u64,
    },
}

/// A bucket of S3-compatible storage, and a prefix in it.
pub struct S3 {
    agent: Agent,
    bucket: Signed,
    prefix: String,
    /// Without credentials and protocol, for messages.
    host: String,
    place: String,
    chain: Chain,
    clock: Mutex<Option<(SystemTime, Instant)>>,
}

impl S3 {
    /// Storage at an address. What the address does not say the environment does.
    ///
    /// # Errors
    /// When there is no such server, or the certificates that the environment names cannot be read. Nothing is asked for yet.
    pub fn open(address: &Address) -> Result<Self, RemoteError> {
        let region = address.region.clone().or_else(credentials::region);
        let region = region.unwrap_or_else(|| "us-east-1".to_owned());
        let given = address.endpoint.clone().or_else(credentials::endpoint);
        // Certificates of Amazon are for one name before its own.
        let style = match given.is_none() && !address.bucket.contains('.') {
            true => UrlStyle::VirtualHost,
            false => UrlStyle::Path,
        };
        let endpoint = given.unwrap_or_else(|| format!("https://s3.{region}.amazonaws.com"));
        check_endpoint(&endpoint)?;
        let wrong = |why: String| InputError::new(format!("{endpoint:?} is no address of a server: {why}"));
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
            chain: Chain::default(),
            clock: Mutex::default(),
        })
    }

    /// The name of an object in the bucket.
    pub fn key(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// The bucket, to name actions on it.
    pub fn bucket(&self) -> &Signed {
        &self.bucket
    }

    /// The credentials to sign with.
    pub fn credentials(&self) -> Option<Credentials> {
        self.chain.now(&self.agent)
    }

    /// Sends a request until there is an answer that says something of what was asked.
    ///
    /// # Errors
    /// When there is none.
    pub fn send<'a, A: S3Action<'a>>(
        &self,
        action: &A,
        headers: &[(&str, String)],
        sent: Sent<'_>,
    ) -> Result<Response<Body>, RemoteError> {
        let mut pause = PAUSE;
        let mut tried = 1;
        loop {
            let answer = self.send_once(action, headers, sent);
            let is_passing = match &answer {
                Ok(answer) => is_passing(answer.status().as_u16()),
                Err(RemoteError::Unreachable { .. }) => true,
                Err(_) => false,
            };
            if !is_passing || tried == TRIES {
                return answer;
            }
            std::thread::sleep(pause);
            pause *= 2;
            tried += 1;
        }
    }

    fn send_once<'a, A: S3Action<'a>>(
        &self,
        action: &A,
        headers: &[(&str, String)],
        sent: Sent<'_>,
    ) -> Result<Response<Body>, RemoteError> {
        let url = action.sign(SIGNED_FOR);
        let mut request = Request::builder().method(method(A::METHOD)).uri(url.as_str());
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        let built = |error: ureq::http::Error| self.unreachable(&error.to_string());
        let done = match sent {
            Sent::Nothing if matches!(A::METHOD, rusty_s3::Method::Post | rusty_s3::Method::Put) => {
                self.agent.run(request.body(SendBody::none()).map_err(built)?)
            }
            Sent::Nothing => self.agent.run(request.body(()).map_err(built)?),
            Sent::Bytes(bytes) => self.agent.run(request.body(bytes).map_err(built)?),
            Sent::File { path, from, length } => {
                let mut file = File::open(path).map_err(RemoteError::io("open", path))?;
                let there = file.metadata().map_err(RemoteError::io("read", path))?.len();
                if there < from + length {
                    // The server would wait for what does not come.
                    return Err(RemoteError::io("read", path)(ErrorKind::UnexpectedEof.into()));
                }
                file.seek(SeekFrom::Start(from))
                    .map_err(RemoteError::io("read", path))?;
                let mut piece = file.take(length);
                let request = request.header("content-length", length.to_string());
                let body = SendBody::from_reader(&mut piece);
                self.agent.run(request.body(body).map_err(built)?)
            }
        };
        let answer = done.map_err(|error| self.unreachable(&words(&error)))?;
        self.look_at_clock(&answer);
        Ok(answer)
    }

    fn look_at_clock(&self, answer: &Response<Body>) {
        let date = answer.headers().get("date").and_then(|date| date.to_str().ok());
        let date = date.and_then(http_date);
        if let Some(date) = date {
            *self.clock.lock().unwrap_or_else(PoisonError::into_inner) = Some((date, Instant::now()));
        }
    }

    /// The words of an answer that says it is well.
    ///
    /// # Errors
    /// When it says otherwise, or ends too early.
    pub fn well(
        &self,
        answer: Response<Body>,
        action: &'static str,
        name: &str,
    ) -> Result<(ureq::http::HeaderMap, String), RemoteError> {
        let (status, headers) = (answer.status().as_u16(), answer.headers().clone());
        let text = answer.into_body().into_with_config().limit(MAX_ANSWER).read_to_string();
        let text = text.map_err(|error| self.unreachable(&words(&error)))?;
        match (200..300).contains(&status) {
            true => Ok((headers, text)),
            false => Err(self.refused(action, name, status, &text)),
        }
    }

    /// The error of an answer that says it is not well.
    fn refused(&self, action: &'static str, name: &str, status: u16, text: &str) -> RemoteError {
        let within = |tag: &str| {
            let rest = text.split_once(&format!("<{tag}>"))?.1;
            let inner = rest.split_once(&format!("</{tag}>"))?.0;
            Some(inner.chars().take(300).collect::<String>())
        };
        let word = match status {
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
            code: within("Code").map_or_else(|| word.to_owned(), |code| blotted(&code)),
            message: within("Message").map_or_else(String::new, |message| blotted(&message)),
        }
    }

    fn unreachable(&self, reason: &str) -> RemoteError {
        RemoteError::Unreachable {
            host: self.host.clone(),
            reason: reason.to_owned(),
        }
    }

    /// The error of an answer that is not understood.
    pub fn puzzled(&self, action: &'static str, name: &str, reason: &str) -> RemoteError {
        RemoteError::Answer {
            host: self.host.clone(),
            action,
            name: name.to_owned(),
            reason: blotted(reason),
        }
    }

    /// Whether an answer says that there is no such object. That there is no bucket is another thing.
    fn is_absent(error: &RemoteError) -> bool {
        matches!(error, RemoteError::Refused { status: 404, code, .. } if code != "NoSuchBucket")
    }

    /// Adds what is left of an object to a file that holds its beginning; says whether there is one.
    fn get_rest(&self, name: &str, file: &mut File, target: &Path, limit: u64) -> Result<bool, RemoteError> {
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.get_object(credentials.as_ref(), &key);
        let there = file.seek(SeekFrom::End(0)).map_err(RemoteError::io("write", target))?;
        let headers: Vec<(&str, String)> = (there > 0)
            .then(|| ("range", format!("bytes={there}-")))
            .into_iter()
            .collect();
        let answer = self.send_once(&action, &headers, Sent::Nothing)?;
        match answer.status().as_u16() {
            206 => {}
            200 => {
                file.set_len(0).map_err(RemoteError::io("write", target))?;
                file.seek(SeekFrom::Start(0))
                    .map_err(RemoteError::io("write", target))?;
            }
            status if is_passing(status) => return Err(self.unreachable(&format!("it answers {status}"))),
            // All of it was there.
            416 if there > 0 => return Ok(true),
            _ => {
                return match self.well(answer, "read", name) {
                    Err(error) if Self::is_absent(&error) => Ok(false),
                    Err(error) => Err(error),
                    Ok(_) => Err(self.puzzled("read", name, "neither an object nor a reason why not")),
                };
            }
        }
        let mut length_there = file.stream_position().map_err(RemoteError::io("write", target))?;
        let (begun, mut come) = (Instant::now(), 0);
        let mut reader = answer.into_body().into_reader();
        let mut buffer = vec![0; PIECE];
        loop {
            let length = reader
                .read(&mut buffer)
                .map_err(|error| self.unreachable(&error.to_string()))?;
            if length == 0 {
                return Ok(true);
            }
            length_there += length as u64;
            come += length as u64;
            if begun.elapsed() > SILENCE && come < LEAST_RATE * begun.elapsed().as_secs() {
                return Err(self.unreachable(&format!("it gives less than {LEAST_RATE} bytes a second")));
            }
            if length_there > limit {
                return Err(self.puzzled("read", name, &format!("it is longer than {limit} bytes")));
            }
            file.write_all(&buffer[..length])
                .map_err(RemoteError::io("write", target))?;
        }
    }
}

impl Bucket for S3 {
    fn place(&self) -> String {
        self.place.clone()
    }

    fn list(&self, prefix: &str) -> Result<Vec<Entry>, RemoteError> {
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
            let answer = self.send(&action, &[], Sent::Nothing)?;
            let (_, text) = self.well(answer, "list", prefix)?;
            let page = ListObjectsV2::parse_response(&text)
                .map_err(|error| self.puzzled("list", prefix, &error.to_string()))?;
            for object in page.contents {
                let modified = object.last_modified.as_deref();
                let modified = modified.and_then(|date| humantime::parse_rfc3339_weak(date).ok());
                if let Some(name) = object.key.strip_prefix(&self.prefix) {
                    entries.push(Entry {
                        name: name.to_owned(),
                        size: object.size.unwrap_or_default(),
                        // Of what has no date nothing is removed for its age.
                        modified: modified.unwrap_or_else(|| self.now()),
                    });
                }
            }
            match page.next_continuation_token {
                Some(next) if last.as_ref() == Some(&next) => {
                    return Err(self.puzzled("list", prefix, "the next page is the same one"));
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
        let mut tried = 1;
        loop {
            let credentials = self.credentials();
            let action = self.bucket.get_object(credentials.as_ref(), &key);
            let answer = self.send(&action, &[], Sent::Nothing)?;
            if answer.status() != 200 {
                return match self.well(answer, "read", name) {
                    Err(error) if Self::is_absent(&error) => Ok(None),
                    Err(error) => Err(error),
                    Ok(_) => Err(self.puzzled("read", name, "neither an object nor a reason why not")),
                };
            }
            match answer.into_body().into_with_config().limit(limit).read_to_vec() {
                Ok(bytes) => return Ok(Some(bytes)),
                Err(ureq::Error::BodyExceedsLimit(_)) => {
                    return Err(self.puzzled("read", name, &format!("it is longer than {limit} bytes")));
                }
                Err(error) if tried == TRIES => return Err(self.unreachable(&words(&error))),
                Err(_) => tried += 1,
            }
        }
    }

    fn get_file(&self, name: &str, target: &Path, limit: u64) -> Result<Option<u64>, RemoteError> {
        let mut file = File::create(target).map_err(RemoteError::io("write", target))?;
        let mut tried = 1;
        loop {
            match self.get_rest(name, &mut file, target, limit) {
                Ok(true) => {
                    let length = file.metadata().map_err(RemoteError::io("write", target))?.len();
                    return Ok(Some(length));
                }
                Ok(false) => return Ok(None),
                Err(RemoteError::Unreachable { .. }) if tried < TRIES => {
                    std::thread::sleep(PAUSE * 2_u32.pow(tried));
                    tried += 1;
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.put_object(credentials.as_ref(), &key);
        let answer = self.send(&action, &[], Sent::Bytes(bytes))?;
        self.well(answer, "write", name).map(|_| ())
    }

    fn put_file(&self, name: &str, file: &Path, size: u64, unfinished: &Unfinished<'_>) -> Result<(), RemoteError> {
        if size > upload::WHOLE {
            return upload::in_pieces(self, name, file, size, unfinished);
        }
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.put_object(credentials.as_ref(), &key);
        let sent = Sent::File {
            path: file,
            from: 0,
            length: size,
        };
        let answer = self.send(&action, &[], sent)?;
        self.well(answer, "write", name).map(|_| ())
    }

    fn delete(&self, name: &str) -> Result<(), RemoteError> {
        let key = self.key(name);
        let credentials = self.credentials();
        let action = self.bucket.delete_object(credentials.as_ref(), &key);
        let answer = self.send(&action, &[], Sent::Nothing)?;
        match self.well(answer, "remove", name) {
            Err(error) if Self::is_absent(&error) => Ok(()),
            done => done.map(|_| ()),
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
            return Err(
                InputError::new(format!("there is no certificate in {}", path.display()))
                    .help("AWS_CA_BUNDLE or SSL_CERT_FILE names it")
                    .into(),
            );
        }
        tls = tls.root_certs(RootCerts::new_with_certs(&certificates));
    }
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .max_redirects(0)
        .max_redirects_will_error(false)
        .timeout_connect(Some(CONNECT))
        .timeout_recv_response(Some(SILENCE))
        .timeout_recv_body(Some(LONGEST))
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

/// What an error says, without the URL, which could be used by whoever reads it.
fn words(error: &ureq::Error) -> String {
    match error {
        ureq::Error::BadUri(_) => "its address cannot be used".to_owned(),
        error => blotted(&error.to_string()),
    }
}

/// A text without what could be used by whoever reads it: the parts of a signed request.
fn blotted(text: &str) -> String {
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

/// A date as HTTP has it (RFC 9110, section 5.6.7): `Sun, 06 Nov 1994 08:49:37 GMT`.
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
    use super::*;

    #[test]
    fn what_signs_a_request_is_told_to_nobody() {
        let text = "no: /lab/x?X-Amz-Credential=A&X-Amz-Signature=3e83d6 is old; x-amz-security-token: S";
        let clean = blotted(text);
        assert!(!clean.contains("3e83d6") && !clean.contains("=A"), "{clean}");
        assert!(clean.starts_with("no: /lab/x?…&… is old; …"), "{clean}");
        assert_eq!(blotted("plain"), "plain");
    }

    #[test]
    fn the_date_of_an_answer_is_read() {
        let date = http_date("Sun, 06 Nov 1994 08:49:37 GMT").unwrap();
        assert_eq!(humantime::format_rfc3339(date).to_string(), "1994-11-06T08:49:37Z");
        assert!(http_date("yesterday").is_none() && http_date("Sun, 06 Brumaire 3 08:49:37 GMT").is_none());
    }
}
