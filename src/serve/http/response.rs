//! Responses of the server.

use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};

use http_body_util::Full;
use hyper::body::{Body, Bytes, Frame, SizeHint};
use serde_json::Value;
use tokio::sync::mpsc;

use deaflow_base::printable_json;

/// A response.
#[derive(Debug)]
pub enum Response {
    /// A JSON document.
    Json(Value),
    /// Bytes of a media type, with a file name if the browser is to save them.
    Bytes {
        /// The media type.
        media: &'static str,
        /// The bytes.
        bytes: Vec<u8>,
        /// The file name.
        file: Option<String>,
    },
    /// A page without scripts, with its style sheet within: figures of an artifact.
    Html(String),
    /// JSON documents, one a line, sent as they are produced.
    JsonLines(mpsc::Receiver<Bytes>),
    /// The main page.
    Index {
        /// Whether the token was in the URL, so that a cookie is set.
        has_token: bool,
    },
}

impl Response {
    /// Arrays for the page, see [`super::frame()`].
    pub fn frame(bytes: Vec<u8>) -> Self {
        Self::Bytes {
            media: "application/octet-stream",
            bytes,
            file: None,
        }
    }
}

impl From<Value> for Response {
    fn from(document: Value) -> Self {
        Self::Json(document)
    }
}

/// Writes a document on one line, without characters that change the direction of text.
#[must_use]
pub fn line_of(document: &Value) -> Bytes {
    let text = document.to_string();
    Bytes::from(format!("{}\n", printable_json(&text)))
}

/// The sending end of a response of [`Response::JsonLines`].
#[derive(Clone, Debug)]
pub struct LineSender(mpsc::Sender<Bytes>);

/// Lines that are sent before the sender waits for the reader.
const BUFFERED_LINES: usize = 32;

impl LineSender {
    /// Creates a sender and its response.
    #[must_use]
    pub fn new() -> (Self, Response) {
        let (sender, receiver) = mpsc::channel(BUFFERED_LINES);
        (Self(sender), Response::JsonLines(receiver))
    }

    /// Sends a document; false if the connection is closed. Blocks while the reader is slow: never call it in async
    /// code.
    #[must_use]
    pub fn send(&self, document: &Value) -> bool {
        self.0.blocking_send(line_of(document)).is_ok()
    }

    /// Whether the connection is closed.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
}

/// The body of a response.
pub enum ResponseBody {
    /// A body that is complete.
    Full(Full<Bytes>),
    /// Lines that are sent as they are produced.
    Lines(mpsc::Receiver<Bytes>),
}

impl Body for ResponseBody {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Self::Error>>> {
        match self.get_mut() {
            Self::Full(full) => Pin::new(full).poll_frame(context),
            Self::Lines(lines) => lines
                .poll_recv(context)
                .map(|line| line.map(|bytes| Ok(Frame::data(bytes)))),
        }
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Self::Full(full) => full.is_end_stream(),
            Self::Lines(_) => false,
        }
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Full(full) => full.size_hint(),
            Self::Lines(_) => SizeHint::default(),
        }
    }
}
