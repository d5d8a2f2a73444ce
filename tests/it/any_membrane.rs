//! Imports, audits and networks on membranes that are not the source paper's square.

use serde_json::Value;

use super::common::Workspace;

/// A rectangle of 50 × 30 mm, stretched a little more across than along.
const SCENE: &str = "geometry: { size: [50 mm, 30 mm], thickness: 1.0 mm, prestretch: [3, 3.2], cells: [40, 24] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4.5 kV }
effects: {}
";

const IMPORTED: &str = "version: 1
name: own
scene: scene.yaml
stages:
  labels:   { kind: import, files: [FILE] }
  audited:  { kind: audit, needs: [labels], samples: 2, seed: 1, fail_on: never }
  balanced: { kind: balance, needs: [labels, audited], bins: 5, range: [0 mm, 3 mm], target: 40, symmetry: d4, seed: 1 }
";

/// A disc frame with a hub.
const RING: &str = "geometry: { side: 40 mm, thickness: 1.0 mm, prestretch: 3, cells: 30,
  frame: { opening: { disc: { centre: [20 mm, 20 mm], radius: 18 mm } }, held: [{ rectangle: [[18 mm, 18 mm], [22 mm, 22 mm]] }] } }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltages: [5 kV, 3 kV] }
effects: {}
";

/// Writes patterns of a raster as CSV files, and gives their names.
fn patterns(
    workspace: &Workspace,
    count: usize,
    [columns, rows]: [usize; 2],
    cell: impl Fn(usize, usize, usize) -> u8,
) -> Vec<String> {
    let write = |k: usize| {
        let line = |y| {
            (0..columns)
                .map(|x| cell(k, x, y).to_string())
                .collect::<Vec<_>>()
                .join(",")
                + "\n"
        };
        let name = format!("p{k}.csv");
        workspace.write(&name, &(0..rows).map(line).collect::<String>());
        name
    };
    (0..count).map(write).collect()
}

/// Solves patterns by the command.
fn solve(workspace: &Workspace, names: &[String], out: &str) {
    let mut arguments = vec!["solve", "scene.yaml"];
    arguments.extend(names.iter().map(String::as_str));
    arguments.extend(["--elements-per-cell", "1", "-o", out]);
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

/// Changes the displacements of a file.
fn rewrite(workspace: &Workspace, from: &str, to: &str, change: impl Fn(&mut [f64])) {
    // Another test's program may inherit a file that is open here, and its lock.
    let folder = tempfile::tempdir().unwrap();
    let aside = folder.path().join("aside.h5");
    std::fs::copy(workspace.path(from), &aside).unwrap();
    let file = hdf5::File::open_rw(&aside).unwrap();
    let dataset = file.dataset("displacement").unwrap();
    let mut values = dataset.read_raw::<f64>().unwrap();
    change(&mut values);
    dataset.write_raw(&values).unwrap();
    file.close().unwrap();
    std::fs::copy(&aside, workspace.path(to)).unwrap();
}

fn checks(found: &Value) -> Vec<(&str, Vec<u64>)> {
    let rows = |finding: &Value| {
        let examples = finding["examples"].as_array().unwrap().iter();
        examples.map(|row| row.as_u64().unwrap()).collect()
    };
    let findings = found["findings"].as_array().unwrap_or_else(|| panic!("{found}"));
    findings
        .iter()
        .map(|f| (f["check"].as_str().unwrap(), rows(f)))
        .collect()
}

/// A pattern of a number on 40 × 24 cells without a symmetry.
fn scattered(k: usize, x: usize, y: usize) -> u8 {
    u8::from((x / 4 * 7 + y / 3 * 5 + (x / 4) * (y / 3) * (k + 1)) % 11 < 5)
}

#[test]
fn labels_of_a_rectangle_are_imported_audited_and_balanced() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    let mut names = patterns(&workspace, 12, [40, 24], scattered);
    workspace.write("image.csv", &{
        let line = |y: usize| {
            (0..40)
                .map(|x| scattered(0, 39 - x, 23 - y).to_string())
                .collect::<Vec<_>>()
                .join(",")
        };
        (0..24).map(|y| line(y) + "\n").collect::<String>()
    });
    names.push("image.csv".to_owned());
    solve(&workspace, &names, "sound.h5");
    workspace.write("own.yaml", &IMPORTED.replace("FILE", "sound.h5"));
    let built = workspace.stages(&["run", "own.yaml"]);
    assert_eq!(built.with("built"), ["labels", "audited", "balanced"]);
    let sound = workspace.run(&["audit", "own.yaml:labels", "--samples", "2", "--json"]);
    assert_eq!(sound.code, Some(0), "{}{}", sound.stdout, sound.stderr);
    assert_eq!(sound.json()["findings"].as_array().unwrap().len(), 0);
    // Half a turn of a pattern is an image of it, a quarter is none.
    assert_eq!(sound.json()["summary"]["orbits"], 12);
    let balanced = workspace.run(&["audit", "own.yaml:balanced", "--samples", "2", "--json"]);
    assert_eq!(balanced.code, Some(0), "{}{}", balanced.stdout, balanced.stderr);

    const FIELD: usize = 25 * 41 * 2;
    type Fault = (&'static str, fn(&mut [f64]));
    let faults: [Fault; 4] = [
        ("sign", |u| u.iter_mut().for_each(|u| *u = -*u)),
        ("rotation", |u| u.chunks_mut(2).for_each(|u| u[0] = -u[0])),
        ("boundary", |u| u[2 * 40] = 0.003),
        ("label", |u| {
            u.iter_mut().enumerate().for_each(|(i, u)| *u += 1e-3 * (i % 7) as f64)
        }),
    ];
    for (check, fault) in faults {
        rewrite(&workspace, "sound.h5", "bad.h5", |all| {
            fault(&mut all[9 * FIELD..10 * FIELD])
        });
        let ended = workspace.run(&["audit", "bad.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
        assert_eq!(ended.code, Some(5), "{check}: {}", ended.stderr);
        let found = ended.json();
        assert!(checks(&found).contains(&(check, vec![9])), "{check}: {found}");
    }
    let ended = workspace.run(&[
        "audit",
        "bad.h5",
        "--scene",
        "scene.yaml",
        "--samples",
        "0",
        "-o",
        "page",
    ]);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    assert!(workspace.path("page").join("label-9.png").exists());

    workspace.write("bad.yaml", &IMPORTED.replace("FILE", "bad.h5"));
    let said = workspace.refused(&["run", "bad.yaml"]);
    assert!(said.contains("bad.h5: row 9: the frame moves by"), "{said}");
    workspace.write("square.yaml", &SCENE.replace("cells: [40, 24]", "cells: [24, 40]"));
    workspace.write(
        "turned.yaml",
        &IMPORTED
            .replace("FILE", "sound.h5")
            .replace("scene.yaml", "square.yaml"),
    );
    let said = workspace.refused(&["run", "turned.yaml"]);
    assert!(
        said.contains("(13, 24, 40)") && said.contains("allowed: (n, 40, 24)"),
        "{said}"
    );
}

#[test]
fn labels_of_groups_in_a_frame_are_imported_and_audited() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", RING);
    let inside = |x: usize, y: usize| {
        let radius = (x as f64 - 14.5).hypot(y as f64 - 14.5);
        (4.0..12.0).contains(&radius)
    };
    let names = patterns(&workspace, 4, [30, 30], |k, x, y| {
        u8::from(inside(x, y)) * ((x / 5 + (k + 1) * (y / 5)) % 3) as u8
    });
    solve(&workspace, &names, "sound.h5");
    workspace.write("own.yaml", &IMPORTED.replace("FILE", "sound.h5"));
    let built = workspace.stages(&["run", "own.yaml", "--until", "audited"]);
    assert_eq!(built.with("built"), ["labels", "audited"]);
    let sound = workspace.run(&["audit", "own.yaml:labels", "--samples", "1", "--json"]);
    assert_eq!(sound.code, Some(0), "{}{}", sound.stdout, sound.stderr);

    // A corner of the hub moves: it is held like the edges.
    rewrite(&workspace, "sound.h5", "moved.h5", |all| {
        all[2 * (31 * (31 + 15) + 15)] = 0.01
    });
    let ended = workspace.run(&["audit", "moved.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    let found = ended.json();
    assert!(checks(&found).contains(&("boundary", vec![1])), "{found}");
    workspace.write("moved.yaml", &IMPORTED.replace("FILE", "moved.h5"));
    let said = workspace.refused(&["run", "moved.yaml"]);
    assert!(
        said.contains("moved.h5: row 1: the frame moves by 1.000e-2 mm at [y=15][x=15]"),
        "{said}"
    );
}
