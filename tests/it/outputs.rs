//! Files that are asked for by name: only regular files are replaced, links are followed, and the user's mask says who
//! may read.

use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use super::common::bounded::{await_end, pipe};
use super::common::{Ended, Workspace, files, scene_file};
use super::damage::copy;

/// A pattern that solves in a moment.
fn pattern() -> String {
    let row = |y: usize| {
        let cells = (0..50).map(|x| u8::from((20..30).contains(&x) && (20..30).contains(&y)).to_string());
        cells.collect::<Vec<_>>().join(",") + "\n"
    };
    (0..50).map(row).collect()
}

/// A pipeline that has run, a scene, a pattern and a model.
fn finished() -> &'static Workspace {
    static FINISHED: OnceLock<Workspace> = OnceLock::new();
    FINISHED.get_or_init(|| {
        let workspace = Workspace::tiny();
        workspace.write("scene.yaml", &scene_file());
        workspace.write("p.csv", &pattern());
        workspace.stages(&["run", "tiny.yaml"]);
        let ended = workspace.run(&["export", "model", "surrogate", "-o", "model.safetensors"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        workspace
    })
}

fn copied() -> Workspace {
    let workspace = Workspace::new();
    copy(&finished().path(""), &workspace.path(""));
    workspace
}

/// Every command that writes one file, with the name of that file.
const FILES: [(&str, &[&str]); 8] = [
    ("a.h5", &["export", "artifact", "solved", "-o", "a.h5"]),
    (
        "out.h5",
        &[
            "solve",
            "scene.yaml",
            "p.csv",
            "--elements-per-cell",
            "1",
            "-o",
            "out.h5",
        ],
    ),
    ("out.h5", &["predict", "model.safetensors", "p.csv", "-o", "out.h5"]),
    (
        "m.svg",
        &["export", "design", "p.csv", "--scene", "scene.yaml", "-o", "m.svg"],
    ),
    (
        "m.png",
        &["export", "design", "p.csv", "--scene", "scene.yaml", "-o", "m.png"],
    ),
    (
        "m.vtkhdf",
        &[
            "export",
            "design",
            "verified",
            "-o",
            "m.vtkhdf",
            "--elements-per-cell",
            "1",
            "--order",
            "1",
        ],
    ),
    ("m.onnx", &["export", "model", "surrogate", "-o", "m.onnx"]),
    ("tiny.yaml.lock", &["run", "tiny.yaml", "--lock"]),
];

/// Every command that writes into a folder, with a file that it writes there.
const FOLDERS: [(&str, &[&str]); 4] = [
    ("out/index.html", &["report", "tiny.yaml", "-o", "out"]),
    ("out/data/designs.csv", &["report", "tiny.yaml", "-o", "out"]),
    (
        "out/audit.html",
        &["audit", "tiny.yaml:solved", "-o", "out", "--samples", "2"],
    ),
    (
        "out/accuracy.csv",
        &[
            "accuracy",
            "scene.yaml",
            "--patterns",
            "p.csv",
            "-o",
            "out",
            "--reference",
            "{ elements_per_cell: 2 }",
            "--methods",
            "[{ method: linear, elements_per_cell: 1 }]",
        ],
    ),
];

/// The files that a path writes beside its arrays; to follow one takes long.
const OF_PATHS: [(&str, &[&str]); 3] = [
    ("out.h5", &["solve", "scene.yaml", "p.csv", "--path", "-o", "out.h5"]),
    ("out.csv", &["solve", "scene.yaml", "p.csv", "--path", "-o", "out.h5"]),
    ("out.png", &["solve", "scene.yaml", "p.csv", "--path", "-o", "out.h5"]),
];

/// What may stand in the way.
const OBSTACLES: [&str; 6] = ["pipe", "socket", "device", "dangling", "circle", "folder"];

fn obstruct(path: &Path, obstacle: &str) -> Option<UnixListener> {
    match obstacle {
        "pipe" => pipe(path),
        "socket" => return Some(UnixListener::bind(path).unwrap()),
        // Only root can make a device; a link to one is as good.
        "device" => {
            let made = Command::new("mknod").arg(path).args(["c", "1", "3"]).output();
            if !made.is_ok_and(|made| made.status.success()) {
                symlink("/dev/null", path).unwrap();
            }
        }
        "dangling" => symlink("nothing/at/all", path).unwrap(),
        "circle" => symlink(path.file_name().unwrap(), path).unwrap(),
        _ => fs::create_dir(path).unwrap(),
    }
    None
}

#[test]
fn what_is_no_regular_file_is_not_replaced() {
    let workspace = copied();
    for (name, arguments) in FILES.iter().chain(&OF_PATHS).chain(&FOLDERS) {
        let path = workspace.path(name);
        for obstacle in OBSTACLES {
            // A mask may be asked for by its folder.
            if obstacle == "folder" && arguments[0] == "export" {
                continue;
            }
            let _ = fs::remove_dir_all(workspace.path("out"));
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let _socket = obstruct(&path, obstacle);
            let before = fs::symlink_metadata(&path).unwrap();
            let said = workspace.refused(arguments);
            let context = format!("{arguments:?} onto {name}, a {obstacle}: {said}");
            assert!(said.contains(name), "{context}");
            let after = fs::symlink_metadata(&path).unwrap();
            assert_eq!((after.ino(), after.mode()), (before.ino(), before.mode()), "{context}");
            assert!(!workspace.path("nothing").exists(), "{context}");
            match obstacle {
                "folder" => fs::remove_dir(&path).unwrap(),
                _ => fs::remove_file(&path).unwrap(),
            }
            let left = files(&workspace.path("")).into_iter();
            let left = left.filter(|left| !left.starts_with(workspace.path("store")));
            let hidden = |left: &std::path::PathBuf| left.file_name().unwrap().to_str().unwrap().starts_with('.');
            let odd: Vec<_> = left.filter(hidden).collect();
            assert!(odd.is_empty(), "{context}: {odd:?}");
        }
    }
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
}

#[test]
fn links_are_followed_to_the_file_that_they_lead_to() {
    let workspace = copied();
    fs::create_dir(workspace.path("far")).unwrap();
    for (name, arguments) in FILES.iter().chain(&FOLDERS) {
        let (path, far) = (workspace.path(name), workspace.path("far/file"));
        let _ = fs::remove_dir_all(workspace.path("out"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&far, "old").unwrap();
        let _ = fs::remove_file(&path);
        symlink(&far, &path).unwrap();
        is_done(arguments, &workspace.run(arguments));
        assert!(fs::symlink_metadata(&path).unwrap().is_symlink(), "{arguments:?}");
        assert_ne!(fs::read(&far).unwrap(), b"old", "{arguments:?}");
        assert_eq!(files(&workspace.path("far")), [far], "{arguments:?}");
        fs::remove_file(&path).unwrap();
    }
}

/// An audit may have found something.
fn is_done(arguments: &[&str], ended: &Ended) {
    let found = arguments[0] == "audit" && ended.code == Some(5);
    assert!(
        ended.code == Some(0) || found,
        "{arguments:?}: {:?}: {}",
        ended.code,
        ended.stderr
    );
}

fn masked(workspace: &Workspace, mask: &str, arguments: &[&str]) -> Ended {
    let binary = workspace.command(&[]).get_program().to_owned();
    let mut command = workspace.dressed("sh");
    command.args(["-c", &format!("umask {mask}; exec \"$0\" \"$@\"")]);
    await_end(command.arg(binary).args(arguments))
}

#[test]
fn every_file_has_the_mode_that_the_mask_leaves() {
    let workspace = copied();
    // Every command under one mask; under the others what all files go through.
    for (mask, file, folder, commands, how) in [
        ("027", 0o640, 0o750, usize::MAX, &["--lock"][..]),
        ("077", 0o600, 0o700, 1, &["--until", "solved"]),
        ("002", 0o664, 0o775, 1, &["--until", "solved"]),
    ] {
        for (name, arguments) in FILES.iter().chain(&FOLDERS).take(commands) {
            let _ = fs::remove_file(workspace.path(name));
            let _ = fs::remove_dir_all(workspace.path("out"));
            is_done(arguments, &masked(&workspace, mask, arguments));
            for path in files(&workspace.path("out")).into_iter().chain([workspace.path(name)]) {
                let mode = fs::metadata(&path).unwrap().permissions().mode() & 0o777;
                assert_eq!(mode, file, "{mask}: {arguments:?}: {}: {mode:o}", path.display());
            }
        }
        // A store of its own, all files of it.
        let _ = fs::remove_dir_all(workspace.path("own"));
        let run = [&["run", "tiny.yaml", "--store", "own"], how].concat();
        let ended = masked(&workspace, mask, &run);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let found = files(&workspace.path("own"));
        assert!(found.iter().any(|path| path.starts_with(workspace.path("own/locks"))));
        for path in found {
            let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
            assert_eq!(mode(&path), file, "{mask}: {}", path.display());
            assert_eq!(mode(path.parent().unwrap()), folder, "{mask}: {}", path.display());
        }
    }
}

#[test]
fn a_report_that_cannot_be_written_costs_nothing_of_the_one_before() {
    let workspace = copied();
    let arguments = ["report", "tiny.yaml", "-o", "out"];
    assert_eq!(workspace.run(&arguments).code, Some(0));
    let kept = || -> Vec<(std::path::PathBuf, Vec<u8>)> {
        let found = files(&workspace.path("out/data")).into_iter();
        let found = found.filter(|path| fs::symlink_metadata(path).unwrap().is_file());
        found.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    };
    let before = kept();
    assert!(before.len() > 1);
    fs::remove_file(workspace.path("out/index.html")).unwrap();
    pipe(&workspace.path("out/index.html"));
    assert!(workspace.refused(&arguments).contains("index.html"));
    assert_eq!(kept(), before);
    // Nor is a pipe in the place of the table of designs waited for.
    fs::remove_file(workspace.path("out/index.html")).unwrap();
    let table = workspace.path("out/data/designs.csv");
    fs::remove_file(&table).unwrap();
    pipe(&table);
    assert!(workspace.refused(&arguments).contains("designs.csv"));
    assert_eq!(kept().len(), before.len() - 1);
}
