//! The device of a dataset, against which its patterns and fields are checked.

use deaflow_field::Field;
use deaflow_pattern::{Bits, Membrane, Part, Parts, PatternForm, Polygons, Raster, Symmetries};

/// Smallest size in bytes of a row of the source paper's membrane. DEFLATE, the densest filter, reduces its 20 kB by
/// at most a factor of a thousand.
const BYTES_OF_ROW: u64 = 16;

/// Returns whether a file of `bytes` bytes is too small for `rows` rows.
#[must_use]
pub fn is_overlong(rows: u64, raster: Raster, bytes: u64) -> bool {
    let [own, paper] = [raster, Raster::PAPER].map(|raster| raster.corners() as u64);
    rows.saturating_mul(own) > (bytes / BYTES_OF_ROW).saturating_mul(paper)
}

/// The device of a dataset.
#[derive(Clone, Debug)]
pub struct Device {
    /// Its rectangle.
    pub membrane: Membrane,
    /// Number of electrode groups.
    pub groups: usize,
    /// Its symmetries.
    pub symmetries: Symmetries,
    /// The cells that may carry electrodes; `None` without frame and bodies.
    pub free: Option<Bits>,
    /// Whether each corner is on the frame.
    on_frame: Vec<bool>,
}

impl Device {
    /// Creates a device. Without `parts` all cells are membrane, clamped at the edges.
    #[must_use]
    pub fn new(membrane: Membrane, groups: usize, symmetries: Symmetries, parts: Option<&Parts>) -> Self {
        Self::within(membrane, groups, symmetries, parts, None)
    }

    /// Creates a device in whose frame elements follow the border of an opening: corners of its cells may move.
    #[must_use]
    pub fn within(
        membrane: Membrane,
        groups: usize,
        symmetries: Symmetries,
        parts: Option<&Parts>,
        opening: Option<&Polygons>,
    ) -> Self {
        let [columns, rows] = membrane.raster.corner_sides();
        let [width, height] = membrane.cell_mm();
        let is_free =
            |x: usize, y: usize| opening.is_some_and(|opening| opening.contains([x as f64 * width, y as f64 * height]));
        let is_on_frame = |x: usize, y: usize| match parts {
            Some(parts) => parts.around(x, y).contains(&Part::Frame) && !is_free(x, y),
            None => x == 0 || y == 0 || x == columns - 1 || y == rows - 1,
        };
        let corners = 0..columns * rows;
        Self {
            membrane,
            groups,
            symmetries,
            free: parts.map(Parts::free_cells),
            on_frame: corners.map(|at| is_on_frame(at % columns, at / columns)).collect(),
        }
    }

    /// Lets corners on sides move, but for those of frame cells: `is_free` says so for the low and the high side along
    /// an axis. Corners at which two sides meet move only if both do.
    #[must_use]
    pub fn with_free_sides(mut self, parts: Option<&Parts>, is_free: impl Fn(usize, usize) -> bool) -> Self {
        let last = self.raster().corner_sides().map(|count| count - 1);
        let columns = last[0] + 1;
        let is_framed = |[x, y]: [usize; 2]| {
            let mut around = (x.saturating_sub(1)..=x.min(last[0] - 1))
                .flat_map(|x| (y.saturating_sub(1)..=y.min(last[1] - 1)).map(move |y| (x, y)));
            parts.is_some_and(|parts| around.any(|(x, y)| parts.at(x, y) == Part::Frame))
        };
        for (at, on_frame) in self.on_frame.iter_mut().enumerate() {
            let corner = [at % columns, at / columns];
            let ends = (0..2).flat_map(|axis| (0..2).map(move |end| (axis, end)));
            let mut touched = ends.filter(|(axis, end)| corner[*axis] == end * last[*axis]).peekable();
            let is_on_side = touched.peek().is_some();
            if is_on_side && touched.all(|(axis, end)| is_free(axis, end)) && !is_framed(corner) {
                *on_frame = false;
            }
        }
        self
    }

    /// Returns its cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.membrane.raster
    }

    /// Returns the form of its patterns.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm::on(&self.membrane, self.groups)
    }

    /// Returns whether a corner, given by its index in `[y][x]`, is on the frame.
    ///
    /// # Panics
    /// When there is no such corner.
    #[must_use]
    pub fn is_on_frame(&self, corner: usize) -> bool {
        self.on_frame[corner]
    }

    /// Returns the largest displacement magnitude of a field on the frame in mm.
    #[must_use]
    pub fn max_on_frame(&self, field: &Field) -> f64 {
        let corners = field.values().chunks_exact(2).zip(&self.on_frame);
        let on_frame = corners.filter(|(_, on_frame)| **on_frame);
        on_frame.map(|(u, _)| u[0].hypot(u[1])).fold(0.0, f64::max)
    }

    /// Returns the field with zero displacement on the frame.
    #[must_use]
    pub fn with_fixed_frame(&self, field: &Field) -> Field {
        let values = field.values().iter().enumerate();
        let values = values.map(|(at, &u)| if self.on_frame[at / 2] { 0.0 } else { u });
        Field::from_values(field.raster(), values.collect()).unwrap_or_else(|_| Field::zero(field.raster()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_on_the_frame_are_found() {
        let raster = Raster::new(4, 3).unwrap();
        let membrane = Membrane {
            raster,
            size_mm: [8.0, 3.0],
        };
        let part = |x: usize, _| if x == 0 { Part::Frame } else { Part::Membrane };
        let parts = Parts::new(raster, 0, part).unwrap();
        // The corners of one row, from the left.
        let row = |device: &Device| [5, 6, 7, 8, 9].map(|corner| device.is_on_frame(corner));
        let plain = Device::new(membrane, 1, Symmetries::RECTANGLE, None);
        assert_eq!(row(&plain), [true, false, false, false, true]);
        let framed = Device::new(membrane, 1, Symmetries::RECTANGLE, Some(&parts));
        assert_eq!(row(&framed), [true, true, false, false, true]);
        let mut values = vec![0.0; 2 * raster.corners()];
        values[2 * 7] = 0.5;
        let inner = Field::from_values(raster, values.clone()).unwrap();
        values[2 * 6 + 1] = -0.25;
        let moved = Field::from_values(raster, values).unwrap();
        assert_eq!([&plain, &framed].map(|device| device.max_on_frame(&moved)), [0.0, 0.25]);
        assert_eq!(plain.with_fixed_frame(&moved), moved);
        assert_eq!(framed.with_fixed_frame(&moved), inner);
        // An opening that elements follow ends left of the corners of frame cells at x = 2.
        let opening = |from: f64| Polygons::new(&[vec![[from, 0.0], [8.0, 0.0], [8.0, 3.0], [from, 3.0]]]);
        for (from, is_free) in [(1.5, true), (2.5, false)] {
            let opening = opening(from);
            let fitted = Device::within(membrane, 1, Symmetries::RECTANGLE, Some(&parts), Some(&opening));
            assert_eq!(row(&fitted), [true, !is_free, false, false, true]);
        }
    }
}
