//! `deaflow export design`: a design as a mask in mm, or as a deformed membrane.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::{Value, json};

use super::format_of;
use super::membrane;
use crate::arguments::{
    DesignArguments, DrawingArguments, StateArguments, StoreArguments, TOLERANCE, has_hdf5_extension, integer, number,
};
use crate::job::extend;
use crate::model::is_displacements;
use crate::pipeline::read_scene_with;
use crate::{CliError, Exit, Output, locate, write};
use deaflow_base::four_digits;
use deaflow_fem::SolveOptions;
use deaflow_field::Mesh;
use deaflow_pattern::{Electrodes, has_patterns};
use deaflow_report::export::{self, MOST_PIXELS, Surface, mask_drawing};
use deaflow_report::{set_options, shell_word};
use deaflow_scene::{Mask, Size, Voltages};
use deaflow_stage::designs::{self, Design, Designs};
use deaflow_store::{Artifact, Run};

/// The heading of options about masks.
const MASK: &str = "Masks";

/// The heading of options about deformed membranes.
const MEMBRANE: &str = "Deformed membranes";

#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow export design pipeline.yaml:verified --role refined -o mask.dxf",
    "deaflow export design mine.csv --scene scene.yaml -o membrane.vtkhdf",
))]
pub struct ExportDesignArguments {
    /// A stage of kind design or verify: PIPELINE.yaml:STAGE, a stage of the last run, a digest or its first digits, or
    /// a file; with --scene a pattern, in any format that `solve` reads
    pub source: String,
    /// The output: a file, which is replaced, or a folder
    #[arg(short, long, value_name = "FILE|DIR")]
    pub output: PathBuf,
    /// The format [default: from the file extension]
    #[arg(long, value_enum)]
    pub format: Option<DesignFormat>,
    #[command(flatten)]
    pub which: DesignArguments,
    /// The scene of a pattern: a YAML file of a scene, or of a pipeline that has one
    #[arg(long, value_name = "SCENE", conflicts_with_all = DesignArguments::NAMES)]
    pub scene: Option<PathBuf>,
    /// Override a value of the pipeline of PIPELINE.yaml:STAGE, as in the `run` that built the stage, or of the scene
    /// of --scene
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub sets: Vec<String>,
    #[command(flatten)]
    pub drawings: DrawingArguments,
    /// The size of a mask: on the frame, or before the membrane is stretched [default: prestretched]
    #[arg(long, value_enum, help_heading = MASK)]
    pub size: Option<DesignSize>,
    /// Export only this group of electrodes; Gerber files need it if there are several
    #[arg(long, value_name = "N", value_parser = integer::<u8>(1..=16), help_heading = MASK)]
    pub group: Option<u8>,
    #[command(flatten)]
    pub state: StateArguments,
    /// Round the outline; its area is reported next to that of the cells
    #[arg(long, help_heading = MASK)]
    pub smooth: bool,
    /// Resolution of an image, rounded to whole pixels per cell [default: 20]
    #[arg(
        long,
        value_name = "N",
        value_parser = number(1e-3..=1e6, "0.001 to 1e6 pixels per mm"),
        help_heading = MASK
    )]
    pub pixels_per_mm: Option<f64>,
    /// Elements along one side of a cell of a deformed membrane [default: 2]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=8), help_heading = MEMBRANE)]
    pub elements_per_cell: Option<u64>,
    /// Polynomial order of these elements [default: 2]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=2), help_heading = MEMBRANE)]
    pub order: Option<u64>,
    #[command(flatten)]
    pub store: StoreArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DesignSize {
    /// Before the membrane is stretched
    Undeformed,
    /// On the frame, without voltage
    Prestretched,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DesignFormat {
    /// Polygons for browsers, laser cutters and plotters
    Svg,
    /// Polygons for CAD
    Dxf,
    /// Regions for manufacturers of circuit boards and photomasks
    Gerber,
    /// An image with black electrodes
    Png,
    /// The cells as numbers
    Csv,
    /// The deformed membrane with stress and field, for ParaView
    Vtkhdf,
}

impl DesignFormat {
    /// The formats with the extensions of their files, the default first.
    const ALL: [(Self, &[&str]); 6] = [
        (Self::Svg, &["svg"]),
        (Self::Dxf, &["dxf"]),
        (Self::Gerber, &["gbr", "ger", "gerber"]),
        (Self::Png, &["png"]),
        (Self::Csv, &["csv"]),
        (Self::Vtkhdf, &["vtkhdf"]),
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Gerber => "gerber",
            other => other.extension(),
        }
    }

    /// The default extension of files of the format.
    fn extension(self) -> &'static str {
        let known = Self::ALL.into_iter().find(|(format, _)| *format == self);
        known.map_or("", |(_, extensions)| extensions[0])
    }
}

/// The default resolution of an image, pixels per mm.
const PIXELS_PER_MM: f64 = 20.0;

pub fn execute(arguments: &ExportDesignArguments, output: &Output) -> Result<Exit, CliError> {
    let format = format_of(arguments.format, &arguments.output, &DesignFormat::ALL)?;
    check_options(arguments, format)?;
    let (design, found_in) = design(arguments, output)?;
    let design = in_state(of_group(design, arguments, format)?, arguments, format)?;
    design.notes.iter().for_each(|note| output.warn(note));
    let path = path(arguments, &design, format);
    let scene = arguments.scene.iter().map(|scene| scene.display().to_string());
    let inputs: Vec<String> = scene.chain([arguments.source.clone()]).collect();
    write::check_output(&path, &inputs)?;
    let report = if format == DesignFormat::Vtkhdf {
        write_membrane(arguments, &design, &path)?
    } else {
        write_mask(arguments, &design, format, &path)?
    };
    let document = || {
        let mut document = json!({
            "file": path,
            "format": format.name(),
            "title": design.title,
            "design": labelled(&design),
            "state": design.state,
            "objective": design.objective,
            "pipeline": found_in.as_ref().map(FoundIn::document),
            "notes": design.notes,
        });
        extend(&mut document, report.document);
        document
    };
    output.result(document, || {
        let found = found_in.iter().map(|found| found.line(&arguments.source, &design));
        let lines: Vec<String> = found.chain(report.lines.iter().cloned()).collect();
        let lines: Vec<String> = lines.iter().map(|line| format!("\n{line}")).collect();
        format!("{}: {}{}", path.display(), design.title, lines.concat())
    })
}

/// The report of a written file, for people and for programs.
struct ExportReport {
    lines: Vec<String>,
    document: Value,
}

fn labelled(design: &Design) -> Value {
    design.label.as_ref().map_or(Value::Null, |label| {
        json!({
            "case": label.case,
            "name": label.name,
            "role": label.role.name(),
            "member": label.member,
            "units": label.units,
        })
    })
}

/// Refuses options that a format does not use.
fn check_options(arguments: &ExportDesignArguments, format: DesignFormat) -> Result<(), CliError> {
    use DesignFormat::{Csv, Png, Vtkhdf};
    let mesh = arguments.elements_per_cell.is_some() || arguments.order.is_some();
    let unused = match format {
        Vtkhdf if arguments.size.is_some() => "--size",
        Vtkhdf if arguments.group.is_some() => "--group",
        Vtkhdf | Csv if arguments.smooth => "--smooth",
        other if other != Png && arguments.pixels_per_mm.is_some() => "--pixels-per-mm",
        other if other != Vtkhdf && mesh => "--elements-per-cell or --order",
        other if other != Vtkhdf && arguments.state.state.is_some() => "--state",
        _ => return Ok(()),
    };
    let why = match format {
        Csv => "a CSV file has no outline and no pixels",
        Vtkhdf => "a deformed membrane has the size of the scene, and all groups",
        _ => "pixels are for png; mesh and state are for vtkhdf",
    };
    Err(CliError::bad_input(format!("{unused} cannot be used with --format {}", format.name())).help(why))
}

/// Where a design was found by the name of a stage alone: the pipeline of the last run that had it.
struct FoundIn {
    pipeline: String,
    path: String,
    overrides: BTreeMap<String, String>,
}

impl FoundIn {
    fn of(run: Run) -> Self {
        Self {
            pipeline: run.pipeline,
            path: run.path,
            overrides: run.overrides,
        }
    }

    fn line(&self, stage: &str, design: &Design) -> String {
        let objective = design.objective.as_deref().unwrap_or_default();
        let objective = match objective.trim() {
            "" => String::new(),
            text => format!(": {text}"),
        };
        let (path, sets) = (shell_word(&self.path), set_options(&self.overrides));
        format!("stage {stage} of pipeline {} ({path}{sets}){objective}", self.pipeline)
    }

    fn document(&self) -> Value {
        json!({ "name": self.pipeline, "path": self.path, "overrides": self.overrides })
    }
}

fn design(arguments: &ExportDesignArguments, output: &Output) -> Result<(Design, Option<FoundIn>), CliError> {
    let source = arguments.source.as_str();
    if let Some(scene) = &arguments.scene {
        let scene = read_scene_with(scene, &arguments.sets, output)?;
        return Ok((designs::of_file(source, scene, &arguments.drawings.options())?, None));
    }
    if !arguments.sets.is_empty() && locate::split(source).is_none() {
        return Err(CliError::bad_input(format!(
            "--set overrides values of a pipeline or of --scene, and {source} is neither"
        ))
        .help("name the stage as PIPELINE.yaml:STAGE"));
    }
    let path = Path::new(source);
    let is_hdf5 = has_hdf5_extension(path);
    let is_dataset = source
        .split_once(":/")
        .is_some_and(|(file, _)| has_patterns(Path::new(file)));
    let mut found_in = None;
    let artifact = match is_hdf5 {
        true if path.is_file() => {
            refuse_results(path)?;
            Artifact::open(path)?
        }
        _ if is_dataset || (has_patterns(path) && !is_hdf5) => {
            return Err(
                CliError::bad_input(format!("{source} is a pattern and needs a scene")).help("add --scene SCENE.yaml")
            );
        }
        _ => {
            let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.source]))?;
            let artifact = locate::artifact_with(&store, source, &arguments.sets)?;
            found_in = store.last_run_with(source, None)?.map(FoundIn::of);
            artifact
        }
    };
    let designs = Designs::read(&artifact)?.ok_or_else(|| {
        CliError::bad_input(format!("artifact {} contains no designs", artifact.digest().short()))
            .help("name a stage of kind design or verify; a pattern needs --scene")
    })?;
    Ok((designs.choose(&arguments.which.filter())?, found_in))
}

/// Refuses a file of `deaflow solve` or `deaflow predict`, which is no artifact; as one it would be damaged.
fn refuse_results(path: &Path) -> Result<(), CliError> {
    match is_displacements(path) {
        true => Err(CliError::bad_input(format!(
            "{0} is an output of `solve` or `predict`, not of a design stage",
            path.display()
        ))
        .help(format!(
            "export a pattern of it with its scene: deaflow export design {}:/patterns --scene SCENE.yaml",
            path.display()
        ))),
        false => Ok(()),
    }
}

/// Returns the design, or one group of its electrodes.
fn of_group(design: Design, arguments: &ExportDesignArguments, format: DesignFormat) -> Result<Design, CliError> {
    let groups = design.scene.groups();
    match arguments.group {
        _ if format == DesignFormat::Vtkhdf => Ok(design),
        None if format == DesignFormat::Gerber && groups > 1 => Err(CliError::bad_input(format!(
            "a Gerber file has one layer, but there are {groups} groups of electrodes"
        ))
        .help(format!("export them one by one: --group 1 to --group {groups}"))),
        None => Ok(design),
        Some(group) if usize::from(group) > groups => Err(CliError::bad_input(format!(
            "there is no group {group} of electrodes: the scene has {groups}"
        ))),
        Some(group) => {
            let voltage = Voltages::one(design.scene.voltage());
            let shapes = design.pattern.electrodes().map(|shapes| {
                let own = shapes.groups().iter().filter(|(number, _)| *number == group);
                let own = own.map(|(_, region)| (1, region.clone())).collect();
                Arc::new(Electrodes::of_parts(own, shapes.size_mm()))
            });
            Ok(Design {
                title: if groups > 1 {
                    format!("{} group {group}", design.title)
                } else {
                    design.title
                },
                pattern: design.pattern.of_group(group).with_electrodes(shapes),
                scene: design.scene.with_voltages(voltage),
                ..design
            })
        }
    }
}

/// Returns the design in one state of its device, for a deformed membrane.
fn in_state(design: Design, arguments: &ExportDesignArguments, format: DesignFormat) -> Result<Design, CliError> {
    let first = design.scene.states.iter().next().map(|(name, _)| name.to_owned());
    let Some(state) = arguments
        .state
        .state
        .clone()
        .or(first)
        .filter(|_| format == DesignFormat::Vtkhdf)
    else {
        return Ok(design);
    };
    let arguments = StateArguments {
        state: Some(state.clone()),
    };
    Ok(Design {
        title: format!("{} in state {state}", design.title),
        scene: arguments.of(design.scene)?,
        state: Some(state),
        ..design
    })
}

/// Returns the file to write: in a folder, it is named after the design.
fn path(arguments: &ExportDesignArguments, design: &Design, format: DesignFormat) -> PathBuf {
    if !arguments.output.is_dir() {
        return arguments.output.clone();
    }
    let name = match &design.label {
        Some(label) => {
            let group = arguments
                .group
                .map_or_else(String::new, |group| format!("-group-{group}"));
            let state = design
                .state
                .as_ref()
                .map_or_else(String::new, |state| format!("-{state}"));
            format!(
                "{}-{}-{}{group}{state}",
                label.name,
                label.role.name(),
                label.member + 1
            )
        }
        None => design.title.clone(),
    };
    let is_plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_');
    let name = name.replace(|c| !is_plain(c), "_");
    arguments.output.join(format!("{name}.{}", format.extension()))
}

fn write_mask(
    arguments: &ExportDesignArguments,
    design: &Design,
    format: DesignFormat,
    path: &Path,
) -> Result<ExportReport, CliError> {
    let size = match arguments.size {
        Some(DesignSize::Undeformed) => Size::Undeformed,
        Some(DesignSize::Prestretched) | None => Size::Prestretched,
    };
    let mask = Mask::new(&design.pattern, &design.scene, size, arguments.smooth);
    let mut document = mask_document(&mask);
    let mut more = Vec::new();
    if format == DesignFormat::Png {
        let pixels = pixels(arguments, &mask)?;
        let per_mm = [0, 1].map(|axis| pixels[axis] as f64 / mask.membrane.size_mm[axis]);
        let colours = match mask.groups.len() {
            1 => "black = electrode".to_owned(),
            groups => format!("white = bare, group g of electrodes = (g - 1)/{groups} of white"),
        };
        more.push(format!("{colours}; {} pixels per mm", export::one_or_both(per_mm)));
        extend(
            &mut document,
            json!({ "pixels": one_or_both(pixels), "pixels_per_mm": one_or_both(per_mm) }),
        );
    }
    let drawing = mask_drawing(&mask, &design.title, source(arguments, design), more);
    let bytes = match format {
        DesignFormat::Svg => export::svg(&drawing),
        DesignFormat::Dxf => export::dxf(&drawing),
        DesignFormat::Gerber => export::gerber(&drawing),
        DesignFormat::Png => export::png(&drawing, pixels(arguments, &mask)?)
            .map_err(|e| CliError::failure(format!("cannot write {}: {e}", path.display())))?,
        DesignFormat::Csv | DesignFormat::Vtkhdf => {
            let (cells, columns) = design.cells();
            export::csv(drawing.lines(), cells, columns)
        }
    };
    write::file(path, &bytes)?;
    extend(&mut document, json!({ "bytes": bytes.len() }));
    Ok(ExportReport {
        lines: drawing.notes[..drawing.notes.len() - 1].to_vec(),
        document,
    })
}

/// Describes the source: the artifact with the stage of the command line, or the file.
fn source(arguments: &ExportDesignArguments, design: &Design) -> String {
    let asked = arguments.source.as_str();
    let name = |path: &str| {
        Path::new(path)
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
    };
    let stage = match locate::split(asked) {
        Some((pipeline, stage)) => name(pipeline).map(|file| format!("{file}:{stage}")),
        None if design.label.is_none() || design.source.contains(asked) || Path::new(asked).is_file() => None,
        None => Some(asked.to_owned()),
    };
    stage.map_or_else(|| design.source.clone(), |stage| format!("{}, {stage}", design.source))
}

/// Returns the pixels along the sides: a whole number per cell, so that edges of cells are edges of pixels.
fn pixels(arguments: &ExportDesignArguments, mask: &Mask) -> Result<[usize; 2], CliError> {
    let (cells, sides) = (mask.membrane.raster.sides(), mask.membrane.cell_mm());
    let per_mm = arguments.pixels_per_mm.unwrap_or(PIXELS_PER_MM);
    let per_cell = sides.map(|side| (per_mm * side).round().max(1.0));
    if (0..2).any(|axis| per_cell[axis] * cells[axis] as f64 > MOST_PIXELS as f64) {
        let [width, height] = mask.membrane.size_mm;
        let most = MOST_PIXELS as f64 / width.max(height);
        return Err(CliError::bad_input(format!(
            "an image of {} at {per_mm} pixels per mm exceeds {MOST_PIXELS} pixels along a side",
            mask.membrane.size_text()
        ))
        .help(format!("use at most --pixels-per-mm {most:.0}")));
    }
    Ok([0, 1].map(|axis| per_cell[axis] as usize * cells[axis]))
}

/// A pair for programs: one number if both are equal.
fn one_or_both<T: Serialize + PartialEq>([x, y]: [T; 2]) -> Value {
    match x == y {
        true => json!(x),
        false => json!([x, y]),
    }
}

fn mask_document(mask: &Mask) -> Value {
    json!({
        "size": mask.size.name(),
        "side_mm": one_or_both(mask.membrane.size_mm),
        "scale": one_or_both(mask.scale),
        "prestretch": one_or_both(mask.prestretch),
        "area_mm2": mask.electrode_area,
        "area_fraction": mask.area_fraction,
        "outline": match (mask.follows_shapes, mask.rounded) {
            (true, _) => "shapes",
            (false, true) => "rounded",
            (false, false) => "square",
        },
        "outline_area_mm2": mask.outline_area,
        "islands": mask.islands(),
        "holes": mask.holes(),
    })
}

fn write_membrane(arguments: &ExportDesignArguments, design: &Design, path: &Path) -> Result<ExportReport, CliError> {
    let elements = arguments.elements_per_cell.unwrap_or(2) as usize;
    let mesh = match arguments.order {
        Some(1) => Mesh::bilinear(elements),
        _ => Mesh::biquadratic(elements),
    };
    let options = SolveOptions {
        mesh,
        tolerance: TOLERANCE,
    };
    let membrane = membrane::simulate(design, options)?;
    let surface = Surface {
        elements: membrane.elements,
        places: &membrane.coordinates,
        displacement: &membrane.displacement,
        cells: &membrane.cells,
        sides: membrane.plane.raster.sides(),
    };
    let attributes = BTreeMap::from(
        [
            ("title", design.title.clone()),
            ("source", design.source.clone()),
            ("scene", membrane.scene.clone()),
            ("warnings", membrane.warnings.join("\n")),
            ("version", format!("deaflow {}", env!("CARGO_PKG_VERSION"))),
            ("units", "mm, Pa, V/m".to_owned()),
        ]
        .map(|(name, value)| (name.to_owned(), value)),
    );
    export::write_vtkhdf(path, &surface, attributes)?;
    let mut lines = vec![format!(
        "deformed membrane of {} {} mm, {} elements; largest displacement {} mm",
        export::side_or_sides(membrane.plane.size_mm),
        export::one_or_both(membrane.plane.size_mm),
        membrane.elements.iter().product::<usize>(),
        four_digits(membrane.largest)
    )];
    lines.extend(membrane.warnings.iter().map(|warning| format!("warning: {warning}")));
    let document = json!({
        "side_mm": one_or_both(membrane.plane.size_mm),
        "elements": membrane.elements.iter().product::<usize>(),
        "max_displacement_mm": membrane.largest,
        "warnings": membrane.warnings,
    });
    Ok(ExportReport { lines, document })
}
