//! The texts from which nodes are read.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::super::quantity::Quantity;

/// A named text: a file, or one `--set` argument.
#[derive(Debug)]
pub struct Source {
    pub(super) name: String,
    pub(super) text: String,
    /// Numbers that were read without a unit although their dimension has units, by their positions.
    bare: Mutex<Vec<((usize, usize), Quantity)>>,
}

impl Source {
    pub(super) fn new(name: String, text: String) -> Self {
        Self {
            name,
            text,
            bare: Mutex::default(),
        }
    }

    /// A single push changes the list, so a panic elsewhere leaves a valid one.
    fn bare(&self) -> MutexGuard<'_, Vec<((usize, usize), Quantity)>> {
        self.bare.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes how a number without a unit was read.
    pub(super) fn note_bare(&self, span: (usize, usize), read: Quantity) {
        let mut bare = self.bare();
        if !bare.contains(&(span, read)) {
            bare.push((span, read));
        }
    }

    /// Returns how the number without a unit at a position was read, if there is one.
    pub(super) fn bare_at(&self, span: (usize, usize)) -> Option<Quantity> {
        self.bare().iter().find(|(at, _)| *at == span).map(|(_, read)| *read)
    }
}
