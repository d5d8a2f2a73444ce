//! An HDF5 file that is read in this process or in a child process.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::elements::{Element, Elements};
use super::error::{Failure, HdfError};
use super::limits::{CALL, ROW, SLICE, TEXTS};
use super::message::{DatasetInfo, Form, Request, Response};
use super::open::OpenFile;
use super::pool::{self, Key};
use super::respond;
use super::session::{Received, has_reader};
use super::tree::Tree;

/// A file that can be read.
pub struct HdfFile {
    path: PathBuf,
    access: Access,
}

enum Access {
    InProcess(Box<OpenFile>),
    ChildProcess(Key),
}

impl HdfFile {
    /// Opens a trusted file, whose checksum has been verified, in this process.
    ///
    /// # Errors
    /// If the library cannot open it.
    pub fn open_trusted(path: &Path) -> Result<Self, HdfError> {
        let open = OpenFile::open(path).map_err(|failure| HdfError::failed(path, failure))?;
        Ok(Self {
            path: path.to_owned(),
            access: Access::InProcess(Box::new(open)),
        })
    }

    /// Opens an untrusted file in its own child process.
    ///
    /// # Errors
    /// If it cannot be opened, or the process crashes or does not finish.
    pub fn open_untrusted(path: &Path) -> Result<Self, HdfError> {
        let file = Self::keyed(path, Key::File(path.to_owned()));
        match file.request(Request::Open)? {
            Received::Plain(Response::Opened) => Ok(file),
            _ => Err(file.invalid_response()),
        }
    }

    /// Opens a file of a store in a child process that is shared by all of them: a checksum does not show who wrote a
    /// file. If the program has not set that process, opens it in this one.
    ///
    /// # Errors
    /// If the library cannot open it.
    pub fn open_of_store(path: &Path) -> Result<Self, HdfError> {
        match has_reader() {
            true => Ok(Self::keyed(path, Key::Stores)),
            false => Self::open_trusted(path),
        }
    }

    fn keyed(path: &Path, key: Key) -> Self {
        Self {
            path: path.to_owned(),
            access: Access::ChildProcess(key),
        }
    }

    /// Returns the paths of the datasets, at most 1000.
    ///
    /// # Errors
    /// If the file cannot be read, or has only links that lead to other files or nowhere.
    pub fn names(&self) -> Result<Vec<String>, HdfError> {
        self.plain(Request::Names, |response| match response {
            Response::Names(names) => Some(names),
            _ => None,
        })
    }

    /// Returns type and shape of a dataset, if it exists.
    ///
    /// # Errors
    /// If it is behind a link, or cannot be read.
    pub fn find(&self, dataset: &str) -> Result<Option<DatasetInfo>, HdfError> {
        self.plain(Request::Find(dataset.to_owned()), |response| match response {
            Response::Dataset(found) => Some(found),
            _ => None,
        })
    }

    /// Reads everything except elements.
    ///
    /// # Errors
    /// If the file does not have the format that this program writes.
    pub fn tree(&self) -> Result<Tree, HdfError> {
        self.plain(Request::Tree, |response| match response {
            Response::Tree(tree) => Some(*tree),
            _ => None,
        })
    }

    /// Returns a text attribute of the file; `None` if it does not exist or is not a text.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn attribute(&self, name: &str) -> Result<Option<String>, HdfError> {
        self.plain(Request::Attribute(name.to_owned()), |response| match response {
            Response::Attribute(text) => Some(text),
            _ => None,
        })
    }

    /// Returns the unit of a dataset; `None` if it has none, or it is not a text.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn units(&self, dataset: &str) -> Result<Option<String>, HdfError> {
        self.plain(Request::Units(dataset.to_owned()), |response| match response {
            Response::Attribute(text) => Some(text),
            _ => None,
        })
    }

    /// Reads all elements of a dataset, which must have a type of artifacts.
    ///
    /// # Errors
    /// If there is no such dataset, they are of another kind, or they are not in the file.
    pub fn elements(&self, dataset: &str) -> Result<Elements, HdfError> {
        let found = self.existing(dataset)?;
        let rows = found.shape.first().copied().unwrap_or(1);
        self.read(dataset, &found, 0..rows, Form::Own, u64::MAX)
    }

    /// Reads rows of a dataset, which must have a type of artifacts.
    ///
    /// # Errors
    /// As [`HdfFile::elements`], or when it has no such rows.
    pub fn rows(&self, dataset: &str, rows: Range<usize>) -> Result<Elements, HdfError> {
        let found = self.existing(dataset)?;
        self.read(dataset, &found, rows.start as u64..rows.end as u64, Form::Own, u64::MAX)
    }

    /// Reads rows of numbers of any type; at most 256 MiB from an untrusted file.
    ///
    /// # Errors
    /// If there is no such dataset, it does not hold numbers, or the rows cannot be read.
    pub fn numbers(&self, dataset: &str, rows: Range<usize>) -> Result<Vec<f64>, HdfError> {
        let found = self.existing(dataset)?;
        let rows = rows.start as u64..rows.end as u64;
        match self.read(dataset, &found, rows, Form::Numbers, CALL)? {
            Elements::F64(numbers) => Ok(numbers),
            _ => Err(self.invalid_response()),
        }
    }

    /// Reads a dataset of texts; at most 256 MiB from an untrusted file.
    ///
    /// # Errors
    /// If there is no such dataset, or it does not hold texts.
    pub fn texts(&self, dataset: &str) -> Result<Vec<String>, HdfError> {
        self.all_texts(dataset, Form::Texts)
    }

    /// Reads a dataset of texts, or of integers as decimal texts.
    ///
    /// # Errors
    /// If there is no such dataset, or it holds neither.
    pub fn words(&self, dataset: &str) -> Result<Vec<String>, HdfError> {
        self.all_texts(dataset, Form::Words)
    }

    fn all_texts(&self, dataset: &str, form: Form) -> Result<Vec<String>, HdfError> {
        let found = self.existing(dataset)?;
        let rows = found.shape.first().copied().unwrap_or(1);
        match self.read(dataset, &found, 0..rows, form, CALL)? {
            Elements::Text(texts) => Ok(texts),
            _ => Err(self.invalid_response()),
        }
    }

    fn existing(&self, dataset: &str) -> Result<DatasetInfo, HdfError> {
        let found = self.find(dataset)?;
        found.ok_or_else(|| HdfError::refused(&self.path, format!("the file has no dataset {dataset:?}")))
    }

    fn read(
        &self,
        dataset: &str,
        found: &DatasetInfo,
        rows: Range<u64>,
        form: Form,
        most: u64,
    ) -> Result<Elements, HdfError> {
        match &self.access {
            Access::InProcess(open) => open.rows(dataset, rows, form).map_err(self.failed()),
            Access::ChildProcess(_) => self.slices(dataset, found, rows, form, most),
        }
    }

    /// Requests some rows at a time, so that responses are limited whatever the file claims.
    fn slices(
        &self,
        dataset: &str,
        found: &DatasetInfo,
        rows: Range<u64>,
        form: Form,
        most: u64,
    ) -> Result<Elements, HdfError> {
        let refused = |why: String| HdfError::refused(&self.path, format!("`{dataset}`: {why}"));
        let width = width(found, form);
        let row = found.shape.iter().skip(1).fold(width, |row, &n| row.saturating_mul(n));
        if row > ROW {
            return Err(refused(format!("a row is larger than {} MiB", ROW >> 20)));
        }
        let count = rows.end.saturating_sub(rows.start);
        let length = std::fs::metadata(&self.path).map_or(0, |found| found.len());
        // Elements of artifacts are not compressed.
        let most = if form == Form::Own { most.min(length) } else { most };
        if row.saturating_mul(count) > most {
            return Err(refused(format!("{count} rows are larger than {} MiB", most >> 20)));
        }
        let step = match (form, &found.element) {
            (Form::Texts | Form::Words, _) | (_, Element::Text(_)) => TEXTS,
            (Form::Own | Form::Numbers, _) => (SLICE / row.max(1)).max(1),
        };
        let mut all: Option<Elements> = None;
        let (mut next, mut texts) = (rows.start, 0);
        while next < rows.end || all.is_none() {
            let slice = next..rows.end.min(next.saturating_add(step));
            next = slice.end;
            let part = self.slice(dataset, slice, (form, row / width))?;
            if let Elements::Text(part) = &part {
                texts += part.iter().map(|text| text.len() as u64).sum::<u64>();
            }
            if texts > CALL {
                return Err(refused(format!("its texts are larger than {} MiB", CALL >> 20)));
            }
            let appended = match &mut all {
                Some(all) => all.append(part),
                None => all.replace(part).is_none(),
            };
            if !appended {
                return Err(self.invalid_response());
            }
        }
        all.ok_or_else(|| self.invalid_response())
    }

    /// Requests rows, and checks the number of elements.
    fn slice(&self, dataset: &str, rows: Range<u64>, (form, per_row): (Form, u64)) -> Result<Elements, HdfError> {
        let count = (rows.end - rows.start) * per_row;
        let request = Request::Rows {
            dataset: dataset.to_owned(),
            rows,
            form,
        };
        match self.request(request)? {
            Received::Elements(elements) if elements.len() as u64 == count => Ok(elements),
            _ => Err(self.invalid_response()),
        }
    }

    /// Reads something without elements.
    fn plain<T>(&self, request: Request, pick: impl FnOnce(Response) -> Option<T>) -> Result<T, HdfError> {
        let response = match &self.access {
            Access::InProcess(open) => respond::reply(open, &request).map_err(self.failed())?.0,
            Access::ChildProcess(_) => match self.request(request)? {
                Received::Plain(response) => response,
                Received::Elements(_) => return Err(self.invalid_response()),
            },
        };
        pick(response).ok_or_else(|| self.invalid_response())
    }

    fn request(&self, request: Request) -> Result<Received, HdfError> {
        match &self.access {
            Access::ChildProcess(key) => pool::send(key, &self.path, request),
            Access::InProcess(_) => Err(self.invalid_response()),
        }
    }

    fn failed(&self) -> impl Fn(Failure) -> HdfError {
        |failure| HdfError::failed(&self.path, failure)
    }

    fn invalid_response(&self) -> HdfError {
        HdfError::Broken {
            path: self.path.clone(),
            how: "its response is invalid".to_owned(),
        }
    }
}

/// Returns the number of bytes of an element in a response.
fn width(found: &DatasetInfo, form: Form) -> u64 {
    match (form, &found.element) {
        (Form::Numbers, _) => 8,
        (Form::Own, Element::U8) => 1,
        (Form::Own, Element::U32 | Element::F32) => 4,
        (Form::Own, Element::Text(width)) => (*width).max(1),
        (Form::Own, _) => 8,
        // A text in memory without its bytes.
        (Form::Texts | Form::Words, _) => 32,
    }
}
