//! The energy of a membrane and the charge on its electrodes, at one time.

use crate::registers::dispatch;

use crate::element::Line;
use crate::material::Material;
use crate::memory::{NUMBERS, lines};
use crate::operator::Activity;
use deaflow_field::Order;
use deaflow_scene::Scene;

/// Integrals over the membrane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Content {
    /// Elastic energy of the equilibrium law in J.
    pub elastic: f64,
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Sum over the groups of charge times share of the voltage, in C: times the voltage it is twice the electric
    /// energy.
    pub driven: f64,
}

/// Units of integrals.
#[derive(Clone, Copy, Debug)]
pub struct Units {
    /// Unit of energy in J.
    pub energy: f64,
}

impl Units {
    /// μH times the mean area of elements.
    #[must_use]
    pub fn new(scene: &Scene, unit_mm: f64) -> Self {
        let thickness = 1e-3 * scene.thickness_mm();
        Self {
            energy: scene.shear_modulus_pa() * thickness * (1e-3 * unit_mm).powi(2),
        }
    }
}

/// Integrates a density given at each point, in rows of elements for each of their points.
#[must_use]
pub fn integral(activity: &Activity, at_points: &[f64]) -> f64 {
    let (grid, layout) = (activity.grid(), activity.grid().layout());
    if grid.follows_borders().is_some() {
        return match grid.order() {
            Order::Bilinear => integral_of_elements::<4>(activity, at_points),
            Order::Biquadratic => integral_of_elements::<9>(activity, at_points),
        };
    }
    integral_of_rows(activity, |line| {
        let values = &at_points[line * layout.part()..][..layout.columns()];
        let each = values.iter().enumerate();
        each.map(|(column, value)| value * grid.size(0, column)).sum()
    })
}

/// Integrates as [`integral`], element by element.
fn integral_of_elements<const N: usize>(activity: &Activity, at_points: &[f64]) -> f64 {
    let (grid, part) = (activity.grid(), activity.grid().layout().part());
    let weights = weights(grid.order());
    let weights: [f64; N] = std::array::from_fn(|q| weights[q]);
    let each = grid.each_element().map(|[column, row]| {
        let areas = grid.areas_of([column, row], weights);
        let values = (0..N).map(|q| areas[q] * at_points[(row * N + q) * part + column]);
        values.sum::<f64>()
    });
    each.sum()
}

/// Integrates over a grid without mapped elements, given the sum over the elements of a row, times their widths, for
/// each of their points.
#[must_use]
pub fn integral_of_rows(activity: &Activity, sum: impl Fn(usize) -> f64) -> f64 {
    let grid = activity.grid();
    let weights = weights(grid.order());
    let lines = 0..grid.layout().rows() * weights.len();
    lines
        .map(|line| {
            let (row, q) = (line / weights.len(), line % weights.len());
            weights[q] * grid.size(1, row) * sum(line)
        })
        .sum()
}

/// Sums the logarithms of positive numbers that are neither tiny nor huge, with one logarithm for several of them.
#[must_use]
pub fn sum_of_logarithms(numbers: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut product, mut count) = (0.0, 1.0_f64, 0_u8);
    for number in numbers {
        product *= number;
        count += 1;
        if count == 8 {
            sum += product.ln();
            (product, count) = (1.0, 0);
        }
    }
    sum + product.ln()
}

/// Returns the weights of the points of an element.
pub fn weights(order: Order) -> Vec<f64> {
    let of = |line: &[f64]| line.iter().flat_map(|y| line.iter().map(move |x| x * y)).collect();
    match order {
        Order::Bilinear => of(&Line::LINEAR.weights),
        Order::Biquadratic => of(&Line::QUADRATIC.weights),
    }
}

/// Computes the content at a metric, for the laws without and with voltage, given in V.
#[must_use]
pub fn content<L: Material>(
    [unloaded, loaded]: [&L; 2],
    activity: &Activity,
    metric: &[f64],
    voltage: f64,
    units: Units,
) -> Content {
    let layout = activity.grid().layout();
    let (part, columns) = (layout.part(), layout.columns());
    let points = (layout.degree() + 1).pow(2);
    let count = metric.len() / NUMBERS;
    let [mut elastic, mut charge, mut driven] = [(); 3].map(|()| vec![0.0; count]);
    let rows = metric
        .chunks_exact(NUMBERS * part)
        .zip(elastic.chunks_exact_mut(part))
        .zip(charge.chunks_exact_mut(part).zip(driven.chunks_exact_mut(part)));
    dispatch(
        #[inline(always)]
        || {
            for (line, ((metric, elastic), (charge, driven))) in rows.enumerate() {
                let active = &activity.at_point(line / points, line % points, points)[..columns];
                let strongest = activity.strongest(line / points);
                let [xx, xy, yy, square] = lines(part, metric);
                let metric = [xx, xy, yy, square];
                unloaded.energies(metric, active, false, elastic);
                if voltage == 0.0 {
                    continue;
                }
                loaded.energies(metric, active, true, driven);
                for at in 0..columns {
                    let charged = 2.0 * (elastic[at] - driven[at]) / voltage;
                    let is_electric = active[at] != 0.0;
                    driven[at] = if is_electric { charged } else { 0.0 };
                    charge[at] = if is_electric {
                        charged / strongest[at].sqrt()
                    } else {
                        0.0
                    };
                }
            }
        },
    );
    let integral = |values: &[f64]| units.energy * integral(activity, values);
    Content {
        elastic: integral(&elastic),
        charge: integral(&charge),
        driven: integral(&driven),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::NeoHookean;
    use crate::grid::Grid;
    use crate::operator::metrics;
    use deaflow_field::Mesh;
    use deaflow_pattern::{Pattern, Raster};

    #[test]
    fn half_of_the_default_membrane_is_a_capacitor_of_470_pf_at_rest() {
        let scene = Scene::vhb4910();
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(2)] {
            let grid = Grid::paper(mesh);
            let activity = Activity::new(&grid, &Pattern::from_fn(Raster::PAPER, |x, _| x < 25));
            let metric = metrics(&activity, &vec![0.0; grid.layout().vector_len()]);
            let laws = [0.0, scene.kappa()].map(|kappa| NeoHookean::new(3.0, kappa));
            let found = content(
                [&laws[0], &laws[1]],
                &activity,
                &metric,
                scene.voltage_v(),
                Units::new(&scene, grid.unit_mm()),
            );
            // ε λp² A/(H/λp²) with A the prestretched area: C = ε A λp²/H.
            let capacitance = scene.permittivity() * 9.0 * (0.5 * 0.05 * 0.05) / 1e-3;
            assert!((found.charge / (capacitance * 5250.0) - 1.0).abs() < 1e-12);
            assert!((capacitance - 470e-12).abs() < 2e-12 && found.driven == found.charge);
        }
    }
}
