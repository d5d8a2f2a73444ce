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
