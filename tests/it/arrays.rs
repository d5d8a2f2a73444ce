//! Files as other programs write them: the arrays of h5py, MATLAB and netCDF, the tables of NumPy and spreadsheets,
//! and pictures, under every command that reads patterns.

use std::process::Command;

use serde_json::Value;

use super::common::{Workspace, scene_file};

/// Writes files with h5py and NumPy. `p` is a pattern that no transposition or mirror keeps.
const WRITE: &str = r#"
import h5py, numpy as np, struct, zlib
p = np.zeros((50, 50), "u1"); p[2:20, 5:17] = 1; p[28:41, 30:48] = 1
np.save("reference.npy", p)
np.save("mask.npy", 255 * p)
np.savez("named.npz", p=p, other=np.zeros(3))
np.savetxt("savetxt.txt", p)
np.savetxt("blanks.dat", p, fmt="%4d")
with open("excel.csv", "w", newline="", encoding="utf-8-sig") as f:
    f.write("".join(";".join(f"{v},0" for v in row) + ";\r\n" for row in p))
with h5py.File("types.h5", "w") as f:
    f["half"] = p.astype("f2")
    f["long"] = p.astype("longdouble")
    f["big"] = p.astype(">i8")
    f["flags"] = p.astype(bool)
    enum = h5py.enum_dtype({"bare": 0, "electrode": 1}, basetype="i1")
    f.create_dataset("enum", data=p.astype("i1"), dtype=enum)
    f["soft"] = h5py.SoftLink("/group/inner")
    f.create_dataset("group/inner", data=p)
    f.create_dataset("lzf", data=p, compression="lzf")
    f.create_dataset("gzip", data=p, compression="gzip", shuffle=True)
    for n in range(30):
        f[f"n{n:02}"] = n
with h5py.File("v73.mat", "w", userblock_size=512) as f:
    f.create_dataset("p", data=p.T.astype("f8")).attrs["MATLAB_class"] = np.bytes_("double")
    f.create_dataset("several", data=np.stack([p, p[::-1]]).T).attrs["MATLAB_class"] = np.bytes_("uint8")
with open("v73.mat", "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
with h5py.File("variable.nc", "w") as f:
    f["p"] = p.astype("i1")
    f["p"].dims[0].label = "y"
with h5py.File("h5write.h5", "w") as f:
    f["p"] = p[:, :40].T
def png(name, pixels, colour):
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, colour, 0, 0, 0)
    with open(name, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
top = p[::-1]
png("alpha.png", np.stack([np.full_like(top, 255)] * 3 + [255 * top], -1), 6)
grey = np.where(top == 1, 40, 230).astype("u1"); grey[9, 30] = 120; grey[8, 30] = 140
png("grey.png", grey, 0)
png("large.png", (255 * (1 - top)).repeat(7, 0).repeat(7, 1)[:, :], 0)
png("odd.png", (255 * (1 - top))[np.arange(512) * 50 // 512][:, np.arange(512) * 50 // 512], 0)
"#;

/// A folder with these files and a scene.
fn written() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let ended = Command::new(super::h5py::python())
        .args(["-c", WRITE])
        .current_dir(workspace.path(""))
        .output()
        .unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    workspace
}

/// The first pattern of a file as `deaflow check` reads it, and its notes.
fn checked(workspace: &Workspace, file: &str) -> (Value, Vec<String>) {
    let ended = workspace.run(&["check", file, "--scene", "scene.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{file}: {}", ended.stderr);
    let found = &ended.json()["files"][0];
    let notes = found["notes"].as_array().unwrap();
    let notes = notes.iter().map(|note| note.as_str().unwrap().to_owned());
    (found["patterns"][0]["rows_from_below"].clone(), notes.collect())
}

#[test]
fn files_of_other_programs_are_read_as_the_same_pattern() {
    let workspace = written();
    let (wanted, notes) = checked(&workspace, "reference.npy");
    assert!(notes.is_empty(), "{notes:?}");
    for (file, note) in [
        ("mask.npy", "values 0 and 255 read as 0 and 1"),
        ("named.npz", ""),
        ("named.npz:/p", ""),
        ("savetxt.txt", ""),
        ("blanks.dat", ""),
        ("excel.csv", ""),
        ("types.h5:/half", ""),
        ("types.h5:/long", ""),
        ("types.h5:/big", ""),
        ("types.h5:/flags", ""),
        ("types.h5:/enum", ""),
        ("types.h5:/soft", ""),
        ("types.h5:/group/inner", ""),
        ("types.h5:/gzip", ""),
        ("v73.mat:/p", "axes in MATLAB's order, reversed"),
        ("v73.mat:/several", "axes in MATLAB's order, reversed"),
        ("variable.nc:/p", ""),
        ("variable.nc", ""),
        ("alpha.png", "shape taken from the transparency: opaque = electrode"),
        ("grey.png", "50 × 50 pixels read by coverage"),
        ("large.png", ""),
        ("odd.png", "512 × 512 pixels read by coverage"),
    ] {
        let (read, notes) = checked(&workspace, file);
        assert!(read == wanted, "{file}: {notes:?}");
        match note {
            "" => assert!(notes.is_empty(), "{file}: {notes:?}"),
            note => assert!(notes[0].starts_with(note), "{file}: {notes:?}"),
        }
    }
}

#[test]
fn what_cannot_be_read_is_named_with_the_reason() {
    let workspace = written();
    std::fs::write(workspace.path("old.mat"), b"MATLAB 5.0 MAT-file, Platform: GLNXA64").unwrap();
    for (file, parts) in [
        ("types.h5:/lzf", &["compressed with lzf (filter 32000)", "gzip"][..]),
        ("types.h5:/none", &["no dataset \"/none\"", "/half", "and 18 more"]),
        ("types.h5", &["not exactly one array", "name a dataset"]),
        ("v73.mat", &["not exactly one array", "/several"]),
        ("old.mat:/p", &["a MATLAB file of version 7 or older", "-v7.3"]),
        ("h5write.h5:/p", &["shape (40, 50)"]),
        ("p.xyz:/p", &["cannot read `.xyz` files", ".mat"]),
    ] {
        let said = workspace.refused(&["solve", "scene.yaml", file]);
        for part in parts {
            assert!(said.contains(part), "{file}: {part}: {said}");
        }
        assert!(
            !said.contains("damaged") && !said.contains("no extension"),
            "{file}: {said}"
        );
    }
    // The file of h5write has no mark, but the reversed shape gives it away.
    let wide = "geometry: { size: [50 mm, 40 mm], thickness: 1 mm, prestretch: 3, cells: [50, 40] }\n";
    let scene: String = scene_file()
        .lines()
        .skip_while(|line| !line.starts_with("material"))
        .collect::<Vec<_>>()
        .join("\n");
    let turned = wide
        .replace("[50 mm, 40 mm]", "[40 mm, 50 mm]")
        .replace("[50, 40]", "[40, 50]");
    workspace.write("turned.yaml", &format!("{turned}{scene}\n"));
    let said = workspace.refused(&["solve", "turned.yaml", "h5write.h5:/p"]);
    assert!(said.contains("MATLAB's h5write"), "{said}");
}

#[test]
fn notes_are_printed_by_solve_and_by_pipelines() {
    let workspace = written();
    let solved = workspace.run(&["solve", "scene.yaml", "v73.mat:/p", "--elements-per-cell", "1"]);
    assert_eq!(solved.code, Some(0), "{}", solved.stderr);
    let note = "v73.mat:/p: axes in MATLAB's order, reversed";
    assert!(solved.stderr.contains(note), "{}", solved.stderr);
    let document = workspace.run(&[
        "solve",
        "scene.yaml",
        "v73.mat:/p",
        "--elements-per-cell",
        "1",
        "--json",
    ]);
    assert_eq!(document.json()["notes"][0], note);
    let mask = [
        "export",
        "design",
        "v73.mat:/p",
        "--scene",
        "scene.yaml",
        "-o",
        "mask.csv",
    ];
    let exported = workspace.run(&mask);
    assert_eq!(exported.code, Some(0), "{}", exported.stderr);
    assert!(exported.stderr.contains(note), "{}", exported.stderr);
    let exported = workspace.run(&[&mask[..], &["--json"]].concat());
    assert_eq!(exported.json()["notes"][0], note);
    for pattern in ["v73.mat:/p", "reference.npy"] {
        let refused = workspace.refused(&["export", "design", pattern, "-o", "mask.svg"]);
        assert!(
            refused.contains(&format!("{pattern} is a pattern and needs a scene")),
            "{refused}"
        );
    }
    workspace.write(
        "own.yaml",
        "version: 1\nname: own\nscene: scene.yaml\nstages:\n  own: { kind: patterns, files: [\"v73.mat:/p\"] }\n",
    );
    let plan = workspace.run(&["plan", "own.yaml"]);
    assert!((plan.stdout + &plan.stderr).contains(&format!("own: {note}")));
    // The same artifact as from another file.
    let of_matlab = workspace.stages(&["run", "own.yaml"]).digests();
    let of_numpy = workspace.stages(&["run", "own.yaml", "--set", "stages.own.files=[reference.npy]"]);
    assert_eq!(of_numpy.digests(), of_matlab);
}

#[test]
fn a_drawing_shows_orientation_area_and_islands() {
    let workspace = written();
    let ended = workspace.run(&["check", "reference.npy"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    super::common::snapshot!(ended.stdout);
}

#[test]
fn keys_that_begin_with_x_hold_shared_anchors() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let pipeline = |top: &str, solve: &str| {
        format!(
            "version: 1\nname: own\nscene: scene.yaml\n{top}stages:\n  \
             a: {{ kind: sample, family: small-grid, count: 2, seed: 1 }}\n  \
             s: {{ kind: solve, needs: [a], {solve} }}\n"
        )
    };
    workspace.write("plain.yaml", &pipeline("", "elements_per_cell: 1"));
    workspace.write(
        "shared.yaml",
        &pipeline("x-mesh: &mesh { elements_per_cell: 1 }\n", "<<: *mesh"),
    );
    let plain = workspace.stages(&["run", "plain.yaml"]);
    let shared = workspace.stages(&["run", "shared.yaml"]);
    assert_eq!(shared.digests(), plain.digests());
    assert!(shared.with("built").is_empty());
    workspace.write(
        "other.yaml",
        &pipeline("y-mesh: { elements_per_cell: 1 }\n", "elements_per_cell: 1"),
    );
    assert!(
        workspace
            .refused(&["plan", "other.yaml"])
            .contains("unknown key `y-mesh`")
    );
}
