//! Where the system gives no more (length of files, open files, memory, threads), commands end with a message and a
//! documented exit code, and nothing is lost.

use std::fs;
use std::fs::File;

use super::common::{Ended, SMALL, Stages, Workspace, files, scene_file};

/// Runs a command under limits of the shell. Its output goes through pipes, whose length is not limited.
fn limited(workspace: &Workspace, limits: &str, arguments: &[&str]) -> Ended {
    let binary = workspace.command(&[]).get_program().to_owned();
    let mut command = workspace.dressed("sh");
    command.args(["-c", &format!("{limits} && exec \"$0\" \"$@\"")]);
    Ended::from(command.arg(binary).args(arguments).output().unwrap())
}

/// Nothing is damaged, and nothing sound was taken for damaged.
fn is_sound(workspace: &Workspace, context: &str) {
    if workspace.path("store/format").exists() {
        let fsck = workspace.run(&["fsck"]);
        assert_eq!(fsck.code, Some(0), "{context}: {}", fsck.stdout);
    }
    assert!(files(&workspace.path("store/quarantine")).is_empty(), "{context}");
}

#[test]
fn a_file_that_may_not_grow_is_an_error_with_a_message() {
    let calm = Workspace::small();
    let wanted = calm.stages(&["run", "small.yaml"]).digests();
    let mut refused = 0;
    // Blocks of 512 bytes.
    for blocks in [0, 1, 8, 16, 40, 64, 160, 400, 1000] {
        let workspace = Workspace::small();
        let ended = limited(&workspace, &format!("ulimit -f {blocks}"), &["run", "small.yaml"]);
        let context = format!("{blocks} blocks: {:?}: {}", ended.code, ended.stderr);
        assert!(matches!(ended.code, Some(0 | 1)), "{context}");
        if ended.code == Some(1) {
            refused += 1;
            assert!(ended.stderr.contains("File too large"), "{context}");
        }
        is_sound(&workspace, &context);
        assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), wanted, "{context}");
    }
    assert!(refused > 3, "{refused}");
}

#[test]
fn a_file_that_cannot_be_written_whole_costs_nothing_of_the_one_before() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.csv", &("0,".repeat(49) + "0\n").repeat(50));
    for (name, arguments) in [
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
            ][..],
        ),
        (
            "m.csv",
            &["export", "design", "p.csv", "--scene", "scene.yaml", "-o", "m.csv"],
        ),
    ] {
        workspace.write(name, "what was there before");
        let ended = limited(&workspace, "ulimit -f 2", arguments);
        assert_eq!(ended.code, Some(1), "{}", ended.stderr);
        assert!(
            ended.stderr.contains("File too large") && ended.stderr.contains(name),
            "{}",
            ended.stderr
        );
        assert_eq!(
            fs::read_to_string(workspace.path(name)).unwrap(),
            "what was there before"
        );
        assert_eq!(
            files(&workspace.path("")).len(),
            3,
            "nothing is left: {:?}",
            files(&workspace.path(""))
        );
        fs::remove_file(workspace.path(name)).unwrap();
    }
}

#[test]
fn too_few_open_files_are_neither_damage_nor_loss() {
    let workspace = Workspace::small();
    let wanted = workspace.stages(&["run", "small.yaml"]).digests();
    let (mut refused, mut done) = (0, 0);
    // Below some number the program itself cannot be loaded.
    for n in (4..16).chain([20, 32]) {
        for arguments in [
            &["fsck"][..],
            &["status"],
            &["plan", "small.yaml", "--verify"],
            &["show", "solved"],
            &["gc", "--grace", "0"],
            &["run", "small.yaml", "--set", "stages.small.count=5"],
        ] {
            let ended = limited(&workspace, &format!("ulimit -n {n}"), arguments);
            let context = format!(
                "{n} files: {arguments:?}: {:?}: {}{}",
                ended.code, ended.stderr, ended.stdout
            );
            // Files that cannot be looked at are no damage, but `fsck` cannot say that the store is sound.
            let unknown = ended.code == Some(4) && arguments == ["fsck"];
            assert!(matches!(ended.code, Some(0 | 1)) || unknown, "{context}");
            match ended.code {
                Some(0) => done += 1,
                _ => {
                    refused += 1;
                    let said = ended.stderr.clone() + &ended.stdout;
                    assert!(said.contains("Too many open files"), "{context}");
                }
            }
            is_sound(&workspace, &context);
        }
    }
    assert!(refused > 3 && done > 20, "{refused} refused, {done} done");
    assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), wanted);
}

#[test]
fn little_memory_and_few_threads_end_in_a_message() {
    let workspace = Workspace::small();
    let wanted = workspace.stages(&["run", "small.yaml"]).digests();
    workspace.write("large.yaml", &SMALL.replace("count: 4", "count: 1000000"));
    // Far from what the program itself takes to be loaded, and far from what such a plan takes.
    let plan = limited(&workspace, "ulimit -v 120000", &["plan", "large.yaml"]);
    assert_eq!(plan.code, Some(1), "{}", plan.stderr);
    assert!(plan.stderr.contains("memory allocation of"), "{}", plan.stderr);
    is_sound(&workspace, "plan");
    // A file is not read into memory that is not there.
    workspace.write("p.csv", &("0,".repeat(49) + "0\n").repeat(50));
    File::create(workspace.path("m.safetensors"))
        .unwrap()
        .set_len(900 << 20)
        .unwrap();
    let predict = limited(
        &workspace,
        "ulimit -v 400000",
        &["predict", "m.safetensors", "p.csv", "-o", "o.h5"],
    );
    assert!(matches!(predict.code, Some(1 | 2)), "{}", predict.stderr);
    assert!(
        predict.stderr.starts_with("error: ") && predict.stderr.contains("m.safetensors"),
        "{}",
        predict.stderr
    );
    let threads = limited(&workspace, "ulimit -v 600000", &["run", "small.yaml", "--jobs", "1024"]);
    assert_eq!(threads.code, Some(1), "{}", threads.stderr);
    assert!(threads.stderr.contains("1024"), "{}", threads.stderr);
    assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), wanted);
}

#[test]
fn a_full_stdout_is_an_error() {
    let workspace = Workspace::small();
    let run = workspace.stages(&["run", "small.yaml"]);
    for arguments in [
        &["status"][..],
        &["status", "--json"],
        &["show", "solved"],
        &["fsck"],
        &["run", "small.yaml"],
    ] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = workspace.command(arguments).stdout(full).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("No space left on device"), "{arguments:?}: {said}");
    }
    let again = workspace.run(&["run", "small.yaml", "--json"]).json();
    assert_eq!(Stages::read(&again).digests(), run.digests());
}
