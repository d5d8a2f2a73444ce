//! The audit finds every planted fault by its check and row, and a correct dataset has no findings. A simple model
//! replaces the simulation of the membrane: displacement away from nearby active cells, which has the same symmetries.

use std::ops::Range;
use std::sync::{Arc, LazyLock, Mutex};

use super::*;
use crate::{BinIndex, Bins, Device};
use deaflow_base::{Digest, Stream};
use deaflow_field::{
    CORNERS, Field, Mesh, Observation, Outcome, SharedSimulator, Simulation, Simulator, SimulatorError, SimulatorKind,
    Simulators,
};
use deaflow_pattern as pattern;
use deaflow_pattern::{CELLS, Pattern, Raster, Symmetries, Symmetry};

/// The model. Its number is the coarseness of the mesh: coarse meshes are too stiff.
struct Membrane(f64);

const REACH: i32 = 3;

impl Membrane {
    fn field(&self, pattern: &Pattern) -> Field {
        let mut values = Vec::with_capacity(CORNERS * CORNERS * 2);
        for y in 0..CORNERS as i32 {
            for x in 0..CORNERS as i32 {
                let within = |i: i32| f64::from(i * (CELLS as i32 - i)) / 625.0;
                let mut u = [0.0, 0.0];
                for (dx, dy) in (-REACH..REACH).flat_map(|dx| (-REACH..REACH).map(move |dy| (dx, dy))) {
                    let (column, row) = (x + dx, y + dy);
                    let inside = |i: i32| (0..CELLS as i32).contains(&i);
                    if inside(column) && inside(row) && pattern.is_active(column as usize, row as usize) {
                        let (far_x, far_y) = (f64::from(dx) + 0.5, f64::from(dy) + 0.5);
                        let weight = 0.01 * (-(far_x * far_x + far_y * far_y) * (1.0 - self.0) / 9.0).exp();
                        u = [u[0] - weight * far_x, u[1] - weight * far_y];
                    }
                }
                values.extend(u.map(|u| u * within(x) * within(y)));
            }
        }
        Field::from_values(Raster::PAPER, values).unwrap()
    }
}

impl Simulator for Membrane {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        // A fully active membrane is unstable.
        let is_stable = |pattern: &Pattern| pattern.area_fraction(None) < 0.99;
        let simulation = |pattern| Simulation {
            outcome: if is_stable(pattern) {
                Outcome::Converged
            } else {
                Outcome::IterationLimit
            },
            field: is_stable(pattern).then(|| self.field(pattern)),
            newton_iterations: 1,
            residual: 0.0,
            observation: Observation::default(),
        };
        patterns.iter().map(simulation).collect()
    }
}

struct Membranes;

fn coarseness(mesh: Mesh) -> f64 {
    0.02 / mesh.cost() as f64
}

impl Simulators for Membranes {
    fn simulator(&self, wanted: SimulatorKind) -> Result<SharedSimulator, SimulatorError> {
        Ok(Arc::new(match wanted {
            SimulatorKind::AsDeclared(mesh) | SimulatorKind::Newton(mesh) => Membrane(coarseness(mesh)),
        }))
    }
}

/// Rows in memory.
struct Memory {
    patterns: Vec<Pattern>,
    fields: Vec<Vec<f64>>,
    odd_cell: Option<usize>,
}

impl RowSource for Memory {
    fn read(&self, range: Range<usize>) -> Result<Batch, AuditError> {
        let cells = |row: usize| {
            let own = self.patterns[row].cells().iter().enumerate();
            own.map(move |(at, &cell)| match (self.odd_cell, at) {
                (Some(odd), 0) if odd == row => 0.5,
                _ => f64::from(cell),
            })
        };
        Ok(Batch {
            cells: range.clone().flat_map(cells).collect(),
            displacement: range.flat_map(|row| self.fields[row].clone()).collect(),
        })
    }
}

fn pattern(index: u64) -> Pattern {
    let mut stream = Stream::new(3, "audit test", index);
    if index.is_multiple_of(2) {
        let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
        return Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x]);
    }
    let blocks: Vec<bool> = (0..25).map(|_| stream.chance(0.5)).collect();
    Pattern::from_fn(Raster::PAPER, |x, y| blocks[y / 10 * 5 + x / 10])
}

/// 32 patterns with their fields. The last two are images of the first two.
fn sound(mesh: Mesh) -> (Memory, Columns) {
    let mut patterns: Vec<Pattern> = (0..30).map(pattern).collect();
    patterns.push(patterns[0].transformed(Symmetry::ALL[1]));
    patterns.push(patterns[1].transformed(Symmetry::ALL[6]));
    let membrane = Membrane(coarseness(mesh));
    let fields: Vec<Field> = patterns.iter().map(|pattern| membrane.field(pattern)).collect();
    let split = |i: usize| if i % 30 < 24 { "train" } else { "test" };
    let columns = Columns {
        split: Some((0..32).map(|i| split(i).to_owned()).collect()),
        peak: Some(fields.iter().map(Field::max_magnitude).collect()),
        orbit: Some(
            patterns
                .iter()
                .map(|pattern| pattern.orbit(Symmetries::SQUARE).to_string())
                .collect(),
        ),
        ..Columns::default()
    };
    let memory = Memory {
        fields: fields.iter().map(|field| field.values().to_vec()).collect(),
        patterns,
        odd_cell: None,
    };
    (memory, columns)
}

/// Two families that contain all patterns, and one with mirror-symmetric patterns.
struct ThreeFamilies;

impl Families for ThreeFamilies {
    fn admits(&self, family: &str, pattern: &Pattern) -> Option<bool> {
        match family {
            "a" | "b" => Some(true),
            "even" => Some(*pattern == pattern.transformed(Symmetry::ALL[4])),
            _ => None,
        }
    }
}

fn square() -> &'static Device {
    static SQUARE: LazyLock<Device> =
        LazyLock::new(|| Device::new(pattern::Membrane::square(50.0), 1, Symmetries::SQUARE, None));
    &SQUARE
}

fn dataset(memory: &Memory, columns: Columns, declared: Discretisation) -> Dataset<'_> {
    Dataset {
        device: square(),
        len: memory.patterns.len(),
        rows: memory,
        columns,
        declared,
        source_samples: None,
        bins: None,
        families: &ThreeFamilies,
    }
}

fn audited(memory: &Memory, columns: Columns, declared: Discretisation) -> Report {
    let dataset = dataset(memory, columns, declared);
    let options = Options {
        samples: Some(4),
        default_accuracy: 0.01,
        tolerance: 1e-5,
        ..Options::default()
    };
    audit(&dataset, &Membranes, &options, &|_| {}).unwrap()
}

#[test]
fn the_progress_of_an_audit_ends_with_its_last_row() {
    let (memory, columns) = sound(MESHES[0]);
    let dataset = dataset(&memory, columns, Discretisation::Mesh(MESHES[0]));
    for samples in [None, Some(0), Some(4), Some(1000)] {
        let options = Options {
            samples,
            default_accuracy: 0.01,
            tolerance: 1e-5,
            ..Options::default()
        };
        let amounts = Mutex::new(Vec::new());
        let report = audit(&dataset, &Membranes, &options, &|amount| {
            amounts.lock().unwrap().push(amount)
        })
        .unwrap();
        let amounts = amounts.into_inner().unwrap();
        let total = work(dataset.len, &options);
        assert_eq!(amounts.iter().sum::<usize>(), total, "{samples:?}");
        // The first pass, the passes that solve rows again, and each row on a finer mesh.
        let finer = samples.unwrap_or(32).min(32);
        assert_eq!(report.resimulated.len(), finer);
        assert_eq!(amounts.len(), 1 + 4 + finer);
        assert!(
            amounts[0] < total && amounts.iter().all(|amount| *amount > 0),
            "{amounts:?}"
        );
    }
}

fn checks(report: &Report) -> Vec<(&str, &[u64])> {
    let findings = report.findings.iter();
    findings.map(|f| (f.check.as_str(), f.examples.as_slice())).collect()
}

const MESHES: [Mesh; 2] = [Mesh::bilinear(2), Mesh::biquadratic(2)];

#[test]
fn a_correct_dataset_has_no_findings() {
    for mesh in MESHES {
        for declared in [
            Discretisation::Mesh(mesh),
            Discretisation::Unknown,
            Discretisation::Estimates(mesh),
        ] {
            let (memory, columns) = sound(mesh);
            let report = audited(&memory, columns, declared);
            assert_eq!(checks(&report), [], "{mesh:?} {declared:?}");
            assert_eq!((report.summary.samples, report.summary.orbits), (32, 30));
            let found_out = report.summary.made_by.contains("found out");
            assert_eq!(
                found_out,
                declared == Discretisation::Unknown,
                "{}",
                report.summary.made_by
            );
            assert_eq!(report.summary.resimulated.faults, 0);
        }
    }
}

/// Plants a fault in row 7, on a coarse and on a fine mesh, and returns the checks that find it.
fn planted(plant: impl Fn(&mut Memory, &mut Columns)) -> Vec<Vec<String>> {
    let found = MESHES.map(|mesh| {
        let (mut memory, mut columns) = sound(mesh);
        plant(&mut memory, &mut columns);
        let report = audited(&memory, columns, Discretisation::Mesh(mesh));
        let named = report
            .findings
            .iter()
            .filter(|f| f.examples == [7] && f.severity == Severity::Error);
        named.map(|f| f.check.clone()).collect()
    });
    found.to_vec()
}

fn change(values: &mut [f64], by: impl Fn(f64) -> f64) {
    values.iter_mut().for_each(|u| *u = by(*u));
}

#[test]
fn each_fault_is_found_by_its_own_check() {
    let is = |check: &str, found: Vec<Vec<String>>| {
        assert!(
            found.iter().all(|checks| checks.iter().any(|c| c == check)),
            "{check}: {found:?}"
        );
    };
    is("sign", planted(|m, _| change(&mut m.fields[7], |u| -u)));
    is("scale", planted(|m, _| change(&mut m.fields[7], |u| 1.03 * u)));
    is("scale", planted(|m, _| change(&mut m.fields[7], |u| 0.97 * u)));
    is("label", planted(|m, _| m.fields[7] = m.fields[9].clone()));
    is("finite", planted(|m, _| m.fields[7][100] = f64::NAN));
    is("boundary", planted(|m, _| m.fields[7][3] = 0.01));
    is("pattern", planted(|m, _| m.odd_cell = Some(7)));
    is("derived", planted(|_, c| c.peak.as_mut().unwrap()[7] *= 1.01));
    is(
        "derived",
        planted(|_, c| c.orbit.as_mut().unwrap()[7].replace_range(..1, "x")),
    );
    // Mirrored with its components, and without.
    is(
        "frame",
        planted(|m, _| {
            let field = Field::from_values(Raster::PAPER, m.fields[7].clone()).unwrap();
            m.fields[7] = field.transformed(Symmetry::ALL[4]).values().to_vec();
        }),
    );
    is(
        "rotation",
        planted(|m, _| {
            let field = Field::from_values(Raster::PAPER, m.fields[7].clone()).unwrap();
            let mirrored = field.transformed(Symmetry::ALL[4]);
            m.patterns[7] = m.patterns[7].transformed(Symmetry::ALL[4]);
            let back = mirrored.values().chunks(2).flat_map(|u| [-u[0], u[1]]);
            m.fields[7] = back.collect();
        }),
    );
}

#[test]
fn a_moving_frame_is_not_a_wrong_label() {
    let found = planted(|m, _| m.fields[7][3] = 0.001);
    assert!(found.iter().flatten().all(|check| check == "boundary"), "{found:?}");
}

#[test]
fn images_that_leak_or_contradict_each_other_are_found() {
    let (memory, mut columns) = sound(MESHES[0]);
    columns.split.as_mut().unwrap()[31] = "test".into();
    let report = audited(&memory, columns, Discretisation::Mesh(MESHES[0]));
    assert_eq!(checks(&report), [("leak", &[1, 31][..])]);
    let (mut memory, columns) = sound(MESHES[0]);
    change(&mut memory.fields[31], |u| 1.03 * u);
    let report = audited(
        &memory,
        Columns { peak: None, ..columns },
        Discretisation::Mesh(MESHES[0]),
    );
    assert_eq!(checks(&report), [("scale", &[31][..]), ("symmetry", &[31])]);
    let (mut memory, mut columns) = sound(MESHES[0]);
    (memory.patterns[5], memory.fields[5]) = (memory.patterns[4].clone(), memory.fields[4].clone());
    columns.peak.as_mut().unwrap()[5] = columns.peak.as_ref().unwrap()[4];
    columns.orbit.as_mut().unwrap()[5] = columns.orbit.as_ref().unwrap()[4].clone();
    let report = audited(&memory, columns, Discretisation::Mesh(MESHES[0]));
    assert_eq!(checks(&report), [("duplicate", &[5][..])]);
    assert_eq!(report.findings[0].severity, Severity::Warning);
}

#[test]
fn rows_without_a_solution_are_listed_and_may_be_nan() {
    let (mut memory, mut columns) = sound(MESHES[0]);
    change(&mut memory.fields[3], |_| f64::NAN);
    memory.patterns[3] = Pattern::from_fn(Raster::PAPER, |_, _| true);
    columns.has_field = Some((0..32).map(|i| i != 3).collect());
    columns.orbit = None;
    let report = audited(&memory, columns, Discretisation::Mesh(MESHES[0]));
    assert_eq!(checks(&report), [("not-converged", &[3][..])]);
    assert_eq!(report.summary.not_converged, [3]);
    assert_eq!(report.findings[0].severity, Severity::Warning);
}

#[test]
fn rows_that_claim_no_field_have_none_and_no_solution() {
    for declared in [Discretisation::Mesh(MESHES[0]), Discretisation::Unknown] {
        let (mut memory, mut columns) = sound(MESHES[0]);
        columns.has_field = Some((0..32).map(|i| ![3, 4].contains(&i)).collect());
        change(&mut memory.fields[4], |_| f64::NAN);
        memory.patterns[3] = Pattern::from_fn(Raster::PAPER, |_, _| true);
        columns.orbit = None;
        let found = audited(&memory, columns, declared);
        let wanted = [("outcome", &[4][..]), ("outcome", &[3]), ("not-converged", &[3, 4])];
        let mut found = checks(&found);
        found.sort_by_key(|(check, rows)| (*check != "outcome", rows[0] == 3));
        assert_eq!(found, wanted, "{declared:?}");
    }
}

#[test]
fn patterns_without_a_solution_are_found_even_where_most_are() {
    let (mut memory, mut columns) = sound(MESHES[1]);
    for row in 0..20 {
        memory.patterns[row] = Pattern::from_fn(Raster::PAPER, |x, y| (x, y) != (row, 0));
    }
    columns.orbit = None;
    let report = audited(&memory, columns, Discretisation::Mesh(MESHES[1]));
    let outcome = report.findings.iter().find(|f| f.check == "outcome").unwrap();
    assert_eq!(outcome.count, 20);
}

#[test]
fn rows_on_several_meshes_are_compared_with_their_own_mesh() {
    let (mut memory, _) = sound(MESHES[0]);
    for row in (1..30).step_by(3) {
        let mesh = if row % 2 == 0 {
            Mesh::biquadratic(1)
        } else {
            Mesh::bilinear(3)
        };
        memory.fields[row] = Membrane(coarseness(mesh))
            .field(&memory.patterns[row])
            .values()
            .to_vec();
    }
    memory.patterns.truncate(30);
    memory.fields.truncate(30);
    let columns = Columns::default();
    let report = audited(&memory, columns.clone(), Discretisation::Unknown);
    assert_eq!(checks(&report), []);
    assert_eq!(report.summary.made_by, "a mesh for each row (found out)");
    change(&mut memory.fields[7], |u| 1.03 * u);
    assert_eq!(
        checks(&audited(&memory, columns, Discretisation::Unknown)),
        [("scale", &[7][..])]
    );
}

#[test]
fn faults_of_all_rows_are_found_without_random_rows() {
    type Fault = fn(&[f64]) -> Vec<f64>;
    let faults: [(&str, Fault); 3] = [
        ("sign", |u| u.iter().map(|u| -u).collect()),
        ("scale", |u| u.iter().map(|u| 1.03 * u).collect()),
        ("scale", |u| vec![0.0; u.len()]),
    ];
    for (check, fault) in faults {
        let (mut memory, mut columns) = sound(MESHES[1]);
        memory.fields.iter_mut().for_each(|field| *field = fault(field));
        columns.peak = None;
        let dataset = dataset(&memory, columns, Discretisation::Mesh(MESHES[1]));
        let options = Options {
            samples: Some(0),
            tolerance: 1e-5,
            ..Options::default()
        };
        let report = audit(&dataset, &Membranes, &options, &|_| {}).unwrap();
        let found: Vec<(&str, u64)> = report.findings.iter().map(|f| (f.check.as_str(), f.count)).collect();
        assert_eq!(found, [(check, 32)]);
    }
}

#[test]
fn rounding_of_a_file_without_declarations_is_not_a_fault() {
    for digits in [1e4, 1e5, 1e6] {
        let (mut memory, mut columns) = sound(MESHES[0]);
        columns.peak = None;
        for field in &mut memory.fields {
            change(field, |u| (u * digits).round() / digits + 0.1 / digits);
        }
        let dataset = dataset(&memory, columns, Discretisation::Unknown);
        let options = Options {
            samples: Some(2),
            default_accuracy: 0.01,
            tolerance: 1e-5,
            rounding: 1e-4,
            ..Options::default()
        };
        let report = audit(&dataset, &Membranes, &options, &|_| {}).unwrap();
        assert_eq!(checks(&report), [], "{digits}");
    }
}

#[test]
fn an_outlier_of_its_kind_is_found_even_within_the_accuracy() {
    let (mut memory, mut columns) = sound(MESHES[1]);
    for (field, pattern) in memory.fields.iter_mut().zip(&memory.patterns) {
        *field = Membrane(0.0031).field(pattern).values().to_vec();
    }
    columns = Columns {
        family: Some((0..32).map(|i| if i % 2 == 0 { "a" } else { "b" }.to_owned()).collect()),
        ..columns
    };
    columns.peak = None;
    change(&mut memory.fields[8], |u| 1.03 * u);
    let report = audited(&memory, columns, Discretisation::Unknown);
    assert_eq!(checks(&report), [("scale", &[8][..])]);
}

#[test]
fn labels_on_an_unknown_mesh_are_compared_with_the_accuracy() {
    // Between the candidate meshes, with an error below a hundredth of a millimetre.
    let (mut memory, mut columns) = sound(MESHES[1]);
    for (field, pattern) in memory.fields.iter_mut().zip(&memory.patterns) {
        *field = Membrane(0.0031).field(pattern).values().to_vec();
    }
    columns.peak = None;
    assert_eq!(checks(&audited(&memory, columns.clone(), Discretisation::Unknown)), []);
    change(&mut memory.fields[7], |u| 1.5 * u);
    let report = audited(&memory, columns, Discretisation::Unknown);
    assert_eq!(checks(&report), [("scale", &[7][..])]);
    assert_eq!(report.summary.made_by, "not known");
}

#[test]
fn columns_of_other_lengths_end_the_audit() {
    let (memory, mut columns) = sound(MESHES[0]);
    columns.split.as_mut().unwrap().pop();
    let report = audited(&memory, columns, Discretisation::Mesh(MESHES[0]));
    assert_eq!(checks(&report), [("shape", &[][..])]);
    assert!(report.findings[0].message.contains("`split` has 31"));
}

#[test]
fn random_rows_show_insufficient_accuracy() {
    let (memory, columns) = sound(MESHES[0]);
    let dataset = dataset(&memory, columns, Discretisation::Mesh(MESHES[0]));
    let options = Options {
        samples: None,
        accuracy: Some(1e-7),
        tolerance: 1e-5,
        default_accuracy: 0.01,
        ..Options::default()
    };
    let report = audit(&dataset, &Membranes, &options, &|_| {}).unwrap();
    assert_eq!(
        report
            .findings
            .iter()
            .map(|f| (f.check.as_str(), f.count))
            .collect::<Vec<_>>(),
        [("accuracy", 32)]
    );
    assert_eq!(report.summary.resimulated.samples, 32);
    assert_eq!(report.summary.resimulated.excluded_above, 1.0);
}

/// The dataset of [`sound`] with the columns of a balanced dataset.
fn balanced() -> (Memory, Columns) {
    let (memory, columns) = sound(MESHES[0]);
    let bins = Bins::new(0.0, 1.0, 1000).unwrap();
    let bin = |peak: &f64| match bins.index_of(*peak) {
        BinIndex::Bin(bin) => bin as u64,
        _ => panic!("{peak}"),
    };
    let number = |last: [u64; 2], of: &dyn Fn(u64) -> u64| Some((0..30).map(of).chain(last).collect::<Vec<u64>>());
    let columns = Columns {
        source: number([0, 1], &|row| row),
        symmetry: number([1, 6], &|_| 0),
        bin: columns.peak.as_ref().map(|peaks| peaks.iter().map(bin).collect()),
        ..columns
    };
    (memory, columns)
}

/// Rows with wrong columns, with and without the samples and bins.
fn claimed(change: impl Fn(&mut Columns)) -> [Vec<(String, Vec<u64>)>; 2] {
    [true, false].map(|is_available| {
        let (memory, mut columns) = balanced();
        change(&mut columns);
        let sample = |pattern: &Pattern| SourceSample {
            pattern: Digest::of(pattern.cells()),
            family: String::new(),
        };
        let samples: Vec<SourceSample> = memory.patterns[..30].iter().map(sample).collect();
        let dataset = Dataset {
            source_samples: is_available.then_some(&samples),
            bins: is_available.then(|| Bins::new(0.0, 1.0, 1000).unwrap()),
            ..dataset(&memory, columns, Discretisation::Mesh(MESHES[0]))
        };
        let options = Options {
            samples: Some(0),
            tolerance: 1e-5,
            ..Options::default()
        };
        let report = audit(&dataset, &Membranes, &options, &|_| {}).unwrap();
        let found = report.findings.into_iter();
        found
            .map(|f| (f.message.split(' ').next().unwrap().to_owned(), f.examples))
            .collect()
    })
}

#[test]
fn wrong_columns_of_rows_are_found() {
    assert_eq!(claimed(|_| {}), [vec![], vec![]]);
    let both = |what: &str, row: u64| [vec![(what.to_owned(), vec![row])], vec![(what.to_owned(), vec![row])]];
    let set = |column: &mut Option<Vec<u64>>, row: usize, value| column.as_mut().unwrap()[row] = value;
    // Rows 0 and 30 are images of one pattern. Without the samples either may be wrong.
    let [known, alone] = claimed(|c| set(&mut c.source, 30, 7));
    assert_eq!(known, [("`source`".to_owned(), vec![30])]);
    assert_eq!(alone, [("`source`".to_owned(), vec![7, 30])]);
    let [known, alone] = claimed(|c| set(&mut c.symmetry, 30, 2));
    assert_eq!(known, [("`source`".to_owned(), vec![30])]);
    assert_eq!(alone, [("`source`".to_owned(), vec![0, 30])]);
    let [known, _] = claimed(|c| set(&mut c.source, 4, NO_NUMBER));
    assert_eq!(known, [("`source`".to_owned(), vec![4])]);
    let [_, alone] = claimed(|c| set(&mut c.symmetry, 4, 8));
    assert_eq!(alone, [("`symmetry`".to_owned(), vec![4])]);
    let (_, columns) = balanced();
    let peaks = columns.peak.unwrap();
    let highest = (0..30).max_by(|a, b| peaks[*a].total_cmp(&peaks[*b])).unwrap();
    assert_eq!(claimed(|c| set(&mut c.bin, highest, 0)), both("`bin`", highest as u64));
    assert_eq!(
        claimed(|c| set(&mut c.bin, highest, NO_NUMBER)),
        both("`bin`", highest as u64)
    );
}

#[test]
fn the_family_must_contain_the_pattern() {
    let family = |name: &str, row: usize| {
        claimed(|c| {
            let mut names = vec![String::new(); 32];
            names[row] = name.to_owned();
            c.family = Some(names);
        })
    };
    let all_but = |row: u64| (0..20).filter(|other| *other != row).collect::<Vec<u64>>();
    let [known, alone] = family("even", 3);
    assert!(
        known.contains(&("`family`".to_owned(), vec![3])),
        "not that of its sample: {known:?}"
    );
    let impossible = ("the".to_owned(), vec![3]);
    assert!(
        known.contains(&impossible) && alone.contains(&impossible),
        "{known:?} {alone:?}"
    );
    let rest = all_but(3).into_iter().chain([20]).take(20).collect();
    assert!(alone.contains(&("`family`".to_owned(), rest)), "unknown: {alone:?}");
}

#[test]
fn the_declared_error_of_a_row_is_bounded() {
    let found = |declared: f64, most: Option<f64>| {
        let (memory, columns) = sound(MESHES[0]);
        let columns = Columns {
            error: Some(vec![declared; 32]),
            ..columns
        };
        let options = Options {
            samples: None,
            tolerance: 1e-5,
            max_declared_error: most,
            ..Options::default()
        };
        let dataset = dataset(&memory, columns, Discretisation::Mesh(MESHES[0]));
        let report = audit(&dataset, &Membranes, &options, &|_| {}).unwrap();
        checks(&report)
            .iter()
            .map(|(check, _)| (*check).to_owned())
            .collect::<Vec<_>>()
    };
    assert!(found(10.0, None).is_empty() && found(10.0, Some(10.0)).is_empty());
    for (declared, most) in [
        (10.0, Some(1e-7)),
        (1e-7, Some(10.0)),
        (f64::NAN, Some(10.0)),
        (-1.0, None),
    ] {
        assert_eq!(found(declared, most), ["accuracy"], "{declared} {most:?}");
    }
}
