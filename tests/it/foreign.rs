//! What is not ours in a store: links, and what people and their programs leave in folders.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::common::bounded::pipe;
use super::common::{SHORT, Stages, Workspace, csv, files, scene_file, snapshot};
use super::damage::copy;

/// The store of a finished run with a pin and a lock file, and the digests of its stages.
fn finished() -> &'static (Workspace, BTreeMap<String, String>) {
    static FINISHED: OnceLock<(Workspace, BTreeMap<String, String>)> = OnceLock::new();
    FINISHED.get_or_init(|| {
        let workspace = Workspace::small();
        let digests = workspace.stages(&["run", "small.yaml", "--lock"]).digests();
        assert_eq!(workspace.run(&["pin", "balanced", "--label", "kept"]).code, Some(0));
        (workspace, digests)
    })
}

fn copied() -> Workspace {
    let workspace = Workspace::new();
    copy(&finished().0.path(""), &workspace.path(""));
    workspace
}

/// Every command that opens a store.
const COMMANDS: [&[&str]; 11] = [
    &["status"],
    &["plan", "small.yaml"],
    &["run", "small.yaml"],
    &["explain", "small.yaml", "solved"],
    &["show", "solved"],
    &["pin"],
    &["report", "small.yaml", "-o", "out"],
    &["gc", "--grace", "0", "--dry-run"],
    &["gc", "--grace", "0"],
    &["run", "small.yaml", "--locked"],
    &["fsck"],
];

/// Everything below a folder as it is, links as links.
fn inventory(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap().flatten() {
            let (path, kind) = (entry.path(), entry.file_type().unwrap());
            let content = match () {
                () if kind.is_symlink() => fs::read_link(&path).unwrap().into_os_string().into_encoded_bytes(),
                () if kind.is_file() => fs::read(&path).unwrap(),
                () => Vec::new(),
            };
            if kind.is_dir() {
                open.push(path.clone());
            }
            found.push((path, content));
        }
    }
    found.sort();
    found
}

#[test]
fn a_store_with_a_linked_folder_is_refused_before_anything_is_touched() {
    for name in [
        "tmp",
        "runs",
        "records",
        "objects",
        "pins",
        "locks",
        "locks/actions",
        "quarantine",
        "lock-files",
    ] {
        let workspace = copied();
        let (inside, elsewhere) = (workspace.path("store").join(name), workspace.path("elsewhere"));
        fs::rename(&inside, &elsewhere).unwrap();
        fs::write(elsewhere.join(".tmpAbCdEf"), "precious").unwrap();
        fs::create_dir(elsewhere.join(".tmpFolder")).unwrap();
        symlink(&elsewhere, &inside).unwrap();
        let before = (inventory(&workspace.path("store")), inventory(&elsewhere));
        let repair: [&[&str]; 1] = [&["fsck", "--repair"]];
        for arguments in COMMANDS.iter().chain(&repair) {
            let said = workspace.refused(arguments);
            assert!(said.contains(&format!("store/{name}")), "{name}: {arguments:?}: {said}");
        }
        assert_eq!(
            (inventory(&workspace.path("store")), inventory(&elsewhere)),
            before,
            "{name}"
        );
    }
}

/// Litter that file managers, editors and people leave in a folder.
fn litter(folder: &Path) -> Vec<PathBuf> {
    let at = |name: &str| folder.join(name);
    for name in [
        ".DS_Store",
        "Thumbs.db",
        "notes.txt",
        "zz~",
        "#edit#",
        "copy of 2026.json",
    ] {
        fs::write(at(name), "mine").unwrap();
    }
    fs::create_dir(at("my folder")).unwrap();
    fs::write(at("my folder/.tmpAbCdEf"), "mine").unwrap();
    pipe(&at("a pipe"));
    symlink("nothing", at("dangling")).unwrap();
    symlink("loop", at("loop")).unwrap();
    symlink("/etc/passwd", at("a link")).unwrap();
    let hidden = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with('.');
    let found = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let names = [
        "Thumbs.db",
        "notes.txt",
        "zz~",
        "#edit#",
        "copy of 2026.json",
        "my folder",
        "a pipe",
        "dangling",
        "loop",
        "a link",
    ];
    let ours = |path: &PathBuf| names.iter().any(|name| path.ends_with(name));
    found.filter(|path| ours(path) && !hidden(path)).collect()
}

#[test]
fn what_others_left_blocks_nothing_and_stays() {
    let workspace = copied();
    let counts = |workspace: &Workspace| {
        let status = workspace.run(&["status", "--json"]).json();
        [
            "objects",
            "bytes",
            "records",
            "runs",
            "pins",
            "lock_files",
            "checkpoints",
            "in_flight",
        ]
        .map(|key| status[key].clone())
    };
    // The copy lies elsewhere, which is news to its store.
    workspace.stages(&["run", "small.yaml"]);
    workspace.stages(&["run", "small.yaml", "--locked"]);
    let before = counts(&workspace);
    let store = workspace.path("store");
    let shard = |folder: &str| {
        fs::read_dir(store.join(folder))
            .unwrap()
            .next()
            .unwrap()
            .unwrap()
            .path()
    };
    fs::create_dir(store.join("checkpoints")).ok();
    let mut littered = Vec::new();
    for folder in [shard("objects"), shard("records")] {
        littered.extend(litter(&folder));
    }
    let mut quiet = Vec::new();
    for folder in ["objects", "records", "runs", "tmp", "pins", "lock-files", "checkpoints"] {
        littered.extend(litter(&store.join(folder)));
    }
    for folder in ["", "locks", "locks/actions", "quarantine", "figures"] {
        quiet.extend(litter(&store.join(folder)));
    }
    let left: Vec<PathBuf> = littered.iter().chain(&quiet).cloned().collect();
    for arguments in COMMANDS {
        let ended = workspace.bounded(arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {}{}", ended.stdout, ended.stderr);
    }
    assert_eq!(counts(&workspace), before);
    for path in &left {
        assert!(fs::symlink_metadata(path).is_ok(), "{} is gone", path.display());
    }
    let strays = workspace.run(&["fsck", "--json"]).json()["strays"].to_string();
    for path in &littered {
        assert!(
            strays.contains(path.strip_prefix(&store).unwrap().to_str().unwrap()),
            "{}: {strays}",
            path.display()
        );
    }
    assert_eq!(workspace.bounded(&["fsck", "--repair"]).code, Some(0));
    let after = workspace.run(&["fsck", "--json"]).json();
    assert_eq!(
        (&after["strays"], &after["sound"]),
        (&serde_json::json!([]), &true.into())
    );
    assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), finished().1);
}

#[test]
fn links_in_the_place_of_files_of_the_store_are_named_and_stepped_over() {
    let name = "0123456789abcdef".repeat(4);
    for target in ["nothing", "itself"] {
        let workspace = copied();
        let store = workspace.path("store");
        let mut links = vec![
            store.join("objects/zz"),
            store.join("records/zz"),
            store.join("runs/2999-01-01T00-00-01.000Z-0123456789ab.json"),
            store.join("pins").join(&name),
            store.join("lock-files").join(&name),
            store.join("checkpoints").join(&name),
            store.join("locks/actions/0123"),
            store.join("tmp/.tmpAbCdEf"),
        ];
        // Every folder of an artifact or a record that a run would make one in.
        for free in (0..256).map(|n| format!("{n:02x}")) {
            for folder in ["objects", "records"] {
                let path = store.join(folder).join(&free);
                if !path.exists() && free != "01" {
                    links.push(path);
                }
            }
        }
        for link in &links {
            fs::create_dir_all(link.parent().unwrap()).unwrap();
            let target = if target == "itself" {
                link.file_name().unwrap().to_str().unwrap()
            } else {
                target
            };
            symlink(target, link).unwrap();
        }
        for arguments in COMMANDS {
            let ended = workspace.bounded(arguments);
            assert_eq!(
                ended.code,
                Some(0),
                "{target}: {arguments:?}: {}{}",
                ended.stdout,
                ended.stderr
            );
        }
        let strays = workspace.run(&["fsck", "--json"]).json()["strays"].to_string();
        for link in &links {
            let shown = link.strip_prefix(&store).unwrap().to_str().unwrap();
            assert!(strays.contains(shown), "{target}: {shown}: {strays}");
            assert!(
                fs::symlink_metadata(link).unwrap().is_symlink(),
                "{target}: {shown} is touched"
            );
        }
        // What is new goes where a link was.
        let more = workspace.bounded(&["run", "small.yaml", "--set", "stages.small.count=5", "--json"]);
        assert_eq!(more.code, Some(0), "{target}: {}", more.stderr);
        assert!(!Stages::read(&more.json()).with("built").is_empty());
        assert!(!workspace.path("nothing").exists());
        assert_eq!(workspace.bounded(&["fsck", "--repair"]).code, Some(0));
        let after = workspace.run(&["fsck", "--json"]).json();
        assert_eq!(
            (&after["strays"], &after["sound"]),
            (&serde_json::json!([]), &true.into()),
            "{target}"
        );
    }
}

#[test]
fn a_linked_folder_of_artifacts_is_neither_collected_from_nor_written_in() {
    let workspace = copied();
    let other = copied();
    let objects = workspace.path("store/objects");
    let shard = fs::read_dir(&objects).unwrap().next().unwrap().unwrap().path();
    let elsewhere = other.path("store/objects").join(shard.file_name().unwrap());
    fs::remove_dir_all(&shard).unwrap();
    symlink(&elsewhere, &shard).unwrap();
    let before = inventory(&other.path("store"));
    for folder in ["runs", "pins", "lock-files"] {
        fs::remove_dir_all(workspace.path("store").join(folder)).unwrap();
    }
    assert_eq!(workspace.bounded(&["gc", "--grace", "0"]).code, Some(0));
    for arguments in [
        &["run", "small.yaml"][..],
        &["fsck"],
        &["fsck", "--repair"],
        &["run", "small.yaml"],
    ] {
        workspace.bounded(arguments);
    }
    assert_eq!(inventory(&other.path("store")), before);
    assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), finished().1);
    assert_eq!(workspace.bounded(&["fsck"]).code, Some(0));
}

#[test]
fn only_runs_are_forgotten_and_never_the_last_one() {
    let workspace = copied();
    let runs = workspace.path("store/runs");
    let mut mine: Vec<PathBuf> = (0..60).map(|n| runs.join(format!("zz-note-{n}.txt"))).collect();
    mine.extend((0..60).map(|n| runs.join(format!("9999-99-99T99-99-99.999Z-note-{n}.json"))));
    mine.iter().for_each(|path| fs::write(path, "mine").unwrap());
    // Runs of ours that a clock far ahead has named.
    let own = fs::read(files(&runs).iter().find(|path| !mine.contains(path)).unwrap()).unwrap();
    for n in 0..10_020 {
        let (hour, minute, second) = (n / 3600, n / 60 % 60, n % 60);
        let name = format!("2999-01-01T{hour:02}-{minute:02}-{second:02}.000Z-{n:012x}.json");
        fs::write(runs.join(name), own.replace(n)).unwrap();
    }
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.count=3"]);
    assert!(mine.iter().all(|path| path.exists()));
    let left: Vec<PathBuf> = files(&runs).into_iter().filter(|path| !mine.contains(path)).collect();
    assert_eq!(left.len(), 10_000);
    let newest = fs::read_to_string(left.last().unwrap()).unwrap();
    let status = workspace.run(&["status", "--json"]).json();
    assert_eq!(status["runs"], 10_000);
    let shown = workspace.run(&["show", "small", "--json"]).json();
    assert!(
        newest.contains(shown["digest"].as_str().unwrap()),
        "the last run is the newest"
    );
    assert_eq!(shown["datasets"]["patterns"]["shape"][0].as_u64().or(Some(3)), Some(3));
}

/// A run of another pipeline, told by a number.
trait Numbered {
    fn replace(&self, number: usize) -> Vec<u8>;
}

impl Numbered for Vec<u8> {
    fn replace(&self, number: usize) -> Vec<u8> {
        let text = String::from_utf8(self.clone()).unwrap();
        text.replacen(
            "\"pipeline\": \"small\"",
            &format!("\"pipeline\": \"other{number}\""),
            1,
        )
        .into_bytes()
    }
}

#[test]
fn a_damaged_marker_is_written_anew_and_nothing_else_changes() {
    for damage in ["gone", "empty", "noise", "folder", "pipe", "device", "dangling"] {
        let workspace = copied();
        let marker = workspace.path("store/format");
        fs::remove_file(&marker).unwrap();
        match damage {
            "empty" => fs::write(&marker, "").unwrap(),
            "noise" => fs::write(&marker, [0xff; 9000]).unwrap(),
            "folder" => {
                fs::create_dir(&marker).unwrap();
                fs::write(marker.join("file"), "mine").unwrap();
            }
            "pipe" => pipe(&marker),
            "device" => symlink("/dev/zero", &marker).unwrap(),
            "dangling" => symlink("nothing", &marker).unwrap(),
            _ => {}
        }
        let before = inventory(&workspace.path("store"));
        for arguments in COMMANDS {
            let said = workspace.refused(arguments);
            assert!(
                said.contains("store/format") && said.contains("fsck --repair"),
                "{damage}: {said}"
            );
        }
        assert_eq!(inventory(&workspace.path("store")), before, "{damage}");
        let repaired = workspace.bounded(&["fsck", "--repair"]);
        assert_eq!(repaired.code, Some(0), "{damage}: {}", repaired.stderr);
        assert!(
            repaired.stdout.contains("store/format"),
            "{damage}: {}",
            repaired.stdout
        );
        assert_eq!(fs::read(&marker).unwrap(), b"deaflow-store 2\n");
        let run = workspace.bounded(&["run", "small.yaml", "--json"]);
        let stages = Stages::read(&run.json());
        assert_eq!(
            (stages.digests(), stages.with("built")),
            (finished().1.clone(), vec![]),
            "{damage}"
        );
        assert_eq!(workspace.bounded(&["fsck"]).code, Some(0), "{damage}");
    }
}

#[test]
fn a_marker_of_another_version_and_a_folder_that_is_no_store_are_not_repaired() {
    for version in ["deaflow-store 1\n", "deaflow-store 3"] {
        let workspace = copied();
        let marker = workspace.path("store/format");
        fs::write(&marker, version).unwrap();
        let said = workspace.refused(&["fsck", "--repair"]);
        assert!(said.contains("--store") && !said.contains("fsck --repair"), "{said}");
        assert_eq!(fs::read_to_string(&marker).unwrap(), version);
    }
    let workspace = Workspace::new();
    fs::create_dir_all(workspace.path("store/objects")).unwrap();
    fs::write(workspace.path("store/objects/mine"), "mine").unwrap();
    let before = inventory(&workspace.path("store"));
    snapshot!(workspace.refused(&["fsck", "--repair"]));
    assert_eq!(inventory(&workspace.path("store")), before);
    workspace.refused(&["fsck", "--repair", "--store", "none"]);
    assert!(!workspace.path("none").exists());
}

#[test]
fn a_folder_whose_name_is_not_utf8_is_refused_before_any_work() {
    use std::os::unix::ffi::OsStrExt;
    let workspace = Workspace::small();
    let folder = workspace.path("").join(std::ffi::OsStr::from_bytes(b"caf\xe9"));
    std::fs::create_dir(&folder).unwrap();
    std::fs::copy(workspace.path("small.yaml"), folder.join("small.yaml")).unwrap();
    for arguments in [
        &["run", "small.yaml"][..],
        &["plan", "small.yaml"],
        &["init"],
        &["init", "new"],
    ] {
        let mut command = workspace.command(arguments);
        let ended = super::common::Ended::from(command.current_dir(&folder).output().unwrap());
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(
            ended.stderr.contains("is not UTF-8, so HDF5 cannot open files there"),
            "{arguments:?}: {}",
            ended.stderr
        );
    }
    let names = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["small.yaml"], "nothing was written");
}

#[test]
fn an_output_whose_name_is_not_utf8_is_refused_before_any_work() {
    use std::os::unix::ffi::OsStrExt;
    let workspace = Workspace::new();
    workspace.write("short.yaml", SHORT);
    assert_eq!(workspace.run(&["run", "short.yaml"]).code, Some(0));
    workspace.write("p.csv", &csv(|x, _| x < 25));
    workspace.write("scene.yaml", &scene_file());
    let before = files(&workspace.path(""));
    for (arguments, name) in [
        (&["export", "crate", "short.yaml"][..], &b"caf\xe9"[..]),
        (&["export", "artifact", "short.yaml:solved"], b"caf\xe9.h5"),
        (
            &["export", "design", "p.csv", "--scene", "scene.yaml"],
            b"caf\xe9.vtkhdf",
        ),
        (&["solve", "scene.yaml", "p.csv"], b"caf\xe9.h5"),
    ] {
        let mut command = workspace.command(arguments);
        let output = command.arg("-o").arg(std::ffi::OsStr::from_bytes(name));
        let ended = super::common::Ended::from(output.output().unwrap());
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(
            ended.stderr.contains("is not UTF-8, so HDF5 cannot write there"),
            "{arguments:?}: {}",
            ended.stderr
        );
        assert_eq!(files(&workspace.path("")), before, "{arguments:?}");
    }
}
