//! The symmetries of patterns and of their fields.
//!
//! Fields of images of one pattern are compared in the frame of the orbit's smallest image. A row keeps some random
//! projections of its field there instead of the field: their root mean square difference is, but for a third, that of the
//! fields, whatever these are.

use deaflow_base::{Digest, OrbitId, Stream};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Raster, Symmetries, Symmetry};

/// Random projections of a field.
pub const PROJECTIONS: usize = 16;

/// A pattern among its images.
pub struct Standing {
    /// Identity of the pattern.
    pub pattern: Digest,
    /// Identity that it shares with its images.
    pub orbit: OrbitId,
    /// What carries it to the smallest of them.
    pub to_smallest: Symmetry,
    /// The symmetries, apart from the identity, that leave it as it is.
    pub stabiliser: Vec<Symmetry>,
}

impl Standing {
    /// Compares a pattern with its images under a group.
    #[must_use]
    pub fn of(pattern: &Pattern, group: Symmetries) -> Self {
        let images: Vec<(Symmetry, Pattern)> = group.iter().map(|g| (g, pattern.transformed(g))).collect();
        let mut smallest = 0;
        for k in 1..images.len() {
            if images[k].1 < images[smallest].1 {
                smallest = k;
            }
        }
        let own = images[1..].iter().filter(|(_, image)| image == pattern);
        Self {
            pattern: Digest::of(pattern.cells()),
            orbit: pattern.orbit(group),
            to_smallest: images[smallest].0,
            stabiliser: own.map(|(g, _)| *g).collect(),
        }
    }
}

/// Random directions that fields on some cells are projected on.
pub struct Projections {
    directions: Vec<Vec<f64>>,
}

impl Projections {
    /// Those of fields on these cells.
    #[must_use]
    pub fn on(raster: Raster) -> Self {
        let n = 2 * raster.corners();
        let direction = |k| {
            let mut stream = Stream::new(0, "audit projection", k);
            let scale = 1.0 / (n as f64).sqrt();
            (0..n)
                .map(|_| if stream.chance(0.5) { scale } else { -scale })
                .collect()
        };
        Self {
            directions: (0..PROJECTIONS as u64).map(direction).collect(),
        }
    }

    /// The projections of a field, in mm: root mean square of a component times deviates of variance 1.
    #[must_use]
    pub fn of(&self, field: &Field) -> [f64; PROJECTIONS] {
        let on = |k: usize| field.values().iter().zip(&self.directions[k]).map(|(u, d)| u * d);
        std::array::from_fn(|k| on(k).sum())
    }
}

/// The root mean square component of the difference of two fields, estimated from their projections, in mm.
#[must_use]
pub fn distance(a: &[f64; PROJECTIONS], b: &[f64; PROJECTIONS]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / PROJECTIONS as f64).sqrt()
}

/// How far a field is from having the symmetries of its pattern, in mm.
#[must_use]
pub fn asymmetry(field: &Field, stabiliser: &[Symmetry]) -> f64 {
    let far = |&g| field.max_difference(&field.transformed(g));
    stabiliser.iter().map(far).fold(0.0, f64::max)
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
    fn images_meet_in_the_smallest() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| (3 * x + y * y) % 7 < 3 && x > y / 2);
        let first = Standing::of(&pattern, Symmetries::SQUARE);
        assert!(first.stabiliser.is_empty() && first.orbit == pattern.orbit(Symmetries::SQUARE));
        let field = wavy().transformed(first.to_smallest);
        for g in Symmetry::ALL {
            let image = Standing::of(&pattern.transformed(g), Symmetries::SQUARE);
            assert_eq!(image.orbit, first.orbit);
            assert_eq!(wavy().transformed(g).transformed(image.to_smallest), field);
        }
    }

    #[test]
    fn the_distance_of_projections_is_that_of_fields() {
        let (a, zero) = (wavy(), Field::zero(Raster::PAPER));
        let projections = Projections::on(Raster::PAPER);
        let found = distance(&projections.of(&a), &projections.of(&zero));
        let exact = a.rms_difference(&zero);
        assert!((found / exact - 1.0).abs() < 0.5, "{found} {exact}");
        assert_eq!(distance(&projections.of(&a), &projections.of(&a)), 0.0);
    }

    #[test]
    fn a_symmetric_pattern_wants_a_symmetric_field() {
        let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
        let own = Standing::of(&half, Symmetries::SQUARE).stabiliser;
        assert_eq!(own.len(), 1);
        assert!(asymmetry(&wavy(), &own) > 0.1);
        assert_eq!(asymmetry(&Field::zero(Raster::PAPER), &own), 0.0);
    }
}
