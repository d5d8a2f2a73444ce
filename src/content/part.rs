//! The parts of a declared struct: an array, several arrays, or a group of them.

use super::declared::Declared;
use super::element::{Element, Grid, Packed, Row, Value};
use super::error::{ElementError, Fault};
use super::writer::Writer;
use deaflow_pattern::Raster;
use deaflow_store::{Artifact, StoreError};

/// The path of an array or a group, and its declaration.
#[derive(Clone, Debug, Default)]
pub struct At {
    path: String,
    units: &'static str,
    axes: Vec<String>,
    description: String,
    renamed: &'static [(&'static str, &'static str)],
    optional: bool,
}

impl At {
    /// Returns an array in this group by path, unit, axes and description.
    #[must_use]
    pub fn array(&self, path: &str, units: &'static str, axes: &[&str], description: &str) -> Self {
        let axis = |axis: &&str| {
            let renamed = self.renamed.iter().find(|(from, _)| from == axis);
            renamed.map_or(*axis, |(_, to)| to).to_owned()
        };
        Self {
            path: self.inner_path(path),
            units,
            axes: axes.iter().map(axis).collect(),
            description: description.trim().to_owned(),
            renamed: &[],
            optional: self.optional,
        }
    }

    /// Returns a group in this group. Its axes may be renamed.
    #[must_use]
    pub fn group(&self, path: &str, renamed: &'static [(&'static str, &'static str)]) -> Self {
        Self {
            path: self.inner_path(path),
            renamed: if renamed.is_empty() { self.renamed } else { renamed },
            optional: self.optional,
            ..Self::default()
        }
    }

    fn inner_path(&self, path: &str) -> String {
        match (self.path.as_str(), path) {
            ("", path) => path.to_owned(),
            (group, "") => group.to_owned(),
            (group, path) => format!("{group}/{path}"),
        }
    }

    fn optional(&self) -> Self {
        Self {
            optional: true,
            ..self.clone()
        }
    }

    /// Returns the path in the file.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    fn declared<R: Row>(&self) -> Declared {
        Declared {
            path: self.path.clone(),
            element: R::Value::TYPE,
            units: self.units,
            axes: self.axes.clone(),
            extents: R::EXTENTS,
            description: self.description.clone(),
            optional: self.optional,
        }
    }
}

/// One or more arrays that are declared, written and read by the same declaration.
pub trait Part: Sized {
    /// Adds its declarations.
    fn declare(at: &At, declared: &mut Vec<Declared>);

    /// Writes it.
    fn put(self, at: &At, writer: &mut Writer);

    /// Reads it.
    ///
    /// # Errors
    /// If it is missing or invalid.
    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError>;

    /// Whether an artifact has any of it.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    fn is_in(at: &At, artifact: &Artifact) -> Result<bool, StoreError> {
        let mut declared = Vec::new();
        Self::declare(at, &mut declared);
        let contents = artifact.contents()?;
        let has = |array: &Declared| contents.iter().any(|content| content.path == array.path);
        Ok(declared.iter().any(has))
    }
}

/// Reads the values of all rows and their raster.
fn values<R: Row>(at: &At, artifact: &Artifact) -> Result<(Vec<R::Value>, Raster), StoreError> {
    let shape = &artifact.content(&at.path)?.shape;
    let Some(raster) = raster_of::<R>(shape) else {
        let fault = Fault::Shape {
            path: at.path.clone(),
            found: shape.clone(),
            expected: at.declared::<R>().shape(),
        };
        return Err(fault.of(artifact.digest()));
    };
    Ok((R::Value::read(artifact, &at.path)?, raster))
}

/// Returns the raster of the rows of an array, or any raster if its rows have none. `None` if the shape does not fit.
fn raster_of<R: Row>(shape: &[usize]) -> Option<Raster> {
    let axes = shape.strip_suffix(R::EXTENTS)?;
    match (R::GRID, axes) {
        (Grid::None, _) => Some(Raster::PAPER),
        (grid, [.., rows, columns]) => grid.raster([*rows, *columns]),
        _ => None,
    }
}

fn element_fault(at: &At, artifact: &Artifact, source: ElementError) -> StoreError {
    let path = at.path.clone();
    Fault::Element { path, source }.of(artifact.digest())
}

impl<T: Element> Part for Vec<T> {
    fn declare(at: &At, declared: &mut Vec<Declared>) {
        declared.push(at.declared::<T>());
    }

    fn put(self, at: &At, writer: &mut Writer) {
        if let Some(raster) = T::raster(&self) {
            writer.set_raster(raster);
        }
        writer.array(at.declared::<T>(), T::Value::into_data(T::pack(self)));
    }

    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError> {
        let (values, raster) = values::<T>(at, artifact)?;
        T::unpack(values, raster).map_err(|e| element_fault(at, artifact, e))
    }
}

impl<R: Row> Part for Packed<R> {
    fn declare(at: &At, declared: &mut Vec<Declared>) {
        declared.push(at.declared::<R>());
    }

    fn put(self, at: &At, writer: &mut Writer) {
        writer.array(at.declared::<R>(), R::Value::into_data(self.0));
    }

    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError> {
        Ok(Self(values::<R>(at, artifact)?.0))
    }
}

/// An array of a fixed number of values.
impl<V: Value + Copy, const N: usize> Part for [V; N] {
    fn declare(at: &At, declared: &mut Vec<Declared>) {
        declared.push(at.declared::<Self>());
    }

    fn put(self, at: &At, writer: &mut Writer) {
        writer.array(at.declared::<Self>(), V::into_data(self.to_vec()));
    }

    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError> {
        let (values, _) = values::<Self>(at, artifact)?;
        let found = vec![values.len()];
        Self::try_from(values).map_err(|_| {
            let (path, expected) = (at.path.clone(), at.declared::<Self>().shape());
            Fault::Shape { path, found, expected }.of(artifact.digest())
        })
    }
}

impl<P: Part> Part for Option<P> {
    fn declare(at: &At, declared: &mut Vec<Declared>) {
        P::declare(&at.optional(), declared);
    }

    fn put(self, at: &At, writer: &mut Writer) {
        if let Some(part) = self {
            part.put(&at.optional(), writer);
        }
    }

    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError> {
        P::is_in(at, artifact)?.then(|| P::get(at, artifact)).transpose()
    }
}

/// Texts of any length, stored as their concatenated bytes and the length of each. An array of texts has 64 bytes per
/// text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LongTexts(pub Vec<String>);

/// Returns the declarations of the bytes and the lengths of long texts.
fn parts_of_texts(at: &At) -> [Declared; 2] {
    let bytes = Declared {
        path: format!("{}/text", at.path),
        axes: vec![format!("{}_byte", at.path.replace('/', "_"))],
        description: format!("{} UTF-8, one text after another.", at.description),
        units: "",
        ..at.declared::<u8>()
    };
    let lengths = Declared {
        path: format!("{}/length", at.path),
        description: "Bytes of each text.".to_owned(),
        units: "1",
        ..at.declared::<u64>()
    };
    [bytes, lengths]
}

impl Part for LongTexts {
    fn declare(at: &At, declared: &mut Vec<Declared>) {
        declared.extend(parts_of_texts(at));
    }

    fn put(self, at: &At, writer: &mut Writer) {
        let [bytes, lengths] = parts_of_texts(at);
        let each = self.0.iter().map(|text| text.len() as u64).collect();
        writer.array(bytes, u8::into_data(self.0.concat().into_bytes()));
        writer.array(lengths, u64::into_data(each));
    }

    fn get(at: &At, artifact: &Artifact) -> Result<Self, StoreError> {
        Ok(Self(artifact.long_texts(&at.path)?))
    }
}
