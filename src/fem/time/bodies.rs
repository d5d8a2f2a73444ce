//! Energies of rigid bodies, bars and loaded sides, and the periods of springs.

use std::f64::consts::TAU;

use crate::grid::Grid;
use crate::mass::Mass;
use crate::rigid::{Pose, Rigid};
use crate::sheet::SheetSides;
use crate::stored::Units;

/// Returns the energy of the springs of bodies and bars, and the work of the loads on them and on sides since the
/// mount, in J.
#[must_use]
pub fn energies(units: Units, grid: &Grid, u: &[f64]) -> [f64; 2] {
    let (mut springs, mut work) = (0.0, grid.boundary().map_or(0.0, |boundary| boundary.work(u)));
    if let Some(supports) = grid.supports() {
        for (body, pose) in supports.bodies().iter().zip(grid.poses(u)) {
            let (mount, arm) = (body.mount, pose.turned(body.mount.arm));
            let unloaded = mount.energy(pose.translation, arm, 0.0);
            springs += unloaded;
            work += unloaded - mount.energy(pose.translation, arm, 1.0);
        }
    }
    [units.energy * springs, units.energy * work]
}

/// Returns a factor by which the heaviest bar makes the period of the first mode longer, as a mass on a spring does.
#[must_use]
pub fn slowed_by_bars(grid: &Grid) -> f64 {
    let bars = grid.sheet_sides().into_iter().flat_map(SheetSides::bars);
    let heaviest = bars.map(|(_, bar)| bar.mass).fold(0.0, f64::max);
    let area: f64 = grid
        .each_element()
        .map(|element| grid.sides(element).iter().product::<f64>())
        .sum();
    (1.0 + heaviest / area).sqrt()
}

/// Returns the shortest period of a body on its spring, in the unit of time in which the mass per area is 1; `None`
/// without springs.
#[must_use]
pub fn shortest_period(grid: &Grid, mass: &Mass) -> Option<f64> {
    let supports = grid.supports()?;
    let len = grid.layout().vector_len();
    let stiffest = |body: &Rigid| f64::max(body.mount.spring[0], body.mount.spring[1]);
    let period = |body: &Rigid| {
        let (mut along, mut image) = (vec![0.0; len], vec![0.0; len]);
        body.nodes.write(&Pose::REST, [1.0, 0.0, 0.0], &mut along);
        mass.apply(&along, &mut image);
        let [heavy, ..] = body.nodes.force(&Pose::REST, &image);
        TAU * (heavy / stiffest(body)).sqrt()
    };
    let sprung = supports.bodies().iter().filter(|body| stiffest(body) > 0.0);
    sprung.map(period).reduce(f64::min)
}
