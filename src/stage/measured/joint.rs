//! Fits parameters of a scene to several files of measurements at once.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::curve::Noise;
use super::described::{outlier, with_interval};
use super::device::{Device, Displacements, Load};
use super::field::{Field, SheetTable};
use super::file::{MeasuredFile, Measurement};
use super::free::{FreeKey, VOLTAGE_OFFSET};
use super::orientation;
use super::table::{MeasuredTable, Rows, named_notes};
use deaflow_base::{InputError, Node, four_significant, listed};
use deaflow_field::Mesh;
use deaflow_fit::{
    Correlation, CreepCurve, Curve, DataSet, Elastomer, FieldData, FieldImage, FreeParameter, JointFit, JointOptions,
    LawKind, Motion, NumberData, Parameter, Profiles, SheetCurve, Sigma, Simulated, Simulation, Verdict, Warning,
    fit_together,
};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// The distance in mm over which noise is correlated at most, where a file does not state it.
const CORRELATED_WITHIN: f64 = 8.0;

/// The least number of points of a field.
const LEAST_POINTS: usize = 3;

/// Points outside of the rectangle by less than this share of its side are on its edge.
const EDGE: f64 = 1e-4;

/// What a file has.
#[derive(Debug)]
pub enum Data {
    /// Stresses against stretches.
    Curve(Curve),
    /// Stretches of a sheet against voltages; its law is a placeholder.
    Sheet(SheetCurve),
    /// Stretches of a sheet over time; its elastomer is a placeholder.
    Creep(CreepCurve),
    /// A field of a device.
    Field(FieldSet),
    /// A point of a device against the voltage.
    Series(SeriesSet),
}

/// A field of a device.
#[derive(Debug)]
pub struct FieldSet {
    image: FieldImage,
    pattern: Pattern,
    load: Load,
    correlation: Correlation,
}

impl FieldSet {
    /// Returns the points and displacements.
    #[must_use]
    pub fn image(&self) -> &FieldImage {
        &self.image
    }
}

/// A point of a device against the voltage.
#[derive(Debug)]
pub struct SeriesSet {
    pattern: Pattern,
    pub(super) loads: Vec<Load>,
    direction: [f64; 2],
    pub(super) measured_mm: Vec<f64>,
    pub(super) sigma: Sigma,
}

impl SeriesSet {
    /// Simulates each row on its own; the reason where there is no stable equilibrium.
    pub(super) fn simulate_each(&self, device: &Device, values: &[f64]) -> Vec<Result<f64, String>> {
        let at = |load: &Load| {
            let found = device.simulate(&self.pattern, std::slice::from_ref(load), values)?;
            let found = Displacements::joined(&found, Some(self.direction)).values;
            found.first().copied().ok_or_else(|| "at a row".to_owned())
        };
        self.loads.par_iter().map(at).collect()
    }
}

/// A file of measurements that was read.
#[derive(Debug)]
pub struct MeasuredSet {
    /// Its name.
    pub name: String,
    /// What was measured.
    pub test: Measurement,
    /// The numbers.
    pub data: Data,
    /// What the reader did that a user should know.
    pub notes: Vec<String>,
}

/// Reads the files of a list. Stresses without a stated noise have the `usual` one.
///
/// # Errors
/// When one cannot be read, or a field has no point on the membrane.
pub fn read_sets(
    files: &[(MeasuredFile, Node)],
    device: &Device,
    scene: &Scene,
    usual: Noise,
) -> Result<Vec<MeasuredSet>, InputError> {
    let tables = MeasuredTable::read_all(files, Some(scene.form()), usual)?;
    let set = |(table, (_, node)): (MeasuredTable, &(MeasuredFile, Node))| {
        MeasuredSet::of_table(table, device, scene).map_err(|error| node.place(error))
    };
    tables.into_iter().zip(files).map(set).collect()
}

impl MeasuredSet {
    /// Places the files of a stage on a device, and passes what a user should know on to `note`.
    ///
    /// # Errors
    /// As [`MeasuredSet::of_table`].
    pub fn of_tables(
        tables: Vec<MeasuredTable>,
        device: &Device,
        scene: &Scene,
        note: impl Fn(&str),
    ) -> Result<Vec<Self>, InputError> {
        let place = |table| Self::of_table(table, device, scene);
        let sets: Vec<Self> = tables.into_iter().map(place).collect::<Result<_, _>>()?;
        let notes = sets.iter().flat_map(|set| named_notes(&set.name, &set.notes));
        notes.for_each(|text| note(&text));
        Ok(sets)
    }

    /// Places the measurements of a file on a device.
    ///
    /// # Errors
    /// When its pattern is not one of the device, or too few points are on the membrane.
    pub fn of_table(table: MeasuredTable, device: &Device, scene: &Scene) -> Result<Self, InputError> {
        let MeasuredTable {
            name,
            test,
            settings,
            rows,
            pattern,
            sigma_source: _,
            mut notes,
        } = table;
        let refused = |why: &str| InputError::new(format!("{name}: {why}"));
        let pattern = || {
            let pattern = pattern.ok_or_else(|| refused("it has no pattern"))?;
            let (raster, groups) = (scene.form().raster, scene.form().groups);
            match pattern.raster() == raster && pattern.groups() <= groups {
                true => Ok(pattern),
                false => Err(refused("its pattern was read for another device")
                    .help("the raster and the groups of electrodes are those of the scene of the pipeline")),
            }
        };
        let thickness_m = 1e-3 * scene.thickness_mm();
        let load = || settings.sheet_load(scene.mean_prestretch());
        let data = match rows {
            Rows::Curve(curve) => Data::Curve(curve),
            Rows::History(_) => {
                return Err(refused("relaxation is fitted alone, and not compared")
                    .help("fit the law first, then the relaxation with the fitted scene"));
            }
            Rows::Sheet(SheetTable { at, stretch, sigma }) => match test {
                Measurement::Creep => Data::Creep(CreepCurve {
                    name: name.clone(),
                    elastomer: Elastomer::elastic(LawKind::NeoHookean),
                    test: settings.sheet(),
                    load: load(),
                    voltage_v: settings.voltage_v.unwrap_or(0.0),
                    thickness_m,
                    time_s: at,
                    stretch,
                    sigma,
                }),
                _ => Data::Sheet(SheetCurve {
                    name: name.clone(),
                    law: LawKind::NeoHookean,
                    test: settings.sheet(),
                    load: load(),
                    thickness_m,
                    voltage_v: at,
                    stretch,
                    sigma,
                }),
            },
            Rows::Field(mut field) => {
                let pattern = pattern()?;
                let size_mm = scene.membrane().size_mm;
                notes.extend(keep_points(&mut field, device, &pattern, size_mm)?);
                let sigma = field.sigma_mm.as_deref();
                let image = FieldImage::new(&name, &field.points_mm, &field.displacements_mm, sigma);
                let image = image.map_err(|error| refused(&error.to_string()))?;
                if image.points().len() < LEAST_POINTS {
                    let found = image.points().len();
                    return Err(refused(&format!("{found} points of the field can be used"))
                        .help("a field needs at least three, beside which the motion of the camera is fitted"));
                }
                let load = Load {
                    voltage_v: settings.voltage_v,
                    points_mm: image.points().to_vec(),
                };
                notes.extend(orientation::better(device, &pattern, &load, image.measured(), size_mm));
                let within = settings.correlated_within_mm.unwrap_or(CORRELATED_WITHIN);
                Data::Field(FieldSet {
                    load,
                    image,
                    pattern,
                    correlation: match within > 0.0 {
                        true => Correlation::Estimated { within_mm: within },
                        false => Correlation::Independent,
                    },
                })
            }
            Rows::Series(series) => {
                let pattern = pattern()?;
                let point = settings.point_mm.unwrap_or_default();
                if !device.on_membrane(&pattern, &[point])?[0] {
                    return Err(refused("the point is not on the membrane")
                        .help("give its distance from the lower left corner"));
                }
                let radians = settings.direction_deg.unwrap_or(0.0).to_radians();
                let load = |voltage: &f64| Load {
                    voltage_v: Some(*voltage),
                    points_mm: vec![point],
                };
                Data::Series(SeriesSet {
                    pattern,
                    loads: series.voltages_v.iter().map(load).collect(),
                    direction: [radians.cos(), radians.sin()],
                    measured_mm: series.displacements_mm,
                    sigma: series.sigma,
                })
            }
        };
        Ok(Self {
            name,
            test,
            data,
            notes,
        })
    }
}

/// Moves points that rounding has put outside of the rectangle to its edge, leaves out those that are not on the
/// membrane, and averages rows at one point, whose noise is not that of different points. Returns notes.
fn keep_points(
    field: &mut Field,
    device: &Device,
    pattern: &Pattern,
    size_mm: [f64; 2],
) -> Result<Vec<String>, InputError> {
    let all = field.points_mm.len();
    for point in &mut field.points_mm {
        for (at, side) in point.iter_mut().zip(size_mm) {
            let near = at.clamp(0.0, side);
            if (*at - near).abs() <= EDGE * side {
                *at = near;
            }
        }
    }
    let inside = device.on_membrane(pattern, &field.points_mm)?;
    let is_number = |v: &[f64; 2]| v.iter().all(|at| at.is_finite());
    let (mut lost, mut joined) = (0, 0);
    let mut rows: BTreeMap<[u64; 2], Vec<usize>> = BTreeMap::new();
    for (row, (point, u)) in field.points_mm.iter().zip(&mut field.displacements_mm).enumerate() {
        match (is_number(point) && is_number(u), inside[row]) {
            (true, true) => {
                rows.entry(point.map(f64::to_bits)).or_default().push(row);
                continue;
            }
            (true, false) => lost += 1,
            // The reader has counted them.
            (false, _) => {}
        }
        *u = [f64::NAN; 2];
    }
    for same in rows.values().filter(|same| same.len() > 1) {
        joined += same.len();
        let count = same.len() as f64;
        let mean = [0, 1].map(|c: usize| same.iter().map(|row| field.displacements_mm[*row][c]).sum::<f64>() / count);
        for row in same {
            field.displacements_mm[*row] = [f64::NAN; 2];
        }
        field.displacements_mm[same[0]] = mean;
        if let Some(sigma) = &mut field.sigma_mm {
            let squares: f64 = same.iter().map(|row| sigma[*row] * sigma[*row]).sum();
            sigma[same[0]] = squares.sqrt() / count;
        }
    }
    let mut notes = Vec::new();
    if lost > 0 {
        let many = if 5 * lost > all {
            ": check `origin`, `turn`, `y` and `scale`"
        } else {
            ""
        };
        notes.push(format!(
            "{lost} of {all} points are not on the membrane, and are not used{many}"
        ));
    }
    if joined > 0 {
        notes.push(format!(
            "{joined} of {all} rows are at the points of others, and are averaged as independent ones"
        ));
    }
    Ok(notes)
}

impl MeasuredSet {
    /// Returns what the fit takes of a specimen or a sheet of an elastomer; `None` for a device.
    pub(super) fn of_elastomer(&self, elastomer: Elastomer) -> Option<DataSet<'static>> {
        match &self.data {
            Data::Curve(curve) => Some(DataSet::Curve(elastomer.law, curve.clone())),
            Data::Sheet(curve) => Some(DataSet::Sheet(SheetCurve {
                law: elastomer.law,
                ..curve.clone()
            })),
            Data::Creep(curve) => Some(DataSet::Creep(CreepCurve {
                elastomer,
                ..curve.clone()
            })),
            Data::Field(_) | Data::Series(_) => None,
        }
    }

    /// Returns whether it is of a device, which finite elements simulate.
    #[must_use]
    pub fn is_of_device(&self) -> bool {
        matches!(self.data, Data::Field(_) | Data::Series(_))
    }

    /// Simulates the measured numbers of a device for values of the parameters; none for a specimen.
    ///
    /// # Errors
    /// When there is no stable equilibrium, or a value is not allowed, with the reason.
    pub fn simulate(&self, device: &Device, values: &[f64]) -> Result<Simulated, String> {
        let (found, direction) = match &self.data {
            Data::Curve(_) | Data::Sheet(_) | Data::Creep(_) => (Vec::new(), None),
            Data::Field(set) => (
                device.simulate(&set.pattern, std::slice::from_ref(&set.load), values)?,
                None,
            ),
            Data::Series(set) => (device.simulate(&set.pattern, &set.loads, values)?, Some(set.direction)),
        };
        Ok(Displacements::joined(&found, direction))
    }
}

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
        Data::Field(_) | Data::Series(_) => false,
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
        Ok(Self {
            scene: device.scene(&rounded)?,
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
