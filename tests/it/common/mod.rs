//! A hermetic place to run the real binary in: its own folder, its own store, no inherited settings.

pub mod bounded;
pub mod compare;
pub mod readers;
pub mod snapshots;

pub use snapshots::Transcript;
pub(crate) use snapshots::snapshot;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// The scene of all pipelines here, of a number of cells along each side.
macro_rules! scene {
    ($cells:literal) => {
        concat!(
            "  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: ",
            $cells,
            " }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5.25 kV }
  effects: {}
"
        )
    };
}

/// A pipeline in that scene.
macro_rules! pipeline {
    ($name:literal, $cells:literal, $stages:literal) => {
        concat!(
            "version: 1\nname: ",
            $name,
            "\nscene:\n",
            scene!($cells),
            "stages:\n",
            $stages
        )
    };
}

/// Every kind of stage at a size that takes a second.
pub const TINY: &str = pipeline!(
    "tiny",
    50,
    "  small:     { kind: sample, family: small-grid, count: 60, seed: 1 }
  large:     { kind: sample, family: large-grid, units: [2, 3], count_per_units: 8, seed: 2 }
  bezier:    { kind: sample, family: bezier, count: 8, seed: 3 }
  solved:    { kind: solve, needs: [small, large, bezier], elements_per_cell: 1 }
  balanced:  { kind: balance, needs: [solved], bins: 20, range: [0 mm, 2.5 mm], target: 60, symmetry: d4, seed: 4 }
  surrogate: { kind: train, needs: [balanced], network: qin2024, epochs: 1, seed: 5 }
  design:    { kind: design, needs: [surrogate], evaluator: surrogate, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, population: 20, generations: 2, seed: 6 }
  verified:  { kind: verify, needs: [design], elements_per_cell: 1 }
  reference: { kind: solve, needs: [bezier], elements_per_cell: 2 }
  accuracy:  { kind: accuracy, needs: [reference], methods: [{ method: linear, elements_per_cell: 1 }, { elements_per_cell: 1 }] }
"
);

/// A pipeline that takes a fraction of a second: three samples of chunks, a manifest, a whole artifact with a figure.
pub const SMALL: &str = pipeline!(
    "small",
    20,
    "  small:    { kind: sample, family: small-grid, count: 4, seed: 1 }
  large:    { kind: sample, family: large-grid, units: [2], count_per_units: 2, seed: 2 }
  solved:   { kind: solve, needs: [small, large], elements_per_cell: 1 }
  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2.5 mm], target: 4, symmetry: d4, seed: 4 }
"
);

/// Two stages are enough where one is to be chunked and one is to need it.
pub const SHORT: &str = pipeline!(
    "short",
    20,
    "  small:  { kind: sample, family: small-grid, count: 60, seed: 1 }
  solved: { kind: solve, needs: [small], elements_per_cell: 1 }
"
);

/// The scene as a file of its own.
pub fn scene_file() -> String {
    scene!(50).lines().map(|line| format!("{}\n", &line[2..])).collect()
}

/// The scene with fewer cells, where their number does not matter: a solution takes a fifth of the time. That of
/// [`SMALL`] and [`SHORT`].
pub fn scene_of_20_cells() -> String {
    scene_file().replace("cells: 50", "cells: 20")
}

/// A pipeline that names `scene.yaml` in place of the scene in it, and its stages alone.
pub fn with_scene_in_a_file(pipeline: &str) -> (String, &str) {
    let (header, _) = pipeline.split_once("scene:\n").unwrap();
    let (_, stages) = pipeline.split_once("stages:\n").unwrap();
    (format!("{header}scene: scene.yaml\nstages:\n{stages}"), stages)
}

/// A folder that is removed at the end, and one for what a command keeps for its user.
pub struct Workspace {
    folder: tempfile::TempDir,
    user: tempfile::TempDir,
}

/// How a command ended.
pub struct Ended {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Workspace {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            user: tempfile::tempdir().unwrap(),
        }
    }

    /// With `tiny.yaml` in it.
    pub fn tiny() -> Self {
        let workspace = Self::new();
        workspace.write("tiny.yaml", TINY);
        workspace
    }

    /// With `small.yaml` in it.
    pub fn small() -> Self {
        let workspace = Self::new();
        workspace.write("small.yaml", SMALL);
        workspace
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    /// The command, ready to be started.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = self.dressed(env!("CARGO_BIN_EXE_deaflow"));
        command.args(arguments);
        command
    }

    /// Any other program, in the workspace, without inherited settings and without the cache and the configuration of
    /// the user.
    pub fn dressed(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.folder.path());
        for setting in [
            "DEAFLOW_STORE",
            "DEAFLOW_REMOTE",
            "DEAFLOW_CONFIG",
            "DEAFLOW_JOBS",
            "CLICOLOR",
            "CLICOLOR_FORCE",
            "RAYON_NUM_THREADS",
            "RUST_BACKTRACE",
            "NO_COLOR",
        ] {
            command.env_remove(setting);
        }
        command.env("XDG_CACHE_HOME", self.user.path().join("cache"));
        command.env("XDG_CONFIG_HOME", self.user.path().join("config"));
        // What the tests themselves have open is inherited, with its locks, by whatever they start meanwhile.
        command.env("HDF5_USE_FILE_LOCKING", "FALSE");
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Ended {
        Ended::from(self.command(arguments).output().unwrap())
    }

    /// Runs a pipeline and returns its stages; the exit code must be 0.
    pub fn stages(&self, arguments: &[&str]) -> Stages {
        let ended = self.run(&[arguments, &["--json"]].concat());
        assert_eq!(ended.code, Some(0), "{}\n{}", ended.stdout, ended.stderr);
        Stages::read(&ended.json())
    }
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Ended {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {}\n{}", self.stdout, self.stderr))
    }
}

/// Starts a command whose output is wanted at its end.
pub fn started(mut command: Command) -> Child {
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// How what was started has ended.
pub fn ended(child: Child) -> Ended {
    child.wait_with_output().unwrap().into()
}

/// The `stages` of a run or plan.
pub struct Stages(Vec<Value>);

impl Stages {
    /// Those of what was started with `--json`, and must have succeeded.
    pub fn of(child: Child) -> Self {
        let ended = ended(child);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        Self::read(&ended.json())
    }

    pub fn read(document: &Value) -> Self {
        Self(
            document["stages"]
                .as_array()
                .unwrap_or_else(|| panic!("no stages in {document}"))
                .clone(),
        )
    }

    pub fn names(&self) -> Vec<&str> {
        self.0.iter().map(|s| s["name"].as_str().unwrap()).collect()
    }

    /// Names of the stages with an outcome.
    pub fn with(&self, outcome: &str) -> Vec<&str> {
        let of = |s: &&Value| s["outcome"] == outcome;
        self.0.iter().filter(of).map(|s| s["name"].as_str().unwrap()).collect()
    }

    pub fn stage(&self, name: &str) -> &Value {
        self.0
            .iter()
            .find(|s| s["name"] == name)
            .unwrap_or_else(|| panic!("no stage {name}"))
    }

    /// (chunks built, chunks reused)
    pub fn chunks(&self, name: &str) -> (u64, u64) {
        let stage = self.stage(name);
        (
            stage["chunks_built"].as_u64().unwrap(),
            stage["chunks_reused"].as_u64().unwrap(),
        )
    }

    /// Digest of every stage.
    pub fn digests(&self) -> BTreeMap<String, String> {
        let pair = |s: &Value| {
            (
                s["name"].as_str().unwrap().to_owned(),
                s["digest"].as_str().unwrap().to_owned(),
            )
        };
        self.0.iter().map(pair).collect()
    }
}

/// All files below a folder.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let Ok(entries) = std::fs::read_dir(folder) else {
        return found;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files(&path))
        } else {
            found.push(path)
        }
    }
    found.sort();
    found
}

/// Width and height of a picture in PNG, in pixels.
pub fn size_of_png(file: &[u8]) -> [u32; 2] {
    assert!(file.starts_with(b"\x89PNG"));
    [16, 20].map(|at| u32::from_be_bytes(file[at..at + 4].try_into().unwrap()))
}

/// A pattern of 50 × 50 cells as a table: a row of `0` and `1` a line.
pub fn csv(active: impl Fn(usize, usize) -> bool) -> String {
    csv_of(50, active)
}

/// A pattern of `cells` × `cells` cells as a table.
pub fn csv_of(cells: usize, active: impl Fn(usize, usize) -> bool) -> String {
    let row = |y| {
        (0..cells)
            .map(|x| if active(x, y) { "1" } else { "0" })
            .collect::<Vec<_>>()
            .join(",")
    };
    (0..cells).map(|y| row(y) + "\n").collect()
}
