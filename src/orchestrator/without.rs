//! The key `without`: stages and files whose rows a stage leaves out.

use deaflow_base::{Node, is_plain_name};

/// The key that names stages and files whose rows a stage leaves out.
pub const WITHOUT: &str = "without";

/// Whether an item of `without` names a stage; the others name files.
#[must_use]
pub fn names_stage(item: &str) -> bool {
    // The stages of sweeps have an @ in their names.
    item.split('@')
        .next()
        .is_some_and(|base| is_plain_name(base, usize::MAX))
}

/// Returns the files that the key of a stage names.
pub fn named_files(stage: &Node) -> Vec<String> {
    let items = stage.peek(WITHOUT).and_then(|items| items.list(WITHOUT).ok());
    let names = items
        .unwrap_or_default()
        .iter()
        .filter_map(|item| item.text(WITHOUT).ok());
    names.filter(|name| !names_stage(name)).map(str::to_owned).collect()
}
