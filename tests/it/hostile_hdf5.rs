//! HDF5 files on which libhdf5 hangs, crashes or asks for all memory: the process that reads them ends, and deaflow
//! says so.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::common::{SMALL, Workspace, files, scene_file, snapshot};
use super::h5py::python;
use super::hostile_files::seal;

/// Found by changing bytes of sound files (`mutate_hdf5.py`). The first lead libhdf5 into circles in the global heap,
/// the next let it crash, the last claim 10⁹ and 10¹² rows in a few kilobytes.
const FILES: [&str; 7] = [
    "plain13",
    "plain133",
    "plain201",
    "plain113",
    "plain126",
    "rows1000000000",
    "split_huge",
];

/// What a command may take: the reader's own time, and a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);

fn source(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it").join(path)
}

/// Unpacks the files that hurt.
fn with_files() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let script = "import sys, lzma, pathlib\nfor p in map(pathlib.Path, sys.argv[1:]): pathlib.Path(p.stem).write_bytes(lzma.decompress(p.read_bytes()))";
    let packed = FILES.map(|name| source(&format!("hostile/{name}.h5.xz")));
    let output = workspace
        .dressed(&python())
        .args(["-c", script])
        .args(packed)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    workspace
}

#[test]
fn files_that_harm_libhdf5_end_no_command_but_their_own_reader() {
    let workspace = with_files();
    std::thread::scope(|scope| {
        for name in FILES {
            let workspace = &workspace;
            scope.spawn(move || {
                let (file, dataset) = (format!("{name}.h5"), format!("{name}.h5:/patterns"));
                let out = format!("{name}.out.h5");
                for arguments in [
                    &["solve", "scene.yaml", &dataset, "-o", &out, "--method", "linear"][..],
                    &["audit", &file, "--scene", "scene.yaml", "--samples", "0"],
                    &["predict", &file, &dataset, "-o", &out],
                ] {
                    let start = Instant::now();
                    let ended = workspace.run(arguments);
                    let said = format!("{arguments:?}: {:?}: {}", ended.code, ended.stderr);
                    assert!(matches!(ended.code, Some(0 | 2 | 4 | 5)), "{said}");
                    assert!(start.elapsed() < PATIENCE, "{said}");
                }
            });
        }
    });
}

/// Puts a file in the place of an artifact; `sealed` with the checksum that fits.
fn replace(workspace: &Workspace, object: &Path, bytes: &[u8], sealed: bool) {
    let digest = object.file_stem().unwrap().to_str().unwrap();
    let _ = fs::remove_file(object);
    fs::write(object, bytes).unwrap();
    if sealed {
        seal(object, digest);
    }
    assert!(workspace.path("store").exists());
}

#[test]
fn such_files_in_a_store_are_damage_with_and_without_a_checksum_that_fits() {
    let workspace = with_files();
    workspace.write("small.yaml", SMALL);
    let before = workspace.stages(&["run", "small.yaml", "--until", "small"]).digests();
    let shown = workspace.run(&["show", "small", "--json"]).json();
    let object = workspace.path(shown["path"].as_str().unwrap());
    for name in ["plain113", "plain126", "plain13"] {
        // These have a user block, so that a header fits.
        let bytes = fs::read(workspace.path(&format!("{name}.h5"))).unwrap();
        for sealed in [false, true] {
            replace(&workspace, &object, &bytes, sealed);
            let show = workspace.run(&["show", &before["small"]]);
            assert_eq!(show.code, Some(4), "{name}: {}", show.stderr);
            let fsck = workspace.run(&["fsck"]);
            assert_eq!(fsck.code, Some(4), "{name}: {}{}", fsck.stdout, fsck.stderr);
            let again = workspace.stages(&["run", "small.yaml", "--until", "small"]).digests();
            assert_eq!(again, before, "{name}");
        }
    }
}

const LIBRARY: &str = r#"
#include <stdio.h>
#include <stdlib.h>
__attribute__((constructor)) static void loaded(void) { fclose(fopen(getenv("MARK"), "w")); }
"#;

const PACKED: &str = r#"
import h5py
with h5py.File('packed.h5', 'w') as f:
    create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    create.set_chunk((50, 50)); create.set_filter(305, h5py.h5z.FLAG_OPTIONAL, (1, 2))
    space = h5py.h5s.create_simple((50, 50))
    h5py.h5d.create(f.id, b'patterns', h5py.h5t.NATIVE_UINT8, space, create).write_direct_chunk((0, 0), b'\0' * 100)
"#;

/// A file names a filter by a number, and libhdf5 would run the code of every library in a folder to find it.
#[test]
fn no_file_makes_the_program_load_a_library() {
    let workspace = with_files();
    workspace.write("library.c", LIBRARY);
    fs::create_dir(workspace.path("plugins")).unwrap();
    let built = workspace
        .dressed("cc")
        .args(["-shared", "-fPIC", "-o", "plugins/library.so", "library.c"])
        .status();
    assert!(built.unwrap().success());
    let dressed = |mut command: Command| {
        command
            .env("HDF5_PLUGIN_PATH", workspace.path("plugins"))
            .env("MARK", workspace.path("mark"));
        command
    };
    let script = |text: &str| {
        let mut command = workspace.dressed(&python());
        command.args(["-c", text]);
        dressed(command).output().unwrap()
    };
    assert!(script(PACKED).status.success());
    // Who packs needs the library.
    let _ = fs::remove_file(workspace.path("mark"));
    for arguments in [
        &["solve", "scene.yaml", "packed.h5:/patterns", "-o", "out.h5"][..],
        &["audit", "packed.h5", "--scene", "scene.yaml"],
    ] {
        let output = dressed(workspace.command(arguments)).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!workspace.path("mark").exists(), "{arguments:?}: {said}");
        assert!(arguments[0] == "audit" || said.contains("305"), "{said}");
    }
    // Other readers do.
    script("import h5py; h5py.File('packed.h5')['patterns'][()]");
    assert!(workspace.path("mark").exists());
}

/// As builds before this one wrote them: attributes of variable length, and labels in place of `axes`.
const EARLIER: &str = r#"
import h5py, sys
def earlier(name, item):
    texts = {k: v.decode() for k, v in item.attrs.items() if isinstance(v, bytes) and k not in ('CLASS', 'NAME')}
    for k, v in texts.items():
        del item.attrs[k]
        item.attrs[k] = v
    if 'axes' in item.attrs:
        item.attrs.create('DIMENSION_LABELS', [a.decode() for a in item.attrs['axes']], dtype=h5py.string_dtype())
        del item.attrs['axes']
for path in sys.argv[1:]:
    with h5py.File(path, 'r+') as f:
        f.visititems(earlier)
        earlier('/', f)
"#;

#[test]
fn artifacts_of_earlier_builds_are_read() {
    let workspace = Workspace::small();
    let before = workspace.stages(&["run", "small.yaml"]).digests();
    let objects = files(&workspace.path("store/objects"));
    let edited = |path: &Path| workspace.path(path.file_name().unwrap().to_str().unwrap());
    for path in &objects {
        fs::copy(path, edited(path)).unwrap();
    }
    let output = workspace
        .dressed(&python())
        .args(["-c", EARLIER])
        .args(objects.iter().map(|p| edited(p)))
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for path in &objects {
        assert!(
            fs::read(edited(path)).unwrap().windows(4).any(|w| w == b"GCOL"),
            "as they were"
        );
        replace(&workspace, path, &fs::read(edited(path)).unwrap(), true);
    }
    let fsck = workspace.run(&["fsck"]);
    assert_eq!(fsck.code, Some(0), "{}{}", fsck.stdout, fsck.stderr);
    let again = workspace.stages(&["run", "small.yaml"]);
    assert_eq!((again.digests(), again.with("built").len()), (before, 0));
    let shown = workspace.run(&["show", "balanced"]);
    assert!(shown.stdout.contains("displacement (row, corner_y, corner_x, xy)") || shown.code == Some(0));
}

#[test]
fn the_process_that_reads_is_no_command_for_people() {
    let workspace = Workspace::new();
    let ended = workspace.bounded(&["read-hdf5"]);
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    snapshot!(ended);
}

/// A few of the files that `mutate_hdf5.py` makes by the thousand.
#[test]
fn files_with_changed_bytes_are_read_or_refused() {
    let workspace = Workspace::new();
    let output = Command::new(python())
        .arg(source("mutate_hdf5.py"))
        .arg(env!("CARGO_BIN_EXE_deaflow"))
        .arg(workspace.path("mutated"))
        .args(["--count", "8"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(said.matches("8 files").count(), 4, "{said}");
}
