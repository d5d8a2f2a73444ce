//! Files of measurements that are placed on a device.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::curve::Noise;
use super::device::{Device, Displacements, Load};
use super::dynamic::DynamicSet;
use super::field::{Field, SheetTable};
use super::file::{MeasuredFile, Measurement};
use super::orientation;
use super::table::{MeasuredTable, Rows, named_notes};
use deaflow_base::{InputError, Node};
use deaflow_fit::{
    Correlation, CreepCurve, Curve, DataSet, Elastomer, FieldImage, LawKind, SheetCurve, Sigma, Simulated,
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
    /// A point of a device over time, or its response to a small alternating voltage.
    Dynamic(DynamicSet),
}

/// A field of a device.
#[derive(Debug)]
pub struct FieldSet {
    pub(super) image: FieldImage,
    pattern: Pattern,
    load: Load,
    pub(super) correlation: Correlation,
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
        let on_membrane =
            |pattern: Pattern| {
                let point = settings.point_mm.unwrap_or_default();
                match device.on_membrane(&pattern, &[point])?[0] {
                    true => Ok((pattern, point)),
                    false => Err(refused("the point is not on the membrane")
                        .help("give its distance from the lower left corner")),
                }
            };
        let data = match rows {
            Rows::Motion(history) => {
                let (pattern, point) = on_membrane(pattern()?)?;
                Data::Dynamic(DynamicSet::of_history(history, pattern, point, &settings))
            }
            Rows::Response(response) => {
                let (pattern, point) = on_membrane(pattern()?)?;
                Data::Dynamic(DynamicSet::of_response(response, pattern, point, &settings))
            }
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
                let (pattern, point) = on_membrane(pattern()?)?;
                let load = |voltage: &f64| Load {
                    voltage_v: Some(*voltage),
                    points_mm: vec![point],
                };
                Data::Series(SeriesSet {
                    pattern,
                    loads: series.voltages_v.iter().map(load).collect(),
                    direction: settings.direction(),
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
            Data::Field(_) | Data::Series(_) | Data::Dynamic(_) => None,
        }
    }

    /// Returns whether it is of a device, which finite elements simulate.
    #[must_use]
    pub fn is_of_device(&self) -> bool {
        matches!(self.data, Data::Field(_) | Data::Series(_) | Data::Dynamic(_))
    }

    /// Simulates the measured numbers of a device for values of the parameters; none for a specimen.
    ///
    /// # Errors
    /// When there is no stable equilibrium, or a value is not allowed, with the reason.
    pub fn simulate(&self, device: &Device, values: &[f64]) -> Result<Simulated, String> {
        device.count();
        let (found, direction) = match &self.data {
            Data::Dynamic(set) => return set.simulate(device, values),
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
