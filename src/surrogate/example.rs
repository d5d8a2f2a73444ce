//! Training examples and their labels.

use std::borrow::Cow;
use std::sync::Arc;

use super::corners::{Corners, inner_sides};
use deaflow_dataset::Split;
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Raster, Symmetry};

/// A pattern with its simulated field.
#[derive(Clone, Debug)]
pub struct Example {
    /// The pattern.
    pub pattern: Pattern,
    /// Its displacement.
    pub label: Label,
    /// The family of the pattern; metrics are computed per family.
    pub family: String,
    /// The split.
    pub split: Split,
    /// How many times an epoch uses the example, at least 1.
    pub repeats: u32,
}

/// A displacement field in mm at the corners that a network predicts, `[y][x][component]`, in single precision. Images
/// of a field under symmetries share its memory.
#[derive(Clone, Debug)]
pub struct Label {
    /// Corners of the stored field.
    corners: Corners,
    values: Arc<[f32]>,
    /// The label is the image of the stored field under this symmetry.
    symmetry: Symmetry,
}

impl PartialEq for Label {
    fn eq(&self, other: &Self) -> bool {
        self.raster() == other.raster() && self.values() == other.values()
    }
}

/// Why values are not a label.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LabelError {
    /// The number of values is wrong.
    #[error("a field on {raster} cells has {} values, found {found}", 2 * raster.corners())]
    Shape {
        /// The cells.
        raster: Raster,
        /// The number of values.
        found: usize,
    },
    /// A displacement is infinite or NaN.
    #[error("a displacement is {0}")]
    NotFinite(f64),
    /// The frame moves.
    #[error("the frame moves by {0} mm")]
    Frame(f64),
}

/// Largest displacement of the frame in mm that counts as rounding of single precision.
const STILL_MM: f64 = 1e-6;

impl Label {
    /// Creates a label of a device whose sides are held from the values of a field in mm, two for each corner.
    ///
    /// # Errors
    /// As [`Label::at`].
    pub fn from_values(raster: Raster, values: &[f64]) -> Result<Self, LabelError> {
        Self::at(Corners::inner(raster), values)
    }

    /// Creates a label from the values of a field from rest in mm, two for each corner of the device.
    ///
    /// # Errors
    /// When the count is wrong, a value is not finite in single precision, or a side moves where it is held.
    pub fn at(corners: Corners, values: &[f64]) -> Result<Self, LabelError> {
        let raster = corners.raster();
        if values.len() != 2 * raster.corners() {
            let found = values.len();
            return Err(LabelError::Shape { raster, found });
        }
        let [across, _] = raster.corner_sides();
        let mut kept = Vec::with_capacity(2 * corners.count());
        for (at, &value) in values.iter().enumerate() {
            if !(value as f32).is_finite() {
                return Err(LabelError::NotFinite(value));
            }
            let corner = [at / 2 % across, at / 2 / across];
            let is_held = corners.holds(corner, at % 2);
            if is_held && value.abs() > STILL_MM {
                return Err(LabelError::Frame(value));
            }
            if corners.has(corner) {
                kept.push(if is_held { 0.0 } else { value as f32 });
            }
        }
        Ok(Self {
            corners,
            values: kept.into(),
            symmetry: Symmetry::IDENTITY,
        })
    }

    /// Creates a label that is zero everywhere.
    #[must_use]
    pub fn zero(raster: Raster) -> Self {
        Self::from(&Field::zero(raster))
    }

    /// Returns the cells of the field.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.corners.raster().transformed(self.symmetry)
    }

    /// Returns the displacements in mm at the corners that a network predicts, `[y][x][component]`.
    #[must_use]
    pub fn values(&self) -> Cow<'_, [f32]> {
        if self.symmetry == Symmetry::IDENTITY {
            return Cow::Borrowed(&self.values);
        }
        let mut values = vec![0.0; self.values.len()];
        let [[a, b], [c, d]] = self.symmetry.matrix().map(|row| row.map(|entry| entry as f32));
        let to = self.symmetry.permutation(self.corners.sides());
        for (u, to) in self.values.chunks_exact(2).zip(to) {
            values[2 * to] = a * u[0] + b * u[1];
            values[2 * to + 1] = c * u[0] + d * u[1];
        }
        Cow::Owned(values)
    }

    /// Returns the sum of the squared components, mm².
    #[must_use]
    pub fn squares(&self) -> f64 {
        self.values().iter().map(|u| f64::from(*u).powi(2)).sum()
    }

    /// Returns the largest displacement magnitude in mm.
    #[must_use]
    pub fn max_magnitude(&self) -> f64 {
        let corners = self.values.chunks_exact(2);
        let lengths = corners.map(|u| f64::from(u[0]).hypot(f64::from(u[1])));
        lengths.fold(0.0, f64::max)
    }

    /// Returns the image under a symmetry, as [`Field::transformed`]: `(gu)(gX) = g·u(X)`. It shares the memory.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        Self {
            corners: self.corners,
            values: Arc::clone(&self.values),
            symmetry: g.compose(self.symmetry),
        }
    }

    /// Returns the same label in the memory of `other`, when it is the image of `other` under `g`.
    #[must_use]
    pub(crate) fn sharing(self, other: &Self, g: Symmetry) -> Self {
        let image = other.transformed(g);
        if image == self { image } else { self }
    }

    /// Returns whether two labels share their memory.
    #[cfg(test)]
    pub(crate) fn shares_memory_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.values, &other.values)
    }
}

impl From<&Field> for Label {
    /// Ignores displacements on the frame.
    fn from(field: &Field) -> Self {
        let raster = field.raster();
        let ([columns, _], [_, rows]) = (raster.sides(), inner_sides(raster));
        let rows = field.values().chunks_exact(2 * (columns + 1)).skip(1).take(rows);
        let values = rows.flat_map(|row| &row[2..2 * columns]).map(|u| *u as f32);
        Self {
            corners: Corners::inner(raster),
            values: values.collect(),
            symmetry: Symmetry::IDENTITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::INNER;
    use deaflow_field::CORNERS;

    fn wavy() -> Vec<f64> {
        let value = |at: usize| {
            let (x, y) = (at / 2 % CORNERS, at / 2 / CORNERS);
            let inside = (1..=INNER).contains(&x) && (1..=INNER).contains(&y);
            if inside {
                ((at * 37 % 101) as f64 - 50.0) / 32.0
            } else {
                0.0
            }
        };
        (0..CORNERS * CORNERS * 2).map(value).collect()
    }

    #[test]
    fn a_label_holds_the_inner_corners_of_its_field() {
        let field = Field::from_values(Raster::PAPER, wavy()).unwrap();
        let label = Label::from_values(Raster::PAPER, field.values()).unwrap();
        assert_eq!(label, Label::from(&field));
        assert_eq!(label.values().len(), INNER * INNER * 2);
        let [ux, uy] = field.at_corner(7, 3);
        let at = 2 * (2 * INNER + 6);
        assert_eq!([label.values()[at], label.values()[at + 1]].map(f64::from), [ux, uy]);
        assert_eq!(label.max_magnitude(), field.max_magnitude());
        let still = Field::zero(Raster::PAPER);
        let count = field.values().len() as f64;
        assert!((label.squares() / count - field.rms_difference(&still).powi(2)).abs() < 1e-12);
    }

    #[test]
    fn symmetries_act_as_on_fields() {
        let raster = Raster::new(7, 4).unwrap();
        let values = (0..2 * raster.corners()).map(|at| (at * 37 % 101) as f64);
        for field in [
            Field::from_values(Raster::PAPER, wavy()).unwrap(),
            Field::from_values(raster, values.collect()).unwrap(),
        ] {
            for g in Symmetry::ALL {
                assert_eq!(Label::from(&field).transformed(g), Label::from(&field.transformed(g)));
            }
        }
    }

    #[test]
    fn labels_of_devices_with_free_sides_hold_all_corners() {
        let raster = Raster::new(6, 3).unwrap();
        let corners = Corners::all(raster, [[true; 2], [false, true], [false; 2], [false; 2]]);
        let value = |at: usize, c: usize| match (at % 7, c) {
            (0, _) | (6, 1) => 0.0,
            _ => ((2 * at + c) * 37 % 101) as f64,
        };
        let values: Vec<f64> = (0..2 * raster.corners()).map(|i| value(i / 2, i % 2)).collect();
        let label = Label::at(corners, &values).unwrap();
        let field = Field::from_values(raster, values.clone()).unwrap();
        assert_eq!(label.values().len(), values.len());
        assert_eq!(label.max_magnitude(), field.max_magnitude());
        // A mirror along y keeps the sides.
        let mirror = Symmetry::ALL
            .into_iter()
            .find(|g| g.matrix() == [[1, 0], [0, -1]])
            .unwrap();
        let image = Label::at(corners, field.transformed(mirror).values()).unwrap();
        assert_eq!(label.transformed(mirror), image);
        for at in [0, 1, 13] {
            let mut moved = values.clone();
            moved[at] = 0.5;
            assert_eq!(Label::at(corners, &moved), Err(LabelError::Frame(0.5)), "{at}");
        }
    }

    #[test]
    fn images_share_the_memory_of_their_field() {
        let raster = Raster::new(7, 4).unwrap();
        let values = (0..2 * raster.corners()).map(|at| (at * 37 % 101) as f64);
        let field = Field::from_values(raster, values.collect()).unwrap();
        let first = Label::from(&field.transformed(Symmetry::ALL[3]));
        for g in Symmetry::ALL {
            let image = Label::from(&field.transformed(g));
            let of_first = g.compose(Symmetry::ALL[3].inverse());
            let shared = image.clone().sharing(&first, of_first);
            assert!(shared == image && Arc::ptr_eq(&shared.values, &first.values));
            let other = Label::zero(raster.transformed(g));
            assert!(!Arc::ptr_eq(
                &other.clone().sharing(&first, of_first).values,
                &first.values
            ));
        }
    }

    #[test]
    fn invalid_values_are_refused() {
        let with = |at: usize, value: f64| {
            let mut values = wavy();
            values[at] = value;
            Label::from_values(Raster::PAPER, &values)
        };
        let inside = 2 * (CORNERS + 1);
        assert!(matches!(with(inside, f64::NAN), Err(LabelError::NotFinite(v)) if v.is_nan()));
        assert_eq!(with(inside, 1e300), Err(LabelError::NotFinite(1e300)));
        assert_eq!(with(0, 0.01), Err(LabelError::Frame(0.01)));
        let found = Label::from_values(Raster::PAPER, &[0.0; 3]);
        assert!(matches!(found, Err(LabelError::Shape { found: 3, .. })));
        assert!(with(inside, 1.0).is_ok() && with(0, 1e-9).is_ok());
    }
}
