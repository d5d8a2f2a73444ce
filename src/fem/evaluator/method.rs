//! The solution methods: `newton`, `linear` or `chord:N`.

use std::fmt;
use std::str::FromStr;

use deaflow_base::{Canonical, InputError, Node, Parameter, Schema, nearest};

/// A solution method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The linear response of the half-active membrane, an estimate.
    Linear,
    /// This number of chord steps after the linear response, a better estimate.
    Chord(u32),
    /// Newton's method to a stable equilibrium.
    Newton,
}

/// Newton's method takes less time than more chord steps.
const MOST_STEPS: u32 = 50;

const ALLOWED: &str = "allowed: newton, linear, chord:N with N from 1 to 50";

impl Method {
    /// Returns the number of chord steps after the linear response; `None` for Newton's method.
    #[must_use]
    pub fn chord_steps(self) -> Option<u32> {
        match self {
            Self::Linear => Some(0),
            Self::Chord(steps) => Some(steps),
            Self::Newton => None,
        }
    }
}

impl Parameter for Method {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let text = node.text(key)?;
        text.parse().map_err(|unknown: UnknownMethod| {
            node.error(format!("`{key}` cannot be {text:?}"))
                .help(unknown.to_string())
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(self.to_string().as_str()))
    }

    fn schema((): &()) -> Schema {
        let words = Schema::word(&["newton", "linear"]);
        let chord = Schema::matching("^chord:\\+?0*([1-9]|[1-4][0-9]|50)$");
        Schema::any_of([words, chord])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

/// A text that names no method.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownMethod {
    near: Option<&'static str>,
}

impl std::error::Error for UnknownMethod {}

/// Formats the suggestion and the allowed values.
impl fmt::Display for UnknownMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(near) = self.near {
            write!(f, "did you mean `{near}`? ")?;
        }
        f.write_str(ALLOWED)
    }
}

impl FromStr for Method {
    type Err = UnknownMethod;

    fn from_str(text: &str) -> Result<Self, UnknownMethod> {
        match (text, text.strip_prefix("chord:").map(str::parse)) {
            ("newton", _) => Ok(Self::Newton),
            ("linear", _) => Ok(Self::Linear),
            (_, Some(Ok(steps))) if (1..=MOST_STEPS).contains(&steps) => Ok(Self::Chord(steps)),
            _ => Err(UnknownMethod {
                // A number that is not allowed is not a misspelt one.
                near: nearest(text, &["newton", "linear", "chord:1"]).filter(|_| !text.starts_with("chord:")),
            }),
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Linear => f.write_str("linear"),
            Self::Chord(steps) => write!(f, "chord:{steps}"),
            Self::Newton => f.write_str("newton"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_read_as_they_are_written() {
        for method in [Method::Newton, Method::Linear, Method::Chord(1), Method::Chord(50)] {
            assert_eq!(method.to_string().parse(), Ok(method));
        }
        for text in ["chord", "chord:0", "chord:51", "chord:-1", "chord:1.5", "Newton", ""] {
            assert!(text.parse::<Method>().is_err(), "{text}");
        }
        let many = "chord:99".parse::<Method>().unwrap_err().to_string();
        assert!(
            !many.contains("did you mean") && many.contains("N from 1 to 50"),
            "{many}"
        );
        assert!(
            "chrod:1"
                .parse::<Method>()
                .unwrap_err()
                .to_string()
                .contains("did you mean `chord:1`?")
        );
    }
}
