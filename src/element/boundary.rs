//! The forces on sides that are not held.
//!
//! Stresses are computed without the part αI + β cof f of a law, and without the stress at rest, since a uniform stress
//! and a cofactor have no forces inside the membrane. On sides that move they have: the first are dead forces, and the
//! energy of β cof f is β times the area of the deformed membrane, a quadratic function of the nodes on its edge. The
//! prestress at rest acts like a load, so that a share s of all loads also releases a share s of the prestress.

use super::element::Line;
use super::grid::Grid;
use super::kernels::stress_at_rest;
use super::lanes::Real;
use super::layout::SIDES;
use super::material::Material;
use super::sheet::SheetSides;

/// The nodes of sides that are not held, and what acts on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Boundary {
    /// f at rest.
    rest: [f64; 2],
    /// For each free component of a node on the edge: its index, its component, the derivative of the area at rest with
    /// respect to it, and the dead load on it.
    nodes: Vec<EdgeNode>,
    /// Dead loads with the indices of their components, also of those that a side holds.
    loads: Vec<(usize, f64)>,
    /// Second derivatives of the area: a free component, another component, and the value.
    curvatures: Vec<(usize, usize, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct EdgeNode {
    index: usize,
    component: usize,
    area: f64,
    load: f64,
}

/// The part of the stress of a law that passes over elements leave out, at rest and without voltage.
#[derive(Clone, Copy, Debug)]
pub struct EdgeStress {
    /// The uniform stress along x and y.
    uniform: [f64; 2],
    /// β.
    cofactor: f64,
}

impl EdgeStress {
    /// Returns that of a material on membrane with f at rest.
    pub fn of<L: Material>(material: &L, rest: [f64; 2]) -> Self {
        let alpha = material.self_stress([[0.0; 2]; 2])[0][0];
        let at_rest = stress_at_rest(|gradient| material.stress(gradient, 0.0), rest);
        Self {
            uniform: at_rest.map(|stress| alpha + stress),
            cofactor: cofactor_stress(material),
        }
    }
}

/// Returns β of a material.
pub fn cofactor_stress<L: Material>(material: &L) -> f64 {
    material.self_stress([[1.0, 0.0], [0.0, 1.0]])[0][0] - material.self_stress([[0.0; 2]; 2])[0][0]
}

impl Boundary {
    /// Creates the boundary of a grid with these sides.
    #[must_use]
    pub fn new(grid: &Grid, sides: &SheetSides) -> Self {
        let layout = grid.layout();
        let plane = layout.vector_len() / 2;
        let mut area = vec![0.0; 2 * plane];
        let mut load = vec![0.0; 2 * plane];
        let mut curvatures = Vec::new();
        let mut free = vec![1.0; 2 * plane];
        layout.clear_frame(&mut free);
        for side in 0..SIDES {
            // Counterclockwise: up on the right, to the left on the top.
            let forward = if matches!(side, 1 | 2) { 1.0 } else { -1.0 };
            let nodes: Vec<[usize; 2]> = layout.side_nodes(side).collect();
            let along = 1 - side / 2;
            let place = |node: &[usize; 2]| grid.node_position(*node);
            let length = place(&nodes[nodes.len() - 1])[along] - place(&nodes[0])[along];
            for edge in nodes.windows(layout.degree() + 1).step_by(layout.degree()) {
                let places: Vec<[f64; 2]> = edge.iter().map(place).collect();
                let indices: Vec<usize> = edge.iter().map(|[x, y]| layout.index(0, *x, *y)).collect();
                let size = places[edge.len() - 1][along] - places[0][along];
                let weights = weights(edge.len());
                let turns = turns(edge.len());
                for (i, &index) in indices.iter().enumerate() {
                    for c in 0..2 {
                        load[index + c * plane] += sides.loads[side][c] * weights[i] * size / length;
                    }
                    // The area is Σ xᵢ yₖ Qᵢₖ.
                    for (k, &other) in indices.iter().enumerate() {
                        let q = forward * turns[i][k];
                        area[index] += q * places[k][1];
                        area[index + plane] -= q * places[k][0];
                        if q != 0.0 {
                            curvatures.push((index, other + plane, q));
                            curvatures.push((index + plane, other, -q));
                        }
                    }
                }
            }
        }
        curvatures.retain(|(index, ..)| free[*index] != 0.0);
        let mut indices: Vec<usize> = curvatures.iter().map(|(index, ..)| *index).collect();
        indices.sort_unstable();
        indices.dedup();
        let node = |index: usize| EdgeNode {
            index,
            component: index / plane,
            area: area[index],
            load: load[index],
        };
        Self {
            rest: grid.rest(),
            nodes: indices.into_iter().map(node).collect(),
            loads: load
                .iter()
                .copied()
                .enumerate()
                .filter(|(_, load)| *load != 0.0)
                .collect(),
            curvatures,
        }
    }

    /// Returns the dead loads on all components of nodes, in a vector of a length.
    #[must_use]
    pub fn loads(&self, len: usize) -> Vec<f64> {
        let mut loads = vec![0.0; len];
        self.loads.iter().for_each(|(index, load)| loads[*index] = *load);
        loads
    }

    /// Returns the work of the dead loads along a displacement.
    #[must_use]
    pub fn work(&self, u: &[f64]) -> f64 {
        self.loads.iter().map(|(index, load)| load * u[*index]).sum()
    }

    /// Returns whether the state of rest differs from that of the mount, at a stress.
    #[must_use]
    pub fn is_loaded(&self, stress: &EdgeStress) -> bool {
        self.nodes.iter().any(|node| self.released(node, stress) != node.load)
    }

    /// Returns the force of the prestress on a component of a node.
    fn released(&self, node: &EdgeNode, stress: &EdgeStress) -> f64 {
        let c = node.component;
        (stress.uniform[c] * self.rest[c] + stress.cofactor) * node.area
    }

    /// Adds the forces at a displacement, with shares of the release and of the loads, to the components that are
    /// free.
    pub fn add_forces(&self, stress: &EdgeStress, [release, loads]: [f64; 2], u: &[f64], out: &mut [f64]) {
        for node in &self.nodes {
            let force = self.released(node, stress);
            // Equal shares are those of one sum.
            out[node.index] += match release == loads {
                true => loads * (force - node.load),
                false => release * force - loads * node.load,
            };
        }
        self.add_product(stress.cofactor, u, out);
    }

    /// Adds the tangent times a vector, to the components that are free.
    pub fn add_product<T: Real>(&self, cofactor: f64, du: &[T], out: &mut [T]) {
        for (index, other, q) in &self.curvatures {
            out[*index] = T::from_f64(out[*index].to_f64() + cofactor * q * du[*other].to_f64());
        }
    }
}

/// Returns the integrals of the functions of the nodes of an edge, in units of its length.
fn weights(nodes: usize) -> Vec<f64> {
    match nodes {
        2 => vec![0.5; 2],
        _ => vec![1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0],
    }
}

/// Returns Q, with ½∫(Nᵢ N′ₖ − N′ᵢ Nₖ) of the functions of the nodes of an edge.
fn turns(nodes: usize) -> Vec<Vec<f64>> {
    fn of<const A: usize>(line: &Line<A>) -> Vec<Vec<f64>> {
        let entry = |i: usize, k: usize| {
            let each = (0..A).map(|q| {
                let (values, slopes) = (&line.values[q], &line.slopes[q]);
                0.5 * line.weights[q] * (values[i] * slopes[k] - slopes[i] * values[k])
            });
            each.sum()
        };
        (0..A).map(|i| (0..A).map(|k| entry(i, k)).collect()).collect()
    }
    match nodes {
        2 => of(&Line::LINEAR),
        _ => of(&Line::QUADRATIC),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_under_an_edge_is_exact() {
        assert_eq!(turns(2), [[0.0, 0.5], [-0.5, 0.0]]);
        let turns = turns(3);
        for (i, k, exact) in [(0, 1, 2.0 / 3.0), (1, 2, 2.0 / 3.0), (0, 2, -1.0 / 6.0), (1, 1, 0.0)] {
            assert!((turns[i][k] - exact).abs() < 1e-15 && (turns[k][i] + exact).abs() < 1e-15);
        }
    }
}
