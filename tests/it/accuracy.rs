//! Accuracy and cost of methods: by a stage, which stores errors and measures times, and by the command.

use super::common::{Transcript, Workspace, snapshot};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
effects: {}
";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    let cell = |x: usize, y: usize| if (x / 5 * 7 + y / 5 * 11) % 13 < 6 { "1" } else { "0" };
    let row = |y| (0..50).map(|x| cell(x, y)).collect::<Vec<_>>().join(",") + "\n";
    let csv: String = (0..50).map(row).collect();
    workspace.write("blocks.csv", &csv);
    workspace
}

#[test]
fn the_command_measures_families_and_names_the_cheapest_setting() {
    let workspace = workspace();
    let ended = workspace.run(&[
        "accuracy",
        "scene.yaml",
        "-o",
        "out",
        "--count",
        "3",
        "--reference",
        "{ elements_per_cell: 2, order: 2 }",
        "--methods",
        "[{ method: linear, elements_per_cell: 1 }, { elements_per_cell: 1 }, { accuracy: 0.1 mm }]",
        "--target",
        "100 um",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json();
    let number = |method: usize, key: &str| found["methods"][method][key].as_f64().unwrap();
    // The linear response misses by some hundredths of a millimetre, the coarsest mesh by some thousandths but on
    // dithers.
    assert!(number(0, "rms_mm") > 2.0 * number(1, "rms_mm"), "{found}");
    for method in 0..3 {
        assert!(
            number(method, "rms_mm") <= number(method, "max_mm")
                && number(method, "max_mm") <= number(method, "bound_mm")
        );
        assert!(number(method, "seconds_per_pattern") > 0.0);
        let families = found["methods"][method]["families"].as_object().unwrap();
        assert_eq!(families.len(), 12);
        assert!(families.contains_key("dithers") && families.contains_key("mazes"));
    }
    assert_eq!(found["target"]["reached"], true);
    let flags = found["target"]["flags"].as_str().unwrap();
    assert!(flags.starts_with("--method newton --"), "{flags}");
    for file in [
        "accuracy.h5",
        "accuracy.csv",
        "accuracy.csv-metadata.json",
        "accuracy.png",
    ] {
        assert!(workspace.path("out").join(file).exists(), "{file}");
    }
    let rows = std::fs::read_to_string(workspace.path("out/accuracy.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 3 * 12);
    assert_eq!(found["measured_on"].as_array().unwrap().len(), 12);
}

#[test]
fn a_target_that_nothing_reaches_is_a_failure_that_names_the_best() {
    let workspace = workspace();
    let accuracy = |more: &[&str]| {
        let common = ["accuracy", "scene.yaml", "-o", "out", "--patterns", "blocks.csv"];
        workspace.run(&[&common[..], more].concat())
    };
    let reference = "{ elements_per_cell: 4 }";
    let ended = accuracy(&["--reference", reference, "--methods", "[linear]", "--target", "1e-6 mm"]);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(ended.stdout.contains("{ method: linear"), "{ended}");
    let mut printed = Transcript::default();
    for (reference, methods, named) in [
        (reference, "[linear, linear]", "linear"),
        (reference, "[]", "[]"),
        (reference, "[chrod:1]", "`chord:1`"),
        (reference, "[{ method: linear, accuracy: 1 mm }]", "accuracy"),
        ("{ method: linear }", "[linear]", "Newton"),
        (reference, "[{ elements_per_cell: 4 }]", "reference"),
    ] {
        let ended = accuracy(&["--reference", reference, "--methods", methods]);
        assert_eq!(ended.code, Some(2), "{methods}: {}", ended.stderr);
        assert!(ended.stderr.contains(named), "{methods}: {}", ended.stderr);
        // Two arguments that exclude each other have no single place.
        let has_place = named != "reference";
        assert!(!has_place || ended.stderr.contains('^'), "{methods}: {}", ended.stderr);
        printed.add(format!("{methods} against {reference}"), ended);
    }
    snapshot!(printed);
}

#[test]
fn times_are_measurements_and_not_content() {
    let workspace = Workspace::tiny();
    let digests = ["one", "two"].map(|store| {
        let run = ["run", "tiny.yaml", "--until", "accuracy", "--store", store];
        workspace.stages(&run).digests()["accuracy"].clone()
    });
    assert_eq!(digests[0], digests[1], "errors are the same, whatever the times");
    let shown = workspace.run(&["show", "accuracy", "--store", "one", "--json"]).json();
    let measured = shown["provenance"]["measurements"].as_str().unwrap();
    let seconds = |line: &str| line.rsplit_once(": ").unwrap().1.parse::<f64>().unwrap();
    assert_eq!(measured.lines().count(), 2);
    assert!(
        measured
            .lines()
            .all(|line| line.contains("; bezier: ") && seconds(line) > 0.0)
    );
    let solved = workspace.run(&["show", "reference", "--store", "one", "--json"]).json();
    assert_eq!(
        solved["attributes"]["solver"],
        "{ method: newton, elements_per_cell: 2, order: 1 }"
    );
    assert_eq!(solved["provenance"]["measurements"], serde_json::Value::Null);
}

#[test]
fn estimates_are_marked_in_the_file() {
    let workspace = workspace();
    let solve =
        |more: &[&str]| workspace.run(&[&["solve", "scene.yaml", "blocks.csv", "-o", "out.h5"][..], more].concat());
    let real = |path: &str| {
        let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
        file.dataset(path).unwrap().read_raw::<f64>().unwrap()
    };
    assert_eq!(solve(&[]).code, Some(0));
    let exact = real("displacement");
    let mut last = f64::INFINITY;
    for method in ["linear", "chord:1", "chord:3"] {
        let ended = solve(&["--method", method]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let pairs = real("displacement")
            .into_iter()
            .zip(&exact)
            .map(|(a, b)| (a - b).powi(2));
        let (error, residual) = ((pairs.sum::<f64>() / exact.len() as f64).sqrt(), real("residual")[0]);
        assert!(error < 0.3 * last && error > 1e-6, "{method}: {error}");
        assert!(residual > 1e-5 && residual < 0.5, "{method}: {residual}");
        last = error;
    }
    for refused in [["--accuracy", "0.01 mm"], ["--tolerance", "1e-6"]] {
        let ended = solve(&[&["--method", "linear"], &refused[..]].concat());
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(refused[0]), "{}", ended.stderr);
    }
    workspace.write("hot.yaml", &SCENE.replace("5.25 kV", "20 kV"));
    let ended = workspace.run(&["solve", "hot.yaml", "blocks.csv", "-o", "hot.h5", "--method", "linear"]);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    snapshot!(ended);
}

#[test]
fn a_surrogate_learns_from_estimates_and_a_design_is_verified_by_one() {
    let workspace = Workspace::tiny();
    let estimated = [
        "run",
        "tiny.yaml",
        "--until",
        "verified",
        "--set",
        "stages.solved.method=linear",
        "--set",
        "stages.verified.method=chord:1",
    ];
    let stages = workspace.stages(&estimated);
    assert!(stages.names().contains(&"verified"));
    let shown = |stage| workspace.run(&["show", stage, "--json"]).json()["datasets"].clone();
    let outcomes = |stage| {
        let datasets = shown(stage);
        let all = datasets.as_array().unwrap();
        let outcome = all.iter().find(|d| d["path"] == "outcome").unwrap();
        outcome["statistics"].to_string()
    };
    assert!(outcomes("solved").contains("estimated") && !outcomes("solved").contains("converged"));
    assert!(outcomes("verified").contains("estimated"));
    let text = workspace.run(&estimated[..]).stdout;
    assert!(text.contains("estimated"), "{text}");
}

#[test]
fn a_model_is_measured_beside_the_methods_and_refused_in_another_scene() {
    let workspace = Workspace::tiny();
    let measured = ["--set", "stages.accuracy.needs=[reference, surrogate]"];
    let run = [&["run", "tiny.yaml", "--until", "accuracy"][..], &measured].concat();
    workspace.stages(&run);
    let shown = workspace.run(&["show", "accuracy", "--json"]).json();
    let times = shown["provenance"]["measurements"].as_str().unwrap();
    assert!(
        times.contains("network: qin2024; bezier: ") && times.contains("network: qin2024; 1000 patterns: "),
        "{times}"
    );

    let exported = workspace.run(&["export", "model", "tiny.yaml:surrogate", "-o", "model.safetensors"]);
    assert_eq!(exported.code, Some(0), "{}", exported.stderr);
    let accuracy = |scene: &str, more: &[&str]| {
        let common = [
            "accuracy",
            scene,
            "-o",
            "out",
            "--count",
            "2",
            "--reference",
            "{ elements_per_cell: 2 }",
            "--json",
        ];
        workspace.run(&[&common[..], more].concat())
    };
    let listed = [
        "--methods",
        "[{ method: linear, elements_per_cell: 1 }, { model: model.safetensors }]",
    ];
    let ended = accuracy("tiny.yaml", &listed);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json();
    let network = &found["methods"][1];
    assert_eq!(network["settings"], "network: qin2024", "{found}");
    // One epoch of sixty patterns: the linear response is better.
    assert!(network["rms_mm"].as_f64() > found["methods"][0]["rms_mm"].as_f64());
    assert!(
        found["beaten_by"].as_object().unwrap().contains_key("qin2024"),
        "{found}"
    );
    assert!(network["batch"]["patterns"] == 1000 && network["batch"]["seconds"].as_f64().unwrap() > 0.0);
    let rows = std::fs::read_to_string(workspace.path("out/accuracy.csv")).unwrap();
    assert_eq!(
        rows.lines().filter(|row| row.starts_with("network: qin2024,")).count(),
        12,
        "{rows}"
    );

    workspace.write("low.yaml", &SCENE.replace("5.25 kV", "5 kV"));
    for arguments in [
        &listed[..],
        &[
            "--methods",
            "[{ method: linear, elements_per_cell: 1 }]",
            "--model",
            "tiny.yaml:surrogate",
        ],
    ] {
        let ended = accuracy("low.yaml", arguments);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        let why = ended.json()["error"]["message"].to_string();
        for part in ["drive.voltage", "5250 V", "5000 V"] {
            assert!(why.contains(part), "{why}");
        }
    }
    let ended = accuracy("tiny.yaml", &["--methods", "[{ model: absent.safetensors }]"]);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended.json()["error"]["message"]
            .to_string()
            .contains("absent.safetensors")
    );
}
