//! Why a remote could not be used.

use std::io;
use std::path::{Path, PathBuf};

use deaflow_base::{EncodingError, InputError};
use deaflow_store::StoreError;

/// A refusal by a remote, or on the way to it.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// An address, a key or a file of the configuration cannot be used.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The store on this side refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The operating system refused.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The system's own message.
        source: io::Error,
    },
    /// Nothing answered, or not to the end.
    #[error("cannot reach {host}: {reason}")]
    Unreachable {
        /// Who was asked.
        host: String,
        /// What went wrong.
        reason: String,
    },
    /// The storage answered that it will not.
    #[error("{host} refuses to {action} `{name}`: {status} {code}{}", if message.is_empty() { String::new() } else { format!(": {message}") })]
    Refused {
        /// Who was asked.
        host: String,
        /// What was asked for.
        action: &'static str,
        /// Of which object.
        name: String,
        /// Status of HTTP.
        status: u16,
        /// Its own word for why.
        code: String,
        /// Its own message.
        message: String,
    },
    /// An answer that is none.
    #[error("{host} gives an answer that is not understood, asked to {action} `{name}`: {reason}")]
    Answer {
        /// Who was asked.
        host: String,
        /// What was asked for.
        action: &'static str,
        /// Of which object.
        name: String,
        /// How it shows.
        reason: String,
    },
    /// The place holds something else, or was written by another version.
    #[error("{place} says {found:?}; this program knows `{known}`")]
    Format {
        /// The marker.
        place: String,
        /// What it says.
        found: String,
        /// What it should say.
        known: &'static str,
    },
    /// Records that cannot be encoded.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
}

impl RemoteError {
    /// For `map_err` on calls of the standard library.
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// What may help, where that is known.
    #[must_use]
    pub fn help(&self) -> Option<&'static str> {
        match self {
            Self::Unreachable { .. } => {
                Some("the network may come back; --endpoint of `remote add` names another server")
            }
            Self::Refused { code, status, .. } => match code.as_str() {
                "RequestTimeTooSkewed" => Some("the clock of this machine is wrong: set it"),
                "NoSuchBucket" => Some("make the bucket first; deaflow makes none"),
                "PermanentRedirect"
                | "TemporaryRedirect"
                | "AuthorizationHeaderMalformed"
                | "IllegalLocationConstraintException" => {
                    Some("the bucket is in another region: `remote add` takes --region")
                }
                _ if [401, 403].contains(status) => Some(
                    "credentials come from AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, from AWS_PROFILE in ~/.aws/credentials, \
                     or from the machine's role; they must allow this",
                ),
                _ => None,
            },
            Self::Format { .. } => Some("use the program that made it, or another place"),
            _ => None,
        }
    }

    /// Whether to try again later may help.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Unreachable { .. } => true,
            Self::Refused { status, code, .. } => is_passing(*status) || code == "RequestTimeTooSkewed",
            Self::Store(error) => error.is_transient(),
            Self::Io { .. } => true,
            _ => false,
        }
    }
}

/// Whether a status of HTTP says that the storage is in trouble just now.
pub fn is_passing(status: u16) -> bool {
    matches!(status, 408 | 429 | 500 | 502 | 503 | 504)
}
