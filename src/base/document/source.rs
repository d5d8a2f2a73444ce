//! The texts from which nodes are read.

/// A named text: a file, or one `--set` argument.
#[derive(Debug)]
pub struct Source {
    pub(super) name: String,
    pub(super) text: String,
}
