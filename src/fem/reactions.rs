//! The forces of the sides on the membrane.

use deaflow_field::Reactions;
use deaflow_pattern::Pattern;

use super::effects::WithMaterial;
use super::layout::SIDES;
use super::material::Material;
use super::operator::{Activity, Operator};
use super::sheet::SheetSides;
use super::solver::{MembraneSolver, MeshSolution};

impl MembraneSolver {
    /// Returns the force in N of each side, in the order of `Edge`, on the membrane in a solution of this pattern: its
    /// components along x and y, 0 where the side does not hold them. A bar holds both. The force at a corner that
    /// two sides hold counts half for each. `None` if all sides are held, or with branches that have no time to relax.
    #[must_use]
    pub fn reactions(&self, pattern: &Pattern, solution: &MeshSolution) -> Option<[[f64; 2]; SIDES]> {
        Some(SideForces::new(self, pattern)?.at_voltage(1.0, &solution.displacement))
    }

    /// Returns the same at a displacement, and the change from the state without voltage in mN.
    pub(super) fn reactions_from_rest(
        &self,
        pattern: &Pattern,
        u: &[f64],
        rest: Option<&[f64]>,
    ) -> Option<([[f64; 2]; SIDES], Option<Reactions>)> {
        let forces = SideForces::new(self, pattern)?;
        let reactions = forces.at_voltage(1.0, u);
        let changes = rest.map(|rest| {
            let at_rest = forces.at_voltage(0.0, rest);
            std::array::from_fn(|side| std::array::from_fn(|c| 1e3 * (reactions[side][c] - at_rest[side][c])))
        });
        Some((reactions, changes))
    }

    /// Converts a dimensionless force to N.
    fn newtons(&self, force: f64) -> f64 {
        1e-6 * force * self.grid.unit_mm() * self.scene.shear_modulus_pa() * self.scene.thickness_mm()
    }
}

/// The forces of the sides on a membrane with one pattern.
pub(super) struct SideForces<'a> {
    solver: &'a MembraneSolver,
    sides: &'a SheetSides,
    /// The membrane without supports.
    activity: Activity,
    /// The dead loads of nodes.
    loads: Vec<f64>,
}

impl<'a> SideForces<'a> {
    /// Prepares them; `None` if all sides are held, or with branches that have no time to relax.
    pub fn new(solver: &'a MembraneSolver, pattern: &Pattern) -> Option<Self> {
        // Opening the grid takes a tenth of a solve, in which all sides are held as a rule.
        Self::sides_of(solver)?;
        Self::of(solver, solver.model.activity(&solver.grid.opened(), pattern))
    }

    /// Returns the sides if they have forces.
    fn sides_of(solver: &'a MembraneSolver) -> Option<&'a SheetSides> {
        solver.grid.sheet_sides().filter(|_| !solver.model.has_unrelaxed())
    }

    /// Prepares them for a membrane without supports.
    pub(super) fn of(solver: &'a MembraneSolver, activity: Activity) -> Option<Self> {
        let grid = &solver.grid;
        Some(Self {
            solver,
            sides: Self::sides_of(solver)?,
            activity,
            loads: grid.boundary()?.loads(grid.layout().vector_len()),
        })
    }

    /// Returns them in N at a displacement and a share of the load of the voltage, with all dead loads.
    fn at_voltage(&self, share: f64, u: &[f64]) -> [[f64; 2]; SIDES] {
        self.solver.model.with(AtVoltage { forces: self, share, u })
    }

    /// Writes the derivative of Σ weights · forces, per mN, with respect to the nodal forces of the membrane into
    /// `out`.
    pub fn weigh(&self, weights: &Reactions, out: &mut [f64]) {
        let unit = 1e3 * self.solver.newtons(1.0);
        out.fill(0.0);
        self.each_share(|side, c, index, share| out[index] += unit * weights[side][c] * share);
    }

    /// Returns the membrane without supports.
    pub fn activity(&self) -> &Activity {
        &self.activity
    }

    /// Calls `take` with each held side and component, the index of that component of a node on it, and the share of
    /// the force of the node that counts for the side.
    fn each_share(&self, mut take: impl FnMut(usize, usize, usize, f64)) {
        let layout = self.activity.grid().layout();
        let plane = layout.vector_len() / 2;
        let holds = |side: usize, c: usize| self.sides.held[side][c] || self.sides.bars[side].is_some();
        for (side, c) in (0..SIDES)
            .flat_map(|side| [(side, 0), (side, 1)])
            .filter(|(side, c)| holds(*side, *c))
        {
            for node in layout.side_nodes(side) {
                let others = touched(node, layout.nodes()).filter(|other| holds(*other, c)).count();
                take(
                    side,
                    c,
                    layout.index(0, node[0], node[1]) + c * plane,
                    1.0 / others as f64,
                );
            }
        }
    }

    /// Returns them in N at a displacement, with a share of the dead loads, as [`MembraneSolver::reactions`] does.
    pub fn at<L: Material>(&self, material: &L, load: f64, u: &[f64]) -> [[f64; 2]; SIDES] {
        let mut forces = vec![0.0; u.len()];
        Operator::new(material, &self.activity).forces(u, &mut forces);
        let mut totals = [[0.0; 2]; SIDES];
        self.each_share(|side, c, index, share| {
            totals[side][c] += share * (forces[index] - load * self.loads[index]);
        });
        totals.map(|total| total.map(|force| self.solver.newtons(force)))
    }
}

/// Returns the sides that a node on the edge lies on.
pub(super) fn touched([column, row]: [usize; 2], [columns, rows]: [usize; 2]) -> impl Iterator<Item = usize> {
    let on = [column == 0, column + 1 == columns, row == 0, row + 1 == rows];
    (0..SIDES).filter(move |side| on[*side])
}

/// Computes the forces of the sides at a share of the load of the voltage.
struct AtVoltage<'a> {
    forces: &'a SideForces<'a>,
    share: f64,
    u: &'a [f64],
}

impl WithMaterial for AtVoltage<'_> {
    type Output = [[f64; 2]; SIDES];

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> [[f64; 2]; SIDES] {
        self.forces.at(&material(self.share), 1.0, self.u)
    }
}
