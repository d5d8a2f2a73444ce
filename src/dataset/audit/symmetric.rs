//! Symmetries of patterns and their fields.
//!
//! To compare the fields of images of a pattern, each field is transformed with its pattern to the smallest image of
//! the orbit. A row keeps random projections of the transformed field instead of the field. The root mean square
//! difference of the projections estimates that of the fields within about a third.

use deaflow_base::{Digest, OrbitId, Stream};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Raster, Symmetries, Symmetry};

/// Number of random projections of a field.
pub const PROJECTIONS: usize = 16;

/// A pattern and its relation to its images.
pub struct PatternSymmetry {
    /// Digest of the pattern.
    pub pattern: Digest,
    /// Orbit of the pattern.
    pub orbit: OrbitId,
    /// The symmetry that maps the pattern to its smallest image.
    pub to_smallest: Symmetry,
    /// The symmetries except the identity that do not change the pattern.
    pub stabiliser: Vec<Symmetry>,
}

impl PatternSymmetry {
    /// Compares a pattern with its images under a group.
    #[must_use]
    pub fn of(pattern: &Pattern, group: Symmetries) -> Self {
        let images: Vec<(Symmetry, Pattern)> = group.iter().map(|g| (g, pattern.transformed(g))).collect();
        let smallest = images.iter().min_by(|(_, a), (_, b)| a.cmp(b));
        let own = images[1..].iter().filter(|(_, image)| image == pattern);
        Self {
            pattern: Digest::of(pattern.cells()),
            orbit: pattern.orbit(group),
            to_smallest: smallest.map_or(Symmetry::IDENTITY, |(g, _)| *g),
            stabiliser: own.map(|(g, _)| *g).collect(),
        }
    }
}

/// Random directions for the projections of fields.
pub struct Projections {
    directions: Vec<Vec<f64>>,
}

impl Projections {
    /// Creates the directions for fields on these cells.
    #[must_use]
    pub fn on(raster: Raster) -> Self {
        let n = 2 * raster.corners();
        let direction = |k| {
            let mut stream = Stream::new(0, "audit projection", k);
            let scale = 1.0 / (n as f64).sqrt();
            let sign = |_| if stream.chance(0.5) { scale } else { -scale };
            (0..n).map(sign).collect()
        };
        Self {
            directions: (0..PROJECTIONS as u64).map(direction).collect(),
        }
    }

    /// Returns the projections of a field in mm. Their root mean square estimates that of a component.
    #[must_use]
    pub fn of(&self, field: &Field) -> [f64; PROJECTIONS] {
        let on = |k: usize| field.values().iter().zip(&self.directions[k]).map(|(u, d)| u * d);
        std::array::from_fn(|k| on(k).sum())
    }
}

/// Estimates the root mean square component of the difference of two fields from their projections, in mm.
#[must_use]
pub fn distance(a: &[f64; PROJECTIONS], b: &[f64; PROJECTIONS]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / PROJECTIONS as f64).sqrt()
}

/// Returns the largest difference in mm between a field and its images under the symmetries of its pattern.
#[must_use]
pub fn asymmetry(field: &Field, stabiliser: &[Symmetry]) -> f64 {
    let differences = stabiliser.iter().map(|&g| field.max_difference(&field.transformed(g)));
    differences.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;

    fn wavy() -> Field {
        let value = |i: usize| ((i * 37 % 101) as f64 - 50.0) / 40.0;
        Field::from_values(Raster::PAPER, (0..CORNERS * CORNERS * 2).map(value).collect()).unwrap()
    }

    #[test]
    fn all_images_have_the_same_smallest_image() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| (3 * x + y * y) % 7 < 3 && x > y / 2);
        let first = PatternSymmetry::of(&pattern, Symmetries::SQUARE);
        assert!(first.stabiliser.is_empty() && first.orbit == pattern.orbit(Symmetries::SQUARE));
        let field = wavy().transformed(first.to_smallest);
        for g in Symmetry::ALL {
            let image = PatternSymmetry::of(&pattern.transformed(g), Symmetries::SQUARE);
            assert_eq!(image.orbit, first.orbit);
            assert_eq!(wavy().transformed(g).transformed(image.to_smallest), field);
        }
    }

    #[test]
    fn the_distance_of_projections_estimates_that_of_fields() {
        let (a, zero) = (wavy(), Field::zero(Raster::PAPER));
        let projections = Projections::on(Raster::PAPER);
        let found = distance(&projections.of(&a), &projections.of(&zero));
        let exact = a.rms_difference(&zero);
        assert!((found / exact - 1.0).abs() < 0.5, "{found} {exact}");
        assert_eq!(distance(&projections.of(&a), &projections.of(&a)), 0.0);
    }

    #[test]
    fn a_symmetric_pattern_must_have_a_symmetric_field() {
        let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
        let own = PatternSymmetry::of(&half, Symmetries::SQUARE).stabiliser;
        assert_eq!(own.len(), 1);
        assert!(asymmetry(&wavy(), &own) > 0.1);
        assert_eq!(asymmetry(&Field::zero(Raster::PAPER), &own), 0.0);
    }
}
