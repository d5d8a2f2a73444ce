//! Leaving the flat state: a first shape under a pressure, or above a volume.
//!
//! Along the solution of Laplace's equation for the load the membrane is in balance at the size at which it holds the
//! load. Forces out of the plane are known to rounding of their own size, however small the load; potentials are not,
//! since they differ by its square.

use super::inflation::{Given, Search, State, combined};
use crate::eigenvalue::dot;
use crate::material::Material;

/// Most sizes at which the pressure is compared.
const MOST_SIZES: u32 = 400;
/// Halvings of the ratio of the sizes between which the pressure is the given one.
const HALVINGS: u32 = 3;
/// Range of tensions, in units of that of a membrane with a large prestretch.
const TENSIONS: [f64; 2] = [1e-9, 1e9];

/// A size of the shape, and the pressure that it holds, or its share of the load.
type Held = (f64, f64);

impl<L: Material> Search<'_, L> {
    /// Leaves the flat state with a load, and notes the tension there for the preconditioner.
    pub(super) fn leave(&mut self, state: &mut State, load: f64) {
        self.tension = 1.0;
        let [mut forces, mut pressed] = [(); 2].map(|()| vec![0.0; state.x.len()]);
        if self.surface.evaluate(&state.x, &mut forces, &mut pressed).is_none() {
            return;
        }
        let (poses, lifts) = (self.surface.poses(&state.x), self.surface.lifts());
        let lifted = self.precondition(&poses, &lifts);
        let (start, shape) = match self.given {
            Given::Volume => (combined(&state.x, 1.0, &lifted), self.precondition(&poses, &pressed)),
            Given::Pressure => (
                state.x.clone(),
                self.precondition(&poses, &combined(&lifts, load, &pressed)),
            ),
        };
        let missing = load - dot(&lifted, &pressed);
        let per_unit = dot(&shape, &pressed);
        let moved = |size: f64| combined(&start, size, &shape);
        let (low, high, size) = match self.given {
            Given::Volume => {
                let mut held = |size: f64| -> Option<Held> {
                    self.surface.evaluate(&moved(size), &mut forces, &mut pressed)?;
                    Some((size, dot(&forces, &shape) / dot(&pressed, &shape)))
                };
                let size = missing / per_unit;
                let ends = [0.5 * size, size].map(&mut held);
                state.pressure = ends[1].map_or(0.0, |(_, pressure)| pressure);
                (ends[0], ends[1], size)
            }
            Given::Pressure => {
                // The share of the pressure and of the forces on bodies that is held.
                let held = |size: f64| -> Option<f64> {
                    self.surface.evaluate(&moved(size), &mut forces, &mut pressed)?;
                    let lifting = dot(&lifts, &shape);
                    Some((dot(&forces, &shape) + lifting) / (load * dot(&pressed, &shape) + lifting))
                };
                let [low, high] = around(held);
                (low, high, high.or(low).map_or(0.0, |(size, _)| size))
            }
        };
        let slope = low.zip(high).map(|(low, high)| (high.1 - low.1) / (high.0 - low.0));
        let secant = high.map(|(size, pressure)| pressure / size);
        let mut known = [slope, secant].into_iter().flatten();
        let tension = known.find(|tension| *tension > 0.0 && tension.is_finite());
        self.tension = tension.unwrap_or(1.0).clamp(TENSIONS[0], TENSIONS[1]);
        state.x = self.surface.settled(moved(size));
    }
}

/// Returns neighbouring sizes of which the first holds less than the load; one of them alone where there is no other.
fn around(mut held: impl FnMut(f64) -> Option<f64>) -> [Option<Held>; 2] {
    let mut at = |size: f64| {
        let found = held(size);
        let is_less = found.is_some_and(|share| share < 1.0);
        (found.map(|share| (size, share)), is_less)
    };
    // From the size of a membrane with the tension of a large prestretch, by factors of two.
    let (mut low, mut high, mut is_bounded) = (None, None, false);
    let mut size = 1.0;
    for _ in 0..MOST_SIZES {
        let (found, is_less) = at(size);
        if is_less {
            low = found;
            size *= 2.0;
        } else {
            high = found;
            is_bounded = true;
            size *= 0.5;
        }
        if low.is_some() && is_bounded {
            break;
        }
    }
    for _ in 0..HALVINGS {
        if let (Some((below, _)), Some((above, _))) = (low, high) {
            match at(below * (above / below).sqrt()) {
                (found, true) => low = found,
                (found, false) => high = found,
            }
        }
    }
    [low, high]
}
