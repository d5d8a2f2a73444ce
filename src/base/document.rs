//! A YAML document that remembers where every word stands.
//!
//! Scenes and pipelines are read through this tree and not through derived deserialisation: a refusal must name
//! file, line and field, put a caret under the word, say what was found and what is allowed, and the same must hold for
//! values given on the command line with `--set`.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Diagnostic, NamedSource, SourceSpan};
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::{Spanned, options::DuplicateKeyPolicy};

use super::quantity::{Decimal, Dimension, Quantity};

/// Pipelines and scenes are written by hand; a larger file is a mistake, and is refused before it is parsed.
const MAX_BYTES: u64 = 4 << 20;

/// A named text: a file, or one `--set` argument.
#[derive(Debug)]
pub struct Source {
    name: String,
    text: String,
}

/// Bad input: where it stands, what was found, what is allowed.
#[derive(Debug, Diagnostic, thiserror::Error)]
#[error("{message}")]
pub struct InputError {
    message: String,
    #[source_code]
    source_code: Option<NamedSource<String>>,
    #[label("{label}")]
    span: Option<SourceSpan>,
    label: String,
    #[help]
    help: Option<String>,
}

impl InputError {
    /// A refusal that has no place in a document (a missing file, an empty argument).
    #[must_use]
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            source_code: None,
            span: None,
            label: String::new(),
            help: None,
        }
    }

    /// Adds advice: what is allowed.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    fn at(source: &Source, span: (usize, usize), message: String, label: String) -> Self {
        Self {
            message,
            source_code: Some(NamedSource::new(&source.name, source.text.clone())),
            span: Some(SourceSpan::new(span.0.into(), span.1)),
            label,
            help: None,
        }
    }
}

/// What a node holds.
#[derive(Clone, Debug)]
pub enum NodeValue {
    /// Nothing.
    Null,
    /// A truth value.
    Bool(bool),
    /// A plain scalar that reads as a number, as it was written.
    Number(String),
    /// Any other scalar.
    Text(String),
    /// A sequence.
    List(Vec<Node>),
    /// A mapping in the order of the file.
    Map(Vec<(Node, Node)>),
}

/// A value with its place.
#[derive(Clone, Debug)]
pub struct Node {
    value: NodeValue,
    span: (usize, usize),
    source: Arc<Source>,
}

/// A mapping whose keys have been checked against those that are allowed.
pub struct Map<'a> {
    node: &'a Node,
    entries: &'a [(Node, Node)],
}

/// A document and the file that it came from.
#[derive(Clone, Debug)]
pub struct Document {
    /// The outermost value.
    pub root: Node,
    path: PathBuf,
}

/// One `--set path.to.field=VALUE`.
#[derive(Clone, Debug)]
pub struct Override {
    path: Vec<String>,
    value: Node,
}

impl Document {
    /// Reads a YAML file.
    ///
    /// # Errors
    /// When the file cannot be read, is larger than 4 MiB, is not UTF-8 or not one YAML document without duplicate keys.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        let shown = path.display();
        let fail = |what: String| InputError::new(format!("cannot read {shown}: {what}"));
        let size = std::fs::metadata(path).map_err(|e| fail(e.to_string()))?.len();
        if size > MAX_BYTES {
            return Err(fail(format!(
                "{size} bytes; a pipeline or scene has at most {MAX_BYTES}"
            )));
        }
        let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
        let text = String::from_utf8(bytes).map_err(|e| fail(format!("not UTF-8 text ({e})")))?;
        Ok(Self {
            root: Node::parse(&shown.to_string(), text)?,
            path: path.to_owned(),
        })
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

impl Override {
    /// Reads `path.to.field=VALUE`, the value in YAML.
    ///
    /// # Errors
    /// When there is no `=`, an empty step in the path, or the value is not YAML.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let form = "write it as --set stages.NAME.param=VALUE or --set scene.drive.voltage=\"5 kV\"";
        let Some((path, value)) = text.split_once('=') else {
            return Err(InputError::new(format!("--set {text}: no '=' in it")).help(form));
        };
        let path: Vec<String> = path.split('.').map(|step| step.trim().to_owned()).collect();
        if path.iter().any(String::is_empty) || path.len() < 2 {
            return Err(InputError::new(format!("--set {text}: the path is incomplete")).help(form));
        }
        Ok(Self {
            value: Node::parse(&format!("--set {}", path.join(".")), value.to_owned())?,
            path,
        })
    }

    /// The path of the field.
    #[must_use]
    pub fn path(&self) -> &[String] {
        &self.path
    }

    /// Puts the value into the tree. Every step but the last must exist.
    ///
    /// # Errors
    /// When a step does not exist or is not a mapping.
    pub fn apply(&self, root: &mut Node) -> Result<(), InputError> {
        let mut at = root;
        let (last, steps) = self.path.split_last().expect("a path has at least two steps");
        for (depth, step) in steps.iter().enumerate() {
            let known = at.keys();
            let Some(child) = at.child_mut(step) else {
                let place = self.path[..depth].join(".");
                let place = if place.is_empty() {
                    "the pipeline".to_owned()
                } else {
                    format!("`{place}`")
                };
                return Err(self
                    .value
                    .error(format!("--set {}: no `{step}` in {place}", self.path.join(".")))
                    .help(suggestion(step, &known.iter().map(String::as_str).collect::<Vec<_>>())));
            };
            at = child;
        }
        let NodeValue::Map(entries) = &mut at.value else {
            return Err(self.value.error(format!(
                "--set {}: `{}` is not a mapping",
                self.path.join("."),
                steps.join(".")
            )));
        };
        match entries.iter_mut().find(|(key, _)| key.is_text(last)) {
            Some((_, value)) => *value = self.value.clone(),
            None => entries.push((self.value.with_value(NodeValue::Text(last.clone())), self.value.clone())),
        }
        Ok(())
    }
}

impl Node {
    /// Parses one YAML document.
    fn parse(name: &str, text: String) -> Result<Self, InputError> {
        let source = Arc::new(Source {
            name: name.to_owned(),
            text,
        });
        let options = serde_saphyr::options! {
            duplicate_keys: DuplicateKeyPolicy::Error,
        };
        let parsed: Spanned<Raw> = serde_saphyr::from_str_with_options(&source.text, options).map_err(|error| {
            let plain = error.without_snippet();
            let at = plain.location().and_then(|l| l.span().byte_offset()).unwrap_or(0) as usize;
            let length = usize::from(at < source.text.len());
            InputError::at(
                &source,
                (at.min(source.text.len()), length),
                format!("{name} is not valid YAML: {plain}"),
                "here".into(),
            )
        })?;
        Ok(build(parsed, &source))
    }

    /// What the node holds.
    #[must_use]
    pub fn value(&self) -> &NodeValue {
        &self.value
    }

    /// A refusal of this node.
    #[must_use]
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.error_labelled(message, "here")
    }

    /// A refusal of this node with a word of one's own at the caret.
    #[must_use]
    pub fn error_labelled(&self, message: impl Into<String>, label: impl Into<String>) -> InputError {
        InputError::at(&self.source, self.span, message.into(), label.into())
    }

    /// `file:line` of this node.
    #[must_use]
    pub fn place(&self) -> String {
        let line = self.source.text[..self.span.0.min(self.source.text.len())]
            .matches('\n')
            .count()
            + 1;
        format!("{}:{line}", self.source.name)
    }

    fn with_value(&self, value: NodeValue) -> Self {
        Self {
            value,
            span: self.span,
            source: self.source.clone(),
        }
    }

    fn keys(&self) -> Vec<String> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().map(|(k, _)| k.describe_plain()).collect(),
            _ => Vec::new(),
        }
    }

    fn child_mut(&mut self, key: &str) -> Option<&mut Node> {
        match &mut self.value {
            NodeValue::Map(entries) => entries.iter_mut().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Replaces the value under `key`, for a reference that has been resolved (a scene given by its file).
    pub fn replace(&mut self, key: &str, node: Node) {
        if let Some(child) = self.child_mut(key) {
            *child = node;
        }
    }

    /// The value under `key` without checking the other keys.
    #[must_use]
    pub fn peek(&self, key: &str) -> Option<&Node> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            _ => None,
        }
    }

    fn is_text(&self, text: &str) -> bool {
        matches!(&self.value, NodeValue::Text(t) | NodeValue::Number(t) if t == text)
    }

    fn describe_plain(&self) -> String {
        match &self.value {
            NodeValue::Null => "null".into(),
            NodeValue::Bool(b) => b.to_string(),
            NodeValue::Number(t) | NodeValue::Text(t) => t.clone(),
            NodeValue::List(_) => "a list".into(),
            NodeValue::Map(_) => "a mapping".into(),
        }
    }

    /// What was found, for a message.
    #[must_use]
    pub fn found(&self) -> String {
        match &self.value {
            NodeValue::Null => "nothing".into(),
            NodeValue::Text(t) => format!("{t:?}"),
            _ => self.describe_plain(),
        }
    }

    fn wanted(&self, field: &str, wanted: impl fmt::Display) -> InputError {
        self.error(format!("`{field}` must be {wanted}, found {}", self.found()))
    }

    /// The node as a mapping with no other than the allowed keys.
    ///
    /// # Errors
    /// When it is no mapping, or has a key that is not allowed; the nearest allowed spelling is named.
    pub fn fields(&self, what: &str, allowed: &[&str]) -> Result<Map<'_>, InputError> {
        let entries = self.entries(what)?;
        for (key, _) in entries {
            let name = key.describe_plain();
            if !allowed.contains(&name.as_str()) {
                return Err(key
                    .error_labelled(format!("unknown key `{name}` in {what}"), "not known here")
                    .help(suggestion(&name, allowed)));
            }
        }
        Ok(Map { node: self, entries })
    }

    /// The entries of a mapping whose keys are free.
    ///
    /// # Errors
    /// When it is no mapping.
    pub fn entries(&self, what: &str) -> Result<&[(Node, Node)], InputError> {
        match &self.value {
            NodeValue::Map(entries) => Ok(entries),
            _ => Err(self.wanted(what, "a mapping")),
        }
    }

    /// The node as a list.
    ///
    /// # Errors
    /// When it is none.
    pub fn list(&self, field: &str) -> Result<&[Node], InputError> {
        match &self.value {
            NodeValue::List(items) => Ok(items),
            _ => Err(self.wanted(field, "a list")),
        }
    }

    /// The node as a text; a number is its own text.
    ///
    /// # Errors
    /// When it is neither.
    pub fn text(&self, field: &str) -> Result<&str, InputError> {
        match &self.value {
            NodeValue::Text(t) | NodeValue::Number(t) => Ok(t),
            _ => Err(self.wanted(field, "a text")),
        }
    }

    /// The node as one of some words.
    ///
    /// # Errors
    /// When it is another; the nearest is named.
    pub fn word<'w>(&self, field: &str, allowed: &[&'w str]) -> Result<&'w str, InputError> {
        let text = self.text(field)?;
        allowed.iter().find(|w| **w == text).copied().ok_or_else(|| {
            self.error(format!("`{field}` cannot be {text:?}"))
                .help(suggestion(text, allowed))
        })
    }

    /// The node as a truth value.
    ///
    /// # Errors
    /// When it is none.
    pub fn bool(&self, field: &str) -> Result<bool, InputError> {
        match self.value {
            NodeValue::Bool(value) => Ok(value),
            _ => Err(self.wanted(field, "true or false")),
        }
    }

    /// The node as a whole number within bounds, both included.
    ///
    /// # Errors
    /// When it is none, or outside.
    pub fn whole(&self, field: &str, low: u64, high: u64) -> Result<u64, InputError> {
        let range = if high >= i64::MAX as u64 {
            format!("a whole number from {low}")
        } else {
            format!("a whole number from {low} to {high}")
        };
        let NodeValue::Number(text) = &self.value else {
            return Err(self.wanted(field, range));
        };
        text.parse::<Decimal>()
            .ok()
            .and_then(Decimal::to_u64)
            .filter(|n| (low..=high).contains(n))
            .ok_or_else(|| self.wanted(field, range))
    }

    /// The node as a quantity: text with a unit, or a bare number in the base unit of the dimension.
    ///
    /// # Errors
    /// When the number or the unit is not understood.
    pub fn quantity(&self, field: &str, dimension: Dimension) -> Result<Quantity, InputError> {
        let (NodeValue::Number(text) | NodeValue::Text(text)) = &self.value else {
            return Err(self.wanted(field, format!("a {dimension}")));
        };
        Quantity::parse(text, dimension).map_err(|error| self.error(format!("`{field}`: {error}")))
    }

    /// The node as a quantity within bounds given in the base unit, both included.
    ///
    /// # Errors
    /// When it is none, or outside.
    pub fn quantity_in(&self, field: &str, dimension: Dimension, low: f64, high: f64) -> Result<Quantity, InputError> {
        let quantity = self.quantity(field, dimension)?;
        if (low..=high).contains(&quantity.value()) {
            return Ok(quantity);
        }
        let unit = dimension.base_unit();
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(" {unit}")
        };
        Err(self
            .error(format!("`{field}` is out of range: found {quantity}"))
            .help(format!("allowed: {low}{unit} to {high}{unit}")))
    }
}

impl<'a> Map<'a> {
    /// The value of a key that must be there.
    ///
    /// # Errors
    /// When it is missing.
    pub fn required(&self, what: &str, key: &str) -> Result<&'a Node, InputError> {
        self.optional(key).ok_or_else(|| {
            self.node
                .error_labelled(format!("`{key}` is missing in {what}"), format!("no `{key}` here"))
        })
    }

    /// The value of a key, if it is there.
    #[must_use]
    pub fn optional(&self, key: &str) -> Option<&'a Node> {
        self.entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v)
    }
}

/// The nearest of some allowed words, if any is near.
#[must_use]
pub fn nearest<'w>(word: &str, allowed: &[&'w str]) -> Option<&'w str> {
    allowed
        .iter()
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), *candidate))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, candidate)| *distance <= 1 + candidate.chars().count().max(word.chars().count()) / 3)
        .map(|(_, candidate)| candidate)
}

fn suggestion(word: &str, allowed: &[&str]) -> String {
    let list = if allowed.is_empty() {
        "nothing".to_owned()
    } else {
        allowed.join(", ")
    };
    match nearest(word, allowed) {
        Some(near) => format!("did you mean `{near}`? allowed: {list}"),
        None => format!("allowed: {list}"),
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
    // A caret under a whole block would underline half the file: collections are marked by their first line.
    if let Some(line) = source.text.get(start..start + length).and_then(|t| t.find('\n')) {
        length = line;
    }
    Node {
        value,
        span: (start, length),
        source: source.clone(),
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Node {
        Document::from_text(Path::new("t.yaml"), text).unwrap().root
    }

    fn underlined(error: &InputError) -> String {
        let span = error.span.unwrap();
        let text = error.source_code.as_ref().unwrap().inner();
        text[span.offset()..span.offset() + span.len()].to_owned()
    }

    #[test]
    fn an_unknown_key_is_underlined_and_the_nearest_is_named() {
        let node = parse("a: { colour: red, size: 3 }\n");
        let error = node.peek("a").unwrap().fields("`a`", &["color", "size"]).err().unwrap();
        assert_eq!(underlined(&error), "colour");
        assert!(error.help.as_ref().unwrap().contains("did you mean `color`?"));
    }

    #[test]
    fn numbers_keep_their_decimal_text_and_values_their_place() {
        let node = parse("v: 5.250\nw: '7'\nx: [1, 2.5 mm]\n");
        let map = node.fields("it", &["v", "w", "x"]).unwrap();
        let v = map.required("it", "v").unwrap();
        assert_eq!(v.quantity("v", Dimension::Voltage).unwrap().base().to_string(), "5.25");
        assert_eq!(v.place(), "t.yaml:1");
        assert!(
            map.required("it", "w").unwrap().whole("w", 0, 9).is_err(),
            "a quoted 7 is a text"
        );
        let error = map.required("it", "x").unwrap().list("x").unwrap()[1]
            .quantity("x", Dimension::Voltage)
            .unwrap_err();
        assert_eq!(underlined(&error), "2.5 mm");
    }

    #[test]
    fn overrides_replace_and_add_and_point_at_themselves() {
        let mut node = parse("stages:\n  small: { count: 300 }\n");
        Override::parse("stages.small.count=400")
            .unwrap()
            .apply(&mut node)
            .unwrap();
        Override::parse("stages.small.seed=-1")
            .unwrap()
            .apply(&mut node)
            .unwrap();
        let small = node.peek("stages").unwrap().peek("small").unwrap();
        assert_eq!(small.peek("count").unwrap().whole("count", 1, 1000).unwrap(), 400);
        let error = small.peek("seed").unwrap().whole("seed", 0, u64::MAX).unwrap_err();
        assert_eq!(underlined(&error), "-1");
        assert_eq!(error.source_code.unwrap().name(), "--set stages.small.seed");
        let missing = Override::parse("stages.smal.count=4")
            .unwrap()
            .apply(&mut node)
            .unwrap_err();
        assert!(missing.help.unwrap().contains("small"));
    }

    #[test]
    fn broken_and_hostile_documents_are_refused_with_their_place() {
        for text in ["a: [1, 2", "a: 1\na: 2\n", "a: &x [*x]\n", "\u{7}", "- a\nb: c", ""] {
            let outcome = Document::from_text(Path::new("t.yaml"), text);
            if let Ok(document) = outcome {
                assert!(document.root.fields("it", &["a"]).is_err(), "{text:?}");
            }
        }
        let bomb = "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\nd: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\nf: &f [*e,*e,*e,*e,*e,*e,*e,*e,*e]\ng: [*f,*f,*f,*f,*f,*f,*f,*f,*f]\n";
        assert!(Document::from_text(Path::new("t.yaml"), bomb).is_err());
    }
}
