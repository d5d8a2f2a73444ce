//! Documents that other documents name.

use std::path::Path;

use super::error::InputError;
use super::node::Node;
use super::parse::Document;
use crate::confined::{ConfinedError, confined};

impl Document {
    /// Reads the file that `node` names. It is of the kind `what`, as in "scene"; its path is relative to `folder`, the
    /// folder of the `owner`, as in "pipeline".
    ///
    /// # Errors
    /// If it does not exist, is outside that folder (after resolving links), or is not valid.
    pub fn beside(node: &Node, folder: &Path, what: &str, owner: &str) -> Result<Self, InputError> {
        let named = Path::new(node.text(what)?);
        let file = folder.join(named);
        // The document of another person must not read files elsewhere.
        match confined(folder, named) {
            Ok(_) => Self::load(&file),
            Err(ConfinedError::Missing) => Err(node
                .error(format!("the {what} file {} does not exist", file.display()))
                .help(format!("its path is relative to the file of the {owner}"))),
            Err(ConfinedError::Outside) => Err(node
                .error(format!(
                    "the {what} file {} is outside the folder of the {owner}",
                    named.display()
                ))
                .help(format!(
                    "put it into the folder of the {owner} or a subfolder, not behind a link"
                ))),
        }
    }
}
