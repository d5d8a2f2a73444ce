//! The linear response of patterns to a small alternating voltage about a bias.
//!
//! At V₀ + Re(V̂ e^(iωt)) the load changes by 2V̂/V₀ of itself, and about the equilibrium at V₀ with relaxed branches
//!
//! ```text
//! (K + Γ K_A − ω²M) û = 2V̂/V₀ f,   Γ = Σ g iωτ/(1 + iωτ)
//! ```
//!
//! with the forces f of the load. K_A is the tangent of ½ (A : c + A₃₃ j⁻²) with A = c⁻¹ and A₃₃ = j² of the
//! equilibrium, where the stress of a relaxed branch is a pressure that has no effect. The finite viscous law differs
//! from the linear one by a change of A along A itself, a pressure too: near equilibrium both respond equally.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::modes::wave_speed;
use crate::direct::Structure;
use crate::dynamic_stiffness::{At, DynamicStiffness, Orders, Solved};
use crate::effects::WithMaterial;
use crate::error::SetupError;
use crate::gauge::check_resisted;
use crate::material::Material;
use crate::memory::Memory;
use crate::operator::{Activity, Operator, metrics};
use crate::solver::{MembraneSolver, MeshSolution, SolveOptions};
use crate::work::WorkLimit;
use deaflow_base::Stream;
use deaflow_field::{Field, Outcome};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Change of the load for the derivative of its forces, in which laws that wrinkle are not linear.
pub(super) const LOAD_DIFFERENCE: f64 = 1e-3;

/// Returns the scene at the voltage about which a small one alternates: the bias of a sine, else the voltage.
#[must_use]
pub fn at_bias(scene: &Scene) -> Scene {
    match scene.waveform().sine {
        Some(sine) if scene.drive.charge.is_none() => scene.at_voltage(sine.bias.value()),
        _ => scene.clone(),
    }
}

/// Returns the scene at the highest voltage of a sine about its bias.
#[must_use]
pub fn at_peak(scene: &Scene) -> Scene {
    match scene.waveform().sine {
        Some(sine) => scene.at_voltage(sine.bias.value() + scene.voltage_v()),
        None => scene.clone(),
    }
}

/// The response of a pattern to a small alternating voltage about its equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct FrequencyResponse {
    /// Outcome of the equilibrium; without one there is no response.
    pub outcome: Outcome,
    /// The equilibrium.
    pub equilibrium: Option<Field>,
    /// Derivative of the relaxed displacement with respect to the voltage in mm/V.
    pub slope: Option<Field>,
    /// Response at each frequency.
    pub each: Vec<AtFrequency>,
    /// The corner (column, row) that moves most at the lowest frequency.
    pub watched: [usize; 2],
}

/// The response at a frequency.
#[derive(Clone, Debug, PartialEq)]
pub enum AtFrequency {
    /// Displacement per voltage in mm/V, û = real + i imaginary: V̂ cos ωt moves the membrane by Re(û e^(iωt)) V̂.
    Response {
        /// In phase with the voltage.
        real: Field,
        /// A quarter of a period ahead of the voltage.
        imaginary: Box<Field>,
    },
    /// An undamped natural frequency within rounding.
    Resonance,
    /// The equations could not be solved: memory is short, or rounding is too large.
    NotSolved,
}

impl AtFrequency {
    /// Returns the word used in files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Response { .. } => Outcome::Converged.name(),
            Self::Resonance => "resonance",
            Self::NotSolved => "not-solved",
        }
    }
}

impl FrequencyResponse {
    /// Returns amplitude in mm/V and phase in degrees, from −180 to below 180, of the watched corner. The axis is that
    /// of its largest motion at the lowest frequency, in the direction of its static motion; `None` without a response.
    #[must_use]
    pub fn watched_motion(&self) -> Vec<Option<[f64; 2]>> {
        let [x, y] = self.watched;
        let at = |one: &AtFrequency| match one {
            AtFrequency::Response { real, imaginary } => Some([real.at_corner(x, y), imaginary.at_corner(x, y)]),
            AtFrequency::Resonance | AtFrequency::NotSolved => None,
        };
        let size = |c: usize| {
            let first = self.each.iter().find_map(at);
            first.map_or(0.0, |[real, imaginary]| real[c].hypot(imaginary[c]))
        };
        let component = usize::from(size(1) > size(0));
        let slope = self
            .slope
            .as_ref()
            .map_or(1.0, |slope| slope.at_corner(x, y)[component]);
        let sign = if slope < 0.0 { -1.0 } else { 1.0 };
        let motion = |[real, imaginary]: [[f64; 2]; 2]| {
            let [real, imaginary] = [real, imaginary].map(|part| sign * part[component]);
            let phase = imaginary.atan2(real).to_degrees();
            // Above a natural frequency, undamped motion is opposite to the voltage: it lags.
            let phase = if phase >= 180.0 { phase - 360.0 } else { phase };
            [real.hypot(imaginary), phase]
        };
        self.each.iter().map(|one| at(one).map(motion)).collect()
    }
}

/// Computes responses of patterns of one scene on one mesh.
pub struct FrequencySolver {
    pub(super) solver: MembraneSolver,
    /// 1/s in units of the membrane; `None` without mass.
    per_second: Option<f64>,
    /// g and τ in s of each branch.
    branches: Vec<[f64; 2]>,
    structure: Option<Arc<Structure>>,
    orders: Arc<Orders>,
}

impl FrequencySolver {
    /// Creates the solver of a scene [`at_bias`] with decided effects, with a work limit for each equilibrium.
    ///
    /// # Errors
    /// If it cannot be set up: the drive is a charge or has no bias, or the density is unknown.
    pub fn new(scene: &Scene, options: SolveOptions, limit: WorkLimit) -> Result<Self, SetupError> {
        if scene.drive.charge.is_some() {
            return Err(SetupError::Charge);
        }
        if scene.voltage_v() <= 0.0 {
            return Err(SetupError::NoBias);
        }
        check_resisted(scene, "frequency responses")?;
        let has_mass = scene.effects.inertia.is_some();
        let speed = has_mass.then(|| wave_speed(scene)).transpose()?;
        let solver = MembraneSolver::new(scene, options)?.within(limit);
        let stiffness = scene.shear_modulus_pa() * scene.mean_prestretch().powi(2);
        let named = scene.effects.viscoelasticity.iter().flat_map(|effect| &effect.branches);
        let branches = named.map(|branch| [branch.modulus.value() / stiffness, branch.time.value()]);
        Ok(Self {
            per_second: speed.map(|speed| speed / (1e-3 * solver.grid.unit_mm())),
            branches: branches.filter(|[modulus, _]| *modulus > 0.0).collect(),
            structure: Structure::new(&solver.grid),
            orders: Arc::default(),
            solver,
        })
    }

    /// Returns the response of a pattern at frequencies in Hz.
    #[must_use]
    pub fn respond(&self, pattern: &Pattern, frequencies: &[f64]) -> FrequencyResponse {
        let Self { solver, .. } = self;
        // The static slope is the response at zero frequency.
        let all: Vec<f64> = std::iter::once(0.0).chain(frequencies.iter().copied()).collect();
        let (solution, mut each) = self.solve(pattern, &all);
        if each.is_empty() {
            return FrequencyResponse {
                outcome: solution.outcome,
                equilibrium: None,
                slope: None,
                each,
                watched: [0; 2],
            };
        }
        let slope = match each.remove(0) {
            AtFrequency::Response { real, .. } => Some(real),
            AtFrequency::Resonance | AtFrequency::NotSolved => None,
        };
        let magnitudes = each.iter().find_map(|one| match one {
            AtFrequency::Response { real, imaginary } => Some(magnitudes(real, imaginary)),
            AtFrequency::Resonance | AtFrequency::NotSolved => None,
        });
        FrequencyResponse {
            outcome: solution.outcome,
            equilibrium: Some(solver.field(&solution)),
            slope,
            each,
            watched: magnitudes.map_or([0; 2], |field| field.most_moved()),
        }
    }

    /// Returns the outcome of the equilibrium, and the response at one frequency in Hz; `None` without an equilibrium.
    pub(super) fn respond_at(&self, pattern: &Pattern, frequency: f64) -> (Outcome, Option<AtFrequency>) {
        let (solution, each) = self.solve(pattern, &[frequency]);
        (solution.outcome, each.into_iter().next())
    }

    /// Returns the equilibrium and the response at each frequency; empty if it is unstable.
    fn solve(&self, pattern: &Pattern, frequencies: &[f64]) -> (MeshSolution, Vec<AtFrequency>) {
        let Self { solver, .. } = self;
        let solution = solver.solve(pattern);
        if !solution.outcome.is_converged() {
            return (solution, Vec::new());
        }
        let each = solver.model.with(Respond {
            about: ResponseProblem {
                solver: self,
                activity: &solver.model.activity(&solver.grid, pattern),
                u: &solution.displacement,
            },
            frequencies,
        });
        (solution, each)
    }

    /// Returns the relative change of the load per volt.
    pub(super) fn per_volt(&self) -> f64 {
        2.0 / self.solver.scene.voltage_v()
    }

    /// Returns a frequency in Hz in the units of the matrices.
    pub(super) fn at(&self, frequency: f64) -> At {
        let omega = TAU * frequency;
        let mut viscous = [0.0; 2];
        for [modulus, time] in &self.branches {
            // iωτ/(1 + iωτ), without overflow.
            let x = omega * time;
            let share = if x > 1.0 {
                [1.0 / (1.0 + x.recip().powi(2)), x.recip() / (1.0 + x.recip().powi(2))]
            } else {
                [x * x / (1.0 + x * x), x / (1.0 + x * x)]
            };
            viscous = [0, 1].map(|part| viscous[part] + modulus * share[part]);
        }
        At {
            viscous,
            square: self.per_second.map_or(0.0, |per_second| (omega / per_second).powi(2)),
        }
    }
}

/// Returns the amplitude of each component at each corner.
fn magnitudes(real: &Field, imaginary: &Field) -> Field {
    let pairs = real.values().iter().zip(imaginary.values());
    let values = pairs.map(|(real, imaginary)| real.hypot(*imaginary)).collect();
    Field::from_values(real.raster(), values).unwrap_or_else(|_| real.clone())
}

struct Respond<'a> {
    about: ResponseProblem<'a>,
    frequencies: &'a [f64],
}

/// The equilibrium of a response.
#[derive(Clone, Copy)]
pub(super) struct ResponseProblem<'a> {
    pub solver: &'a FrequencySolver,
    pub activity: &'a Activity,
    pub u: &'a [f64],
}

/// Its equations.
pub(super) struct Equations<'a> {
    pub matrices: DynamicStiffness,
    structure: &'a Structure,
    about: ResponseProblem<'a>,
    /// Forces of 1 V, and forces with a part along every mode, in the layout of the matrices.
    pub forces: Vec<f64>,
    pub probe: Vec<f64>,
}

impl WithMaterial for Respond<'_> {
    /// Computes the response at each frequency.
    type Output = Vec<AtFrequency>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        let ResponseProblem { solver, .. } = self.about;
        let Some(equations) = self.about.equations(&material) else {
            return vec![AtFrequency::NotSolved; self.frequencies.len()];
        };
        let Equations {
            matrices,
            forces,
            probe,
            ..
        } = &equations;
        let field = |part: &[f64]| solver.solver.grid.sample(&equations.unpack(part));
        let at = |frequency: f64| match matrices.solve(solver.at(frequency), forces, probe) {
            Some(Solved::Response([real, imaginary])) => AtFrequency::Response {
                real: field(&real),
                imaginary: Box::new(field(&imaginary)),
            },
            Some(Solved::Resonance) => AtFrequency::Resonance,
            None => AtFrequency::NotSolved,
        };
        self.frequencies.iter().map(|frequency| at(*frequency)).collect()
    }
}

impl Equations<'_> {
    /// Converts nodal forces to the layout of the matrices.
    pub fn pack(&self, forces: &[f64]) -> Vec<f64> {
        let ResponseProblem { solver, u, .. } = self.about;
        self.structure.pack(&solver.solver.grid, u, forces)
    }

    /// Converts displacements from the layout of the matrices.
    pub fn unpack(&self, part: &[f64]) -> Vec<f64> {
        let ResponseProblem { solver, u, .. } = self.about;
        self.structure.unpack(&solver.solver.grid, u, part)
    }
}

impl<'a> ResponseProblem<'a> {
    /// Returns its equations; `None` if memory is short.
    pub fn equations<L: Material>(self, material: &impl Fn(f64) -> L) -> Option<Equations<'a>> {
        let (matrices, structure) = self.matrices(material)?;
        let grid = &self.solver.solver.grid;
        let probe = grid.random_load(&mut Stream::new(0, "frequency response", 0), self.u);
        let [probe, forces] = [probe, self.forces(material)].map(|load| structure.pack(grid, self.u, &load));
        let per_volt = self.solver.per_volt();
        Some(Equations {
            matrices,
            structure,
            about: self,
            forces: forces.iter().map(|force| per_volt * force).collect(),
            probe,
        })
    }

    fn matrices<L: Material>(&self, material: &impl Fn(f64) -> L) -> Option<(DynamicStiffness, &'a Structure)> {
        let structure = self.solver.structure.as_deref()?;
        let grid = &self.solver.solver.grid;
        let law = material(1.0);
        let tangent = |activity: &Activity| {
            let operator = Operator::new(&law, activity);
            structure.tangent(&operator, self.u)
        };
        let with_branches = match self.solver.branches.is_empty() {
            true => None,
            false => {
                let relaxed = Memory::new(grid.layout(), &metrics(self.activity, self.u));
                Some(tangent(&self.activity.with_memory(relaxed))?)
            }
        };
        let mass = match self.solver.per_second {
            Some(_) => Some(structure.mass(grid, self.u)?),
            None => None,
        };
        let matrices = DynamicStiffness::new(
            tangent(self.activity)?,
            with_branches.as_ref(),
            mass.as_ref(),
            Arc::clone(&self.solver.orders),
        );
        Some((matrices, structure))
    }

    /// Returns the forces of the load: the decrease of the residual with it.
    fn forces<L: Material>(&self, material: &impl Fn(f64) -> L) -> Vec<f64> {
        let residual = |share: f64| {
            let mut residual = vec![0.0; self.u.len()];
            let material = material(share);
            let operator = Operator::new(&material, self.activity);
            operator.residual(self.u, &mut residual);
            residual
        };
        let [less, more] = [1.0 - LOAD_DIFFERENCE, 1.0 + LOAD_DIFFERENCE].map(residual);
        let pairs = less.iter().zip(&more);
        pairs
            .map(|(less, more)| (less - more) / (2.0 * LOAD_DIFFERENCE))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::HistoryRequest;
    use deaflow_field::Mesh;
    use deaflow_pattern::Raster;

    const BRANCHES: &str =
        "viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }, { modulus: 20 kPa, time: 20 ms }] }";
    const OPTIONS: SolveOptions = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-12,
    };

    fn scene(drive: &str, effects: &str) -> Scene {
        let text = format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }}, \
             material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, \
             drive: {{ {drive} }}, effects: {{ {effects} }}, properties: {{ density: 960 }} }}"
        );
        Scene::from_text(&text).unwrap()
    }

    /// A pattern without symmetry.
    fn odd() -> Pattern {
        Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| {
            (x * x + 3 * y + x * y) % 7 < 3 || (x > 5 && y < 4)
        })
    }

    fn respond(scene: &Scene, frequencies: &[f64]) -> FrequencyResponse {
        let solver = FrequencySolver::new(scene, OPTIONS, WorkLimit::default()).unwrap();
        solver.respond(&odd(), frequencies)
    }

    fn parts(at: &AtFrequency) -> [&Field; 2] {
        match at {
            AtFrequency::Response { real, imaginary } => [real, imaginary],
            other => panic!("{}", other.name()),
        }
    }

    /// Half the difference of two fields over a voltage.
    fn difference(more: &Field, less: &Field, volts: f64) -> Field {
        let pairs = more.values().iter().zip(less.values());
        let values = pairs.map(|(more, less)| (more - less) / (2.0 * volts)).collect();
        Field::from_values(more.raster(), values).unwrap()
    }

    fn solver(scene: &Scene) -> MembraneSolver {
        MembraneSolver::new(scene, OPTIONS).unwrap()
    }

    #[test]
    fn slow_and_sudden_changes_are_those_of_equilibria_and_of_jumps() {
        let found = respond(&scene("voltage: 5 kV", BRANCHES), &[1e-7, 1e9]);
        let slope = found.slope.as_ref().unwrap();
        let volts = 5.0;
        let still = |voltage: f64| {
            let solver = solver(&scene(&format!("voltage: {voltage} V"), ""));
            solver.field(&solver.solve(&odd()))
        };
        let static_slope = difference(&still(5000.0 + volts), &still(5000.0 - volts), volts);
        let size = static_slope.max_magnitude();
        assert!(slope.max_difference(&static_slope) < 1e-5 * size);
        let [slow, behind] = parts(&found.each[0]);
        assert!(slow.max_difference(slope) < 1e-9 * size && behind.max_magnitude() < 1e-5 * size);
        // A jump after a long time: the branches have relaxed, and have no time to follow.
        let jumped = |to: f64| {
            let table =
                format!("waveform: {{ table: [[0 s, 5 kV], [1e6 s, 5 kV], [1e6 s, {to} V], [2e6 s, {to} V]] }}");
            let request = HistoryRequest {
                // The last time of a history has no jump.
                times: vec![1e6, 1.5e6],
                accuracy_mm: None,
                ..HistoryRequest::at(Vec::new())
            };
            let history = solver(&scene(&table, BRANCHES)).history(&odd(), &request).unwrap();
            history.fields[0].clone()
        };
        let jump = difference(&jumped(5000.0 + volts), &jumped(5000.0 - volts), volts);
        let [sudden, behind] = parts(&found.each[1]);
        assert!(jump.max_magnitude() < 0.9 * size);
        assert!(
            sudden.max_difference(&jump) < 1e-5 * size,
            "{:e}",
            sudden.max_difference(&jump) / size
        );
        assert!(behind.max_magnitude() < 1e-6 * size);
    }

    #[test]
    fn membranes_follow_a_small_sine_as_in_their_history() {
        let (period, bias, amplitude) = (2.0, 5000.0, 20.0);
        let drive = format!("voltage: {amplitude} V, waveform: {{ sine: {{ frequency: 0.5 Hz, bias: {bias} V }} }}");
        let scene = scene(&drive, BRANCHES);
        let samples = 8_u32;
        let request = HistoryRequest {
            times: (0..samples)
                .map(|k| period * (12.0 + f64::from(k) / f64::from(samples)))
                .collect(),
            accuracy_mm: Some(2e-6),
            ..HistoryRequest::at(Vec::new())
        };
        let history = solver(&scene).history(&odd(), &request).unwrap();
        let found = respond(&at_bias(&scene), &[1.0 / period]);
        let [x, y] = found.watched;
        let [real, imaginary] = parts(&found.each[0]).map(|part| part.at_corner(x, y));
        for c in 0..2 {
            // The drive is a sine: sin ωt = cos (ωt − ¼ period).
            let mut sums = [0.0; 2];
            for (k, field) in history.fields.iter().enumerate() {
                let phase = TAU * k as f64 / f64::from(samples);
                let value = 2.0 / f64::from(samples) / amplitude * field.at_corner(x, y)[c];
                sums = [sums[0] + value * phase.sin(), sums[1] + value * phase.cos()];
            }
            let size = real[c].hypot(imaginary[c]);
            let error = (sums[0] - real[c]).hypot(sums[1] - imaginary[c]);
            assert!(error < 1e-3 * size, "{error:e} of {size:e}");
        }
        assert!(found.watched_motion()[0].unwrap()[1] < -1.0);
    }

    #[test]
    fn resonances_are_at_natural_frequencies() {
        let scene = scene("voltage: 5 kV", "inertia: {}");
        let natural = solver(&scene).vibration(&odd(), 3, false).unwrap().frequencies;
        let first = natural[0];
        let found = respond(
            &scene,
            &[
                first,
                first * (1.0 - 1e-4),
                first * (1.0 + 1e-4),
                first * (1.0 - 1e-6),
                1e-3,
            ],
        );
        assert_eq!(found.each[0], AtFrequency::Resonance);
        // One mode is left: its amplitude over ω₁² − ω² is the same on both sides, and its phase turns.
        let motion: Vec<[f64; 2]> = found.watched_motion().into_iter().skip(1).flatten().collect();
        let residues: Vec<f64> = [-1e-4_f64, 1e-4, -1e-6]
            .into_iter()
            .zip(&motion)
            .map(|(off, [amplitude, _])| amplitude * (off * (2.0 + off)).abs())
            .collect();
        assert!((residues[0] / residues[1] - 1.0).abs() < 1e-2, "{residues:?}");
        assert!((residues[0] / residues[2] - 1.0).abs() < 1e-2, "{residues:?}");
        assert!((motion[0][1] - motion[1][1]).abs() == 180.0, "{motion:?}");
        // Far below there is no inertia.
        let [slow, _] = parts(&found.each[4]);
        let slope = found.slope.as_ref().unwrap();
        assert!(slow.max_difference(slope) < 1e-9 * slope.max_magnitude());
    }

    #[test]
    fn what_has_no_response_is_said() {
        let refused = |drive: &str, effects: &str| {
            let scene = at_bias(&scene(drive, effects));
            FrequencySolver::new(&scene, OPTIONS, WorkLimit::default()).err()
        };
        assert_eq!(refused("voltage: 0 V", ""), Some(SetupError::NoBias));
        let sine = "voltage: 1 kV, waveform: { sine: { frequency: 1 Hz } }";
        assert_eq!(refused(sine, ""), Some(SetupError::NoBias));
        assert_eq!(refused("charge: { total: 1 uC }", ""), Some(SetupError::Charge));
        let found = respond(&scene("voltage: 12 kV", BRANCHES), &[1.0, 2.0]);
        assert!(found.equilibrium.is_none() && found.each.is_empty() && !found.outcome.is_converged());
    }
}
