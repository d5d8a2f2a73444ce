//! From YAML text to the tree.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::{Location, Spanned, options::DuplicateKeyPolicy};

use super::error::{InputError, clipped, nearest};
use super::node::{Node, NodeValue, Source};
use crate::file::read_bounded;

/// Pipelines and scenes are written by hand; a larger file is a mistake, and is refused before it is parsed.
const MAX_BYTES: u64 = 4 << 20;

/// Files in a folder among which one of a like name is looked for.
const MOST_FILES: usize = 1000;

/// A document and the file that it came from.
#[derive(Clone, Debug)]
pub struct Document {
    /// The outermost value.
    pub root: Node,
    path: PathBuf,
}

impl Document {
    /// Reads a YAML file.
    ///
    /// # Errors
    /// When it cannot be read, is no regular file, is larger than 4 MiB, is not UTF-8 or not one YAML document without duplicate keys.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::from_text(path, &Self::text(path)?)
    }

    /// The text of a file that is to be a document.
    ///
    /// # Errors
    /// When it cannot be read, or is no text.
    pub fn text(path: &Path) -> Result<String, InputError> {
        let fail = |what: String| InputError::new(format!("cannot read {}: {what}", path.display()));
        let bytes = read_bounded(path, MAX_BYTES).map_err(|e| {
            let like = (e.kind() == ErrorKind::NotFound).then(|| beside(path)).flatten();
            match like {
                Some(other) => fail(e.to_string()).help(format!("did you mean {}?", other.display())),
                None => fail(e.to_string()),
            }
        })?;
        String::from_utf8(bytes).map_err(|e| fail(format!("not UTF-8 text ({e})")))
    }

    /// A document from a text, as if it had been read from `path`.
    ///
    /// # Errors
    /// As [`Document::load`].
    pub fn from_text(path: &Path, text: &str) -> Result<Self, InputError> {
        Ok(Self {
            root: Node::parse(&path.display().to_string(), text.to_owned())?,
            path: path.to_owned(),
        })
    }

    /// The file, as it was named.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The file beside one that is not there whose name is most like it.
fn beside(path: &Path) -> Option<PathBuf> {
    let folder = path.parent()?;
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let entries = std::fs::read_dir(folder).ok()?.take(MOST_FILES);
    let names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".yaml") || name.ends_with(".yml"))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let name = nearest(path.file_name()?.to_str()?, &names)?;
    Some(path.with_file_name(name))
}

impl Node {
    /// Parses one YAML document.
    pub(super) fn parse(name: &str, text: String) -> Result<Self, InputError> {
        let source = Arc::new(Source {
            name: clipped(name.to_owned()),
            text,
        });
        let options = serde_saphyr::options! {
            duplicate_keys: DuplicateKeyPolicy::Error,
            // As in YAML 1.2: a key `y` or a stage `on` is no truth value.
            strict_booleans: true,
        };
        let parsed: Spanned<Raw> = serde_saphyr::from_str_with_options(&source.text, options).map_err(|error| {
            let plain = error.without_snippet();
            let at = plain.location().map_or(0, |l| offset(&source.text, &l));
            let length = source.text[at..].chars().next().map_or(0, char::len_utf8);
            InputError::at(
                &source,
                (at, length),
                format!("{name} is not valid YAML: {}", said(plain)),
                "here".into(),
            )
        })?;
        Ok(build(parsed, &source))
    }
}

enum Raw {
    Null,
    Bool(bool),
    Number,
    Text(String),
    List(Vec<Spanned<Raw>>),
    Map(Vec<(Spanned<Raw>, Spanned<Raw>)>),
}

/// What the parser says, without its advice to programmers, and without the place, which is shown beside it.
fn said(error: &serde_saphyr::Error) -> String {
    let message = error
        .to_string()
        .replace(", set DuplicateKeyPolicy in Options if acceptable", "");
    let place = error
        .location()
        .map(|l| format!(" at line {}, column {}", l.line(), l.column()));
    match place.and_then(|place| message.strip_suffix(&place).map(str::to_owned)) {
        Some(without) => without,
        None => message,
    }
}

/// Byte offset of a location. Errors of syntax come with line and column only, both counted from 1 in characters.
fn offset(text: &str, location: &Location) -> usize {
    let line = location.line().saturating_sub(1) as usize;
    let before: usize = text.split_inclusive('\n').take(line).map(str::len).sum();
    let column = location.column().saturating_sub(1) as usize;
    let in_line = text[before..].char_indices().map(|(at, _)| at).nth(column);
    in_line.map_or(text.len(), |at| before + at)
}

fn build(spanned: Spanned<Raw>, source: &Arc<Source>) -> Node {
    let end = source.text.len();
    let range = spanned.defined.span();
    let start = (range.byte_offset().unwrap_or(0) as usize).min(end);
    let mut length = (range.byte_len().unwrap_or(0) as usize).min(end - start);
    let value = match spanned.value {
        Raw::Null => NodeValue::Null,
        Raw::Bool(b) => NodeValue::Bool(b),
        // Numbers stay as written: a decimal text is exact, a double is not.
        Raw::Number => NodeValue::Number(source.text.get(start..start + length).unwrap_or("").trim().to_owned()),
        Raw::Text(t) => NodeValue::Text(t),
        Raw::List(items) => NodeValue::List(items.into_iter().map(|item| build(item, source)).collect()),
        Raw::Map(entries) => NodeValue::Map(
            entries
                .into_iter()
                .map(|(k, v)| (build(k, source), build(v, source)))
                .collect(),
        ),
    };
    // The parser marks a collection by its first character. All of it is meant, but a caret under a whole block would
    // underline half the file, so it ends with the first line.
    length = length.max(last_end(&value).saturating_sub(start));
    if let Some(line) = source.text.get(start..start + length).and_then(|t| t.find('\n')) {
        length = line;
    }
    Node {
        value,
        span: (start, length),
        source: source.clone(),
        gone: &[],
    }
}

/// Where the last item of a collection ends.
fn last_end(value: &NodeValue) -> usize {
    let last = match value {
        NodeValue::List(items) => items.last(),
        NodeValue::Map(entries) => entries.last().map(|(_, value)| value),
        _ => None,
    };
    last.map_or(0, |node| node.span.0 + node.span.1)
}

impl<'de> Deserialize<'de> for Raw {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RawVisitor)
    }
}

struct RawVisitor;

impl<'de> Visitor<'de> for RawVisitor {
    type Value = Raw;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a YAML value")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Raw, E> {
        Ok(Raw::Bool(value))
    }

    fn visit_i64<E>(self, _: i64) -> Result<Raw, E> {
        Ok(Raw::Number)
    }

    fn visit_u64<E>(self, _: u64) -> Result<Raw, E> {
        Ok(Raw::Number)
    }

    fn visit_i128<E>(self, _: i128) -> Result<Raw, E> {
        Ok(Raw::Number)
    }

    fn visit_u128<E>(self, _: u128) -> Result<Raw, E> {
        Ok(Raw::Number)
    }

    fn visit_f64<E>(self, _: f64) -> Result<Raw, E> {
        Ok(Raw::Number)
    }

    fn visit_str<E>(self, value: &str) -> Result<Raw, E> {
        Ok(Raw::Text(value.to_owned()))
    }

    fn visit_unit<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_none<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Raw, D::Error> {
        Raw::deserialize(deserializer)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Raw, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Raw::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Raw, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Raw::Map(entries))
    }
}
