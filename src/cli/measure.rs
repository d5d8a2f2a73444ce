//! `deaflow measure`: shows what is read from files of measurements.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::measured_files::MeasuredArguments;
use super::pipeline::read_scene_with;
use super::text::Text;
use super::{CliError, Exit, Output, table, write};
use deaflow_base::{Node, four_significant};
use deaflow_fem::SolveOptions;
use deaflow_report::figures::measured_sheet;
use deaflow_report::figures_of_measurements;
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_stage::measured::{
    Data, Deviations, Device, MeasuredSet, MeasuredTable, MeshChoice, Range, SigmaSource, named_notes,
};

/// Read files of measurements, and show their ranges, noise and left out rows
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow measure uniaxial=ut.csv equibiaxial=et.csv",
    "deaflow measure measured.yaml --scene scene.yaml -o read.png",
))]
pub struct MeasureArguments {
    #[command(flatten)]
    measured: MeasuredArguments,
    /// The device of fields and displacements: which points are on it, and whether a field is turned or mirrored
    /// [default: patterns have the cells of their files, and nothing is simulated]
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Override a value of the scene, such as geometry.cells=20
    #[arg(long = "set", value_name = "PATH=VALUE", requires = "scene")]
    sets: Vec<String>,
    /// The file for a figure of what was read [default: none]
    #[arg(short, long, value_name = "OUT.png")]
    output: Option<PathBuf>,
}

/// What was read from a file.
struct Read<'a> {
    table: &'a MeasuredTable,
    /// What its entry says.
    entry: Vec<String>,
    notes: Vec<String>,
    /// Rows that a fit uses.
    used: usize,
}

pub fn execute(arguments: &MeasureArguments, output: &Output) -> Result<Exit, CliError> {
    let files = arguments.measured.files.entries()?;
    if let Some(file) = &arguments.output {
        let scene = arguments.scene.iter().flat_map(|scene| direct::files_read(scene));
        let inputs: Vec<String> = arguments
            .measured
            .files
            .names(&files)
            .into_iter()
            .chain(scene)
            .collect();
        write::check_output(file, &inputs)?;
    }
    let scene = arguments
        .scene
        .as_deref()
        .map(|path| read_scene_with(path, &arguments.sets, output))
        .transpose()?;
    let form = scene.as_ref().map(Scene::form);
    let tables = MeasuredTable::read_all(&files, form, arguments.measured.noise())?;
    let device = scene
        .as_ref()
        .map(|scene| Device::new(scene, &[], options()))
        .transpose()?;
    let on_device = scene.as_ref().zip(device.as_ref());
    let read = tables.iter().zip(&files);
    let read = read.map(|(table, (_, node))| Read::new(table, node, on_device));
    let read: Vec<Read<'_>> = read.collect::<Result<_, CliError>>()?;
    let notes = read.iter().flat_map(|one| named_notes(&one.table.name, &one.notes));
    let notes: Vec<String> = notes.collect();
    notes.iter().for_each(|note| output.warn(note));
    if let Some(file) = &arguments.output {
        let content = MeasuredTable::content(&tables).map_err(|error| CliError::failure(error.to_string()))?;
        measured_sheet(&figures_of_measurements(&content))?.write_png(file)?;
    }
    let figure = arguments.output.as_ref().map(|file| file.display().to_string());
    let document = || {
        let files: Vec<Value> = read.iter().map(Read::document).collect();
        json!({ "files": files, "figure": figure, "notes": notes })
    };
    output.result(document, || {
        let mut text = text(&read);
        figure.iter().for_each(|file| {
            text.line(file);
        });
        text
    })
}

/// Returns mesh and tolerance of the simulation that a field is held against.
fn options() -> SolveOptions {
    MeshChoice {
        elements_per_cell: None,
        order: 2,
    }
    .options()
}

impl<'a> Read<'a> {
    /// Places a table on a device, if there is one.
    fn new(table: &'a MeasuredTable, node: &Node, device: Option<(&Scene, &Device)>) -> Result<Self, CliError> {
        let is_foreign = |entry: &String| !["file: ", "test: ", "sigma: "].iter().any(|key| entry.starts_with(key));
        let mut read = Self {
            table,
            entry: node.written_entries().into_iter().filter(is_foreign).collect(),
            notes: table.notes.clone(),
            used: table.rows_with_numbers() - table.rows_at_rest(),
        };
        if let Some((scene, device)) = device.filter(|_| table.pattern.is_some()) {
            let set = MeasuredSet::of_table(table.clone(), device, scene).map_err(|error| node.place(error))?;
            if let Data::Field(field) = &set.data {
                read.used = field.image().points().len();
            }
            read.notes = set.notes;
        }
        Ok(read)
    }

    fn document(&self) -> Value {
        let table = self.table;
        let range =
            |range: Range| json!({ "name": range.name, "unit": range.dimension.base_unit(), "ends": range.ends });
        let unit = table.quantities().measured().dimension.base_unit();
        let mut sigma = match table.deviations() {
            Deviations::Stated(ends) => json!({ "ends": ends, "unit": unit }),
            Deviations::Share(share) => json!({ "share": share }),
            Deviations::Relative => json!({ "assumed": "relative" }),
            Deviations::Absolute => json!({ "assumed": "absolute" }),
        };
        sigma["source"] = json!(table.sigma_source.map(SigmaSource::name));
        json!({
            "file": table.name,
            "test": table.test.name(),
            "quantities": table.quantities().name(),
            "rows": table.count(),
            "used": self.used,
            "ranges": table.ranges().into_iter().map(range).collect::<Vec<_>>(),
            "sigma": sigma,
            "entry": self.entry,
            "electrode_area": table.pattern.as_ref().map(|pattern| pattern.area_fraction(None)),
        })
    }

    fn ranges(&self) -> String {
        let range = |range: Range| {
            let (factor, _) = range.dimension.display_unit();
            let [least, most] = range.ends;
            match least == most {
                true => format!("{} {}", range.name, range.dimension.with_unit(least)),
                false => format!(
                    "{} {} to {}",
                    range.name,
                    four_significant(factor * least),
                    range.dimension.with_unit(most)
                ),
            }
        };
        self.table
            .ranges()
            .into_iter()
            .map(range)
            .collect::<Vec<_>>()
            .join("\n")
    }

    fn sigma(&self) -> String {
        let dimension = self.table.quantities().measured().dimension;
        let value = match self.table.deviations() {
            Deviations::Stated([least, most]) if least == most => dimension.with_unit(least),
            Deviations::Stated([least, most]) => {
                let (factor, _) = dimension.display_unit();
                format!("{} to {}", four_significant(factor * least), dimension.with_unit(most))
            }
            Deviations::Share(share) => format!("{} %", four_significant(100.0 * share)),
            Deviations::Relative => return "unknown, in proportion".to_owned(),
            Deviations::Absolute => return "unknown, equal at all points".to_owned(),
        };
        let source = match self.table.sigma_source {
            Some(SigmaSource::Column) => " (column)",
            Some(SigmaSource::Entry) => " (sigma of the list)",
            Some(SigmaSource::Usual) => " (--sigma)",
            Some(SigmaSource::Unknown) | None => "",
        };
        format!("{value}{source}")
    }
}

fn text(read: &[Read<'_>]) -> Text {
    let has_entries = read.iter().any(|one| !one.entry.is_empty());
    let mut header = vec!["file", "test", "rows", "used", "ranges", "σ"];
    header.extend(has_entries.then_some("known"));
    let mut table = table::table(&header, &["rows", "used"]).flowing(&["ranges", "known"]);
    for one in read {
        let mut row = vec![
            one.table.name.clone(),
            one.table.test.name().to_owned(),
            one.table.count().to_string(),
            one.used.to_string(),
            one.ranges(),
            one.sigma(),
        ];
        row.extend(has_entries.then(|| one.entry.join("\n")));
        table.add_row(row);
    }
    let mut text = Text::of(table);
    for one in read.iter().filter(|one| one.table.rows_at_rest() > 0) {
        let rows = table::counted(one.table.rows_at_rest() as u64, "rows");
        text.line(format!(
            "{}: {rows} at a stretch of 1, which fits do not count",
            one.table.name
        ));
    }
    text
}
