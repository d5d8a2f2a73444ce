//! Damage of every sort is found, named, and rebuilt to what was there: nothing hangs, nothing is taken for a result.

use std::collections::BTreeMap;
use std::fs::{self, File, FileTimes};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::common::bounded::pipe;
use super::common::{Ended, Transcript, Workspace, files, snapshot};

/// A finished store to copy, and the digests of its stages.
fn finished() -> &'static (Workspace, BTreeMap<String, String>) {
    static FINISHED: OnceLock<(Workspace, BTreeMap<String, String>)> = OnceLock::new();
    FINISHED.get_or_init(|| {
        let workspace = Workspace::small();
        let digests = workspace.stages(&["run", "small.yaml"]).digests();
        assert_eq!(workspace.run(&["pin", "balanced", "--label", "kept"]).code, Some(0));
        (workspace, digests)
    })
}

pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

fn copied() -> Workspace {
    let workspace = Workspace::small();
    copy(&finished().0.path("store"), &workspace.path("store"));
    workspace
}

/// Writes other bytes and leaves the times as they were.
fn overwrite(path: &Path, bytes: &[u8]) {
    let before = fs::metadata(path).unwrap();
    fs::write(path, bytes).unwrap();
    let times = FileTimes::new()
        .set_modified(before.modified().unwrap())
        .set_accessed(before.accessed().unwrap());
    File::options()
        .write(true)
        .open(path)
        .unwrap()
        .set_times(times)
        .unwrap();
    assert_eq!(
        fs::metadata(path).unwrap().modified().unwrap(),
        before.modified().unwrap()
    );
}

fn flip(path: &Path, at: usize) {
    let mut bytes = fs::read(path).unwrap();
    bytes[at] ^= 16;
    overwrite(path, &bytes);
}

fn only(folder: &Path) -> PathBuf {
    let found = files(folder);
    assert_eq!(found.len(), 1, "{found:?}");
    found[0].clone()
}

/// The file of a chunk of a stage, or of the stage itself.
fn artifact(workspace: &Workspace, stage: &str, chunk: Option<usize>) -> PathBuf {
    let shown = workspace.run(&["show", stage, "--json"]).json();
    let digest = chunk
        .map_or(&shown["digest"], |k| &shown["parts"][k])
        .as_str()
        .unwrap()
        .to_owned();
    workspace
        .path("store/objects")
        .join(&digest[..2])
        .join(format!("{digest}.h5"))
}

#[test]
fn a_byte_that_changed_under_the_same_size_and_time_is_found_by_the_next_reader() {
    let digests = &finished().1;
    for (stage, chunk) in [("solved", Some(0)), ("solved", None), ("small", Some(0))] {
        let workspace = copied();
        let victim = artifact(&workspace, stage, chunk);
        let sound = fs::read(&victim).unwrap();
        flip(&victim, sound.len() * 2 / 3);
        // Another balance, and another solution, read all of them anew.
        let arguments = [
            "run",
            "small.yaml",
            "--set",
            "scene.drive.voltage=\"5 kV\"",
            "--set",
            "stages.balanced.bins=6",
        ];
        workspace.stages(&arguments);
        assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), *digests, "{stage}");
        let aside = workspace.path("store/quarantine");
        assert!(
            files(&aside).iter().any(|f| f
                .file_name()
                .unwrap()
                .to_str()
                .unwrap()
                .starts_with(victim.file_name().unwrap().to_str().unwrap())),
            "{stage}"
        );
        // Removing what nobody needs leaves it, and says so.
        let told = workspace.run(&["gc", "-n"]).stdout;
        assert!(
            told.contains("in ") && told.contains("/quarantine stay: damaged"),
            "{told}"
        );
        let told = workspace.run(&["gc", "-n", "--json"]).json();
        assert_eq!(told["quarantined"], files(&aside).len());
        // Also without progress a run says that it builds something damaged anew.
        flip(&victim, sound.len() / 3);
        let ended = workspace.run(&["run", "small.yaml", "--quiet"]);
        let warning = format!("warning: {stage}: its artifact was damaged and is built anew");
        assert!(
            ended.code == Some(0) && ended.stderr.contains(&warning),
            "{}",
            ended.stderr
        );
    }
}

#[test]
fn a_byte_that_changed_under_the_same_size_and_time_is_named_by_fsck() {
    for what in ["chunk", "manifest", "whole", "record", "run"] {
        let workspace = copied();
        let path = match what {
            "chunk" => artifact(&workspace, "small", Some(0)),
            "manifest" => artifact(&workspace, "solved", None),
            "whole" => artifact(&workspace, "balanced", None),
            "record" => files(&workspace.path("store/records"))[3].clone(),
            _ => only(&workspace.path("store/runs")),
        };
        let length = fs::metadata(&path).unwrap().len() as usize;
        // The digits of a run may change to others that are as good: its first byte is the bracket.
        flip(&path, if what == "run" { 0 } else { length / 2 });
        let fsck = workspace.bounded(&["fsck"]);
        assert_eq!(fsck.code, Some(4), "{what}: {}", fsck.stdout);
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(fsck.stdout.contains(name), "{what}: {}", fsck.stdout);
        assert!(!path.exists(), "{what} is moved aside");
        let again = workspace.stages(&["run", "small.yaml"]);
        assert_eq!(again.digests(), finished().1, "{what}");
        assert_eq!(workspace.bounded(&["fsck"]).code, Some(0), "{what}");
    }
}

#[test]
fn a_pin_whose_file_is_damaged_still_holds() {
    let workspace = copied();
    let pin = only(&workspace.path("store/pins"));
    let mut printed = Transcript::default();
    for damage in ["flip", "empty", "folder", "pipe"] {
        fs::remove_dir_all(workspace.path("store")).unwrap();
        copy(&finished().0.path("store"), &workspace.path("store"));
        match damage {
            "flip" => flip(&pin, 0),
            "empty" => overwrite(&pin, b""),
            _ => fs::remove_file(&pin).unwrap(),
        }
        match damage {
            "folder" => fs::create_dir(&pin).unwrap(),
            "pipe" => pipe(&pin),
            _ => {}
        }
        let pins = workspace.bounded(&["pin"]);
        assert_eq!(pins.code, Some(0), "{damage}: {}", pins.stderr);
        printed.add(damage, pins);
        fs::remove_dir_all(workspace.path("store/runs")).unwrap();
        let gc = workspace.bounded(&["gc", "--grace", "0"]);
        assert_eq!(gc.code, Some(0), "{damage}: {}", gc.stderr);
        assert!(
            workspace
                .path("store/objects")
                .join(&pin.file_name().unwrap().to_str().unwrap()[..2])
                .is_dir()
        );
        assert!(!files(&workspace.path("store/objects")).is_empty(), "{damage}");
    }
    snapshot!(printed);
}

#[test]
fn gc_does_not_forget_a_run_whose_file_is_damaged() {
    let workspace = copied();
    let before = files(&workspace.path("store/objects"));
    let run = only(&workspace.path("store/runs"));
    flip(&run, 0);
    let gc = workspace.bounded(&["gc", "--grace", "0"]);
    assert_eq!(gc.code, Some(4), "{}", gc.stdout);
    assert!(
        gc.stderr.contains(run.file_name().unwrap().to_str().unwrap()),
        "{}",
        gc.stderr
    );
    assert_eq!(files(&workspace.path("store/objects")), before, "nothing is removed");
    assert_eq!(workspace.bounded(&["fsck"]).code, Some(4));
    assert_eq!(
        workspace.bounded(&["gc", "--dry-run"]).code,
        Some(0),
        "fsck moved the file aside"
    );
}

#[test]
fn a_marker_that_says_nothing_is_refused_and_nothing_is_touched() {
    let workspace = copied();
    let marker = workspace.path("store/format");
    for damage in ["flip", "empty", "folder", "pipe", "device"] {
        fs::remove_dir_all(workspace.path("store")).unwrap();
        copy(&finished().0.path("store"), &workspace.path("store"));
        match damage {
            "flip" => flip(&marker, 3),
            "empty" => overwrite(&marker, b""),
            _ => fs::remove_file(&marker).unwrap(),
        }
        match damage {
            "folder" => fs::create_dir(&marker).unwrap(),
            "pipe" => pipe(&marker),
            "device" => symlink("/dev/zero", &marker).unwrap(),
            _ => {}
        }
        let before = files(&workspace.path("store"));
        for arguments in [
            &["run", "small.yaml"][..],
            &["plan", "small.yaml"],
            &["show", "small"],
            &["fsck"],
            &["gc"],
            &["pin"],
        ] {
            let said = workspace.refused(arguments);
            assert!(said.contains("format"), "{damage}: {said}");
        }
        assert_eq!(files(&workspace.path("store")), before, "{damage}");
    }
}

/// SplitMix64 (Steele, Lea & Flood, OOPSLA 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

const DAMAGES: [&str; 10] = [
    "flip", "empty", "cut", "append", "noise", "zeros", "gone", "folder", "pipe", "link",
];

fn harm(path: &Path, damage: &str, random: &mut Random) {
    let bytes = fs::read(path).unwrap();
    match damage {
        "flip" if bytes.is_empty() => {}
        "flip" => flip(path, random.below(bytes.len())),
        "empty" => overwrite(path, b""),
        "cut" => overwrite(path, &bytes[..random.below(bytes.len() + 1)]),
        "append" => overwrite(path, &[&bytes[..], b"more"].concat()),
        "noise" => overwrite(path, &bytes.iter().map(|_| random.below(256) as u8).collect::<Vec<_>>()),
        "zeros" => overwrite(path, &vec![0; bytes.len()]),
        _ => fs::remove_file(path).unwrap(),
    }
    match damage {
        "folder" => fs::create_dir(path).unwrap(),
        "pipe" => pipe(path),
        "link" => symlink("/dev/zero", path).unwrap(),
        _ => {}
    }
}

#[test]
fn any_damage_to_any_file_ends_in_a_sound_store_with_the_same_digests() {
    let mut random = Random(12);
    for round in 0..24 {
        let workspace = copied();
        let all: Vec<PathBuf> = ["objects", "records", "runs", "pins", "figures"]
            .iter()
            .flat_map(|folder| files(&workspace.path("store").join(folder)))
            .collect();
        let victim = &all[random.below(all.len())];
        let damage = DAMAGES[random.below(DAMAGES.len())];
        harm(victim, damage, &mut random);
        let context = format!("round {round}: {damage} {}", victim.display());
        // Sometimes the run comes first, sometimes those that only look.
        let looks: [&[&str]; 6] = [
            &["plan", "small.yaml"],
            &["explain", "small.yaml", "solved"],
            &["show", "solved"],
            &["pin"],
            &["gc", "--grace", "0", "--dry-run"],
            &["fsck"],
        ];
        for _ in 0..random.below(4) {
            workspace.bounded(looks[random.below(looks.len())]);
        }
        let run = workspace.bounded(&["run", "small.yaml", "--json"]);
        assert_eq!(run.code, Some(0), "{context}: {}", run.stderr);
        assert_eq!(
            super::common::Stages::read(&run.json()).digests(),
            finished().1,
            "{context}"
        );
        // What no run reads again may still lie there damaged: once fsck has moved it aside, all is sound.
        workspace.bounded(&["fsck"]);
        let run = workspace.bounded(&["run", "small.yaml", "--json"]);
        assert_eq!(
            super::common::Stages::read(&run.json()).digests(),
            finished().1,
            "{context}"
        );
        let fsck = workspace.bounded(&["fsck"]);
        assert_eq!(fsck.code, Some(0), "{context}: {}", fsck.stdout);
    }
}

/// The library that makes reads fail.
fn failing_reads(workspace: &Workspace) -> PathBuf {
    let library = workspace.path("readfail.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/scale/readfail.c");
    let mut compiler = std::process::Command::new("cc");
    compiler
        .args(["-shared", "-fPIC", "-o"])
        .arg(&library)
        .arg(source)
        .arg("-ldl");
    assert!(compiler.status().unwrap().success());
    library
}

#[test]
fn what_one_process_reads_wrongly_is_not_moved() {
    let workspace = copied();
    let digests = &finished().1;
    let library = failing_reads(&workspace);
    let flipped = workspace.path("flipped");
    let failing = |arguments: &[&str]| {
        let mut command = workspace.command(arguments);
        command.env("LD_PRELOAD", &library);
        command.env("FAIL_UNDER", "store/objects").env("FLIP_ONCE", &flipped);
        Ended::from(command.output().unwrap())
    };
    let store = workspace.path("store");
    let before = files(&store.join("objects"));
    let fsck = failing(&["fsck", "--json"]);
    assert!(flipped.exists(), "a process has read wrong bytes");
    let report = fsck.json();
    assert_eq!(report["damaged"], serde_json::json!([]), "{report}");
    assert_eq!(report["unreadable"].as_array().map(Vec::len), Some(1), "{report}");
    let told = report["unreadable"][0]["reason"].as_str().unwrap();
    assert!(told.contains("read again, it is intact"), "{told}");
    assert_eq!(fsck.code, Some(1));
    for arguments in [
        &["run", "small.yaml", "--verify", "--json"][..],
        &[
            "run",
            "small.yaml",
            "--verify",
            "--json",
            "--set",
            "stages.balanced.seed=9",
        ],
    ] {
        fs::remove_file(&flipped).unwrap();
        let ran = failing(arguments);
        assert!(flipped.exists(), "a process has read wrong bytes");
        assert!(matches!(ran.code, Some(0 | 1)), "{:?} {}", ran.code, ran.stderr);
        if ran.code == Some(0) {
            let found = super::common::Stages::read(&ran.json()).digests();
            assert_eq!(found["solved"], digests["solved"]);
        }
    }
    let kept = files(&store.join("objects"));
    assert!(before.iter().all(|path| kept.contains(path)));
    assert_eq!(files(&store.join("quarantine")), [""; 0].map(PathBuf::from));
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn what_a_device_cannot_read_is_not_moved() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let library = failing_reads(&workspace);
    let failing = |arguments: &[&str], under: &str, at: u32| {
        let mut command = workspace.command(arguments);
        command.env("LD_PRELOAD", &library);
        command.env("FAIL_UNDER", under).env("FAIL_AT", at.to_string());
        Ended::from(command.output().unwrap())
    };
    let store = workspace.path("store");
    let contents = || -> Vec<_> {
        ["objects", "records", "runs", "quarantine"]
            .iter()
            .flat_map(|part| files(&store.join(part)))
            .collect()
    };
    let before = contents();
    for under in ["store/objects", "store/records", "store/runs"] {
        let mut unreadable = 0;
        // The first reads of each process, one by one, and all.
        for at in 0..30 {
            let ended = failing(&["fsck", "--json"], under, at);
            let report = ended.json();
            assert_eq!(report["damaged"], serde_json::json!([]), "{under} {at}: {report}");
            let is_sound = report["unreadable"] == serde_json::json!([]);
            assert_eq!(ended.code, Some(if is_sound { 0 } else { 1 }), "{under} {at}: {report}");
            unreadable += u32::from(!is_sound);
            assert_eq!(contents(), before, "{under} {at}");
        }
        assert!(unreadable > 1, "{under}: {unreadable}");
    }
    for arguments in [
        &["run", "small.yaml", "--verify"][..],
        &["run", "small.yaml", "--set", "stages.small.seed=2"],
        &["copy", "balanced", "--to", "other"],
    ] {
        let mut failures = 0;
        for at in [0, 1, 2, 3, 5, 8, 13, 21] {
            let ended = failing(arguments, "store/objects", at);
            assert!(
                matches!(ended.code, Some(0 | 1)),
                "{arguments:?} {at}: {:?} {}",
                ended.code,
                ended.stderr
            );
            failures += u32::from(ended.code == Some(1));
            assert_eq!(
                files(&store.join("quarantine")),
                [""; 0].map(std::path::PathBuf::from),
                "{arguments:?} {at}"
            );
            if ended.code == Some(1) {
                assert!(
                    ended.stderr.contains("store/objects"),
                    "{arguments:?} {at}: {}",
                    ended.stderr
                );
            }
            let _ = std::fs::remove_dir_all(workspace.path("other"));
        }
        assert!(failures > 0, "{arguments:?}");
    }
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_link_in_a_circle_or_to_nothing_in_the_place_of_a_file_is_damage() {
    for part in ["records", "objects"] {
        for target in ["self", "nothing"] {
            let workspace = Workspace::small();
            let digests = workspace.stages(&["run", "small.yaml"]).digests();
            let path = files(&workspace.path("store").join(part)).remove(0);
            fs::remove_file(&path).unwrap();
            match target {
                "self" => symlink(path.file_name().unwrap(), &path).unwrap(),
                target => symlink(target, &path).unwrap(),
            }
            let fsck = workspace.run(&["fsck", "--json"]);
            assert_eq!(fsck.code, Some(4), "{part} {target}: {}", fsck.stdout);
            let damaged = &fsck.json()["damaged"];
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(damaged[0]["path"].as_str().unwrap().ends_with(name), "{damaged}");
            assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), digests);
            assert_eq!(workspace.run(&["fsck"]).code, Some(0), "{part} {target}");
        }
    }
}
