//! The forces of the sides on the membrane.

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
        let forces = SideForces::new(self, pattern)?;
        Some(self.model.with(AtFullLoad {
            forces: &forces,
            u: &solution.displacement,
        }))
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
        let grid = &solver.grid;
        Some(Self {
            solver,
            sides: grid.sheet_sides().filter(|_| !solver.model.has_unrelaxed())?,
            activity: solver.model.activity(&grid.opened(), pattern),
            loads: grid.boundary()?.loads(grid.layout().vector_len()),
        })
    }

    /// Returns them in N at a displacement, with a share of the dead loads, as [`MembraneSolver::reactions`] does.
    pub fn at<L: Material>(&self, material: &L, load: f64, u: &[f64]) -> [[f64; 2]; SIDES] {
        let mut forces = vec![0.0; u.len()];
        Operator::new(material, &self.activity).forces(u, &mut forces);
        let layout = self.activity.grid().layout();
        let plane = forces.len() / 2;
        let holds = |side: usize, c: usize| self.sides.held[side][c] || self.sides.bars[side].is_some();
        let mut totals = [[0.0; 2]; SIDES];
        for (side, c) in (0..SIDES)
            .flat_map(|side| [(side, 0), (side, 1)])
            .filter(|(side, c)| holds(*side, *c))
        {
            let of_node = |node: [usize; 2]| {
                let index = layout.index(0, node[0], node[1]) + c * plane;
                let others = touched(node, layout.nodes()).filter(|other| holds(*other, c)).count();
                (forces[index] - load * self.loads[index]) / others as f64
            };
            totals[side][c] = self.solver.newtons(layout.side_nodes(side).map(of_node).sum());
        }
        totals
    }
}

/// Returns the sides that a node on the edge lies on.
fn touched([column, row]: [usize; 2], [columns, rows]: [usize; 2]) -> impl Iterator<Item = usize> {
    let on = [column == 0, column + 1 == columns, row == 0, row + 1 == rows];
    (0..SIDES).filter(move |side| on[*side])
}

/// Computes the forces of the sides at the full voltage and loads.
struct AtFullLoad<'a> {
    forces: &'a SideForces<'a>,
    u: &'a [f64],
}

impl WithMaterial for AtFullLoad<'_> {
    type Output = [[f64; 2]; SIDES];

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> [[f64; 2]; SIDES] {
        self.forces.at(&material(1.0), 1.0, self.u)
    }
}
