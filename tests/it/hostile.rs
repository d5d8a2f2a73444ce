//! Pipelines and scenes that are meant to hold the program up are refused in bounded time and memory, with a message.

use std::fs::{self, File};
use std::os::unix::fs::symlink;

use super::common::bounded::pipe;
use super::common::{SMALL, TINY, Transcript, Workspace, scene_file, snapshot};

fn many(n: usize, line: impl Fn(usize) -> String) -> String {
    (0..n).map(line).collect()
}

/// Nine aliases of nine aliases of nine …
fn alias_bomb() -> String {
    let letter = |k: usize| char::from(b'a' + k as u8);
    let level = |k: usize| {
        let alias = format!("*{},", letter(k));
        format!("{0}: &{0} [{1}x]\n", letter(k + 1), alias.repeat(9))
    };
    format!("a: &a [x]\n{}", many(12, level))
}

#[test]
fn documents_that_would_take_all_memory_or_time_are_refused() {
    let workspace = Workspace::new();
    let (header, _) = TINY.split_once("stages:").unwrap();
    let stages = |line: &dyn Fn(usize) -> String| format!("{header}stages:\n{}", many(20_000, line));
    let sample = |k: usize| format!("  s{k}: {{ kind: sample, family: bezier, count: 1, seed: {k} }}\n");
    let documents: Vec<(&str, Vec<u8>)> = vec![
        ("alias bomb", alias_bomb().into()),
        (
            "long aliases",
            format!("a: &a [{}]\nb: [{}]\n", "x,".repeat(100_000), "*a,".repeat(100_000)).into(),
        ),
        ("circle of anchors", "a: &a [*a]\n".into()),
        ("merge of itself", "a: &a\n  <<: *a\n".into()),
        ("open lists", "[".repeat(100_000).into()),
        (
            "closed lists",
            format!("{}{}", "[".repeat(100_000), "]".repeat(100_000)).into(),
        ),
        ("open maps", "{a: ".repeat(100_000).into()),
        ("block lists", "- ".repeat(100_000).into()),
        ("block keys", "? ".repeat(100_000).into()),
        ("block maps", many(2000, |k| format!("{}a:\n", " ".repeat(k))).into()),
        ("10 MB scalar", format!("name: {}\n", "x".repeat(10 << 20)).into()),
        ("3 MB scalar", format!("name: {}\n", "x".repeat(3 << 20)).into()),
        ("3 MB key", format!("{}\n", "k".repeat(3 << 20)).into()),
        ("3 MB quoted", format!("\"{}\": 1\n", "k".repeat(3 << 20)).into()),
        (
            "300,000 keys",
            format!("{{{}}}", many(300_000, |k| format!("k{k}: 1,"))).into(),
        ),
        (
            "10 MB binary",
            many(1 << 20, |k| format!("{:010}", k * 2_654_435_761)).into_bytes(),
        ),
        ("NUL bytes", vec![0; 3 << 20]),
        ("NUL in a value", "name: a\0b\n".into()),
        ("not UTF-8", b"name: \xff\xfe\xc0\n".to_vec()),
        (
            "UTF-16",
            "\u{feff}version: 1\n"
                .encode_utf16()
                .flat_map(u16::to_le_bytes)
                .collect(),
        ),
        ("duplicate keys", "version: 1\nversion: 1\n".into()),
        (
            "object tag",
            "!!python/object/apply:os.system [\"touch owned\"]\n".into(),
        ),
        ("include tag", "version: !include /etc/passwd\n".into()),
        ("many documents", "---\na: 1\n".repeat(1000).into()),
        ("terminal codes", "# \u{1b}[2J\u{7}\nversion: 2\n".into()),
        ("many colons", ":".repeat(1 << 20).into()),
        ("many dashes", "-".repeat(3 << 20).into()),
        ("many anchors", many(100_000, |k| format!("a{k}: &a{k} 1\n")).into()),
        ("empty", Vec::new()),
        ("many stages", stages(&|k| many(2, |j| sample(2 * k + j))).into()),
        (
            "many needs",
            format!(
                "{}  q: {{ kind: solve, needs: [{}] }}\n",
                stages(&sample),
                many(20_000, |k| format!("s{k},"))
            )
            .into(),
        ),
    ];
    for (what, bytes) in documents {
        fs::write(workspace.path("bad.yaml"), bytes).unwrap();
        let said = workspace.refused(&["plan", "bad.yaml"]);
        assert!(said.contains("bad.yaml") || said.contains("stage"), "{what}: {said}");
    }
    assert!(!workspace.path("owned").exists() && !workspace.path("store").exists());
}

#[test]
fn numbers_and_names_without_end_are_refused() {
    let workspace = Workspace::new();
    for (from, to) in [
        ("5.25 kV", "1e400 kV".to_owned()),
        ("5.25 kV", "1e-2000000000 kV".into()),
        ("5.25 kV", format!("{} kV", "9".repeat(1 << 20))),
        ("5.25 kV", ".nan".into()),
        ("area: 0.5", "area: 1e400".into()),
        ("count: 60", "count: 1e99".into()),
        ("generations: 2", "generations: 18446744073709551615".into()),
        ("name: tiny", format!("name: {}", "n".repeat(1 << 20))),
        ("name: tiny", format!("name: {}", "n".repeat(300))),
        ("accuracy:  {", format!("{}: {{", "a".repeat(300))),
        ("kind: balance", format!("kind: {}", "b".repeat(1 << 20))),
        ("bins: 20", format!("{}: 20", "b".repeat(70_000))),
        ("needs: [balanced]", format!("needs: [{}]", "b".repeat(1 << 20))),
        ("cells: 50", "cells: 5000000".into()),
        ("units: [2, 3]", format!("units: [{}]", "2,".repeat(100_000))),
    ] {
        assert!(TINY.contains(from), "{from}");
        workspace.write("bad.yaml", &TINY.replacen(from, &to, 1));
        workspace.refused(&["plan", "bad.yaml"]);
    }
    let long = format!("stages.design.{}=1", "x".repeat(100_000));
    workspace.write("tiny.yaml", TINY);
    workspace.refused(&["plan", "tiny.yaml", "--set", &long]);
    workspace.refused(&["plan", "tiny.yaml", "--until", &"x".repeat(100_000)]);
}

#[test]
fn a_line_that_is_too_long_to_be_quoted_still_has_its_place() {
    let workspace = Workspace::new();
    workspace.write("bad.yaml", &format!("version: 1\n{}: 3\n", "k".repeat(1 << 17)));
    let said = workspace.refused(&["plan", "bad.yaml"]);
    assert!(said.contains("bad.yaml:2:"), "{said}");
}

#[test]
fn huge_counts_are_planned_in_bounded_memory_or_refused() {
    let workspace = Workspace::new();
    workspace.write("large.yaml", &SMALL.replace("count: 4", "count: 1000000"));
    let plan = workspace.bounded(&["plan", "large.yaml", "--json"]);
    assert_eq!(plan.code, Some(0), "{}", plan.stderr);
    let stages = super::common::Stages::read(&plan.json());
    assert_eq!(
        (stages.chunks("small"), stages.chunks("solved")),
        ((20_000, 0), (20_001, 0))
    );

    let every: Vec<String> = (2..=20).map(|n| n.to_string()).collect();
    let units = format!("units: [{}], count_per_units: 10000000", every.join(", "));
    workspace.write("vast.yaml", &SMALL.replace("units: [2], count_per_units: 2", &units));
    let said = workspace.refused(&["plan", "vast.yaml"]);
    assert!(said.contains("`large`"), "{said}");
    let mut printed = Transcript::default();
    printed.add("one large stage", said);

    // Each stage is allowed, all together are not.
    let solve = |k| format!("  again{k}: {{ kind: solve, needs: [small] }}\n");
    let text = SMALL.replace("count: 4", "count: 1000000") + &many(50, solve);
    workspace.write("many.yaml", &text);
    printed.add("many stages", workspace.refused(&["plan", "many.yaml"]));
    snapshot!(printed);
}

#[test]
fn what_is_not_a_file_is_neither_waited_for_nor_read_without_end() {
    let workspace = Workspace::new();
    pipe(&workspace.path("pipe.yaml"));
    fs::create_dir(workspace.path("folder.yaml")).unwrap();
    symlink("/dev/zero", workspace.path("zero.yaml")).unwrap();
    symlink("round.yaml", workspace.path("round.yaml")).unwrap();
    File::create(workspace.path("sparse.yaml"))
        .unwrap()
        .set_len(1 << 30)
        .unwrap();
    let scene = |name: &str| {
        format!(
            "version: 1\nname: x\nscene: {name}\nstages:\n  s: {{ kind: sample, family: bezier, count: 1, seed: 1 }}\n"
        )
    };
    for name in [
        "pipe.yaml",
        "folder.yaml",
        "zero.yaml",
        "round.yaml",
        "sparse.yaml",
        "/dev/zero",
    ] {
        let said = workspace.refused(&["plan", name]);
        assert!(said.contains(name), "{said}");
        workspace.write("p.yaml", &scene(name));
        let said = workspace.refused(&["plan", "p.yaml"]);
        assert!(said.contains(name), "{said}");
    }
}

#[test]
fn a_scene_lies_in_the_folder_of_its_pipeline() {
    let workspace = Workspace::new();
    for folder in ["inside/scenes", "outside"] {
        fs::create_dir_all(workspace.path(folder)).unwrap();
    }
    let scene = scene_file();
    workspace.write("outside/scene.yaml", &scene);
    workspace.write("inside/scenes/own.yaml", &scene);
    symlink("../outside", workspace.path("inside/way")).unwrap();
    symlink("../../outside/scene.yaml", workspace.path("inside/scenes/linked.yaml")).unwrap();
    symlink("own.yaml", workspace.path("inside/scenes/near.yaml")).unwrap();
    let outside = workspace.path("outside/scene.yaml");
    let mut printed = Transcript::default();
    let plan = |scene: &str| {
        let text = format!(
            "version: 1\nname: x\nscene: {scene}\nstages:\n  s: {{ kind: sample, family: bezier, count: 1, seed: 1 }}\n"
        );
        workspace.write("inside/p.yaml", &text);
        ["plan", "inside/p.yaml"]
    };
    for scene in [
        "../outside/scene.yaml",
        "way/scene.yaml",
        "scenes/linked.yaml",
        outside.to_str().unwrap(),
        "/etc/passwd",
    ] {
        let said = workspace.refused(&plan(scene));
        assert!(said.contains("help:"), "{scene}: {said}");
        assert!(!said.contains("root:"), "nothing of the file is shown: {said}");
        printed.add(scene, said);
    }
    for scene in ["scenes/own.yaml", "scenes/near.yaml", "./scenes/../scenes/own.yaml"] {
        let ended = workspace.bounded(&plan(scene));
        assert_eq!(ended.code, Some(0), "{scene}: {}", ended.stderr);
    }
    printed.add("scenes/none.yaml", workspace.refused(&plan("scenes/none.yaml")));
    snapshot!(printed);
}
