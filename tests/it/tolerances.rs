//! The yield of devices under tolerances, from the command line.

use serde_json::Value;

use super::common::{Ended, Workspace};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
";

const TOLERANCES: &str = "tolerances: { voltage: 1 %, shear_modulus: { relative: 5 %, distribution: lognormal }, \
                          thickness: 3 %, mask: 0.3 mm, misregistration: [0.2 mm, 0 mm], lost_cells: 1 % }\n";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &format!("{SCENE}{TOLERANCES}"));
    let half: String = (0..10).map(|_| "1,1,1,1,1,0,0,0,0,0\n").collect();
    workspace.write("half.csv", &half);
    workspace
}

fn yields(workspace: &Workspace, more: &[&str]) -> Ended {
    let first = [
        "yield",
        "scene.yaml",
        "half.csv",
        "--point",
        "25,25",
        "--direction",
        "0",
    ];
    workspace.run(&[&first[..], more].concat())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn a_yield_has_intervals_and_does_not_depend_on_threads() {
    let workspace = workspace();
    let options = ["--json", "--wanted", "2 mm", "--samples", "200", "-o", "devices.csv"];
    let ended = yields(&workspace, &[&options[..], &["-j", "1"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json()["patterns"][0].clone();
    let table = std::fs::read_to_string(workspace.path("devices.csv")).unwrap();
    let again = yields(&workspace, &[&options[..], &["-j", "2"]].concat());
    assert_eq!(again.json()["patterns"][0], found);
    assert_eq!(std::fs::read_to_string(workspace.path("devices.csv")).unwrap(), table);
    assert_eq!(table.lines().count(), 201);
    let header = "pattern,device,voltage_deviation,shear_modulus_deviation,thickness_deviation,mask_deviation,\
                  misregistration_x_deviation,outcome,displacement_mm";
    assert_eq!(table.lines().next(), Some(header));
    let about = std::fs::read_to_string(workspace.path("devices.csv-metadata.json")).unwrap();
    let about: Value = serde_json::from_str(&about).unwrap();
    let columns = about["tableSchema"]["columns"].as_array().unwrap();
    let units: Vec<&Value> = columns.iter().map(|column| &column["schema:unitText"]).collect();
    assert_eq!(
        (units[2], units[8], units[7]),
        (&"standard deviations".into(), &"mm".into(), &Value::Null)
    );
    let told = yields(&workspace, &options[1..]).stdout;
    let sentence = "half.csv: the mean of the rows in the file is ";
    let plain = told.split_once(sentence).unwrap_or_else(|| panic!("{told}")).1;
    let mm: Vec<f64> = table
        .lines()
        .skip(1)
        .map(|line| line.rsplit(',').next().unwrap().parse().unwrap())
        .collect();
    let mean = mm.iter().sum::<f64>() / 200.0;
    let plain: f64 = plain.split(' ').next().unwrap().parse().unwrap();
    assert!((plain - mean).abs() < 1e-4, "{plain} {mean}");
    // With control variates: near the mean of the devices, in an interval much narrower than that of independent ones.
    let [from, to] = [0, 1].map(|end| number(&found["mean_mm"]["interval"][end]));
    let spread = (mm.iter().map(|mm| (mm - mean) * (mm - mean)).sum::<f64>() / 199.0).sqrt();
    let independent = 2.0 * 1.96 * spread / 200.0_f64.sqrt();
    assert!(to - from < 0.4 * independent, "{from} {to} {independent}");
    assert!((number(&found["mean_mm"]["value"]) - mean).abs() < 0.1 * independent);
    let reached = mm.iter().filter(|mm| **mm >= 2.0).count() as f64 / 200.0;
    assert_eq!(number(&found["yield"]["value"]), reached);
    let [low, high] = [0, 1].map(|end| number(&found["yield"]["interval"][end]));
    assert!(
        low < reached && reached < high && high - low < 0.15,
        "{low} {reached} {high}"
    );
    assert!(number(&found["shares"]["thickness"]) > number(&found["shares"]["voltage"]));
    // Another seed is another sample of the same distribution.
    let other = yields(&workspace, &[&options[..], &["--seed", "1"]].concat()).json()["patterns"][0].clone();
    let difference = number(&other["mean_mm"]["value"]) - mean;
    assert!(difference != 0.0 && difference.abs() < 0.02, "{difference}");
    let narrow = yields(
        &workspace,
        &["--json", "--wanted", "2 mm", "--samples", "100", "--within", "0.05"],
    )
    .json();
    let narrow = &narrow["patterns"][0];
    assert!(number(&narrow["samples"]) >= 200.0, "{narrow}");
    let value = number(&narrow["yield"]["value"]);
    assert!(
        [0, 1]
            .into_iter()
            .all(|end| (number(&narrow["yield"]["interval"][end]) - value).abs() <= 0.05)
    );
}

#[test]
fn a_share_of_the_displacement_as_drawn_is_wanted() {
    let workspace = workspace();
    let options = ["--samples", "40", "--json", "--wanted"];
    let of = |wanted: &str| {
        let ended = yields(&workspace, &[&options[..], &[wanted]].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        ended.json()
    };
    let share = of("90 %");
    let (drawn, wanted) = (&share["patterns"][0]["as_drawn_mm"], &share["patterns"][0]["wanted_mm"]);
    assert!(
        (number(wanted) - 0.9 * number(drawn)).abs() < 1e-12,
        "{wanted} of {drawn}"
    );
    assert_eq!(
        (&share["wanted_share"], &share["wanted_mm"]),
        (&Value::from(0.9), &Value::Null)
    );
    let length = of(&format!("{wanted} mm"));
    assert_eq!(length["patterns"][0]["yield"], share["patterns"][0]["yield"]);
    let told = yields(&workspace, &["--samples", "40", "--wanted", "90 %"]).stdout;
    let line = format!("wanted 90 % of {:.3} mm = {:.3} mm", number(drawn), number(wanted));
    assert!(told.contains(&line) && told.contains("reach 90 %"), "{told}");
    // Against the direction of the motion.
    let against = ["--wanted", "90 %", "--direction", "180"];
    let first = ["yield", "scene.yaml", "half.csv", "--point", "25,25"];
    let refused = workspace.run(&[&first[..], &against].concat());
    assert_eq!(refused.code, Some(2), "{refused}");
    assert!(refused.stderr.contains("--direction"), "{refused}");
}

#[test]
fn what_a_yield_needs_is_said() {
    let workspace = workspace();
    workspace.write("bare.yaml", SCENE);
    let point: [&str; 2] = ["--point", "25,25"];
    let with = |first: &[&'static str], more: &[&'static str]| [&["yield"], first, &["half.csv"], more].concat();
    let cases: [(Vec<&str>, &str); 9] = [
        (with(&["bare.yaml"], &point), "no device differs from another"),
        (with(&["scene.yaml"], &[]), "--point"),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--samples", "1"]),
            "2 to 65536",
        ),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--wanted", "120 %"]),
            "from 0 % to 100 %",
        ),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--within", "0.1"]),
            "--wanted",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "tolerances.voltage=20 %"],
            ),
            "0 % to 15 %",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "tolerances.voltage={ relative: 20 % }"],
            ),
            "lognormal",
        ),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--set", "tolerances.width=1 mm"]),
            "width",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "loads={ pressure: 10 Pa }"],
            ),
            "pressure",
        ),
    ];
    for (arguments, why) in cases {
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(why), "{arguments:?}: {}", ended.stderr);
    }
}

/// Tolerances are no part of what a stage depends on.
#[test]
fn tolerances_rebuild_nothing() {
    let workspace = workspace();
    let pipeline = |tolerances: &str| {
        format!(
            "version: 1\nname: made\nscene: {{ {}{tolerances} }}\nstages:\n  small: {{ kind: sample, family: \
             small-grid, count: 2, seed: 1 }}\n  solved: {{ kind: solve, needs: [small] }}\n",
            SCENE.trim_end().replace('\n', ", ")
        )
    };
    workspace.write("made.yaml", &pipeline(""));
    assert_eq!(workspace.run(&["run", "made.yaml"]).code, Some(0));
    workspace.write("made.yaml", &pipeline(", tolerances: { mask: 0.1 mm }"));
    let plan = workspace.run(&["plan", "made.yaml", "--json"]).json();
    for stage in plan["stages"].as_array().unwrap() {
        assert_ne!(stage["outcome"], "stale", "{stage}");
    }
}

const PIPELINE: &str = "version: 1
name: made
scene: scene.yaml
stages:
  own: { kind: patterns, files: [half.csv] }
  made: { kind: yield, needs: [own], point: [25 mm, 25 mm], direction: 0 deg, samples: 600, wanted: 2 mm, seed: 1 }
";

fn run(workspace: &Workspace, more: &[&str]) -> Value {
    let ended = workspace.run(&[&["run", "made.yaml", "--json"], more].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended.json()
}

/// The stage `made` of a run.
fn made(run: &Value) -> &Value {
    let stages = run["stages"].as_array().unwrap();
    stages.iter().find(|stage| stage["name"] == "made").unwrap()
}

#[test]
fn a_stage_has_the_numbers_of_the_command_and_simulates_only_new_devices() {
    let workspace = workspace();
    workspace.write("made.yaml", PIPELINE);
    let first = run(&workspace, &["-j", "1"]);
    let found = &first["yields"][0]["designs"][0];
    let command = yields(
        &workspace,
        &["--json", "--wanted", "2 mm", "--samples", "600", "--seed", "1"],
    )
    .json();
    let command = &command["patterns"][0];
    for key in ["as_drawn_mm", "mean_mm", "standard_deviation_mm", "yield", "failures"] {
        assert_eq!(found[key], command[key], "{key}");
    }
    let again = Workspace::new();
    for file in ["scene.yaml", "half.csv", "made.yaml"] {
        again.write(file, &std::fs::read_to_string(workspace.path(file)).unwrap());
    }
    assert_eq!(made(&run(&again, &["-j", "2"]))["digest"], made(&first)["digest"]);
    // Another wanted displacement simulates nothing, more samples only the new ones: 500 devices are one piece.
    let pieces = |run: &Value| made(run)["chunks_built"].as_u64().unwrap();
    assert_eq!(pieces(&first), 2, "{}", made(&first));
    let lower = run(&workspace, &["--set", "stages.made.wanted=1.9 mm"]);
    assert_eq!(pieces(&lower), 0, "{}", made(&lower));
    assert!(number(&lower["yields"][0]["designs"][0]["yield"]["value"]) > number(&found["yield"]["value"]));
    // A share of the displacement as drawn.
    let share = run(&workspace, &["--set", "stages.made.wanted=90 %"]);
    assert_eq!(pieces(&share), 0, "{}", made(&share));
    let of_command = ["--json", "--wanted", "90 %", "--samples", "600", "--seed", "1"];
    let of_command = yields(&workspace, &of_command).json()["patterns"][0].clone();
    assert_eq!(share["yields"][0]["designs"][0]["yield"], of_command["yield"]);
    assert_eq!(share["yields"][0]["wanted_share"], 0.9);
    let told = workspace.run(&["run", "made.yaml", "--set", "stages.made.wanted=90 %"]);
    assert!(told.stdout.contains("of the devices reach 90 % of "), "{told}");
    let changed = workspace.run(&[
        "explain",
        "made.yaml",
        "made",
        "--set",
        "stages.made.wanted=85 %",
        "--set",
        "stages.made.tolerances={ thickness: 2.5 % }",
    ]);
    let share = changed.stdout.contains("parameter changed: wanted from 90 % to 85 %");
    assert!(share && changed.stdout.contains(" to 2.5 %"), "{changed}");
    let refused = workspace.run(&["plan", "made.yaml", "--set", "stages.made.wanted=110 %"]);
    assert!(refused.stderr.contains("from 0 % to 100 %"), "{refused}");
    let more = run(&workspace, &["--set", "stages.made.samples=1200"]);
    assert_eq!(pieces(&more), 2, "the second half and a third piece: {}", made(&more));
    // The tolerances of the stage replace those of the scene.
    let masks = run(&workspace, &["--set", "stages.made.tolerances={ mask: 0.3 mm }"]);
    assert_eq!(pieces(&masks), 2);
    let shares = masks["yields"][0]["designs"][0]["shares"].as_object().unwrap();
    assert_eq!(shares.keys().collect::<Vec<_>>(), ["mask"]);
    let report = workspace.run(&["report", "made.yaml", "-o", "out"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    assert!(page.contains("Devices as they are made") && page.contains("Devices that reach a displacement"));
}

#[test]
fn designs_are_made_and_what_a_stage_cannot_simulate_is_refused() {
    let workspace = Workspace::new();
    let scene = format!(
        "{}properties: {{ density: 960 kg/m3 }}\n{TOLERANCES}",
        SCENE.replace("cells: 10", "cells: 20")
    );
    workspace.write("scene.yaml", &scene);
    workspace.write(
        "made.yaml",
        "version: 1
name: made
scene: scene.yaml
stages:
  best: { kind: design, method: adjoint, units: 20, starts: 1, seed: 1,
    objective: { point: [25 mm, 25 mm], direction: 0 deg } }
  made: { kind: yield, needs: [best], samples: 40, wanted: 2 mm, seed: 1 }
  checked: { kind: verify, needs: [best], elements_per_cell: 1 }
",
    );
    let found = run(&workspace, &[]);
    let designs = found["yields"][0]["designs"].as_array().unwrap();
    let titles: Vec<&str> = designs.iter().filter_map(|one| one["title"].as_str()).collect();
    assert_eq!(titles[0], "design: gradient search");
    assert!(titles.iter().any(|title| title.contains("intuitive")), "{titles:?}");
    let verified = found["results"][0]["rows"].as_array().unwrap();
    assert_eq!(designs.len(), verified.len());
    for (made, verified) in designs.iter().zip(verified) {
        let [made, verified] = [&made["as_drawn_mm"], &verified["simulated_mm"]].map(number);
        assert!((made - verified).abs() < 1e-9, "{made} {verified}");
    }
    // The scene of a stage is exported with what the stage does not read, as long as the file has it.
    let exported = |stage: &str| {
        let ended = workspace.run(&["export", "scene", stage, "-o", "exported.yaml"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        (
            std::fs::read_to_string(workspace.path("exported.yaml")).unwrap(),
            ended.stderr,
        )
    };
    for stage in ["best", "made", "made.yaml:checked"] {
        let (text, said) = exported(stage);
        assert!(
            text.contains("density: 960") && text.contains("lost_cells"),
            "{stage}: {text}"
        );
        assert!(!said.contains("warning"), "{stage}: {said}");
    }
    workspace.write("scene.yaml", &scene.replace("5.25 kV", "5 kV"));
    let (text, said) = exported("best");
    assert!(text.contains("5250 V") && !text.contains("density"), "{text}");
    assert!(said.contains("perhaps without `properties`"), "{said}");
    workspace.write("scene.yaml", &scene);
    let refused = |set: &str, why: &str| {
        let ended = workspace.run(&["plan", "made.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}: {}", ended.stdout);
        assert!(ended.stderr.contains(why), "{set}: {}", ended.stderr);
    };
    refused("stages.made.needs=[own]", "own");
    refused("scene.tolerances={ voltage: 0 % }", "no device differs from another");
    refused(
        "scene.effects={ fringe_field: {} }",
        "`mask` of `tolerances` is not simulated with",
    );
    refused(
        "stages.made.objective={ point: [60 mm, 25 mm], direction: 0 deg }",
        "60",
    );
    refused("stages.made.samples=1", "65536");
    // Fields beyond breakdown are failures if they are simulated.
    let set = "scene.effects={ dielectric_breakdown: { law: constant, field: 40 MV/m } }";
    let ended = workspace.run(&["run", "made.yaml", "--json", "--set", set, "--until", "made"]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let document = ended.json();
    let design = &document["yields"][0]["designs"][0];
    assert_eq!(design["failures"]["breakdown"], 40, "{design}");
    assert!(
        design["mean_mm"].is_null() && design["as_drawn_mm"].is_null(),
        "{design}"
    );
    workspace.write("half.csv", "1,0\n");
    refused("stages.own={ kind: patterns, files: [half.csv] }", "half.csv");
}

#[test]
fn changed_tolerances_are_named_where_the_file_has_them() {
    let workspace = Workspace::new();
    let stress = |stretch: f64| 45.0 * (stretch - stretch.powi(-2));
    let pulls = (1..12).map(|at| 1.0 + f64::from(at) / 6.0);
    let pulls: String = pulls.map(|pull| format!("{pull:.4},{:.4}\n", stress(pull))).collect();
    workspace.write("pull.csv", &format!("stretch,nominal_stress (kPa)\n{pulls}"));
    let pipeline = |thickness: &str| {
        format!(
            "version: 1
name: made
scene: {{ {}, tolerances: {{ thickness: {thickness}, mask: 0.15 mm }} }}
stages:
  pulled: {{ kind: measure, files: [{{ file: pull.csv, test: uniaxial, sigma: 3 % }}] }}
  fitted: {{ kind: fit, needs: [pulled], laws: [neo-hookean], branches: 0 }}
  best: {{ kind: design, method: adjoint, starts: 1, seed: 1,
    objective: {{ point: [25 mm, 25 mm], direction: 0 deg, robust: {{ mean_minus: 1 }} }} }}
  made: {{ kind: yield, needs: [best], samples: 20, seed: 1 }}
  masks: {{ kind: yield, needs: [best], samples: 20, seed: 1, tolerances: {{ mask: 0.3 mm }} }}
  own: {{ kind: yield, needs: [best], samples: 20, seed: 1, scene: {{ from: fitted }} }}
",
            SCENE.trim().replace('\n', ", ").replace("5.25 kV", "4 kV")
        )
    };
    workspace.write("made.yaml", &pipeline("3 %"));
    run(&workspace, &["--lock"]);
    let why = |sets: &[&str], stage: &str| {
        let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
        let plan = workspace.run(&[&["plan", "made.yaml", "--json"], &sets[..]].concat());
        let plan = plan.json();
        let stages = plan["stages"].as_array().unwrap();
        let found = stages.iter().find(|one| one["name"] == stage).unwrap().clone();
        found["why"].clone()
    };
    let thicker = "scene.tolerances.thickness=4 %";
    let changed = "parameter changed: scene.tolerances.thickness from 3 % to 4 %";
    assert_eq!(why(&[thicker], "made"), changed);
    assert_eq!(why(&[thicker], "fitted"), changed);
    assert_eq!(why(&[thicker], "masks"), Value::Null);
    let own = ["stages.masks.tolerances.mask=0.2 mm"];
    assert_eq!(
        why(&own, "masks"),
        "parameter changed: tolerances.mask from 0.3 mm to 0.2 mm"
    );
    let lognormal = ["scene.tolerances.thickness={ relative: 4 %, distribution: lognormal }"];
    let changed = "parameter changed: scene.tolerances.thickness from 3 % to {distribution: lognormal, relative: 4 %}";
    assert_eq!(why(&lognormal, "made"), changed);
    let changed = "parameter changed: scene.tolerances.mask from 0.15 mm to 0.2 mm";
    assert_eq!(why(&["scene.tolerances.mask=0.2 mm"], "best"), changed);

    // The scene of a stage is that of the lock file, so that what differs is named before any work.
    let locked = workspace.run(&["run", "made.yaml", "--locked", "--set", "stages.own.samples=30"]);
    assert_eq!(locked.code, Some(6), "{locked}");
    let named = "stage `own` differs from the lock file: parameter changed: samples from 20 to 30";
    assert!(locked.stderr.contains(named), "{locked}");

    run(&workspace, &["--set", thicker]);
    let log = || {
        let ended = workspace.run(&["log", "made.yaml"]);
        assert_eq!(ended.code, Some(0), "{ended}");
        ended.stdout
    };
    assert!(!log().contains("changed in the files"), "{}", log());
    let diff = workspace.run(&["diff", "@2", "@1", "--json"]).json();
    let names: Vec<&str> = diff["parameters"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|one| one["path"].as_str())
        .collect();
    assert_eq!(names, ["scene.tolerances.thickness.relative"]);
    run(&workspace, &[]);
    workspace.write("made.yaml", &pipeline("2 %"));
    run(&workspace, &[]);
    let changed = "changed in the files: scene.tolerances.thickness from 3 % to 2 %";
    assert!(log().contains(changed), "{}", log());
    // The mask of a robust objective is that of the scene.
    run(&workspace, &["--set", "scene.tolerances.mask=0.2 mm"]);
    assert_eq!(log().matches("changed in the files").count(), 1, "{}", log());
    // What is added to the scene is named once, and what a stage has in place of the scene is its own.
    run(&workspace, &[]);
    let before = pipeline("2 %");
    let changes = |text: &str| {
        workspace.write("made.yaml", text);
        run(&workspace, &[]);
        let listed = workspace.run(&["log", "made.yaml", "-n", "1"]).stdout;
        let words: Vec<&str> = listed.split_whitespace().collect();
        let listed = words.join(" ");
        let at = listed.find("changed in the files: ").unwrap_or(listed.len());
        listed[at..].split(" results").next().unwrap_or_default().to_owned()
    };
    let more = before.replace("mask: 0.15 mm }", "mask: 0.15 mm, misregistration: 0.1 mm }");
    let added = changes(&more);
    assert!(
        added.contains("scene.tolerances.misregistration added (") && !added.contains("robust"),
        "{added}"
    );
    assert_eq!(
        changes(&before),
        "changed in the files: scene.tolerances.misregistration removed"
    );
    let own = before.replace("mean_minus: 1 }", "mean_minus: 1, mask: 0.2 mm }");
    assert_eq!(
        changes(&own),
        "changed in the files: stages.best.objective.robust.mask from 0.15 mm to 0.2 mm"
    );
}

#[test]
fn the_displacement_as_drawn_has_the_error_of_the_mesh() {
    let workspace = workspace();
    let document = |more: &[&str]| {
        let ended = yields(&workspace, &[&["--json", "--samples", "100"], more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        (ended.json()["patterns"][0].clone(), ended.stderr)
    };
    let thin = ["--set", "tolerances={ voltage: 0.1 % }", "--wanted", "2 mm"];
    let (coarse, warned) = document(&thin);
    let (fine, silent) = document(&["--order", "2", "--elements-per-cell", "2"]);
    let [coarse_mm, fine_mm] = [&coarse, &fine].map(|found| number(&found["as_drawn_mm"]));
    let stated = number(&coarse["as_drawn_error_mm"]);
    assert!(
        (coarse_mm - fine_mm).abs() < 1.5 * stated,
        "{coarse_mm} {fine_mm} {stated}"
    );
    assert!(number(&fine["as_drawn_error_mm"]) < 0.3 * stated);
    // Tolerances of 0.1 % of the voltage change the displacement by less than a coarse mesh.
    assert!(
        warned.contains("another mesh changes the displacement as drawn by") && warned.contains("use --order 2"),
        "{warned}"
    );
    assert!(!silent.contains("another mesh"), "{silent}");
    let told = yields(&workspace, &["--samples", "100"]).stdout;
    assert!(told.contains(" ± "), "{told}");
}

#[test]
fn drawings_of_devices_are_placed_and_followed_as_by_solve() {
    let workspace = workspace();
    workspace.write(
        "disc.svg",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20mm\" height=\"20mm\" viewBox=\"0 0 20 20\"><circle \
         cx=\"10\" cy=\"10\" r=\"10\"/></svg>",
    );
    let own = [
        "--set",
        "tolerances={ voltage: 1 % }",
        "--samples",
        "20",
        "--point",
        "40,25",
        "--json",
    ];
    let placed = ["--origin", "15 mm, 15 mm", "--edges", "fitted", "--order", "2"];
    let ended = workspace.run(&[&["yield", "scene.yaml", "disc.svg"], &own[..], &placed].concat());
    assert_eq!(ended.code, Some(0), "{ended}");
    let found = number(&ended.json()["patterns"][0]["as_drawn_mm"]);
    let solved = workspace.run(
        &[
            &[
                "solve",
                "scene.yaml",
                "disc.svg",
                "--json",
                "--point",
                "40,25",
                "--elements-per-cell",
                "1",
            ],
            &placed[..],
        ]
        .concat(),
    );
    assert_eq!(solved.code, Some(0), "{solved}");
    let solved = number(&solved.json()["patterns"][0]["along_mm"]);
    assert!((found / solved - 1.0).abs() < 1e-4, "{found} {solved}");
}
