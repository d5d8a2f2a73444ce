//! A disk that fills up: the run says so and where, nothing half-written is taken for a result, and once there is space
//! the next run goes on.
//!
//! The store is a small file system in memory where the system lets its users mount one; elsewhere the size of every
//! file is limited, which refuses the same writes with another word.

use super::common::bounded::await_end;
use super::common::{Ended, Stages, Workspace, csv, scene_file};

/// $0 is the binary, $1 the space in KiB. Exit code 99: the store cannot be made.
const MOUNTED: &str = r#"
mount -t tmpfs -o "size=$1k" none store || exit 99
"$0" run small.yaml --json >first 2>first.err; echo $? >first.code
mount -o remount,size=64m store || exit 99
"$0" run small.yaml --json >second 2>second.err; echo $? >second.code
"$0" fsck >third 2>third.err; echo $? >third.code
find store -name '.tmp*' >left
"#;

/// The same with files of at most $1 KiB.
const LIMITED: &str = r#"
(ulimit -f $(($1 * 2)); "$0" run small.yaml --json >first 2>first.err; echo $? >first.code)
"$0" run small.yaml --json >second 2>second.err; echo $? >second.code
"$0" fsck >third 2>third.err; echo $? >third.code
find store -name '.tmp*' >left
"#;

/// Fills the file system of a store to the last byte, and collects. $1 is the space in KiB, $2 whether processes use
/// claims.
const COLLECTED: &str = r#"
mount -t tmpfs -o "size=$1k" none store || exit 99
"$0" run small.yaml --json >first 2>first.err; echo $? >first.code
if [ "$2" = claims ]; then
    mkdir store/locks/processes
    "$0" run small.yaml --json >first 2>first.err; echo $? >first.code
fi
cat /dev/zero >store/README 2>/dev/null
cat /dev/zero >store/README.2 2>/dev/null
df --output=avail store | tail -1 >space.before
"$0" gc --free 1GB --grace 0 --json >free 2>free.err; echo $? >free.code
"$0" gc --keep-runs 0 --grace 0 --json >second 2>second.err; echo $? >second.code
df --output=avail store | tail -1 >space.after
ls -A store/locks/processes store/locks/claims >claims 2>/dev/null
rm store/README store/README.2
"$0" fsck >third 2>third.err; echo $? >third.code
find store -name '.tmp*' >left
"#;

fn script<'a>(workspace: &Workspace, prefix: &[&'a str], text: &'a str, arguments: &[&str]) -> Ended {
    let binary = workspace.command(&[]).get_program().to_owned();
    let words: Vec<&str> = [prefix, &["sh", "-c", text]].concat();
    let mut command = workspace.dressed(words[0]);
    await_end(command.args(&words[1..]).arg(binary).args(arguments))
}

/// How to get a mount of one's own: as an ordinary user in a namespace, or as root.
pub fn namespace() -> Option<&'static [&'static str]> {
    let workspace = Workspace::new();
    let ways: [&[&str]; 2] = [&["unshare", "-rm"], &["unshare", "-m"]];
    ways.into_iter().find(|way| {
        let mut command = workspace.dressed(way[0]);
        command
            .args(&way[1..])
            .args(["sh", "-c", "mount -t tmpfs none . && mount --bind / /mnt"]);
        command.output().is_ok_and(|output| output.status.success())
    })
}

fn read(workspace: &Workspace, step: &str) -> Ended {
    let text = |name: String| std::fs::read_to_string(workspace.path(&name)).unwrap();
    Ended {
        code: text(format!("{step}.code")).trim().parse().ok(),
        stdout: text(step.into()),
        stderr: text(format!("{step}.err")),
    }
}

#[test]
fn a_full_disk_is_named_and_loses_nothing() {
    let calm = Workspace::small();
    let wanted = calm.stages(&["run", "small.yaml"]);
    let way = namespace();
    let (prefix, text, said): (&[&str], _, _) = match way {
        Some(way) => (way, MOUNTED, "No space left on device"),
        None => (&[], LIMITED, "File too large"),
    };
    let mut refused = 0;
    for space in [4, 12, 16, 20, 24, 32, 64, 76, 180, 330, 440, 500, 560, 640] {
        let workspace = Workspace::small();
        std::fs::create_dir(workspace.path("store")).unwrap();
        let ended = script(&workspace, prefix, text, &[&space.to_string()]);
        assert_eq!(ended.code, Some(0), "{space} KiB: {}", ended.stderr);
        let [first, second, fsck] = ["first", "second", "third"].map(|step| read(&workspace, step));
        assert!(
            matches!(first.code, Some(0 | 1)),
            "{space} KiB: {:?} {}",
            first.code,
            first.stderr
        );
        if first.code == Some(1) {
            refused += 1;
            let last = first.stderr.lines().last().unwrap_or_default();
            assert!(
                last.contains(said) && last.contains("store/"),
                "{space} KiB: {}",
                first.stderr
            );
            let message = first.json()["error"]["message"].as_str().unwrap().to_owned();
            assert!(message.contains(said), "{space} KiB: {message}");
        }
        assert_eq!(second.code, Some(0), "{space} KiB: {}", second.stderr);
        assert_eq!(Stages::read(&second.json()).digests(), wanted.digests(), "{space} KiB");
        assert_eq!(fsck.code, Some(0), "{space} KiB: {}", fsck.stdout);
        let left = std::fs::read_to_string(workspace.path("left")).unwrap();
        assert_eq!(left, "", "{space} KiB: temporary files stay");
    }
    assert!(refused > 3, "the disk was full in {refused} runs");
}

#[test]
fn a_collection_frees_space_on_a_full_disk() {
    collects("locks");
}

#[test]
fn a_collection_frees_space_on_a_full_disk_with_claims() {
    collects("claims");
}

fn collects(how: &str) {
    let Some(way) = namespace() else { return };
    let workspace = Workspace::small();
    std::fs::create_dir(workspace.path("store")).unwrap();
    let ended = script(&workspace, way, COLLECTED, &["4096", how]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let [first, second, fsck] = ["first", "second", "third"].map(|step| read(&workspace, step));
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let free = read(&workspace, "free");
    assert_eq!(free.code, Some(1), "{}", free.stderr);
    assert!(free.stderr.contains("of 1.0 GB"), "{}", free.stderr);
    assert_eq!(free.json()["last_runs_removed"], serde_json::json!([]));
    assert_eq!(second.code, Some(0), "{}", second.stderr);
    assert!(
        second.stderr.contains("small.yaml"),
        "the last run goes: {}",
        second.stderr
    );
    let document = second.json();
    assert!(document["bytes_removed"].as_u64() > Some(0), "{}", second.stdout);
    assert_eq!(document["bytes_kept"], 0);
    let space = |when: &str| {
        let text = std::fs::read_to_string(workspace.path(&format!("space.{when}"))).unwrap();
        text.trim().parse::<u64>().unwrap()
    };
    assert_eq!(space("before"), 0);
    assert!(space("after") > 0);
    let claims = std::fs::read_to_string(workspace.path("claims")).unwrap();
    let listed = match how {
        "claims" => "store/locks/claims:\n\nstore/locks/processes:\n",
        _ => "",
    };
    assert_eq!(claims, listed);
    assert_eq!(fsck.code, Some(0), "{}", fsck.stdout);
    assert_eq!(std::fs::read_to_string(workspace.path("left")).unwrap(), "");
}

/// Creates a project on a disk of $1 KiB, and again with more space.
const PROJECT: &str = r#"
mkdir disk && mount -t tmpfs -o "size=$1k" none disk || exit 99
"$0" init disk/project >first 2>first.err; echo $? >first.code
find disk -mindepth 1 >left
mount -o remount,size=64m disk || exit 99
"$0" init disk/project >second 2>second.err; echo $? >second.code
"#;

#[test]
fn a_project_is_created_whole_or_not_at_all() {
    let Some(way) = namespace() else { return };
    let mut refused = 0;
    for space in ["4", "16", "64", "400"] {
        let workspace = Workspace::new();
        let ended = script(&workspace, way, PROJECT, &[space]);
        assert_eq!(ended.code, Some(0), "{space} KiB: {}", ended.stderr);
        let [first, second] = ["first", "second"].map(|step| read(&workspace, step));
        if first.code == Some(0) {
            continue;
        }
        refused += 1;
        assert!(first.stderr.contains("No space left on device"), "{}", first.stderr);
        assert_eq!(
            std::fs::read_to_string(workspace.path("left")).unwrap(),
            "",
            "{space} KiB"
        );
        assert_eq!(second.code, Some(0), "{space} KiB: {}", second.stderr);
    }
    assert!(refused > 1, "the disk was full in {refused} runs");
}

/// Simulates a pattern in time on a disk of $1 KiB.
const FIGURE: &str = r#"
mkdir disk && mount -t tmpfs -o "size=$1k" none disk || exit 99
"$0" solve scene.yaml half.csv --history --at "0 s" --elements-per-cell 1 -o disk/out.h5 --json >first 2>first.err; echo $? >first.code
ls -A disk >left
"#;

#[test]
fn a_figure_that_does_not_fit_loses_no_result() {
    let Some(way) = namespace() else { return };
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let history = ["--history", "--at", "0 s", "--elements-per-cell", "1", "-o", "out.h5"];
    let ended = workspace.run(&[&["solve", "scene.yaml", "half.csv"][..], &history].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let kib = |name: &str| std::fs::metadata(workspace.path(name)).unwrap().len().div_ceil(4096) * 4;
    let results: u64 = ["out.h5", "out.csv", "out.csv-metadata.json"].map(kib).iter().sum();
    assert!(kib("out.png") > 8, "the figure is larger than what is left");
    let ended = script(&workspace, way, FIGURE, &[&(results + 8).to_string()]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let first = read(&workspace, "first");
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    assert!(
        first.stderr.contains("warning: there is no figure disk/out.png"),
        "{}",
        first.stderr
    );
    assert!(first.json()["figure"].is_null());
    let left = std::fs::read_to_string(workspace.path("left")).unwrap();
    assert_eq!(left, "out.csv\nout.csv-metadata.json\nout.h5\n");
}
