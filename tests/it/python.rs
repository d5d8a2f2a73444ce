//! The Python package: simulations, gradients, errors and runs, and what it reads of a store.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use super::common::{Transcript, Workspace, csv, files, readers, snapshot};

/// Puts the package into a folder, with the library that cargo has built beside the tests.
pub fn install(folder: &Path) {
    let package = folder.join("deaflow");
    std::fs::create_dir(&package).unwrap();
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/python/package/deaflow");
    for entry in std::fs::read_dir(sources).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_file() {
            std::fs::copy(entry.path(), package.join(entry.file_name())).unwrap();
        }
    }
    let tests = std::env::current_exe().unwrap();
    let library = tests.with_file_name("libdeaflow_python.so");
    std::os::unix::fs::symlink(library, package.join("_deaflow.abi3.so")).unwrap();
}

fn run(workspace: &Workspace, arguments: &[&str]) -> Output {
    run_by(workspace, &super::h5py::python(), arguments)
}

fn run_by(workspace: &Workspace, python: &str, arguments: &[&str]) -> Output {
    run_in(workspace, &workspace.path(""), python, arguments)
}

/// Runs a python in a folder, with the package in the workspace.
pub fn run_in(workspace: &Workspace, folder: &Path, python: &str, arguments: &[&str]) -> Output {
    let package = workspace.path("package");
    if !package.exists() {
        std::fs::create_dir(&package).unwrap();
        install(&package);
    }
    let mut command = workspace.dressed(python);
    command.arg("-B").args(arguments).env("PYTHONPATH", package);
    command.current_dir(folder).output().unwrap()
}

fn python(workspace: &Workspace, script: &str) -> Output {
    run(workspace, &["-c", script])
}

/// Runs a file of `tests/it/python`; returns what it prints.
fn script(workspace: &Workspace, name: &str, argument: &str) -> String {
    script_by(workspace, &super::h5py::python(), name, argument)
}

/// As [`script`], by a python.
fn script_by(workspace: &Workspace, python: &str, name: &str, argument: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/python").join(name);
    let output = run_by(workspace, python, &[file.to_str().unwrap(), argument]);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{name} {argument}: {stdout}{stderr}");
    stdout
}

const MATERIAL: &str = "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n";

/// With two scenes, and patterns for them.
fn with_scenes() -> Workspace {
    let workspace = Workspace::new();
    let plain = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 20 }\ndrive: { voltage: 5.25 kV }\n";
    workspace.write("plain.yaml", &format!("{plain}{MATERIAL}effects: {{}}\n"));
    let device = "geometry:
  size: [60 mm, 30 mm]
  thickness: 1 mm
  prestretch: 3
  cells: [20, 10]
  bodies: [{ rectangle: [[27 mm, 12 mm], [33 mm, 18 mm]] }]
states:
  push: { voltages: [5.25 kV, 0 V] }
  pull: { voltages: [0 V, 5.25 kV] }
";
    workspace.write("device.yaml", &format!("{device}{MATERIAL}"));
    script(&workspace, "solve.py", "write");
    workspace
}

#[test]
fn results_have_the_bits_of_the_files_of_the_command() {
    let workspace = with_scenes();
    grey(&workspace);
    for line in [
        "solve plain.yaml patterns.npy --no-checks -o plain.h5",
        "solve plain.yaml patterns.npy --no-checks --accuracy 0.05mm -o accurate.h5",
        "solve plain.yaml patterns.npy --no-checks --method linear -o linear.h5",
        "solve plain.yaml patterns.npy --no-checks --set drive.voltage=6kV --set \
         effects.electromechanical_stability={} --order 2 --elements-per-cell 1 --cells -o observed.h5",
        "solve device.yaml groups.npy -o device.h5",
        "solve device.yaml groups.npy --no-checks --state pull --tolerance 1e-10 -o pull.h5",
        "solve plain.yaml grey.png --edges coverage --no-checks -o grey.h5",
    ] {
        let words: Vec<&str> = line.split_whitespace().collect();
        let ended = workspace.run(&words);
        assert!(matches!(ended.code, Some(0 | 3)), "{line}: {}", ended.stderr);
    }
    let compared = script(&workspace, "solve.py", "compare");
    assert!(compared.trim().parse::<u32>().unwrap() > 60, "{compared} arrays");
}

#[test]
fn histories_paths_modes_and_responses_have_the_bits_of_the_files_of_the_command() {
    let workspace = Workspace::new();
    let geometry = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }\n";
    let drive = "drive: { voltage: 4 kV, waveform: { step: {} }, duration: 10 s }\n";
    let creep = "effects: { viscoelasticity: {} }
properties: { viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }] }, density: 960 kg/m3 }\n";
    workspace.write("moving.yaml", &format!("{geometry}{MATERIAL}{drive}{creep}"));
    let strip = "geometry:
  size: [40 mm, 20 mm]
  thickness: 1 mm
  prestretch: [2.5, 2]
  cells: [8, 4]
  sides: { right: { bar: { load: [0.3 N, 0 N], moves: [x] } }, top: free, bottom: roller }
drive: { voltage: 2 kV }\n";
    workspace.write("bar.yaml", &format!("{strip}{MATERIAL}effects: {{}}\n"));
    let script = "import numpy as np
y, x = np.mgrid[:10, :10]
np.save('few.npy', np.array([x < 5, (x + y) % 3 == 0]).astype('u1'))
np.save('one.npy', (x < 5).astype('u1'))
np.save('rows.npy', np.ones((4, 8), dtype='u1'))";
    assert!(python(&workspace, script).status.success());
    for line in [
        "solve moving.yaml few.npy --history --at 0s,1s,10s --elements-per-cell 1 -o history.h5",
        "solve moving.yaml one.npy --history --every 5s --accuracy 0.05mm --time-limit 100s -o every.h5",
        "solve moving.yaml few.npy --path -o path.h5",
        "solve bar.yaml rows.npy --path=load --elements-per-cell 2 --tolerance 1e-9 -o load.h5",
        "solve moving.yaml few.npy --modes 3 --lumped -o modes.h5",
        "solve moving.yaml few.npy --response 1Hz:100Hz --points 5 --elements-per-cell 1 -o response.h5",
        "solve moving.yaml few.npy --elements-per-cell 1 --order 2 --set loads={\"pressure\":\"500Pa\"} -o space.h5",
        "solve moving.yaml one.npy --path=volume --set loads={\"volume\":\"8ml\"} -o volume.h5",
    ] {
        let ended = workspace.run(&line.split_whitespace().collect::<Vec<_>>());
        assert_eq!(ended.code, Some(0), "{line}: {}", ended.stderr);
    }
    let compared = self::script(&workspace, "analyses.py", "");
    assert!(compared.trim().parse::<u32>().unwrap() > 150, "{compared} arrays");
}

/// Writes a picture whose greys cover cells in part, and the greys, `[y][x]` from below.
fn grey(workspace: &Workspace) {
    let greys: Vec<u8> = (0..20 * 20).map(|at| (at * 37 % 256) as u8).collect();
    let file = std::fs::File::create(workspace.path("grey.png")).unwrap();
    let mut encoder = png::Encoder::new(file, 20, 20);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(&greys).unwrap();
    let script = "import numpy as np; a = np.arange(400) * 37 % 256; np.save('grey.npy', a.reshape(20, 20)[::-1])";
    assert!(python(workspace, script).status.success());
}

#[test]
fn predictions_have_the_bits_of_the_files_of_the_command() {
    let workspace = super::intervals::workspace();
    for more in [
        &["-o", "out.h5", "--objective", super::intervals::POINT][..],
        &["-o", "plain.h5", "--calibration", "intervals"],
    ] {
        let ended = workspace.run(&[&["predict", "tiny.yaml:surrogate", "cells.csv", "board.csv"][..], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    let compared = script(&workspace, "model.py", "");
    assert!(compared.trim().parse::<u32>().unwrap() > 20, "{compared} arrays");
}

#[test]
fn effects_are_screened_as_by_the_command() {
    let workspace = with_scenes();
    let python = |call: &str| -> Value {
        let script = format!(
            "import deaflow, json, numpy
scene, patterns = deaflow.Scene.read('plain.yaml'), numpy.load('patterns.npy')
print(json.dumps(scene.screen({call})))"
        );
        serde_json::from_str(&printed(&workspace, &script)).unwrap()
    };
    for (call, more) in [
        ("", &[][..]),
        ("patterns, time_limit='2 s'", &["patterns.npy", "--time-limit", "2 s"]),
    ] {
        let ended = workspace.run(&[&["screen", "plain.yaml", "--json"][..], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        // The command calls a pattern by its file.
        let named = |text: String, at: usize| text.replace(&format!("patterns.npy[{at}]"), &format!("pattern {at}"));
        let text = (0..3).fold(ended.json().to_string(), named);
        let expected: Value = serde_json::from_str(&text).unwrap();
        let found = python(call);
        assert_eq!(found, expected, "{call}");
    }
}

#[test]
fn accuracy_is_measured_as_by_the_command() {
    let workspace = with_scenes();
    let reference = "{ elements_per_cell: 2, order: 2 }";
    let methods = "[linear, { elements_per_cell: 1 }, { accuracy: 0.1 mm }]";
    for (words, call) in [
        (&["--count", "2", "--seed", "3"][..], "count=2, seed=3"),
        (
            &["--target", "0.1 mm", "--patterns", "patterns.npy"],
            "patterns, target=0.1",
        ),
    ] {
        let line = [
            "accuracy",
            "plain.yaml",
            "-o",
            "out",
            "--json",
            "--reference",
            reference,
            "--methods",
            methods,
        ];
        let ended = workspace.run(&[&line[..], words].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let script = format!(
            "import deaflow, json, numpy
scene, patterns = deaflow.Scene.read('plain.yaml'), numpy.load('patterns.npy')
found = scene.accuracy({call}, reference={{'elements_per_cell': 2, 'order': 2}},
    methods=['linear', {{'elements_per_cell': 1}}, {{'accuracy': '0.1 mm'}}])
print(json.dumps(found))"
        );
        let mut found: Value = serde_json::from_str(&printed(&workspace, &script)).unwrap();
        let mut expected = ended.json();
        let seconds = found["methods"][0]["seconds_per_pattern"].as_f64().unwrap();
        assert!(seconds > 0.0);
        assert_eq!(found["target"]["reached"], expected["target"]["reached"]);
        for document in [&mut found, &mut expected] {
            without_times(document);
        }
        assert_eq!(found, expected, "{call}");
    }
}

/// Removes times, and what depends on them.
fn without_times(document: &mut Value) {
    let object = document.as_object_mut().unwrap();
    object.retain(|key, _| !["files", "target"].contains(&key.as_str()));
    for method in object["methods"].as_array_mut().unwrap() {
        let method = method.as_object_mut().unwrap();
        method.retain(|key, _| !["seconds_per_pattern", "front", "batch"].contains(&key.as_str()));
        for family in method["families"].as_object_mut().unwrap().values_mut() {
            assert!(family.as_object_mut().unwrap().remove("seconds_per_pattern").is_some());
        }
    }
}

#[test]
fn membranes_are_drawn_where_they_have_moved_to() {
    let workspace = with_scenes();
    let error = "import sys; sys.modules['matplotlib'] = None
import deaflow, numpy
scene = deaflow.Scene.read('plain.yaml')
try: scene.plot(scene.solve(numpy.load('patterns.npy')))
except ImportError as error: print(error)";
    assert_eq!(
        printed(&workspace, error),
        "this needs matplotlib: pip install matplotlib\n"
    );
    let look = || readers::python("frameworks", "matplotlib, numpy");
    if let Some(python) = readers::installed("matplotlib, for drawings of membranes", look) {
        script_by(&workspace, &python, "plot.py", "");
    }
}

#[test]
fn gradients_are_those_of_central_differences() {
    script(&Workspace::new(), "gradient.py", "");
}

#[test]
fn derivatives_with_respect_to_parameters_are_those_of_central_differences() {
    script(&Workspace::new(), "parameters.py", "");
}

#[test]
fn designs_have_the_bits_of_a_stage_and_their_search_is_told() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &super::common::scene_file());
    for (name, search) in [
        ("along", "method: adjoint, area: 0.5, units: 20, starts: 1, seed: 1"),
        (
            "ga",
            "population: 60, generations: 3, evaluator: linear, seed: 3, constraints: { keep_out: [{ disc: { centre: \
             [25 mm, 25 mm], radius: 3 mm } }] }",
        ),
    ] {
        let objective = "objective: { point: [25 mm, 25 mm], direction: 0 deg }";
        let stage = format!("stages: {{ design: {{ kind: design, {objective}, {search} }} }}");
        workspace.write(
            &format!("{name}.yaml"),
            &format!("version: 1\nname: {name}\nscene: scene.yaml\n{stage}\n"),
        );
        workspace.stages(&["run", &format!("{name}.yaml")]);
    }
    script(&workspace, "design.py", "");
}

#[test]
fn threads_and_processes_solve_at_the_same_time() {
    let workspace = with_scenes();
    script(&workspace, "processes.py", "threads_and_processes");
    script(&workspace, "processes.py", "other_threads_run");
}

#[test]
fn scenes_results_and_errors_are_pickled() {
    script(&with_scenes(), "processes.py", "pickling");
}

#[test]
fn an_interrupt_ends_a_simulation_within_a_second() {
    script(&with_scenes(), "processes.py", "interrupt");
    script(&with_scenes(), "processes.py", "interrupt_here");
    script(&with_scenes(), "processes.py", "interrupt_design");
}

#[test]
fn scenes_do_not_leak() {
    script(&with_scenes(), "processes.py", "memory");
}

#[test]
fn errors_have_the_text_of_the_command() {
    let workspace = with_scenes();
    workspace.write(
        "wrong.yaml",
        &format!("geometry: {{ side: 50 mm, thicknes: 1 mm }}\n{MATERIAL}"),
    );
    workspace.write("other.yaml", &format!("geometry: {{ side: 50 mm\n{MATERIAL}"));
    for (command, call) in [
        ("wrong.yaml", "Scene.read('wrong.yaml')"),
        ("other.yaml", "Scene.read('other.yaml')"),
        ("plain.yml", "Scene.read('plain.yml')"),
        (
            "plain.yaml --set drive.voltage=4mm",
            "Scene.read('plain.yaml', {'drive.voltage': '4mm'})",
        ),
        (
            "plain.yaml --set drive.volt=4",
            "Scene.read('plain.yaml', {'drive.volt': 4})",
        ),
        ("device.yaml --state puls", "Scene.read('device.yaml').in_state('puls')"),
        (
            "plain.yaml --set geometry.sides={\"top\":\"free\"} --method linear",
            "Scene.read('plain.yaml', {'geometry.sides': {'top': 'free'}}).solve(\
             __import__('numpy').load('patterns.npy'), method='linear')",
        ),
    ] {
        let line = format!("solve {command} patterns.npy --no-checks");
        let ended = workspace.run(&line.split_whitespace().collect::<Vec<_>>());
        assert_eq!(ended.code, Some(2), "{line}: {}", ended.stderr);
        let script = format!("import deaflow\ntry: deaflow.{call}\nexcept deaflow.Error as error: print(error)");
        assert_eq!(
            printed(&workspace, &script).trim_end(),
            ended.stderr.trim_end(),
            "{line}"
        );
    }
    let script = "import deaflow
try: deaflow.Scene.read('wrong.yaml')
except deaflow.Error as error:
    print(error.code, error.file, error.line, error.column, '|', error.message, '|', error.help)";
    snapshot!(printed(&workspace, script));
}

#[test]
fn what_is_not_a_pattern_is_refused() {
    let workspace = with_scenes();
    let mut shown = Transcript::default();
    let groups = "numpy.ones((10, 20), dtype=int)";
    for call in [
        "plain.solve(numpy.zeros((20, 21), dtype=int))",
        "plain.solve(numpy.zeros((0, 20, 20), dtype=int))",
        "plain.solve(numpy.zeros(400, dtype=int))",
        "plain.solve(numpy.full((20, 20), 2))",
        "plain.solve(numpy.full((20, 20), -1))",
        "plain.solve(numpy.full((20, 20), 1.5))",
        "plain.solve(numpy.full((20, 20), numpy.nan))",
        "plain.solve([['a'] * 20] * 20)",
        "plain.solve(one, order=3)",
        "plain.solve(one, accuracy='0.1 V')",
        "plain.solve(one, accuracy='0.1 mm', order=2)",
        "plain.solve(one / 2, method='linear')",
        "plain.history(numpy.ones((20, 20), dtype=int))",
        "plain.history(one / 2, at=[1])",
        "plain.history(one, at='1 V')",
        "plain.history(one, at=[1], every=1)",
        "device.history(groups, at=[1])",
        "plain.path(one, 'charge')",
        "plain.path(one, 'load')",
        "plain.modes(one, 3)",
        "plain.modes(one, 0)",
        "plain.response(one, [])",
        "plain.response(one, '1 Hz')",
        "plain.response(one, [1, -1])",
        "plain.response(one, [1, 2], points=3)",
        "inflated.solve(one, cells=True)",
        "inflated.solve(one, accuracy='0.1 mm')",
        "plain.accuracy(one / 2)",
        "plain.accuracy(one > 0, target='1 V')",
        "plain.accuracy(count=0)",
        "plain.accuracy(one > 0, methods=['linear', 'linear'])",
        "plain.accuracy(one > 0, reference={'order': 2}, methods=[{'elements_per_cell': 4, 'order': 2}])",
        "plain.accuracy(one > 0, models=['there-is-none.safetensors'])",
        "plain.value_and_gradient(one, {'point': ['25 mm', '25 mm']})",
        "plain.value_and_gradient(one, {'point': ['25 mm', '60 mm'], 'direction': '0 deg'})",
        "plain.value_and_gradient(one, {'point': ['25 mm', '5 mm'], 'direction': '0 deg', 'time': '1 s'})",
        "deaflow.Scene({'geometry': {'side': '50 mm'}})",
        "deaflow.Scene({'geometry': {'side': '50 mm', 'mask': 'mask.png'}})",
    ] {
        let script = format!(
            "import deaflow, numpy
plain, device = deaflow.Scene.read('plain.yaml'), deaflow.Scene.read('device.yaml')
inflated = deaflow.Scene.read('plain.yaml', {{'loads': {{'pressure': '100 Pa'}}}})
one, groups = numpy.ones((20, 20)), {groups}
try: {call}
except Exception as error: print(type(error).__name__, error, sep=': ')
else: print('no error')"
        );
        let printed = printed(&workspace, &script);
        assert!(printed != "no error\n", "{call}");
        shown.add(call, printed);
    }
    snapshot!(shown);
}

#[test]
fn runs_are_those_of_the_command() {
    let workspace = Workspace::small();
    let stages = workspace.stages(&["run", "small.yaml", "--store", "other"]);
    let script = r#"
import deaflow, json
run = deaflow.run("small.yaml")
print(json.dumps({name: run[name].digest for name in run}))
again = deaflow.run("small.yaml", {"stages.small.seed": 7}, until="solved", jobs=1)
assert list(again) == ["small", "large", "solved"], list(again)
assert again["large"].digest == run["large"].digest and again["small"].digest != run["small"].digest
assert run["solved"].displacement.shape[1:] == (21, 21, 2)
try: deaflow.run("small.yaml", {"stages.small.sed": 7})
except deaflow.Error as error: print(error.code, error)
"#;
    let printed = printed(&workspace, script);
    let (digests, error) = printed.split_once('\n').unwrap();
    let digests: std::collections::BTreeMap<String, String> = serde_json::from_str(digests).unwrap();
    assert_eq!(digests, stages.digests());
    let ended = workspace.run(&["run", "small.yaml", "--set", "stages.small.sed=7"]);
    assert_eq!(error.trim_end(), format!("2 {}", ended.stderr.trim_end()));
}

#[test]
fn the_command_of_the_package_reads_foreign_files_in_another_process() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &super::common::scene_file());
    workspace.write("one.csv", &csv(|x, y| x < 20 && y < 30));
    let ended = workspace.run(&["solve", "scene.yaml", "one.csv", "--no-checks", "-o", "one.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let command = [
        "-m",
        "deaflow",
        "solve",
        "scene.yaml",
        "one.h5:/patterns",
        "--no-checks",
        "-o",
        "again.h5",
    ];
    let output = run(&workspace, &command);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let script = "import h5py
one, again = (h5py.File(name)['displacement'][:] for name in ('one.h5', 'again.h5'))
print((one == again).all())";
    assert_eq!(printed(&workspace, script), "True\n");
    let version = run(&workspace, &["-m", "deaflow", "--version"]);
    assert_eq!(
        String::from_utf8_lossy(&version.stdout),
        workspace.run(&["--version"]).stdout
    );
}

/// PyTorch is tried where somebody has put it beside JAX.
#[test]
fn functions_of_other_frameworks_are_differentiable() {
    let look = || readers::python("frameworks", "jax, mypy, numpy");
    let Some(python) = readers::find("JAX and mypy, for the Python package", look) else {
        return;
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let workspace = Workspace::new();
    let script = root.join("tests/it/python/frameworks.py");
    let output = run_by(&workspace, &python, &[script.to_str().unwrap()]);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(text(&output.stdout).contains("jax"), "{}", text(&output.stderr));
    let config = root.join("pyproject.toml");
    let cache = workspace.path("cache");
    let arguments = [
        "-m",
        "mypy",
        "--config-file",
        config.to_str().unwrap(),
        "--cache-dir",
        cache.to_str().unwrap(),
    ];
    let sources = root.join("src/python/package/deaflow");
    let checked = run_by(
        &workspace,
        &python,
        &[&arguments[..], &[sources.to_str().unwrap()]].concat(),
    );
    assert!(checked.status.success(), "{}", text(&checked.stdout));
}

#[test]
fn numpy_is_imported_when_it_is_needed_and_no_other_package() {
    let script = r#"
import sys, time
start = time.perf_counter()
import deaflow
seconds = time.perf_counter() - start
assert "numpy" not in sys.modules
assert deaflow.Scene.__module__ == deaflow.open.__module__ == "deaflow" and "Scene" in dir(deaflow)
assert "numpy" in sys.modules and not {"h5py", "xarray", "pandas", "matplotlib"} & set(sys.modules)
print(seconds)
"#;
    let seconds: f64 = printed(&Workspace::new(), script).trim().parse().unwrap();
    // The machine may be busy with other tests; the library is several times larger than an optimised one.
    assert!(seconds < 1.0, "{seconds} s");
    let command = "import sys; sys.modules['numpy'] = None
from deaflow.__main__ import main; sys.argv = ['deaflow', '--version']; sys.exit(main())";
    assert!(printed(&Workspace::new(), command).starts_with("deaflow "));
}

/// The wheel itself takes a release build: `make wheel` tries it.
#[test]
fn the_metadata_of_the_wheel_fit_the_package() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = r#"
import importlib, pathlib, re, sys, tomllib
root = pathlib.Path(sys.argv[1])
about = tomllib.loads((root / "pyproject.toml").read_text())
crate = tomllib.loads((root / "Cargo.toml").read_text())["workspace"]
project, build = about["project"], about["tool"]["maturin"]
assert (root / build["manifest-path"]).is_file()
sources = root / build["python-source"]
package, library = build["module-name"].split(".")
assert hasattr(importlib.import_module(f"{package}.{library}"), "Scene")
assert {"py.typed", f"{library}.pyi"} <= {file.name for file in (sources / package).iterdir()}
module, function = project["scripts"]["deaflow"].split(":")
assert callable(getattr(importlib.import_module(module), function))
import deaflow
assert project["dynamic"] == ["version"] and deaflow.__version__ == crate["package"]["version"]
# One library for all versions of CPython from the least one on.
abi = next(one for one in crate["dependencies"]["pyo3"]["features"] if one.startswith("abi3-py3"))
assert project["requires-python"] == f">=3.{abi.removeprefix('abi3-py3')}"
assert project["license"] == crate["package"]["license"] and list(root.glob(project["license-files"][0]))
texts = "".join(file.read_text() for file in (sources / package).glob("*.py"))
named = {one for extra in project["optional-dependencies"].values() for one in extra}
assert set(re.findall(r'needed\("(\w+)', texts)) == named, named
print(len(named))
"#;
    let output = run(&Workspace::new(), &["-c", script, root.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_package_that_only_sys_path_leads_to_reads_files_in_processes_of_its_own() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--until", "small"]);
    std::fs::create_dir(workspace.path("elsewhere")).unwrap();
    install(&workspace.path("elsewhere"));
    let message = |before: &str| {
        let script = format!(
            "import sys; sys.path.insert(0, 'elsewhere'); {before}
import deaflow
try: deaflow.Model.read('small', store='store')
except deaflow.Error as error: print(error.message)"
        );
        let mut command = workspace.dressed(&super::h5py::python());
        let output = command.args(["-B", "-c", &script]).output().unwrap();
        String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
    };
    let read = message("");
    assert!(read.contains("of kind `sample` is not a model"), "{read}");
    // The message does not blame the file.
    let not_started = message("sys.executable = 'false'");
    assert!(
        not_started.contains("false -m deaflow read-hdf5` ended at once (exit status: 1)"),
        "{not_started}"
    );
    assert!(!not_started.contains("damaged"), "{not_started}");
}

fn printed(workspace: &Workspace, script: &str) -> String {
    let output = python(workspace, script);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// All that the module says of an artifact, in the words of `deaflow show --json`.
const SHOW: &str = r#"
import json, sys, deaflow
for name in ("tiny:solved", "verified", "tiny.yaml:surrogate"):
    artifact = deaflow.open("store", name)
    datasets = {}
    for path, values in artifact.items():
        about = {"shape": list(values.shape), "units": artifact.units[path]}
        assert values.shape == artifact.shapes[path] and len(artifact.dims[path]) == values.ndim
        assert len(artifact.descriptions[path]) > 5
        if values.dtype.kind == "U":
            about["texts"] = sorted(set(values.tolist()))
        elif values.size:
            about["min"], about["max"] = float(values.min()), float(values.max())
        datasets[path] = about
    print(json.dumps({"digest": artifact.digest, "kind": artifact.kind, "attributes": artifact.attributes,
                      "provenance": artifact.provenance, "datasets": datasets}))
"#;

#[test]
fn the_module_reads_what_the_program_shows() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml"]);
    let lines = printed(&workspace, SHOW);
    for (stage, line) in ["solved", "verified", "surrogate"].iter().zip(lines.lines()) {
        let read: Value = serde_json::from_str(line).unwrap();
        let shown = workspace.run(&["show", stage, "--json"]).json();
        for key in ["digest", "attributes", "provenance"] {
            assert_eq!(read[key], shown[key], "{stage}: {key}");
        }
        assert_eq!(read["kind"], shown["provenance"]["kind"]);
        for dataset in shown["datasets"].as_array().unwrap() {
            let path = dataset["path"].as_str().unwrap();
            // Texts of any length are one array.
            if path.ends_with("/text") || path.ends_with("/length") {
                assert!(
                    read["datasets"][path.rsplit_once('/').unwrap().0]["texts"].is_array(),
                    "{path}"
                );
                continue;
            }
            let found = &read["datasets"][path];
            assert_eq!(
                (&found["shape"], &found["units"]),
                (&dataset["shape"], &dataset["units"]),
                "{stage}: {path}"
            );
            let told = &dataset["statistics"];
            if let Some(counts) = told["counts"].as_object() {
                assert_eq!(
                    found["texts"].as_array().unwrap().len(),
                    counts.len(),
                    "{stage}: {path}"
                );
            } else {
                assert_eq!(
                    (&found["min"], &found["max"]),
                    (&told["min"], &told["max"]),
                    "{stage}: {path}"
                );
            }
        }
    }
}

#[test]
fn runs_are_listed_and_names_lead_to_the_last_of_them() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.seed=7"]);
    let script = r#"
import deaflow
last, first = deaflow.runs("store")
assert first.created < last.created and last.overrides == {"stages.small.seed": "7"}
assert deaflow.runs("store", "small") == deaflow.runs("store", "small.yaml") == [last, first]
assert deaflow.runs("store", "other") == []
assert deaflow.open("store", "small").digest == last.stages["small"] != first.stages["small"]
assert deaflow.open("store", first.stages["small"][:8]).digest == first.stages["small"]
assert last.results["solved.samples"] == len(deaflow.open("store", "solved")["family"])
print(last.id)
"#;
    let log = workspace.run(&["log", "--json"]).json();
    assert_eq!(
        printed(&workspace, script).trim(),
        log["runs"][0]["id"].as_str().unwrap()
    );
}

#[test]
fn wrong_names_and_damage_raise_errors() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let error = |script: &str| {
        let output = python(&workspace, &format!("import deaflow\n{script}"));
        assert!(!output.status.success(), "{script}");
        let text = String::from_utf8(output.stderr).unwrap();
        text.lines().last().unwrap_or_default().to_owned()
    };
    let mut printed = Transcript::default();
    for (script, parts) in [
        ("deaflow.open('store', 'solvd')", ["NotFound: ", "'solved'"]),
        ("deaflow.open('store', 'smal:solved')", ["NotFound: ", "'small'"]),
        (
            "deaflow.open('store', 'other.yaml:solved')",
            ["NotFound: ", "'other.yaml'"],
        ),
        ("deaflow.open('store', 'solved')['displacemen']", ["", "'displacement'"]),
        ("deaflow.open('nowhere', 'solved')", ["StoreError: ", "nowhere"]),
        ("deaflow.load('small.yaml')", ["StoreError: ", "small.yaml"]),
    ] {
        let message = error(script);
        for part in parts {
            assert!(message.contains(part), "{script}: {message}");
        }
        printed.add(script, message);
    }
    for package in ["xarray", "pandas"] {
        let script =
            format!("import sys; sys.modules['{package}'] = None; deaflow.open('store', 'solved').to_{package}()");
        let message = error(&script);
        assert!(
            message.contains("ImportError: ") && message.contains(package),
            "{message}"
        );
        printed.add(format!("without {package}"), message);
    }
    // A chunk that is gone shows no numbers that look like data.
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let chunk = shown["parts"][0].as_str().unwrap();
    let path = files(&workspace.path("store/objects"))
        .into_iter()
        .find(|path| path.to_string_lossy().contains(chunk));
    std::fs::remove_file(path.unwrap()).unwrap();
    let message = error("deaflow.open('store', 'solved')");
    assert!(
        message.contains("StoreError: ") && message.contains(&chunk[..12]),
        "{message}"
    );
    printed.add("a missing chunk", message);
    snapshot!(printed);
}

#[test]
fn an_exported_artifact_is_loaded_without_its_store() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let ended = workspace.run(&["export", "artifact", "solved", "-o", "solved.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let script = r#"
import deaflow, numpy as np
alone, whole = deaflow.load("solved.h5"), deaflow.open("store", "solved")
assert alone.digest == whole.digest and alone.attributes == whole.attributes and alone.dims == whole.dims
assert list(alone) == list(whole) and all(np.array_equal(alone[name], whole[name]) for name in whole)
print(len(alone))
"#;
    assert!(printed(&workspace, script).trim().parse::<u32>().unwrap() > 8);
}
