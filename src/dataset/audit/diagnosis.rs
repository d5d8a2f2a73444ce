//! What is wrong with a label: how the stored field comes of the true one.

use deaflow_field::Field;
use deaflow_pattern::{Symmetries, Symmetry};

/// A field that is so close to a changed truth, relative to its own size, is that.
const ALIKE: f64 = 0.02;

/// How a stored field differs from the simulated one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The truth with its sign flipped.
    Sign,
    /// The truth times a number.
    Scale(f64),
    /// The truth with its components turned and its places not, or the other way round.
    Rotation,
    /// The truth of another image of the pattern.
    Frame,
    /// Something else.
    Other,
}

impl Fault {
    /// The name of the check that finds it.
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

/// The number a by which a·`truth` comes closest to `stored`, and the part of `stored` that is still missed.
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

/// Tells how `stored` comes of `truth` on a membrane of these symmetries.
#[must_use]
pub fn diagnose(stored: &Field, truth: &Field, symmetries: Symmetries) -> Fault {
    let (ratio, rest) = fit(stored, truth);
    if rest < ALIKE {
        if (ratio + 1.0).abs() < ALIKE {
            return Fault::Sign;
        }
        // A number near 1 explains nothing.
        return if (ratio - 1.0).abs() > rest {
            Fault::Scale(ratio)
        } else {
            Fault::Other
        };
    }
    let is = |other: &Field| {
        let (ratio, rest) = fit(stored, other);
        rest < ALIKE && (ratio - 1.0).abs() < ALIKE
    };
    let others = || symmetries.iter().skip(1);
    if others().any(|g| is(&truth.transformed(g))) {
        return Fault::Frame;
    }
    if others().any(|g| is(&components(truth, g)) || is(&components(&truth.transformed(g), g.inverse()))) {
        return Fault::Rotation;
    }
    Fault::Other
}

/// The field with its components turned and its places left.
fn components(field: &Field, g: Symmetry) -> Field {
    let turned = field
        .values()
        .chunks_exact(2)
        .flat_map(|u| g.apply_vector([u[0], u[1]]));
    Field::from_values(field.raster(), turned.collect()).unwrap_or_else(|_| Field::zero(field.raster()))
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
    fn faults_are_told_apart() {
        assert_eq!(diagnosed(&scaled(-1.0)), Fault::Sign);
        let Fault::Scale(ratio) = diagnosed(&scaled(1.03)) else {
            panic!("a scale")
        };
        assert!((ratio - 1.03).abs() < 1e-12);
        for g in &Symmetry::ALL[1..] {
            let moved = components(&field().transformed(*g), g.inverse());
            // Half a turn of the components alone is a change of sign.
            let (expected, turned) = match g.index() {
                2 => (Fault::Sign, components(&field(), *g)),
                _ => (Fault::Rotation, components(&field(), *g)),
            };
            assert_eq!(diagnosed(&moved), Fault::Rotation, "{g:?}");
            assert_eq!(diagnosed(&turned), expected, "{g:?}");
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
