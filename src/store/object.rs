//! What an artifact says, apart from any file: named arrays with units and descriptions, attributes, and parts.

use std::collections::BTreeMap;

use super::element_type::ElementType;
use deaflow_base::{ArtifactId, DigestWriter};
pub use deaflow_hdf::Elements as Data;
use deaflow_hdf::LONG;

/// Bytes of one text element. Texts have a fixed width in files, so that virtual datasets can show chunks as one array.
pub const TEXT_WIDTH: usize = 64;

/// Attributes that only tell people what the content means: to mend their English changes no digest.
pub const WORDING: [&str; 1] = ["warnings"];

/// What the store itself keeps in files.
const OWN: [&str; 3] = ["parts", "provenance", LONG];

/// The attribute of a file that holds the kind.
pub const KIND: &str = "kind";

/// A named array as it stands in an artifact.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Unit of the elements ("mm", "V", "1" for pure numbers, "" where a unit makes no sense).
    pub units: String,
    /// One sentence for whoever opens the file.
    pub description: String,
    /// Names of the axes, slowest first ("sample", "y", "x"); empty where they have none.
    pub axes: Vec<String>,
    /// Extents, slowest first.
    pub shape: Vec<usize>,
    /// The elements.
    pub data: Data,
}

/// The logical content of an artifact. Either it has datasets, or it is a manifest of parts whose datasets, laid end to
/// end along the first axis, are its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Kind of the action that makes it; empty where none does.
    pub kind: String,
    /// Content attributes: texts that belong to the content (a scene, the names of columns), never times or hosts. Those that
    /// `WORDING` names stand in the file and are no part of the identity.
    pub attributes: BTreeMap<String, String>,
    /// Arrays by path ("patterns", "unstable/patterns").
    pub datasets: BTreeMap<String, Dataset>,
    /// Digests of the chunks of a manifest, in order.
    pub parts: Vec<ArtifactId>,
}

/// Content that cannot be an artifact.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ObjectError {
    /// The shape does not match the number of elements.
    #[error("dataset `{path}`: shape {shape:?} does not hold {found} elements")]
    Shape {
        /// Path of the dataset.
        path: String,
        /// Its shape.
        shape: Vec<usize>,
        /// How many elements there are.
        found: usize,
    },
    /// A text that does not fit.
    #[error("dataset `{path}`: the text {text:?} is longer than {TEXT_WIDTH} bytes or contains NUL")]
    Text {
        /// Path of the dataset.
        path: String,
        /// The text.
        text: String,
    },
    /// Axes that cannot be named so.
    #[error(
        "dataset `{path}` has {extents} axes, and the names {axes:?} do not fit: one for each, all different, none empty or the store's own"
    )]
    Axes {
        /// Path of the dataset.
        path: String,
        /// The names.
        axes: Vec<String>,
        /// How many axes there are.
        extents: usize,
    },
    /// A NaN or infinity: artifacts hold numbers only.
    #[error("dataset `{path}`: element {at} is not a finite number")]
    NotFinite {
        /// Path of the dataset.
        path: String,
        /// Position of the element.
        at: usize,
    },
    /// A name that cannot stand in a file.
    #[error("{name:?} cannot name {what}: {reason}")]
    Name {
        /// The name.
        name: String,
        /// A dataset or an attribute.
        what: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// An object with both datasets and parts.
    #[error("an object is either arrays or a manifest of parts, not both")]
    Mixed,
}

impl Dataset {
    /// A dataset from its parts, its axes without names.
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

    /// The same with names for its axes, slowest first.
    #[must_use]
    pub fn with_axes(mut self, axes: &[&str]) -> Self {
        self.axes = axes.iter().map(|&axis| axis.to_owned()).collect();
        self
    }

    fn validate_axes(&self, path: &str) -> Result<(), ObjectError> {
        let wrong = |(at, axis): (usize, &String)| {
            let reserved = axis.is_empty() || OWN.contains(&axis.as_str());
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
    /// A manifest of parts.
    #[must_use]
    pub fn manifest(attributes: BTreeMap<String, String>, parts: Vec<ArtifactId>) -> Self {
        Self {
            attributes,
            parts,
            ..Self::default()
        }
    }

    /// The same as what an action of this kind makes.
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

    /// Adds texts of any length: their bytes one after another under `PATH/text`, and how many belong to each under
    /// `PATH/length`.
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
    /// When the content cannot be an artifact.
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
            return refuse("it is not a path of names joined by '/'");
        }
        if steps.next().is_some_and(|step| OWN.contains(&step)) {
            return refuse("the store itself uses it");
        }
        let inside = format!("{path}/");
        if self.datasets.keys().any(|other| other.starts_with(&inside)) {
            return refuse("other datasets lie inside it");
        }
        Ok(())
    }

    /// The identity: a digest of kind, attributes, paths, types, shapes, units and little-endian bytes. Descriptions, names of
    /// axes and attributes of `WORDING` are no part of it.
    ///
    /// # Errors
    /// When the content cannot be an artifact.
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
        return refuse("the store itself uses it");
    }
    if name.is_empty() || name.contains('\0') || value.contains('\0') {
        return refuse("it is empty, or it or its value contains NUL");
    }
    Ok(())
}

/// Bytes of elements that are in memory beside them at a time.
const PIECE: usize = 1 << 20;

/// Adds the little-endian bytes of all elements to a digest.
fn add_elements(writer: &mut DigestWriter, data: &Data) {
    match data {
        Data::U8(v) => {
            writer.bytes(v);
        }
        Data::U32(v) => add(writer, v, |x| x.to_le_bytes()),
        Data::U64(v) => add(writer, v, |x| x.to_le_bytes()),
        // Adding zero makes −0 into 0: they are equal, so they must not tell two artifacts apart.
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
        let mut described = sample("mm", 0.0).attribute("warnings", "strain stiffening is neglected");
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
