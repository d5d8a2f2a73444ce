//! Messages between this process and the one that reads a file.
//!
//! A message has a length of four bytes, that many bytes in the encoding of records, which limits all lengths in them,
//! and, for a response, the bytes of elements that it announces. Lengths are checked before memory is allocated.

use std::io::{Error, ErrorKind, Read, Result, Write};
use std::ops::Range;

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::elements::Element;
use super::error::Failure;
use super::limits::ROW;
use super::tree::Tree;
use deaflow_base::{decode, encode};

/// Maximum length of a message without elements, bytes.
const MOST: u32 = 16 << 20;

/// What a process sends when it runs, before any file is opened: if it ends earlier, no file is the cause.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Started;

/// A request for a file.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct FileRequest {
    /// The file.
    pub path: String,
    /// The request.
    pub request: Request,
}

/// A request.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Request {
    /// Opens the file.
    Open,
    /// The paths of the datasets.
    Names,
    /// Type and shape of a dataset.
    Find(String),
    /// Everything except the elements.
    Tree,
    /// A text attribute of the file.
    Attribute(String),
    /// The text attribute `units` of a dataset.
    Units(String),
    /// Rows of a dataset.
    Rows {
        dataset: String,
        rows: Range<u64>,
        form: Form,
    },
}

/// The form in which elements are returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Form {
    /// Their own type, one of those of artifacts.
    Own,
    /// Numbers of any type, as double precision.
    Numbers,
    /// Texts of any type.
    Texts,
    /// Texts of any type, or integers as decimal texts.
    Words,
}

/// A response.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Response {
    Opened,
    Names(Vec<String>),
    Dataset(Option<DatasetInfo>),
    Tree(Box<Tree>),
    Attribute(Option<String>),
    Texts(Vec<String>),
    /// Numbers of this type; the number of bytes, which follow.
    Numbers(Element, u64),
}

/// A response or a failure.
pub(super) type Reply = std::result::Result<Response, Failure>;

/// A dataset without its elements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DatasetInfo {
    /// Extents, slowest first; for a dataset of MATLAB those of the array in MATLAB.
    pub shape: Vec<u64>,
    /// Type of the elements.
    pub element: Element,
    /// Factor and offset of its values, which netCDF stores packed; [`super::HdfFile::numbers`] applies them.
    pub packing: Option<[f64; 2]>,
    /// Whether MATLAB wrote it, which reverses the axes in its files. [`super::HdfFile::numbers`] reverses them again.
    pub is_reversed: bool,
}

/// Sends a message and its bytes.
pub(super) fn send<T: Serialize>(to: &mut impl Write, message: &T, bytes: &[u8]) -> Result<()> {
    let encoded = encode(message).map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
    let length = u32::try_from(encoded.len()).map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
    let mut whole = length.to_le_bytes().to_vec();
    whole.extend(encoded);
    to.write_all(&whole)?;
    to.write_all(bytes)
}

/// Receives a message; `None` if the other side has closed the connection.
pub(super) fn receive<T: DeserializeOwned>(from: &mut impl Read) -> Result<Option<T>> {
    let mut length = [0; 4];
    match from.read_exact(&mut length) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        read => read?,
    }
    let length = u32::from_le_bytes(length);
    if length > MOST {
        return Err(Error::new(
            ErrorKind::InvalidData,
            format!("a message has {length} bytes, allowed are {MOST}"),
        ));
    }
    let encoded = bytes(from, u64::from(length))?;
    let message = decode(&encoded).map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
    Ok(Some(message))
}

/// Receives a number of bytes.
pub(super) fn bytes(from: &mut impl Read, count: u64) -> Result<Vec<u8>> {
    if count > ROW {
        return Err(Error::new(
            ErrorKind::InvalidData,
            format!("{count} bytes of elements, allowed are {ROW}"),
        ));
    }
    let mut received = Vec::new();
    from.take(count).read_to_end(&mut received)?;
    match received.len() as u64 == count {
        true => Ok(received),
        false => Err(ErrorKind::UnexpectedEof.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_arrive_and_too_long_ones_are_rejected() {
        let mut sent = Vec::new();
        send(&mut sent, &Request::Attribute("a/b".into()), b"more").unwrap();
        let mut rest = &sent[..];
        let arrived: Request = receive(&mut rest).unwrap().unwrap();
        assert!(matches!(arrived, Request::Attribute(name) if name == "a/b"));
        assert_eq!(bytes(&mut rest, 4).unwrap(), b"more");
        assert!(receive::<Request>(&mut rest).unwrap().is_none(), "the end");
        for claimed in [MOST + 1, u32::MAX, 100] {
            let mut claim = claimed.to_le_bytes().to_vec();
            claim.extend([0; 50]);
            assert!(receive::<Request>(&mut &claim[..]).is_err());
        }
        assert!(bytes(&mut &[0; 8][..], ROW + 1).is_err() && bytes(&mut &[0; 8][..], 9).is_err());
    }
}
