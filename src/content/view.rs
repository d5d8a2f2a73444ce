//! Views of an artifact, which read single arrays and attributes: all fields together may exceed the memory.

use std::marker::PhantomData;
use std::ops::Range;

use super::attribute::Attribute;
use super::declared::{Declared, check};
use super::part::{At, Part};
use deaflow_store::{Artifact, StoreError};

/// A struct of arrays with a view that reads them one by one.
pub trait Group: Part {
    /// The view.
    type View<'a>;

    /// Returns the view of a group of an artifact without checking it.
    fn view(artifact: &Artifact, at: At) -> Self::View<'_>;
}

impl<G: Group> Group for Option<G> {
    type View<'a> = G::View<'a>;

    fn view(artifact: &Artifact, at: At) -> Self::View<'_> {
        G::view(artifact, at)
    }
}

/// Returns the view of an artifact and checks the axes of its arrays.
///
/// # Errors
/// If an array has other axes than declared, or two differ in length along a shared axis.
pub fn open<G: Group>(artifact: &Artifact) -> Result<G::View<'_>, StoreError> {
    let mut declared: Vec<Declared> = Vec::new();
    G::declare(&At::default(), &mut declared);
    check(artifact, &declared)?;
    Ok(G::view(artifact, At::default()))
}

/// Returns the files of an artifact: its chunks, or itself if it has none.
///
/// # Errors
/// If a chunk is missing or damaged.
pub fn files(artifact: &Artifact) -> Result<&[Artifact], StoreError> {
    Ok(match artifact.is_manifest() {
        true => artifact.chunks()?,
        false => std::slice::from_ref(artifact),
    })
}

/// An array of an artifact.
pub struct Stored<'a, P> {
    artifact: &'a Artifact,
    at: At,
    part: PhantomData<P>,
}

impl<'a, P: Part> Stored<'a, P> {
    /// The array at this path.
    #[must_use]
    pub fn new(artifact: &'a Artifact, at: At) -> Self {
        Self {
            artifact,
            at,
            part: PhantomData,
        }
    }

    /// Reads its elements; for a manifest, those of all chunks.
    ///
    /// # Errors
    /// If it is missing or invalid, or a file is damaged.
    pub fn read(&self) -> Result<P, StoreError> {
        P::get(&self.at, self.artifact)
    }

    /// Reads its elements, if the artifact has it.
    ///
    /// # Errors
    /// As [`Stored::read`].
    pub fn read_if_there(&self) -> Result<Option<P>, StoreError> {
        Option::get(&self.at, self.artifact)
    }

    /// Whether the artifact has it.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    pub fn is_there(&self) -> Result<bool, StoreError> {
        P::is_in(&self.at, self.artifact)
    }

    /// Returns its path in the file.
    #[must_use]
    pub fn path(&self) -> &str {
        self.at.path()
    }

    /// Returns its length along the first axis, without reading elements.
    ///
    /// # Errors
    /// If it is missing, or a chunk is missing or damaged.
    pub fn rows(&self) -> Result<usize, StoreError> {
        let shape = &self.artifact.content(self.path())?.shape;
        Ok(shape.first().copied().unwrap_or_default())
    }

    /// Reads the numbers of some of its rows from an artifact that is not a manifest.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn numbers(&self, rows: Range<usize>) -> Result<Vec<f64>, StoreError> {
        self.artifact.rows()?.numbers(self.path(), rows)
    }
}

/// An attribute of an artifact.
pub struct StoredAttribute<'a, A> {
    artifact: &'a Artifact,
    name: &'static str,
    value: PhantomData<A>,
}

impl<'a, A: Attribute> StoredAttribute<'a, A> {
    /// The attribute of this name.
    #[must_use]
    pub fn new(artifact: &'a Artifact, name: &'static str) -> Self {
        Self {
            artifact,
            name,
            value: PhantomData,
        }
    }

    /// Reads its value, from the first chunk if a manifest does not have it.
    ///
    /// # Errors
    /// If it is required but missing, or invalid.
    pub fn read(&self) -> Result<A, StoreError> {
        let text = self.text()?;
        A::from_text(self.name, text.as_deref()).map_err(|fault| fault.of(self.artifact.digest()))
    }

    /// Reads its text; `None` if it is missing.
    ///
    /// # Errors
    /// If the first chunk is missing or damaged.
    pub fn text(&self) -> Result<Option<String>, StoreError> {
        if let Some(own) = self.artifact.attribute(self.name) {
            return Ok(Some(own.to_owned()));
        }
        let first = self.artifact.first_chunk()?;
        Ok(first.and_then(|chunk| chunk.attribute(self.name).map(str::to_owned)))
    }
}
