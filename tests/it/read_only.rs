//! A store that may only be read answers what can be answered, and says clearly what cannot be done.

use std::collections::BTreeMap;
use std::process::Command;

use super::common::bounded::await_end;
use super::common::{Ended, Stages, Workspace, files};
use super::full_disk::namespace;

/// How commands meet a store that they cannot write.
enum Way {
    /// Mounted read-only in a namespace of their own.
    Mounted(&'static [&'static str]),
    /// As a user who owns nothing there.
    Stranger,
    /// By its permissions, which bind everybody but root.
    Permissions,
}

fn way() -> Way {
    let root = Command::new("id").arg("-u").output().unwrap().stdout == b"0\n";
    match (namespace(), root) {
        (Some(prefix), _) => Way::Mounted(prefix),
        (None, true) => Way::Stranger,
        (None, false) => Way::Permissions,
    }
}

fn shell(workspace: &Workspace, prefix: &[&str], text: &str, arguments: &[&str]) -> Ended {
    let binary = workspace.command(&[]).get_program().to_owned();
    let words: Vec<&str> = [prefix, &["sh", "-c", text]].concat();
    await_end(
        workspace
            .dressed(words[0])
            .args(&words[1..])
            .arg(binary)
            .args(arguments),
    )
}

fn read_only(workspace: &Workspace, way: &Way, arguments: &[&str]) -> Ended {
    match way {
        Way::Mounted(prefix) => {
            let text = "mount --bind store store && mount -o remount,bind,ro store || exit 99; exec \"$0\" \"$@\"";
            shell(workspace, prefix, text, arguments)
        }
        Way::Stranger => {
            // The binary may lie where only root can go.
            let text = "chmod 755 . && cp \"$0\" binary && exec setpriv --reuid 65534 --regid 65534 --clear-groups ./binary \"$@\"";
            shell(workspace, &[], text, arguments)
        }
        Way::Permissions => shell(
            workspace,
            &[],
            "chmod -R a-w store; \"$0\" \"$@\"; code=$?; chmod -R u+w store; exit $code",
            arguments,
        ),
    }
}

#[test]
fn a_store_that_may_only_be_read_is_read() {
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    check(&workspace, &digests);
    // As on a network, where processes show themselves by files.
    std::fs::create_dir(workspace.path("store/locks/processes")).unwrap();
    check(&workspace, &digests);
}

fn check(workspace: &Workspace, digests: &BTreeMap<String, String>) {
    let before = files(&workspace.path("store"));
    let way = way();
    for arguments in [
        &["plan", "small.yaml"][..],
        &["explain", "small.yaml", "solved"],
        &["show", "solved"],
        &["fsck"],
        &["pin"],
        &["gc", "--dry-run"],
    ] {
        let ended = read_only(workspace, &way, arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
    }
    let run = read_only(workspace, &way, &["run", "small.yaml", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let stages = Stages::read(&run.json());
    assert_eq!((stages.with("built"), stages.digests()), (vec![], digests.clone()));
    for arguments in [
        &["run", "small.yaml", "--set", "stages.small.count=5"][..],
        &["pin", "solved"],
    ] {
        let ended = read_only(workspace, &way, arguments);
        assert_eq!(ended.code, Some(1), "{arguments:?}: {}", ended.stderr);
        let said = ended.stderr.lines().last().unwrap_or_default();
        assert!(
            said.starts_with("error: ") && said.contains("store/"),
            "{arguments:?}: {said}"
        );
        assert!(
            said.contains("Read-only file system") || said.contains("Permission denied"),
            "{arguments:?}: {said}"
        );
    }
    assert_eq!(files(&workspace.path("store")), before);
}

/// Makes what accompanies artifacts read-only: $0 is the binary, then its arguments.
const NOTES: &str = r#"
for note in runs logs memos figures lock-files costs.jsonl index removed.jsonl; do
  mount --bind store/$note store/$note && mount -o remount,bind,ro store/$note || exit 99
done
exec "$0" "$@"
"#;

#[test]
fn notes_that_cannot_be_written_stop_nothing() {
    let Some(way) = namespace() else { return };
    let workspace = Workspace::small();
    for arguments in [
        &["run", "small.yaml", "--set", "stages.small.seed=5"][..],
        &["run", "small.yaml", "--lock"],
        &["gc", "--keep-runs", "1", "--grace", "0"],
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
    }
    for registered in files(&workspace.path("store/lock-files")) {
        std::fs::remove_file(registered).unwrap();
    }
    let text = std::fs::read_to_string(workspace.path("small.yaml")).unwrap();
    workspace.write("small.yaml", &text.replacen("seed: 1", "seed: 6", 1));
    let run = &["run", "small.yaml", "--lock", "--json"];
    let ended = shell(&workspace, way, NOTES, run);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let stages = Stages::read(&ended.json());
    assert_eq!(stages.with("built"), ["small", "solved", "balanced"]);
    let warnings = ended.json()["warnings"].to_string();
    assert!(warnings.contains("figures are missing"), "{warnings}");
    for told in ["log file", "history", "lock file"] {
        let warnings = ended
            .stderr
            .lines()
            .filter(|line| line.starts_with("warning: ") && line.contains(told));
        assert_eq!(warnings.count(), 1, "{told}: {}", ended.stderr);
    }
    let again = workspace.run(run);
    assert_eq!(Stages::read(&again.json()).with("built"), [""; 0]);
    assert!(!again.json()["figures"].as_array().unwrap().is_empty(), "drawn now");

    std::fs::remove_file(workspace.path("small.yaml.lock")).unwrap();
    let ended = shell(
        &workspace,
        way,
        NOTES,
        &["gc", "--keep-runs", "0", "--grace", "0", "--json"],
    );
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.json()["bytes_kept"], 0);
    assert!(
        ended.stderr.contains("removed.jsonl") && ended.stderr.contains("some figures"),
        "{}",
        ended.stderr
    );
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}
