//! Declared content is read as written, and inconsistent arrays are refused.

use super::*;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Artifact, Object, Provenance, Store};

/// Puts an object into a store of its own.
fn stored(object: &Object) -> (tempfile::TempDir, Artifact) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("store")).unwrap();
    let stored = store.put(object, &Provenance::default()).unwrap();
    let artifact = store.artifact(&stored.digest).unwrap();
    (folder, artifact)
}

fn rows(n: usize) -> SampleRows {
    SampleRows {
        patterns: vec![Pattern::from_fn(Raster::PAPER, |x, y| x < 20 && y > 3); n],
        family: vec!["stripes".into(); n],
        index: (0..n as u64).collect(),
        units: vec![0; n],
        electrodes: None,
        covered: None,
    }
}

fn solutions() -> Solutions {
    Solutions {
        rows: rows(2),
        outcome: vec![OutcomeKind::Converged; 2],
        displacement: vec![Field::zero(Raster::PAPER); 2],
        max_displacement: vec![0.0; 2],
        newton_iterations: Some(vec![5, 6]),
        residual: Some(vec![1e-9; 2]),
        observations: Observations {
            critical_voltage: Some(vec![[1.0, 2.0], [3.0, 4.0]]),
            ..Observations::default()
        },
        meshes: None,
        history: None,
        unstable: Unstable {
            rows: rows(1),
            outcome: vec![OutcomeKind::PullIn],
            voltage_bracket: vec![[5000.0, 5010.0]],
            time_bracket: None,
        },
        scene: Scene::vhb4910(),
        solver: Some("{ method: newton }".into()),
        effects: Some(Effects::default()),
    }
}

#[test]
fn content_is_read_as_written() {
    let object = solutions().object();
    assert_eq!(object.datasets["critical_voltage"].shape, [2, 2]);
    assert_eq!(object.datasets["unstable/patterns"].shape, [1, 50, 50]);
    assert_eq!(object.datasets["displacement"].units, "mm");
    let (_folder, artifact) = stored(&object);
    assert_eq!(Solutions::read(&artifact).unwrap(), solutions());
}

/// Rows with drawn electrodes, one of which has two groups and one none.
fn drawn_rows() -> SampleRows {
    let triangle = |x: f64| vec![[x, 1.0], [x + 5.0, 1.0], [x, 7.125]];
    let square = vec![[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0]];
    let polygons = |rings: &[Vec<[f64; 2]>]| deaflow_pattern::Polygons::new(rings);
    let drawn = |groups: &[(u8, deaflow_pattern::Polygons)]| {
        Some(std::sync::Arc::new(deaflow_pattern::Electrodes::new(groups, [50.0; 2])))
    };
    let own = [
        drawn(&[
            (2, polygons(&[triangle(20.0)])),
            (1, polygons(&[square, triangle(2.0)])),
        ]),
        None,
        drawn(&[(1, polygons(&[triangle(30.0)]))]),
    ];
    let patterns = rows(3).patterns.into_iter().zip(own);
    let patterns: Vec<Pattern> = patterns.map(|(pattern, own)| pattern.with_electrodes(own)).collect();
    SampleRows {
        electrodes: DrawnElectrodes::of(&patterns),
        patterns,
        ..rows(3)
    }
}

#[test]
fn drawn_electrodes_are_read_as_written_and_checked() {
    let samples = Samples {
        rows: drawn_rows(),
        area: vec![0.5; 3],
    };
    let (_folder, artifact) = stored(&samples.object());
    let read = Samples::read(&artifact).unwrap().rows;
    assert_ne!(read, drawn_rows());
    let read = read.drawn().unwrap();
    assert_eq!(read, drawn_rows());
    let selected = read.select(&[2, 0]);
    assert_eq!(selected.electrodes, DrawnElectrodes::of(&selected.patterns));
    assert_eq!(selected.patterns[1], read.patterns[0]);
    assert_eq!(read.select(&[]).electrodes, Some(DrawnElectrodes::default()));
    type Fault = fn(&mut DrawnElectrodes);
    let faults: [(Fault, &str); 5] = [
        (|own| own.polygons[1] = 1, "do not add up"),
        (|own| own.vertices[0] = u64::MAX, "do not add up"),
        (|own| own.group[0] = 0, "a group is out of range"),
        (|own| own.vertex[3][1] = f64::NAN, "a coordinate is out of range"),
        (|own| own.size.truncate(2), "not one for each pattern"),
    ];
    for (fault, says) in faults {
        let mut rows = drawn_rows();
        fault(rows.electrodes.as_mut().unwrap());
        let found = rows.drawn().unwrap_err().to_string();
        assert!(found.contains(says), "{found}");
    }
}

/// Rows with cells that are covered in part, of which the second has none.
fn covered_rows() -> SampleRows {
    let patterns = rows(3).patterns.into_iter().enumerate();
    let patterns = patterns.map(|(at, pattern)| {
        let (mut groups, mut shares) = (pattern.cells().to_vec(), Vec::new());
        for (cell, group) in groups.iter_mut().enumerate() {
            let share = match (at, cell % 7) {
                (0 | 2, 3) => 0.3,
                (0 | 2, 5) => 0.5 + 1e-3 * at as f64,
                _ => f64::from(u8::from(*group != 0)),
            };
            *group = if share == 0.0 { 0 } else { (*group).max(1) };
            shares.push(share);
        }
        let coverage = deaflow_pattern::Coverage::new(pattern.raster(), &groups, &shares).unwrap();
        Pattern::of_coverage(coverage)
    });
    let patterns: Vec<Pattern> = patterns.collect();
    assert!(patterns[0].coverage().is_some() && patterns[1].coverage().is_none());
    SampleRows {
        covered: CoveredCells::of(&patterns),
        patterns,
        ..rows(3)
    }
}

#[test]
fn covered_shares_of_cells_are_read_as_written_and_checked() {
    let samples = Samples {
        rows: covered_rows(),
        area: vec![0.5; 3],
    };
    let (_folder, artifact) = stored(&samples.object());
    let read = Samples::read(&artifact).unwrap().rows;
    assert_ne!(read, covered_rows());
    let read = read.drawn().unwrap();
    assert_eq!(read, covered_rows());
    let selected = read.select(&[2, 1]);
    assert_eq!(selected.covered, CoveredCells::of(&selected.patterns));
    assert_eq!(rows(3).drawn().unwrap(), rows(3));
    type Fault = fn(&mut CoveredCells);
    let faults: [(Fault, &str); 6] = [
        (|own| own.share.0.truncate(10), "not one for each cell"),
        (|own| own.group.0[3] = 17, "a group is out of range"),
        (
            |own| own.share.0[3] = 1.5,
            "cell [y=0][x=3] is covered by 1.5; allowed: 0 to 1",
        ),
        (|own| own.share.0[3] = f64::NAN, "is covered by NaN"),
        (|own| own.group.0[3] = 0, "has the electrode group 0"),
        (|own| own.share.0[3] = 0.7, "are not those of the pattern"),
    ];
    for (fault, says) in faults {
        let mut rows = covered_rows();
        fault(rows.covered.as_mut().unwrap());
        let found = rows.drawn().unwrap_err().to_string();
        assert!(found.contains(says), "{found}");
    }
}

#[test]
fn samples_near_the_limit_are_those_that_a_finer_mesh_could_reject() {
    let near = |critical: Option<Vec<[f64; 2]>>| {
        let mut solved = solutions();
        solved.observations.critical_voltage = critical;
        let (_folder, artifact) = stored(&solved.object());
        Solutions::open(&artifact).unwrap().near_limit().unwrap()
    };
    // A mesh may be too stiff by 12 %: 88 % of 5,900 V are below the 5,250 V of the scene, 88 % of 6,000 V are not.
    assert_eq!(near(Some(vec![[5900.0, 5901.0], [6000.0, 6001.0]])), [true, false]);
    assert_eq!(near(Some(vec![[0.0; 2], [5250.0, 5251.0]])), [false, true]);
    assert_eq!(near(None), [false; 2]);
}

#[test]
fn a_view_reads_single_arrays_and_detects_missing_ones() {
    let (_folder, artifact) = stored(&solutions().object());
    let view = Solutions::open(&artifact).unwrap();
    assert_eq!(view.unstable().rows().index().read().unwrap(), [0]);
    assert_eq!(view.displacement().rows().unwrap(), 2);
    assert_eq!(view.displacement().numbers(1..2).unwrap(), vec![0.0; 51 * 51 * 2]);
    assert!(!view.meshes().is_there().unwrap() && view.observations().is_there().unwrap());
    assert_eq!(view.observations().breakdown_ratio().read().unwrap(), None);
    assert_eq!(view.scene().read().unwrap(), Scene::vhb4910());
}

#[test]
fn arrays_along_one_axis_are_equally_long() {
    let mut object = solutions().object();
    let short = SampleRows::object(rows(1)).datasets.remove("index").unwrap();
    object.datasets.insert("index".into(), short);
    let (_folder, artifact) = stored(&object);
    let error = Solutions::read(&artifact).unwrap_err().to_string();
    assert!(
        error.ends_with("arrays differ in length: `index` has 1 along `sample`, `patterns` has 2"),
        "{error}"
    );
}

#[test]
fn other_axes_and_missing_attributes_are_named() {
    let mut object = solutions().object();
    let flat = object.datasets["residual"].clone();
    object.datasets.insert("displacement".into(), flat);
    let (_folder, artifact) = stored(&object);
    let error = Solutions::read(&artifact).unwrap_err().to_string();
    assert!(
        error.ends_with("`displacement` has shape [2], expected (sample, corner_y, corner_x, 2)"),
        "{error}"
    );

    let mut object = solutions().object();
    object.attributes.remove("scene");
    let (_folder, artifact) = stored(&object);
    let error = Solutions::read(&artifact).unwrap_err().to_string();
    assert!(error.ends_with("attribute `scene` is missing"), "{error}");
}

#[test]
fn arrays_that_do_not_fit_their_axes_cannot_be_stored() {
    let mut wrong = solutions();
    wrong.max_displacement.pop();
    assert!(wrong.object().digest().is_err());
}

#[test]
fn every_array_is_declared_once_with_its_axes_and_a_description() {
    for kind in catalogue() {
        let mut paths: Vec<&str> = kind.arrays.iter().map(|array| array.path.as_str()).collect();
        paths.sort_unstable();
        assert!(
            paths.windows(2).all(|pair| pair[0] != pair[1]),
            "{}: {paths:?}",
            kind.name
        );
        for array in &kind.arrays {
            let place = format!("{}: {}", kind.name, array.path);
            assert!(array.axes.len() >= array.extents.len().max(1), "{place}");
            assert!(array.description.ends_with('.'), "{place}: {}", array.description);
        }
    }
}

#[test]
fn axes_of_a_group_can_be_renamed() {
    let axes = |path: &str| {
        let declared = Evaluation::declared();
        declared.into_iter().find(|array| array.path == path).unwrap().axes
    };
    assert_eq!(axes("score/rmse"), ["predictors", "families"]);
    assert_eq!(axes("area/rmse"), ["predictors", "area_bin"]);
    let unstable = Solutions::declared();
    let unstable = unstable.iter().find(|array| array.path == "unstable/family").unwrap();
    assert_eq!(unstable.axes, ["unstable_sample"]);
}
