//! What is kept for a user saves time. It never changes a result and never stops a command.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use serde_json::Value;

use super::common::bounded::{await_end, pipe};
use super::common::{Ended, Workspace, csv, files, scene_file};
use super::full_disk::namespace;

/// A pattern in a scene whose effects are decided, in less than a second.
fn workspace() -> Workspace {
    let workspace = Workspace::new();
    let scene = scene_file()
        .replace("effects: {}", "effects: auto")
        .replace("5.25 kV", "500 V");
    assert!(scene.contains("auto") && scene.contains("500 V"));
    workspace.write("scene.yaml", &scene);
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace
}

const SOLVE: [&str; 4] = ["solve", "scene.yaml", "half.csv", "--json"];

/// What a command has found, without the time it took.
fn result(ended: &Ended, what: &str) -> Value {
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{what}");
    let mut document = ended.json();
    document.as_object_mut().unwrap().remove("seconds");
    document
}

#[test]
fn a_decision_is_kept_and_a_file_that_is_none_changes_nothing() {
    let workspace = workspace();
    let cache = workspace.path("cache");
    let solve = |what: &str| {
        let mut command = workspace.command(&SOLVE);
        result(&await_end(command.env("XDG_CACHE_HOME", &cache)), what)
    };
    let expected = solve("an empty cache");
    let kept = files(&cache);
    let [file] = kept.as_slice() else {
        panic!("{kept:?}");
    };
    let written = || fs::metadata(file).unwrap().modified().unwrap();
    let (before, decision) = (written(), fs::read(file).unwrap());
    assert_eq!(solve("the decision"), expected);
    assert_eq!(written(), before, "it is not made again");
    let text = String::from_utf8(decision.clone()).unwrap();
    let (sum, effects) = text.split_once('\n').unwrap();
    let others: [(&str, &[u8]); 6] = [
        ("an empty file", b""),
        ("other effects", &[sum.as_bytes(), b"\n{fringe_field: {}}"].concat()),
        ("no checksum", effects.as_bytes()),
        ("zeros", &vec![0; decision.len()]),
        ("a part", &decision[..decision.len() - 1]),
        ("more", &[decision.as_slice(), b"\n"].concat()),
    ];
    for (what, bytes) in others {
        fs::write(file, bytes).unwrap();
        assert_eq!(solve(what), expected, "{what}");
        assert_eq!(fs::read(file).unwrap(), decision, "{what}: it is written again");
    }
    type Make = fn(&Path);
    let others: [(&str, Make); 5] = [
        ("a folder", |path| fs::create_dir(path).unwrap()),
        ("a pipe", |path| pipe(path)),
        ("a device", |path| symlink("/dev/zero", path).unwrap()),
        ("a link to itself", |path| symlink(path, path).unwrap()),
        ("a link to nothing", |path| symlink("nothing", path).unwrap()),
    ];
    for (what, make) in others {
        let _ = fs::remove_file(file);
        make(file);
        assert_eq!(solve(what), expected, "{what}");
        let _ = fs::remove_dir(file);
    }
}

#[test]
fn a_cache_that_cannot_be_used_is_done_without() {
    let workspace = workspace();
    let solve = |cache: &Path, what: &str| {
        let mut command = workspace.command(&SOLVE);
        result(&await_end(command.env("XDG_CACHE_HOME", cache)), what)
    };
    let expected = solve(&workspace.path("cache"), "a cache");
    for file in ["a", "b/deaflow", "c/deaflow/effects"] {
        let path = workspace.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "mine").unwrap();
        assert_eq!(solve(&workspace.path(&file[..1]), file), expected, "{file}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine", "{file}");
    }
    let circle = workspace.path("circle");
    symlink(&circle, &circle).unwrap();
    assert_eq!(solve(&circle, "a link to itself"), expected);
    // A relative path is none.
    assert_eq!(solve(Path::new("relative"), "a relative path"), expected);
    assert!(!workspace.path("relative").exists());
    let Some(way) = namespace() else { return };
    fs::create_dir(workspace.path("disk")).unwrap();
    for (what, before) in [
        ("a full disk", "cat /dev/zero >disk/full 2>/dev/null"),
        ("a disk that cannot be written", "mount -o remount,ro disk"),
    ] {
        let binary = workspace.command(&[]).get_program().to_owned();
        let script = format!("mount -t tmpfs -o size=64k none disk || exit 99; {before}; \"$0\" \"$@\"; exit $?");
        let mut command = workspace.dressed(way[0]);
        command
            .args(&way[1..])
            .args(["sh", "-c", &script])
            .arg(binary)
            .args(SOLVE);
        let ended = await_end(command.env("XDG_CACHE_HOME", workspace.path("disk")));
        assert_eq!(result(&ended, what), expected, "{what}");
    }
}
