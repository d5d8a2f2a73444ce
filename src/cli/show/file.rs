//! The content of an HDF5 file that is not an artifact: the output of `solve`, `predict` or `export artifact`.

use std::path::Path;

use super::{DatasetSummary, ShowArguments, Summary, corners, print, print_rows, statistics};
use crate::{CliError, Exit, Output};
use deaflow_hdf::{Array, HdfFile, Tree};
use deaflow_report::{RowSource, Rows, RowsError};
use deaflow_store::{Content, Data, ElementType, StoreError, long_texts};

/// A file, and the tree of its objects.
struct ResultFile<'a> {
    path: &'a Path,
    file: HdfFile,
    tree: Tree,
}

pub fn execute(path: &Path, arguments: &ShowArguments, output: &Output) -> Result<Exit, CliError> {
    let file = HdfFile::open_untrusted(path).map_err(StoreError::from)?;
    let tree = file.tree().map_err(StoreError::from)?;
    let file = ResultFile { path, file, tree };
    if arguments.corners && !output.is_json() {
        let scene = file.tree.attributes.get("scene").map(String::as_str);
        return corners::print(&file, scene, output);
    }
    if arguments.csv && !output.is_json() {
        return print_rows(&Rows::of(&file, arguments.along.as_deref())?, output);
    }
    print(&file.summary()?, output)
}

impl ResultFile<'_> {
    fn summary(&self) -> Result<Summary, CliError> {
        let dataset = |array: &Array| -> Result<DatasetSummary, CliError> {
            let elements = self.elements(&array.path)?;
            Ok(DatasetSummary {
                path: array.path.clone(),
                kind: ElementType::of(&elements).name(),
                shape: array.shape.clone(),
                units: array.units.clone(),
                description: array.description.clone(),
                statistics: statistics::of_data(&elements),
            })
        };
        Ok(Summary {
            digest: None,
            path: self.path.display().to_string(),
            attributes: self.tree.attributes.clone(),
            parts: Vec::new(),
            datasets: self.tree.arrays.iter().map(dataset).collect::<Result<_, _>>()?,
            provenance: self.tree.provenance.clone().unwrap_or_default(),
            record: None,
            table: None,
            audit: None,
        })
    }
}

impl RowSource for ResultFile<'_> {
    fn title(&self) -> String {
        self.path.display().to_string()
    }

    fn contents(&self) -> Result<Vec<Content>, RowsError> {
        let arrays = self.tree.arrays.iter();
        arrays
            .map(|array| Ok(Content::of_file(self.path, array.clone())?))
            .collect()
    }

    fn elements(&self, path: &str) -> Result<Data, RowsError> {
        Ok(self.file.elements(path).map_err(StoreError::from)?)
    }

    fn long_texts(&self, path: &str) -> Result<Vec<String>, RowsError> {
        let texts = match (
            self.elements(&format!("{path}/text"))?,
            self.elements(&format!("{path}/length"))?,
        ) {
            (Data::U8(bytes), Data::U64(lengths)) => long_texts(&bytes, &lengths),
            _ => None,
        };
        texts.ok_or_else(|| {
            let file = self.path.display();
            RowsError::None {
                message: format!("{file}: the lengths of the texts of `{path}` are wrong"),
                help: "the file is damaged, or was written by another program".to_owned(),
            }
        })
    }
}
