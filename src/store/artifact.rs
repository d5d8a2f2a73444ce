//! An artifact that can be read: arrays, or a manifest whose chunks read as one.

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

/// A verified artifact. Cheap to clone; elements are read when asked for.
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
    /// Opens the file of an artifact wherever it stands; the chunks of a manifest are looked for as in a store. Anybody may have
    /// made it: it is read in another process.
    ///
    /// # Errors
    /// When it is not an artifact, or damaged.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        // Its chunks are looked for beside the file and not beside a link to it.
        let path = match path.is_symlink() {
            true => std::fs::canonicalize(path).map_err(StoreError::io("open", path))?,
            false => path.to_owned(),
        };
        let header = Header::read(&path)?;
        Self::load(Access::Apart, path, header.content, Arc::default())
    }

    /// Whether the file at `path` is meant for an artifact.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        Header::is_at(path)
    }

    /// Opens the file of an artifact, verified. What is not known to stand in it is read in another process.
    pub(super) fn load(
        access: Access,
        path: PathBuf,
        digest: ArtifactId,
        verified: Arc<Verified>,
    ) -> Result<Self, StoreError> {
        verified.verify(&path, &digest)?;
        let first = match access {
            Access::Here if !verified.is_described(&path, &digest)? => Access::Guarded,
            access => access,
        };
        let overview = read::overview(first, &path)?;
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

    /// Reads a file whole and digests what stands in it anew, trusting nothing that this process has seen before.
    ///
    /// # Errors
    /// When it is not the artifact that it should be.
    pub(super) fn read_anew(path: &Path, digest: &ArtifactId) -> Result<(Self, Object), StoreError> {
        let artifact = Self::load(Access::Guarded, path.to_owned(), *digest, Arc::default())?;
        let object = artifact.object()?;
        let found = object.digest()?;
        if found != *digest {
            let reason = format!("its content has the digest {}", found.short());
            return Err(StoreError::damaged(path, reason));
        }
        Ok((artifact, object))
    }

    /// Its digest.
    #[must_use]
    pub fn digest(&self) -> ArtifactId {
        self.0.digest
    }

    /// Its file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// BLAKE3 of its file as written (after the user block).
    ///
    /// # Errors
    /// When the file is missing or damaged.
    pub fn file_digest(&self) -> Result<FileDigest, StoreError> {
        Ok(self.0.verified.verify(&self.0.path, &self.0.digest)?.file)
    }

    /// Kind of the stage that made it; empty where none did.
    #[must_use]
    pub fn kind(&self) -> &str {
        stage_kind(&self.0.overview.listing.kind)
    }

    /// A content attribute.
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

    /// Whether its datasets are those of chunks laid end to end.
    #[must_use]
    pub fn is_manifest(&self) -> bool {
        !self.parts().is_empty()
    }

    /// The chunks as artifacts of their own, in order; none unless it is a manifest.
    ///
    /// # Errors
    /// When one is missing or damaged.
    pub fn chunks(&self) -> Result<&[Artifact], StoreError> {
        if let Some(chunks) = self.0.chunks.get() {
            return Ok(chunks);
        }
        let chunks: Result<Vec<Self>, StoreError> = self.parts().iter().map(|digest| self.beside(digest)).collect();
        let chunks = chunks?;
        // Another thread may have been faster, with the same chunks.
        Ok(self.0.chunks.get_or_init(|| chunks))
    }

    /// The first chunk, without opening the others; none unless it is a manifest.
    ///
    /// # Errors
    /// When it is missing or damaged.
    pub fn first_chunk(&self) -> Result<Option<Self>, StoreError> {
        self.parts().first().map(|digest| self.beside(digest)).transpose()
    }

    /// Opens another artifact of the store that it stands in.
    ///
    /// # Errors
    /// When it is missing or damaged.
    pub fn beside(&self, digest: &ArtifactId) -> Result<Self, StoreError> {
        Self::load(
            self.0.access,
            self.path_beside(digest),
            *digest,
            self.0.verified.clone(),
        )
    }

    /// The file of another artifact of the store that it stands in.
    fn path_beside(&self, digest: &ArtifactId) -> PathBuf {
        let folder = self.0.path.parent().and_then(Path::parent).unwrap_or(Path::new(".."));
        let name = digest.to_string();
        folder.join(&name[..2]).join(format!("{name}.h5"))
    }

    /// What stands in each chunk, in order; in a store their files are opened only where that is not known.
    fn listings(&self) -> Result<Vec<Arc<Listing>>, StoreError> {
        if self.0.access == Access::Apart {
            let listings = self.chunks()?.iter().map(|chunk| chunk.0.overview.listing.clone());
            return Ok(listings.map(Arc::new).collect());
        }
        let of = |digest: &ArtifactId| Ok(self.0.verified.structure(&self.path_beside(digest), digest)?.listing);
        self.parts().iter().map(of).collect()
    }

    /// Opens its file to read rows of its own datasets. Every byte was verified when the artifact was opened.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn rows(&self) -> Result<RowFile, StoreError> {
        RowFile::of(self.0.access, &self.0.path)
    }

    /// The datasets in the order of their paths, without their elements.
    ///
    /// # Errors
    /// When a chunk is missing or damaged.
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

    /// One dataset without its elements.
    ///
    /// # Errors
    /// When there is none of that path, or a chunk is missing or damaged.
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

    /// Reads one dataset; of a manifest, that of all chunks, laid end to end along the first axis.
    ///
    /// # Errors
    /// When there is none of that path, or a file is missing or damaged.
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
                let reason = format!("`{path}` changed its type");
                return Err(StoreError::damaged(&self.path_beside(digest), reason));
            }
        }
        let mut whole = whole.ok_or_else(|| StoreError::damaged(&self.0.path, "it has no chunks"))?;
        whole.shape.clone_from(&content.shape);
        Ok(whole)
    }

    /// One dataset of a chunk, by what is known to stand in it: its file is opened once. Every byte of it is verified.
    fn read_part(&self, digest: &ArtifactId, listing: &Listing, path: &str) -> Result<Dataset, StoreError> {
        let file = self.path_beside(digest);
        let Some(content) = listing.contents.iter().find(|content| content.path == path) else {
            return Err(StoreError::damaged(&file, format!("`{path}` is not in it")));
        };
        self.0.verified.verify(&file, digest)?;
        let access = match self.0.access {
            Access::Apart => Access::Apart,
            _ if self.0.verified.is_described(&file, digest)? => Access::Here,
            _ => Access::Guarded,
        };
        read::dataset(access, &file, content)
    }

    /// Verified anew, since the file may have changed after it was opened; a glance unless it did.
    fn read_own(&self, content: &Content) -> Result<Dataset, StoreError> {
        self.0.verified.verify(&self.0.path, &self.0.digest)?;
        read::dataset(self.0.access, &self.0.path, content)
    }

    /// Everything: what was put, as it was put.
    ///
    /// # Errors
    /// When the file is missing or damaged.
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

    /// The attributes of `/provenance`: when, where, how long, by which action.
    ///
    /// # Errors
    /// When the file is missing or damaged.
    pub fn provenance(&self) -> Result<BTreeMap<String, String>, StoreError> {
        self.0.verified.verify(&self.0.path, &self.0.digest)?;
        read::provenance(self.0.access, &self.0.path)
    }

    /// What the action that made it measured by name, s; none where nothing was.
    ///
    /// # Errors
    /// When the file is missing or damaged.
    pub fn measurements(&self) -> Result<Vec<(String, f64)>, StoreError> {
        Ok(provenance::measurements(&self.provenance()?))
    }

    fn wrong(&self, path: &str, wanted: &'static str, found: &Data) -> StoreError {
        StoreError::WrongType {
            digest: self.0.digest,
            dataset: path.to_owned(),
            wanted,
            found: ElementType::of(found).name(),
        }
    }
}

impl Artifact {
    /// Texts of any length, as [`super::Object::with_long_texts`] keeps them.
    ///
    /// # Errors
    /// When they are not there, their lengths are not those of their bytes, or a file is missing or damaged.
    pub fn long_texts(&self, path: &str) -> Result<Vec<String>, StoreError> {
        let (_, bytes) = self.u8s(&format!("{path}/text"))?;
        let (_, lengths) = self.u64s(&format!("{path}/length"))?;
        long_texts(&bytes, &lengths).ok_or_else(|| {
            let reason = format!("the texts of `{path}` are not as long as it says");
            StoreError::damaged(&self.0.path, reason)
        })
    }
}

/// Texts of any length from their bytes, end to end, and their lengths; none where these contradict each other.
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

/// One getter per element type: the type is checked, so that the caller has a vector and no `match`.
macro_rules! typed {
    ($name:ident, $variant:ident, $element:ty, $wanted:literal) => {
        impl Artifact {
            #[doc = concat!("Shape and elements of a dataset of type ", $wanted, ".")]
            ///
            /// # Errors
            /// When there is none of that path, it has another type, or a file is missing or damaged.
            pub fn $name(&self, path: &str) -> Result<(Vec<usize>, Vec<$element>), StoreError> {
                let dataset = self.read(path)?;
                match dataset.data {
                    Data::$variant(elements) => Ok((dataset.shape, elements)),
                    other => Err(self.wrong(path, $wanted, &other)),
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
