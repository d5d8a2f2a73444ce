//! Digests of different things have different types, so that they cannot be confused.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::digest::{Digest, ParseDigestError};

macro_rules! id {
    ($(#[$meta:meta])* $name:ident) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub struct $name(Digest);

        impl $name {
            /// Computes the digest of bytes.
            #[must_use]
            pub fn of(bytes: &[u8]) -> Self {
                Self(Digest::of(bytes))
            }

            /// The raw 32 bytes.
            #[must_use]
            pub fn as_bytes(&self) -> &[u8; 32] {
                self.0.as_bytes()
            }

            /// Returns the first 12 hexadecimal digits, for tables and messages.
            #[must_use]
            pub fn short(&self) -> String {
                self.0.short()
            }
        }

        impl From<Digest> for $name {
            fn from(digest: Digest) -> Self {
                Self(digest)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!(stringify!($name), "({})"), self.short())
            }
        }

        impl FromStr for $name {
            type Err = ParseDigestError;

            fn from_str(text: &str) -> Result<Self, Self::Err> {
                text.parse().map(Self)
            }
        }
    };
}

id! {
    /// The digest of the logical content of an artifact.
    ArtifactId
}

id! {
    /// The digest of kind, recipe, parameters and inputs of an action.
    ActionKey
}

id! {
    /// The digest of a pattern together with its symmetric images.
    OrbitId
}

id! {
    /// The digest of the bytes of a file.
    FileDigest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_written_and_encoded_as_its_digest() {
        let (digest, id) = (Digest::of(b"1"), ArtifactId::of(b"1"));
        assert_eq!(id.to_string(), digest.to_string());
        assert_eq!(digest.to_string().parse::<ArtifactId>().unwrap(), id);
        assert_eq!(format!("{id:?}"), format!("ArtifactId({})", digest.short()));
        assert_eq!(crate::encode(&id).unwrap(), crate::encode(&digest).unwrap());
        assert!("x".parse::<ActionKey>().is_err());
    }
}
