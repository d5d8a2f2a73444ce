//! The linear response of patterns to a small alternating voltage about a bias.
//!
//! At V₀ + Re(V̂ e^(iωt)) the load changes by 2V̂/V₀ of itself, and about the equilibrium at V₀ with relaxed branches
//!
//! ```text
//! (K + Γ K_A − ω²M) û = 2V̂/V₀ f,   Γ = Σ g iωτ/(1 + iωτ)
//! ```
//!
//! with the forces f of the load. K_A is the tangent of ½ (A : c + A₃₃ j⁻²) with A = c⁻¹ and A₃₃ = j² of the equilibrium, where the stress of a
//! relaxed branch is a pressure that drops out. The finite viscous law differs from the linear one by a change of A along A itself, a pressure too:
//! near equilibrium both respond alike.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::modes::wave_speed;
use crate::base::Stream;
use crate::fem::direct::Structure;
use crate::fem::dynamic_stiffness::{At, DynamicStiffness, Solved};
use crate::fem::effects::WithMaterial;
use crate::fem::energy::Material;
use crate::fem::error::SetupError;
use crate::fem::memory::Memory;
use crate::fem::operator::{Activity, Operator, metrics};
use crate::fem::solver::{MembraneSolver, SolveOptions};
use crate::fem::work::WorkLimit;
use crate::field::{Field, Outcome};
use crate::pattern::Pattern;
use crate::scene::Scene;

/// Change of the load over which its forces are differentiated: laws that wrinkle are not linear in it.
const NUDGE: f64 = 1e-3;

/// The scene at the voltage about which a small one alternates: the bias where the drive is a sine, else its voltage.
#[must_use]
pub fn at_bias(scene: &Scene) -> Scene {
    match scene.waveform().sine {
        Some(sine) if scene.drive.charge.is_none() => scene.at_voltage(sine.bias.value()),
        _ => scene.clone(),
    }
}

/// How a pattern responds to a small alternating voltage about its equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct FrequencyResponse {
    /// How the search for the equilibrium ended; without one there is no response.
    pub outcome: Outcome,
    /// The equilibrium.
    pub equilibrium: Option<Field>,
    /// How far it moves with the voltage when there is time to relax: its derivative in mm/V.
    pub slope: Option<Field>,
    /// At each frequency.
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
        /// A quarter of a period ahead of it.
        imaginary: Field,
    },
    /// A natural frequency that nothing damps, as far as rounding can tell.
    Resonance,
    /// The equations could not be solved: memory is short, or rounding is too large.
    NotSolved,
}

impl AtFrequency {
    /// The word that stands in files.
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
    /// Amplitude in mm/V and phase in degrees, from −180 to below 180, of the corner that is watched, along the axis along which it moves most at the
    /// lowest frequency, in the direction in which a static voltage moves it; none where there is no response.
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
            // What nothing damps moves against the voltage above a natural frequency: it lags.
            let phase = if phase >= 180.0 { phase - 360.0 } else { phase };
            [real.hypot(imaginary), phase]
        };
        self.each.iter().map(|one| at(one).map(motion)).collect()
    }
}

/// Finds responses of patterns of one scene on one mesh.
pub struct FrequencySolver {
    solver: MembraneSolver,
    /// 1/s in units of the membrane; none where it has no mass.
    per_second: Option<f64>,
    /// Of each branch g, and τ in s.
    branches: Vec<[f64; 2]>,
    structure: Option<Arc<Structure>>,
}

impl FrequencySolver {
    /// The solver of a scene [`at_bias`] whose effects are decided, within a limit of work for each equilibrium.
    ///
    /// # Errors
    /// When it cannot be set up: the drive is a charge or has no bias, the density is not known, or rigid bodies would move with inertia.
    pub fn new(scene: &Scene, options: SolveOptions, limit: WorkLimit) -> Result<Self, SetupError> {
        if scene.drive.charge.is_some() {
            return Err(SetupError::Charge);
        }
        if scene.voltage_v() <= 0.0 {
            return Err(SetupError::NoBias);
        }
        let has_mass = scene.effects.inertia.is_some();
        if has_mass && scene.geometry.bodies.is_some() {
            return Err(SetupError::MovingBodies);
        }
        let speed = has_mass.then(|| wave_speed(scene)).transpose()?;
        let solver = MembraneSolver::new(scene, options)?.within(limit);
        let stiffness = scene.shear_modulus_pa() * scene.mean_prestretch().powi(2);
        let named = scene.effects.viscoelasticity.iter().flat_map(|effect| &effect.branches);
        let branches = named.map(|branch| [branch.modulus.value() / stiffness, branch.time.value()]);
        Ok(Self {
            per_second: speed.map(|speed| speed / (1e-3 * solver.grid.unit_mm())),
            branches: branches.filter(|[modulus, _]| *modulus > 0.0).collect(),
            structure: Structure::new(&solver.grid),
            solver,
        })
    }

    /// How a pattern responds at frequencies in Hz.
    #[must_use]
    pub fn respond(&self, pattern: &Pattern, frequencies: &[f64]) -> FrequencyResponse {
        let Self { solver, .. } = self;
        let solution = solver.solve(pattern);
        if !solution.outcome.is_converged() {
            return FrequencyResponse {
                outcome: solution.outcome,
                equilibrium: None,
                slope: None,
                each: Vec::new(),
                watched: [0; 2],
            };
        }
        let (slope, each) = solver.model.with(Respond {
            solver: self,
            activity: &solver.model.activity(&solver.grid, pattern),
            u: &solution.displacement,
            frequencies,
        });
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

    /// A frequency in Hz, for the matrices.
    fn at(&self, frequency: f64) -> At {
        let omega = TAU * frequency;
        let mut viscous = [0.0; 2];
        for [modulus, time] in &self.branches {
            // iωτ/(1 + iωτ), without an overflow.
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

/// The amplitude of each component at each corner.
fn magnitudes(real: &Field, imaginary: &Field) -> Field {
    let pairs = real.values().iter().zip(imaginary.values());
    let values = pairs.map(|(real, imaginary)| real.hypot(*imaginary)).collect();
    Field::from_values(real.raster(), values).unwrap_or_else(|_| real.clone())
}

struct Respond<'a> {
    solver: &'a FrequencySolver,
    activity: &'a Activity,
    u: &'a [f64],
    frequencies: &'a [f64],
}

impl WithMaterial for Respond<'_> {
    /// The static slope, and the response at each frequency.
    type Output = (Option<Field>, Vec<AtFrequency>);

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        let Some((matrices, structure)) = self.matrices(&material) else {
            return (None, vec![AtFrequency::NotSolved; self.frequencies.len()]);
        };
        let FrequencySolver { solver, .. } = self.solver;
        let grid = &solver.grid;
        let probe = grid.random_load(&mut Stream::new(0, "frequency response", 0), self.u);
        let [probe, forces] = [probe, self.forces(&material)].map(|load| structure.pack(grid, self.u, &load));
        let per_volt = 2.0 / solver.scene.voltage_v();
        let forces: Vec<f64> = forces.iter().map(|force| per_volt * force).collect();
        let field = |part: &[f64]| grid.sample(&structure.unpack(grid, self.u, part));
        let at = |frequency: f64| match matrices.solve(self.solver.at(frequency), &forces, &probe) {
            Some(Solved::Response([real, imaginary])) => AtFrequency::Response {
                real: field(&real),
                imaginary: field(&imaginary),
            },
            Some(Solved::Resonance) => AtFrequency::Resonance,
            None => AtFrequency::NotSolved,
        };
        let slope = match at(0.0) {
            AtFrequency::Response { real, .. } => Some(real),
            AtFrequency::Resonance | AtFrequency::NotSolved => None,
        };
        (slope, self.frequencies.iter().map(|frequency| at(*frequency)).collect())
    }
}

impl Respond<'_> {
    /// The matrices about the equilibrium; `None` when memory is short.
    fn matrices<L: Material>(&self, material: &impl Fn(f64) -> L) -> Option<(DynamicStiffness, &Structure)> {
        let structure = self.solver.structure.as_deref()?;
        let grid = &self.solver.solver.grid;
        let law = material(1.0);
        let tangent = |activity: &Activity| {
            let operator = Operator {
                material: &law,
                activity,
                pulled: 1.0,
            };
            structure.tangent(&operator, self.u)
        };
        let with_branches = match self.solver.branches.is_empty() {
            true => None,
            false => {
                let relaxed = Memory::new(grid.layout(), metrics(self.activity, self.u));
                Some(tangent(&self.activity.with_memory(relaxed))?)
            }
        };
        let mass = match self.solver.per_second {
            Some(_) => Some(structure.mass(grid)?),
            None => None,
        };
        let matrices = DynamicStiffness::new(tangent(self.activity)?, with_branches.as_ref(), mass.as_ref());
        Some((matrices, structure))
    }

    /// The forces of the load, by which the residual falls as it grows.
    fn forces<L: Material>(&self, material: &impl Fn(f64) -> L) -> Vec<f64> {
        let residual = |share: f64| {
            let mut residual = vec![0.0; self.u.len()];
            let operator = Operator {
                material: &material(share),
                activity: self.activity,
                pulled: 1.0,
            };
            operator.residual(self.u, &mut residual);
            residual
        };
        let [less, more] = [1.0 - NUDGE, 1.0 + NUDGE].map(residual);
        let pairs = less.iter().zip(&more);
        pairs.map(|(less, more)| (less - more) / (2.0 * NUDGE)).collect()
    }
}
