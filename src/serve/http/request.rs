//! What is asked: method, path, query and body.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;

use super::refusal::Refusal;

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Read.
    Get,
    /// Ask with a body, or begin something.
    Post,
    /// End something.
    Delete,
}

/// A request that was let in.
#[derive(Clone, Debug)]
pub struct Request {
    /// What is to be done.
    pub method: Method,
    /// The steps of the path.
    pub path: Vec<String>,
    /// What stands after the question mark.
    pub query: BTreeMap<String, String>,
    /// The body.
    pub body: Vec<u8>,
}

impl Request {
    /// The body as JSON.
    ///
    /// # Errors
    /// When it is none, or says something else than is wanted.
    pub fn json<T: DeserializeOwned>(&self) -> Result<T, Refusal> {
        Ok(serde_json::from_slice(&self.body)?)
    }

    /// A word of the query.
    #[must_use]
    pub fn word(&self, name: &str) -> Option<&str> {
        self.query.get(name).map(String::as_str)
    }

    /// A whole number of the query.
    ///
    /// # Errors
    /// When it is none, or more than `most`.
    pub fn number(&self, name: &str, usual: usize, most: usize) -> Result<usize, Refusal> {
        let Some(text) = self.word(name) else {
            return Ok(usual);
        };
        let number = text.parse().ok().filter(|number| *number <= most);
        number.ok_or_else(|| Refusal::bad(format!("{name} is {text:?}")).help(format!("allowed: 0 to {most}")))
    }

    /// Refuses words of the query that mean nothing here.
    ///
    /// # Errors
    /// When there are such.
    pub fn allow(&self, names: &[&str]) -> Result<(), Refusal> {
        match self.query.keys().find(|name| !names.contains(&name.as_str())) {
            None => Ok(()),
            Some(other) => {
                let known = if names.is_empty() {
                    "none".to_owned()
                } else {
                    names.join(", ")
                };
                Err(Refusal::bad(format!("{other:?} means nothing in this query")).help(format!("allowed: {known}")))
            }
        }
    }
}

/// The steps of a path, decoded; none where it is malformed.
#[must_use]
pub fn steps(path: &str) -> Option<Vec<String>> {
    let steps = path.strip_prefix('/')?.split('/').filter(|step| !step.is_empty());
    steps.map(|step| decoded(step, false)).collect()
}

/// The words of a query, decoded; of a name that comes several times the last. None where it is malformed.
#[must_use]
pub fn words(query: &str) -> Option<BTreeMap<String, String>> {
    let pairs = query.split('&').filter(|pair| !pair.is_empty());
    let pair = |pair: &str| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        Some((decoded(name, true)?, decoded(value, true)?))
    };
    pairs.map(pair).collect()
}

/// A text with its percent signs resolved (RFC 3986); in a query a plus is a space.
fn decoded(text: &str, is_query: bool) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let mut digit = || char::from(rest.next()?).to_digit(16);
                u8::try_from(16 * digit()? + digit()?).ok()?
            }
            b'+' if is_query => b' ',
            other => other,
        });
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_are_resolved_or_refused() {
        assert_eq!(steps("/api/a%20b/").unwrap(), ["api", "a b"]);
        assert_eq!(steps("/%2e%2e/x").unwrap(), ["..", "x"]);
        for malformed in ["api", "/%", "/%2", "/%zz", "/%ff"] {
            assert_eq!(steps(malformed), None, "{malformed}");
        }
        let found = words("filter=a%3E1+and+b&limit=3&x").unwrap();
        assert_eq!(found["filter"], "a>1 and b");
        assert_eq!((found["limit"].as_str(), found["x"].as_str()), ("3", ""));
        assert_eq!(words("a=%"), None);
    }
}
