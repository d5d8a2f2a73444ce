//! The index of a store: for each artifact the stamp of its file when it was last verified, and the part of its content
//! that planning needs, so that a rerun that builds nothing does not open any artifact.
//!
//! The index is only a cache and may be deleted or damaged at any time: it ends with its own digest, and an incomplete
//! index or one of another version is ignored. Artifacts that are not in the index are verified in full. Processes
//! merge the index with that of others before they write it; if several write at once, the last wins and some artifacts
//! are verified again.
//!
//! ```text
//! "deaflow-index 2\n"
//! number of listings; each: length, encoded kind and datasets
//! number of artifacts; each: digest, file digest, size, modified, changed, inode, noted, listing, parts
//! the parts of all manifests in the order of the artifacts
//! BLAKE3 of all bytes before
//! ```
//!
//! Numbers are 64-bit little-endian. `listing` counts from 1 and is 0 where it is unknown; `parts` is how many parts it
//! has.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::header::Header;
use super::listing::Listing;
use super::stamp::{Stamp, Time};
use deaflow_base::{ArtifactId, Digest, FileDigest, decode, encode, read_own};

const TITLE: &[u8; 16] = b"deaflow-index 2\n";
const TRAILER: usize = 32;

/// Maximum length, bytes: an index of some millions of artifacts. A longer one is ignored.
const MAX_BYTES: u64 = 1 << 30;

/// The content of an artifact without elements and attributes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Structure {
    /// Its kind and datasets. Equal listings of chunks are shared.
    pub listing: Arc<Listing>,
    /// The chunks of a manifest; empty for other artifacts.
    pub parts: Arc<Vec<ArtifactId>>,
}

/// An artifact in the index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// BLAKE3 digest of its file.
    pub file: FileDigest,
    /// The stamp of its file when it was verified.
    pub stamp: Stamp,
    /// When it was verified, by the clock of the file system.
    pub noted: Time,
    /// Its structure, if known.
    pub structure: Option<Structure>,
}

impl Entry {
    /// Returns the header of the file.
    pub fn header(&self, content: ArtifactId) -> Header {
        Header {
            content,
            file: self.file,
            size: self.stamp.size,
        }
    }
}

/// The entries of an index by artifact.
pub type Entries = HashMap<ArtifactId, Entry>;

/// Reads an index; returns an empty one if the file is missing or not valid. Entries with a time in the future are left
/// out: the clock has been set back, so a file that changed since may have the same time as before.
pub fn read(path: &Path, now: Time) -> Entries {
    let bytes = read_own(path, MAX_BYTES).unwrap_or_default();
    let mut entries = parse(&bytes).unwrap_or_default();
    entries.retain(|_, entry| entry.noted <= now && entry.stamp.is_settled(entry.noted));
    entries
}

fn parse(bytes: &[u8]) -> Option<Entries> {
    let (body, trailer) = bytes.split_at_checked(bytes.len().checked_sub(TRAILER)?)?;
    (Digest::of(body).as_bytes() == trailer).then_some(())?;
    let mut reader = Reader(body);
    (reader.take(TITLE.len())? == TITLE).then_some(())?;
    let mut listings: Vec<Arc<Listing>> = Vec::new();
    for _ in 0..reader.number()? {
        let length = usize::try_from(reader.number()?).ok()?;
        listings.push(Arc::new(decode(reader.take(length)?).ok()?));
    }
    let mut rows = Vec::new();
    for _ in 0..reader.number()? {
        rows.push(reader.entry()?);
    }
    let mut entries = Entries::with_capacity(rows.len());
    let no_parts = Arc::new(Vec::new());
    for (digest, file, stamp, noted, (listing, parts)) in rows {
        let structure = match (listing.checked_sub(1), parts) {
            (None, 0) => None,
            (None, _) => return None,
            (Some(at), parts) => Some(Structure {
                listing: listings.get(usize::try_from(at).ok()?)?.clone(),
                parts: match parts {
                    0 => no_parts.clone(),
                    count => Arc::new((0..count).map(|_| reader.artifact()).collect::<Option<_>>()?),
                },
            }),
        };
        let entry = Entry {
            file,
            stamp,
            noted,
            structure,
        };
        entries.insert(digest, entry);
    }
    reader.0.is_empty().then_some(entries)
}

type EncodedEntry = (ArtifactId, FileDigest, Stamp, Time, (u64, u64));

/// Reads numbers and digests from bytes.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn number(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    fn digest(&mut self) -> Option<Digest> {
        Some(Digest::from_bytes(self.take(32)?.try_into().ok()?))
    }

    fn artifact(&mut self) -> Option<ArtifactId> {
        self.digest().map(ArtifactId::from)
    }

    fn time(&mut self) -> Option<Time> {
        Some((self.number()?.cast_signed(), self.number()?.cast_signed()))
    }

    fn entry(&mut self) -> Option<EncodedEntry> {
        let (digest, file) = (self.artifact()?, self.digest()?.into());
        let stamp = Stamp {
            size: self.number()?,
            modified: self.time()?,
            changed: self.time()?,
            inode: self.number()?,
        };
        Some((digest, file, stamp, self.time()?, (self.number()?, self.number()?)))
    }
}

/// Encodes an index. Listings that are too large to be encoded are left out.
pub fn write(entries: &Entries) -> Vec<u8> {
    let mut listings = Listings::default();
    let mut sorted: Vec<(&ArtifactId, &Entry)> = entries.iter().collect();
    sorted.sort_unstable_by_key(|(digest, _)| **digest);
    let (mut rows, mut parts) = (Vec::<u8>::new(), Vec::<u8>::new());
    for (digest, entry) in sorted {
        let known = entry.structure.as_ref();
        let known = known.and_then(|structure| Some((listings.number(&structure.listing)?, &structure.parts)));
        let (listing, count) = known.map_or((0, 0), |(listing, chunks)| {
            chunks.iter().for_each(|chunk| parts.extend(chunk.as_bytes()));
            (listing, chunks.len() as u64)
        });
        rows.extend(digest.as_bytes());
        rows.extend(entry.file.as_bytes());
        let (stamp, noted) = (&entry.stamp, entry.noted);
        let times = [stamp.modified.0, stamp.modified.1, stamp.changed.0, stamp.changed.1];
        rows.extend(stamp.size.to_le_bytes());
        rows.extend(times.iter().flat_map(|time| time.to_le_bytes()));
        rows.extend(stamp.inode.to_le_bytes());
        rows.extend([noted.0, noted.1].iter().flat_map(|time| time.to_le_bytes()));
        rows.extend([listing, count].iter().flat_map(|number| number.to_le_bytes()));
    }
    let mut bytes = TITLE.to_vec();
    bytes.extend((listings.encoded.len() as u64).to_le_bytes());
    for listing in &listings.encoded {
        bytes.extend((listing.len() as u64).to_le_bytes());
        bytes.extend(listing);
    }
    bytes.extend((entries.len() as u64).to_le_bytes());
    bytes.extend(rows);
    bytes.extend(parts);
    let trailer = Digest::of(&bytes);
    bytes.extend(trailer.as_bytes());
    bytes
}

/// The encoded listings, each once.
#[derive(Default)]
struct Listings {
    encoded: Vec<Vec<u8>>,
    numbers: HashMap<Arc<Listing>, u64>,
}

impl Listings {
    /// Returns the number of a listing, from 1; `None` if it cannot be encoded.
    fn number(&mut self, listing: &Arc<Listing>) -> Option<u64> {
        if let Some(number) = self.numbers.get(listing) {
            return Some(*number);
        }
        self.encoded.push(encode(&**listing).ok()?);
        let number = self.encoded.len() as u64;
        self.numbers.insert(listing.clone(), number);
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::element_type::ElementType;
    use super::super::listing::Content;
    use super::*;

    const NOW: Time = (1000, 0);

    fn entries() -> Entries {
        let content = |n| Content {
            path: "a/b".into(),
            kind: ElementType::F64,
            shape: vec![n, 2],
            units: "mm".into(),
            description: "d".into(),
            axes: vec!["row".into(), "column".into()],
        };
        let structure = |contents, parts| Structure {
            listing: Arc::new(Listing {
                kind: "solve".into(),
                contents,
            }),
            parts: Arc::new(parts),
        };
        let listing = |n| structure(vec![content(n)], Vec::new());
        let digest = |i: u8| ArtifactId::of(&[i]);
        let outlines = [
            Some(listing(1)),
            Some(listing(2)),
            Some(listing(1)),
            Some(structure(Vec::new(), vec![digest(0), digest(1)])),
            None,
        ];
        let entry = |(i, structure)| {
            let i = i as u8;
            let entry = Entry {
                file: FileDigest::of(&[i + 100]),
                stamp: Stamp {
                    size: u64::from(i),
                    modified: (-5, 7),
                    changed: (900 + i64::from(i), 1),
                    inode: 3,
                },
                noted: (950, 0),
                structure,
            };
            (digest(i), entry)
        };
        outlines.into_iter().enumerate().map(entry).collect()
    }

    fn read_bytes(bytes: &[u8], now: Time) -> Entries {
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), bytes).unwrap();
        read(file.path(), now)
    }

    #[test]
    fn an_index_comes_back_whole_or_not_at_all() {
        let bytes = write(&entries());
        assert_eq!(read_bytes(&bytes, NOW), entries());
        for length in 0..bytes.len() {
            assert!(parse(&bytes[..length]).is_none(), "{length} bytes");
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            assert!(parse(&damaged).is_none(), "byte {at}");
        }
    }

    /// Numbers that are not those of the content, under a digest that fits: written by another program.
    #[test]
    fn an_index_that_cannot_be_is_none() {
        let whole = write(&entries());
        let body = &whole[..whole.len() - TRAILER];
        for at in (0..body.len()).step_by(4) {
            let mut body = body.to_vec();
            body[at] ^= 0x80;
            body.extend(*Digest::of(&body).as_bytes());
            // Whatever it says, it is read without a panic and without asking for memory that is not there.
            let _ = parse(&body);
        }
        let mut longer = body.to_vec();
        longer.push(0);
        longer.extend(*Digest::of(&longer).as_bytes());
        assert!(parse(&longer).is_none());
        let mut other = body.to_vec();
        other[14] = b'1';
        other.extend(*Digest::of(&other).as_bytes());
        assert!(parse(&other).is_none(), "another version");
    }

    #[test]
    fn equal_listings_are_written_once() {
        let bytes = write(&entries());
        let found = bytes.windows(3).filter(|window| window == b"a/b").count();
        assert_eq!(found, 2);
    }

    #[test]
    fn what_was_noted_too_soon_or_in_the_future_is_not_believed() {
        let mut racy = entries();
        let (digest, mut entry) = racy.drain().next().unwrap();
        entry.stamp.changed = (950, 0);
        racy.insert(digest, entry);
        assert!(read_bytes(&write(&racy), NOW).is_empty());
        assert!(read_bytes(&write(&entries()), (949, 0)).is_empty());
        assert_eq!(read_bytes(&write(&entries()), (950, 0)).len(), 5);
    }
}
