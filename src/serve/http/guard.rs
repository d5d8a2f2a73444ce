//! Who may ask: who knows the token, from a page of this server or from a script, under this machine's own name.
//!
//! The address alone keeps nobody out: any page in the browser may send requests to it, and a name that a stranger owns may be made to lead
//! here while a page is open (DNS rebinding). So a request must name the server by its address ([`Guard::check`]: `Host`), a page that sends
//! it must be one of the server's (`Origin`, `Sec-Fetch-Site`), and it must have the token, in a header or in a cookie that other sites
//! cannot have sent along (`SameSite=Strict`).

use std::fmt::Write;

use hyper::HeaderMap;
use hyper::header::{AUTHORIZATION, COOKIE, HOST, HeaderName, HeaderValue, ORIGIN};
use ring::rand::{SecureRandom, SystemRandom};

use super::refusal::Refusal;

/// Bytes of a token: nobody guesses 256 bits.
const BYTES: usize = 32;

/// What lets in: random, and new with each server.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A new one; `None` where the system has no random numbers to give.
    #[must_use]
    pub fn random() -> Option<Self> {
        let mut bytes = [0; BYTES];
        SystemRandom::new().fill(&mut bytes).ok()?;
        let mut text = String::with_capacity(2 * BYTES);
        for byte in bytes {
            // Writing to a text cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        Some(Self(text))
    }

    /// As it stands in an address.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether a text is the token. It takes as long whatever the text has in common with it: digests are compared, in constant time.
    #[must_use]
    pub fn is(&self, text: &str) -> bool {
        blake3::hash(self.0.as_bytes()) == blake3::hash(text.as_bytes())
    }
}

/// Lets in or refuses.
pub struct Guard {
    token: Token,
    port: u16,
}

impl Guard {
    /// For a server on a port.
    #[must_use]
    pub fn new(token: Token, port: u16) -> Self {
        Self { token, port }
    }

    /// Whether a text is the token.
    #[must_use]
    pub fn knows(&self, text: &str) -> bool {
        self.token.is(text)
    }

    /// The names by which the server may be called.
    fn hosts(&self) -> [String; 2] {
        ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port))
    }

    /// Refuses a request that is none of a page of this server or of a script on this machine.
    ///
    /// # Errors
    /// When it is not.
    pub fn check(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        let host = text(HOST).unwrap_or_default();
        if !self.hosts().iter().any(|known| known == host) {
            return Err(
                Refusal::new(403, "this server is not called so").help(format!("allowed: {}", self.hosts().join(", ")))
            );
        }
        let is_own = |origin: &str| origin.strip_prefix("http://") == Some(host);
        if text(ORIGIN).is_some_and(|origin| !is_own(origin)) {
            return Err(Refusal::new(403, "a page of another site has sent this"));
        }
        let site = text(HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
        match site {
            "none" | "same-origin" => Ok(()),
            _ => Err(Refusal::new(403, "a page of another site has sent this")),
        }
    }

    /// Refuses who does not know the token.
    ///
    /// # Errors
    /// When it is neither in the header nor in the cookie.
    pub fn admit(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let bearer = headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok());
        let bearer = bearer.and_then(|value| value.strip_prefix("Bearer "));
        let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let cookie = cookies
            .flat_map(|value| value.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .find(|(name, _)| *name == self.cookie_name());
        let given = bearer.or(cookie.map(|(_, value)| value));
        match given {
            Some(token) if self.knows(token) => Ok(()),
            Some(_) => Err(Refusal::new(401, "the token is not that of this server").help(ADVICE)),
            None => Err(Refusal::new(401, "there is no token").help(ADVICE)),
        }
    }

    /// Cookies know no ports, so each server has its own.
    fn cookie_name(&self) -> String {
        format!("deaflow-{}", self.port)
    }

    /// The cookie of who has named the token.
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

const ADVICE: &str = "open the address that deaflow printed, or send the token in it as `Authorization: Bearer TOKEN`";

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
    fn tokens_are_long_random_and_compared_whole() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert_eq!(one.text().len(), 64);
        assert!(one.is(one.text()) && !one.is(other.text()));
        assert!(!one.is(&one.text()[..63]) && !one.is(""));
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
