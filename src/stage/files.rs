//! The files that a stage names, relative to the pipeline's file and inside its folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use deaflow_base::{Canonical, InputError, Node, Parameter, Schema, confined};
use deaflow_pattern::split_array;

/// The key with the list of files.
const KEY: &str = "files";

/// The name of a file, optionally with a dataset in it: `own.h5:/patterns`. The result of a stage depends on the
/// content of the file, not on its name, so a name has no canonical value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileName(String);

impl FileName {
    /// Returns the name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Parameter for FileName {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        node.text(key).map(|name| Self(name.to_owned()))
    }

    fn canonical(&self) -> Option<Canonical> {
        None
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

/// Returns the files that a stage names, without the datasets in them.
pub fn named(stage: &Node) -> Vec<String> {
    let names = stage
        .peek(KEY)
        .and_then(|names| names.list(KEY).ok())
        .unwrap_or_default();
    let names = names.iter().filter_map(|name| name.text(KEY).ok());
    names
        .map(|name| split_array(name).map_or(name, |(file, _)| file).to_owned())
        .collect()
}

/// A file that a stage names.
pub struct NamedFile<'a> {
    node: &'a Node,
    /// The name, as in the pipeline.
    pub name: &'a str,
    /// Path of the file, with links resolved.
    pub path: PathBuf,
    /// The dataset in it, if one is named.
    pub dataset: Option<&'a str>,
}

impl<'a> NamedFile<'a> {
    /// Returns the files of a stage, in order.
    ///
    /// # Errors
    /// If one does not exist, is outside the folder of the pipeline, or is listed twice.
    pub fn of_stage(stage: &'a Node) -> Result<Vec<Self>, InputError> {
        let folder = stage.file().parent().unwrap_or(Path::new(""));
        let names = stage.peek(KEY).map(|names| names.list(KEY)).transpose()?;
        let mut seen = BTreeSet::new();
        let once = |node: &'a Node| {
            let file = Self::find(node, folder)?;
            match seen.insert((file.path.clone(), file.dataset)) {
                true => Ok(file),
                false => Err(node.error(format!("the file {} is listed twice", file.name))),
            }
        };
        names.unwrap_or_default().iter().map(once).collect()
    }

    /// Returns the file that a node names, relative to the folder of the pipeline.
    ///
    /// # Errors
    /// If it does not exist, or is outside the folder.
    pub fn find(node: &'a Node, folder: &Path) -> Result<Self, InputError> {
        let name = node.text(KEY)?;
        let (file, dataset) = match split_array(name) {
            Some((file, dataset)) => (file, Some(dataset)),
            None => (name, None),
        };
        let found = confined(folder, Path::new(file));
        let mut named = Self {
            node,
            name,
            path: PathBuf::new(),
            dataset,
        };
        named.path = found.map_err(|why| named.refused(&why, why.help()))?;
        Ok(named)
    }

    /// Returns the error that refuses the file, with advice.
    pub fn refused(&self, why: &dyn std::fmt::Display, help: &str) -> InputError {
        let refusal = self.node.error(format!("the file {}: {why}", self.name));
        match help {
            "" => refusal,
            help => refusal.help(help),
        }
    }
}
