//! Access control: a request needs the token, and must come from a page of this server or from a script on this
//! machine.
//!
//! The loopback address alone does not protect the server: any page in the browser may send requests to it, and a host
//! name of a stranger may be resolved to it while a page is open (DNS rebinding). So a request must name the server by
//! its address ([`Guard::check`]: `Host`), the page that sends it must be one of the server's (`Origin`,
//! `Sec-Fetch-Site`), and it must have the token, in a header or in a cookie that other sites cannot use
//! (`SameSite=Strict`).

use std::fmt::Write;

use hyper::HeaderMap;
use hyper::header::{AUTHORIZATION, COOKIE, HOST, HeaderName, HeaderValue, ORIGIN};
use ring::rand::{SecureRandom, SystemRandom};

use super::error::ApiError;

/// Bytes of a token.
const TOKEN_BYTES: usize = 32;

/// The secret of a server: random, new with each start.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// Creates a token; `None` if the system has no source of random numbers.
    #[must_use]
    pub fn random() -> Option<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        SystemRandom::new().fill(&mut bytes).ok()?;
        let mut text = String::with_capacity(2 * TOKEN_BYTES);
        for byte in bytes {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        Some(Self(text))
    }

    /// Returns the token as in the URL.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether a text is the token. Digests are compared, so that the time says nothing about the common prefix.
    #[must_use]
    pub fn matches(&self, text: &str) -> bool {
        blake3::hash(self.0.as_bytes()) == blake3::hash(text.as_bytes())
    }
}

/// Checks requests.
pub struct Guard {
    token: Token,
    port: u16,
}

impl Guard {
    /// Creates the guard of a server on a port.
    #[must_use]
    pub fn new(token: Token, port: u16) -> Self {
        Self { token, port }
    }

    /// Whether a text is the token.
    #[must_use]
    pub fn is_token(&self, text: &str) -> bool {
        self.token.matches(text)
    }

    /// Returns the allowed values of `Host`.
    fn hosts(&self) -> [String; 2] {
        ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port))
    }

    /// Refuses a request that comes from a page of another site, or names the server by another host.
    ///
    /// # Errors
    /// If it does.
    pub fn check(&self, headers: &HeaderMap) -> Result<(), ApiError> {
        let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        let host = text(HOST).unwrap_or_default();
        if !self.hosts().iter().any(|known| known == host) {
            let help = format!("allowed: {}", self.hosts().join(", "));
            return Err(ApiError::new(403, format!("the request is for another host, {host:?}")).help(help));
        }
        let is_own = |origin: &str| origin.strip_prefix("http://") == Some(host);
        let site = text(HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
        let is_foreign = !matches!(site, "none" | "same-origin") || text(ORIGIN).is_some_and(|origin| !is_own(origin));
        match is_foreign {
            true => Err(ApiError::new(403, "the request comes from a page of another site")),
            false => Ok(()),
        }
    }

    /// Refuses a request without the token.
    ///
    /// # Errors
    /// If it is neither in the header nor in the cookie.
    pub fn admit(&self, headers: &HeaderMap) -> Result<(), ApiError> {
        let bearer = headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok());
        let bearer = bearer.and_then(|value| value.strip_prefix("Bearer "));
        let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let cookie = cookies
            .flat_map(|value| value.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .find(|(name, _)| *name == self.cookie_name());
        let given = bearer.or(cookie.map(|(_, value)| value));
        match given {
            Some(token) if self.is_token(token) => Ok(()),
            Some(_) => Err(ApiError::new(401, "the token is not the token of this server").help(TOKEN_HELP)),
            None => Err(ApiError::new(401, "the request has no token").help(TOKEN_HELP)),
        }
    }

    /// Returns the name of the cookie. Cookies are shared by all ports of a host, so the name has the port.
    fn cookie_name(&self) -> String {
        format!("deaflow-{}", self.port)
    }

    /// Returns the cookie that holds the token.
    #[must_use]
    pub fn cookie(&self) -> Option<HeaderValue> {
        let text = format!(
            "{}={}; Path=/; HttpOnly; SameSite=Strict",
            self.cookie_name(),
            self.token.text()
        );
        HeaderValue::from_str(&text).ok()
    }
}

const TOKEN_HELP: &str = "open the URL that deaflow printed, or send the token in it as `Authorization: Bearer TOKEN`";

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs.iter();
        pairs
            .map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_str(value).unwrap()))
            .collect()
    }

    #[test]
    fn tokens_are_long_random_and_compared_as_a_whole() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert_eq!(one.text().len(), 64);
        assert!(one.matches(one.text()) && !one.matches(other.text()));
        assert!(!one.matches(&one.text()[..63]) && !one.matches(""));
    }

    #[test]
    fn only_the_own_name_and_own_pages_are_let_in() {
        let guard = Guard::new(Token::random().unwrap(), 8080);
        let status = |pairs: &[(&'static str, &str)]| guard.check(&headers(pairs)).map_err(|refusal| refusal.status);
        let own = ("host", "127.0.0.1:8080");
        assert_eq!(status(&[own]), Ok(()));
        assert_eq!(
            status(&[("host", "localhost:8080"), ("origin", "http://localhost:8080")]),
            Ok(())
        );
        for refused in [
            &[][..],
            &[("host", "evil.example:8080")],
            &[("host", "127.0.0.1")],
            &[("host", "127.0.0.1:8081")],
            &[own, ("origin", "http://evil.example")],
            &[own, ("origin", "null")],
            &[own, ("origin", "https://127.0.0.1:8080")],
            &[own, ("origin", "http://localhost:8080")],
            &[own, ("sec-fetch-site", "cross-site")],
            &[own, ("sec-fetch-site", "same-site")],
        ] {
            assert_eq!(status(refused), Err(403), "{refused:?}");
        }
    }

    #[test]
    fn the_token_is_taken_from_a_header_or_the_cookie_of_this_port() {
        let token = Token::random().unwrap();
        let guard = Guard::new(token.clone(), 8080);
        let admitted = |name: &'static str, value: String| guard.admit(&headers(&[(name, &value)])).is_ok();
        assert!(admitted("authorization", format!("Bearer {}", token.text())));
        assert!(admitted("cookie", format!("a=b; deaflow-8080={}", token.text())));
        assert!(!admitted("cookie", format!("deaflow-8081={}", token.text())));
        assert!(!admitted("authorization", token.text().to_owned()));
        assert!(!admitted("authorization", "Bearer x".to_owned()));
        assert!(guard.admit(&HeaderMap::new()).is_err());
        assert!(guard.cookie().unwrap().to_str().unwrap().contains("SameSite=Strict"));
    }
}
