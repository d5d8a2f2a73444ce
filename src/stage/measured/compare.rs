//! Measured beside simulated numbers, without a fit.

use super::device::Device;
use super::dynamic::{DynamicSet, Motions};
use super::joint::FINEST;
use super::set::{Data, MeasuredSet};
use deaflow_base::InputError;
use deaflow_content::Quantities;
use deaflow_fem::screening::resolve;
use deaflow_field::Mesh;
use deaflow_fit::{Curve, DataSet, ImageResult, Motion, SheetCurve, Sigma, simulate};
use deaflow_scene::Scene;
use deaflow_scene::effects::{Effects, On, names};

/// How well a simulation agrees with measurements; all differences are measured − simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// The number of compared points.
    pub points: usize,
    /// The mean difference; none of a field, where it is that of the camera.
    pub bias: Option<f64>,
    /// The root mean square of the difference; of a field, of its components.
    pub rms: f64,
    /// The largest difference, and its row from 1.
    pub largest: (f64, usize),
    /// 1 − Σ(measured − simulated)²/Σ(measured − mean)², without the motion of the camera; `None` if all measured
    /// numbers are equal.
    pub r_squared: Option<f64>,
    /// χ² per degree of freedom, if standard deviations are stated.
    pub chi2_per_dof: Option<f64>,
}

/// Measured and simulated numbers.
#[derive(Clone, Debug)]
pub enum Values {
    /// Displacements in mm at points of a device.
    Field {
        /// The points on the membrane at rest, in mm.
        points_mm: Vec<[f64; 2]>,
        /// The row of each point, from 1.
        rows: Vec<usize>,
        /// The simulated displacements, without the motion of the camera.
        simulated_mm: Vec<[f64; 2]>,
        /// The motion of the camera and the differences.
        result: Box<ImageResult>,
    },
    /// Numbers against others, by row.
    Series {
        /// What they are.
        quantities: Quantities,
        /// The row of each number, from 1.
        rows: Vec<usize>,
        /// What they are measured against.
        at: Vec<f64>,
        /// The measured numbers.
        measured: Vec<f64>,
        /// The simulated numbers.
        simulated: Vec<f64>,
    },
}

impl Values {
    /// Returns what is compared.
    #[must_use]
    pub fn quantities(&self) -> Quantities {
        match self {
            Self::Field { .. } => Quantities::Field,
            Self::Series { quantities, .. } => *quantities,
        }
    }
}

/// A file of measurements beside the simulation.
#[derive(Clone, Debug)]
pub struct Compared {
    /// The name of the file.
    pub name: String,
    /// How well they agree.
    pub agreement: Agreement,
    /// The numbers.
    pub values: Values,
    /// The rows from 1 at which the simulation has no stable equilibrium; they are not compared.
    pub without_equilibrium: Vec<usize>,
}

impl Compared {
    /// Compares numbers that are measured against others. Rows without a simulated number are left out.
    pub(super) fn series(
        name: &str,
        quantities: Quantities,
        (at, measured, simulated): (&[f64], &[f64], Vec<Option<f64>>),
        sigma: &Sigma,
    ) -> Self {
        let kept: Vec<usize> = (0..simulated.len()).filter(|row| simulated[*row].is_some()).collect();
        let of = |all: &[f64]| -> Vec<f64> { kept.iter().map(|row| all[*row]).collect() };
        let (at, measured) = (of(at), of(measured));
        let sigma = match sigma {
            Sigma::Stated(all) => Sigma::Stated(of(all)),
            other => other.clone(),
        };
        let without_equilibrium = (1..=simulated.len()).filter(|row| simulated[row - 1].is_none());
        let without_equilibrium = without_equilibrium.collect();
        let simulated: Vec<f64> = simulated.into_iter().flatten().collect();
        let rows: Vec<usize> = kept.iter().map(|row| row + 1).collect();
        Self {
            name: name.to_owned(),
            agreement: Agreement::new(&rows, &measured, &simulated, &sigma),
            values: Values::Series {
                quantities,
                rows,
                at,
                measured,
                simulated,
            },
            without_equilibrium,
        }
    }
}

/// Root mean squares that differ by less than this share on two meshes do not depend on the mesh.
const SAME: f64 = 0.01;

/// Compares all sets, on finer meshes until the root mean squares no longer change if `refines`; returns the mesh too.
///
/// # Errors
/// As [`compare`].
pub fn compare_all(
    device: &Device,
    sets: &[MeasuredSet],
    values: &[f64],
    refines: bool,
) -> Result<(Vec<Compared>, Mesh), InputError> {
    let on = |mesh: Mesh| -> Result<Vec<Compared>, InputError> {
        let device = device.on(mesh);
        of_sets(&device, sets, values)
    };
    let mut mesh = device.options().mesh;
    let mut compared = on(mesh)?;
    while refines && mesh.elements_per_cell() < FINEST {
        mesh = Mesh::new(2 * mesh.elements_per_cell(), mesh.order());
        let finer = on(mesh)?;
        let mut pairs = compared.iter().zip(&finer);
        let is_same =
            |(a, b): (&Compared, &Compared)| (a.agreement.rms - b.agreement.rms).abs() <= SAME * b.agreement.rms;
        let settled = pairs.all(is_same);
        compared = finer;
        if settled {
            break;
        }
    }
    Ok((compared, mesh))
}

/// Compares all sets; a frequency response gives one comparison for amplitudes and one for phases.
fn of_sets(device: &Device, sets: &[MeasuredSet], values: &[f64]) -> Result<Vec<Compared>, InputError> {
    let each = sets.iter().map(|set| match &set.data {
        Data::Dynamic(own) => motions(device, set, own, values),
        _ => compare(device, set, values).map(|one| vec![one]),
    });
    let all: Vec<Vec<Compared>> = each.collect::<Result<_, _>>()?;
    Ok(all.into_iter().flatten().collect())
}

/// Compares the motion of a point.
fn motions(device: &Device, set: &MeasuredSet, own: &DynamicSet, values: &[f64]) -> Result<Vec<Compared>, InputError> {
    let refused = |why: String| InputError::new(format!("{}: {why}", set.name));
    let one = |found: Motions<'_>| {
        if let (true, Some(Err(why))) = (found.simulated.iter().all(Result::is_err), found.simulated.first()) {
            return Err(refused(format!("no state {why}")));
        }
        let name = match found.quantities {
            Quantities::FrequencyPhase => format!("{}, phase", set.name),
            _ => set.name.clone(),
        };
        let simulated = found.simulated.into_iter().map(Result::ok).collect();
        let numbers = (found.at, found.measured, simulated);
        Ok(Compared::series(&name, found.quantities, numbers, &found.sigma))
    };
    own.motions(device, values)
        .map_err(refused)?
        .into_iter()
        .map(one)
        .collect()
}

/// Describes why there is no simulated number: no equilibrium at a load, or a device that cannot be simulated.
fn why_not(why: &str) -> String {
    match why.starts_with("at ") {
        true => format!("no equilibrium {why}"),
        false => why.to_owned(),
    }
}

/// Simulates the measured numbers of a set with values of the free parameters; a motion gives the first of its
/// comparisons.
///
/// # Errors
/// When there is no stable equilibrium, or the law has no stress at a stretch.
pub fn compare(device: &Device, set: &MeasuredSet, values: &[f64]) -> Result<Compared, InputError> {
    let refused = |why: String| InputError::new(format!("{}: {why}", set.name));
    let series = |quantities, numbers: (&[f64], &[f64], Vec<Result<f64, String>>), sigma: &Sigma| {
        let (at, measured, simulated) = numbers;
        // Without any number there is nothing to compare.
        if simulated.iter().all(Result::is_err)
            && let Some(Err(why)) = simulated.first()
        {
            return Err(refused(why_not(why)));
        }
        let simulated = simulated.into_iter().map(Result::ok).collect();
        Ok(Compared::series(
            &set.name,
            quantities,
            (at, measured, simulated),
            sigma,
        ))
    };
    match &set.data {
        Data::Dynamic(own) => {
            let mut all = motions(device, set, own, values)?;
            Ok(all.swap_remove(0))
        }
        Data::Field(own) => {
            let simulated = set.simulate(device, values);
            let simulated = simulated.map_err(|why| refused(why_not(&why)))?;
            let simulated_mm: Vec<[f64; 2]> = simulated.values.chunks_exact(2).map(|u| [u[0], u[1]]).collect();
            let result = own
                .image()
                .compare(&simulated_mm, Motion::Fitted, 0)
                .map_err(|error| refused(error.to_string()))?;
            let found = &result.statistics;
            let agreement = Agreement {
                points: found.points,
                bias: None,
                rms: found.rms_mm,
                largest: (found.largest_mm, found.largest_at.1),
                r_squared: r_squared_of_field(&simulated_mm, &result.residual_mm),
                chi2_per_dof: found.chi2_per_dof,
            };
            Ok(Compared {
                name: set.name.clone(),
                agreement,
                values: Values::Field {
                    points_mm: own.image().points().to_vec(),
                    rows: own.image().rows().to_vec(),
                    simulated_mm,
                    result: Box::new(result),
                },
                without_equilibrium: Vec::new(),
            })
        }
        Data::Series(own) => {
            let at: Vec<f64> = own.loads.iter().filter_map(|load| load.voltage_v).collect();
            let numbers = (&at[..], &own.measured_mm[..], own.simulate_each(device, values));
            series(Quantities::VoltageDisplacement, numbers, &own.sigma)
        }
        Data::Curve(curve) => {
            let simulated = stresses(device, curve, values).map_err(|error| refused(error.to_string()))?;
            let simulated = simulated.into_iter().map(Ok).collect();
            let numbers = (&curve.stretch[..], &curve.stress_pa[..], simulated);
            series(Quantities::StretchStress, numbers, &curve.sigma)
        }
        Data::Sheet(curve) => {
            let (elastomer, known) = device.elastomer(values)?;
            // A sheet has an equilibrium at each voltage of its own.
            let at = |row: usize| {
                let one = SheetCurve {
                    law: elastomer.law,
                    voltage_v: vec![curve.voltage_v[row]],
                    stretch: vec![curve.stretch[row]],
                    sigma: Sigma::UnstatedAbsolute,
                    ..curve.clone()
                };
                let found = simulate(&DataSet::Sheet(one), &known);
                let found = found.map_err(|error| error.to_string())?;
                found.first().copied().ok_or_else(|| "at a row".to_owned())
            };
            let simulated = (0..curve.stretch.len()).map(at).collect();
            series(
                Quantities::VoltageStretch,
                (&curve.voltage_v[..], &curve.stretch[..], simulated),
                &curve.sigma,
            )
        }
        Data::Creep(curve) => {
            let (elastomer, known) = device.elastomer(values)?;
            let data = set.of_elastomer(elastomer);
            let simulated = data.map_or(Ok(Vec::new()), |data| simulate(&data, &known));
            let simulated = simulated.map_err(|error| refused(error.to_string()))?;
            let simulated = simulated.into_iter().map(Ok).collect();
            let numbers = (&curve.time_s[..], &curve.stretch[..], simulated);
            series(Quantities::TimeStretch, numbers, &curve.sigma)
        }
    }
}

/// A neglected effect, and how a simulation with it would agree.
#[derive(Clone, Debug)]
pub struct WithEffect {
    /// The name of the effect.
    pub effect: &'static str,
    /// The agreement of each set, or why there is none.
    pub agreements: Result<Vec<Agreement>, String>,
}

/// Compares each set with simulations in which one more effect is on: those that change an equilibrium, are off, and
/// whose data the scene has. The device, its values and the
/// comparison without further effects are those of [`compare_all`].
///
/// # Errors
/// When the effects of the scene cannot be decided.
pub fn with_neglected_effects(
    scene: &Scene,
    device: &Device,
    (sets, compared): (&[MeasuredSet], &[Compared]),
    values: &[f64],
) -> Result<Vec<WithEffect>, InputError> {
    let scene = resolve(scene).map_err(|error| InputError::new(error.to_string()))?;
    let keys: Vec<String> = device.keys().iter().map(|key| key.path.clone()).collect();
    let agreements = |effects: Effects| -> Result<Vec<Agreement>, InputError> {
        let device = Device::new(&scene.with_effects(effects), &keys, device.options())?;
        let found = of_sets(&device, sets, values)?;
        // Agreements over other rows say nothing about the effect.
        let mut pairs = found.iter().zip(compared);
        match pairs.find(|(own, other)| own.without_equilibrium != other.without_equilibrium) {
            Some((own, _)) => Err(InputError::new(format!(
                "{}: no equilibrium at {} of its rows",
                own.name,
                own.without_equilibrium.len()
            ))),
            None => Ok(found.into_iter().map(|own| own.agreement).collect()),
        }
    };
    let of = |(effect, effects)| WithEffect {
        effect,
        agreements: agreements(effects).map_err(|error| error.to_string()),
    };
    Ok(neglected(&scene).into_iter().map(of).collect())
}

/// Returns the effects of a scene with each neglected one.
fn neglected(scene: &Scene) -> Vec<(&'static str, Effects)> {
    let (on, known) = (&scene.effects, &scene.properties);
    let mut all = Vec::new();
    let mut add = |name, add: &dyn Fn(&mut Effects)| {
        let mut effects = on.clone();
        add(&mut effects);
        if effects != *on {
            all.push((name, effects));
        }
    };
    if on.strain_stiffening.is_none() {
        add(names::STIFFENING, &|own| {
            own.strain_stiffening.clone_from(&known.strain_stiffening)
        });
    }
    if on.electrode_stiffness.is_none() {
        add(names::ELECTRODE, &|own| {
            own.electrode_stiffness.clone_from(&known.electrode_stiffness)
        });
    }
    if on.stretch_dependent_permittivity.is_none() {
        let decay = &known.stretch_dependent_permittivity;
        add(names::PERMITTIVITY, &|own| {
            own.stretch_dependent_permittivity.clone_from(decay)
        });
    }
    add(names::FRINGE, &|own| own.fringe_field = Some(On {}));
    add(names::WRINKLING, &|own| own.wrinkling = Some(On {}));
    all
}

/// Returns the nominal stresses of the law of a scene at the stretches of a curve.
fn stresses(device: &Device, curve: &Curve, values: &[f64]) -> Result<Vec<f64>, InputError> {
    let (elastomer, known) = device.elastomer(values)?;
    let names = elastomer.law.parameters();
    let value = |name: &String| known.iter().find(|(own, _)| own == name).map(|(_, value)| *value);
    let law = names.iter().map(value).collect::<Option<Vec<f64>>>();
    let law = law.and_then(|values| elastomer.law.with(&values));
    let at = |(row, stretch): (usize, &f64)| {
        let stress = law.as_ref().and_then(|law| law.nominal_stress(curve.test, *stretch));
        stress.ok_or_else(|| {
            InputError::new(format!(
                "row {}: the law has no stress at a stretch of {stretch}",
                row + 1
            ))
        })
    };
    curve.stretch.iter().enumerate().map(at).collect()
}

/// Returns R²; `None` if the measured numbers do not differ.
fn share_explained(squares: f64, spread: f64) -> Option<f64> {
    (spread > 0.0).then(|| 1.0 - squares / spread).filter(|r| r.is_finite())
}

/// Returns R² of a field whose measured displacements are the simulated ones and the differences.
fn r_squared_of_field(simulated_mm: &[[f64; 2]], differences_mm: &[[f64; 2]]) -> Option<f64> {
    let measured = || {
        let pairs = simulated_mm.iter().zip(differences_mm);
        pairs.map(|(u, d)| [u[0] + d[0], u[1] + d[1]])
    };
    let count = simulated_mm.len() as f64;
    let mean = [0, 1].map(|c: usize| measured().map(|u| u[c]).sum::<f64>() / count);
    let spread: f64 = measured()
        .map(|u| (u[0] - mean[0]).powi(2) + (u[1] - mean[1]).powi(2))
        .sum();
    let squares: f64 = differences_mm.iter().map(|d| d[0] * d[0] + d[1] * d[1]).sum();
    share_explained(squares, spread)
}

impl Agreement {
    fn new(rows: &[usize], measured: &[f64], simulated: &[f64], sigma: &Sigma) -> Self {
        let points = measured.len();
        let differences: Vec<f64> = measured.iter().zip(simulated).map(|(m, s)| m - s).collect();
        let count = points as f64;
        let mean = measured.iter().sum::<f64>() / count;
        let squares: f64 = differences.iter().map(|d| d * d).sum();
        let spread: f64 = measured.iter().map(|m| (m - mean).powi(2)).sum();
        let largest =
            differences.iter().zip(rows).fold(
                (0.0, 1),
                |most: (f64, usize), (d, row)| {
                    if d.abs() > most.0.abs() { (*d, *row) } else { most }
                },
            );
        let sigmas: Option<Vec<f64>> = match sigma {
            Sigma::Stated(all) => Some(all.clone()),
            Sigma::StatedFraction(share) => Some(measured.iter().map(|m| share * m.abs()).collect()),
            Sigma::UnstatedRelative | Sigma::UnstatedAbsolute => None,
        };
        let chi2 = |sigmas: Vec<f64>| {
            let terms = differences.iter().zip(sigmas).filter(|(_, sigma)| *sigma > 0.0);
            terms.map(|(d, sigma)| (d / sigma).powi(2)).sum::<f64>() / count
        };
        Self {
            points,
            bias: Some(differences.iter().sum::<f64>() / count),
            rms: (squares / count).sqrt(),
            largest,
            r_squared: share_explained(squares, spread),
            chi2_per_dof: sigmas.map(chi2),
        }
    }
}
