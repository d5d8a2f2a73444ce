//! Electrodes that charge from their leads: ∂(c j² φ)/∂t = Div(R⁻¹ j f⁻¹f⁻ᵀ ∇φ) in prestretched coordinates, with the
//! voltage of the source at the leads and no current across the other edges. c is the permittivity over the
//! prestretched thickness and R the sheet resistance of both electrodes, which are in series.
//!
//! φ is bilinear between the corners of elements, and the charge is lumped at these corners. So potentials stay between
//! those of the leads, and half of Σ qφ is the energy of the field whose forces act on the elements, each with the mean
//! of φ² over its corners. A step is the stiffly accurate two-stage SDIRK method of second order (Alexander, SIAM J.
//! Numer. Anal. 14 (1977) 1006).

use deaflow_linalg::{Pair, Sparsity};

use crate::element::Line;
use crate::grid::Grid;
use crate::memory::{NUMBERS, line};
use crate::operator::Activity;
use deaflow_field::Order;
use deaflow_pattern::Bits;
use deaflow_scene::{Edge, Scene};

/// γ = 1 − √½, the position of both stages in a step.
pub const FIRST_STAGE: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
/// Displacement of a membrane at its full voltage in units of its side, accurate enough to compare errors of potentials
/// with others.
const MOVED: f64 = 1e-2;
/// Marks a corner without electrode, or without unknown.
const NONE: usize = usize::MAX;

/// The electrodes of a pattern as conductors with leads.
pub struct Conductor {
    grid: Grid,
    /// Sheet resistance of both electrodes in Ω.
    resistance: f64,
    /// The voltage of the scene in V.
    full: f64,
    /// Charging time of an element in s.
    time: f64,
    /// Displacement in units of the grid that corresponds to an error of the full voltage.
    moved: f64,
    /// The active elements (column, row), with the numbers of their corners row by row.
    elements: Vec<([usize; 2], [usize; 4])>,
    /// Number of each corner among the unknowns; [`NONE`] at a lead.
    unknowns: Vec<usize>,
    /// `None` if memory is short.
    sparsity: Option<Sparsity>,
}

/// Capacitances and conductances at a displacement.
pub struct Circuit {
    /// Capacitance of each corner in F.
    capacitance: Vec<f64>,
    /// Conductance of each active element in 1/Ω.
    conductance: Vec<[[f64; 4]; 4]>,
}

/// The electrodes at one time.
#[derive(Clone, Debug)]
pub struct Charged {
    /// φ of each corner in V.
    pub potential: Vec<f64>,
    /// Charge of each corner in C.
    pub charge: Vec<f64>,
    /// Mean voltage, weighted by capacitance, in V: charge over capacitance.
    pub voltage: f64,
    /// Energy in J supplied to the field and the membrane in the last step.
    pub work: f64,
    /// Mean of φ² over each element, relative to the largest of these.
    pub activity: Activity,
    /// The largest of these over the squared voltage of the scene.
    pub share: f64,
}

impl Conductor {
    /// Returns the electrodes of an activity; `None` if the scene has no electrode resistance, or nothing is active.
    #[must_use]
    pub fn of(scene: &Scene, activity: &Activity) -> Option<Self> {
        let resistance = 2.0 * scene.effects.electrode_resistance.as_ref()?.sheet_resistance.value();
        let (leads, full) = (scene.leads.as_ref()?, scene.voltage_v());
        let grid = activity.grid().clone();
        let Corners { elements, places } = Corners::of(activity);
        if resistance <= 0.0 || full <= 0.0 || elements.is_empty() {
            return None;
        }
        let [columns, rows] = grid.elements();
        let mut wired: Vec<bool> = places
            .iter()
            .map(|[x, y]| {
                let ends = [
                    (Edge::Left, *x == 0),
                    (Edge::Right, *x == columns),
                    (Edge::Bottom, *y == 0),
                    (Edge::Top, *y == rows),
                ];
                ends.into_iter()
                    .any(|(edge, is_there)| is_there && leads.is_along(edge))
            })
            .collect();
        let [along, across] = grid.per_cell();
        for ([column, row], corners) in &elements {
            if leads.is_on([column / along, row / across]) {
                corners.iter().for_each(|corner| wired[*corner] = true);
            }
        }
        let mut count = 0;
        let unknowns: Vec<usize> = wired
            .into_iter()
            .map(|wired| {
                if wired {
                    return NONE;
                }
                count += 1;
                count - 1
            })
            .collect();
        let mut pairs: Vec<_> = (0..count).map(|at| Pair::new(at, at)).collect();
        for (_, corners) in &elements {
            pairs.extend(below_diagonal(corners, &unknowns).map(|(row, column, _)| Pair::new(row, column)));
        }
        let thickness = 1e-3 * scene.prestretched_thickness_mm();
        let area = (1e-3 * grid.unit_mm()).powi(2);
        Some(Self {
            resistance,
            full,
            time: resistance * scene.permittivity() / thickness * area,
            moved: MOVED * scene.side_mm() / grid.unit_mm(),
            elements,
            sparsity: Sparsity::new(count, &pairs),
            unknowns,
            grid,
        })
    }

    /// Returns the charging time of an element in s.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Returns the circuit at a metric of [`crate::operator::metrics`]; `capacitance` returns that of a mean element in
    /// F for the metric at a point.
    #[must_use]
    pub fn circuit(&self, metric: &[f64], capacitance: impl Fn([f64; NUMBERS]) -> f64) -> Circuit {
        let (places, weights): (&[f64], &[f64]) = match self.grid.order() {
            Order::Bilinear => (&Line::LINEAR.points, &Line::LINEAR.weights),
            Order::Biquadratic => (&Line::QUADRATIC.points, &Line::QUADRATIC.weights),
        };
        let count = places.len();
        let mut circuit = Circuit {
            capacitance: vec![0.0; self.unknowns.len()],
            conductance: vec![[[0.0; 4]; 4]; self.elements.len()],
        };
        let elements = self.elements.iter().zip(&mut circuit.conductance);
        for ((element @ [column, row], corners), conductance) in elements {
            let [width, height] = self.grid.sides(*element);
            let mut charged = 0.0;
            for q in 0..count * count {
                let number = |at| metric[line(self.grid.layout(), count * count, *row, q, at) + column];
                let point @ [xx, xy, yy, square] = [number(0), number(1), number(2), number(3)];
                let (x, y) = (places[q % count], places[q / count]);
                let weight = weights[q % count] * weights[q / count] * width * height;
                charged += weight * capacitance(point);
                let along = [y - 1.0, 1.0 - y, -y, y].map(|slope| slope / width);
                let across = [x - 1.0, -x, 1.0 - x, x].map(|slope| slope / height);
                let weight = weight * square.sqrt() / self.resistance;
                for (a, entries) in conductance.iter_mut().enumerate() {
                    let flow = [xx * along[a] + xy * across[a], xy * along[a] + yy * across[a]];
                    for (b, entry) in entries.iter_mut().enumerate() {
                        *entry += weight * (flow[0] * along[b] + flow[1] * across[b]);
                    }
                }
            }
            corners
                .iter()
                .for_each(|corner| circuit.capacitance[*corner] += 0.25 * charged);
        }
        circuit
    }

    /// Returns the uncharged electrodes.
    #[must_use]
    pub fn uncharged(&self, activity: &Activity) -> Charged {
        let nothing = vec![0.0; self.unknowns.len()];
        Charged {
            voltage: 0.0,
            work: 0.0,
            activity: activity.clone(),
            share: 0.0,
            charge: nothing.clone(),
            potential: nothing,
        }
    }

    /// Returns the potentials after a step in s from charges, between two circuits that change linearly within it, with
    /// the voltages of the leads at [`FIRST_STAGE`] of the step and at its end. A step of zero length gives the
    /// potentials just after a jump. `None` if memory is short.
    #[must_use]
    pub fn step(&self, seconds: f64, charge: &[f64], ends: [&Circuit; 2], volts: [f64; 2]) -> Option<Vec<f64>> {
        let between = |a: f64, b: f64| a + FIRST_STAGE * (b - a);
        let [before, after] = ends;
        let first = Circuit {
            capacitance: pairs(&before.capacitance, &after.capacitance)
                .map(|(a, b)| between(*a, *b))
                .collect(),
            conductance: pairs(&before.conductance, &after.conductance)
                .map(|(a, b)| std::array::from_fn(|i| std::array::from_fn(|j| between(a[i][j], b[i][j]))))
                .collect(),
        };
        let weight = FIRST_STAGE * seconds;
        let potential = self.stage(&first, weight, charge, volts[0])?;
        // The rate of charging in the first stage follows from the charge at its end.
        let share = (1.0 - FIRST_STAGE) / FIRST_STAGE;
        let known: Vec<f64> = pairs(&potential, &first.capacitance)
            .zip(charge)
            .map(|((potential, capacitance), charge)| charge + share * (potential * capacitance - charge))
            .collect();
        self.stage(after, weight, &known, volts[1])
    }

    /// Solves (C + weight · K) φ = q with a voltage at the leads.
    fn stage(&self, circuit: &Circuit, weight: f64, charge: &[f64], volts: f64) -> Option<Vec<f64>> {
        let free = |corner: usize| self.unknowns[corner];
        let count = self.unknowns.iter().filter(|unknown| **unknown != NONE).count();
        let (mut entries, mut right) = (vec![0.0; count], vec![0.0; count]);
        for (corner, capacitance) in circuit.capacitance.iter().enumerate() {
            if free(corner) != NONE {
                entries[free(corner)] = *capacitance;
                right[free(corner)] = charge[corner];
            }
        }
        for ((_, corners), conductance) in self.elements.iter().zip(&circuit.conductance) {
            entries.extend(below_diagonal(corners, &self.unknowns).map(|(_, _, [a, b])| weight * conductance[a][b]));
            for (a, corner) in corners.iter().enumerate().filter(|(_, corner)| free(**corner) != NONE) {
                let wired = corners
                    .iter()
                    .zip(&conductance[a])
                    .filter(|(other, _)| free(**other) == NONE);
                let sum: f64 = wired.map(|(_, conductance)| conductance).sum();
                right[free(*corner)] -= weight * volts * sum;
            }
        }
        if count > 0 {
            let sparsity = self.sparsity.as_ref()?;
            sparsity.solve(&sparsity.factors(&entries)?, &mut right);
        }
        let value = |unknown: &usize| if *unknown == NONE { volts } else { right[*unknown] };
        Some(self.unknowns.iter().map(value).collect())
    }

    /// Returns the electrodes at potentials in a circuit, after another state.
    #[must_use]
    pub fn charged(&self, potential: Vec<f64>, circuit: &Circuit, before: &Charged) -> Charged {
        let charge: Vec<f64> = pairs(&potential, &circuit.capacitance).map(|(v, c)| v * c).collect();
        let work = |at: usize| 0.5 * (potential[at] + before.potential[at]) * (charge[at] - before.charge[at]);
        let (activity, share) = self.loads(&potential);
        Charged {
            voltage: charge.iter().sum::<f64>() / circuit.capacitance.iter().sum::<f64>(),
            work: (0..charge.len()).map(work).sum(),
            activity,
            share,
            charge,
            potential,
        }
    }

    /// Returns the load of each element relative to the largest, and the largest relative to the load at the voltage of
    /// the scene.
    #[must_use]
    pub fn loads(&self, potential: &[f64]) -> (Activity, f64) {
        let [columns, rows] = self.grid.elements();
        let mut squares = vec![0.0; columns * rows];
        for ([column, row], corners) in &self.elements {
            let sum: f64 = corners.iter().map(|corner| potential[*corner].powi(2)).sum();
            squares[row * columns + column] = 0.25 * sum;
        }
        let largest = squares.iter().copied().fold(0.0, f64::max);
        let over = if largest > 0.0 { largest.recip() } else { 0.0 };
        let activity = Activity::from_elements(&self.grid, |[column, row]| over * squares[row * columns + column]);
        (activity, largest / self.full.powi(2))
    }

    /// Returns the root mean square difference of two potentials, as a displacement in units of the grid.
    #[must_use]
    pub fn difference(&self, one: &[f64], other: &[f64]) -> f64 {
        let sum: f64 = pairs(one, other).map(|(a, b)| (a - b).powi(2)).sum();
        self.moved * (sum / one.len() as f64).sqrt() / self.full
    }
}

fn pairs<'a, A, B>(one: &'a [A], other: &'a [B]) -> impl Iterator<Item = (&'a A, &'a B)> {
    one.iter().zip(other)
}

/// The entries of an element on and below the diagonal: row, column, and their corners.
fn below_diagonal<'a>(
    corners: &'a [usize; 4],
    unknowns: &'a [usize],
) -> impl Iterator<Item = (usize, usize, [usize; 2])> + 'a {
    let all = (0..4).flat_map(|a| (0..4).map(move |b| [a, b]));
    all.filter_map(|[a, b]| {
        let [row, column] = [a, b].map(|at| unknowns[corners[at]]);
        (row != NONE && column != NONE && row >= column).then_some((row, column, [a, b]))
    })
}

/// The corners of active elements by number.
struct Corners {
    /// The elements (column, row) with their corners.
    elements: Vec<([usize; 2], [usize; 4])>,
    /// Column and row of each corner.
    places: Vec<[usize; 2]>,
}

impl Corners {
    /// Parts of electrodes that touch only at a corner have separate corners there: no current flows across.
    fn of(activity: &Activity) -> Self {
        let grid = activity.grid();
        let ([columns, rows], [along, across]) = (grid.elements(), grid.per_cell());
        let layout = grid.layout();
        let is_active = |column: usize, row: usize| activity.elements()[row * layout.part() + column] > 0.0;
        let mut left = Bits::from_fn(grid.raster(), |x, y| is_active(x * along, y * across));
        let mut found = Self {
            elements: Vec::new(),
            places: Vec::new(),
        };
        while !left.is_empty() {
            let part = left.flooded(&left.first());
            left = left.without(&part);
            let mut numbers = vec![NONE; (columns + 1) * (rows + 1)];
            for [column, row] in layout.each_element() {
                if !part.has(column / along, row / across) {
                    continue;
                }
                let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| {
                    let number = &mut numbers[(row + y) * (columns + 1) + column + x];
                    if *number == NONE {
                        *number = found.places.len();
                        found.places.push([column + x, row + y]);
                    }
                    *number
                });
                found.elements.push(([column, row], corners));
            }
        }
        found
    }
}

/// Aitken's relaxation of a fixed-point iteration (Irons, Tuck, Int. J. Numer. Methods Eng. 1 (1969) 275).
#[derive(Default)]
pub struct Relaxation {
    /// The last value, its difference from the target, and the relaxation factor.
    last: Option<(Vec<f64>, Vec<f64>, f64)>,
}

impl Relaxation {
    /// Largest difference of a target from its value.
    #[must_use]
    pub fn off(&self, target: &[f64]) -> f64 {
        let off = |(value, ..): &(Vec<f64>, _, _)| pairs(target, value).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        self.last.as_ref().map_or(f64::INFINITY, off)
    }

    /// Returns the next value, given the target for the last one.
    pub fn next(&mut self, target: Vec<f64>) -> &[f64] {
        let (value, off, share) = match self.last.take() {
            None => (target.clone(), vec![0.0; target.len()], 1.0),
            Some((value, before, share)) => {
                let off: Vec<f64> = pairs(&target, &value).map(|(a, b)| a - b).collect();
                let change: Vec<f64> = pairs(&off, &before).map(|(a, b)| a - b).collect();
                let product = |a: &[f64], b: &[f64]| pairs(a, b).map(|(a, b)| a * b).sum::<f64>();
                let (along, square) = (product(&before, &change), product(&change, &change));
                // The first value has no earlier error.
                let share = match along < 0.0 && square > 0.0 {
                    true => (-share * along / square).clamp(0.1, 2.0),
                    false => share,
                };
                let next = pairs(&value, &off).map(|(value, off)| value + share * off).collect();
                (next, off, share)
            }
        };
        &self.last.insert((value, off, share)).0
    }
}

#[cfg(test)]
mod tests;
