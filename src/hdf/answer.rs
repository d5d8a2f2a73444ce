//! Answers to what is asked of a file.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::elements::{self, Elements};
use super::error::Failure;
use super::message::{Answer, Question, Reply, Request};
use super::open::OpenFile;

/// The file that was asked for last, which stays open for what is asked next.
#[derive(Default)]
pub(super) struct Answers {
    last: Option<(PathBuf, Stamp, OpenFile)>,
}

/// By which a file is known to be the same.
#[derive(PartialEq, Eq)]
struct Stamp(u64, u64, u64, Option<SystemTime>);

impl Answers {
    /// The answer to a question, and the bytes of elements in it.
    pub fn answer(&mut self, question: &Question) -> (Reply, Vec<u8>) {
        match self
            .open(Path::new(&question.path))
            .and_then(|file| reply(file, &question.request))
        {
            Ok((answer, bytes)) => (Ok(answer), bytes),
            Err(failure) => (Err(failure), Vec::new()),
        }
    }

    fn open(&mut self, path: &Path) -> Result<&OpenFile, Failure> {
        let stamp = stamp(path).map_err(|e| Failure::Unopened(e.to_string()))?;
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

fn reply(file: &OpenFile, request: &Request) -> Result<(Answer, Vec<u8>), Failure> {
    let plain = match request {
        Request::Open => Answer::Opened,
        Request::Names => Answer::Names(file.names()?),
        Request::Find(dataset) => Answer::Found(file.find(dataset)?),
        Request::Tree => Answer::Tree(Box::new(file.tree()?)),
        Request::Attribute(name) => Answer::Attribute(file.attribute(name)?),
        Request::Units(dataset) => Answer::Attribute(file.units(dataset)?),
        Request::Rows { dataset, rows, form } => {
            let elements = file.rows(dataset, rows.clone(), *form)?;
            return Ok(match (elements::to_bytes(&elements), elements) {
                (Some((element, bytes)), _) => (Answer::Numbers(element, bytes.len() as u64), bytes),
                (None, Elements::Text(texts)) => (Answer::Texts(texts), Vec::new()),
                (None, other) => return Err(Failure::Refused(format!("{} elements", other.len()))),
            });
        }
    };
    Ok((plain, Vec::new()))
}
