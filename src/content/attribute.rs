//! Values that are stored in attributes of an artifact.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::error::{AttributeError, Fault};
use deaflow_scene::{Effects, Scene, Tolerances};

/// A value that is stored in an attribute as text.
pub trait Attribute: Sized {
    /// Returns its text; `None` if it is not written.
    fn into_text(self) -> Option<String>;

    /// Parses the text of an attribute, `None` if the attribute is missing.
    ///
    /// # Errors
    /// If it is required but missing, or invalid.
    fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault>;
}

fn required<'a>(name: &'static str, text: Option<&'a str>) -> Result<&'a str, Fault> {
    text.ok_or(Fault::NoAttribute { name })
}

impl Attribute for String {
    fn into_text(self) -> Option<String> {
        Some(self)
    }

    fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
        required(name, text).map(str::to_owned)
    }
}

impl Attribute for f64 {
    fn into_text(self) -> Option<String> {
        Some(self.to_string())
    }

    fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
        let text = required(name, text)?;
        text.parse().map_err(|source| Fault::Attribute {
            name,
            source: AttributeError::Number(source),
        })
    }
}

/// Types that are stored as YAML.
macro_rules! yaml {
    ($($type:ty),*) => {$(
        impl Attribute for $type {
            fn into_text(self) -> Option<String> {
                Some(self.to_text())
            }

            fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
                Self::from_text(required(name, text)?).map_err(|source| Fault::Attribute {
                    name,
                    source: AttributeError::Input(source),
                })
            }
        }
    )*};
}

yaml!(Effects, Scene, Tolerances);

impl<A: Attribute> Attribute for Option<A> {
    fn into_text(self) -> Option<String> {
        self.and_then(A::into_text)
    }

    fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
        text.map(|text| A::from_text(name, Some(text))).transpose()
    }
}

/// Texts of one line each; none if the attribute is missing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lines(pub Vec<String>);

impl Attribute for Lines {
    fn into_text(self) -> Option<String> {
        Some(self.0.join("\n"))
    }

    fn from_text(_name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
        Ok(Self(text.unwrap_or_default().lines().map(str::to_owned).collect()))
    }
}

/// A value in JSON.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Json(pub String);

impl Json {
    /// Writes a value as JSON.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
    pub fn of<T: Serialize>(value: &T) -> Result<Self, AttributeError> {
        Ok(Self(serde_json::to_string(value)?))
    }

    /// Writes a list as JSON, one entry per line.
    ///
    /// # Errors
    /// If an entry cannot be written as JSON.
    pub fn of_list<T: Serialize>(values: &[T]) -> Result<Self, AttributeError> {
        let entries: Vec<String> = values.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        Ok(Self(format!("[\n{}\n]", entries.join(",\n"))))
    }

    /// Parses the value.
    ///
    /// # Errors
    /// If it is not of this type.
    pub fn value<T: DeserializeOwned>(&self) -> Result<T, AttributeError> {
        Ok(serde_json::from_str(&self.0)?)
    }
}

impl Attribute for Json {
    fn into_text(self) -> Option<String> {
        Some(self.0)
    }

    fn from_text(name: &'static str, text: Option<&str>) -> Result<Self, Fault> {
        Ok(Self(required(name, text)?.to_owned()))
    }
}
