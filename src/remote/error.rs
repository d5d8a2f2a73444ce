//! Errors of remotes.

use std::io;
use std::path::{Path, PathBuf};

use deaflow_base::{EncodingError, InputError};
use deaflow_store::StoreError;

/// A remote could not be used.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// An address, a key or a configuration file is invalid.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The local store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file operation failed.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// The operation, as a verb.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// There was no complete response.
    #[error("cannot reach {host}: {reason}")]
    Unreachable {
        /// Host name and port.
        host: String,
        /// The cause, without parts of the signed URL.
        reason: String,
    },
    /// The storage sent or took data too slowly.
    #[error("{host} is too slow: {reason}")]
    Slow {
        /// Host name and port.
        host: String,
        /// The rate, and the time after which it was given up.
        reason: String,
    },
    /// The storage refused a request.
    #[error(
        "{host} refuses to {action} `{name}`: {status} {code}{}",
        if message.is_empty() { String::new() } else { format!(": {message}") }
    )]
    Refused {
        /// Host name and port.
        host: String,
        /// The request, as a verb.
        action: &'static str,
        /// Name of the object.
        name: String,
        /// HTTP status.
        status: u16,
        /// Error code of the storage.
        code: String,
        /// Message of the storage.
        message: String,
    },
    /// The response was not understood.
    #[error("unexpected response from {host} to {action} `{name}`: {reason}")]
    UnexpectedResponse {
        /// Host name and port.
        host: String,
        /// The request, as a verb.
        action: &'static str,
        /// Name of the object.
        name: String,
        /// What is unexpected.
        reason: String,
    },
    /// The location is not a remote, or was written by another version.
    #[error("{place} contains {found:?}, expected `{known}`")]
    Format {
        /// Location of the marker.
        place: String,
        /// Its content.
        found: String,
        /// The expected content.
        known: &'static str,
    },
    /// Records could not be encoded.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
}

impl RemoteError {
    /// Converts errors of file operations, for `map_err`.
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// Returns advice, if there is any.
    #[must_use]
    pub fn help(&self) -> Option<&'static str> {
        match self {
            Self::Unreachable { .. } | Self::Slow { .. } => {
                Some("try again later, or set another server with --endpoint of `remote add`")
            }
            Self::Refused { code, status, .. } => match code.as_str() {
                "RequestTimeTooSkewed" => Some("set the clock of this machine"),
                "NoSuchBucket" => Some("create the bucket first; deaflow does not create buckets"),
                "PermanentRedirect"
                | "TemporaryRedirect"
                | "AuthorizationHeaderMalformed"
                | "IllegalLocationConstraintException" => {
                    Some("the bucket is in another region; set it with --region of `remote add`")
                }
                _ if [401, 403].contains(status) => Some(
                    "check your credentials: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE in \
                     ~/.aws/credentials, or the role of the machine",
                ),
                _ => None,
            },
            Self::Format { .. } => Some("use the version of deaflow that wrote it, or another URL"),
            _ => None,
        }
    }

    /// Returns whether the same command sends the request again at once.
    pub(super) fn may_be_retried(&self) -> bool {
        matches!(self, Self::Unreachable { .. })
    }

    /// Returns whether a later attempt may succeed.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Unreachable { .. } | Self::Slow { .. } => true,
            Self::Refused { status, code, .. } => is_temporary(*status) || code == "RequestTimeTooSkewed",
            Self::Store(error) => error.is_transient(),
            Self::Io { .. } => true,
            _ => false,
        }
    }
}

/// Returns whether an HTTP status means a temporary failure.
pub fn is_temporary(status: u16) -> bool {
    matches!(status, 408 | 429 | 500 | 502 | 503 | 504)
}
