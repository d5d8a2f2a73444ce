//! The state without voltage, to which sides that are not held relax from the mount.
//!
//! All loads and the release of the prestress are raised together from the mount. Where the mount is unstable under
//! dead forces, as that of most laws at large stretches, the search starts again from a uniform state in which each
//! axis that nothing holds bears its load alone: the forces that keep it are then removed. Membrane that wrinkles may
//! do so on the way, in any basin.

use super::continuation::{BRACKET, Loading, Loads, MAX_LOAD_STEPS, Problem, StepFailure, ending};
use super::grid::Grid;
use super::material::Material;
use super::newton::Workspace;
use super::operator::Operator;
use super::sheet::{Mount, SheetSides};
use super::stability::Basin;

/// Factor between stretches at which the stress of a uniform state is compared with its load.
const FACTOR: f64 = 1.02;
/// The range of these stretches, relative to the mount.
const RANGE: [f64; 2] = [0.02, 20.0];

impl<L: Material, F: Fn(f64) -> L> Problem<'_, F> {
    /// Moves `u` to the state without voltage, loaded only by the forces on bodies and sides.
    ///
    /// # Errors
    /// If these make the membrane unstable.
    pub fn rest(&self, u: &mut [f64], workspace: &mut Workspace) -> Result<(), Loading> {
        u.fill(0.0);
        if let Some(known) = self.at_rest {
            u.copy_from_slice(known);
            return Ok(());
        }
        if !self.is_loaded() {
            return Ok(());
        }
        workspace.begin_again();
        let mut total = Loading::from(0.0);
        let Err(failure) = self.release_from_mount(u, workspace, &mut total) else {
            return Ok(());
        };
        if failure != StepFailure::Work && self.release_from_uniform(u, workspace, &mut total) {
            return Ok(());
        }
        total.ending = ending(failure, 0.0, 0.0);
        Err(total)
    }

    /// Raises all loads and the release of the prestress together.
    fn release_from_mount(
        &self,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        in_steps(self.activity.grid(), u, |share, u| {
            let loads = Loads {
                bodies: share,
                ..Loads::at(0.0)
            };
            self.attempt(loads, Basin::Any, u, workspace, total)
        })
    }

    /// Removes the forces that keep a uniform state; returns whether a stable state is reached.
    fn release_from_uniform(&self, u: &mut [f64], workspace: &mut Workspace, total: &mut Loading) -> bool {
        let material = (self.material)(0.0);
        let operator = Operator::new(&material, self.activity);
        let Some(start) = uniform_state(&operator) else {
            return false;
        };
        u.copy_from_slice(&start);
        let mut unbalanced = start;
        operator.residual(u, &mut unbalanced);
        let released = in_steps(self.activity.grid(), u, |share, u| {
            let dead: Vec<f64> = unbalanced.iter().map(|force| (share - 1.0) * force).collect();
            let loads = Loads {
                dead: Some(&dead),
                ..Loads::at(0.0)
            };
            self.attempt(loads, Basin::Any, u, workspace, total)
        });
        released.is_ok()
    }
}

/// Raises a share from 0 to 1 by attempts at shares, which move `u` to equilibria; steps that fail are halved. A step
/// in which an element turns over leads to another branch, and fails.
fn in_steps(
    grid: &Grid,
    u: &mut [f64],
    mut attempt: impl FnMut(f64, &mut [f64]) -> Result<(), StepFailure>,
) -> Result<(), StepFailure> {
    let (mut reached, mut step) = (0.0, 1.0_f64);
    let mut before = u.to_vec();
    for _ in 0..MAX_LOAD_STEPS {
        let share = f64::min(reached + step, 1.0);
        let found = match attempt(share, u) {
            Ok(()) if turns_over(grid, &before, u) => Err(StepFailure::Unknown),
            found => found,
        };
        match found {
            Ok(()) if share >= 1.0 => return Ok(()),
            Ok(()) => {
                reached = share;
                before.copy_from_slice(u);
            }
            Err(failure) => {
                u.copy_from_slice(&before);
                if failure == StepFailure::Work || step <= BRACKET {
                    return Err(failure);
                }
                step *= 0.5;
            }
        }
    }
    Err(StepFailure::Unknown)
}

/// Returns whether both diagonals of an element turn by more than a right angle from one state to another.
fn turns_over(grid: &Grid, before: &[f64], after: &[f64]) -> bool {
    let (layout, degree) = (grid.layout(), grid.layout().degree());
    let place = |u: &[f64], node: [usize; 2]| {
        let position = grid.node_position(node);
        [0, 1].map(|c| position[c] + u[layout.index(c, node[0], node[1])])
    };
    let turns = |[first, last]: [[usize; 2]; 2]| {
        let along = |u: &[f64]| {
            let [a, b] = [first, last].map(|node| place(u, node));
            [b[0] - a[0], b[1] - a[1]]
        };
        let ([a, b], [x, y]) = (along(before), along(after));
        a * x + b * y < 0.0
    };
    layout.each_element().any(|element| {
        let [left, low] = element.map(|at| at * degree);
        let [right, high] = [left + degree, low + degree];
        turns([[left, low], [right, high]]) && turns([[right, low], [left, high]])
    })
}

/// Returns the uniform state in which each axis that nothing holds bears its load; `None` if something holds both, or
/// there is none.
fn uniform_state<L: Material>(operator: &Operator<'_, L>) -> Option<Vec<f64>> {
    let grid = operator.activity.grid();
    let sides = grid.sheet_sides()?;
    if grid.supports().is_some_and(|supports| !supports.held_edge().is_empty()) {
        return None;
    }
    let axes = [0, 1].map(|axis| FreeAxis::new(grid, sides, axis));
    if axes.iter().all(Option::is_none) {
        return None;
    }
    let mut stretch = [1.0; 2];
    // The stress along one axis depends on the stretch of the other.
    for _ in 0..50 {
        let before = stretch;
        for (axis, free) in axes.iter().enumerate() {
            if let Some(free) = free {
                stretch[axis] = stretch_under(operator.material, grid.rest(), stretch, axis, free.traction)?;
            }
        }
        if (0..2).all(|axis| (stretch[axis] - before[axis]).abs() < 1e-10) {
            break;
        }
    }
    let layout = grid.layout();
    let mut u = vec![0.0; layout.vector_len()];
    let [columns, rows] = layout.nodes();
    for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
        let position = grid.node_position([column, row]);
        for (axis, free) in axes.iter().enumerate() {
            if let Some(free) = free {
                u[layout.index(axis, column, row)] = (stretch[axis] - 1.0) * (position[axis] - free.fixed);
            }
        }
    }
    grid.settle(&mut u);
    Some(u)
}

/// An axis along which a uniform sheet can change its length.
struct FreeAxis {
    /// The place that does not move.
    fixed: f64,
    /// The load over μH and the length of the side.
    traction: f64,
}

impl FreeAxis {
    /// Returns it, if at most one of the sides across it is held along it, and none along it.
    fn new(grid: &Grid, sides: &SheetSides, axis: usize) -> Option<Self> {
        let other = 1 - axis;
        let is_kept = |side: usize| sides.held[side][axis] || sides.bars[side].is_some();
        if [2 * other, 2 * other + 1].into_iter().any(is_kept) {
            return None;
        }
        let is_fixed = |side: usize| {
            let keeps = |bar: &Mount| !bar.moves[axis] || bar.given != [0.0; 2];
            sides.held[side][axis] || sides.bars[side].as_ref().is_some_and(keeps)
        };
        let [low, high] = [2 * axis, 2 * axis + 1];
        let last = grid.layout().nodes().map(|count| count - 1);
        let [start, end] = [[0; 2], last].map(|node| grid.node_position(node));
        let load = |side: usize| sides.loads[side][axis] + sides.bars[side].map_or(0.0, |bar| bar.load[axis]);
        let (fixed, pull) = match (is_fixed(low), is_fixed(high)) {
            (true, true) => return None,
            (true, false) => (start[axis], load(high)),
            (false, true) => (end[axis], -load(low)),
            (false, false) => (0.5 * (start[axis] + end[axis]), 0.5 * (load(high) - load(low))),
        };
        Some(Self {
            fixed,
            traction: f64::max(pull, 0.0) / (end[other] - start[other]),
        })
    }
}

/// Returns the smallest stretch along an axis, relative to the mount, at which a uniform bare sheet bears a traction.
fn stretch_under<L: Material>(
    material: &L,
    rest: [f64; 2],
    stretch: [f64; 2],
    axis: usize,
    traction: f64,
) -> Option<f64> {
    let excess = |along: f64| {
        let mut f = [rest[0] * stretch[0], rest[1] * stretch[1]];
        f[axis] = rest[axis] * along;
        let [gradient, f] = [1.0, 0.0].map(|less| [[f[0] - less, 0.0], [0.0, f[1] - less]]);
        let stress = material.stress(gradient, 0.0)[axis][axis] + material.self_stress(f)[axis][axis];
        (material.admissible(gradient) > 0.0).then_some(stress * rest[axis] - traction)
    };
    let mut low = RANGE[0];
    while low < RANGE[1] && excess(low).is_none_or(|excess| excess >= 0.0) {
        low *= FACTOR;
    }
    let mut high = low;
    while high < RANGE[1] && excess(high).is_some_and(|excess| excess < 0.0) {
        low = high;
        high *= FACTOR;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess(middle).is_some_and(|excess| excess < 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    (high < RANGE[1]).then_some(high)
}
