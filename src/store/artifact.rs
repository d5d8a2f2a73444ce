//! Reads artifacts: arrays, or a manifest whose chunks are read as one array each.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use super::action::stage_kind;
use super::element_type::ElementType;
use super::error::StoreError;
use super::header::Header;
use super::listing::{self, Content, Listing};
use super::object::{Data, Dataset, Object};
use super::provenance;
use super::read::{self, Access};
use super::row_file::RowFile;
use super::verified::Verified;
use deaflow_base::{ArtifactId, FileDigest};

/// A verified artifact. Cheap to clone; elements are read on demand.
#[derive(Clone)]
pub struct Artifact(Arc<Inner>);

struct Inner {
    digest: ArtifactId,
    path: PathBuf,
    overview: read::Overview,
    verified: Arc<Verified>,
    access: Access,
    chunks: OnceLock<Vec<Artifact>>,
    contents: OnceLock<Vec<Content>>,
}

impl Artifact {
    /// Opens the file of an artifact at any path; the chunks of a manifest are expected beside it as in a store. The
    /// file is untrusted, so another process reads it.
    ///
    /// # Errors
    /// If it is not an artifact, or is damaged.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        // The chunks are beside the file, not beside a link to it.
        let path = match path.is_symlink() {
            true => std::fs::canonicalize(path).map_err(StoreError::io("open", path))?,
            false => path.to_owned(),
        };
        let header = Header::read(&path)?;
        Self::load(Access::Apart, path, header.content, Arc::default())
    }

    /// Whether the file at `path` starts with the header of an artifact.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        Header::is_at(path)
    }

    /// Opens and verifies the file of an artifact. Another process reads it if its structure is not known yet.
    pub(super) fn load(
        access: Access,
        path: PathBuf,
        digest: ArtifactId,
        verified: Arc<Verified>,
    ) -> Result<Self, StoreError> {
        verified.verify(&path, &digest)?;
        let overview_access = match access {
            Access::Here if !verified.is_described(&path, &digest)? => Access::Guarded,
            access => access,
        };
        let overview = read::overview(overview_access, &path)?;
        verified.describe(&digest, overview.listing.clone(), overview.parts.clone());
        Ok(Self(Arc::new(Inner {
            digest,
            overview,
            path,
            verified,
            access,
            chunks: OnceLock::new(),
            contents: OnceLock::new(),
        })))
    }

    /// Reads a whole file and computes the digest of its content, without using anything that is cached.
    ///
    /// # Errors
    /// If it is not the expected artifact.
    pub(super) fn read_uncached(path: &Path, digest: &ArtifactId) -> Result<(Self, Object), StoreError> {
        let artifact = Self::load(Access::Guarded, path.to_owned(), *digest, Arc::default())?;
        let object = artifact.object()?;
        let found = object.digest()?;
        if found != *digest {
            let reason = format!("the digest of its content is {}", found.short());
            return Err(StoreError::damaged(path, reason));
        }
        Ok((artifact, object))
    }

    /// Returns the digest.
    #[must_use]
    pub fn digest(&self) -> ArtifactId {
        self.0.digest
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Returns the BLAKE3 digest of the file (after the user block).
    ///
    /// # Errors
    /// If the file is missing or damaged.
    pub fn file_digest(&self) -> Result<FileDigest, StoreError> {
        Ok(self.0.verified.verify(&self.0.path, &self.0.digest)?.file)
    }

    /// Returns the kind of the stage that made it; empty if no stage did.
    #[must_use]
    pub fn kind(&self) -> &str {
        stage_kind(&self.0.overview.listing.kind)
    }

    /// Returns a content attribute.
    #[must_use]
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.0.overview.attributes.get(name).map(String::as_str)
    }

    /// All content attributes by name.
    #[must_use]
    pub fn attributes(&self) -> &BTreeMap<String, String> {
        &self.0.overview.attributes
    }

    /// Digests of the chunks, in order; none unless it is a manifest.
    #[must_use]
    pub fn parts(&self) -> &[ArtifactId] {
        &self.0.overview.parts
    }

    /// Whether the artifact is a manifest, whose datasets are the concatenated datasets of its chunks.
    #[must_use]
    pub fn is_manifest(&self) -> bool {
        !self.parts().is_empty()
    }

    /// Returns the chunks as artifacts, in order; empty unless it is a manifest.
    ///
    /// # Errors
    /// If one is missing or damaged.
    pub fn chunks(&self) -> Result<&[Artifact], StoreError> {
        if let Some(chunks) = self.0.chunks.get() {
            return Ok(chunks);
        }
        let chunks: Result<Vec<Self>, StoreError> = self.parts().iter().map(|digest| self.sibling(digest)).collect();
        let chunks = chunks?;
        // Another thread may have set the same chunks meanwhile.
        Ok(self.0.chunks.get_or_init(|| chunks))
    }

    /// Returns the first chunk without opening the others; `None` unless it is a manifest.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn first_chunk(&self) -> Result<Option<Self>, StoreError> {
        self.parts().first().map(|digest| self.sibling(digest)).transpose()
    }

    /// Opens another artifact of the same store.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn sibling(&self, digest: &ArtifactId) -> Result<Self, StoreError> {
        Self::load(
            self.0.access,
            self.sibling_path(digest),
            *digest,
            self.0.verified.clone(),
        )
    }

    /// Returns the path of another artifact of the same store.
    fn sibling_path(&self, digest: &ArtifactId) -> PathBuf {
        let folder = self.0.path.parent().and_then(Path::parent).unwrap_or(Path::new(".."));
        let name = digest.to_string();
        folder.join(&name[..2]).join(format!("{name}.h5"))
    }

    /// Returns the listing of each chunk, in order. In a store, files are opened only if the index does not have the
    /// listing.
    fn listings(&self) -> Result<Vec<Arc<Listing>>, StoreError> {
        if self.0.access == Access::Apart {
            let listings = self.chunks()?.iter().map(|chunk| chunk.0.overview.listing.clone());
            return Ok(listings.map(Arc::new).collect());
        }
        let of = |digest: &ArtifactId| Ok(self.0.verified.structure(&self.sibling_path(digest), digest)?.listing);
        self.parts().iter().map(of).collect()
    }

    /// Opens the file to read rows of its own datasets. Every byte was verified when the artifact was opened.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn rows(&self) -> Result<RowFile, StoreError> {
        RowFile::of(self.0.access, &self.0.path)
    }

    /// Returns the descriptions of the datasets in the order of their paths.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    pub fn contents(&self) -> Result<&[Content], StoreError> {
        if !self.is_manifest() {
            return Ok(&self.0.overview.listing.contents);
        }
        if let Some(contents) = self.0.contents.get() {
            return Ok(contents);
        }
        let listings = self.listings()?;
        let parts = self.parts().iter().zip(&listings);
        let whole = listing::concatenate(parts.map(|(digest, listing)| (*digest, listing.contents.as_slice())))?;
        Ok(self.0.contents.get_or_init(|| whole))
    }

    /// Returns the description of one dataset.
    ///
    /// # Errors
    /// If there is no such dataset, or a chunk is missing or damaged.
    pub fn content(&self, path: &str) -> Result<&Content, StoreError> {
        let contents = self.contents()?;
        contents.iter().find(|content| content.path == path).ok_or_else(|| {
            let known: Vec<&str> = contents.iter().map(|content| content.path.as_str()).collect();
            StoreError::NoDataset {
                digest: self.0.digest,
                dataset: path.to_owned(),
                known: known.join(", "),
            }
        })
    }

    /// Reads one dataset; for a manifest, concatenates those of all chunks along the first axis.
    ///
    /// # Errors
    /// If there is no such dataset, or a file is missing or damaged.
    pub fn read(&self, path: &str) -> Result<Dataset, StoreError> {
        let content = self.content(path)?;
        if !self.is_manifest() {
            return self.read_own(content);
        }
        let mut whole: Option<Dataset> = None;
        for (digest, listing) in self.parts().iter().zip(self.listings()?) {
            let part = self.read_part(digest, &listing, path)?;
            let Some(whole) = &mut whole else {
                whole = Some(part);
                continue;
            };
            if !whole.data.append(part.data) {
                let reason = format!("the type of `{path}` has changed");
                return Err(StoreError::damaged(&self.sibling_path(digest), reason));
            }
        }
        let mut whole = whole.ok_or_else(|| StoreError::damaged(&self.0.path, "it is a manifest without chunks"))?;
        whole.shape.clone_from(&content.shape);
        Ok(whole)
    }

    /// Reads one dataset of a chunk whose listing is known, so that the file is opened once. Every byte of it is
    /// verified.
    fn read_part(&self, digest: &ArtifactId, listing: &Listing, path: &str) -> Result<Dataset, StoreError> {
        let file = self.sibling_path(digest);
        let Some(content) = listing.contents.iter().find(|content| content.path == path) else {
            return Err(StoreError::damaged(&file, format!("it has no dataset `{path}`")));
        };
        self.0.verified.verify(&file, digest)?;
        let access = match self.0.access {
            Access::Apart => Access::Apart,
            _ if self.0.verified.is_described(&file, digest)? => Access::Here,
            _ => Access::Guarded,
        };
        read::dataset(access, &file, content)
    }

    /// Reads a dataset of this file, which is verified again in case it changed; without a change that is only a look
    /// at its stamp.
    fn read_own(&self, content: &Content) -> Result<Dataset, StoreError> {
        self.0.verified.verify(&self.0.path, &self.0.digest)?;
        read::dataset(self.0.access, &self.0.path, content)
    }

    /// Reads the whole content.
    ///
    /// # Errors
    /// If the file is missing or damaged.
    pub fn object(&self) -> Result<Object, StoreError> {
        let mut object = Object {
            kind: self.0.overview.listing.kind.clone(),
            attributes: self.0.overview.attributes.clone(),
            datasets: BTreeMap::new(),
            parts: self.0.overview.parts.clone(),
        };
        for content in &self.0.overview.listing.contents {
            object.datasets.insert(content.path.clone(), self.read_own(content)?);
        }
        Ok(object)
    }

    /// Reads the attributes of `/provenance`: time, host, duration and action.
    ///
    /// # Errors
    /// If the file is missing or damaged.
    pub fn provenance(&self) -> Result<BTreeMap<String, String>, StoreError> {
        self.0.verified.verify(&self.0.path, &self.0.digest)?;
        read::provenance(self.0.access, &self.0.path)
    }

    /// Returns the times in s that the action which made it measured, by name.
    ///
    /// # Errors
    /// If the file is missing or damaged.
    pub fn measurements(&self) -> Result<Vec<(String, f64)>, StoreError> {
        Ok(provenance::measurements(&self.provenance()?))
    }

    fn wrong_type(&self, path: &str, expected: &'static str, found: &Data) -> StoreError {
        StoreError::WrongType {
            digest: self.0.digest,
            dataset: path.to_owned(),
            expected,
            found: ElementType::of(found).name(),
        }
    }
}

impl Artifact {
    /// Reads texts of any length that [`super::Object::with_long_texts`] added.
    ///
    /// # Errors
    /// If there are none, the lengths do not match the bytes, or a file is missing or damaged.
    pub fn long_texts(&self, path: &str) -> Result<Vec<String>, StoreError> {
        let (_, bytes) = self.u8s(&format!("{path}/text"))?;
        let (_, lengths) = self.u64s(&format!("{path}/length"))?;
        long_texts(&bytes, &lengths).ok_or_else(|| {
            let reason = format!("the lengths of the texts in `{path}` do not match their bytes");
            StoreError::damaged(&self.0.path, reason)
        })
    }
}

/// Splits concatenated bytes into texts of the given lengths; returns `None` if the lengths do not match.
#[must_use]
pub fn long_texts(bytes: &[u8], lengths: &[u64]) -> Option<Vec<String>> {
    let (mut texts, mut rest) = (Vec::new(), bytes);
    for length in lengths {
        let (text, after) = rest.split_at_checked(usize::try_from(*length).ok()?)?;
        texts.push(String::from_utf8(text.to_vec()).ok()?);
        rest = after;
    }
    rest.is_empty().then_some(texts)
}

/// Defines a reader for one element type, which checks the type.
macro_rules! typed {
    ($name:ident, $variant:ident, $element:ty, $expected:literal) => {
        impl Artifact {
            #[doc = concat!("Reads shape and elements of a dataset of type ", $expected, ".")]
            ///
            /// # Errors
            /// If there is no such dataset, it has another type, or a file is missing or damaged.
            pub fn $name(&self, path: &str) -> Result<(Vec<usize>, Vec<$element>), StoreError> {
                let dataset = self.read(path)?;
                match dataset.data {
                    Data::$variant(elements) => Ok((dataset.shape, elements)),
                    other => Err(self.wrong_type(path, $expected, &other)),
                }
            }
        }
    };
}

typed!(u8s, U8, u8, "u8");
typed!(u32s, U32, u32, "u32");
typed!(u64s, U64, u64, "u64");
typed!(f32s, F32, f32, "f32");
typed!(f64s, F64, f64, "f64");
typed!(texts, Text, String, "text");
