//! `deaflow yield`: how many devices of a pattern reach a displacement under the tolerances of a scene.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{
    DrawingArguments, EdgesArguments, StateArguments, TimeArguments, has_hdf5_extension, integer, quantity,
};
use super::pipeline::warn_of_scene;
use super::point::{PointArguments, Probe};
use super::progress::Bar;
use super::text::Text;
use super::{CliError, Exit, Output, csv, model_warnings, table, write};
use deaflow_base::{CsvColumn, Dimension, Length, Progress, four_digits, is_interrupted, measured};
use deaflow_fem::SolveOptions;
use deaflow_fem::screening::resolve;
use deaflow_field::{Mesh, Order};
use deaflow_pattern::{DrawingOptions, Pattern};
use deaflow_stage::direct;
use deaflow_tolerance::{
    Device, Estimate, Failure, MOST_SAMPLES, Quantile, Source, Study, ToleranceError, Wanted, Yield, share_within,
};

/// Shares of the variance below this are not listed for people.
const LISTED: f64 = 0.005;

/// Show how many devices reach a displacement under the tolerances of a scene
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow yield scene.yaml mine.csv --point \"25 mm, 25 mm\" --direction \"0 deg\" --wanted \"2 mm\"",
    "deaflow yield scene.yaml mine.csv --point \"25 mm, 25 mm\" --set \"tolerances={ thickness: 3 % }\"",
))]
pub struct YieldArguments {
    /// The scene with its `tolerances`: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    /// Patterns: FILE.npy, FILE.csv, pictures, drawings, or FILE.h5:/dataset
    #[arg(value_name = "PATTERN", required = true)]
    pub patterns: Vec<String>,
    #[command(flatten)]
    drawings: DrawingArguments,
    #[command(flatten)]
    edges: EdgesArguments,
    #[command(flatten)]
    point: PointArguments,
    /// The displacement that a device has to reach, as in "2 mm", or "90 %" of that of the pattern as drawn
    #[arg(long, value_name = "LENGTH|SHARE", value_parser = wanted, allow_hyphen_values = true)]
    wanted: Option<Wanted>,
    /// Number of devices
    #[arg(long, value_name = "N", default_value = "1000", value_parser = integer::<u32>(2..=u64::from(MOST_SAMPLES)))]
    samples: u32,
    /// Double the number of devices, up to 65536, until the interval of the yield is at most this far from it, as in
    /// "1 %"
    #[arg(long, value_name = "SHARE", value_parser = share, requires = "wanted")]
    within: Option<f64>,
    /// Seed of the random deviations
    #[arg(long, value_name = "N", default_value = "0", value_parser = integer::<u64>(0..=i64::MAX as u64))]
    seed: u64,
    /// Elements along one side of a cell
    #[arg(long, value_name = "N", default_value = "1", value_parser = integer::<u64>(1..=8))]
    elements_per_cell: u64,
    /// Polynomial order of the elements: 1 or 2
    #[arg(long, value_name = "N", default_value = "1", value_parser = integer::<u64>(1..=2))]
    order: u64,
    /// Override a value of the scene, such as tolerances.mask="0.2 mm"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    /// The file for the table of all devices; an existing file is replaced [default: none]
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
    #[command(flatten)]
    pub time: TimeArguments,
    #[command(flatten)]
    pub state: StateArguments,
}

fn wanted(text: &str) -> Result<Wanted, String> {
    if let Some(share) = Wanted::percentage(text) {
        return share;
    }
    let length = Length::from_base(quantity(text, Dimension::Length)?.base());
    Ok(Wanted::Length(length))
}

fn share(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let value = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse().map(|percent: f64| 0.01 * percent),
        None => text.parse(),
    };
    let value = value.ok().filter(|value| (1e-4..=0.5).contains(value));
    value.ok_or_else(|| "allowed: 0.01 % to 50 %".to_owned())
}

/// The devices of a scene, and those on another mesh for an estimate of the error.
struct Studies {
    of_devices: Study,
    on_other_mesh: Study,
}

/// The devices of a pattern.
struct Found {
    file: String,
    nominal: Option<f64>,
    /// The displacement as drawn on another mesh less that on the mesh of the devices, mm.
    mesh_change: Option<f64>,
    /// The displacement that devices have to reach, mm.
    wanted_mm: Option<f64>,
    devices: Vec<Device>,
    result: Yield,
}

pub fn execute(arguments: &YieldArguments, output: &Output) -> Result<Exit, CliError> {
    if let Some(file) = &arguments.output {
        let inputs = [arguments.patterns.clone(), direct::files_read(&arguments.scene)].concat();
        write::check_output(file, &inputs)?;
        if has_hdf5_extension(file) {
            return Err(CliError::bad_input(format!("{} is not a table", file.display()))
                .help("the devices are written as comma-separated values: -o devices.csv"));
        }
    }
    let changes = direct::Changes {
        sets: &arguments.sets,
        voltage: None,
    };
    let read = direct::read_scene_with(&arguments.scene, changes)?;
    warn_of_scene(&read, output);
    let tolerances = read.tolerances;
    let scene = arguments.state.of(read.scene)?;
    let names: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    if !names.is_empty() {
        return Err(CliError::bad_input("a yield is computed for one state of a device")
            .help(format!("choose a state with --state: {}", names.join(", "))));
    }
    let probe = arguments.point.on(&scene)?.ok_or_else(|| {
        CliError::bad_input("no point is given")
            .help("add the point whose displacement counts, as in --point \"25 mm, 25 mm\"")
    })?;
    let direct::NamedPatterns {
        patterns, names, notes, ..
    } = direct::patterns(&arguments.patterns, scene.form(), &arguments.drawing_options())?;
    notes.iter().for_each(|note| output.warn(note));
    let (decided, tolerances) = (resolve(&scene)?, tolerances.ok_or(ToleranceError::None)?);
    let study_on = |mesh: Mesh| {
        let (states, limit) = (vec![decided.clone()], arguments.time.work_limit());
        Study::new(
            states,
            tolerances.clone(),
            SolveOptions::on(mesh),
            limit,
            arguments.seed,
        )
    };
    let studies = Studies {
        of_devices: study_on(arguments.mesh())?,
        on_other_mesh: study_on(arguments.other_mesh())?,
    };
    let study = &studies.of_devices;
    patterns.iter().try_for_each(|pattern| study.check(pattern))?;
    let neglected = model_warnings::of_equilibria(&scene, &patterns)?;
    let mut found = Vec::new();
    for (pattern, file) in patterns.iter().zip(names) {
        found.push(of_pattern(arguments, &studies, pattern, file, &probe)?);
    }
    let is_share = arguments.wanted.is_some_and(|wanted| wanted.share().is_some());
    let of_mesh = found
        .iter()
        .filter_map(|one| one.mesh_warning(&study.varying(), is_share));
    of_mesh.for_each(|warning| output.warn(warning));
    if let Some(file) = &arguments.output {
        let source = format!("scene {}, seed {}", arguments.scene.display(), arguments.seed);
        let (rows, columns) = devices(&found, &study.varying())?;
        write::csv_of(file, rows.as_bytes(), ("Devices", &source), columns)?;
    }
    output.result(
        || {
            let mut document = document(&found, &probe, arguments);
            document["warnings"] = json!(neglected);
            document
        },
        || {
            let mut text = text(&found, &probe, arguments);
            for warning in &neglected {
                text.line(format!("model warning: {warning}"));
            }
            text
        },
    )?;
    // Devices that fail are a result; a pattern that has no stable state as drawn is not one of a design.
    Ok(match found.iter().all(|one| one.nominal.is_some()) {
        true => Exit::Done,
        false => Exit::Unstable,
    })
}

impl YieldArguments {
    fn drawing_options(&self) -> DrawingOptions {
        DrawingOptions {
            edges: self.edges.edges,
            ..self.drawings.options()
        }
    }

    fn mesh(&self) -> Mesh {
        let order = if self.order == 1 {
            Order::Bilinear
        } else {
            Order::Biquadratic
        };
        Mesh::new(self.elements_per_cell as usize, order)
    }

    /// Returns the mesh whose displacements tell the error of those on the mesh of the devices: a finer one, or the
    /// next coarser one of the finest.
    fn other_mesh(&self) -> Mesh {
        let mesh = self.mesh();
        match (mesh.order(), 2 * mesh.elements_per_cell()) {
            (Order::Bilinear, _) => Mesh::biquadratic(mesh.elements_per_cell()),
            (Order::Biquadratic, twice) if twice <= Mesh::MOST_ELEMENTS => Mesh::biquadratic(twice),
            (Order::Biquadratic, twice) => Mesh::biquadratic(twice / 4),
        }
    }

    /// Returns the displacement that devices of a pattern have to reach, mm.
    ///
    /// # Errors
    /// When it is a share of a displacement against the direction.
    fn wanted_mm(&self, file: &str, nominal: Option<f64>) -> Result<Option<f64>, CliError> {
        let Some(wanted) = self.wanted else { return Ok(None) };
        match (wanted.in_mm(nominal), nominal) {
            (None, Some(mm)) => Err(CliError::bad_input(format!(
                "--wanted {wanted}: {file} moves by {} mm as drawn, of which no share can be reached",
                four_digits(mm)
            ))
            .help("choose the --direction along which the point moves, or give a length")),
            (mm, _) => Ok(mm),
        }
    }
}

/// Simulates the devices of a pattern: as many as requested, or until the interval of the yield is narrow enough.
fn of_pattern(
    arguments: &YieldArguments,
    studies: &Studies,
    pattern: &Pattern,
    file: String,
    probe: &Probe,
) -> Result<Found, CliError> {
    let study = &studies.of_devices;
    let as_drawn = |study: &Study| -> Result<Option<f64>, CliError> {
        Ok(study.nominal(pattern)?.ok().map(|fields| probe.of(&fields[0])))
    };
    let nominal = as_drawn(study)?;
    let mesh_change = match nominal {
        Some(own) => as_drawn(&studies.on_other_mesh)?.map(|other| other - own),
        None => None,
    };
    let wanted_mm = arguments.wanted_mm(&file, nominal)?;
    let mut samples = arguments.samples;
    let mut devices: Vec<Device> = Vec::new();
    loop {
        let bar = Bar::new(&file, "devices", u64::from(samples));
        let done = devices.len() as u32;
        bar.set(u64::from(done), u64::from(samples));
        devices.extend(study.devices(pattern, done..samples, |fields| probe.of(&fields[0]), || bar.advance(1))?);
        bar.clear();
        if is_interrupted() {
            return Err(CliError::stopped("stopped before all devices were simulated"));
        }
        let result = Yield::of(&devices, &study.varying(), wanted_mm);
        let is_wide = arguments.within.is_some_and(|within| half_width(&result) > within);
        if samples == MOST_SAMPLES || !is_wide {
            return Ok(Found {
                file,
                nominal,
                mesh_change,
                wanted_mm,
                devices,
                result,
            });
        }
        samples = (2 * samples).min(MOST_SAMPLES);
    }
}

impl Found {
    /// Formats the displacement as drawn with the error of the mesh.
    fn as_drawn(&self) -> String {
        match (self.nominal, self.mesh_change) {
            (Some(mm), Some(change)) => measured(mm, change.abs()),
            (Some(mm), None) => four_digits(mm),
            (None, _) => "-".to_owned(),
        }
    }

    /// Returns the yield of the devices with the displacement of all changed as by the other mesh. A share of the
    /// displacement as drawn changes with it.
    fn reached_on_other_mesh(&self, varying: &[Source], is_share: bool) -> Option<f64> {
        let wanted = self.wanted_mm.filter(|_| !is_share)? - self.mesh_change?;
        Some(Yield::of(&self.devices, varying, Some(wanted)).reached?.value)
    }

    /// Warns of a mesh whose error is not small against the differences of the devices, or changes the yield by more
    /// than its interval.
    fn mesh_warning(&self, varying: &[Source], is_share: bool) -> Option<String> {
        let change = self.mesh_change?;
        let deviation = self.result.deviation.as_ref()?.value;
        let reached = self.result.reached.as_ref();
        let other = self.reached_on_other_mesh(varying, is_share);
        let is_outside = |Estimate {
                              interval: [low, high], ..
                          }: &Estimate,
                          other: f64| other < *low || *high < other;
        let shifted = reached
            .zip(other)
            .filter(|(reached, other)| is_outside(reached, *other));
        if change.abs() <= SMALL_SHARE * deviation && shifted.is_none() {
            return None;
        }
        let shifted = shifted.map_or_else(String::new, |(_, other)| {
            format!(", and the yield to about {}", percent(other))
        });
        Some(format!(
            "{}: another mesh changes the displacement as drawn by {} mm, {} of the standard deviation{shifted}: use \
             --order 2, or more --elements-per-cell",
            self.file,
            four_digits(change),
            percent(change.abs() / deviation)
        ))
    }
}

/// The error of a mesh in units of the standard deviation of the devices from which on it is too large.
const SMALL_SHARE: f64 = 0.1;

/// How far the interval of a yield reaches from it.
fn half_width(result: &Yield) -> f64 {
    let ends = |reached: &Estimate| reached.interval.map(|end| (end - reached.value).abs());
    let ends = result.reached.as_ref().map_or([0.0; 2], ends);
    ends[0].max(ends[1])
}

/// The unit of deviations in tables.
const DEVIATIONS: &str = "standard deviations";

/// The table of all devices, and its columns; deviations are in units of the standard deviation.
fn devices(found: &[Found], varying: &[Source]) -> Result<(String, Vec<CsvColumn>), CliError> {
    let first = ["pattern", "device"].map(CsvColumn::of_title).into_iter();
    let deviations = varying.iter().map(|source| CsvColumn {
        title: format!("{}_deviation", source.name()),
        unit: Some(DEVIATIONS.to_owned()),
    });
    let last = ["outcome", "displacement_mm"].map(CsvColumn::of_title);
    let columns: Vec<CsvColumn> = first.chain(deviations).chain(last).collect();
    let header: Vec<String> = columns.iter().map(|column| column.title.clone()).collect();
    let rows = found.iter().flat_map(|one| {
        one.devices.iter().enumerate().map(|(index, device)| {
            let deviations = varying.iter().map(|source| device.deviation(*source).to_string());
            let outcome = device.outcome();
            let value = device.value.map_or_else(|_| String::new(), |mm| mm.to_string());
            let first = [one.file.clone(), index.to_string()];
            first
                .into_iter()
                .chain(deviations)
                .chain([outcome.to_owned(), value])
                .collect()
        })
    });
    Ok((csv::text(&header, rows)?, columns))
}

/// The plain mean of the devices that do not fail, mm, where that with control variates is another one.
fn other_mean(found: &Found) -> Option<f64> {
    let values: Vec<f64> = found.devices.iter().filter_map(|device| device.value.ok()).collect();
    let plain = values.iter().sum::<f64>() / values.len() as f64;
    let told = found.result.mean?.value;
    ((plain - told).abs() > 1e-9 * told.abs()).then_some(plain)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn text(found: &[Found], probe: &Probe, arguments: &YieldArguments) -> Text {
    let wanted = arguments.wanted.map(|wanted| format!("reach {wanted}"));
    let mut header = vec!["pattern", "as drawn", "mean", "deviation", "5 %", "median", "95 %"];
    header.extend(wanted.as_deref());
    header.push("fail");
    let mut overview = table::table(&header, &header[1..]).dispensable(&["median", "95 %"]);
    for one in found {
        let result = &one.result;
        let mm = |estimate: &Option<Estimate>| {
            estimate
                .as_ref()
                .map_or_else(|| "-".to_owned(), Estimate::with_interval)
        };
        let quantile = |quantile: &Quantile| match quantile.value.value.is_finite() {
            true => four_digits(quantile.value.value),
            false => "fails".to_owned(),
        };
        let mut row = vec![
            one.file.clone(),
            one.as_drawn(),
            mm(&result.mean),
            mm(&result.deviation),
        ];
        row.extend(result.quantiles.iter().map(quantile));
        row.extend(wanted.as_ref().map(|_| match &result.reached {
            Some(Estimate {
                value,
                interval: [low, high],
            }) => format!("{} ({} to {})", percent(*value), percent(*low), percent(*high)),
            None => "-".to_owned(),
        }));
        row.push(percent(result.failed() as f64 / result.samples as f64));
        overview.add_row(row);
    }
    let mut text = Text::from(format!("displacement {} of each device, mm", probe.title_from_rest()));
    text.table(overview);
    for one in found {
        let result = &one.result;
        let listed = result.shares.iter().filter(|(_, share)| *share >= LISTED);
        let devices = result.samples - result.failed();
        let within = listed.clone().map(|(_, share)| share_within(*share, devices));
        // A share of 100 % has no error.
        let within = Some(percent(within.fold(0.0, f64::max))).filter(|within| *within != percent(0.0));
        let within = within.map_or_else(String::new, |within| format!(", each ± {within}"));
        let shares: Vec<String> = listed
            .map(|(source, share)| format!("{} {}", source.label(), percent(*share)))
            .collect();
        let variance = match shares.is_empty() {
            true => String::new(),
            false => format!("; shares of the variance: {}{within}", shares.join(", ")),
        };
        text.line(format!("{}: {} devices{variance}", one.file, result.samples));
        if let Some(plain) = other_mean(one).filter(|_| arguments.output.is_some()) {
            text.line(format!(
                "{}: the mean of the rows in the file is {} mm; the mean above is corrected by the known means of the \
                 deviations",
                one.file,
                table::number(plain)
            ));
        }
        let share = arguments.wanted.filter(|wanted| wanted.share().is_some());
        if let Some(wanted) = share {
            text.line(format!("{}: wanted {}", one.file, wanted.described(one.nominal)));
        }
        if arguments.within.is_some_and(|within| half_width(result) > within) {
            let known = percent(half_width(result));
            text.line(format!(
                "{}: {MOST_SAMPLES} devices are the most; the yield is known within {known}",
                one.file
            ));
        }
        for (failure, count) in result.failures {
            let what = failure.description();
            if count > 0 {
                text.line(format!(
                    "{}: {count} of {} devices {what}; they count as failed, and not in the mean",
                    one.file, result.samples
                ));
            }
            if count > 0 && failure == Failure::Unstable && arguments.order == 1 {
                text.line("bilinear elements overestimate the voltages at which stability is lost: use --order 2");
            }
        }
    }
    text
}

fn document(found: &[Found], probe: &Probe, arguments: &YieldArguments) -> Value {
    let of_one = |(index, one): (usize, &Found)| {
        let result = &one.result;
        let shares = result
            .shares
            .iter()
            .map(|(source, share)| (source.name().to_owned(), json!(share)));
        let failures = result
            .failures
            .iter()
            .map(|(failure, count)| (failure.name().to_owned(), json!(count)));
        json!({
            "index": index,
            "file": one.file,
            "samples": result.samples,
            "as_drawn_mm": one.nominal,
            "as_drawn_error_mm": one.mesh_change.map(f64::abs),
            "wanted_mm": one.wanted_mm,
            "mean_mm": result.mean,
            "standard_deviation_mm": result.deviation,
            "quantiles_mm": result.quantiles,
            "yield": result.reached,
            "failures": failures.collect::<serde_json::Map<_, _>>(),
            "shares": shares.collect::<serde_json::Map<_, _>>(),
        })
    };
    json!({
        "along": probe.document(),
        "wanted_mm": arguments.wanted.and_then(Wanted::length_mm),
        "wanted_share": arguments.wanted.and_then(Wanted::share),
        "seed": arguments.seed,
        "table": arguments.output,
        "patterns": found.iter().enumerate().map(of_one).collect::<Vec<_>>(),
    })
}
