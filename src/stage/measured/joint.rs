//! Fits parameters of a scene to several files of measurements at once.

use std::path::Path;

use super::described::{outlier, with_interval};
use super::device::Device;
use super::free::{FreeKey, VOLTAGE_OFFSET};
use super::set::{Data, MeasuredSet};
use deaflow_base::{Document, InputError, four_significant, listed};
use deaflow_field::Mesh;
use deaflow_fit::{
    DataSet, Elastomer, FieldData, FreeParameter, JointFit, JointOptions, LawKind, Motion, NumberData, Parameter,
    Profiles, Simulated, Simulation, Verdict, Warning, fit_together,
};
use deaflow_scene::Scene;
use deaflow_scene::effects::names;

/// Shifts of parameters below this share of their standard errors do not matter.
pub const SETTLED: f64 = 0.1;
/// The most elements along a cell that a fit refines its mesh to.
pub(super) const FINEST: usize = 4;

/// A fit of parameters of a scene to files of measurements.
pub struct SceneFit {
    /// The fit; its parameters have the names of [`Device::keys`].
    pub fit: JointFit,
    /// The scene with the fitted values and decided effects, without the voltage offset.
    pub scene: Scene,
    /// The mesh of the fit; `None` without devices.
    pub mesh: Option<Mesh>,
    /// The largest change of a parameter from the mesh with elements of twice the size, in standard errors; `None` if
    /// the mesh was given, or there is no device.
    pub shift: Option<f64>,
}

/// Refuses free parameters that a curve or a sheet depends on, but takes from the scene as it is.
fn check_free(device: &Device, sets: &[MeasuredSet]) -> Result<(), InputError> {
    let fixed = |set: &MeasuredSet, path: &str| match &set.data {
        Data::Curve(_) => path.contains(".terms."),
        Data::Sheet(_) | Data::Creep(_) => {
            path.contains(".terms.") || path == "geometry.thickness" || path.starts_with("geometry.prestretch")
        }
        Data::Field(_) | Data::Series(_) | Data::Dynamic(_) => false,
    };
    let pairs = sets
        .iter()
        .flat_map(|set| device.keys().iter().map(move |key| (set, key)));
    match pairs.into_iter().find(|(set, key)| fixed(set, &key.path)) {
        Some((set, key)) => Err(InputError::new(format!(
            "`{}` cannot be fitted to {}, which is a `{}`",
            key.path,
            set.name,
            set.test.name()
        ))
        .help("fit it to devices alone")),
        None => Ok(()),
    }
}

/// Fits the free parameters of a device, on finer meshes until they no longer change if `refines`.
///
/// # Errors
/// When the data cannot determine the parameters, or there is no state at the first values.
pub fn fit_scene(device: &Device, sets: &[MeasuredSet], refines: bool) -> Result<SceneFit, InputError> {
    check_free(device, sets)?;
    let first = device.first_values();
    for set in sets {
        let simulated = set.simulate(device, &first);
        simulated.map_err(|why| {
            InputError::new(format!("{}: the scene has no state to start from {why}", set.name))
                .help("start from a scene that is stable at the measured loads, such as a stiffer one")
        })?;
    }
    let has_devices = sets.iter().any(MeasuredSet::is_of_device);
    if !has_devices || !refines {
        let fit = fit_on(device, sets, &first, Profiles::Wide)?;
        return SceneFit::new(device, fit, has_devices, None);
    }
    let mut device = device.clone();
    let mut fit = fit_on(&device, sets, &first, Profiles::Never)?;
    loop {
        let mesh = device.options().mesh;
        let finer = Mesh::new(2 * mesh.elements_per_cell(), mesh.order());
        device = device.on(finer);
        let next = fit_on(&device, sets, &values(&fit), Profiles::Never)?;
        let shift = shift(&fit, &next);
        fit = next;
        if shift <= SETTLED || finer.elements_per_cell() >= FINEST {
            let fit = fit_on(&device, sets, &values(&fit), Profiles::Wide)?;
            return SceneFit::new(&device, fit, true, Some(shift));
        }
    }
}

/// Returns whether a parameter of an effect is free.
fn frees(keys: &[FreeKey], effect: &str) -> bool {
    let parameters = format!("effects.{effect}.");
    keys.iter().any(|key| key.path.starts_with(&parameters))
}

/// Returns whether fits of earlier versions left the law or the branches of the former elastomer among the properties
/// of the fitted scene: `free` names the free parameters, or nothing if laws or branches are fitted.
#[must_use]
pub fn replaces_known_elastomer(scene: &Scene, free: Option<&[String]>) -> bool {
    let (known, mut effects) = (&scene.properties, scene.effects.clone());
    let has_known = known.strain_stiffening.is_some() || known.viscoelasticity.is_some();
    let Some(free) = free.filter(|_| has_known) else {
        return has_known && !scene.auto;
    };
    // What `effects: auto` may turn on is free, too.
    effects.strain_stiffening = effects.strain_stiffening.or_else(|| known.strain_stiffening.clone());
    effects.viscoelasticity = effects.viscoelasticity.or_else(|| known.viscoelasticity.clone());
    let text = scene.with_effects(effects).to_text();
    let Ok(document) = Document::from_text(Path::new("scene"), &text) else {
        return false;
    };
    let found = free.iter().filter_map(|key| FreeKey::find(&document.root, key).ok());
    let keys: Vec<FreeKey> = found.collect();
    known.strain_stiffening.is_some() && frees(&keys, names::STIFFENING)
        || known.viscoelasticity.is_some() && frees(&keys, names::VISCOELASTICITY)
}

fn values(fit: &JointFit) -> Vec<f64> {
    fit.estimate
        .parameters
        .iter()
        .map(|parameter| parameter.value)
        .collect()
}

/// Returns the largest change of a parameter from one fit to another, in standard errors of the second.
fn shift(first: &JointFit, second: &JointFit) -> f64 {
    let pairs = first.estimate.parameters.iter().zip(&second.estimate.parameters);
    let change = |(first, second): (&Parameter, &Parameter)| {
        let change = match second.logarithmic {
            true => (second.value / first.value).ln().abs(),
            false => (second.value - first.value).abs(),
        };
        second.standard_error.map_or(0.0, |error| change / error)
    };
    pairs.map(change).fold(0.0, f64::max)
}

impl SceneFit {
    /// Returns the fitted values of the parameters.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        values(&self.fit)
    }

    fn new(device: &Device, fit: JointFit, has_devices: bool, shift: Option<f64>) -> Result<Self, InputError> {
        let rounded: Vec<f64> = fit.estimate.parameters.iter().map(rounded).collect();
        let mut scene = device.scene(&rounded)?;
        // What the scene knows of its former elastomer does not hold for the fitted one.
        let (effects, known) = (&scene.effects, &mut scene.properties);
        if known.strain_stiffening.is_some() && frees(device.keys(), names::STIFFENING) {
            known.strain_stiffening.clone_from(&effects.strain_stiffening);
        }
        if known.viscoelasticity.is_some() && frees(device.keys(), names::VISCOELASTICITY) {
            known.viscoelasticity.clone_from(&effects.viscoelasticity);
        }
        Ok(Self {
            scene,
            fit,
            mesh: has_devices.then_some(device.options().mesh),
            shift,
        })
    }

    /// Returns what a user should know before using the fit.
    ///
    /// # Errors
    /// If the effects at the fitted values cannot be decided.
    pub fn warnings(&self, device: &Device) -> Result<Vec<String>, InputError> {
        const OUTLIERS: usize = 5;
        let (fit, keys) = (&self.fit, device.keys());
        // The reader has counted rows that were left out.
        let own = fit
            .warnings
            .iter()
            .filter(|warning| !matches!(warning, Warning::Dropped { .. }));
        let mut warnings: Vec<String> = own.map(ToString::to_string).collect();
        let values = self.values();
        if let Some(other) = device.other_effects(&values)? {
            let named = |effects: &[String]| {
                if effects.is_empty() {
                    "none".to_owned()
                } else {
                    listed(effects)
                }
            };
            warnings.push(format!(
                "`effects: auto` was decided at the first values of the parameters ({}); at the fitted values it is: \
                 {}. Fit again from a scene with these values",
                named(device.effects()),
                named(&other)
            ));
        }
        for (_, key) in pairs(self, keys).filter(|(parameter, _)| parameter.at_bound) {
            warnings.push(format!("{} is at its bound: its value says nothing", key.path));
        }
        if let Some(shift) = self.shift.filter(|shift| *shift > SETTLED) {
            warnings.push(format!(
                "the finest mesh still changes the parameters by {} standard errors: use order 2, or more elements per \
                 cell",
                four_significant(shift)
            ));
        }
        if fit.verdict != Verdict::Determined {
            warnings.push(fit.verdict.to_string());
        }
        warnings.extend(
            fit.outliers
                .iter()
                .take(OUTLIERS)
                .map(|found| format!("outlier: {}", outlier(found))),
        );
        if fit.outliers.len() > OUTLIERS {
            warnings.push(format!("{} more outliers", fit.outliers.len() - OUTLIERS));
        }
        if let Some((parameter, key)) = pairs(self, keys).find(|(_, key)| key.path == VOLTAGE_OFFSET) {
            let [value, _] = with_interval(parameter, key, true);
            warnings.push(format!(
                "the scene has no offset: add {value} to the voltages of the supply, as in compare --voltage-offset"
            ));
        }
        Ok(warnings)
    }
}

/// Returns the parameters with their keys.
fn pairs<'a>(found: &'a SceneFit, keys: &'a [FreeKey]) -> impl Iterator<Item = (&'a Parameter, &'a FreeKey)> {
    found.fit.estimate.parameters.iter().zip(keys)
}

/// Rounds a value to a thousandth of its standard error, so that another processor gives the same scene.
#[must_use]
pub fn rounded(parameter: &Parameter) -> f64 {
    let error = parameter.standard_error.map(|error| match parameter.logarithmic {
        true => error * parameter.value.abs(),
        false => error,
    });
    let step = 1e-3
        * error
            .filter(|error| *error > 0.0)
            .unwrap_or(1e-6 * parameter.value.abs());
    let decimals = (-step.log10().floor()).clamp(0.0, 15.0) as usize;
    let text = format!("{:.decimals$}", parameter.value);
    text.parse().unwrap_or(parameter.value)
}

/// Returns starts at which the first positive parameters are smaller or larger.
fn around(parameters: &[FreeParameter]) -> Vec<Vec<f64>> {
    const FACTORS: [f64; 5] = [0.4, 0.7, 1.0, 1.5, 2.5];
    const VARIED: usize = 3;
    let mut starts = vec![parameters.iter().map(|parameter| parameter.start).collect::<Vec<f64>>()];
    let positive = (0..parameters.len()).filter(|at| parameters[*at].lower > 0.0);
    for at in positive.take(VARIED) {
        let (low, high) = (parameters[at].lower, parameters[at].upper);
        let varied = |start: &Vec<f64>| {
            FACTORS.map(|factor| {
                let mut start = start.clone();
                start[at] = (factor * start[at]).clamp(low, high);
                start
            })
        };
        starts = starts.iter().flat_map(varied).collect();
    }
    starts
}

/// Returns the simulation of a set; values of the parameters without a state have none.
fn evaluator<'a>(
    device: &'a Device,
    set: &'a MeasuredSet,
) -> impl Fn(&[f64]) -> Result<Option<Simulated>, String> + use<'a> {
    move |values| Ok(set.simulate(device, values).ok())
}

fn fit_on(device: &Device, sets: &[MeasuredSet], start: &[f64], profiles: Profiles) -> Result<JointFit, InputError> {
    let parameters: Vec<FreeParameter> = device
        .keys()
        .iter()
        .zip(start)
        .map(|(key, start)| FreeParameter {
            start: *start,
            ..key.parameter()
        })
        .collect();
    let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
    let (elastomer, fixed) = match sets.iter().all(MeasuredSet::is_of_device) {
        true => (Elastomer::elastic(LawKind::NeoHookean), Vec::new()),
        false => device.elastomer(start)?,
    };
    let evaluators: Vec<_> = sets.iter().map(|set| evaluator(device, set)).collect();
    let data = sets.iter().zip(&evaluators).map(|(set, evaluate)| {
        let simulation = || Simulation {
            parameters: names.clone(),
            evaluate,
        };
        match &set.data {
            Data::Field(own) => Some(DataSet::Field(FieldData {
                name: set.name.clone(),
                images: vec![own.image.clone()],
                motion: Motion::Fitted,
                correlation: own.correlation,
                simulation: simulation(),
            })),
            Data::Series(own) => Some(DataSet::Numbers(NumberData {
                name: set.name.clone(),
                measured: own.measured_mm.clone(),
                sigma: own.sigma.clone(),
                simulation: simulation(),
            })),
            Data::Dynamic(own) => {
                let (measured, sigma) = own.numbers();
                Some(DataSet::Numbers(NumberData {
                    name: set.name.clone(),
                    measured,
                    sigma,
                    simulation: simulation(),
                }))
            }
            Data::Curve(_) | Data::Sheet(_) | Data::Creep(_) => set.of_elastomer(elastomer),
        }
    });
    let data: Vec<DataSet<'_>> = data.flatten().collect();
    // Simulations of specimens take no time, and a search may end at the edge of pull-in.
    let has_devices = sets.iter().any(MeasuredSet::is_of_device);
    let options = JointOptions {
        fixed,
        profiles,
        more_starts: if has_devices { Vec::new() } else { around(&parameters) },
    };
    fit_together(&parameters, &data, &options).map_err(|error| InputError::new(error.to_string()))
}
