//! An artifact as one HDF5 file that needs no store: the arrays of its chunks end to end, and how all that it was made
//! from was made.

use std::path::Path;

use hdf5::{Extents, Group, H5Type};

use super::ancestry::Ancestor;
use super::artifact::Artifact;
use super::element_type::ElementType;
use super::error::StoreError;
use super::listing::Content;
use super::object::{Data, KIND, TEXT_WIDTH};
use super::write::{PIECE, TextCell, describe, put_elements};
use super::{create, plain, scales, texts};
use deaflow_base::{ArtifactId, Progress};

/// Writes an artifact at `path`, where the file appears complete or not at all and replaces what was there. Elements
/// are copied some rows at a time. `ancestry` begins with the artifact itself; `writer` names this program. Each chunk
/// is a step of progress, an artifact without chunks is one.
///
/// # Errors
/// If a file of the artifact is missing or damaged, the folder does not exist or cannot be written in, or the library
/// refuses.
pub fn write_standalone(
    path: &Path,
    artifact: &Artifact,
    ancestry: &[Ancestor],
    writer: &str,
    progress: &dyn Progress,
) -> Result<(), StoreError> {
    plain::place(path, |file| {
        let output = Output {
            asked_for: path,
            artifact,
            progress,
        };
        output.write(file, ancestry, writer)
    })
}

struct Output<'a> {
    /// The path that is named where something fails.
    asked_for: &'a Path,
    artifact: &'a Artifact,
    progress: &'a dyn Progress,
}

impl Output<'_> {
    fn write(&self, path: &Path, ancestry: &[Ancestor], writer: &str) -> Result<(), StoreError> {
        let failed = StoreError::hdf5("write", self.asked_for);
        let contents = self.artifact.contents()?;
        let file = create::new_file().create(path).map_err(&failed)?;
        self.write_attributes(&file).map_err(&failed)?;
        // As in `write`: all stay open until the file has been flushed, so that a full disk is noticed.
        let datasets: hdf5::Result<Vec<hdf5::Dataset>> = contents.iter().map(|array| create(&file, array)).collect();
        let datasets = datasets.map_err(&failed)?;
        self.copy_elements(contents, &datasets)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        scales::attach(&file, folder, contents).map_err(&failed)?;
        self.write_provenance(&file, ancestry, writer).map_err(&failed)?;
        file.flush().map_err(&failed)?;
        drop(datasets);
        file.close().map_err(&failed)
    }

    fn write_attributes(&self, file: &Group) -> hdf5::Result<()> {
        let own = self.artifact.attributes().iter();
        let own = own.map(|(name, value)| (name.as_str(), value.as_str()));
        texts::attributes(
            file,
            own.chain(
                [(KIND, self.artifact.kind())]
                    .into_iter()
                    .filter(|(_, kind)| !kind.is_empty()),
            ),
        )
    }

    /// Chunk by chunk, so that each file is opened once.
    fn copy_elements(&self, contents: &[Content], datasets: &[hdf5::Dataset]) -> Result<(), StoreError> {
        let mut starts = vec![0; contents.len()];
        let whole = std::slice::from_ref(self.artifact);
        let chunks = self.artifact.chunks()?;
        for source in if chunks.is_empty() { whole } else { chunks } {
            let rows = source.rows()?;
            for ((array, dataset), start) in contents.iter().zip(datasets).zip(&mut starts) {
                let shape = &source.content(&array.path)?.shape;
                let count = shape.first().copied().unwrap_or(1);
                for piece in pieces(array, count) {
                    let end = piece.end;
                    let data = rows.elements(&array.path, piece.clone())?;
                    let at = *start + piece.start;
                    put(dataset, &array.shape, at, end - piece.start, &data)
                        .map_err(StoreError::hdf5("write", self.asked_for))?;
                }
                *start += count;
            }
            self.progress.advance(1);
        }
        Ok(())
    }

    /// The attributes of `/provenance` are those of the artifact's own; each action has a group with its own.
    fn write_provenance(&self, file: &Group, ancestry: &[Ancestor], writer: &str) -> hdf5::Result<()> {
        let group = file.create_group("provenance")?;
        let digest = self.artifact.digest().to_string();
        let names: Vec<String> = ancestry.iter().map(Ancestor::name).collect();
        let parts: Vec<String> = self.artifact.parts().iter().map(ArtifactId::to_string).collect();
        let own = ancestry.first().map(|own| &own.entries).into_iter().flatten();
        let own = own.map(|(name, value)| (name.as_str(), value.as_str()));
        let (actions, parts) = (names.join("\n"), parts.join("\n"));
        let added = [
            ("artifact", digest.as_str()),
            ("actions", actions.as_str()),
            ("parts", parts.as_str()),
            ("exported_by", writer),
        ];
        texts::attributes(
            &group,
            own.chain(added.into_iter().filter(|(_, value)| !value.is_empty())),
        )?;
        for (name, ancestor) in names.iter().zip(ancestry) {
            let digest = ancestor.artifact.to_string();
            let entries = ancestor
                .entries
                .iter()
                .map(|(name, value)| (name.as_str(), value.as_str()));
            texts::attributes(
                &group.create_group(name)?,
                entries.chain([("artifact", digest.as_str())]),
            )?;
        }
        Ok(())
    }
}

/// Ranges of rows that fit into memory.
fn pieces(array: &Content, rows: usize) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
    let row: usize = array.shape.iter().skip(1).product::<usize>() * width(array.kind);
    let step = (PIECE / row.max(1)).max(1);
    (0..rows).step_by(step).map(move |start| start..rows.min(start + step))
}

fn width(kind: ElementType) -> usize {
    match kind {
        ElementType::U8 => 1,
        ElementType::U32 | ElementType::F32 => 4,
        ElementType::U64 | ElementType::F64 => 8,
        ElementType::Text => TEXT_WIDTH,
    }
}

/// An empty dataset in the file, described.
fn create(file: &Group, array: &Content) -> hdf5::Result<hdf5::Dataset> {
    let made = match array.kind {
        ElementType::U8 => empty::<u8>(file, array),
        ElementType::U32 => empty::<u32>(file, array),
        ElementType::U64 => empty::<u64>(file, array),
        ElementType::F32 => empty::<f32>(file, array),
        ElementType::F64 => empty::<f64>(file, array),
        ElementType::Text => empty::<TextCell>(file, array),
    }?;
    describe(&made, &array.units, &array.description, &array.axes)?;
    Ok(made)
}

fn empty<T: H5Type>(file: &Group, array: &Content) -> hdf5::Result<hdf5::Dataset> {
    let shape = Extents::from(array.shape.clone());
    file.new_dataset::<T>().shape(shape).create(array.path.as_str())
}

/// Writes `count` rows of a dataset of a shape, from row `start`.
fn put(dataset: &hdf5::Dataset, shape: &[usize], start: usize, count: usize, data: &Data) -> hdf5::Result<()> {
    match data {
        Data::U8(v) => put_elements(dataset, shape, start, count, v),
        Data::U32(v) => put_elements(dataset, shape, start, count, v),
        Data::U64(v) => put_elements(dataset, shape, start, count, v),
        Data::F32(v) => put_elements(dataset, shape, start, count, v),
        Data::F64(v) => put_elements(dataset, shape, start, count, v),
        Data::Text(v) => {
            let cells: Result<Vec<TextCell>, _> = v.iter().map(|text| text.parse()).collect();
            let cells = cells.map_err(|_| hdf5::Error::from("a text is too long"))?;
            put_elements(dataset, shape, start, count, &cells)
        }
    }
}
