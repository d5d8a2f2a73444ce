//! Collects arrays and attributes into an object for the store.

use std::collections::BTreeMap;

use super::declared::Declared;
use super::element::RASTER_AXES;
use deaflow_pattern::Raster;
use deaflow_store::{Data, Dataset, Object};

/// The arrays and attributes written so far.
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

    /// Sets the raster of arrays on cells or their corners. The first call counts.
    pub fn set_raster(&mut self, raster: Raster) {
        self.raster.get_or_insert(raster);
    }

    /// Adds an attribute.
    pub fn attribute(&mut self, name: &str, text: String) {
        self.attributes.insert(name.to_owned(), text);
    }

    /// Returns the object. The length of an axis is that of the first array along this axis alone; if there is none, it
    /// follows from the number of values of arrays along several axes. The store refuses arrays that do not fit these
    /// lengths. Without any raster, empty arrays get that of the source paper.
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
