//! Two hosts in one store, on a file system whose locks are seen by one host alone or by none.
//!
//! A FUSE file system (`scale/skewfs.py`) stands for a network: one folder mounted twice, each mount with locks,
//! remembered names and a clock of its own. A preloaded library (`scale/flockfail.c`) stands for one that knows no
//! locks.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::common::{Ended, Stages, Workspace, readers, started};

fn scale(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/scale").join(file)
}

/// Runs on both stores at once: the same digests as in a store of one's own, nothing built twice, a sound store.
fn run_on_both(workspace: &Workspace, stores: [&str; 2], prepare: &dyn Fn(&mut Command)) {
    let alone = workspace.stages(&["run", "small.yaml", "--store", "alone"]);
    let run = |store: &str| {
        let mut command = workspace.command(&["run", "small.yaml", "--json", "--jobs", "1", "--store", store]);
        prepare(&mut command);
        started(command)
    };
    let (first, second) = (run(stores[0]), run(stores[1]));
    let (first, second) = (Stages::of(first), Stages::of(second));
    assert_eq!(first.digests(), alone.digests());
    assert_eq!(second.digests(), alone.digests());
    for name in ["small", "large", "solved", "balanced"] {
        let built = first.chunks(name).0 + second.chunks(name).0;
        assert_eq!(built, alone.chunks(name).0, "{name}");
    }
    std::fs::remove_dir_all(workspace.path("alone")).unwrap();
}

#[test]
fn where_there_are_no_locks_claims_take_their_place() {
    let workspace = Workspace::small();
    let library = workspace.path("flockfail.so");
    let mut compiler = Command::new("cc");
    compiler
        .args(["-shared", "-fPIC", "-o"])
        .arg(&library)
        .arg(scale("flockfail.c"))
        .arg("-ldl");
    assert!(compiler.status().unwrap().success());
    // ENOLCK, ENOSYS, EOPNOTSUPP
    for number in ["37", "38", "95"] {
        let store = format!("store{number}");
        let prepare = |command: &mut Command| {
            command.env("LD_PRELOAD", &library).env("FLOCK_ERRNO", number);
        };
        run_on_both(&workspace, [&store, &store], &prepare);
        let mut doctor = workspace.command(&["doctor", "--json", "--store", &store]);
        prepare(&mut doctor);
        let found = Ended::from(doctor.output().unwrap()).json();
        assert_eq!(found["locking"], "claims", "{found}");
        assert_eq!(workspace.run(&["fsck", "--store", &store]).code, Some(0));
        let left = std::fs::read_dir(workspace.path(&store).join("tmp")).unwrap().count();
        let processes = std::fs::read_dir(workspace.path(&store).join("locks/processes"))
            .unwrap()
            .count();
        assert_eq!((left, processes), (0, 0), "what processes had is gone with them");
    }
}

/// Two mounts of one folder.
struct Mounts {
    hosts: Vec<(PathBuf, Child)>,
}

impl Mounts {
    /// None where there is no FUSE.
    fn of(workspace: &Workspace) -> Option<Self> {
        let python = readers::find(
            "a FUSE file system (libfuse2 and fusepy), which stands for two hosts",
            || {
                Path::new("/dev/fuse")
                    .exists()
                    .then(|| readers::python("fusepy", "fuse"))?
            },
        )?;
        let backing = workspace.path("backing");
        std::fs::create_dir(&backing).unwrap();
        let mut mounts = Self { hosts: Vec::new() };
        for (name, skew) in [("a", "0"), ("b", "120")] {
            let mount = workspace.path(name);
            std::fs::create_dir(&mount).unwrap();
            let mut server = Command::new(&python);
            server.arg(scale("skewfs.py")).arg(&backing).arg(&mount);
            server.args(["--locks", "kernel", "--ttl", "3", "--negative", "3", "--skew", skew]);
            let server = server.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            mounts.hosts.push((mount.clone(), server));
            let start = Instant::now();
            let device = |path: &Path| std::os::unix::fs::MetadataExt::dev(&std::fs::metadata(path).unwrap());
            while device(&mount) == device(&backing) {
                assert!(
                    start.elapsed() < Duration::from_secs(20),
                    "{} is not mounted",
                    mount.display()
                );
                std::thread::sleep(Duration::from_millis(50));
            }
        }
        Some(mounts)
    }
}

impl Drop for Mounts {
    fn drop(&mut self) {
        for (mount, server) in &mut self.hosts {
            let _ = Command::new("umount").arg("-l").arg(mount).status();
            let _ = server.kill();
            let _ = server.wait();
        }
    }
}

#[test]
fn two_hosts_whose_names_are_late_and_clocks_differ_make_one_store() {
    let workspace = Workspace::small();
    let Some(_mounts) = Mounts::of(&workspace) else { return };
    for round in 0..3 {
        let stores = [format!("a/store{round}"), format!("b/store{round}")];
        run_on_both(&workspace, [&stores[0], &stores[1]], &|_| ());
        let checked = workspace.run(&["fsck", "--store", &format!("backing/store{round}")]);
        assert_eq!(checked.code, Some(0), "{}{}", checked.stdout, checked.stderr);
    }
}
