//! Reads YAML text into the tree.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::options::{DuplicateKeyPolicy, NonFiniteFloatPolicy};
use serde_saphyr::{Location, Spanned};

use super::error::{InputError, clipped, nearest};
use super::node::{Node, NodeValue};
use super::source::Source;
use crate::file::read_bounded;
use crate::output_file::folder_of;

/// The largest file that is parsed; pipelines and scenes are written by hand and much smaller.
const MAX_BYTES: u64 = 4 << 20;

/// The largest number of files in a folder that are compared with a missing name.
const MAX_COMPARED_FILES: usize = 1000;

/// A document and its file.
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
    /// When it cannot be read, is not a regular file, is larger than 4 MiB, is not UTF-8, or is not one YAML document
    /// without duplicate keys.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::from_text(path, &Self::text(path)?)
    }

    /// Reads the text of a document.
    ///
    /// # Errors
    /// When the file cannot be read, or is not text.
    pub fn text(path: &Path) -> Result<String, InputError> {
        let fail = |what: String| InputError::new(format!("cannot read {}: {what}", path.display()));
        let bytes = read_bounded(path, MAX_BYTES).map_err(|e| {
            let similar = (e.kind() == ErrorKind::NotFound).then(|| similar_file(path)).flatten();
            match similar {
                Some(other) => fail(e.to_string()).help(format!("did you mean {}?", other.display())),
                None => fail(e.to_string()),
            }
        })?;
        String::from_utf8(bytes).map_err(|e| fail(format!("not UTF-8 text ({e})")))
    }

    /// Reads a text as if it were the file `path`.
    ///
    /// # Errors
    /// As for [`Document::load`].
    pub fn from_text(path: &Path, text: &str) -> Result<Self, InputError> {
        Ok(Self {
            root: Node::parse(&path.display().to_string(), text.to_owned())?,
            path: path.to_owned(),
        })
    }

    /// The path of the file as given.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Returns the YAML file in the same folder whose name is most similar to a missing one; if the folder is missing, the
/// file in the most similar folder beside it that has one.
fn similar_file(path: &Path) -> Option<PathBuf> {
    let folder = folder_of(path);
    let is_yaml = |name: &str| name.ends_with(".yaml") || name.ends_with(".yml");
    if folder.is_dir() {
        return similar_entry(path, |name, _| is_yaml(name));
    }
    let other = similar_entry(folder, |_, path| path.is_dir())?.join(path.file_name()?);
    match other.is_file() {
        true => Some(other),
        false => similar_entry(&other, |name, _| is_yaml(name)),
    }
}

/// Returns the entry beside a missing one whose name is most similar, of those that `is_candidate` accepts by name and
/// path.
fn similar_entry(path: &Path, is_candidate: impl Fn(&str, &Path) -> bool) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder_of(path)).ok()?.take(MAX_COMPARED_FILES);
    let names = entries.filter_map(|entry| {
        let entry = entry.ok()?;
        let name = entry.file_name().into_string().ok()?;
        is_candidate(&name, &entry.path()).then_some(name)
    });
    let names: Vec<String> = names.collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let name = nearest(path.file_name()?.to_str()?, &names)?;
    Some(path.with_file_name(name))
}

impl Node {
    /// Parses one YAML document.
    pub(super) fn parse(name: &str, text: String) -> Result<Self, InputError> {
        let source = Arc::new(Source::new(clipped(name.to_owned()), text));
        let options = serde_saphyr::options! {
            duplicate_keys: DuplicateKeyPolicy::Error,
            // As in YAML 1.2: a key `y` or a stage `on` is not a boolean.
            strict_booleans: true,
            // A number that no double holds is refused where it is read, with the range that is allowed there.
            non_finite_float_policy: NonFiniteFloatPolicy::PassThrough,
        };
        let parsed: Spanned<Raw> = serde_saphyr::from_str_with_options(&source.text, options).map_err(|error| {
            let plain = error.without_snippet();
            let at = plain.location().map_or(0, |l| offset(&source.text, &l));
            let length = source.text[at..].chars().next().map_or(0, char::len_utf8);
            InputError::at(
                &source,
                (at, length),
                format!("{name} is not valid YAML: {}", parser_message(plain)),
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

/// Returns the message of the parser without its advice to programmers and without the position, which is shown
/// separately.
fn parser_message(error: &serde_saphyr::Error) -> String {
    let message = error
        .to_string()
        .replace(", set DuplicateKeyPolicy in Options if acceptable", "");
    let position = error
        .location()
        .map(|l| format!(" at line {}, column {}", l.line(), l.column()));
    match position.and_then(|position| message.strip_suffix(&position).map(str::to_owned)) {
        Some(without) => without,
        None => message,
    }
}

/// Returns the byte offset of a location. Syntax errors have line and column only, counted from 1 in characters.
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
        // Numbers remain text, since a double would not be exact.
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
    // The parser marks only the first character of a collection. Underline it up to the end of its first line.
    length = length.max(last_end(&value).saturating_sub(start));
    if let Some(line) = source.text.get(start..start + length).and_then(|t| t.find('\n')) {
        length = line;
    }
    Node {
        value,
        span: (start, length),
        source: source.clone(),
        removed_keys: &[],
    }
}

/// Returns the end of the last item of a collection.
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
