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

const SAMPLES: &str = "samples: { kind: sample, family: small-grid, count: 20, seed: 1 }";
const SOLVED: &str = "solved: { kind: solve, needs: [samples], elements_per_cell: 2 }";
const MODEL: &str = "model: { kind: train, needs: [solved], network: qin2024, epochs: 1, seed: 1 }";

#[test]
fn needs_that_cannot_do_are_refused_by_plan() {
    let with = |stage: &'static str| [SAMPLES, SOLVED, MODEL, stage];
    for (stage, message) in [
        (
            "few: { kind: calibrate, needs: [model, solved], seed: 1 }",
            "a calibration needs 80 patterns that were not used in training, found 20",
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
    ] {
        refuses(SCENE, &with(stage), 8, message);
    }
    let surrogate = DESIGN.replace(
        "method: adjoint, units: 20, starts: 1",
        "evaluator: surrogate, needs: []",
    ) + " }";
    refuses(SCENE, &[&surrogate], 5, "`evaluator: surrogate` needs a network");
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
    let planned = workspace(SCENE, &[&with(1.6)]).run(&["plan", "p.yaml"]);
    assert_eq!(planned.code, Some(0), "{}", planned.stderr);
}

#[test]
fn states_without_networks_of_their_own_are_refused_by_plan() {
    let scene = SCENE.replace("voltage: 2 kV", "voltages: [2 kV, 2 kV]")
        + "states: { left: { voltages: [2 kV, 0 kV] }, right: { voltages: [0 kV, 2 kV] } }\n";
    let solved = |name: &str, state: &str| {
        format!("{name}: {{ kind: solve, needs: [samples], elements_per_cell: 1, state: {state} }}")
    };
    let (left, right) = (solved("a", "left"), solved("b", "right"));
    let both = "model: { kind: train, needs: [a, b], network: qin2024, epochs: 1, seed: 1 }";
    refuses(
        &scene,
        &[SAMPLES, &left, &right, both],
        8,
        "`a` is of state `left` and `b` of state `right`",
    );
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
