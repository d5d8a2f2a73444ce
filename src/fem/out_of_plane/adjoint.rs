//! The gradient of a functional of a state in space with respect to all cells, from additional linear solutions.
//!
//! With F(x, S) − p b(x) = 0 and a functional J(x), dJ/dS = −ψ · ∂F/∂S, where Kψ = ∂J/∂x with the tangent K at the
//! pressure. At a given volume, changes of x do not change it: Kψ + ηb = ∂J/∂x with b · ψ = 0.

use super::inflation::{Failure, Found, Given, InflationSolver, Search, State, combined};
use super::system::{End, System};
use crate::effects::WithMaterial;
use crate::eigenvalue::{add, dot};
use crate::material::Material;
use crate::newton::norm;
use crate::operator::Activity;
use deaflow_field::Field;
use deaflow_pattern::Pattern;

/// Relative residual of the adjoint solution.
const EXACT: f64 = 1e-9;

/// A gradient with respect to the cells.
struct Gradient<'a> {
    solver: &'a InflationSolver,
    activity: &'a Activity,
    at: &'a Found,
    weights: &'a Field,
}

impl InflationSolver {
    /// Returns the derivative of Σ weights · displacement at the cell corners, in mm, with the weights of heights and
    /// of the volume in ml, with respect to the activity of each cell, `[y][x]`; `None` without a solution of the
    /// linear systems.
    pub(super) fn gradient(&self, pattern: &Pattern, at: &Found, weights: &Field) -> Option<Vec<f64>> {
        let model = &self.flat().model;
        model.with(Gradient {
            solver: self,
            activity: &model.activity(&self.flat().grid, pattern),
            at,
            weights,
        })
    }

    /// Returns ∂J/∂x, given the gradient of the volume.
    fn weigh(&self, x: &[f64], weights: &Field, pressed: &[f64]) -> Vec<f64> {
        let grid = &self.flat().grid;
        let (planar, heights) = x.split_at(2 * (x.len() / 3));
        let mut load = grid.spread(weights, planar);
        match weights.heights() {
            [] => load.resize(load.len() + heights.len(), 0.0),
            of_heights => load.extend(grid.spread_heights(of_heights)),
        }
        let unit_mm = grid.unit_mm();
        load.iter_mut().for_each(|load| *load *= unit_mm);
        let [_, millilitres] = self.units();
        combined(&load, millilitres * weights.volume(), pressed)
    }
}

impl WithMaterial for Gradient<'_> {
    type Output = Option<Vec<f64>>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Vec<f64>> {
        let law = material(1.0);
        let Self {
            solver, at, weights, ..
        } = self;
        let mut search = solver.search(&law, self.activity);
        search.tension = at.tension;
        search
            .gradient(&at.state, |pressed| solver.weigh(&at.state.x, weights, pressed))
            .ok()
    }
}

impl<L: Material> Search<'_, L> {
    /// Returns dJ/dS of each cell in a state; `slope` gives ∂J/∂x from the gradient of the volume.
    fn gradient(&mut self, state: &State, slope: impl Fn(&[f64]) -> Vec<f64>) -> Result<Vec<f64>, Failure> {
        let (at, pressed, image) = self.pressed_at(&state.x)?;
        let mut load = slope(&pressed);
        self.surface.restrict(&at.poses, &mut load);
        let system = System::of(self.given, &at, state.pressure, [&pressed, &image]);
        let mut adjoint = self.solved(&system, &load)?;
        if self.given == Given::Volume {
            let along = self.solved(&system, &pressed)?;
            let factor = dot(&pressed, &adjoint) / dot(&pressed, &along);
            add(&mut adjoint, -factor, &along);
        }
        self.surface.of_cells(&state.x, &adjoint).ok_or(Failure::Lost)
    }

    /// Returns the solution of a system; zero without a load.
    fn solved(&mut self, system: &System<'_>, load: &[f64]) -> Result<Vec<f64>, Failure> {
        if norm(load) == 0.0 {
            return Ok(vec![0.0; load.len()]);
        }
        match self.solve(system, load, EXACT)? {
            (solution, End::Solved) => Ok(solution),
            (_, End::NegativeCurvature | End::Iterations) => Err(Failure::Lost),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::out_of_plane::{InflationOutcome, SpatialSolver};
    use crate::solver::SolveOptions;
    use deaflow_base::Stream;
    use deaflow_field::{Differentiable, Mesh};
    use deaflow_scene::Scene;

    const CELLS: usize = 8;

    fn scene(geometry: &str, more: &str) -> Scene {
        Scene::from_text(&format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 2, cells: {CELLS}{geometry} }}, material: {{ model: \
             neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}{more} }}"
        ))
        .unwrap()
    }

    /// Weights of a few displacements and heights, and of the volume.
    fn weights(scene: &Scene) -> Field {
        let raster = scene.membrane().raster;
        let mut stream = Stream::new(4, "weights in space", 0);
        let mut few = |count: usize| -> Vec<f64> {
            let weight = |at: usize| if at % 7 == 3 { stream.normal() } else { 0.0 };
            (0..count).map(weight).collect()
        };
        let planar = Field::from_values(raster, few(2 * raster.corners())).unwrap();
        planar.in_space(few(raster.corners()), 0.7).unwrap()
    }

    fn value(weights: &Field, field: &Field) -> f64 {
        let all = |of: &Field| {
            of.values()
                .iter()
                .chain(of.heights())
                .copied()
                .chain([of.volume()])
                .collect::<Vec<_>>()
        };
        dot(&all(weights), &all(field))
    }

    #[test]
    fn gradients_in_space_are_differences() {
        let body = ", bodies: [{ rectangle: [[18.75 mm, 18.75 mm], [31.25 mm, 37.5 mm]]";
        for (geometry, more) in [
            ("", ", loads: { pressure: 400 Pa }"),
            ("", ", loads: { volume: 12 ml }"),
            (
                &*format!("{body}, load: [0 N, 0.1 N, 0.4 N], spring: [0 N/m, 0 N/m, 50 N/m] }}]"),
                "",
            ),
            (&*format!("{body} }}]"), ", loads: { pressure: -300 Pa }"),
            (&*format!("{body} }}]"), ", loads: { volume: 5 ml }"),
        ] {
            let scene = scene(geometry, &format!("{more}, drive: {{ voltage: 6 kV }}"));
            let weights = weights(&scene);
            for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
                let options = SolveOptions { mesh, tolerance: 1e-11 };
                let solver = InflationSolver::new(&scene, options).unwrap();
                let grid = &solver.flat().grid;
                let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| (x + 2 * y) % 5 < 2);
                let mut stream = Stream::new(5, "cells in space", 0);
                let change: Vec<f64> = (0..CELLS * CELLS).map(|_| stream.normal()).collect();
                let found = |step: f64| {
                    let share = |x: usize, y: usize| {
                        f64::from(u8::from(pattern.is_active(x, y))) + step * change[y * CELLS + x]
                    };
                    let start = vec![0.0; 3 * (grid.layout().vector_len() / 2)];
                    let found = solver.raise(&Activity::from_shares(grid, share), start);
                    assert_eq!(found.outcome, InflationOutcome::Converged, "{geometry} {more}");
                    let inflated = solver.inflated(found.clone());
                    (
                        found,
                        inflated
                            .displacement
                            .in_space(inflated.heights, inflated.volume)
                            .unwrap(),
                    )
                };
                let at = |step: f64| value(&weights, &found(step).1);
                let step = 1e-2;
                let slope = (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
                let gradient = solver.gradient(&pattern, &found(0.0).0, &weights).unwrap();
                let sum: f64 = dot(&gradient, &change);
                assert!(
                    (sum - slope).abs() < 1e-6 * slope.abs(),
                    "{geometry} {more} {mesh}: {sum} {slope}"
                );
            }
        }
    }

    #[test]
    fn strokes_in_space_count_from_the_state_without_voltage() {
        let stiff = ", effects: { electrode_stiffness: { shear_modulus: 200 kPa, thickness: 20 um } }";
        for more in ["", stiff] {
            let scene = scene(
                "",
                &format!("{more}, loads: {{ pressure: 400 Pa }}, drive: {{ voltage: 6 kV }}"),
            );
            let options = SolveOptions {
                mesh: Mesh::bilinear(1),
                tolerance: 1e-10,
            };
            let solver = SpatialSolver::new(&scene, options).unwrap();
            let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| x + y < 7);
            let solve = |scene: &Scene| InflationSolver::new(scene, options).unwrap().solve(&pattern);
            let [on, off] = [6e3, 0.0].map(|volts| solve(&scene.at_voltage(volts)));
            let weights = weights(&scene);
            let (stroke, gradient) = solver.gradient(&pattern, &|_| weights.clone()).unwrap().unwrap();
            assert!((stroke.volume() - (on.volume - off.volume)).abs() < 1e-7);
            assert!((stroke.height(40) - (on.heights[40] - off.heights[40])).abs() < 1e-7);
            // Cells that are covered and bare by the whole change, in both directions: second order.
            let moved = |x: usize, y: usize, is_on: bool| {
                let other = Pattern::from_fn(pattern.raster(), |i, j| {
                    if (i, j) == (x, y) {
                        is_on
                    } else {
                        pattern.is_active(i, j)
                    }
                });
                value(
                    &weights,
                    &solver.predict_near(&pattern, &[other]).unwrap()[0].clone().unwrap(),
                )
            };
            let (here, there) = (value(&weights, &stroke), moved(5, 4, true));
            assert!(
                (there - here - gradient[4 * CELLS + 5]).abs() < 0.3 * (there - here).abs(),
                "{more}"
            );
        }
    }
}
