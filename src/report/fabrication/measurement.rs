//! The table to fill in by hand, and how what is written there is read back.

use maud::{Markup, html};

use super::{LINE, Lines, rows};
use crate::designs::{Design, TargetMotion, TargetPoint};
use crate::drawing::number;
use crate::format::{set_options, shell_word};
use crate::history::PipelineHistory;
use crate::page::{design_options, source_of};

/// Rows of the table.
const ROWS: usize = 8;

/// The height of a row of the table, mm.
const ROW: f64 = 6.2;

/// The characters in a row of code, and its height, mm.
const CODE: (usize, f64) = (125, 3.2);

/// Points for which the table has columns.
const MOST_POINTS: usize = 3;

/// The header of the files that `measure`, `fit` and `compare` read for a displacement against the voltage.
const HEADER: &str = "voltage_kV,displacement_mm";

/// A file with one component of the displacement of a point.
struct ComponentFile {
    name: String,
    point: [f64; 2],
    direction_deg: u8,
}

/// The table to fill in.
pub struct HandTable {
    /// What to measure, above the table.
    what: String,
    /// The heads of the columns, without the remarks.
    columns: Vec<String>,
    /// The first column.
    first: Vec<String>,
    /// The files that take the numbers, or why there are none.
    files: Result<Vec<ComponentFile>, &'static str>,
    /// The commands that read the files.
    commands: Vec<String>,
    /// Whether the commands name the file of the scene.
    has_scene: bool,
}

impl HandTable {
    /// Creates the table of a design: a row for each eighth of the voltage, or for a part of the voltage of each state.
    pub fn of(history: &PipelineHistory, design: &Design, scene_file: Option<&str>) -> Self {
        let mut points: Vec<[f64; 2]> = Vec::new();
        let targets = design.objective.points();
        for target in targets.iter().filter(|target| target.has_point()) {
            if !points.contains(&target.point) {
                points.push(target.point);
            }
        }
        let more = points.len().saturating_sub(MOST_POINTS);
        points.truncate(MOST_POINTS);
        let measured = columns(design, points.len());
        let groups = design.scene.groups();
        let mut what = match points.as_slice() {
            // Points of a field are not listed.
            [] if targets.is_empty() => "Points as in the objective, from the lower left corner".to_owned(),
            [] => "Volume below the membrane".to_owned(),
            points => {
                let places = (1..).zip(points).map(|(k, point)| match points.len() {
                    1 => format!("Point {}", place(*point)),
                    _ => format!("point {k} {}", place(*point)),
                });
                places.collect::<Vec<_>>().join(", ") + " from the lower left corner"
            }
        };
        what += "; change from 0 V";
        if more > 0 {
            what += &format!("; {more} more points have no column");
        }
        if groups > 1 && design.scene.drive.charge.is_none() {
            what += "; the voltage is the largest one, and those of the other groups are in proportion";
        }
        Self {
            what,
            columns: std::iter::once("voltage, kV".to_owned()).chain(measured).collect(),
            first: first_column(design),
            files: unreadable(design).map_or_else(|| Ok(component_files(&points)), Err),
            commands: commands(history, design, scene_file),
            has_scene: scene_file.is_some(),
        }
    }

    /// Returns the height of the table and of the text below it, mm.
    pub fn height_mm(&self) -> f64 {
        let files = match &self.files {
            Err(_) => LINE,
            Ok(files) => {
                let entries = files.iter().map(ComponentFile::entry);
                let codes = entries.chain(self.commands.iter().cloned());
                let rows: usize = codes.map(|code| rows(&code, CODE.0, usize::MAX)).sum();
                3.0 * LINE + CODE.1 * (rows + 1) as f64
            }
        };
        LINE * rows(&self.what, Lines::ACROSS.0, usize::MAX) as f64 + ROW * (self.first.len() + 1) as f64 + files
    }

    /// Draws the table.
    pub fn table(&self) -> Markup {
        html! {
            p { (self.what) "." }
            table {
                thead {
                    tr {
                        @for column in &self.columns { th scope="col" { (column) } }
                        th.wide scope="col" { "remark" }
                    }
                }
                tbody {
                    @for first in &self.first {
                        // The first column has a head of its own, and that of remarks takes its place.
                        tr { th scope="row" { (first) } @for _ in &self.columns { td {} } }
                    }
                }
            }
        }
    }

    /// Writes the files that take the numbers, and the commands that read them.
    pub fn files(&self) -> Markup {
        let files = match &self.files {
            Ok(files) => files,
            Err(why) => return html! { p { (why) } },
        };
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        html! {
            p {
                "Type x and y into " code { (names.join(", ")) } ", a line for each row below the header "
                code.header { (HEADER) } ":"
            }
            pre.list { "files:\n" @for file in files { (file.entry()) "\n" } }
            p {
                "The lines above are " code { "measured.yaml" } ". Read them back"
                @if !self.has_scene { ", with the scene of the stage in " code { "SCENE.yaml" } }
                ":"
            }
            pre.commands { @for command in &self.commands { (command) "\n" } }
        }
    }
}

impl ComponentFile {
    /// Returns its entry in a list of measured files.
    fn entry(&self) -> String {
        let [x, y] = self.point.map(|mm| number(mm, 6));
        format!(
            "  - {{ file: {}, test: voltage-displacement, pattern: design.csv, point: [{x} mm, {y} mm], \
             direction: {} deg }}",
            self.name, self.direction_deg
        )
    }
}

/// Returns the commands that write the pattern, show what is read, and compare it.
fn commands(history: &PipelineHistory, design: &Design, scene_file: Option<&str>) -> Vec<String> {
    let scene = scene_file.map_or_else(|| "SCENE.yaml".to_owned(), shell_word);
    // Those of stages do not change the scene, and a scene in a file of its own has them.
    let is_of_scene = |(path, _): &(&String, &String)| *path == "scene" || path.starts_with("scene.");
    let overrides = history
        .overrides
        .iter()
        .filter(is_of_scene)
        .filter(|_| scene_file.is_some());
    let sets = set_options(overrides);
    vec![
        format!(
            "deaflow export design {}{} --member {} --units {} -o design.csv",
            source_of(history, &design.made.stage),
            design_options(design),
            design.member + 1,
            design.units
        ),
        format!("deaflow measure measured.yaml --scene {scene}{sets}"),
        format!("deaflow compare {scene} measured.yaml{sets}"),
    ]
}

fn component_files(points: &[[f64; 2]]) -> Vec<ComponentFile> {
    let mut files = Vec::new();
    for (k, point) in (1..).zip(points) {
        for (component, direction_deg) in [("x", 0), ("y", 90)] {
            files.push(ComponentFile {
                name: match points.len() {
                    1 => format!("{component}.csv"),
                    _ => format!("{component}{k}.csv"),
                },
                point: *point,
                direction_deg,
            });
        }
    }
    files
}

fn place([x, y]: [f64; 2]) -> String {
    format!("({}, {}) mm", number(x, 6), number(y, 6))
}

fn turns(design: &Design) -> bool {
    let targets = &design.objective.targets;
    targets
        .iter()
        .any(|target| matches!(target.motion, TargetMotion::Turn(_)))
}

/// Whether a height or a volume is to change.
fn leaves_plane(design: &Design) -> bool {
    let targets = &design.objective.targets;
    targets
        .iter()
        .any(|target| matches!(target.motion, TargetMotion::Rise(_) | TargetMotion::Fill(_)))
}

/// Returns the columns of what is measured.
fn columns(design: &Design, points: usize) -> Vec<String> {
    let unit = design.objective.unit();
    if unit != "mm" {
        return vec![format!("{}, {unit}", design.objective.quantity())];
    }
    if leaves_plane(design) {
        let of_target = |(k, target): (usize, &TargetPoint)| match target.motion {
            TargetMotion::Rise(_) => Some(format!("height {k}, mm")),
            TargetMotion::Fill(_) => Some("volume, ml".to_owned()),
            _ => None,
        };
        let mut columns: Vec<String> = (1..).zip(design.objective.points()).filter_map(of_target).collect();
        // Volumes in several states are in the rows of these.
        columns.dedup();
        return columns;
    }
    let of_point = |k: usize| match points {
        0 | 1 => ["x, mm".to_owned(), "y, mm".to_owned()],
        _ => [format!("x{k}, mm"), format!("y{k}, mm")],
    };
    let mut columns: Vec<String> = (1..=points.max(1)).flat_map(of_point).collect();
    if turns(design) {
        columns.push("angle, °".to_owned());
    }
    columns
}

/// Returns the voltages of the rows in kV; those of states with their names, and none if the charge is prescribed.
fn first_column(design: &Design) -> Vec<String> {
    let drive = &design.scene.drive;
    let parts = |volts: f64, rows: usize| {
        let (largest, step) = (1e-3 * volts, 1e-3 * volts / rows as f64);
        (1..=rows).map(move |k| match k == rows {
            true => number(largest, 6),
            false => number(k as f64 * step, digits(step)),
        })
    };
    let states = design.scene.states.iter();
    match (drive.charge.is_some(), states.len()) {
        (true, _) => vec![String::new(); ROWS],
        (false, 0) => parts(drive.voltages.largest_v(), ROWS).collect(),
        (false, count) => {
            let each = (ROWS / count).max(1);
            let named = states.flat_map(|(name, voltages)| {
                parts(voltages.largest_v(), each).map(move |kilovolts| format!("{name}: {kilovolts}"))
            });
            named.take(ROWS).collect()
        }
    }
}

/// Returns the decimal digits of voltages in kV at such steps: those of a volt, and more where these would change a
/// step by more than a twentieth.
fn digits(step: f64) -> usize {
    let coarse = |digits: &usize| 0.5 * 10_f64.powi(-(*digits as i32)) > 0.05 * step;
    (3..6).find(|digits| !coarse(digits)).unwrap_or(6)
}

/// Says why no file of deaflow takes the numbers; `None` if there is one.
fn unreadable(design: &Design) -> Option<&'static str> {
    let (objective, scene) = (&design.objective, &design.scene);
    if objective.unit() != "mm" {
        return Some("deaflow does not read measured forces.");
    }
    if turns(design) {
        return Some("deaflow does not read measured angles.");
    }
    if scene.is_in_space() {
        return Some("deaflow compare does not simulate membranes that leave their plane.");
    }
    if scene.states.iter().len() > 0 {
        return Some("deaflow reads no curve of a device with several states: give each state a scene of its own.");
    }
    if scene.drive.charge.is_some() {
        return Some("deaflow reads no curve of a device with a prescribed charge.");
    }
    if objective.moment.is_some() {
        return Some("Of a motion in time deaflow reads tables of the tests time-displacement and frequency-response.");
    }
    if scene.geometry.sides.is_some() || scene.without_loads().is_some() {
        return Some("deaflow compare counts displacements from the membrane without loads, and this table from rest.");
    }
    objective
        .points()
        .is_empty()
        .then_some("Of a displacement field deaflow reads tables of the test field.")
}
