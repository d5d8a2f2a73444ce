//! Requests: method, path, query and body.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;

use super::error::ApiError;

/// The method of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Reads.
    Get,
    /// Sends a body, or starts something.
    Post,
    /// Stops something.
    Delete,
}

/// A request that passed access control.
#[derive(Clone, Debug)]
pub struct Request {
    /// The method.
    pub method: Method,
    /// The segments of the path.
    pub path: Vec<String>,
    /// The parameters of the query.
    pub query: BTreeMap<String, String>,
    /// The body.
    pub body: Vec<u8>,
}

impl Request {
    /// Parses the body as JSON.
    ///
    /// # Errors
    /// If it is not valid JSON, or has unexpected keys.
    pub fn json<T: DeserializeOwned>(&self) -> Result<T, ApiError> {
        Ok(serde_json::from_slice(&self.body)?)
    }

    /// Returns a parameter of the query, which may be empty; `None` if it is missing.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&str> {
        self.query.get(name).map(String::as_str)
    }

    /// Returns a parameter of the query; `None` if it is missing or empty.
    #[must_use]
    pub fn nonempty(&self, name: &str) -> Option<&str> {
        self.parameter(name).filter(|text| !text.is_empty())
    }

    /// Returns an integer parameter of the query, or `default` if it is missing.
    ///
    /// # Errors
    /// If it is not an integer, or larger than `max`.
    pub fn integer(&self, name: &str, default: usize, max: usize) -> Result<usize, ApiError> {
        let Some(text) = self.parameter(name) else {
            return Ok(default);
        };
        let number = text.parse().ok().filter(|number| *number <= max);
        number.ok_or_else(|| {
            ApiError::bad_request(format!("invalid `{name}`: {text:?}"))
                .help(format!("allowed: an integer from 0 to {max}"))
        })
    }

    /// Returns the row that the parameter `row` names, of `count` rows of an array.
    ///
    /// # Errors
    /// If it names none of them, or is missing.
    pub fn row(&self, path: &str, count: usize) -> Result<usize, ApiError> {
        let text = self.parameter("row").unwrap_or_default();
        let row = text.parse().ok().filter(|row| *row < count);
        row.ok_or_else(|| {
            ApiError::not_found(format!("{path} has no row {text:?}")).help(format!("allowed: rows 0 to {}", count - 1))
        })
    }

    /// Refuses unknown parameters of the query.
    ///
    /// # Errors
    /// If there is an unknown one.
    pub fn allow(&self, names: &[&str]) -> Result<(), ApiError> {
        match self.query.keys().find(|name| !names.contains(&name.as_str())) {
            None => Ok(()),
            Some(other) => {
                let known = if names.is_empty() {
                    "none".to_owned()
                } else {
                    names.join(", ")
                };
                Err(ApiError::bad_request(format!("unknown parameter {other:?}")).help(format!("allowed: {known}")))
            }
        }
    }
}

/// Splits a path into decoded segments; `None` if it is malformed.
#[must_use]
pub fn steps(path: &str) -> Option<Vec<String>> {
    let steps = path.strip_prefix('/')?.split('/').filter(|step| !step.is_empty());
    steps.map(|step| decoded(step, false)).collect()
}

/// Decodes the parameters of a query; of a repeated name the last value counts. `None` if it is malformed.
#[must_use]
pub fn words(query: &str) -> Option<BTreeMap<String, String>> {
    let pairs = query.split('&').filter(|pair| !pair.is_empty());
    let pair = |pair: &str| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        Some((decoded(name, true)?, decoded(value, true)?))
    };
    pairs.map(pair).collect()
}

/// Decodes percent signs (RFC 3986); in a query, plus is a space.
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
    fn percent_signs_are_decoded_or_refused() {
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
