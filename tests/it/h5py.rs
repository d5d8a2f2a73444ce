//! Artifacts are read by h5py, the reader that most users have.

use std::process::Command;

use super::common::{Workspace, files};

const CHECK: &str = r#"
import sys, h5py, numpy as np
arrays = virtual = 0
def look(name, item):
    global arrays, virtual
    if not isinstance(item, h5py.Dataset) or name.startswith("provenance"):
        return
    if "CLASS" in item.attrs:
        assert h5py.h5ds.is_scale(item.id), name
        return
    arrays += 1
    # What xarray and netCDF call a dimension: a scale of that name, number and length.
    scales = {s.attrs["_Netcdf4Dimid"]: s for s in item.file.values() if "CLASS" in s.attrs}
    if name != "parts":
        axes = [axis.decode() for axis in item.attrs["axes"]]
        assert len(axes) == item.ndim, name
        for axis, length, number in zip(axes, item.shape, item.attrs["_Netcdf4Coordinates"]):
            assert scales[number].name[1:] in (axis, axis + "_axis"), name
            assert scales[number].shape == (length,), name
    virtual += item.is_virtual
    assert isinstance(item.attrs["units"], bytes), name
    assert len(item.attrs["description"].decode()) > 10, name
    values = item[...]
    assert values.shape == item.shape, name
    if values.dtype.kind == "f":
        assert np.isfinite(values).all(), name
for path in sys.argv[1:]:
    with h5py.File(path) as f:
        p = f["provenance"].attrs
        for key in ("kind", "created", "version", "parameters"):
            assert len(p[key].decode()) > 0, (path, key)
        f.visititems(look)
        # Only the parts of virtual datasets stand in the global heap.
        assert "parts" in f or b"GCOL" not in open(path, "rb").read(), path
print(arrays, virtual)
"#;

pub fn python() -> String {
    let with_h5py = |python: &&str| {
        Command::new(python)
            .args(["-c", "import h5py"])
            .output()
            .is_ok_and(|output| output.status.success())
    };
    ["/usr/bin/python3", "python3"]
        .into_iter()
        .find(with_h5py)
        .expect("no python3 with h5py: `make test` installs it")
        .to_string()
}

#[test]
fn every_artifact_explains_itself_to_h5py() {
    let workspace = Workspace::tiny();
    let stages = workspace.stages(&["run", "tiny.yaml"]);
    let artifacts = files(&workspace.path("store/objects"));
    // 5 chunks of samples, 6 of solutions, 1 design, 6 manifests, 4 whole artifacts.
    assert_eq!(artifacts.len(), 22);
    let read = Command::new(python())
        .args(["-c", CHECK])
        .args(&artifacts)
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let counts = String::from_utf8(read.stdout).unwrap();
    let counts: Vec<u32> = counts.split_whitespace().map(|n| n.parse().unwrap()).collect();
    assert!(
        counts[0] > 100 && counts[1] > 20,
        "arrays and virtual arrays: {counts:?}"
    );

    // A manifest shows its chunks as one array.
    let digest = stages.digests()["solved"].clone();
    let manifest = artifacts
        .iter()
        .find(|f| f.to_string_lossy().contains(&digest))
        .unwrap();
    let script = "import sys, h5py; f = h5py.File(sys.argv[1]); d = f['displacement']; assert abs(d[...]).max() > 1; print(d.shape, f['family'][0].decode(), f.attrs['scene'][:10].decode())";
    let read = Command::new(python())
        .args(["-c", script])
        .arg(manifest)
        .output()
        .unwrap();
    let shown = String::from_utf8(read.stdout).unwrap();
    assert!(
        shown.starts_with("(82, 51, 51, 2) small-grid { geometry"),
        "{shown}{}",
        String::from_utf8_lossy(&read.stderr)
    );

    // Without its chunks it shows no numbers that look like data.
    let alone = workspace.path("alone.h5");
    std::fs::copy(manifest, &alone).unwrap();
    let script = "import sys, h5py, numpy as np; f = h5py.File(sys.argv[1]); print(np.isnan(f['displacement'][...]).all(), (f['patterns'][...] == 255).all(), f['family'][0].decode(), *[a.decode() for a in f['displacement'].attrs['axes']])";
    let read = Command::new(python())
        .args(["-c", script])
        .arg(&alone)
        .output()
        .unwrap();
    assert_eq!(
        String::from_utf8_lossy(&read.stdout),
        "True True (the chunk is missing) sample corner_y corner_x xy\n",
        "{}",
        String::from_utf8_lossy(&read.stderr)
    );
}

/// The reader that docs/store.md describes knows nothing of this program.
#[test]
fn the_documented_reader_understands_a_store_and_sees_damage() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "large"]);
    let read = || {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/tools/read_store.py");
        let output = Command::new(python()).arg(script).arg(workspace.path("store")).output();
        let output = output.unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.success(), text(&output.stdout), text(&output.stderr))
    };
    let (sound, listed, errors) = read();
    assert!(sound, "{errors}");
    // 8 patterns of 3 by 3 units, 6 of 2 by 2, and the manifest of both.
    let last = listed.lines().last().unwrap();
    assert!(last.contains("3 artifacts") && last.contains("3 records"), "{listed}");
    for folder in ["store/objects", "store/records"] {
        let path = files(&workspace.path(folder)).remove(0);
        let intact = std::fs::read(&path).unwrap();
        let mut bytes = intact.clone();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        let (sound, _, errors) = read();
        assert!(
            !sound && errors.contains(path.file_name().unwrap().to_str().unwrap()),
            "{errors}"
        );
        std::fs::write(&path, intact).unwrap();
    }
}
