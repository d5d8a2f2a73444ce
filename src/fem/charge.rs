//! Equilibria at a prescribed charge.
//!
//! For conducting electrodes, let e(u) be the electric energy at the voltage of the scene in units of the membrane, and
//! Q₀(u) the charge. A charge Q then has the share s = (Q/Q₀)² of the load, and the equilibria are those at that
//! voltage. Their energy U + Q²/2C has another tangent, K + (2s/e) g gᵀ with the forces g of the full load, so at most
//! one negative eigenvalue of K at fixed voltage becomes positive. Sprayed immobile charge resists the expansion of the
//! electrodes: it adds a term to the stiffness in thickness, a ← a + q²λp⁻⁶ with q = D₀/√(με).

use deaflow_field::Charged;
use deaflow_scene::Scene;

use super::continuation::{Loading, LoadingEnd, Problem};
use super::eigenvalue::dot;
use super::material::Material;
use super::memory::{self, Memory, NUMBERS, line};
use super::newton::{self, Workspace, norm};
use super::operator::{Activity, Operator, metrics};
use super::stability::{LOOSE, Loss, Stability, judge};
use super::stored::{Units, content, integral};

/// Smallest step, as a share of the charge.
const MIN_STEP: f64 = 1e-3;
/// Work limit relative to that at a voltage, because each step factorises a matrix.
pub const WORK: f64 = 6.0;
/// Maximum number of Newton steps at each charge.
const MAX_NEWTON_STEPS: usize = 12;
const MAX_HALVINGS: u32 = 8;

/// A load stepping by charge, and its last state.
pub struct ChargedLoading {
    /// The load stepping, in shares of the load of the scene.
    pub loading: Loading,
    /// Voltage and stability of the last state; `None` without charge.
    pub charged: Option<Charged>,
}

/// An equilibrium at a charge.
pub struct ChargedState {
    /// The displacement.
    pub u: Vec<f64>,
    /// Share of the load.
    share: f64,
    /// Voltage and stability.
    pub charged: Charged,
}

/// Moves `u` from rest to the equilibrium at the charge of a scene with conducting electrodes.
pub fn conducting<L: Material, F: Fn(f64) -> L>(
    problem: &Problem<'_, F>,
    scene: &Scene,
    charge: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> ChargedLoading {
    let mut total = Loading::from(0.0);
    problem.start(u);
    let system = System { problem, scene };
    if system.at_full_load(u).0 <= 0.0 {
        // Without electrodes there is no charge.
        total.ending = LoadingEnd::Stable;
        return ChargedLoading {
            loading: total,
            charged: Some(Charged {
                charge: 0.0,
                voltage: Some(0.0),
                negative_at_voltage: 0,
                negative_at_charge: 0,
            }),
        };
    }
    let mut reached: Option<ChargedState> = None;
    let (mut at, mut step) = (0.0, 1.0_f64);
    // Change of the displacement in the last step, per share of the charge.
    let mut slope: Option<Vec<f64>> = None;
    while at < 1.0 {
        let target = f64::min(at + step, 1.0);
        let before = u.to_vec();
        if let Some(slope) = &slope {
            u.iter_mut()
                .zip(slope)
                .for_each(|(u, slope)| *u += (target - at) * slope);
            problem.activity.grid().settle(u);
        }
        match system.solve(target * charge, u, workspace, &mut total) {
            Ok(state) => {
                let pairs = state.u.iter().zip(&before);
                slope = Some(pairs.map(|(new, old)| (new - old) / (target - at)).collect());
                u.copy_from_slice(&state.u);
                reached = Some(state);
                at = target;
                step *= 1.5;
            }
            Err(failure) => {
                match &reached {
                    Some(state) => u.copy_from_slice(&state.u),
                    None => problem.start(u),
                }
                if step <= MIN_STEP || matches!(failure, ChargeFailure::Work) {
                    let stable = reached.as_ref().map_or(0.0, |state| state.share);
                    total.ending = match failure {
                        ChargeFailure::Lost(loss, unstable) => LoadingEnd::Lost { stable, unstable, loss },
                        ChargeFailure::Unknown => LoadingEnd::Unknown { stable },
                        ChargeFailure::Work => LoadingEnd::WorkLimit { stable },
                    };
                    return ChargedLoading {
                        loading: total,
                        charged: reached.map(|state| state.charged),
                    };
                }
                step *= 0.5;
            }
        }
    }
    total.ending = LoadingEnd::Stable;
    ChargedLoading {
        loading: total,
        charged: reached.map(|state| state.charged),
    }
}

/// Why a step fails.
pub enum ChargeFailure {
    /// The lost property, and the share of the load.
    Lost(Loss, f64),
    /// The iteration did not converge.
    Unknown,
    /// The work limit was reached.
    Work,
}

/// Finds the equilibrium at a charge on conducting electrodes from a nearby state; updates steps and residual of the
/// load stepping.
///
/// # Errors
/// If the iteration finds no stable one.
pub fn near<L: Material, F: Fn(f64) -> L>(
    problem: &Problem<'_, F>,
    scene: &Scene,
    charge: f64,
    start: &[f64],
    (workspace, total): (&mut Workspace, &mut Loading),
) -> Result<ChargedState, ChargeFailure> {
    System { problem, scene }.solve(charge, start, workspace, total)
}

struct System<'a, 'b, F> {
    problem: &'a Problem<'b, F>,
    scene: &'a Scene,
}

impl<L: Material, F: Fn(f64) -> L> System<'_, '_, F> {
    /// Returns the charge at the full load, and its electric energy in units of the membrane.
    fn at_full_load(&self, u: &[f64]) -> (f64, f64) {
        let activity = self.problem.activity;
        let laws = [0.0, 1.0].map(|share| (self.problem.material)(share));
        let units = Units::new(self.scene, activity.grid().unit_mm());
        let voltage = self.scene.voltage_v();
        let found = content([&laws[0], &laws[1]], activity, &metrics(activity, u), voltage, units);
        (found.charge, 0.5 * found.driven * voltage / units.energy)
    }

    /// Finds the equilibrium at a charge from a nearby state.
    fn solve(
        &self,
        charge: f64,
        start: &[f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<ChargedState, ChargeFailure> {
        let activity = self.problem.activity;
        let mut u = start.to_vec();
        let [mut residual, mut forces, mut trial] = [0; 3].map(|_| vec![0.0; u.len()]);
        let mut goal = f64::NAN;
        for step in 0..=MAX_NEWTON_STEPS {
            let (full, energy) = self.at_full_load(&u);
            let share = (charge / full).powi(2);
            let size = self.residual(&u, share, &mut residual).ok_or(ChargeFailure::Unknown)?;
            let law = (self.problem.material)(share);
            let operator = Operator::new(&law, activity);
            if step == 0 {
                let mut rest = vec![0.0; u.len()];
                self.residual(&vec![0.0; u.len()], share, &mut rest)
                    .ok_or(ChargeFailure::Unknown)?;
                goal = (self.problem.tolerance * norm(&rest)).max(operator.rounding() * (u.len() as f64).sqrt());
            }
            total.residual = size;
            if size <= goal {
                return self.accept(&operator, u, (charge, share, energy), workspace);
            }
            if workspace.is_spent() {
                return Err(ChargeFailure::Work);
            }
            total.steps += 1;
            let factors = workspace.factorise(&operator, &u).ok_or(ChargeFailure::Unknown)?;
            self.forces(&u, &mut forces);
            let (direct, along) = (factors.solve(&residual), factors.solve(&forces));
            let weight = 2.0 * share / energy;
            let factor = weight * dot(&forces, &direct) / (1.0 + weight * dot(&forces, &along));
            let pairs = direct.iter().zip(&along);
            let change: Vec<f64> = pairs.map(|(direct, along)| direct - factor * along).collect();
            u = self
                .damped_step(charge, &u, &change, size, &mut trial)
                .ok_or(ChargeFailure::Lost(Loss::Stability, share))?;
        }
        Err(ChargeFailure::Unknown)
    }

    /// Checks the stability of the equilibrium `u` at a charge, a share of the load and the electric energy at the full
    /// load.
    fn accept(
        &self,
        operator: &Operator<'_, L>,
        u: Vec<f64>,
        (charge, share, energy): (f64, f64, f64),
        workspace: &mut Workspace,
    ) -> Result<ChargedState, ChargeFailure> {
        let lost = |loss| Err(ChargeFailure::Lost(loss, share));
        let margins = operator.margins(&u);
        if margins.ellipticity <= 0.0 {
            return lost(Loss::Ellipticity);
        }
        if margins.tension < -LOOSE {
            return lost(Loss::Tension);
        }
        let (at_voltage, at_charge) = self
            .inertia(operator, &u, (share, energy), workspace)
            .ok_or(ChargeFailure::Unknown)?;
        if at_charge > 0 {
            return lost(Loss::Stability);
        }
        let charged = Charged {
            charge,
            voltage: Some(self.scene.voltage_v() * share.sqrt()),
            negative_at_voltage: at_voltage,
            negative_at_charge: at_charge,
        };
        Ok(ChargedState { u, share, charged })
    }

    /// Moves by −`change`, halved until the residual is below `size`; `None` if it never is.
    fn damped_step(&self, charge: f64, u: &[f64], change: &[f64], size: f64, trial: &mut [f64]) -> Option<Vec<f64>> {
        let mut length = 1.0;
        for _ in 0..=MAX_HALVINGS {
            let mut next: Vec<f64> = u.iter().zip(change).map(|(u, change)| u - length * change).collect();
            self.problem.activity.grid().settle(&mut next);
            let (full, _) = self.at_full_load(&next);
            let new = self.residual(&next, (charge / full).powi(2), trial);
            if new.is_some_and(|new| new < size) {
                return Some(next);
            }
            length *= 0.5;
        }
        None
    }

    /// Computes the residual at a share of the load, and returns its norm; `None` if the state is not admissible.
    fn residual(&self, u: &[f64], share: f64, out: &mut [f64]) -> Option<f64> {
        if !share.is_finite() {
            return None;
        }
        let law = (self.problem.material)(share);
        let operator = Operator::new(&law, self.problem.activity);
        let smallest = operator.residual(u, out);
        let size = norm(out);
        (smallest > 0.0 && size.is_finite()).then_some(size)
    }

    /// Computes the forces of the full load.
    fn forces(&self, u: &[f64], out: &mut [f64]) {
        let mut without = vec![0.0; out.len()];
        for (share, out) in [(1.0, &mut *out), (0.0, &mut without)] {
            let law = (self.problem.material)(share);
            let operator = Operator::new(&law, self.problem.activity);
            operator.residual(u, out);
        }
        out.iter_mut()
            .zip(&without)
            .for_each(|(with, without)| *with -= without);
    }

    /// Returns the number of negative eigenvalues of the tangent at fixed voltage and at fixed charge.
    fn inertia(
        &self,
        operator: &Operator<'_, L>,
        u: &[f64],
        (share, energy): (f64, f64),
        workspace: &mut Workspace,
    ) -> Option<(usize, usize)> {
        let factors = workspace.factorise(operator, u)?;
        let at_voltage = factors.negative_pivots();
        let mut forces = vec![0.0; u.len()];
        self.forces(u, &mut forces);
        // By the sign of a determinant: the rank-one term makes at most one negative eigenvalue positive.
        let lifted = 1.0 + 2.0 * share / energy * dot(&forces, &factors.solve(&forces)) < 0.0;
        Some((at_voltage, at_voltage - usize::from(lifted && at_voltage > 0)))
    }
}

/// Returns the area of all electrodes on the prestretched membrane in m².
fn electrode_area(activity: &Activity) -> f64 {
    let grid = activity.grid();
    let elements = grid.each_element().map(|element| activity.area(element));
    elements.sum::<f64>() * (1e-3 * grid.unit_mm()).powi(2)
}

/// Adds a charge sprayed evenly over the electrodes to an activity.
#[must_use]
pub fn sprayed(activity: &Activity, scene: &Scene, charge: f64) -> Activity {
    let layout = activity.grid().layout();
    let area = electrode_area(activity);
    let prestretch = scene.mean_prestretch();
    let thickness = if area > 0.0 {
        let density = charge * prestretch.powi(2) / area;
        density.powi(2) / (scene.shear_modulus_pa() * scene.permittivity()) * prestretch.powi(-6)
    } else {
        0.0
    };
    let points = (layout.degree() + 1).pow(2);
    let none = || vec![0.0; layout.element_rows() * points * NUMBERS * layout.part()];
    let mut values = activity
        .memory()
        .map_or_else(none, |memory| memory.view::<f64>().to_vec());
    for (row, q) in (0..layout.element_rows()).flat_map(|row| (0..points).map(move |q| (row, q))) {
        let start = line(layout, points, row, q, NUMBERS - 1);
        let active = activity.at_point(row, q, points);
        let targets = values[start..][..layout.part()].iter_mut().zip(active);
        targets.for_each(|(value, active)| *value += thickness * active);
    }
    activity.with_memory(Memory::new(layout, &values))
}

/// Returns the energy of the field of sprayed charge, in units of μH times the mean area of elements, if the memory
/// holds nothing else.
#[must_use]
pub fn energy_of_sprayed(activity: &Activity, u: &[f64]) -> f64 {
    let numbers = activity.memory().map(Memory::view).unwrap_or_default();
    let part = activity.grid().layout().part();
    let mut spread = vec![0.0; numbers.len() / NUMBERS];
    memory::add_energy(part, [numbers, &metrics(activity, u)], 0.5, &mut spread);
    integral(activity, &spread)
}

/// Moves `u` from rest to the equilibrium with a charge sprayed evenly over the electrodes.
pub fn immobile<L: Material, F: Fn(f64) -> L>(
    problem: &Problem<'_, F>,
    scene: &Scene,
    charge: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> ChargedLoading {
    let area = electrode_area(problem.activity);
    let law = (problem.material)(0.0);
    let with = |share: f64| sprayed(problem.activity, scene, share.sqrt() * charge);
    let mut total = Loading::from(0.0);
    problem.start(u);
    let mut reached = u.to_vec();
    let (mut at, mut step) = (0.0, 1.0_f64);
    while at < 1.0 {
        let target = f64::min(at + step, 1.0);
        let activity = with(target);
        let operator = Operator::new(&law, &activity);
        let result = newton::solve(&operator, problem.laplacian, problem.tolerance, u, workspace);
        let (Ok(progress) | Err((_, progress))) = result;
        total.steps += progress.steps;
        total.residual = progress.residual;
        let stability = result
            .is_ok()
            .then(|| judge(&operator, problem.laplacian, u, workspace));
        if let Some(Stability::Stable { pointwise }) = stability {
            total.pointwise = pointwise;
            reached.copy_from_slice(u);
            at = target;
            step *= 1.5;
            continue;
        }
        u.copy_from_slice(&reached);
        if workspace.is_spent() || step <= MIN_STEP {
            total.ending = match stability {
                _ if workspace.is_spent() => LoadingEnd::WorkLimit { stable: at },
                Some(Stability::Lost(loss)) => LoadingEnd::Lost {
                    stable: at,
                    unstable: target,
                    loss,
                },
                _ => LoadingEnd::Unknown { stable: at },
            };
            return ChargedLoading {
                loading: total,
                charged: None,
            };
        }
        step *= 0.5;
    }
    total.ending = LoadingEnd::Stable;
    let charged = Charged {
        charge: if area > 0.0 { charge } else { 0.0 },
        voltage: None,
        negative_at_voltage: 0,
        negative_at_charge: 0,
    };
    ChargedLoading {
        loading: total,
        charged: Some(charged),
    }
}
