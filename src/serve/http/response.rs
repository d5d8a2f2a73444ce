//! What a request is answered with.

use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};

use http_body_util::Full;
use hyper::body::{Body, Bytes, Frame, SizeHint};
use serde_json::Value;
use tokio::sync::mpsc;

use deaflow_base::printable_json;

/// An answer.
#[derive(Debug)]
pub enum Answer {
    /// A document.
    Document(Value),
    /// Bytes of a type, and what a file of them would be called where they are to become one.
    Bytes {
        /// The media type.
        media: &'static str,
        /// The bytes.
        bytes: Vec<u8>,
        /// The name of a file.
        file: Option<String>,
    },
    /// A page of this program's own making, without scripts: what it draws has its colours within.
    Page(String),
    /// Documents, a line for each, as they come.
    Lines(mpsc::Receiver<Bytes>),
    /// The page that shows everything else, and whether who asked has named the token and is to be known from now on.
    Entrance {
        /// Whether the token was in the address.
        admitted: bool,
    },
}

impl Answer {
    /// Bytes that a page draws.
    pub fn frame(bytes: Vec<u8>) -> Self {
        Self::Bytes {
            media: "application/octet-stream",
            bytes,
            file: None,
        }
    }
}

impl From<Value> for Answer {
    fn from(document: Value) -> Self {
        Self::Document(document)
    }
}

/// A document as it is sent: on one line, and without what changes the direction of text.
#[must_use]
pub fn line_of(document: &Value) -> Bytes {
    let text = document.to_string();
    Bytes::from(format!("{}\n", printable_json(&text)))
}

/// Where lines are sent to.
#[derive(Clone, Debug)]
pub struct Lines(mpsc::Sender<Bytes>);

/// Lines that are sent and not yet read, before who sends them has to wait.
const AHEAD: usize = 32;

impl Lines {
    /// A pair of ends.
    #[must_use]
    pub fn new() -> (Self, Answer) {
        let (sender, receiver) = mpsc::channel(AHEAD);
        (Self(sender), Answer::Lines(receiver))
    }

    /// Sends a document; false where nobody listens any more. It waits for a slow reader, and must not be called where others are served.
    #[must_use]
    pub fn send(&self, document: &Value) -> bool {
        self.0.blocking_send(line_of(document)).is_ok()
    }

    /// Whether nobody listens any more.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
}

/// A body that is sent.
pub enum Outgoing {
    /// All of it.
    Whole(Full<Bytes>),
    /// As it comes.
    Lines(mpsc::Receiver<Bytes>),
}

impl Body for Outgoing {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Self::Error>>> {
        match self.get_mut() {
            Self::Whole(full) => Pin::new(full).poll_frame(context),
            Self::Lines(lines) => lines
                .poll_recv(context)
                .map(|line| line.map(|bytes| Ok(Frame::data(bytes)))),
        }
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Self::Whole(full) => full.is_end_stream(),
            Self::Lines(_) => false,
        }
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Whole(full) => full.size_hint(),
            Self::Lines(_) => SizeHint::default(),
        }
    }
}
