//! Patterns, models and artifacts that are meant to hold the program up, or to make it read what it should not.

use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::symlink;

use super::common::bounded::pipe;
use super::common::{Workspace, files, scene_file, snapshot};
use super::h5py::python;

fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(data);
    bytes
}

fn described(descr: &str, shape: &str) -> String {
    format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}")
}

/// An image of one colour and one bit a pixel: a few kilobytes, whatever its size.
fn bomb(side: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side, side);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_compression(png::Compression::Best);
    let mut writer = encoder.write_header().unwrap();
    let mut stream = writer.stream_writer().unwrap();
    let row = vec![0; side.div_ceil(8) as usize];
    (0..side).for_each(|_| stream.write_all(&row).unwrap());
    stream.finish().unwrap();
    drop(writer);
    bytes
}

fn with_scene() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace
}

#[test]
fn patterns_that_lie_about_their_size_are_refused() {
    let workspace = with_scene();
    let solve = |name: &str| workspace.refused(&["solve", "scene.yaml", name, "-o", "out.h5"]);
    for (name, bytes) in [
        ("vast.npy", npy(&described("<f8", "(1152921504606846976, 50, 50)"), b"")),
        (
            "over.npy",
            npy(&described("<f8", "(18446744073709551615, 50, 50)"), b""),
        ),
        ("promise.npy", npy(&described("<f8", "(20000, 50, 50)"), b"")),
        ("short.npy", npy(&described("<f8", "(50, 50)"), &[0; 100])),
        (
            "pickle.npy",
            npy(&described("|O", "(50, 50)"), b"cos\nsystem\n(S'touch owned'\ntR."),
        ),
        ("brackets.npy", npy(&"(".repeat(60_000), b"")),
        ("negative.npy", npy(&described("<f8", "(-1, 50, 50)"), b"")),
        ("endless.csv", b"1,".repeat(300_000)),
        ("quoted.csv", [b"\"".to_vec(), vec![b'x'; 1 << 19]].concat()),
        ("longer.csv", b"1,".repeat(600_000)),
        ("bomb.png", bomb(50_000)),
    ] {
        fs::write(workspace.path(name), bytes).unwrap();
        let said = solve(name);
        assert!(said.contains(name), "{said}");
    }
    assert!(
        workspace.path("bomb.png").metadata().unwrap().len() < 1 << 20,
        "a bomb is small"
    );
    for form in ["npy", "csv", "png", "h5"] {
        let suffix = if form == "h5" { ":/x" } else { "" };
        pipe(&workspace.path(&format!("pipe.{form}")));
        symlink("/dev/zero", workspace.path(&format!("zero.{form}"))).unwrap();
        File::create(workspace.path(&format!("sparse.{form}")))
            .unwrap()
            .set_len(1 << 29)
            .unwrap();
        for name in ["pipe", "zero", "sparse"] {
            solve(&format!("{name}.{form}{suffix}"));
        }
    }
    assert!(!workspace.path("owned").exists() && !workspace.path("out.h5").exists());
}

/// Everything that HDF5 can do and a pattern should not.
const HOSTILE_HDF5: &str = r#"
import h5py, numpy as np, os
os.mkfifo('fifo.h5')
with h5py.File('elsewhere.h5', 'w') as f:
    f['x'] = np.zeros((50, 50), 'u1')
with h5py.File('a.h5', 'w') as f:
    f['good'] = np.zeros((50, 50), 'u1')
    f.create_dataset('packed', data=np.zeros((50, 50), 'u1'), compression='gzip')
    f.create_dataset('vast', shape=(2**52, 50, 50), dtype='u1', chunks=(1, 50, 50))
    f.create_dataset('odd', shape=(2**20, 2**20, 2**20), dtype='u1', chunks=(1, 50, 50))
    f.create_dataset('chunk', shape=(50, 50), maxshape=(None, None), dtype='f8', chunks=(20000, 20000))
    f.create_dataset('list', shape=(50, 50), dtype=h5py.vlen_dtype('i4'))
    f.create_dataset('string', shape=(50, 50), dtype=h5py.string_dtype())
    f.create_dataset('reference', shape=(50, 50), dtype=h5py.ref_dtype)
    f.create_dataset('compound', shape=(50, 50), dtype=[('a', 'f8'), ('b', 'u1')])
    f.create_dataset('complex', shape=(50, 50), dtype='c8')
    f['soft'] = h5py.SoftLink('/soft')
    f['soft2'] = h5py.SoftLink('/soft3'); f['soft3'] = h5py.SoftLink('/soft2')
    f['far'] = h5py.ExternalLink('elsewhere.h5', '/x')
    f['pipe'] = h5py.ExternalLink('fifo.h5', '/x')
    f['round'] = f['/']
    for name in ('/etc/passwd', '/dev/zero', 'fifo.h5'):
        f.create_dataset('outside' + name.replace('/', '_'), shape=(50, 50), dtype='u1', external=[(name, 0, 2500)])
    for name, source in (('self', 'a.h5'), ('none', 'none.h5'), ('passwd', '/etc/passwd'), ('fifo', 'fifo.h5')):
        layout = h5py.VirtualLayout((50, 50), dtype='u1')
        layout[...] = h5py.VirtualSource(source, 'virtual_' + name, (50, 50))
        f.create_virtual_dataset('virtual_' + name, layout)
    create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    create.set_chunk((50, 50)); create.set_filter(305, h5py.h5z.FLAG_OPTIONAL, (1, 2))
    space = h5py.h5s.create_simple((50, 50))
    h5py.h5d.create(f.id, b'filtered', h5py.h5t.NATIVE_UINT8, space, create).write_direct_chunk((0, 0), b'\0' * 100)
    names = [n for n in f if n not in ('good', 'packed')]
whole = open('a.h5', 'rb').read()
open('half.h5', 'wb').write(whole[:len(whole) // 2])
open('head.h5', 'wb').write(whole[:100])
print(' '.join(names))
"#;

fn script(workspace: &Workspace, text: &str) -> String {
    let output = workspace.dressed(&python()).args(["-c", text]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn hdf5_files_lead_nowhere_else() {
    let workspace = with_scene();
    let names = script(&workspace, HOSTILE_HDF5);
    let solve = |name: &str| workspace.refused(&["solve", "scene.yaml", name, "-o", "out.h5"]);
    assert!(names.split_whitespace().count() > 15, "{names}");
    for name in names.split_whitespace() {
        let said = solve(&format!("a.h5:/{name}"));
        assert!(said.contains(name), "{said}");
    }
    for name in [
        "half.h5:/good",
        "head.h5:/good",
        "a.h5:/",
        "a.h5:/none",
        "a.h5:/../good",
        "a.h5",
    ] {
        solve(name);
    }
    solve(&format!("a.h5:{}", "/round".repeat(10_000)));
    for name in ["good", "packed"] {
        let ended = workspace.bounded(&["solve", "scene.yaml", &format!("a.h5:/{name}"), "-o", "out.h5"]);
        assert_eq!(ended.code, Some(0), "{name}: {}", ended.stderr);
    }
}

#[test]
fn a_manifest_taken_out_of_its_store_is_no_pattern_of_zeros() {
    let workspace = Workspace::small();
    // Of two chunks.
    let two = [
        "run",
        "small.yaml",
        "--until",
        "small",
        "--set",
        "stages.small.count=51",
    ];
    workspace.stages(&two);
    let shown = workspace.run(&["show", "small", "--json"]).json();
    let path = shown["path"].as_str().unwrap();
    let inside = workspace.bounded(&[
        "solve",
        "small.yaml",
        &format!("{path}:/patterns"),
        "-o",
        "out.h5",
        "--method",
        "linear",
    ]);
    assert_eq!(inside.code, Some(0), "{}", inside.stderr);
    fs::copy(workspace.path(path), workspace.path("alone.h5")).unwrap();
    let said = workspace.refused(&["solve", "small.yaml", "alone.h5:/patterns", "-o", "out.h5"]);
    assert!(said.contains("alone.h5"), "{said}");
    snapshot!(said);
}

#[test]
fn files_that_are_no_models_are_refused() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--until", "small"]);
    fs::write(workspace.path("p.npy"), npy(&described("|u1", "(50, 50)"), &[0; 2500])).unwrap();
    let head = |length: u64, text: &str| [&length.to_le_bytes()[..], text.as_bytes()].concat();
    let weights = |text: &str| head(text.len() as u64, text);
    let overflow = r#"{"w":{"dtype":"F32","shape":[1152921504606846976,16],"data_offsets":[0,0]}}"#;
    for (name, bytes) in [
        ("empty.safetensors", Vec::new()),
        ("long.safetensors", head(1 << 60, "{}")),
        ("overflow.safetensors", weights(overflow)),
        ("nested.safetensors", weights(&"{\"a\":".repeat(50_000))),
        ("meta.safetensors", weights(r#"{"__metadata__":{"network":"qin2024"}}"#)),
        ("empty.h5", Vec::new()),
        ("noise.h5", (0..4000u32).map(|k| ((k * 7919) >> 3) as u8).collect()),
    ] {
        fs::write(workspace.path(name), bytes).unwrap();
    }
    fs::copy(env!("CARGO_BIN_EXE_deaflow"), workspace.path("program.h5")).unwrap();
    for form in ["h5", "safetensors"] {
        pipe(&workspace.path(&format!("pipe.{form}")));
        symlink("/dev/zero", workspace.path(&format!("zero.{form}"))).unwrap();
        File::create(workspace.path(&format!("sparse.{form}")))
            .unwrap()
            .set_len(1 << 33)
            .unwrap();
    }
    let models = fs::read_dir(workspace.path(""))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap());
    let models: Vec<String> = models
        .filter(|n| n.ends_with(".h5") || n.ends_with(".safetensors"))
        .collect();
    assert_eq!(models.len(), 14);
    for model in models.iter().map(String::as_str).chain(["none.h5", "none", "small"]) {
        workspace.refused(&["predict", model, "p.npy", "-o", "answer"]);
    }
}

/// Puts the seal of an artifact at the head of a file, as docs/store.md describes it: the seal does not say who
/// wrote the rest.
pub fn seal(path: &std::path::Path, content: &str) {
    let mut bytes = fs::read(path).unwrap();
    let rest = blake3::hash(&bytes[512..]);
    let text = format!("deaflow-artifact 1\n{content}\n{rest}\n{}\n", bytes.len());
    bytes[..512].fill(0);
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    fs::remove_file(path).unwrap();
    fs::write(path, bytes).unwrap();
}

/// `FILE` is the artifact of a sample chunk; each snippet makes another lie of it.
const LIES: [(&str, &str); 9] = [
    ("another value", "f['area'][0] = 0.125"),
    (
        "vast",
        "del f['area']; f.create_dataset('area', shape=(2**60,), dtype='f8', chunks=(1,))",
    ),
    (
        "external link",
        "del f['area']; f['area'] = h5py.ExternalLink('fifo', '/x')",
    ),
    ("soft link", "f['round'] = h5py.SoftLink('/round')"),
    ("circle", "f.create_group('a'); f['a/b'] = f['a']; f['a/c'] = f['/']"),
    (
        "outside",
        "del f['area']; f.create_dataset('area', shape=(4,), dtype='f8', external=[('fifo', 0, 32)])",
    ),
    (
        "virtual",
        "v = h5py.VirtualLayout((4,), dtype='f8'); v[...] = h5py.VirtualSource('fifo', 'x', (4,)); del f['area']; f.create_virtual_dataset('area', v)",
    ),
    ("long attribute", "f.attrs['x'] = 'y' * 60000"),
    ("attribute of another type", "f['area'].attrs['units'] = np.zeros(1000)"),
];

#[test]
fn a_sealed_file_that_lies_is_seen_where_it_is_read_and_by_fsck() {
    let workspace = Workspace::small();
    let before = workspace.stages(&["run", "small.yaml"]).digests();
    let shown = workspace.run(&["show", "small", "--json"]).json();
    let chunk = shown["parts"][0].as_str().unwrap().to_owned();
    let path = workspace
        .path("store/objects")
        .join(&chunk[..2])
        .join(format!("{chunk}.h5"));
    let honest = fs::read(&path).unwrap();
    let mut forge = format!(
        "import h5py, numpy as np, os\nos.mkfifo({:?})\n",
        path.with_file_name("fifo").display()
    );
    for (k, (_, lie)) in LIES.iter().enumerate() {
        workspace.write(&format!("lie{k}.h5"), "");
        fs::write(workspace.path(&format!("lie{k}.h5")), &honest).unwrap();
        forge += &format!("with h5py.File('lie{k}.h5', 'r+') as f:\n    {lie}\n");
    }
    script(&workspace, &forge);
    for (k, (what, _)) in LIES.iter().enumerate() {
        let forged = workspace.path(&format!("lie{k}.h5"));
        seal(&forged, &chunk);
        fs::remove_file(&path).unwrap();
        fs::copy(&forged, &path).unwrap();
        // Whoever reads it ends; a mere other value can be seen only by digesting all content.
        for arguments in [
            &["show", "small"][..],
            &["plan", "small.yaml"],
            &["predict", path.to_str().unwrap(), "small.yaml", "-o", "o"],
        ] {
            workspace.bounded(arguments);
        }
        let fsck = workspace.bounded(&["fsck"]);
        assert_eq!(fsck.code, Some(4), "{what}: {}", fsck.stdout);
        assert!(fsck.stdout.contains(&chunk), "{what}: {}", fsck.stdout);
        assert_eq!(workspace.stages(&["run", "small.yaml"]).digests(), before, "{what}");
    }
    fs::remove_file(path.with_file_name("fifo")).unwrap();
    assert_eq!(workspace.bounded(&["fsck"]).code, Some(0));
    assert!(files(&workspace.path("store/quarantine")).len() >= LIES.len());
}
