//! The content of an artifact, independent of files: named arrays with units and descriptions, attributes, and parts.

use std::collections::BTreeMap;

use super::element_type::ElementType;
use deaflow_base::{ArtifactId, DigestWriter};
pub use deaflow_hdf::Elements as Data;
use deaflow_hdf::LONG;

/// Width of a text element in bytes. It is fixed so that virtual datasets can show chunks as one array.
pub const TEXT_WIDTH: usize = 64;

/// Attributes that are texts for people. They are not part of the digest, so their wording may change.
pub const WORDING: [&str; 1] = ["warnings"];

/// Names that the store itself uses in files.
const RESERVED: [&str; 3] = ["parts", "provenance", LONG];

/// The attribute with the kind of the action.
pub const KIND: &str = "kind";

/// An array of an artifact.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Unit of the elements ("mm", "V", "1" for pure numbers, "" if a unit makes no sense).
    pub units: String,
    /// One sentence that describes it.
    pub description: String,
    /// Names of the axes, slowest first ("sample", "y", "x"); may be empty.
    pub axes: Vec<String>,
    /// Extents, slowest first.
    pub shape: Vec<usize>,
    /// The elements.
    pub data: Data,
}

/// The logical content of an artifact. It has either datasets or parts; the latter is a manifest, whose datasets are
/// those of its parts, concatenated along the first axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Kind of the action that makes it; empty if it is not made by an action.
    pub kind: String,
    /// Content attributes: texts that belong to the content (a scene, the names of columns), never times or hosts.
    /// Those named in `WORDING` are written but are not part of the digest.
    pub attributes: BTreeMap<String, String>,
    /// Datasets by path ("patterns", "unstable/patterns").
    pub datasets: BTreeMap<String, Dataset>,
    /// Digests of the chunks of a manifest, in order.
    pub parts: Vec<ArtifactId>,
}

/// Content that is not valid for an artifact.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ObjectError {
    /// The shape does not match the number of elements.
    #[error("dataset `{path}`: shape {shape:?} does not match {found} elements")]
    Shape {
        /// Path of the dataset.
        path: String,
        /// Its shape.
        shape: Vec<usize>,
        /// The number of elements.
        found: usize,
    },
    /// A text is too long or contains NUL.
    #[error("dataset `{path}`: the text {text:?} is longer than {TEXT_WIDTH} bytes or contains NUL")]
    Text {
        /// Path of the dataset.
        path: String,
        /// The text.
        text: String,
    },
    /// The names of the axes are not valid.
    #[error(
        "dataset `{path}` has {extents} axes, but the axis names are {axes:?}: give each axis a different name that \
         is not empty or reserved"
    )]
    Axes {
        /// Path of the dataset.
        path: String,
        /// The names.
        axes: Vec<String>,
        /// The number of axes.
        extents: usize,
    },
    /// An element is NaN or infinite.
    #[error("dataset `{path}`: element {at} is not a finite number")]
    NotFinite {
        /// Path of the dataset.
        path: String,
        /// Index of the element.
        at: usize,
    },
    /// A name is not valid.
    #[error("{name:?} is not a valid name for {what}: {reason}")]
    Name {
        /// The name.
        name: String,
        /// What is named: a dataset or an attribute.
        what: &'static str,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The object has both datasets and parts.
    #[error("an object has both datasets and parts; only one of them is allowed")]
    Mixed,
}

impl Dataset {
    /// Creates a dataset whose axes have no names.
    #[must_use]
    pub fn new(units: &str, description: &str, shape: &[usize], data: Data) -> Self {
        Self {
            units: units.to_owned(),
            description: description.to_owned(),
            axes: Vec::new(),
            shape: shape.to_vec(),
            data,
        }
    }

    /// Sets the names of the axes, slowest first.
    #[must_use]
    pub fn with_axes(mut self, axes: &[&str]) -> Self {
        self.axes = axes.iter().map(|&axis| axis.to_owned()).collect();
        self
    }

    fn validate_axes(&self, path: &str) -> Result<(), ObjectError> {
        let wrong = |(at, axis): (usize, &String)| {
            let reserved = axis.is_empty() || RESERVED.contains(&axis.as_str());
            reserved || axis.contains(['/', '\0']) || self.axes[..at].contains(axis)
        };
        let count = self.axes.len();
        if count > 0 && (count != self.shape.len() || self.axes.iter().enumerate().any(wrong)) {
            return Err(ObjectError::Axes {
                path: path.to_owned(),
                axes: self.axes.clone(),
                extents: self.shape.len(),
            });
        }
        Ok(())
    }

    fn validate(&self, path: &str) -> Result<(), ObjectError> {
        self.validate_axes(path)?;
        let found = self.data.len();
        if self.shape.iter().product::<usize>() != found {
            return Err(ObjectError::Shape {
                path: path.to_owned(),
                shape: self.shape.clone(),
                found,
            });
        }
        let not_finite = match &self.data {
            Data::F32(v) => v.iter().position(|x| !x.is_finite()),
            Data::F64(v) => v.iter().position(|x| !x.is_finite()),
            _ => None,
        };
        if let Some(at) = not_finite {
            return Err(ObjectError::NotFinite {
                path: path.to_owned(),
                at,
            });
        }
        if let Data::Text(texts) = &self.data
            && let Some(text) = texts.iter().find(|t| t.len() > TEXT_WIDTH || t.contains('\0'))
        {
            return Err(ObjectError::Text {
                path: path.to_owned(),
                text: text.clone(),
            });
        }
        Ok(())
    }
}

impl Object {
    /// Creates a manifest of parts.
    #[must_use]
    pub fn manifest(attributes: BTreeMap<String, String>, parts: Vec<ArtifactId>) -> Self {
        Self {
            attributes,
            parts,
            ..Self::default()
        }
    }

    /// Sets the kind of the action that makes it.
    #[must_use]
    pub fn of_kind(self, kind: &str) -> Self {
        Self {
            kind: kind.to_owned(),
            ..self
        }
    }

    /// Adds a dataset.
    #[must_use]
    pub fn with(mut self, path: &str, dataset: Dataset) -> Self {
        self.datasets.insert(path.to_owned(), dataset);
        self
    }

    /// Adds texts of any length: their concatenated bytes as `PATH/text`, and the length of each as `PATH/length`.
    #[must_use]
    pub fn with_long_texts<'a>(self, path: &str, description: &str, texts: impl IntoIterator<Item = &'a str>) -> Self {
        let (mut bytes, mut lengths) = (Vec::new(), Vec::new());
        for text in texts {
            bytes.extend_from_slice(text.as_bytes());
            lengths.push(text.len() as u64);
        }
        let shapes = [bytes.len(), lengths.len()];
        let text = format!("{description}; UTF-8, one after another");
        self.with(
            &format!("{path}/text"),
            Dataset::new("", &text, &shapes[..1], Data::U8(bytes)),
        )
        .with(
            &format!("{path}/length"),
            Dataset::new("1", "bytes of each text", &shapes[1..], Data::U64(lengths)),
        )
    }

    /// Adds an attribute.
    #[must_use]
    pub fn attribute(mut self, name: &str, value: impl Into<String>) -> Self {
        self.attributes.insert(name.to_owned(), value.into());
        self
    }

    /// Checks shapes, texts and numbers.
    ///
    /// # Errors
    /// If the content is not valid for an artifact.
    pub fn validate(&self) -> Result<(), ObjectError> {
        if !self.parts.is_empty() && !self.datasets.is_empty() {
            return Err(ObjectError::Mixed);
        }
        validate_attribute("kind of an action", &self.kind)?;
        for (name, value) in &self.attributes {
            validate_attribute(name, value)?;
        }
        for (path, dataset) in &self.datasets {
            self.validate_path(path)?;
            dataset.validate(path)?;
        }
        Ok(())
    }

    fn validate_path(&self, path: &str) -> Result<(), ObjectError> {
        let refuse = |reason| {
            Err(ObjectError::Name {
                name: path.to_owned(),
                what: "a dataset",
                reason,
            })
        };
        let mut steps = path.split('/');
        if steps.clone().any(|step| step.is_empty() || step == "." || step == "..") || path.contains('\0') {
            return refuse("allowed are names joined by '/'");
        }
        if steps.next().is_some_and(|step| RESERVED.contains(&step)) {
            return refuse("the store reserves it");
        }
        let inside = format!("{path}/");
        if self.datasets.keys().any(|other| other.starts_with(&inside)) {
            return refuse("it is also a group of other datasets");
        }
        Ok(())
    }

    /// Returns the identity: the digest of kind, attributes, paths, types, shapes, units and little-endian bytes.
    /// Descriptions, names of axes and the attributes in `WORDING` are not part of it.
    ///
    /// # Errors
    /// If the content is not valid for an artifact.
    pub fn digest(&self) -> Result<ArtifactId, ObjectError> {
        self.validate()?;
        let mut writer = DigestWriter::new();
        let attributes = || {
            self.attributes
                .iter()
                .filter(|(name, _)| !WORDING.contains(&name.as_str()))
        };
        writer.text("deaflow object 2").text(&self.kind);
        writer.number(attributes().count() as u64);
        for (name, value) in attributes() {
            writer.text(name).text(value);
        }
        writer.number(self.datasets.len() as u64);
        for (path, dataset) in &self.datasets {
            writer
                .text(path)
                .text(&dataset.units)
                .text(ElementType::of(&dataset.data).name());
            writer.number(dataset.shape.len() as u64);
            dataset.shape.iter().for_each(|&n| {
                writer.number(n as u64);
            });
            add_elements(&mut writer, &dataset.data);
        }
        writer.number(self.parts.len() as u64);
        for part in &self.parts {
            writer.bytes(part.as_bytes());
        }
        Ok(writer.finish().into())
    }
}

fn validate_attribute(name: &str, value: &str) -> Result<(), ObjectError> {
    let refuse = |reason| {
        Err(ObjectError::Name {
            name: name.to_owned(),
            what: "an attribute",
            reason,
        })
    };
    if name == KIND {
        return refuse("the store reserves it");
    }
    if name.is_empty() || name.contains('\0') || value.contains('\0') {
        return refuse("the name is empty, or the name or the value contains NUL");
    }
    Ok(())
}

/// Bytes of elements that are copied at a time.
const PIECE: usize = 1 << 20;

/// Adds the little-endian bytes of all elements to a digest.
fn add_elements(writer: &mut DigestWriter, data: &Data) {
    match data {
        Data::U8(v) => {
            writer.bytes(v);
        }
        Data::U32(v) => add(writer, v, |x| x.to_le_bytes()),
        Data::U64(v) => add(writer, v, |x| x.to_le_bytes()),
        // Adding zero turns −0 into 0: they are equal, so they must have the same digest.
        Data::F32(v) => add(writer, v, |x| (x + 0.0).to_le_bytes()),
        Data::F64(v) => add(writer, v, |x| (x + 0.0).to_le_bytes()),
        Data::Text(v) => add(writer, v, |t| {
            let mut cell = [0; TEXT_WIDTH];
            cell[..t.len()].copy_from_slice(t.as_bytes());
            cell
        }),
    }
}

fn add<T, const N: usize>(writer: &mut DigestWriter, elements: &[T], bytes: impl Fn(&T) -> [u8; N]) {
    let pieces = elements.chunks(PIECE / N);
    let pieces = pieces.map(|piece| piece.iter().flat_map(&bytes).collect::<Vec<u8>>());
    writer.pieces(N * elements.len(), pieces);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(units: &str, value: f64) -> Object {
        Object::default().with("a/b", Dataset::new(units, "d", &[1, 2], Data::F64(vec![value, 1.0])))
    }

    #[test]
    fn the_digest_sees_all_content_and_nothing_else() {
        let base = sample("mm", 0.0).digest().unwrap();
        assert_eq!(base, sample("mm", -0.0).digest().unwrap());
        assert_ne!(base, sample("m", 0.0).digest().unwrap());
        assert_ne!(base, sample("mm", 1e-300).digest().unwrap());
        assert_ne!(base, sample("mm", 0.0).attribute("x", "y").digest().unwrap());
        assert_ne!(base, sample("mm", 0.0).of_kind("solve").digest().unwrap());
    }

    #[test]
    fn to_mend_the_english_changes_no_digest() {
        let base = sample("mm", 0.0).digest().unwrap();
        let mut described = sample("mm", 0.0).attribute("warnings", "strain stiffening is off");
        let dataset = described.datasets.get_mut("a/b").unwrap();
        dataset.description = "displacement of the corners".to_owned();
        dataset.axes = vec!["sample".to_owned(), "x".to_owned()];
        assert_eq!(base, described.digest().unwrap());
    }

    #[test]
    fn what_cannot_be_stored_has_no_digest() {
        assert!(matches!(
            sample("mm", f64::NAN).digest(),
            Err(ObjectError::NotFinite { at: 0, .. })
        ));
        let bad = Object::default().with("x", Dataset::new("", "", &[3], Data::U8(vec![1])));
        assert!(matches!(bad.digest(), Err(ObjectError::Shape { .. })));
        let long = Object::default().with("x", Dataset::new("", "", &[1], Data::Text(vec!["é".repeat(33)])));
        assert!(matches!(long.digest(), Err(ObjectError::Text { .. })));
        for axes in [&["x"][..], &["x", "x"], &["x", ""], &["x", "a/b"], &["x", "parts"]] {
            let data = Dataset::new("", "", &[1, 2], Data::U8(vec![1, 2]));
            let named = Object::default().with("x", data.with_axes(axes));
            assert!(matches!(named.digest(), Err(ObjectError::Axes { .. })), "{axes:?}");
        }
    }
}
