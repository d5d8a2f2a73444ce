//! Writes the files of a report: the page, the table of designs, and each pattern.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::artifacts::StageArtifact;
use super::designs::{Design, DesignStatistics, OtherObjective, designs, role_word};
use super::error::ReportError;
use super::export::{cell_lines, dxf, mask_drawing};
use super::history::PipelineHistory;
use super::intervals::NetworkInterval;
use super::page::sweep::VoltageSweep;
use super::page::{self, report_page};
use deaflow_base::{CsvColumn, CsvTable, OutputFile, csv_metadata, folder_of, read_bounded};
use deaflow_field::{CHARGE_UNIT, REACTION_UNIT};
use deaflow_scene::{Mask, Size};
use deaflow_store::Store;

/// The columns of the table of designs.
pub const COLUMNS: [&str; 28] = [
    "name",
    "case",
    "role",
    "units",
    "point_x_mm",
    "point_y_mm",
    "direction_deg",
    "objective",
    "area_target",
    "area",
    "area_mm2",
    "predicted_mm",
    "simulated_mm",
    "simulated_error_mm",
    "predicted_mN",
    "simulated_mN",
    "simulated_error_mN",
    "distance_mm",
    "intuitive_own_mm",
    "intuitive_equal_area_mm",
    "optimum_mm",
    "ratio_to_optimum",
    "network_mm",
    "interval_lower_mm",
    "interval_upper_mm",
    "novelty",
    "out_of_distribution",
    "pattern_file",
];

/// Columns of designs of fronts, before the last one: the objectives after the first, in the syntax of pipelines, with
/// their values as predicted by the search. Areas have their column in all reports.
pub const FRONT_COLUMNS: [&str; 7] = [
    "second_objective",
    "second_predicted_mm",
    "second_predicted_mN",
    "third_objective",
    "third_predicted_mm",
    "third_predicted_mN",
    "charge_nC",
];

/// Columns of robust objectives and of rotations, before those of fronts: the value that counts as predicted by the
/// search, and angles.
const ROBUST_COLUMNS: [&str; 1] = ["robust_predicted_mm"];
const ANGLE_COLUMNS: [&str; 3] = ["predicted_deg", "simulated_deg", "simulated_error_deg"];

/// The columns of volumes.
const VOLUME_COLUMNS: [&str; 3] = ["predicted_ml", "simulated_ml", "simulated_error_ml"];

/// The largest table or page, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The description of the CSV files in the folder.
const METADATA: &str = "csv-metadata.json";

/// The files of a report.
#[derive(Clone, Debug)]
pub struct ReportFiles {
    /// The page.
    pub page: PathBuf,
    /// The table of designs, if there are designs.
    pub designs: Option<PathBuf>,
    /// The patterns, in the order of the table.
    pub patterns: Vec<PathBuf>,
    /// The masks of the searched designs, in the same order.
    pub masks: Vec<PathBuf>,
    /// Statistics of the designs.
    pub found: DesignStatistics,
}

/// Writes the report of a pipeline into a folder: `index.html`, and if there are designs `data/designs.csv`,
/// `data/patterns/NAME.csv`, their description in `data/csv-metadata.json`, and for searched designs
/// `data/masks/NAME.dxf`. Patterns and masks of an earlier report that are no longer needed are removed. `sweep`
/// simulates the best of the designs at rising voltages.
///
/// # Errors
/// If an artifact cannot be read, or a file cannot be written.
pub fn write_report(
    store: &Store,
    history: &PipelineHistory,
    folder: &Path,
    sweep: impl FnOnce(&[Design]) -> Option<VoltageSweep>,
) -> Result<ReportFiles, ReportError> {
    let made = history.made();
    let run = history.run(store, &made);
    let designs = designs(&run, &run.superseded())?;
    let (path, data) = (folder.join("index.html"), folder.join("data"));
    let (table, patterns, about) = (data.join("designs.csv"), data.join("patterns"), data.join(METADATA));
    // Obstacles are found before any file of an earlier report is removed, and before the sweep, which takes seconds.
    let page_file = OutputFile::new(&path)?;
    let page = report_page(&run, history, &designs, sweep(&designs).as_ref())?;
    refuse_another(&page, folder)?;
    let of_design = |design: &Design| data.join(design.pattern_file());
    let earlier = earlier_files(&table, &data);
    let (mut written, mut masks) = (Vec::new(), Vec::new());
    if !designs.is_empty() {
        fs::create_dir_all(&patterns).map_err(failed(&patterns))?;
        let (table_file, about_file) = (OutputFile::new(&table)?, OutputFile::new(&about)?);
        let files: Result<Vec<_>, _> = designs
            .iter()
            .map(|design| OutputFile::new(&of_design(design)))
            .collect();
        for (design, file) in designs.iter().zip(files?) {
            file.write(cell_lines(design.pattern.cells(), design.pattern.raster().columns()).as_bytes())?;
            written.push(of_design(design));
        }
        masks = write_masks(&designs, &data, &digests(&made))?;
        table_file.write(&table_text(&designs).map_err(failed(&table))?)?;
        about_file.write(&csv_metadata(&described(&designs, history, &made)))?;
        written.extend([table.clone(), about.clone()]);
    }
    let stale = earlier
        .iter()
        .filter(|path| !written.contains(path) && !masks.contains(path));
    stale
        .into_iter()
        .try_for_each(|path| fs::remove_file(path).map_err(failed(path)))?;
    written.retain(|path| ![&table, &about].contains(&path));
    // The page is written last, so that it never exists without its files.
    page_file.write(page.as_bytes())?;
    Ok(ReportFiles {
        page: path,
        designs: (!designs.is_empty()).then_some(table),
        patterns: written,
        masks,
        found: DesignStatistics::of(&designs),
    })
}

/// Refuses a folder with the report of another pipeline, whose files would be replaced or removed.
fn refuse_another(page: &str, folder: &Path) -> Result<(), ReportError> {
    let there = read_bounded(&folder.join("index.html"), MAX_BYTES).unwrap_or_default();
    let there = String::from_utf8_lossy(&there);
    match (pipeline_of(&there), pipeline_of(page)) {
        (Some(other), Some(own)) if other != own => Err(ReportError::Other {
            folder: folder.to_owned(),
            pipeline: other.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Returns the name of the pipeline of a page.
fn pipeline_of(page: &str) -> Option<&str> {
    let (_, rest) = page.split_once(page::ABOUT)?;
    Some(rest.split_once(": ")?.0)
}

impl ReportFiles {
    /// Lists the files for people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut lines = vec![format!("written:\n  {}", self.page.display())];
        if let Some(designs) = &self.designs {
            lines.push(format!("  {}, described by {METADATA}", designs.display()));
            let folder = self.patterns.first().and_then(|path| path.parent());
            let folder = folder.map_or(String::new(), |folder| folder.display().to_string());
            lines.push(format!("  {folder}/*.csv: {} patterns", self.patterns.len()));
            if let Some(folder) = self.masks.first().and_then(|path| path.parent()) {
                lines.push(match self.masks.len() {
                    1 => format!("  {}/*.dxf: 1 mask", folder.display()),
                    n => format!("  {}/*.dxf: {n} masks", folder.display()),
                });
            }
        }
        lines.join("\n")
    }
}

/// Writes the mask of each searched design, at the size of the frame, with the digests of the artifacts of the designs.
fn write_masks(designs: &[Design], data: &Path, source: &str) -> Result<Vec<PathBuf>, ReportError> {
    let mut written = Vec::new();
    for (design, name) in designs.iter().filter_map(|design| Some((design, design.mask_file()?))) {
        let path = data.join(name);
        let folder = folder_of(&path);
        fs::create_dir_all(folder).map_err(failed(folder))?;
        let mask = Mask::new(&design.pattern, &design.scene, Size::Prestretched, false);
        let drawing = mask_drawing(&mask, &design.name, source.to_owned(), Vec::new());
        OutputFile::new(&path)?.write(&dxf(&drawing))?;
        written.push(path);
    }
    Ok(written)
}

fn failed(path: &Path) -> impl Fn(io::Error) -> ReportError + '_ {
    |source| ReportError::Replace {
        path: path.to_owned(),
        source,
    }
}

/// Lists the files of an earlier report: its table, and the patterns and masks of the table. Other files are ignored.
fn earlier_files(table: &Path, data: &Path) -> Vec<PathBuf> {
    let Ok(text) = read_bounded(table, MAX_BYTES) else {
        return Vec::new();
    };
    let mut reader = csv::Reader::from_reader(text.as_slice());
    // Other versions have other columns between these.
    let [first, .., last] = COLUMNS;
    let is_ours = |header: &csv::StringRecord| header.get(0) == Some(first) && header.iter().next_back() == Some(last);
    if !reader.headers().is_ok_and(is_ours) {
        return Vec::new();
    }
    let files = |record: csv::StringRecord| {
        let pattern = record.iter().next_back().unwrap_or_default().to_owned();
        let name = pattern.strip_prefix("patterns/").filter(|name| !name.contains('/'));
        let mask = name.and_then(|name| Some(format!("masks/{}.dxf", name.strip_suffix(".csv")?)));
        let both = [name.map(|_| pattern.clone()), mask].into_iter().flatten();
        both.map(|name| data.join(name))
            .filter(|path| path.is_file())
            .collect::<Vec<_>>()
    };
    let patterns: BTreeSet<PathBuf> = reader.records().flatten().flat_map(files).collect();
    patterns
        .into_iter()
        .chain(
            [table.to_owned(), data.join(METADATA)]
                .into_iter()
                .filter(|path| path.is_file()),
        )
        .collect()
}

/// Lists the digests of the artifacts of the designs.
fn digests(made: &[StageArtifact]) -> String {
    let of_designs = made
        .iter()
        .filter(|made| ["design", "verify"].contains(&made.kind.as_str()));
    of_designs
        .map(|made| made.digest.to_string())
        .collect::<Vec<_>>()
        .join(" ")
}

/// Describes the CSV files: the pipeline, and the artifacts of the designs.
fn described(designs: &[Design], history: &PipelineHistory, made: &[StageArtifact]) -> Vec<CsvTable> {
    let source = digests(made);
    let table = |url: String, title: &str, columns: Vec<CsvColumn>| CsvTable {
        url,
        title: format!("{}: {title}", history.pipeline),
        source: source.clone(),
        header: !columns.is_empty(),
        columns,
    };
    let patterns = designs
        .iter()
        .map(|design| table(design.pattern_file(), &design.name, Vec::new()));
    let columns = columns(designs).into_iter().map(CsvColumn::of_title).collect();
    std::iter::once(table("designs.csv".to_owned(), "designs", columns))
        .chain(patterns)
        .collect()
}

fn table_text(designs: &[Design]) -> io::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns(designs))?;
    for design in designs {
        let mut cells = row(design).to_vec();
        let last = cells.pop();
        if has_robust(designs) {
            cells.extend([known(design.robust_mm)]);
        }
        let values = [design.predicted_mm, design.simulated_mm, design.error_mm];
        if has_rotation(designs) {
            cells.extend(values.map(|value| known(value.and_then(|value| design.objective.degrees(value)))));
        }
        if has_volume(designs) {
            cells.extend(values.map(|value| known(value.and_then(|value| design.objective.millilitres(value)))));
        }
        if has_front(designs) {
            cells.extend(front_row(design));
        }
        cells.extend(last);
        writer.write_record(cells)?;
    }
    writer.into_inner().map_err(|e| e.into_error())
}

/// Returns the columns of the table of some designs.
fn columns(designs: &[Design]) -> Vec<&'static str> {
    let (mut columns, [.., last]) = (COLUMNS.to_vec(), COLUMNS);
    columns.pop();
    if has_robust(designs) {
        columns.extend(ROBUST_COLUMNS);
    }
    if has_rotation(designs) {
        columns.extend(ANGLE_COLUMNS);
    }
    if has_volume(designs) {
        columns.extend(VOLUME_COLUMNS);
    }
    if has_front(designs) {
        columns.extend(FRONT_COLUMNS);
    }
    columns.push(last);
    columns
}

/// Whether some objectives are robust.
fn has_robust(designs: &[Design]) -> bool {
    designs.iter().any(|design| design.objective.robust.is_some())
}

/// Whether the values of some designs are arc lengths of rotations.
fn has_rotation(designs: &[Design]) -> bool {
    designs.iter().any(|design| design.objective.arm_mm.is_some())
}

/// Whether the values of some designs are mean heights of volumes.
fn has_volume(designs: &[Design]) -> bool {
    designs.iter().any(|design| design.objective.ml_per_mm.is_some())
}

/// Whether some designs are points of fronts.
fn has_front(designs: &[Design]) -> bool {
    designs.iter().any(|design| design.front.is_some())
}

/// The cells of the columns of fronts.
fn front_row(design: &Design) -> [String; FRONT_COLUMNS.len()] {
    let others = design.other_objectives();
    let text = |at: usize| others.get(at).map_or_else(String::new, |other| other.text.clone());
    let value = |other: Option<&OtherObjective>| other.map_or_else(String::new, |other| number(other.value));
    let in_unit = |at: usize, unit: &str| value(others.get(at).filter(|other| other.unit == unit));
    [
        text(0),
        in_unit(0, "mm"),
        in_unit(0, REACTION_UNIT),
        text(1),
        in_unit(1, "mm"),
        in_unit(1, REACTION_UNIT),
        value(others.iter().find(|other| other.unit == CHARGE_UNIT)),
    ]
}

/// Writes a number with six decimals, without a minus sign of zero.
fn number(value: f64) -> String {
    format!("{:.6}", value + 0.0)
}

/// Writes a number as [`number`]; nothing if it is not known.
fn known(value: Option<f64>) -> String {
    value.map_or_else(String::new, number)
}

fn row(design: &Design) -> [String; COLUMNS.len()] {
    let (compared, interval) = (&design.compared, design.interval.as_ref());
    let is_motion = design.objective.unit() == "mm";
    let of_interval = |of: fn(&NetworkInterval) -> f64| known(interval.map(of));
    [
        design.name.clone(),
        design.case.clone(),
        role_word(design.role).to_owned(),
        design.units.to_string(),
        design.objective.coordinates(0),
        design.objective.coordinates(1),
        design.objective.directions(),
        design.objective.short_text(),
        design.area_target.clone(),
        number(design.area),
        number(design.area_mm2()),
        known(design.predicted_mm.filter(|_| is_motion)),
        known(design.simulated_mm.filter(|_| is_motion)),
        known(design.error_mm.filter(|_| is_motion)),
        known(design.predicted_mm.filter(|_| !is_motion)),
        known(design.simulated_mm.filter(|_| !is_motion)),
        known(design.error_mm.filter(|_| !is_motion)),
        known(design.distance_mm),
        known(compared.intuitive_own.filter(|_| is_motion)),
        known(compared.intuitive_equal_area.filter(|_| is_motion)),
        known(compared.optimum.filter(|_| is_motion)),
        known(compared.ratio),
        of_interval(|interval| interval.predicted_mm),
        of_interval(|interval| interval.lower_mm),
        of_interval(|interval| interval.upper_mm),
        of_interval(|interval| interval.novelty),
        interval.map_or_else(String::new, |interval| {
            u8::from(interval.out_of_distribution).to_string()
        }),
        design.pattern_file(),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::designs::{FrontPlace, Objective, Role, tests::design};
    use super::super::intervals::tests::interval;
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn the_first_line_of_a_pattern_is_its_lower_edge() {
        let pattern = deaflow_pattern::Pattern::from_fn(Raster::PAPER, |x, y| y == 0 && x < 3);
        let text = cell_lines(pattern.cells(), pattern.raster().columns());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 50);
        assert!(lines[0].starts_with("1,1,1,0,") && !lines[49].contains('1'));
        assert!(lines.iter().all(|line| line.split(',').count() == 50));
    }

    #[test]
    fn a_row_has_numbers_with_six_decimals_lists_of_points_and_empty_cells_for_unknown_values() {
        let mut of_four = design(Role::Refined, 50, Some(0.987_654_32));
        of_four.objective = Objective::read(
            "{ points: [{ point: [12.5, 25], direction: 0 }, { point: [37.5, 25], direction: 180 deg }] }",
            &deaflow_scene::Scene::vhb4910(),
        )
        .unwrap();
        of_four.interval = Some(interval(1.0, 1.5));
        let text = String::from_utf8(table_text(&[of_four, design(Role::Intuitive, 50, None)]).unwrap()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], COLUMNS.join(","));
        assert_eq!(
            lines[1],
            "I-centre-refined,I,refined,50,12.5 37.5,25 25,0 180,\
             \"{ points: [{ point: [12.5, 25], direction: 0 }, { point: [37.5, 25], direction: 180 deg }] }\",\
             0.5,0.500000,1250.000000,1.000000,0.987654,,,,,,,,,,1.000000,0.950000,1.050000,1.500000,1,\
             patterns/I-centre-refined.csv"
        );
        assert!(
            lines[2].contains("direction: 0 }\",0.5,0.500000,1250.000000,1.000000,,,,,,,,,,,,,,,,"),
            "{}",
            lines[2]
        );
    }

    #[test]
    fn points_of_fronts_have_all_their_objectives() {
        let other = |text: &str, unit: &str, value| OtherObjective {
            text: text.to_owned(),
            description: String::new(),
            unit: unit.to_owned(),
            value,
            ml_per_mm: None,
        };
        let mut point = design(Role::Ga, 20, None);
        point.front = Some(FrontPlace {
            stage: "three".to_owned(),
            others: vec![
                other("{ reaction: right }", "mN", -1.5),
                other("{ charge: least }", "nC", 812.5),
            ],
        });
        let text = table_text(&[point.clone(), design(Role::Own, 50, None)]).unwrap();
        let mut reader = csv::Reader::from_reader(text.as_slice());
        let header = reader.headers().unwrap().clone();
        assert_eq!(
            (header.get(0), header.iter().next_back()),
            (Some("name"), Some("pattern_file"))
        );
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        let cell = |row: usize, name: &str| {
            rows[row]
                .get(header.iter().position(|one| one == name).unwrap())
                .unwrap()
        };
        let cells = FRONT_COLUMNS.map(|name| cell(0, name));
        assert_eq!(
            cells,
            [
                "{ reaction: right }",
                "",
                "-1.500000",
                "{ charge: least }",
                "",
                "",
                "812.500000"
            ]
        );
        assert!(FRONT_COLUMNS.into_iter().all(|name| cell(1, name).is_empty()));
        assert!(cell(0, "pattern_file").starts_with("patterns/"));
        let unit = |name: &str| CsvColumn::of_title(name).unit;
        assert_eq!(
            [
                "second_predicted_mm",
                "third_predicted_mN",
                "charge_nC",
                "second_objective"
            ]
            .map(unit),
            [
                Some("mm".to_owned()),
                Some("mN".to_owned()),
                Some("nC".to_owned()),
                None
            ]
        );
    }

    #[test]
    fn the_report_of_another_pipeline_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let page = |name: &str| format!("<p class=\"lead\">{}{name}: 3 stages from x.yaml</p>", page::ABOUT);
        assert!(refuse_another(&page("own"), folder.path()).is_ok());
        fs::write(folder.path().join("index.html"), page("own")).unwrap();
        assert!(refuse_another(&page("own"), folder.path()).is_ok());
        let refused = refuse_another(&page("another"), folder.path()).unwrap_err();
        assert!(refused.to_string().contains("another pipeline, own"), "{refused}");
        // Another file has no files that a report would remove.
        fs::write(folder.path().join("index.html"), "<p>mine</p>").unwrap();
        assert!(refuse_another(&page("another"), folder.path()).is_ok());
    }

    #[test]
    fn only_files_of_an_earlier_report_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path();
        fs::create_dir(data.join("patterns")).unwrap();
        let (own, other) = (data.join("patterns/I-centre-ga.csv"), data.join("patterns/mine.csv"));
        for path in [&own, &other, &data.join("precious.csv")] {
            fs::write(path, "1").unwrap();
        }
        let table = data.join("designs.csv");
        let mut text = String::from_utf8(table_text(&[design(Role::Ga, 20, None)]).unwrap()).unwrap();
        text += &text
            .lines()
            .last()
            .unwrap()
            .replace("patterns/I-centre-ga.csv", "patterns/../precious.csv");
        fs::write(&table, text).unwrap();
        assert_eq!(earlier_files(&table, data), [own, table.clone()]);
        assert!(other.exists() && data.join("precious.csv").exists());

        fs::write(&table, "name,of_another_version,pattern_file\nx,1,patterns/mine.csv\n").unwrap();
        assert_eq!(earlier_files(&table, data), [other.clone(), table.clone()]);

        fs::write(&table, "a,b\n1,patterns/mine.csv\n").unwrap();
        assert_eq!(earlier_files(&table, data), [] as [PathBuf; 0]);
    }
}
