//! Collects arrays and attributes into an object of the store.

use std::collections::BTreeMap;

use super::declared::Declared;
use crate::store::{Data, Dataset, Object};

/// What has been written so far.
#[derive(Default)]
pub struct Writer {
    attributes: BTreeMap<String, String>,
    arrays: Vec<(Declared, Data)>,
}

impl Writer {
    /// Adds an array.
    pub fn array(&mut self, declared: Declared, data: Data) {
        self.arrays.push((declared, data));
    }

    /// Adds an attribute.
    pub fn attribute(&mut self, name: &str, text: String) {
        self.attributes.insert(name.to_owned(), text);
    }

    /// The object. An array along one axis says how long that is, and the first of several is believed: the store refuses an
    /// array that does not fit the lengths of its axes. An axis of tables alone is as long as their numbers make it.
    #[must_use]
    pub fn finish(self) -> Object {
        let lengths = self.lengths();
        let dataset = |(declared, data): (Declared, Data)| {
            let free = declared.free_axes().iter();
            let free = free.map(|axis| lengths.get(axis).copied().unwrap_or_default());
            let shape: Vec<usize> = free.chain(declared.extents.iter().copied()).collect();
            let dataset = Dataset::new(declared.units, &declared.description, &shape, data);
            let dataset = Dataset {
                axes: declared.axes,
                ..dataset
            };
            (declared.path, dataset)
        };
        Object {
            attributes: self.attributes,
            datasets: self.arrays.into_iter().map(dataset).collect(),
            ..Object::default()
        }
    }

    fn lengths(&self) -> BTreeMap<String, usize> {
        let mut lengths: BTreeMap<String, usize> = BTreeMap::new();
        for free in [1, 2] {
            for (declared, data) in self.arrays.iter().filter(|(array, _)| array.free_axes().len() == free) {
                let (known, unknown): (Vec<&String>, Vec<&String>) = declared
                    .free_axes()
                    .iter()
                    .partition(|axis| lengths.contains_key(*axis));
                if let [axis] = unknown[..] {
                    let row: usize = known.iter().map(|axis| lengths[*axis]).product();
                    let row = row * declared.extents.iter().product::<usize>();
                    let length = data.len().checked_div(row).unwrap_or_default();
                    lengths.insert(axis.clone(), length);
                }
            }
        }
        lengths
    }
}
