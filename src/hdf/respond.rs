//! Responds to requests in the child process.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::elements::{self, Elements};
use super::error::Failure;
use super::message::{FileRequest, Reply, Request, Response};
use super::open::OpenFile;

/// Responds to requests; the last file stays open for the next request.
#[derive(Default)]
pub(super) struct Responder {
    last: Option<(PathBuf, Stamp, OpenFile)>,
}

/// Device, inode, size and time, which identify an unchanged file.
#[derive(PartialEq, Eq)]
struct Stamp(u64, u64, u64, Option<SystemTime>);

impl Responder {
    /// Returns the reply to a request, and the bytes of its elements.
    pub fn respond(&mut self, request: &FileRequest) -> (Reply, Vec<u8>) {
        match self
            .open(Path::new(&request.path))
            .and_then(|file| reply(file, &request.request))
        {
            Ok((response, bytes)) => (Ok(response), bytes),
            Err(failure) => {
                // What the library has read of it may be wrong.
                self.last = None;
                (Err(failure), Vec::new())
            }
        }
    }

    fn open(&mut self, path: &Path) -> Result<&OpenFile, Failure> {
        let stamp = stamp(path).map_err(|e| Failure::unopened(&e))?;
        let same = |(known, then, _): &(PathBuf, Stamp, OpenFile)| known == path && *then == stamp;
        let file = match self.last.take().filter(same) {
            Some((_, _, file)) => file,
            None => OpenFile::open(path)?,
        };
        Ok(&self.last.insert((path.to_owned(), stamp, file)).2)
    }
}

fn stamp(path: &Path) -> std::io::Result<Stamp> {
    use std::os::unix::fs::MetadataExt;
    let found = std::fs::metadata(path)?;
    Ok(Stamp(found.dev(), found.ino(), found.len(), found.modified().ok()))
}

/// Returns the response of a file, and the bytes of its elements.
pub(super) fn reply(file: &OpenFile, request: &Request) -> Result<(Response, Vec<u8>), Failure> {
    let plain = match request {
        Request::Open => Response::Opened,
        Request::Names => Response::Names(file.names()?),
        Request::Find(dataset) => Response::Dataset(file.find(dataset)?),
        Request::Tree => Response::Tree(Box::new(file.tree()?)),
        Request::Attribute(name) => Response::Attribute(file.attribute(name)?),
        Request::Units(dataset) => Response::Attribute(file.units(dataset)?),
        Request::Rows { dataset, rows, form } => {
            let elements = file.rows(dataset, rows.clone(), *form)?;
            return Ok(match (elements::to_bytes(&elements), elements) {
                (Some((element, bytes)), _) => (Response::Numbers(element, bytes.len() as u64), bytes),
                (None, Elements::Text(texts)) => (Response::Texts(texts), Vec::new()),
                (None, other) => return Err(Failure::Refused(format!("{} elements", other.len()))),
            });
        }
    };
    Ok((plain, Vec::new()))
}
