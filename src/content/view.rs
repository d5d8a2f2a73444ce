//! Arrays and attributes of an artifact that are read when they are asked for: fields may be larger than memory.

use std::marker::PhantomData;
use std::ops::Range;

use super::attribute::Attribute;
use super::declared::{Declared, check};
use super::part::{At, Part};
use deaflow_store::{Artifact, StoreError};

/// A struct whose fields are arrays, and the view that reads them one by one.
pub trait Group: Part {
    /// The view.
    type View<'a>;

    /// The view of a group of an artifact. Nothing is checked.
    fn view(artifact: &Artifact, at: At) -> Self::View<'_>;
}

impl<G: Group> Group for Option<G> {
    type View<'a> = G::View<'a>;

    fn view(artifact: &Artifact, at: At) -> Self::View<'_> {
        G::view(artifact, at)
    }
}

/// The view of a whole artifact, whose arrays fit the declaration as far as they are there.
///
/// # Errors
/// When an array has other axes than declared, or two differ in length along one.
pub fn open<G: Group>(artifact: &Artifact) -> Result<G::View<'_>, StoreError> {
    let mut declared: Vec<Declared> = Vec::new();
    G::declare(&At::default(), &mut declared);
    check(artifact, &declared)?;
    Ok(G::view(artifact, At::default()))
}

/// The parts of an artifact that are files of their own: its chunks, or itself where it has none.
///
/// # Errors
/// When a chunk is missing or damaged.
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
    /// The array that stands there.
    #[must_use]
    pub fn new(artifact: &'a Artifact, at: At) -> Self {
        Self {
            artifact,
            at,
            part: PhantomData,
        }
    }

    /// Its elements; of a manifest, those of all chunks.
    ///
    /// # Errors
    /// When it is missing, a file is damaged, or it does not hold what it should.
    pub fn read(&self) -> Result<P, StoreError> {
        P::get(&self.at, self.artifact)
    }

    /// Its elements, where it is there.
    ///
    /// # Errors
    /// As [`Stored::read`].
    pub fn read_if_there(&self) -> Result<Option<P>, StoreError> {
        Option::get(&self.at, self.artifact)
    }

    /// Whether the artifact has it.
    ///
    /// # Errors
    /// When a chunk is missing or damaged.
    pub fn is_there(&self) -> Result<bool, StoreError> {
        P::is_in(&self.at, self.artifact)
    }

    /// Its path in the file.
    #[must_use]
    pub fn path(&self) -> &str {
        self.at.path()
    }

    /// Its length along the first axis, without reading elements.
    ///
    /// # Errors
    /// When it is missing, or a chunk is missing or damaged.
    pub fn rows(&self) -> Result<usize, StoreError> {
        Ok(self
            .artifact
            .content(self.path())?
            .shape
            .first()
            .copied()
            .unwrap_or_default())
    }

    /// The numbers of some of its rows, out of an artifact that is no manifest.
    ///
    /// # Errors
    /// When they cannot be read.
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
    /// The attribute of that name.
    #[must_use]
    pub fn new(artifact: &'a Artifact, name: &'static str) -> Self {
        Self {
            artifact,
            name,
            value: PhantomData,
        }
    }

    /// Its value. What a manifest does not say itself its chunks say, all the same.
    ///
    /// # Errors
    /// When it is missing although it is needed, or cannot be read.
    pub fn read(&self) -> Result<A, StoreError> {
        let text = self.text()?;
        A::from_text(self.name, text.as_deref()).map_err(|fault| fault.of(self.artifact.digest()))
    }

    /// Its text; none where it is missing.
    ///
    /// # Errors
    /// When the first chunk is missing or damaged.
    pub fn text(&self) -> Result<Option<String>, StoreError> {
        if let Some(own) = self.artifact.attribute(self.name) {
            return Ok(Some(own.to_owned()));
        }
        let first = self.artifact.first_chunk()?;
        Ok(first.and_then(|chunk| chunk.attribute(self.name).map(str::to_owned)))
    }
}
