//! What a file already says is refused by `plan`, with line and column; a search keeps to the leads of the scene.

use super::common::Workspace;

const SCENE: &str = "geometry: { side: 40 mm, thickness: 0.5 mm, prestretch: 3, cells: 20 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 2 kV }
properties: { dielectric_breakdown: { law: constant, field: 60 MV/m } }
effects: {}
";

const DESIGN: &str = "best: { kind: design, method: adjoint, units: 20, starts: 1, seed: 1, area: 0.4, \
                      objective: { point: [20 mm, 20 mm], direction: 0 deg }";

fn workspace(scene: &str, stages: &[&str]) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", scene);
    let stages: Vec<String> = stages.iter().map(|stage| format!("  {stage}\n")).collect();
    workspace.write(
        "p.yaml",
        &format!("version: 1\nname: p\nscene: scene.yaml\nstages:\n{}", stages.concat()),
    );
    workspace
}

/// Checks that `plan` refuses a pipeline at a line with a message.
fn refuses(scene: &str, stages: &[&str], line: usize, message: &str) {
    let refused = workspace(scene, stages).refused(&["plan", "p.yaml"]);
    assert!(refused.contains(message), "{message}\n{refused}");
    assert!(refused.contains(&format!("p.yaml:{line}:")), "{message}\n{refused}");
}

#[test]
fn a_scene_that_a_sweep_completes_is_refused_with_its_axis() {
    let workspace = workspace(SCENE, &["one: { kind: sample, family: small-grid, count: 2, seed: 1 }"]);
    let material = SCENE.lines().nth(1).unwrap();
    let scene = SCENE.replace(material, "material: { from: \"${m}.yaml\" }");
    assert_ne!(scene, SCENE);
    workspace.write("swept-scene.yaml", &scene);
    workspace.write(
        "swept.yaml",
        "version: 1\nname: p\nscene: swept-scene.yaml\nstages:\n  one: { kind: sample, family: small-grid, \
         foreach: { m: [a, b] }, count: 2, seed: 1 }\n",
    );
    workspace.write("mine.csv", &"1,0\n".repeat(2));
    let refused = workspace.refused(&["solve", "swept.yaml", "mine.csv"]);
    assert!(refused.contains("the sweep of the pipeline sets `${m}`"), "{refused}");
    // A scene is no pattern.
    let refused = workspace.refused(&["check", "scene.yaml", "mine.csv"]);
    assert!(refused.contains("--scene scene.yaml"), "{refused}");
}

const SAMPLES: &str = "samples: { kind: sample, family: small-grid, count: 20, seed: 1 }";
const SOLVED: &str = "solved: { kind: solve, needs: [samples], elements_per_cell: 2 }";
const MODEL: &str = "model: { kind: train, needs: [solved], network: qin2024, epochs: 1, seed: 1 }";

#[test]
fn needs_that_cannot_do_are_refused_by_plan() {
    let with = |stage: &'static str| [SAMPLES, SOLVED, MODEL, stage];
    for (stage, message) in [
        (
            "seen: { kind: calibrate, needs: [model, solved], seed: 1 }",
            "the model `model` was trained on the samples `solved`",
        ),
        (
            "seen: { kind: evaluate, needs: [solved, model] }",
            "the model `model` was trained on the samples `solved`",
        ),
        (
            "few: { kind: calibrate, needs: [solved, samples2], seed: 1 }",
            "no stage is named `samples2`",
        ),
        (
            "judged: { kind: accuracy, needs: [solved], methods: [{ elements_per_cell: 2 }] }",
            "cannot measure the error of { method: newton, elements_per_cell: 2",
        ),
        (
            "judged: { kind: accuracy, needs: [model] }",
            "needs exactly one solve stage as its reference; `needs` names 0",
        ),
        ("judged: { kind: evaluate, needs: [solved] }", "nothing to evaluate"),
        ("judged: { kind: evaluate, needs: [model] }", "no data to evaluate on"),
        (
            "more: { kind: train, needs: [model], network: qin2024, epochs: 1, seed: 1 }",
            "the training has no labels",
        ),
        (
            "more: { kind: train, needs: [solved, model], network: physics, epochs: 1, seed: 1 }",
            "the training of a network `physics` cannot start from `model`, a network `qin2024`",
        ),
    ] {
        refuses(SCENE, &with(stage), 8, message);
    }
    let surrogate = DESIGN.replace(
        "method: adjoint, units: 20, starts: 1",
        "evaluator: surrogate, needs: []",
    ) + " }";
    refuses(SCENE, &[&surrogate], 5, "`evaluator: surrogate` needs a network");
}

const OTHERS: &str = "others: { kind: sample, family: small-grid, count: 20, seed: 2 }";
const FRESH: &str = "fresh: { kind: solve, needs: [others], elements_per_cell: 2 }";

#[test]
fn calibrations_that_cannot_do_are_refused_by_plan() {
    let few = "few: { kind: calibrate, needs: [model, fresh], seed: 1 }";
    refuses(
        SCENE,
        &[SAMPLES, SOLVED, MODEL, OTHERS, FRESH, few],
        10,
        "a calibration needs 80 patterns that were not used in training, found 20",
    );
    let fresh = OTHERS.replace("20", "80");
    let other = MODEL.replace("model:", "other:").replace("seed: 1", "seed: 2");
    let calibrated = "calibrated: { kind: calibrate, needs: [other, fresh], seed: 1 }";
    let again = "again: { kind: calibrate, needs: [other, fresh], seed: 2 }";
    let search = DESIGN.replace("method: adjoint, units: 20, starts: 1", "needs: [NEEDS]") + " }";
    for (stage, message) in [
        (
            "judged: { kind: evaluate, needs: [model, fresh, calibrated] }",
            "the calibration `calibrated` is of the model `other`, which `needs` does not name",
        ),
        (
            &search.replace("NEEDS", "model, calibrated"),
            "the calibration `calibrated` is of the model `other`, which `needs` does not name",
        ),
        (
            &search.replace("NEEDS", "other, calibrated, again"),
            "a design stage can use only one calibration",
        ),
    ] {
        let stages = [SAMPLES, SOLVED, MODEL, &other, &fresh, FRESH, calibrated, again, stage];
        refuses(SCENE, &stages, 13, message);
    }
}

#[test]
fn patterns_that_a_calibration_cannot_use_are_refused_by_plan() {
    let balanced = |target: u64| {
        format!(
            "balanced: {{ kind: balance, needs: [solved], bins: 5, range: [0 mm, 2 mm], target: {target}, seed: 1 }}"
        )
    };
    let calibrated = "calibrated: { kind: calibrate, needs: [model, balanced], seed: 1 }";
    let model = MODEL.replace("[solved]", "[balanced]");
    let more = SAMPLES.replace("20", "100");
    // A tenth of the rows are test rows; 100 samples have at most 800 images.
    refuses(
        SCENE,
        &[&more, SOLVED, &balanced(79), &model, calibrated],
        9,
        "a calibration needs 80 patterns that were not used in training, and `needs` has at most 79",
    );
    let warned = "`needs` probably has only ";
    for (target, warning) in [(400, true), (800, false)] {
        let stages = [&more, SOLVED, &balanced(target), &model, calibrated];
        let planned = workspace(SCENE, &stages).run(&["plan", "p.yaml"]);
        assert_eq!(planned.code, Some(0), "{}", planned.stderr);
        assert_eq!(planned.stderr.contains(warned), warning, "{target}: {}", planned.stderr);
    }
    let others = |family: &str| OTHERS.replace("small-grid", family).replace("20", "80");
    let calibrated = "calibrated: { kind: calibrate, needs: [model, fresh], seed: 1 }";
    refuses(
        SCENE,
        &[SAMPLES, SOLVED, MODEL, &others("stripes"), FRESH, calibrated],
        10,
        "a calibration needs 80 patterns of the training families, and `needs` has at most 0; these are: small-grid",
    );
    let same = [SAMPLES, SOLVED, MODEL, &others("small-grid"), FRESH, calibrated];
    let planned = workspace(SCENE, &same).run(&["plan", "p.yaml"]);
    assert_eq!(planned.code, Some(0), "{}", planned.stderr);
}

#[test]
fn networks_that_are_too_large_for_a_scene_are_refused_by_plan() {
    let balanced = "balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2 mm], target: 40, seed: 1 }";
    for (cells, network, message) in [
        (
            "150",
            "physics",
            "the linear response of this scene has 253125000 values, but at most 67108864 are allowed",
        ),
        (
            "300",
            "qin2024",
            "network qin2024 for 300 × 300 cells has matrices of 266897408 entries",
        ),
    ] {
        let scene = SCENE.replace("cells: 20", &format!("cells: {cells}"));
        let model = MODEL.replace("qin2024", network);
        refuses(&scene, &[SAMPLES, SOLVED, &model], 7, message);
        // Also behind another stage.
        let model = model.replace("[solved]", "[balanced]");
        refuses(&scene, &[SAMPLES, SOLVED, balanced, &model], 8, message);
    }
}

#[test]
fn a_range_that_no_displacement_reaches_is_refused_by_plan() {
    let balanced = |low: &str| {
        format!("balanced: {{ kind: balance, needs: [solved], bins: 5, range: [{low}, 1 m], target: 40, seed: 1 }}")
    };
    refuses(
        SCENE,
        &[SAMPLES, SOLVED, &balanced("57 mm")],
        7,
        "`range` starts at 57 mm, and no point of a membrane of 40 × 40 mm can move by more than 56.5685 mm",
    );
    let planned = workspace(SCENE, &[SAMPLES, SOLVED, &balanced("56 mm")]).run(&["plan", "p.yaml"]);
    assert_eq!(planned.code, Some(0), "{}", planned.stderr);
}

#[test]
fn areas_and_distances_that_no_design_has_are_refused_by_plan() {
    let several = |distance: &str| format!("{DESIGN}, designs: 8, distance: {distance} }}");
    refuses(
        SCENE,
        &[&several("0.82")],
        5,
        "`distance: 0.82` is not possible: two patterns of area 0.4 within 0.005 differ in at most 0.8100 of the cells",
    );
    let dense = several("0.5").replace("area: 0.4", "area: 0.8");
    refuses(SCENE, &[&dense], 5, "differ in at most 0.4100 of the cells");
    for possible in [several("0.81"), several("0.82").replace("designs: 8", "designs: 1")] {
        let planned = workspace(SCENE, &[&possible]).run(&["plan", "p.yaml"]);
        assert_eq!(planned.code, Some(0), "{}", planned.stderr);
    }
}

#[test]
fn a_reference_that_may_be_coarser_than_an_accuracy_is_named_by_plan() {
    let reference = |mesh: &str| SOLVED.replace("elements_per_cell: 2", mesh);
    let judged = |accuracy: &str| {
        format!("judged: {{ kind: accuracy, needs: [solved], methods: [{{ accuracy: {accuracy} }}] }}")
    };
    for accuracy in ["0.01 mm", "0.003 mm"] {
        refuses(
            SCENE,
            &[SAMPLES, &reference("accuracy: 0.01 mm"), &judged(accuracy)],
            7,
            "it is not coarser than the reference",
        );
    }
    let warning = "accuracy: 0.03 mm } may need a finer mesh than the reference";
    for (mesh, warned) in [
        ("accuracy: 0.01 mm", false),
        ("elements_per_cell: 8, order: 2", false),
        ("elements_per_cell: 2", true),
        ("elements_per_cell: 4, order: 2", true),
    ] {
        let planned = workspace(SCENE, &[SAMPLES, &reference(mesh), &judged("0.03 mm")]).run(&["plan", "p.yaml"]);
        assert_eq!(planned.code, Some(0), "{}", planned.stderr);
        assert_eq!(planned.stderr.contains(warning), warned, "{mesh}: {}", planned.stderr);
    }
}

#[test]
fn a_pull_in_margin_that_no_pattern_can_reach_is_refused_by_plan() {
    let with = |margin: f64| format!("{DESIGN}, constraints: {{ pull_in_margin: {margin} }} }}");
    // A fully active membrane is stable up to √(λ⁻² + 3λ⁻⁸) = 0.334 of H √(μ/ε), 5.492 kV.
    let said =
        |margin: f64, at: &str| format!("`pull_in_margin: {margin}` cannot be reached: no pattern is stable at {at}");
    refuses(
        SCENE,
        &[&with(2.75)],
        5,
        &said(2.75, "5.4919 kV, 2.746 times 2.0000 kV"),
    );
    let planned = |scene: &str, margin: f64| {
        let planned = workspace(scene, &[&with(margin)]).run(&["plan", "p.yaml"]);
        assert_eq!(planned.code, Some(0), "{}", planned.stderr);
    };
    planned(SCENE, 2.74);
    // A pattern may use the group with the lowest voltage alone.
    let groups = SCENE.replace("voltage: 2 kV", "voltages: [2 kV, 1 kV]");
    planned(&groups, 5.4);
    refuses(
        &groups,
        &[&with(5.5)],
        5,
        &said(5.5, "5.4919 kV, 5.492 times 1.0000 kV"),
    );
    // Nothing is known of membranes that stiffen.
    planned(
        &SCENE.replace(
            "effects: {}",
            "effects: { electrode_stiffness: { shear_modulus: 1 MPa, thickness: 0.0001 mm } }",
        ),
        4.0,
    );
}

#[test]
fn results_of_several_scenes_are_refused_by_plan() {
    let scene = SCENE.replace("2 kV", "\"${voltage}\"");
    let solved = "solved: { foreach: { voltage: [1 kV, 2 kV] }, kind: solve, needs: [samples], elements_per_cell: 1 }";
    let balanced = "balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2 mm], target: 80, symmetry: none, seed: 1 }";
    let model = |more: &str| {
        MODEL
            .replace("[solved]", "[balanced]")
            .replace("kind: train", &format!("kind: train{more}"))
    };
    let both = workspace(&scene, &[SAMPLES, solved, balanced, &model(", gather: true")]).refused(&["plan", "p.yaml"]);
    for part in [
        "`balanced@voltage=1kV` and `balanced@voltage=2kV` have different scenes: drive.voltage is 1000 V there",
        "p.yaml:8:",
    ] {
        assert!(both.contains(part), "{part}\n{both}");
    }
    let each = workspace(&scene, &[SAMPLES, solved, balanced, &model("")]).run(&["plan", "p.yaml"]);
    assert_eq!(each.code, Some(0), "{}", each.stderr);
}

#[test]
fn words_that_a_table_cannot_hold_are_refused_by_plan() {
    let long = format!("{}.csv", "l".repeat(61));
    let stages = [
        &format!("own: {{ foreach: {{ file: [short.csv, {long}] }}, kind: patterns, files: [\"${{file}}\"] }}"),
        "solved: { kind: solve, needs: [own], elements_per_cell: 1 }",
        "table: { kind: table, needs: [solved], columns: [file, max_displacement] }",
    ];
    let workspace = workspace(SCENE, &stages);
    for file in ["short.csv", &long] {
        workspace.write(file, &"1,1,1,1,1,1,1,1,1,1,0,0,0,0,0,0,0,0,0,0\n".repeat(20));
    }
    let refused = workspace.refused(&["plan", "p.yaml"]);
    for part in ["the column `file`: \"lll", "has 65 bytes", "at most 64", "p.yaml:5:"] {
        assert!(refused.contains(part), "{part}\n{refused}");
    }
    let short = workspace.run(&["plan", "p.yaml", "--set", "stages.own.foreach.file=[short.csv]"]);
    assert_eq!(short.code, Some(0), "{}", short.stderr);
}

#[test]
fn a_breakdown_margin_that_no_pattern_can_reach_is_refused_by_plan() {
    // 2 kV on 55.6 µm are 36 MV/m, and 60 / 36 = 1.667.
    let with = |margin: f64| format!("{DESIGN}, constraints: {{ breakdown_margin: {margin} }} }}");
    refuses(
        SCENE,
        &[&with(1.7)],
        5,
        "`breakdown_margin: 1.7` cannot be reached: at 2.0000 kV the field of any electrode leaves at most 1.667",
    );
    let planned = |scene: &str, margin: f64| {
        let planned = workspace(scene, &[&with(margin)]).run(&["plan", "p.yaml"]);
        assert_eq!(planned.code, Some(0), "{}", planned.stderr);
    };
    planned(SCENE, 1.6);
    // A pattern may use the group with the lowest voltage alone, but one without voltage moves nothing.
    let groups = |second: &str| SCENE.replace("voltage: 2 kV", &format!("voltages: [2 kV, {second}]"));
    refuses(
        &groups("0 kV"),
        &[&with(1.7)],
        5,
        "at 2.0000 kV the field of any electrode leaves at most 1.667",
    );
    planned(&groups("0 kV"), 1.6);
    planned(&groups("1 kV"), 3.3);
    refuses(
        &groups("1 kV"),
        &[&with(3.4)],
        5,
        "at 1.0000 kV the field of any electrode leaves at most 3.333",
    );
}

#[test]
fn states_without_networks_of_their_own_are_refused_by_plan() {
    let scene = SCENE.replace("voltage: 2 kV", "voltages: [2 kV, 2 kV]")
        + "states: { left: { voltages: [2 kV, 0 kV] }, right: { voltages: [0 kV, 2 kV] } }\n";
    let solved = |name: &str, state: &str| {
        format!("{name}: {{ kind: solve, needs: [samples], elements_per_cell: 2, state: {state} }}")
    };
    let (left, right) = (solved("a", "left"), solved("b", "right"));
    let both = "model: { kind: train, needs: [a, b], network: qin2024, epochs: 1, seed: 1 }";
    refuses(
        &scene,
        &[SAMPLES, &left, &right, both],
        8,
        "`a` is of state `left` and `b` of state `right`",
    );
    // Also behind other stages.
    let balanced = |name: &str, of: &str| {
        format!(
            "{name}: {{ kind: balance, needs: [{of}], bins: 5, range: [0 mm, 2 mm], target: 80, symmetry: none, \
             seed: 1 }}"
        )
    };
    let (first, second) = (balanced("c", "a"), balanced("d", "b"));
    let model = |name: &str, needs: &str| {
        both.replace("model:", &format!("{name}:"))
            .replace("[a, b]", &format!("[{needs}]"))
    };
    for (stages, message) in [
        (
            vec![model("m", "c, d")],
            "`c` is of state `left` and `d` of state `right`",
        ),
        (
            vec![model("m", "c"), model("n", "m, d")],
            "`m` is of state `left` and `d` of state `right`",
        ),
        (
            vec![
                model("m", "c"),
                "k: { kind: calibrate, needs: [m, d], seed: 1 }".to_owned(),
            ],
            "`m` is of state `left` and `d` of state `right`",
        ),
        (
            vec![model("m", "c"), "k: { kind: evaluate, needs: [m, d] }".to_owned()],
            "`m` is of state `left` and `d` of state `right`",
        ),
        (
            vec![
                model("m", "c"),
                "k: { kind: accuracy, needs: [b, m], methods: [{ method: linear, elements_per_cell: 1 }] }".to_owned(),
            ],
            "`b` is of state `right` and `m` of state `left`",
        ),
    ] {
        let stages: Vec<&str> = [SAMPLES, &left, &right, &first, &second]
            .into_iter()
            .chain(stages.iter().map(String::as_str))
            .collect();
        refuses(&scene, &stages, 4 + stages.len(), message);
    }
    let networks = |needs: &str| {
        DESIGN
            .replace("method: adjoint, units: 20, starts: 1", &format!("needs: [{needs}]"))
            .replace("direction: 0 deg", "direction: 0 deg, state: left")
            + " }"
    };
    let (m, n, o) = (model("m", "c"), model("n", "a"), model("o", "d"));
    let with = |needs: &str| {
        let design = networks(needs);
        [SAMPLES, &left, &right, &first, &second, &m, &n, &o, &design].map(str::to_owned)
    };
    let stages = with("m, n");
    let stages: Vec<&str> = stages.iter().map(String::as_str).collect();
    refuses(&scene, &stages, 13, "the networks `m` and `n` are both of state `left`");
    let stages = with("m, o");
    let stages: Vec<&str> = stages.iter().map(String::as_str).collect();
    let planned = workspace(&scene, &stages).run(&["plan", "p.yaml"]);
    assert_eq!(planned.code, Some(0), "{}", planned.stderr);
    let one = both.replace("[a, b]", "[a]");
    let design = DESIGN
        .replace("method: adjoint, units: 20, starts: 1", "needs: [model]")
        .replace("direction: 0 deg", "direction: 0 deg, state: left")
        + " }";
    refuses(
        &scene,
        &[SAMPLES, &left, &one, &design],
        8,
        "a design of a device with 2 states (left, right) uses a network for each; `needs` names 1",
    );
}

#[test]
fn a_search_keeps_to_the_leads_of_the_scene() {
    let design = format!("{DESIGN} }}");
    let verify = "verified: { kind: verify, needs: [best], elements_per_cell: 1 }";
    let scene = format!("{SCENE}leads: {{ cells: [[19, 10]] }}\n");
    let made = workspace(&scene, &[&design, verify]).run(&["run", "p.yaml", "--quiet"]);
    assert_eq!(made.code, Some(0), "{}{}", made.stdout, made.stderr);
}
