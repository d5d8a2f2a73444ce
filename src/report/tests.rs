use std::collections::BTreeMap;
use std::path::Path;

use super::format::figure_name;
use super::*;
use deaflow_scene::Scene;
use deaflow_store::{Data, Dataset, Object, Provenance, Store};

struct TestStore {
    folder: tempfile::TempDir,
    store: Store,
}

impl TestStore {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("store")).unwrap();
        Self { folder, store }
    }

    fn run<'a>(&'a self, stages: &'a [StageArtifact]) -> RunArtifacts<'a> {
        RunArtifacts {
            store: &self.store,
            file: Path::new("/p.yaml"),
            stages,
            rounds: &[],
        }
    }

    fn made(&self, stage: &str, kind: &str, object: &Object) -> StageArtifact {
        let stored = self.store.put(object, &Provenance::default()).unwrap();
        StageArtifact {
            stage: stage.into(),
            kind: kind.into(),
            digest: stored.digest,
        }
    }
}

fn floats(units: &str, values: &[f64]) -> Dataset {
    Dataset::new(units, "d", &[values.len()], Data::F64(values.to_vec()))
}

fn object(datasets: Vec<(&str, Dataset)>) -> Object {
    Object {
        attributes: BTreeMap::from([
            ("scene".to_owned(), Scene::vhb4910().to_text()),
            (
                "objective".to_owned(),
                "{ point: [25 mm, 2.5 cm], direction: 0 deg }".to_owned(),
            ),
        ]),
        datasets: datasets.into_iter().map(|(path, d)| (path.to_owned(), d)).collect(),
        ..Object::default()
    }
}

fn balanced() -> Object {
    let counts = |n: u64| Dataset::new("1", "d", &[2], Data::U64(vec![n, 2 * n]));
    object(vec![
        ("histogram/edges", floats("mm", &[0.0, 1.0, 2.0])),
        ("histogram/before", counts(5)),
        ("histogram/augmented", counts(8)),
        ("histogram/after", counts(3)),
        ("bin", Dataset::new("1", "d", &[3], Data::U64(vec![0, 1, 1]))),
        ("symmetry", Dataset::new("1", "d", &[3], Data::U64(vec![0, 0, 4]))),
    ])
}

fn solved(peaks: &[f64]) -> Object {
    let families = vec!["bezier".to_owned(); peaks.len()];
    object(vec![
        ("family", Dataset::new("", "d", &[peaks.len()], Data::Text(families))),
        ("max_displacement", floats("mm", peaks)),
    ])
}

fn trained() -> Object {
    let curve = || floats("1", &[0.3, 0.1]);
    let texts = |texts: &[&str]| {
        let texts: Vec<String> = texts.iter().map(|text| (*text).to_owned()).collect();
        Dataset::new("", "d", &[texts.len()], Data::Text(texts))
    };
    let content = object(vec![
        ("curves/train_loss", curve()),
        ("curves/validation_loss", curve()),
        ("curves/validation_rmse", curve()),
        ("curves/learning_rate", curve()),
        ("best_epoch", Dataset::new("1", "d", &[1], Data::U64(vec![2]))),
        ("metrics/family", texts(&["all", "bezier", "all"])),
        ("metrics/split", texts(&["train", "train", "test"])),
        ("metrics/rmse", floats("mm", &[0.01, 0.02, 0.0345])),
    ]);
    let content = content.attribute("network", "qin2024");
    content.attribute("warnings", "3 samples are left out\nthe training diverged")
}

fn words(texts: &[&str]) -> Dataset {
    let texts: Vec<String> = texts.iter().map(|text| (*text).to_owned()).collect();
    Dataset::new("", "d", &[texts.len()], Data::Text(texts))
}

fn integers(values: &[u64]) -> Dataset {
    Dataset::new("1", "d", &[values.len()], Data::U64(values.to_vec()))
}

const OBJECTIVE: &str = "{ point: [25 mm, 25 mm], direction: 0 deg }";

fn designed() -> Object {
    let curve = || floats("1", &[1.5, 1.7, 1.8]);
    object(vec![
        ("name", words(&["design"; 2])),
        ("role", words(&["ga", "intuitive"])),
        ("evaluator", words(&["method: linear"; 2])),
        ("probe/name", words(&["design"])),
        ("probe/candidates", words(&["method: linear"])),
        ("probe/rmse", floats("mm", &[0.002])),
        ("probe/design_error", floats("1", &[0.001])),
        ("probe/known", integers(&[32])),
        ("probe/disagree", integers(&[0])),
        ("history/name", words(&["design"; 3])),
        ("history/best", curve()),
        ("history/mean", curve()),
        ("history/value", floats("mm", &[1.1, 1.3, 1.4])),
        ("history/area", floats("1", &[0.5, 0.51, 0.5])),
        (
            "patterns",
            Dataset::new("1", "d", &[2, 50, 50], Data::U8(vec![1; 5000])),
        ),
        (
            "predicted",
            Dataset::new("mm", "d", &[2, 51, 51, 2], Data::F64(vec![0.1; 10404])),
        ),
        ("value", floats("mm", &[1.4, 1.2])),
        ("case", words(&[""; 2])),
        ("member", integers(&[0; 2])),
        ("units", integers(&[20, 50])),
        ("area", floats("1", &[0.5, 0.4])),
    ])
    .with_long_texts("objective", "d", [OBJECTIVE; 2])
    .with_long_texts("status", "d", ["met"; 2])
}

/// A design, an optimum of 2.5 mm, of which it reaches 2.0 mm, and the two intuitive designs.
fn verified(outcomes: [&str; 4]) -> Object {
    let simulated: Vec<f64> = outcomes
        .iter()
        .zip([2.0, 2.5, 1.6, 1.95])
        .filter(|(outcome, _)| **outcome == "converged")
        .map(|(_, s)| s)
        .collect();
    let n = simulated.len();
    object(vec![
        ("case", words(&[""; 4])),
        ("name", words(&["design"; 4])),
        ("role", words(&["ga", "optimum", "intuitive", "intuitive-equal-area"])),
        ("member", integers(&[0; 4])),
        ("units", integers(&[20, 20, 50, 50])),
        ("outcome", words(&outcomes)),
        (
            "patterns",
            Dataset::new("1", "d", &[4, 50, 50], Data::U8(vec![1; 10000])),
        ),
        (
            "displacement",
            Dataset::new("mm", "d", &[n, 51, 51, 2], Data::F64(vec![0.1; n * 5202])),
        ),
        ("component/predicted", floats("mm", &[2.1, 2.5, 1.9, 2.0])),
        ("component/simulated", floats("mm", &simulated)),
        ("component/error", floats("mm", &vec![0.01; n])),
        ("component/error_known", integers(&vec![1; n])),
        ("component/distance", floats("mm", &vec![0.0; n])),
        ("area", floats("1", &[0.5, 0.5, 0.4, 0.5])),
        ("area_target", words(&["0.5"; 4])),
    ])
    .with_long_texts("objective", "d", [OBJECTIVE; 4])
    .with_long_texts("constraints", "d", ["{}"; 4])
    .with_long_texts("status", "d", ["met"; 4])
}

#[test]
fn two_files_with_the_same_pipeline_name_have_separate_folders() {
    let bench = TestStore::new();
    let made = [bench.made("solved", "solve", &solved(&[1.7; 13]))];
    let files = ["one.yaml", "two.yaml"].map(|name| bench.folder.path().join(name));
    files.iter().for_each(|file| std::fs::write(file, "").unwrap());
    let folder = |file: &Path| {
        let run = RunArtifacts {
            file,
            ..bench.run(&made)
        };
        let paths = draw_figures(PRESENTERS, &run, "p").unwrap();
        paths[0]
            .parent()
            .unwrap()
            .file_name()
            .unwrap()
            .to_str()
            .unwrap()
            .to_owned()
    };
    assert_eq!(folder(&files[0]), "p");
    assert_eq!(folder(&files[1]).len(), "p-123456".len());
    assert_eq!(folder(&files[0]), "p");
    // A file that was moved keeps its figures.
    std::fs::remove_file(&files[0]).unwrap();
    assert_eq!(folder(&bench.folder.path().join("moved.yaml")), "p");
}

#[test]
fn figures_are_drawn_once_and_named_by_their_artifact() {
    let bench = TestStore::new();
    let made = [
        bench.made("small", "sample", &Object::default().with("x", floats("1", &[1.0]))),
        bench.made("solved", "solve", &solved(&[1.7; 13])),
        bench.made("fallen", "solve", &solved(&[])),
        bench.made("balanced", "balance", &balanced()),
        bench.made("a/../b", "train", &trained()),
        bench.made("design", "design", &designed()),
        bench.made("verified", "verify", &verified(["converged"; 4])),
    ];
    let paths = draw_figures(PRESENTERS, &bench.run(&made), "../quick start").unwrap();
    let folder = bench.store.root().join("figures/---quick-start");
    let names: Vec<String> = paths
        .iter()
        .map(|p| p.strip_prefix(&folder).unwrap().display().to_string())
        .collect();
    let digest = |k: usize| made[k].digest.to_string()[..8].to_owned();
    let expected = [
        format!("solved-{}-deformation.png", digest(1)),
        format!("balanced-{}-histogram.png", digest(3)),
        format!("a----b-{}-training.png", digest(4)),
        format!("design-{}-evolution.png", digest(5)),
        format!("design-{}-best.png", digest(5)),
        format!("verified-{}-verification.png", digest(6)),
    ];
    assert_eq!(names, expected);

    // Existing figures are neither drawn nor are their artifacts opened again.
    let written = std::fs::metadata(&paths[0]).unwrap().modified().unwrap();
    std::fs::remove_file(bench.store.artifact(&made[1].digest).unwrap().path()).unwrap();
    assert_eq!(
        draw_figures(PRESENTERS, &bench.run(&made), "../quick start").unwrap(),
        paths
    );
    assert_eq!(std::fs::metadata(&paths[0]).unwrap().modified().unwrap(), written);
    std::fs::remove_file(&paths[0]).unwrap();
    assert!(matches!(
        draw_figures(PRESENTERS, &bench.run(&made), "../quick start"),
        Err(ReportError::Store(_))
    ));
}

#[test]
fn figures_are_drawn_in_the_background() {
    let bench = TestStore::new();
    let made = [
        bench.made("solved", "solve", &solved(&[1.7; 13])),
        bench.made("found", "solve", &solved(&[1.6; 13])),
        bench.made("lost", "balance", &balanced()),
    ];
    std::fs::remove_file(bench.store.artifact(&made[2].digest).unwrap().path()).unwrap();
    let background =
        BackgroundFigures::start(bench.store.clone(), bench.run(&made).file.to_owned(), "p".into()).unwrap();
    // One is built, one already existed, and one cannot be read, which is reported at the end.
    for (made, is_new) in made.iter().zip([true, false, true]) {
        background.add(made.clone(), is_new);
    }
    background.finish();
    let folder = bench.store.root().join("figures/p");
    let drawn = || -> Vec<String> {
        let entries = std::fs::read_dir(&folder).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.filter(|name| name.ends_with(".png")).collect();
        names.sort();
        names
    };
    let first = figure_name("solved", &made[0].digest.to_string(), "deformation");
    assert_eq!(drawn(), std::slice::from_ref(&first));
    let written = |name: &str| std::fs::metadata(folder.join(name)).unwrap().modified().unwrap();
    let before = written(&first);
    let paths = draw_figures(PRESENTERS, &bench.run(&made[..2]), "p").unwrap();
    assert_eq!((paths.len(), drawn().len()), (2, 2));
    assert_eq!(written(&first), before);
    assert!(matches!(
        draw_figures(PRESENTERS, &bench.run(&made), "p"),
        Err(ReportError::Store(_))
    ));
}

#[test]
fn errors_are_drawn_over_the_times_in_the_provenance() {
    let bench = TestStore::new();
    let texts = |t: [&str; 2]| Dataset::new("", "d", &[2], Data::Text(t.map(str::to_owned).to_vec()));
    let measured = |errors: [f64; 4]| {
        let errors = Dataset::new("mm", "d", &[2, 2], Data::F64(errors.to_vec()));
        object(vec![
            ("methods", texts(["method: linear", "method: newton"])),
            ("families", texts(["bezier", "stripes"])),
            ("error/rms", errors),
        ])
    };
    let times = |names: [&str; 2]| Provenance {
        measurements: names.iter().map(|name| ((*name).to_owned(), 1e-3)).collect(),
        ..Provenance::default()
    };
    let figures = |stage: &str, object: &Object, provenance: &Provenance| {
        let made = StageArtifact {
            stage: stage.into(),
            kind: "accuracy".into(),
            digest: bench.store.put(object, provenance).unwrap().digest,
        };
        draw_figures(PRESENTERS, &bench.run(&[made]), "p").map(|paths| paths.len())
    };
    let known = times(["method: linear; bezier", "method: newton; stripes"]);
    assert_eq!(figures("a", &measured([0.1, 0.2, 0.3, 0.4]), &known).unwrap(), 1);
    assert_eq!(figures("b", &measured([0.0; 4]), &known).unwrap(), 0, "nothing moves");
    let unknown = times(["method: other; bezier", "x"]);
    assert_eq!(
        figures("c", &measured([0.4, 0.2, 0.3, 0.4]), &unknown).unwrap(),
        0,
        "no time is known"
    );
}

#[test]
fn the_summary_has_predictions_simulations_and_gains() {
    let bench = TestStore::new();
    let made = [bench.made("verified", "verify", &verified(["converged"; 4]))];
    let summaries = bench.run(&made).each("verify", summary::read).unwrap();
    let text = summaries[0].to_string();
    for part in [
        "genetic algorithm",
        "predicted   2.100 mm",
        "simulated    2.000 ± 0.010 mm",
        "gain over the intuitive design +2.56 % at equal area, +25.0 % at its area of 40.0 %",
        "80.0 % of the best pattern found by gradient search under the same constraints",
        "differ by up to 18.7 %: the evaluator is not accurate",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json = serde_json::to_value(&summaries).unwrap();
    assert_eq!(json[0]["rows"][3]["role"], "intuitive-equal-area");
    assert_eq!(json[0]["rows"][0]["simulated_mm"], 2.0);
    assert!((json[0]["rows"][0]["gain_own_area"].as_f64().unwrap() - 0.25).abs() < 1e-12);
    assert_eq!(json[0]["rows"][1]["ratio_to_optimum"], 1.0);
    let optimum = "the best pattern found by gradient search under the same constraints";
    assert_eq!(json[0]["rows"][0]["optimum_is"], optimum);
    assert_eq!(json[0]["rows"][2]["optimum_is"], serde_json::Value::Null);
    assert_eq!(json[0]["rows"][2]["ratio_to_optimum"], serde_json::Value::Null);
    assert!((json[0]["rows"][3]["ratio_to_optimum"].as_f64().unwrap() - 0.78).abs() < 1e-12);
}

#[test]
fn gains_are_those_over_intuitive_designs_that_satisfy_the_constraints() {
    let bench = TestStore::new();
    let told = |area: &str, statuses: [&str; 4]| {
        let verified = verified(["converged"; 4]).with("area_target", words(&[area; 4]));
        let verified = verified.with_long_texts("status", "d", statuses);
        let made = [bench.made("verified", "verify", &verified)];
        let summary = bench.run(&made).each("verify", summary::read).unwrap().remove(0);
        let row = serde_json::to_value(&summary.rows[0]).unwrap();
        let gains = ["gain_own_area", "gain_equal_area"].map(|key| row[key].is_number());
        (gains, summary.to_string(), summary.result().text)
    };
    let all = ["met"; 4];
    // At its own area, the intuitive design has 0.4.
    assert_eq!(told("at most 0.4", all).0, [true, false]);
    assert_eq!(told("0.5", all).0, [true, true]);
    let (gains, listed, _) = told("at most 0.39", all);
    assert_eq!(gains, [false, false]);
    assert!(listed.contains("(area 0.4000, wanted at most 0.39)"), "{listed}");
    let ragged = "no rectangle of 3 mm in 2 cells";
    let (gains, listed, headline) = told("free", ["met", "met", ragged, "met"]);
    assert_eq!(gains, [false, true]);
    assert!(
        listed.contains("gain over the intuitive design +2.56 % at equal area") && listed.contains(ragged),
        "{listed}"
    );
    assert!(
        headline.contains("2.56 % more than the intuitive design of the same area"),
        "{headline}"
    );
    assert!(!headline.contains("40.0 %"), "{headline}");
    let (gains, listed, headline) = told("free", ["met", "met", ragged, ragged]);
    assert_eq!(gains, [false, false]);
    // One of equal area is told nevertheless.
    assert!(
        listed.contains("+2.56 % at equal area, which violates constraints"),
        "{listed}"
    );
    let told_of = "2.56 % more than the intuitive design of the same area, which violates constraints";
    assert!(headline.contains(told_of), "{headline}");
    // A design that violates its area has an intuitive one of equal area that does so, too.
    let wide = "area 0.5, wanted 0.4 within 0.005";
    assert_eq!(told("0.4", [wide, "met", "met", wide]).0, [true, true]);
    // What an evaluator cannot predict says nothing about constraints.
    let (gains, ..) = told("free", ["met", "met", "no stable field", "met"]);
    assert_eq!(gains, [true, true]);
}

#[test]
fn designs_within_their_errors_are_counted() {
    let bench = TestStore::new();
    let told = |errors: [f64; 4]| {
        let mut verified = verified(["converged"; 4]);
        for (path, values) in [
            ("component/simulated", [2.0, 1.99, 1.97, 1.5]),
            ("component/error", errors),
        ] {
            verified.datasets.insert(path.into(), floats("mm", &values));
        }
        let verified = verified
            .with("role", words(&["ga", "ga", "ga", "intuitive"]))
            .with("member", integers(&[1, 2, 0, 0]));
        let made = [bench.made("verified", "verify", &verified)];
        let summary = bench.run(&made).each("verify", summary::read).unwrap().remove(0);
        (summary.clone().sorted(), summary.result().text)
    };
    let few = "the best 2 of 3 designs do not differ by more than their errors";
    let (sorted, headline) = told([0.006; 4]);
    assert!(
        sorted.to_string().contains(few) && headline.ends_with(few),
        "{sorted}\n{headline}"
    );
    let members: Vec<u64> = sorted.rows.iter().map(|row| row.member).collect();
    assert_eq!(members, [0, 1, 2, 0]);
    let (_, headline) = told([0.004; 4]);
    assert!(!headline.contains("differ by more"), "{headline}");
}

#[test]
fn an_inaccurate_evaluator_is_reported() {
    let bench = TestStore::new();
    let mut wrong = verified(["converged"; 4]);
    wrong
        .datasets
        .insert("component/predicted".into(), floats("mm", &[2.8, 2.5, 1.9, 2.0]));
    let made = [bench.made("verified", "verify", &wrong)];
    let summary = &bench.run(&made).each("verify", summary::read).unwrap()[0];
    assert!((summary.largest_difference.unwrap() - 0.4).abs() < 1e-12);
    assert!(
        summary
            .to_string()
            .contains("up to 40.0 %: the evaluator is not accurate")
    );
}

#[test]
fn a_gain_over_a_pattern_that_moves_the_other_way_is_a_difference() {
    let bench = TestStore::new();
    let shown = |intuitive: f64, error: f64| {
        let mut moved = verified(["converged"; 4]);
        for (path, values) in [
            ("component/simulated", [2.0, 2.5, intuitive, 1.95]),
            ("component/error", [0.01, 0.01, error, 0.01]),
        ] {
            moved.datasets.insert(path.into(), floats("mm", &values));
        }
        moved.datasets.insert("component/error_known".into(), integers(&[1; 4]));
        let made = [bench.made("verified", "verify", &moved)];
        let summary = bench.run(&made).each("verify", summary::read).unwrap().remove(0);
        let row = serde_json::to_value(&summary.rows[0]).unwrap();
        let gains = ["gain_own_area", "gain_own_area_mm"].map(|key| row[key].as_f64());
        (gains, summary.to_string())
    };
    for (intuitive, error, gain) in [(-0.1, 0.01, "+2.10 mm"), (0.02, 0.05, "+1.98 mm")] {
        let (gains, text) = shown(intuitive, error);
        assert_eq!(gains, [None, Some(2.0 - intuitive)]);
        let gain = format!("gain over the intuitive design +2.56 % at equal area, {gain} at its area of 40.0 %");
        assert!(text.contains(&gain), "{gain}: {text}");
    }
    let (gains, text) = shown(0.5, 0.05);
    assert_eq!(gains, [Some(3.0), None]);
    assert!(text.contains("+300 % at its area of 40.0 %"), "{text}");
}

#[test]
fn a_pattern_that_hardly_moves_does_not_make_an_evaluator_inaccurate() {
    let bench = TestStore::new();
    let mut still = verified(["converged"; 4]);
    for (path, values) in [
        ("component/simulated", [2.0, 2.5, 0.01, 1.95]),
        ("component/predicted", [2.0, 2.5, 0.02, 1.95]),
    ] {
        still.datasets.insert(path.into(), floats("mm", &values));
    }
    let made = [bench.made("verified", "verify", &still)];
    let summary = &bench.run(&made).each("verify", summary::read).unwrap()[0];
    // 0.01 mm of a tenth of 2.5 mm.
    assert!(summary.to_string().ends_with("differ by up to 4.00 %"), "{summary}");
}

#[test]
fn a_pattern_without_a_stable_solution_shows_no_numbers() {
    let bench = TestStore::new();
    let outcomes = ["converged", "converged", "converged", "pull-in"];
    let made = [bench.made("verified", "verify", &verified(outcomes))];
    let summary = &bench.run(&made).each("verify", summary::read).unwrap()[0];
    let gains = |row: &summary::RowSummary| (row.gain_own_area, row.gain_equal_area);
    let (own, equal) = gains(&summary.rows[0]);
    assert!((own.unwrap() - 0.25).abs() < 1e-12 && equal.is_none());
    assert_eq!(summary.rows[3].simulated_mm, None);
    assert!(summary.to_string().contains("no stable solution was found: pull-in"));
    assert_eq!(draw_figures(PRESENTERS, &bench.run(&made), "p").unwrap().len(), 1);
    let none = [bench.made("verified", "verify", &verified(["pull-in"; 4]))];
    assert_eq!(draw_figures(PRESENTERS, &bench.run(&none), "p").unwrap().len(), 0);
}

#[test]
fn many_targets_are_drawn_as_a_gallery() {
    let bench = TestStore::new();
    let mut many = verified(["converged"; 4]);
    let object = &mut many.datasets;
    let eight: Vec<String> = (0..8).map(|k| format!("t{k}")).collect();
    let names: Vec<&str> = eight.iter().map(String::as_str).collect();
    for (path, data) in [
        ("name", words(&names)),
        ("case", words(&["I"; 8])),
        ("role", words(&["refined"; 8])),
        ("outcome", words(&["converged"; 8])),
        ("member", integers(&[0; 8])),
        ("units", integers(&[50; 8])),
        ("area", floats("1", &[0.5; 8])),
        ("component/predicted", floats("mm", &[1.0; 8])),
        ("component/simulated", floats("mm", &[1.0; 8])),
        ("component/error", floats("mm", &[0.0; 8])),
        ("component/error_known", integers(&[0; 8])),
        ("component/distance", floats("mm", &[0.0; 8])),
        (
            "patterns",
            Dataset::new("1", "d", &[8, 50, 50], Data::U8(vec![1; 20000])),
        ),
        (
            "displacement",
            Dataset::new("mm", "d", &[8, 51, 51, 2], Data::F64(vec![0.1; 8 * 5202])),
        ),
    ] {
        object.insert(path.into(), data);
    }
    let many = many.with_long_texts("objective", "d", [OBJECTIVE; 8]);
    let many = many
        .with_long_texts("status", "d", ["met"; 8])
        .with_long_texts("constraints", "d", ["{}"; 8])
        .with("area_target", words(&["0.5"; 8]));
    let made = [bench.made("verified", "verify", &many)];
    let figures = draw_figures(PRESENTERS, &bench.run(&made), "p").unwrap();
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&figures[0]).unwrap()));
    let size = decoder.read_info().unwrap().info().size();
    assert_eq!(size, (8 * 240, 330));
    let text = bench.run(&made).each("verify", summary::read).unwrap()[0].to_string();
    assert!(text.contains("I t7: refined") && !text.contains("±"), "{text}");
}

#[test]
fn artifacts_with_missing_data_are_named() {
    let bench = TestStore::new();
    let mut short = verified(["converged"; 4]);
    short.datasets.insert("area".into(), floats("1", &[0.5]));
    let made = [bench.made("verified", "verify", &short)];
    let error = bench.run(&made).each("verify", summary::read).unwrap_err().to_string();
    assert!(
        error.contains("verified") && error.contains("differ in length"),
        "{error}"
    );
    let mut lost = designed();
    lost.attributes.clear();
    let error = draw_figures(PRESENTERS, &bench.run(&[bench.made("d", "design", &lost)]), "p")
        .unwrap_err()
        .to_string();
    assert!(error.contains("attribute `scene` is missing"), "{error}");
}

#[test]
fn a_training_is_described_in_a_line_with_its_warnings() {
    let bench = TestStore::new();
    let made = [
        bench.made("solved", "solve", &solved(&[1.7])),
        bench.made("surrogate", "train", &trained()),
    ];
    let found = bench.run(&made).each("train", kinds::train::read).unwrap();
    let expected = kinds::train::TrainingSummary {
        line: "surrogate: qin2024, epoch 2 of 2 kept; RMSE of a component: train 0.0100 mm, test 0.0345 mm".to_owned(),
        warnings: vec![
            "surrogate: 3 samples are left out".to_owned(),
            "surrogate: the training diverged".to_owned(),
        ],
    };
    assert_eq!(found, [expected]);
}

/// An evaluation of a model and of an estimate without predictions, on two families and all, with a calibration.
fn evaluated(model: &StageArtifact) -> Object {
    let texts = |t: &[&str]| {
        Dataset::new(
            "",
            "d",
            &[t.len()],
            Data::Text(t.iter().map(|t| (*t).to_owned()).collect()),
        )
    };
    let table = |values: &[f64], shape: &[usize]| Dataset::new("mm", "d", shape, Data::F64(values.to_vec()));
    let counts = |values: &[u64], shape: &[usize]| Dataset::new("1", "d", shape, Data::U64(values.to_vec()));
    let digest = model.digest.to_string();
    let six = [0.0012, 0.0345, 0.02, 0.0, 0.0, 0.0];
    let mut datasets = vec![
        ("predictors", texts(&["qin2024", "linear"])),
        ("predictor_digests", texts(&[&digest, ""])),
        ("families", texts(&["blobs", "curves", "all"])),
        ("trained", counts(&[1, 0, 0, 0, 0, 0], &[2, 3])),
        ("score/samples", counts(&[1, 1, 2, 0, 0, 0], &[2, 3])),
        ("area/centre", floats("1", &[0.5])),
        ("area/samples", counts(&[2, 0], &[2, 1])),
        ("area/rmse", table(&[0.02, 0.0], &[2, 1])),
        ("area/max_error", table(&[0.1, 0.0], &[2, 1])),
        ("pattern/simulated_max", floats("mm", &[1.0, 2.0])),
        ("pattern/predicted_max", table(&[1.1, 1.9, 0.0, 0.0], &[2, 2])),
        (
            "pattern/predicted",
            Dataset::new("1", "d", &[2, 2], Data::U8(vec![1, 1, 0, 0])),
        ),
        ("coverage/calibrations", texts(&["0123456789abcdef"])),
        ("coverage/objectives", texts(&["centre, 0 deg", "elsewhere"])),
        ("coverage/field", table(&[1.0, 0.9, 0.95], &[1, 3])),
        ("coverage/radius", table(&[0.004, 0.1, 0.05], &[1, 3])),
        ("coverage/unlike", table(&[0.0, 1.0, 0.5], &[1, 3])),
        ("coverage/calibrated", counts(&[80, 0, 80], &[1, 3])),
        ("coverage/unflagged", counts(&[1, 0, 1], &[1, 3])),
        ("coverage/unflagged_field", table(&[1.0, 0.0, 1.0], &[1, 3])),
        (
            "coverage/objective",
            table(&[1.0, 0.9, 0.95, 0.8, 0.9, 0.85], &[2, 1, 3]),
        ),
        ("coverage/objective_half_width", table(&[0.01; 6], &[2, 1, 3])),
    ];
    let names = [
        "score/rmse",
        "score/r2",
        "score/max_displacement_r2",
        "score/max_error",
        "score/max_displacement_error",
        "score/quantile95",
    ];
    datasets.extend(names.map(|name| (name, table(&six, &[2, 3]))));
    object(datasets)
}

#[test]
fn an_evaluation_names_models_by_their_stages() {
    let bench = TestStore::new();
    let model = bench.made("surrogate", "train", &trained());
    let stage = bench.made("judged", "evaluate", &evaluated(&model));
    let made = [model.clone(), stage.clone()];
    let found = &bench.run(&made).each("evaluate", evaluation::read).unwrap()[0];
    assert_eq!(found.predictors[0].name, "surrogate");
    assert_eq!(found.calibrations[0].name, "calibration 01234567");
    assert_eq!(found.calibrations[0].objectives[1].covered, [0.8, 0.9, 0.85]);
    let text = found.to_string();
    for part in [
        "0.0012",
        "0.035",
        "none",
        "90.0 %",
        "0.0040",
        "judged: root mean square",
        "surrogate was trained on blobs; not on curves: its error on curves is 28.8 times that on its own families",
        "calibrated on blobs; not on curves",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(
        serde_json::to_value(found).unwrap()["predictors"][0]["by_area"][0]["area"],
        0.5
    );
    assert_eq!(draw_figures(PRESENTERS, &bench.run(&made), "p").unwrap().len(), 2);
    let alone = &bench.run(&made[1..]).each("evaluate", evaluation::read).unwrap()[0];
    assert_eq!(
        alone.predictors[0].name,
        format!("qin2024 {}", &model.digest.to_string()[..8])
    );

    let mut broken = evaluated(&model);
    let short = Dataset::new("1", "d", &[2, 1], Data::F64(vec![0.5; 2]));
    broken.datasets.insert("score/r2".into(), short);
    let made = [bench.made("judged", "evaluate", &broken)];
    let error = bench
        .run(&made)
        .each("evaluate", evaluation::read)
        .unwrap_err()
        .to_string();
    assert!(error.contains("differ in length"), "{error}");
}

#[test]
fn a_design_that_moves_the_other_way_than_the_optimum_has_no_share_of_it() {
    let bench = TestStore::new();
    let mut moved = verified(["converged"; 4]);
    let values = [-2.0, 2.5, 1.6, 1.95];
    moved
        .datasets
        .insert("component/simulated".into(), floats("mm", &values));
    let made = [bench.made("verified", "verify", &moved)];
    let summary = bench.run(&made).each("verify", summary::read).unwrap().remove(0);
    let row = serde_json::to_value(&summary.rows[0]).unwrap();
    assert_eq!(
        (&row["ratio_to_optimum"], &row["difference_to_optimum_mm"]),
        (&serde_json::Value::Null, &(-4.5).into())
    );
    let text = summary.to_string();
    let less = "4.50 mm less than the best pattern found by gradient search under the same constraints";
    assert!(text.contains(less) && !text.contains("−80"), "{text}");
}
