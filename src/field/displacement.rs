//! A displacement field at the cell corners, for any mesh, with the forces of the sides and the charge, and with
//! heights where the membrane leaves its plane.

use deaflow_pattern::{CELLS, Raster, Symmetry};

/// Corners along a side of the source paper's membrane.
pub const CORNERS: usize = CELLS + 1;

/// Displacements in mm at the cell corners, `[y][x][component]`, origin at the lower left.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    raster: Raster,
    values: Vec<f64>,
    reactions: Reactions,
    charge: f64,
    /// One for each corner, or none in the plane.
    heights: Vec<f64>,
    volume: f64,
}

/// The unit of [`Field::charge`].
pub const CHARGE_UNIT: &str = "nC";

/// The unit of [`Reactions`].
pub const REACTION_UNIT: &str = "mN";

/// Forces in mN along x and y of the left, right, lower and upper side.
pub type Reactions = [[f64; 2]; 4];

/// The normals of these sides.
const NORMALS: [[f64; 2]; 4] = [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]];

/// Values that are not a field.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// The wrong number of values.
    #[error("a field on {raster} cells needs {} values, found {found}", 2 * raster.corners())]
    Shape {
        /// The cells.
        raster: Raster,
        /// The number of values.
        found: usize,
    },
    /// The wrong number of heights.
    #[error("a field on {raster} cells needs {} heights, found {found}", raster.corners())]
    Heights {
        /// The cells.
        raster: Raster,
        /// The number of heights.
        found: usize,
    },
    /// An infinity or NaN.
    #[error("value {at} of the field is not finite")]
    NotFinite {
        /// The position in the array.
        at: usize,
    },
}

impl Field {
    /// Returns the corner (column, row) with the largest displacement, the first of equal ones.
    #[must_use]
    pub fn most_moved(&self) -> [usize; 2] {
        let square = |at: usize| {
            let planar = self.values[2 * at].powi(2) + self.values[2 * at + 1].powi(2);
            planar + self.height(at).powi(2)
        };
        let larger = |best: usize, at: usize| if square(at) > square(best) { at } else { best };
        let at = (0..self.raster.corners()).fold(0, larger);
        let [columns, _] = self.raster.corner_sides();
        [at % columns, at / columns]
    }

    /// Extrapolates beyond this field: u + factor · (u − from).
    #[must_use]
    pub fn extrapolated(&self, from: &Self, factor: f64) -> Self {
        let pairs = self.values.iter().zip(&from.values);
        let beyond = |own: f64, other: f64| own + factor * (own - other);
        Self {
            raster: self.raster,
            values: pairs.map(|(own, other)| beyond(*own, *other)).collect(),
            reactions: combined(&self.reactions, &from.reactions, beyond),
            charge: beyond(self.charge, from.charge),
            heights: combined_heights(&self.heights, &from.heights, beyond),
            volume: beyond(self.volume, from.volume),
        }
    }

    /// Returns the field times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            raster: self.raster,
            values: self.values.iter().map(|value| factor * value).collect(),
            reactions: self.reactions.map(|force| force.map(|value| factor * value)),
            charge: factor * self.charge,
            heights: self.heights.iter().map(|height| factor * height).collect(),
            volume: factor * self.volume,
        }
    }

    /// Returns the sum with a multiple of a field on the same corners.
    #[must_use]
    pub fn plus(&self, factor: f64, other: &Self) -> Self {
        let pairs = self.values.iter().zip(&other.values);
        let sum = |own: f64, other: f64| own + factor * other;
        Self {
            raster: self.raster,
            values: pairs.map(|(own, other)| sum(*own, *other)).collect(),
            reactions: combined(&self.reactions, &other.reactions, sum),
            charge: sum(self.charge, other.charge),
            heights: combined_heights(&self.heights, &other.heights, sum),
            volume: sum(self.volume, other.volume),
        }
    }

    /// Returns the zero field.
    #[must_use]
    pub fn zero(raster: Raster) -> Self {
        Self {
            raster,
            values: vec![0.0; 2 * raster.corners()],
            reactions: Reactions::default(),
            charge: 0.0,
            heights: Vec::new(),
            volume: 0.0,
        }
    }

    /// Sets the change of the forces of the sides on the membrane from rest.
    #[must_use]
    pub fn with_reactions(self, reactions: Reactions) -> Self {
        Self { reactions, ..self }
    }

    /// The change of the forces of the sides on the membrane from rest; zero if it is not known, as in files.
    #[must_use]
    pub fn reactions(&self) -> &Reactions {
        &self.reactions
    }

    /// Sets the charge on the electrodes in nC.
    #[must_use]
    pub fn with_charge(self, charge: f64) -> Self {
        Self { charge, ..self }
    }

    /// The charge on the electrodes in nC; zero if it is not known, as in files and where it was not asked for.
    #[must_use]
    pub fn charge(&self) -> f64 {
        self.charge
    }

    /// Sets the displacements out of the plane in mm, `[y][x]`, and the volume between membrane and plane in ml.
    ///
    /// # Errors
    /// When the number of heights is wrong, or one is not finite.
    pub fn in_space(self, heights: Vec<f64>, volume: f64) -> Result<Self, FieldError> {
        let raster = self.raster;
        if heights.len() != raster.corners() {
            let found = heights.len();
            return Err(FieldError::Heights { raster, found });
        }
        let all = heights.iter().copied().chain([volume]);
        match all.enumerate().find(|(_, value)| !value.is_finite()) {
            Some((at, _)) => Err(FieldError::NotFinite { at }),
            None => Ok(Self {
                heights,
                volume,
                ..self
            }),
        }
    }

    /// All displacements out of the plane in mm, `[y][x]`; none of a membrane that stays in its plane.
    #[must_use]
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// The volume between the membrane and its plane in ml; zero in the plane.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns the displacement out of the plane in mm at a corner, by its index in `[y][x]`; zero in the plane.
    #[must_use]
    pub fn height(&self, corner: usize) -> f64 {
        self.heights.get(corner).copied().unwrap_or(0.0)
    }

    /// Returns the displacement out of the plane in mm at a point in cells, as [`Field::at`] does.
    #[must_use]
    pub fn height_at(&self, point_cells: [f64; 2]) -> f64 {
        let weights = Self::interpolation_weights(self.raster, point_cells);
        weights
            .iter()
            .map(|&(corner, weight)| self.height(corner) * weight)
            .sum()
    }

    /// Creates a field from its values in mm, two for each corner.
    ///
    /// # Errors
    /// When the number of values is wrong or a value is not finite.
    pub fn from_values(raster: Raster, values: Vec<f64>) -> Result<Self, FieldError> {
        if values.len() != 2 * raster.corners() {
            let found = values.len();
            return Err(FieldError::Shape { raster, found });
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(at) => Err(FieldError::NotFinite { at }),
            None => Ok(Self {
                raster,
                values,
                reactions: Reactions::default(),
                charge: 0.0,
                heights: Vec::new(),
                volume: 0.0,
            }),
        }
    }

    /// The cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// All values in mm, `[y][x][component]`.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the displacement in mm at corner (column `x`, row `y`).
    ///
    /// # Panics
    /// When the corner is outside the membrane.
    #[must_use]
    pub fn at_corner(&self, x: usize, y: usize) -> [f64; 2] {
        let [columns, rows] = self.raster.corner_sides();
        assert!(x < columns && y < rows, "corner ({x}, {y}) is outside the membrane");
        let at = 2 * (y * columns + x);
        [self.values[at], self.values[at + 1]]
    }

    /// Returns the displacement in mm at a point in cells from the lower left corner, bilinear between corners. Points
    /// outside are moved to the frame, where the displacement is zero.
    #[must_use]
    pub fn at(&self, point_cells: [f64; 2]) -> [f64; 2] {
        let weights = Self::interpolation_weights(self.raster, point_cells);
        std::array::from_fn(|k| {
            let terms = weights
                .iter()
                .map(|&(corner, weight)| self.values[2 * corner + k] * weight);
            terms.sum()
        })
    }

    /// Returns the four corners around a point in cells, by their index in `[y][x]`, with their weights in bilinear
    /// interpolation.
    #[must_use]
    pub fn interpolation_weights(raster: Raster, point_cells: [f64; 2]) -> [(usize, f64); 4] {
        let [columns, rows] = raster.sides();
        let split = |c: f64, cells: usize| {
            let c = c.clamp(0.0, cells as f64);
            let low = (c.floor() as usize).min(cells - 1);
            (low, c - low as f64)
        };
        let ((i, s), (j, t)) = (split(point_cells[0], columns), split(point_cells[1], rows));
        let above = columns + 1;
        let first = j * above + i;
        [
            (first, (1.0 - s) * (1.0 - t)),
            (first + 1, s * (1.0 - t)),
            (first + above, (1.0 - s) * t),
            (first + above + 1, s * t),
        ]
    }

    /// Returns the largest displacement magnitude of all corners in mm.
    #[must_use]
    pub fn max_magnitude(&self) -> f64 {
        self.magnitudes().fold(0.0, f64::max)
    }

    /// Returns the displacement magnitude of each corner in mm.
    fn magnitudes(&self) -> impl Iterator<Item = f64> {
        let corners = self.values.chunks_exact(2).enumerate();
        corners.map(|(at, u)| u[0].hypot(u[1]).hypot(self.height(at)))
    }

    /// Returns the corner (column, row) with the largest displacement magnitude, the first of equal ones, and the
    /// magnitude in mm.
    #[must_use]
    pub fn largest(&self) -> ([usize; 2], f64) {
        let columns = self.raster.corner_sides()[0];
        let larger = |best: (usize, f64), (at, mm): (usize, f64)| if mm > best.1 { (at, mm) } else { best };
        let (at, mm) = self.magnitudes().enumerate().fold((0, 0.0), larger);
        ([at % columns, at / columns], mm)
    }

    /// Returns the largest magnitude of the difference from `other` at all corners in mm.
    #[must_use]
    pub fn max_difference(&self, other: &Self) -> f64 {
        self.plus(-1.0, other).max_magnitude()
    }

    /// Returns the image under a symmetry, `(gu)(gX) = g·u(X)`; the vectors are transformed too.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let (mut values, mut heights) = (vec![0.0; self.values.len()], vec![0.0; self.heights.len()]);
        let corners = self.values.chunks_exact(2).enumerate();
        for ((at, u), to) in corners.zip(g.permutation(self.raster.corner_sides())) {
            values[2 * to..][..2].copy_from_slice(&g.apply_vector([u[0], u[1]]));
            if let Some(height) = heights.get_mut(to) {
                *height = self.height(at);
            }
        }
        let mut reactions = Reactions::default();
        for (force, normal) in self.reactions.into_iter().zip(NORMALS) {
            let image = g.apply_vector(normal);
            if let Some(side) = NORMALS.iter().position(|other| *other == image) {
                reactions[side] = g.apply_vector(force);
            }
        }
        let raster = self.raster.transformed(g);
        Self {
            raster,
            values,
            reactions,
            charge: self.charge,
            heights,
            volume: self.volume,
        }
    }

    /// Returns the root mean square over all components of the difference from `other` in mm.
    #[must_use]
    pub fn rms_difference(&self, other: &Self) -> f64 {
        let difference = self.plus(-1.0, other);
        let all = difference.values.iter().chain(&difference.heights);
        let sum: f64 = all.map(|value| value.powi(2)).sum();
        (sum / (difference.values.len() + difference.heights.len()) as f64).sqrt()
    }
}

/// Combines two sets of forces number by number.
fn combined(one: &Reactions, other: &Reactions, with: impl Fn(f64, f64) -> f64) -> Reactions {
    std::array::from_fn(|side| std::array::from_fn(|c| with(one[side][c], other[side][c])))
}

/// Combines heights number by number; those of a membrane in its plane are zero.
fn combined_heights(one: &[f64], other: &[f64], with: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let height = |of: &[f64], corner: usize| of.get(corner).copied().unwrap_or(0.0);
    let corners = 0..one.len().max(other.len());
    corners
        .map(|corner| with(height(one, corner), height(other, corner)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rasters() -> [Raster; 3] {
        [(50, 50), (7, 3), (1, 12)].map(|(columns, rows)| Raster::new(columns, rows).unwrap())
    }

    fn wavy(raster: Raster) -> Field {
        let value = |i: usize| ((i * 37 % 101) as f64 - 50.0) / 40.0;
        Field::from_values(raster, (0..2 * raster.corners()).map(value).collect()).unwrap()
    }

    #[test]
    fn symmetries_move_the_point_and_rotate_the_vector() {
        for raster in rasters() {
            let mut values = vec![0.0; 2 * raster.corners()];
            values[0] = 1.0;
            let rotated = Field::from_values(raster, values)
                .unwrap()
                .transformed(Symmetry::ALL[1]);
            assert_eq!(rotated.at_corner(raster.rows(), 0), [0.0, 1.0]);
            for g in Symmetry::ALL {
                let image = wavy(raster).transformed(g);
                assert_eq!(image.transformed(g.inverse()), wavy(raster));
                assert_eq!(image.max_magnitude(), wavy(raster).max_magnitude());
                let ([x, y], mm) = image.largest();
                assert_eq!(mm, image.max_magnitude());
                assert_eq!(image.at_corner(x, y).map(|u| u * u).iter().sum::<f64>().sqrt(), mm);
            }
        }
    }

    #[test]
    fn symmetries_move_the_forces_of_sides() {
        let forces = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]];
        let field = wavy(Raster::PAPER).with_reactions(forces);
        let quarter = field.transformed(Symmetry::ALL[1]);
        // The right side becomes the upper one, and x becomes y.
        assert_eq!(
            *quarter.reactions(),
            [[-8.0, 7.0], [-6.0, 5.0], [-2.0, 1.0], [-4.0, 3.0]]
        );
        for g in Symmetry::ALL {
            assert_eq!(field.transformed(g).transformed(g.inverse()), field);
        }
        let twice = field.plus(1.0, &field);
        assert_eq!(twice, field.scaled(2.0));
        assert_eq!(twice.extrapolated(&field, 1.0).reactions()[3], [21.0, 24.0]);
    }

    #[test]
    fn heights_move_with_the_symmetries_and_combine_with_a_membrane_in_its_plane() {
        for raster in rasters() {
            let heights: Vec<f64> = (0..raster.corners()).map(|i| (i * 29 % 83) as f64).collect();
            let field = wavy(raster).in_space(heights, 1.5).unwrap();
            let corners = raster.corner_sides();
            for g in Symmetry::ALL {
                let image = field.transformed(g);
                assert_eq!(image.transformed(g.inverse()), field);
                assert_eq!((image.max_magnitude(), image.volume()), (field.max_magnitude(), 1.5));
                for (at, to) in g.permutation(corners).enumerate() {
                    assert_eq!(image.height(to), field.height(at));
                }
            }
            let flat = wavy(raster);
            assert_eq!(field.plus(1.0, &field).plus(-1.0, &field), field);
            assert_eq!(
                flat.plus(0.5, &field.plus(-1.0, &flat)).height(3),
                0.5 * field.height(3)
            );
            let raised = field.plus(-1.0, &flat);
            assert_eq!(raised.max_difference(&Field::zero(raster)), raised.max_magnitude());
            assert_eq!(raised.height_at([0.0, 0.0]), field.height(0));
            assert!(raised.largest().1 == raised.max_magnitude() && raised.volume() == 1.5);
            assert!(matches!(
                flat.clone().in_space(vec![0.0], 0.0),
                Err(FieldError::Heights { found: 1, .. })
            ));
            let infinite = vec![f64::INFINITY; raster.corners()];
            assert_eq!(flat.in_space(infinite, 0.0), Err(FieldError::NotFinite { at: 0 }));
        }
    }

    #[test]
    fn interpolation_is_exact_for_bilinear_fields() {
        let f = |x: f64, y: f64| [1.0 + 2.0 * x - y + 0.5 * x * y, x * y];
        for raster in rasters() {
            let above = raster.columns() + 1;
            let values = (0..raster.corners())
                .flat_map(|i| f((i % above) as f64, (i / above) as f64))
                .collect();
            let field = Field::from_values(raster, values).unwrap();
            let [right, top] = raster.sides().map(|side| side as f64);
            for point in [
                [0.0, 0.0],
                [0.245 * right, 0.67 * top],
                [right, top],
                [0.99998 * right, 0.006 * top],
            ] {
                let (u, exact) = (field.at(point), f(point[0], point[1]));
                assert!((u[0] - exact[0]).abs() < 1e-11 && (u[1] - exact[1]).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn wrong_shapes_and_values_that_are_not_finite_are_rejected() {
        let refused = |values| Field::from_values(Raster::PAPER, values).unwrap_err();
        assert_eq!(
            refused(vec![0.0; 3]).to_string(),
            "a field on 50 × 50 cells needs 5202 values, found 3"
        );
        let mut values = vec![0.0; 5202];
        values[5] = f64::NAN;
        assert_eq!(refused(values), FieldError::NotFinite { at: 5 });
    }
}
