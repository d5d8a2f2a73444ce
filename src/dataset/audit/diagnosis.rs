//! Diagnosis of wrong labels: how the stored field differs from the simulated one.

use deaflow_field::Field;
use deaflow_pattern::{Symmetries, Symmetry};

/// Relative difference below which two fields count as equal.
const EQUAL: f64 = 0.02;

/// How a stored field differs from the simulated one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The sign is wrong.
    Sign,
    /// The field is multiplied by this factor.
    Scale(f64),
    /// The components are rotated or mirrored but the corners are not, or the reverse.
    Rotation,
    /// It is the field of another image of the pattern.
    Frame,
    /// Any other difference.
    Other,
}

impl Fault {
    /// Returns the name of the check.
    #[must_use]
    pub fn check(self) -> &'static str {
        match self {
            Self::Sign => "sign",
            Self::Scale(_) => "scale",
            Self::Rotation => "rotation",
            Self::Frame => "frame",
            Self::Other => "label",
        }
    }
}

/// Returns the factor a for which a·`truth` is closest to `stored`, and the relative residual.
#[must_use]
pub fn fit(stored: &Field, truth: &Field) -> (f64, f64) {
    let (mut product, mut square, mut own) = (0.0, 0.0, 0.0);
    for (u, v) in stored.values().iter().zip(truth.values()) {
        product += u * v;
        square += v * v;
        own += u * u;
    }
    if square == 0.0 || own == 0.0 {
        return (0.0, if own == 0.0 { 0.0 } else { 1.0 });
    }
    let ratio = product / square;
    (ratio, ((own - ratio * product).max(0.0) / own).sqrt())
}

/// Determines how `stored` differs from `truth` on a device with these symmetries.
#[must_use]
pub fn diagnose(stored: &Field, truth: &Field, symmetries: Symmetries) -> Fault {
    let (ratio, residual) = fit(stored, truth);
    if residual < EQUAL {
        if (ratio + 1.0).abs() < EQUAL {
            return Fault::Sign;
        }
        // A factor near 1 does not explain the difference.
        return match (ratio - 1.0).abs() > residual {
            true => Fault::Scale(ratio),
            false => Fault::Other,
        };
    }
    let equals = |other: &Field| {
        let (ratio, residual) = fit(stored, other);
        residual < EQUAL && (ratio - 1.0).abs() < EQUAL
    };
    let others = || symmetries.iter().skip(1);
    if others().any(|g| equals(&truth.transformed(g))) {
        return Fault::Frame;
    }
    if others().any(|g| equals(&components(truth, g)) || equals(&components(&truth.transformed(g), g.inverse()))) {
        return Fault::Rotation;
    }
    Fault::Other
}

/// Transforms the components of a field, but not its corners.
fn components(field: &Field, g: Symmetry) -> Field {
    let vectors = field.values().chunks_exact(2);
    let transformed = vectors.flat_map(|u| g.apply_vector([u[0], u[1]])).collect();
    Field::from_values(field.raster(), transformed).unwrap_or_else(|_| Field::zero(field.raster()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;
    use deaflow_pattern::Raster;

    fn field() -> Field {
        let value = |i: usize| {
            let (x, y) = ((i / 2 % CORNERS) as f64 / 50.0, (i / 2 / CORNERS) as f64 / 50.0);
            let bump = x * (1.0 - x) * y * (1.0 - y);
            bump * if i.is_multiple_of(2) { 1.0 + x * y } else { x - 0.3 }
        };
        Field::from_values(Raster::PAPER, (0..CORNERS * CORNERS * 2).map(value).collect()).unwrap()
    }

    fn diagnosed(stored: &Field) -> Fault {
        diagnose(stored, &field(), Symmetries::SQUARE)
    }

    fn scaled(by: f64) -> Field {
        Field::from_values(Raster::PAPER, field().values().iter().map(|u| u * by).collect()).unwrap()
    }

    #[test]
    fn faults_are_distinguished() {
        assert_eq!(diagnosed(&scaled(-1.0)), Fault::Sign);
        let Fault::Scale(ratio) = diagnosed(&scaled(1.03)) else {
            panic!("a scale")
        };
        assert!((ratio - 1.03).abs() < 1e-12);
        for g in &Symmetry::ALL[1..] {
            let moved = components(&field().transformed(*g), g.inverse());
            // A half turn of the components is a change of sign.
            let expected = if g.index() == 2 { Fault::Sign } else { Fault::Rotation };
            assert_eq!(diagnosed(&moved), Fault::Rotation, "{g:?}");
            assert_eq!(diagnosed(&components(&field(), *g)), expected, "{g:?}");
            assert_eq!(diagnosed(&field().transformed(*g)), Fault::Frame, "{g:?}");
        }
        let odd = Field::from_values(Raster::PAPER, field().values().iter().map(|u| u * u).collect()).unwrap();
        assert_eq!(diagnosed(&odd), Fault::Other);
        let mut values = field().values().to_vec();
        values[2 * (25 * CORNERS + 25)] += 1e-3;
        assert_eq!(
            diagnosed(&Field::from_values(Raster::PAPER, values).unwrap()),
            Fault::Other
        );
        assert_eq!(diagnosed(&Field::zero(Raster::PAPER)), Fault::Scale(0.0));
    }
}
