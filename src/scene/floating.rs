//! The motions of a membrane as a whole that neither sides nor bodies resist.
//!
//! Without dead loads along such a motion the energy does not depend on it, so that a part of the displacement is not
//! determined. Dead loads that are balanced resist a turn once the membrane is displaced, but no translation.

use super::leads::Edge;
use super::sides::Sides;

/// The motions of a membrane as a whole that nothing resists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Floating {
    /// Whether it moves along x and y.
    pub along: [bool; 2],
    /// What it turns about, if it turns.
    pub turn: Option<Pivot>,
}

/// What a membrane can turn about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pivot {
    /// Any point.
    Any,
    /// The centroid of a body.
    Body(usize),
    /// The middle of a bar.
    Bar(Edge),
}

/// What acts on a body.
pub(super) struct LoadedBody {
    pub centroid: [f64; 2],
    /// In N along x and y.
    pub load: [f64; 2],
    /// Whether a spring acts along x, and along y.
    pub is_sprung: [bool; 2],
}

const TURNS: &str = "nothing keeps the membrane from turning";

/// Share of the size of all loads, and of their moments, that counts as none.
const ROUNDING: f64 = 1e-9;

/// A place where a component of the displacement is held.
#[derive(Clone, Copy)]
struct Hold {
    axis: usize,
    at: [f64; 2],
    pivot: Pivot,
}

impl Floating {
    /// Returns whether all motions are resisted.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Describes them; `None` if all motions are resisted.
    #[must_use]
    pub fn description(&self) -> Option<String> {
        let along = match self.along {
            [true, true] => "along x and y",
            [true, false] => "along x",
            [false, true] => "along y",
            [false, false] => return self.turn.map(|_| TURNS.to_owned()),
        };
        let turn = self.turn.map_or("", |_| ", and nothing keeps it from turning");
        Some(format!("nothing holds the membrane {along}{turn}"))
    }

    /// Finds the motions of a membrane of a size in mm with these sides and bodies.
    ///
    /// # Errors
    /// If loads act along one of them, or a turn is resisted only to second order.
    pub(super) fn of(sides: &Sides, size: [f64; 2], bodies: &[LoadedBody]) -> Result<Self, &'static str> {
        let (holds, is_turn_held) = holds(sides, size, bodies);
        let holds_on = |axis: usize| holds.iter().filter(move |hold| hold.axis == axis);
        let along = [0, 1].map(|axis| holds_on(axis).next().is_none());
        let loads = loads(sides, size, bodies);
        let scale: f64 = loads.iter().map(|(_, [x, y])| x.hypot(*y)).sum();
        let total = |axis: usize| loads.iter().map(|(_, load)| load[axis]).sum::<f64>();
        for (axis, why) in [
            (0, "nothing holds the membrane along x"),
            (1, "nothing holds the membrane along y"),
        ] {
            if along[axis] && total(axis).abs() > ROUNDING * scale {
                return Err(why);
            }
        }
        // A turn moves no place of a component that is held: those along x have one y, those along y one x.
        let [x, y] = [1, 0].map(|axis| {
            let first = holds_on(axis).next().map(|hold| hold.at[1 - axis]);
            let is_one = holds_on(axis).all(|hold| Some(hold.at[1 - axis]) == first);
            (first.unwrap_or(0.5 * size[1 - axis]), is_one)
        });
        if is_turn_held || !x.1 || !y.1 {
            return Ok(Self { along, turn: None });
        }
        let pivot = match holds.split_first() {
            None => Pivot::Any,
            Some((first, others)) if others.iter().all(|hold| hold.at == first.at) => first.pivot,
            // A finite turn changes the distances of the places.
            Some(_) => return Err(TURNS),
        };
        let moment = |([p, q], [f, g]): &([f64; 2], [f64; 2])| (p - x.0) * g - (q - y.0) * f;
        let moments: f64 = loads.iter().map(moment).sum();
        if moments.abs() > ROUNDING * scale * size[0].hypot(size[1]) {
            return Err(TURNS);
        }
        // Balanced loads resist a turn: if they pull, by their places. If they push, the membrane is not stable.
        let turn = (scale == 0.0).then_some(pivot);
        Ok(Self { along, turn })
    }
}

/// Returns what sides, bars and springs hold, and whether they keep the membrane from turning.
fn holds(sides: &Sides, size: [f64; 2], bodies: &[LoadedBody]) -> (Vec<Hold>, bool) {
    let each = bodies.iter().enumerate();
    let mut holds: Vec<Hold> = each
        .flat_map(|(number, body)| {
            let sprung = (0..2).filter(|axis| body.is_sprung[*axis]);
            sprung.map(move |axis| Hold {
                axis,
                at: body.centroid,
                pivot: Pivot::Body(number),
            })
        })
        .collect();
    let mut is_turn_held = false;
    for (edge, side) in sides.iter() {
        let held = match side.bar() {
            Some(bar) => {
                let [x, y, turns] = bar.moves();
                is_turn_held |= !turns;
                [x, y].map(|moves| !moves || bar.spring_n_per_m() > 0.0)
            }
            None => side.holds(edge),
        };
        is_turn_held |= side.bar().is_none() && held.contains(&true);
        holds.extend((0..2).filter(|axis| held[*axis]).map(|axis| Hold {
            axis,
            at: edge.middle(size),
            pivot: Pivot::Bar(edge),
        }));
    }
    (holds, is_turn_held)
}

/// Returns the places in mm and the forces in N of all loads.
fn loads(sides: &Sides, size: [f64; 2], bodies: &[LoadedBody]) -> Vec<([f64; 2], [f64; 2])> {
    let on_bodies = bodies.iter().map(|body| (body.centroid, body.load));
    let on_sides = sides.iter().filter_map(|(edge, side)| {
        let (force, at_mm) = side.force()?;
        let mut at = edge.middle(size);
        at[1 - edge.normal_axis()] += at_mm;
        Some((at, force))
    });
    on_bodies
        .chain(on_sides)
        .filter(|(_, load)| *load != [0.0; 2])
        .collect()
}
