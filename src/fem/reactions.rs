//! The forces of the sides on the membrane.

use deaflow_pattern::Pattern;

use super::effects::WithMaterial;
use super::layout::SIDES;
use super::material::Material;
use super::operator::{Activity, Operator};
use super::solver::{MembraneSolver, MeshSolution};

impl MembraneSolver {
    /// Returns the force in N of each side, in the order of `Edge`, on the membrane in a solution of this pattern: its
    /// components along x and y, 0 where the side does not hold them. A bar holds both. The force at a corner that
    /// two sides hold counts half for each. `None` if all sides are held.
    #[must_use]
    pub fn reactions(&self, pattern: &Pattern, solution: &MeshSolution) -> Option<[[f64; 2]; SIDES]> {
        let sides = self.grid.sheet_sides()?;
        let opened = self.grid.opened();
        let forces = self.model.with(NodalForces {
            activity: &self.model.activity(&opened, pattern),
            u: &solution.displacement,
        });
        let layout = opened.layout();
        let plane = forces.len() / 2;
        let loads = self.grid.boundary().map(|boundary| boundary.loads(forces.len()))?;
        let holds = |side: usize, c: usize| sides.held[side][c] || sides.bars[side].is_some();
        let mut totals = [[0.0; 2]; SIDES];
        for (side, c) in (0..SIDES)
            .flat_map(|side| [(side, 0), (side, 1)])
            .filter(|(side, c)| holds(*side, *c))
        {
            let of_node = |node: [usize; 2]| {
                let index = layout.index(0, node[0], node[1]) + c * plane;
                let others = touched(node, layout.nodes()).filter(|other| holds(*other, c)).count();
                (forces[index] - loads[index]) / others as f64
            };
            totals[side][c] = self.newtons(layout.side_nodes(side).map(of_node).sum());
        }
        Some(totals)
    }

    /// Converts a dimensionless force to N.
    fn newtons(&self, force: f64) -> f64 {
        1e-6 * force * self.grid.unit_mm() * self.scene.shear_modulus_pa() * self.scene.thickness_mm()
    }
}

/// Returns the sides that a node on the edge lies on.
fn touched([column, row]: [usize; 2], [columns, rows]: [usize; 2]) -> impl Iterator<Item = usize> {
    let on = [column == 0, column + 1 == columns, row == 0, row + 1 == rows];
    (0..SIDES).filter(move |side| on[*side])
}

/// Computes the forces of all elements on all nodes.
struct NodalForces<'a> {
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for NodalForces<'_> {
    type Output = Vec<f64>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Vec<f64> {
        let material = material(1.0);
        let mut forces = vec![0.0; self.u.len()];
        Operator::new(&material, self.activity).forces(self.u, &mut forces);
        forces
    }
}
