//! Collects arrays and attributes into an object of the store.

use std::collections::BTreeMap;

use super::declared::Declared;
use super::element::RASTER_AXES;
use deaflow_pattern::Raster;
use deaflow_store::{Data, Dataset, Object};

/// What has been written so far.
#[derive(Default)]
pub struct Writer {
    attributes: BTreeMap<String, String>,
    arrays: Vec<(Declared, Data)>,
    raster: Option<Raster>,
}

impl Writer {
    /// Adds an array.
    pub fn array(&mut self, declared: Declared, data: Data) {
        self.arrays.push((declared, data));
    }

    /// Says on what the arrays stand that stand on cells or their corners; the first of several is believed, as of other lengths.
    pub fn on(&mut self, raster: Raster) {
        self.raster.get_or_insert(raster);
    }

    /// Adds an attribute.
    pub fn attribute(&mut self, name: &str, text: String) {
        self.attributes.insert(name.to_owned(), text);
    }

    /// The object. An array along one axis says how long that is, and the first of several is believed: the store refuses an
    /// array that does not fit the lengths of its axes. An axis of tables alone is as long as their numbers make it. Where there is nothing on a
    /// raster, arrays without rows have that of the source paper.
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
        let raster = self.raster.unwrap_or(Raster::PAPER);
        let axes = RASTER_AXES.into_iter().flatten();
        let [columns, rows] = raster.sides();
        let sides = [rows, columns, rows + 1, columns + 1];
        let mut lengths: BTreeMap<String, usize> = axes.map(str::to_owned).zip(sides).collect();
        let own = |array: &Declared| {
            let axes = array.free_axes().iter();
            axes.filter(|axis| !RASTER_AXES.as_flattened().contains(&axis.as_str()))
                .count()
        };
        for free in [1, 2, 3] {
            for (declared, data) in self.arrays.iter().filter(|(array, _)| own(array) == free) {
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
