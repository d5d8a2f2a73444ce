//! Equilibria at a given charge.
//!
//! On electrodes that conduct, with the electric energy e(u) at the voltage of the scene in units of the membrane and the charge Q₀(u) there, a
//! charge Q makes the share s = (Q/Q₀)² of the load. Equilibria are those at that voltage; their energy U + Q²/2C has another tangent,
//! K + (2s/e) g gᵀ with g the forces of the full load, which is stable along one more direction than K at a fixed voltage. Sprayed charge that stays
//! where it is resists being spread: it thickens the membrane by a term of its own, a ← a + q²λp⁻⁶ with q = D₀/√(με).

use deaflow_field::Charged;
use deaflow_scene::Scene;

use super::continuation::{Loading, LoadingEnd, Loss, Problem};
use super::eigenvalue::dot;
use super::material::Material;
use super::memory::{self, Memory, NUMBERS, line};
use super::newton::{self, Workspace, norm};
use super::operator::{Activity, Operator, metrics};
use super::stability::{Stability, judge};
use super::stored::{Units, content, integral};

/// Smallest step of the charge, in units of all of it.
const SMALLEST: f64 = 1e-3;
/// Work that is allowed, in units of that for a voltage: each step takes the factors of its matrix.
pub const WORK: f64 = 6.0;
/// Newton steps for each charge at most.
const MOST_STEPS: usize = 12;
const MOST_HALVINGS: u32 = 8;

/// Loading by charge, with what it leads to.
pub struct ChargedLoading {
    /// How it ended, in shares of the load of the scene.
    pub loading: Loading,
    /// Voltage and stability of the last state; none where no charge is there.
    pub charged: Option<Charged>,
}

/// A state at a charge.
pub struct ChargedState {
    /// The displacement.
    pub u: Vec<f64>,
    /// Share of the load.
    share: f64,
    /// Its voltage and stability.
    pub charged: Charged,
}

/// Moves `u` from rest to the equilibrium at the charge of a scene whose electrodes conduct.
pub fn conducting<L: Material, F: Fn(f64) -> L>(
    problem: &Problem<'_, F>,
    scene: &Scene,
    charge: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> ChargedLoading {
    let mut total = Loading {
        ending: LoadingEnd::Unknown { stable: 0.0 },
        steps: 0,
        residual: 0.0,
        pointwise: false,
    };
    u.fill(0.0);
    let system = System { problem, scene };
    if system.at_full_load(u).0 <= 0.0 {
        // Without an electrode there is nothing that a charge could be put on.
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
    // How the last step moved the membrane, for all of the charge.
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
            Err(refusal) => {
                match &reached {
                    Some(state) => u.copy_from_slice(&state.u),
                    None => u.fill(0.0),
                }
                if step <= SMALLEST || matches!(refusal, ChargeFailure::Work) {
                    let stable = reached.as_ref().map_or(0.0, |state| state.share);
                    total.ending = match refusal {
                        ChargeFailure::Lost(loss, unstable) => LoadingEnd::Lost { stable, unstable, loss },
                        ChargeFailure::Unknown => LoadingEnd::Unknown { stable },
                        ChargeFailure::Work => LoadingEnd::WorkLimit { stable },
                    };
                    let charged = reached.map(|state| state.charged);
                    return ChargedLoading {
                        loading: total,
                        charged,
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

/// Why a state is not accepted.
pub enum ChargeFailure {
    /// What is lost, and the share of the load there.
    Lost(Loss, f64),
    /// The iteration did not end.
    Unknown,
    /// It took more work than is allowed.
    Work,
}

/// The equilibrium with a charge on electrodes that conduct, from a state nearby; steps and residual are those of the loading then.
///
/// # Errors
/// When there is no stable one that the iteration finds.
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
    /// The charge at the full load, and its electric energy in units of the membrane.
    fn at_full_load(&self, u: &[f64]) -> (f64, f64) {
        let activity = self.problem.activity;
        let laws = [0.0, 1.0].map(|share| (self.problem.material)(share));
        let units = Units::new(self.scene, activity.grid().unit_mm());
        let voltage = self.scene.voltage_v();
        let found = content([&laws[0], &laws[1]], activity, &metrics(activity, u), voltage, units);
        (found.charge, 0.5 * found.driven * voltage / units.energy)
    }

    /// The equilibrium at a charge, from a state nearby.
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
        for step in 0..=MOST_STEPS {
            let (full, energy) = self.at_full_load(&u);
            let share = (charge / full).powi(2);
            let size = self.residual(&u, share, &mut residual).ok_or(ChargeFailure::Unknown)?;
            let law = (self.problem.material)(share);
            let operator = Operator {
                material: &law,
                activity,
                pulled: 1.0,
            };
            if step == 0 {
                let mut rest = vec![0.0; u.len()];
                self.residual(&vec![0.0; u.len()], share, &mut rest)
                    .ok_or(ChargeFailure::Unknown)?;
                goal = (self.problem.tolerance * norm(&rest)).max(operator.rounding() * (u.len() as f64).sqrt());
            }
            total.residual = size;
            let lost = |loss| ChargeFailure::Lost(loss, share);
            if size <= goal {
                let margins = operator.margins(&u);
                if margins.ellipticity <= 0.0 {
                    return Err(lost(Loss::Ellipticity));
                }
                if margins.tension < -super::stability::LOOSE {
                    return Err(lost(Loss::Tension));
                }
                let (at_voltage, at_charge) = self
                    .inertia(&operator, &u, (share, energy), workspace)
                    .ok_or(ChargeFailure::Unknown)?;
                if at_charge > 0 {
                    return Err(lost(Loss::Stability));
                }
                let charged = Charged {
                    charge,
                    voltage: Some(self.scene.voltage_v() * share.sqrt()),
                    negative_at_voltage: at_voltage,
                    negative_at_charge: at_charge,
                };
                return Ok(ChargedState { u, share, charged });
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
            let mut length = 1.0;
            let mut halvings = 0;
            loop {
                let pairs = direct.iter().zip(&along);
                let moved = u
                    .iter()
                    .zip(pairs)
                    .map(|(u, (direct, along))| u - length * (direct - factor * along));
                let mut next: Vec<f64> = moved.collect();
                activity.grid().settle(&mut next);
                let (full, _) = self.at_full_load(&next);
                let new = self.residual(&next, (charge / full).powi(2), &mut trial);
                if new.is_some_and(|new| new < size) {
                    u = next;
                    break;
                }
                halvings += 1;
                if halvings > MOST_HALVINGS {
                    return Err(lost(Loss::Stability));
                }
                length *= 0.5;
            }
        }
        Err(ChargeFailure::Unknown)
    }

    /// The residual at a share of the load, and its norm; `None` where the state is none that a membrane can have.
    fn residual(&self, u: &[f64], share: f64, out: &mut [f64]) -> Option<f64> {
        if !share.is_finite() {
            return None;
        }
        let law = (self.problem.material)(share);
        let operator = Operator {
            material: &law,
            activity: self.problem.activity,
            pulled: 1.0,
        };
        let smallest = operator.residual(u, out);
        let size = norm(out);
        (smallest > 0.0 && size.is_finite()).then_some(size)
    }

    /// The forces of the full load.
    fn forces(&self, u: &[f64], out: &mut [f64]) {
        let mut without = vec![0.0; out.len()];
        for (share, out) in [(1.0, &mut *out), (0.0, &mut without)] {
            let law = (self.problem.material)(share);
            let operator = Operator {
                material: &law,
                activity: self.problem.activity,
                pulled: 1.0,
            };
            operator.residual(u, out);
        }
        out.iter_mut()
            .zip(&without)
            .for_each(|(with, without)| *with -= without);
    }

    /// How many eigenvalues of the tangent are negative at a fixed voltage, and at a fixed charge.
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
        // The sign of a determinant: a rank of one lifts one eigenvalue above zero, or none.
        let lifted = 1.0 + 2.0 * share / energy * dot(&forces, &factors.solve(&forces)) < 0.0;
        Some((at_voltage, at_voltage - usize::from(lifted && at_voltage > 0)))
    }
}

/// The area of all electrodes on the prestretched membrane, in units of m².
fn electrode_area(activity: &Activity) -> f64 {
    let grid = activity.grid();
    let elements = grid.layout().each_element().map(|element| activity.area(element));
    elements.sum::<f64>() * (1e-3 * grid.unit_mm()).powi(2)
}

/// The same with a charge that was sprayed evenly over the electrodes.
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
    let none = || vec![0.0; layout.rows() * points * NUMBERS * layout.part()];
    let mut values = activity
        .memory()
        .map_or_else(none, |memory| memory.view::<f64>().to_vec());
    for (row, q) in (0..layout.rows()).flat_map(|row| (0..points).map(move |q| (row, q))) {
        let start = line(layout, points, row, q, NUMBERS - 1);
        let active = activity.at_point(row, q, points);
        let targets = values[start..][..layout.part()].iter_mut().zip(active);
        targets.for_each(|(value, active)| *value += thickness * active);
    }
    activity.with_memory(Memory::new(layout, &values))
}

/// The energy of the field of charge that was sprayed, in units of μH times the mean area of elements, of a membrane that remembers nothing else.
#[must_use]
pub fn energy_of_sprayed(activity: &Activity, u: &[f64]) -> f64 {
    let numbers = activity.memory().map(Memory::view).unwrap_or_default();
    let part = activity.grid().layout().part();
    let mut spread = vec![0.0; numbers.len() / NUMBERS];
    memory::add_energy(part, [numbers, &metrics(activity, u)], 0.5, &mut spread);
    integral(activity, &spread)
}

/// Moves `u` from rest to the equilibrium with charge that was sprayed evenly over the electrodes.
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
    let mut total = Loading {
        ending: LoadingEnd::Unknown { stable: 0.0 },
        steps: 0,
        residual: 0.0,
        pointwise: false,
    };
    u.fill(0.0);
    let mut reached = u.to_vec();
    let (mut at, mut step) = (0.0, 1.0_f64);
    while at < 1.0 {
        let target = f64::min(at + step, 1.0);
        let activity = with(target);
        let operator = Operator {
            material: &law,
            activity: &activity,
            pulled: 1.0,
        };
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
        if workspace.is_spent() || step <= SMALLEST {
            total.ending = match (workspace.is_spent(), stability) {
                (true, _) => LoadingEnd::WorkLimit { stable: at },
                (_, Some(Stability::Slack)) => LoadingEnd::Lost {
                    stable: at,
                    unstable: target,
                    loss: Loss::Tension,
                },
                (_, Some(other)) => LoadingEnd::Lost {
                    stable: at,
                    unstable: target,
                    loss: match other {
                        Stability::NotElliptic => Loss::Ellipticity,
                        _ => Loss::Stability,
                    },
                },
                (_, None) => LoadingEnd::Unknown { stable: at },
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
