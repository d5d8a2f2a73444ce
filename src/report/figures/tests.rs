use std::fs;
use std::path::Path;

use super::*;
use crate::drawing::{Background, Sheet};
use deaflow_pattern as pattern;

fn square() -> Background {
    Background::plain(pattern::Membrane::square(50.0))
}

/// A membrane with a point of the objective.
fn membrane(direction: f64) -> DeformedMembrane {
    let cell = |at: usize| u8::from(at % 50 < 25 || (at / 50) > 40 && at % 50 < 34);
    with(cell, direction, vec![[25.0, 25.0]])
}

fn with(cell: impl Fn(usize) -> u8, direction: f64, points: Vec<[f64; 2]>) -> DeformedMembrane {
    let bump = |t: f64| (std::f64::consts::PI * t).sin();
    let corner = |at: usize| {
        let (x, y) = ((at % 51) as f64 / 50.0, (at / 51) as f64 / 50.0);
        [2.1 * direction * bump(x) * bump(y), 0.6 * bump(2.0 * x) * bump(y)]
    };
    let pattern: Vec<u8> = (0..2500).map(cell).collect();
    let displacement: Vec<f64> = (0..51 * 51).flat_map(corner).collect();
    DeformedMembrane::new(&pattern, &displacement, square(), points).unwrap()
}

fn histogram() -> Histogram {
    let before: Vec<u64> = (0..100)
        .map(|k| (800.0 * (-((k as f64 - 20.0) / 6.0).powi(2)).exp()) as u64 + 2 * (k % 3))
        .collect();
    Histogram {
        edges: (0..=100).map(|k| 0.025 * k as f64).collect(),
        augmented: before.iter().map(|n| 8 * n).collect(),
        levelled: before.iter().map(|n| (*n).min(10)).collect(),
        after: before.iter().map(|n| (8 * n).min(10)).collect(),
        before,
    }
}

fn training(epochs: usize) -> Training {
    let curve = |a: f64, b: f64| (0..epochs).map(|k| a * (-0.4 * k as f64).exp() + b).collect();
    Training {
        is_validated: true,
        train_loss: curve(0.3, 0.004),
        validation_loss: curve(0.2, 0.007),
        validation_rmse: curve(0.6, 0.031),
        learning_rate: (0..epochs).map(|k| 2e-3 * (-0.9 * k as f64).exp()).collect(),
        kept: epochs as u64,
    }
}

fn evolution(n: usize) -> Evolution {
    let rise = |a: f64, r: f64| (0..n).map(|k| a * (1.0 - (-r * k as f64).exp()) + 0.4).collect();
    Evolution {
        best: rise(-1.6, 0.1),
        value: rise(1.6, 0.1),
        mean: rise(-1.3, 0.06),
        area: (0..n).map(|k| 0.5 + 0.02 * (k as f64 / 3.0).sin()).collect(),
        unit: "mm",
    }
}

fn cases() -> Vec<VerifiedPattern> {
    [("Design", 1.0), ("Intuitive", 0.9), ("Intuitive, equal area", 0.85)]
        .map(|(name, factor)| VerifiedPattern {
            name: name.into(),
            membrane: membrane(factor),
            predicted: Some(2.08 * factor),
            simulated: 2.1 * factor,
            error: Some(0.003_21),
            unit: "mm",
            least_width: None,
        })
        .into()
}

fn branches(n: usize) -> Vec<Branch> {
    let at = |k: usize| k as f64 / 30.0;
    let one = |name: &str, top: f64| Branch {
        name: name.into(),
        along: (0..40).map(|k| top * (2.0 * at(k) - at(k).powi(2))).collect(),
        across: (0..40).map(|k| at(k).powi(2)).collect(),
        stable: (0..40).map(|k| k <= 30).collect(),
        limit: Some(Limit {
            name: "fold".into(),
            along: top,
            error: Some(0.01 * top),
            across: 1.0,
        }),
        breakdown: None,
        first: None,
    };
    (0..n)
        .map(|k| one(&format!("pattern {k}"), 4.0 + 0.5 * k as f64))
        .collect()
}

fn volts() -> PathAxes {
    PathAxes {
        along: "Voltage [kV]".to_owned(),
        unit: "kV".to_owned(),
        across: "Displacement [mm]".to_owned(),
    }
}

fn costs() -> Vec<FamilyCosts> {
    let settings = [
        "method: linear, elements_per_cell: 1, order: 1",
        "method: chord:1, elements_per_cell: 1, order: 1",
        "method: newton, elements_per_cell: 1, order: 2",
        "method: newton, accuracy: 0.01 mm",
    ];
    let cost = |(k, settings): (usize, &&str)| Cost {
        settings: (*settings).to_owned(),
        seconds: 2e-4 * 5f64.powi(k as i32),
        error: 0.04 * 0.1f64.powi(k as i32),
    };
    let family = |name: &str| FamilyCosts {
        family: name.into(),
        costs: settings.iter().enumerate().map(cost).collect(),
    };
    vec![family("bezier"), family("small-grid")]
}

fn deformations() -> Vec<FamilyDeformation> {
    let family = |name: &str, middle: f64| FamilyDeformation {
        family: name.into(),
        peaks: (0..200).map(|k| middle + 0.1 * (k as f64).sin()).collect(),
    };
    vec![family("bezier", 1.8), family("small-grid", 0.25)]
}

fn rounds() -> Vec<Round> {
    let round = |k: usize| Round {
        differences: (1..9).map(|i| 0.05 * i as f64 / (1 + 10 * k) as f64).collect(),
        best: ["centre, right", "upper right"]
            .map(|name| (name.to_owned(), 1.9 + 0.1 * k as f64))
            .into(),
    };
    (0..3).map(round).collect()
}

const NAMES: [&str; 9] = [
    "histogram.png",
    "training.png",
    "evolution.png",
    "membrane.png",
    "agreement.png",
    "paths.png",
    "accuracy.png",
    "deformation.png",
    "rounds.png",
];

fn draw_all(folder: &Path) {
    let sheets = [
        histogram().sheet(),
        training(8).sheet(),
        evolution_sheet(&evolution(61)),
        Ok(membrane_sheet("Best design, simulated", &membrane(1.0))),
        agreement_sheet(&cases()),
        paths_sheet(&branches(3), &volts()),
        accuracy_sheet(&costs()),
        deformation_sheet(&deformations()),
        rounds_sheet(&rounds()),
    ];
    for (name, sheet) in NAMES.into_iter().zip(sheets) {
        sheet.unwrap().write_png(&folder.join(name)).unwrap();
    }
}

/// Width, height, RGB.
fn pixels(path: &Path) -> (usize, usize, Vec<[u8; 3]>) {
    let mut reader = png::Decoder::new(fs::File::open(path).unwrap()).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    let pixels = bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    (frame.width as usize, frame.height as usize, pixels)
}

const SKY: [u8; 3] = [86, 180, 233];

#[test]
fn figures_have_the_same_bytes_every_time_and_nothing_touches_their_border() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    draw_all(one.path());
    draw_all(two.path());
    for name in NAMES {
        assert_eq!(
            fs::read(one.path().join(name)).unwrap(),
            fs::read(two.path().join(name)).unwrap(),
            "{name}"
        );
        let (width, height, pixels) = pixels(&one.path().join(name));
        assert!(width >= 1200, "{name}");
        let border = |at: usize| {
            let (x, y) = (at % width, at / width);
            x.min(width - 1 - x).min(y).min(height - 1 - y) < 3
        };
        let stained = pixels
            .iter()
            .enumerate()
            .filter(|(at, p)| border(*at) && **p != [255; 3])
            .count();
        assert_eq!(stained, 0, "{name}");
    }
    assert_eq!(
        fs::read_dir(one.path()).unwrap().count(),
        NAMES.len(),
        "no temporary file stays"
    );
}

#[test]
fn verified_displacements_are_rounded_by_their_errors() {
    let title = |sheet: Result<Sheet, FigureError>| sheet.unwrap().markup.into_string();
    let known = title(agreement_sheet(&cases()));
    assert!(known.contains("2.1000 ± 0.0032 mm"), "{known}");
    assert!(title(gallery_sheet(&cases())).contains("2.1000 mm"));
    let unknown = cases().into_iter().map(|case| VerifiedPattern { error: None, ..case });
    let unknown = title(agreement_sheet(&unknown.collect::<Vec<_>>()));
    assert!(unknown.contains("2.100 mm") && !unknown.contains("±"), "{unknown}");
}

#[test]
fn a_verification_has_a_bar_with_the_number_of_the_headline_for_each_pattern() {
    let mut all = cases();
    all[1].predicted = None;
    let drawn = agreement_sheet(&all).unwrap().markup.into_string();
    let bars: Vec<&str> = drawn.split("class=\"bars ").skip(1).collect();
    assert_eq!(bars.len(), 2, "simulated values, and differences of predictions");
    // The number stands with its unit above the membrane, and at the end of its bar.
    for number in ["2.1000", "1.8900", "1.7850"] {
        assert_eq!(drawn.matches(number).count(), 2, "{number}: {drawn}");
        assert!(bars[0].contains(number), "{number}");
    }
    // Each bar begins with a move to its lower left corner.
    let count = |bars: &str| {
        bars.split("d=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .matches('M')
            .count()
    };
    assert_eq!([count(bars[0]), count(bars[1])], [3, 3]);
    assert!(bars[1].contains(">none</text>") && !bars[0].contains(">none</text>"));
}

#[test]
fn the_electrode_is_drawn_where_it_has_moved_to() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.png");
    let share = |direction: f64| {
        // A half plane, so that the exact area between its moved edge and the frame is known.
        let data = with(|at| u8::from(at % 50 < 25), direction, Vec::new());
        membrane_sheet("t", &data).write_png(&path).unwrap();
        let (_, _, pixels) = pixels(&path);
        pixels.iter().filter(|p| **p == SKY).count() as f64 / (594.0 * 594.0)
    };
    // Mean over the edge of 2.1 mm · sin(πy), drawn twice as large, in shares of 50 mm.
    let moved = 2.0 * 2.1 * 2.0 / std::f64::consts::PI / 50.0;
    let (rest, right, left) = (share(0.0), share(1.0), share(-1.0));
    // The outline takes two pixels of each edge.
    assert!((rest - 0.5).abs() < 0.015, "{rest}");
    // Moved to the right, the electrode lies under the outline of the state at rest: two pixels of 594 more.
    assert!((right - left - 2.0 * moved).abs() < 0.005, "{right} {left}");
    assert!(left < rest && rest < right, "{left} {rest} {right}");
}

#[test]
fn incomplete_data_is_refused_and_unusual_data_is_drawn() {
    let is_refused = |sheet: Result<Sheet, FigureError>| matches!(sheet, Err(FigureError::Data(_)));
    let mut bad = histogram();
    bad.after.pop();
    assert!(is_refused(bad.sheet()));
    assert!(is_refused(training(0).sheet()));
    for kept in [0, 4] {
        assert!(is_refused(Training { kept, ..training(3) }.sheet()));
    }
    // Without validation samples the error is that on the training samples.
    let charts = |is_validated| {
        let training = Training {
            is_validated,
            ..training(3)
        };
        let charts = training.charts().unwrap();
        let names = charts
            .iter()
            .flat_map(|chart| chart.series.iter().map(|series| series.name.clone()));
        let has_validation = names.collect::<Vec<_>>().contains(&Some("validation".to_owned()));
        (charts[1].title.clone(), has_validation)
    };
    let (title, has_validation) = charts(true);
    assert!(title.starts_with("Validation error, ") && has_validation, "{title}");
    let (title, has_validation) = charts(false);
    assert!(
        title.starts_with("Training error (no validation rows), ") && !has_validation,
        "{title}"
    );
    assert!(is_refused(evolution_sheet(&evolution(0))));
    assert!(is_refused(agreement_sheet(&[])));
    let mut field = [0.0; 5202];
    field[7] = f64::NAN;
    assert!(matches!(
        DeformedMembrane::new(&[1; 2500], &field, square(), Vec::new()),
        Err(FigureError::Data(_))
    ));
    let mut none = deformations();
    none[1].peaks.clear();
    let mut odd = deformations();
    odd[0].peaks[3] = f64::NAN;
    for bad in [&[][..], &none, &odd] {
        assert!(is_refused(deformation_sheet(bad)));
    }
    assert!(is_refused(accuracy_sheet(&[])));
    let mut bad = branches(2);
    bad[1].stable.pop();
    assert!(is_refused(paths_sheet(&bad, &volts())));
    assert!(is_refused(paths_sheet(&[], &volts())));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.png");
    let draw = |sheet: Result<Sheet, FigureError>| sheet.unwrap().write_png(&path).unwrap();
    draw(paths_sheet(&branches(12), &volts()));
    // An unstable part that leads far away does not flatten the stable one: the axis ends near twice its height.
    let mut far = branches(1);
    far[0].across[39] = 4000.0;
    let flat = paths_sheet(&far, &volts()).unwrap().svg("far").into_string();
    assert!(!flat.contains("4000") && !flat.contains("1000"), "{flat}");
    let mut still = branches(1);
    still[0].across.fill(0.0);
    still[0].limit = None;
    draw(paths_sheet(&still, &volts()));
    draw(evolution_sheet(&evolution(1)));
    draw(training(1).sheet());
    let still = DeformedMembrane::new(&[1; 2500], &[0.0; 5202], square(), Vec::new()).unwrap();
    draw(Ok(membrane_sheet("t", &still)));
    let empty = Histogram {
        before: vec![0; 100],
        augmented: vec![0; 100],
        levelled: vec![0; 100],
        after: vec![0; 100],
        ..histogram()
    };
    draw(empty.sheet());
    let mut far = deformations();
    far[1].peaks = vec![17.3];
    draw(deformation_sheet(&far));
    let mut negative = cases();
    negative[0].simulated = -1.5;
    draw(agreement_sheet(&negative));
    let mut odd = costs();
    odd.truncate(1);
    (odd[0].costs[0].error, odd[0].costs[1].error) = (0.0, f64::NAN);
    draw(accuracy_sheet(&odd));
    let nowhere = training(1).sheet().unwrap().write_png(Path::new("/nonexistent/x.png"));
    assert!(matches!(nowhere, Err(FigureError::Output(_))));
}

#[test]
fn a_path_marks_where_the_field_reaches_that_of_breakdown() {
    let drawn = |breakdown: Option<[f64; 2]>| {
        let branch = Branch {
            breakdown,
            ..branches(1).remove(0)
        };
        paths_sheet(&[branch], &volts()).unwrap().markup.into_string()
    };
    let words = "breakdown field";
    assert!(!drawn(None).contains(words));
    let marked = drawn(Some([3.0, 0.3]));
    assert!(marked.contains(words), "{marked}");
    // Marks of several paths have one entry in the legend.
    for (n, reached) in [(3, 0), (3, 2), (12, 5)] {
        let mut several = branches(n);
        let marked = several.iter_mut().take(reached);
        marked.for_each(|branch| branch.breakdown = Some([3.0, 0.3]));
        let drawn = paths_sheet(&several, &volts()).unwrap().markup.into_string();
        assert_eq!(drawn.matches(words).count(), reached.min(1), "{drawn}");
    }
}

#[test]
fn the_title_of_a_path_says_what_fails_first() {
    let drawn = |branches: &[Branch]| paths_sheet(branches, &volts()).unwrap().markup.into_string();
    let first = Some(FirstFailure {
        name: "breakdown",
        along: 3.0,
    });
    let mut several = branches(3);
    assert!(!drawn(&several).contains("before"));
    several[1].first.clone_from(&first);
    assert!(drawn(&several).contains("1 of 3 fail before their limit"));
    let mut one = Branch {
        first,
        ..branches(1).remove(0)
    };
    let title = "Load path: breakdown at 3.000 kV, before fold at 4.000 ± 0.040 kV";
    let markup = drawn(std::slice::from_ref(&one));
    assert!(markup.contains(title), "{markup}");
    one.limit = None;
    let markup = drawn(&[one]);
    assert!(
        markup.contains("Load path: breakdown at 3.000 kV") && !markup.contains("before"),
        "{markup}"
    );
}

#[test]
fn the_unstable_part_of_a_path_is_dashed() {
    let folder = tempfile::tempdir().unwrap();
    let blue = |stable: bool| {
        let mut branch = branches(1);
        branch[0].limit = None;
        branch[0].stable.fill(stable);
        let path = folder.path().join("x.png");
        paths_sheet(&branch, &volts()).unwrap().write_png(&path).unwrap();
        pixels(&path).2.iter().filter(|p| **p == [0, 114, 178]).count()
    };
    let (solid, dashed) = (blue(true), blue(false));
    assert!(
        solid > 300 && dashed * 10 < solid * 8 && dashed * 10 > solid * 3,
        "{solid} {dashed}"
    );
}
