//! What the store and the orchestrator cost beside the work itself.
//!
//! `cargo bench --bench orchestrator`: a toy kind whose chunks are arrays of a few numbers, through the public API.
//! Each case runs in a process of its own, so that its peak memory is its own. A rerun opens the store anew each time,
//! as a process does. The share of the disk is what the same files cost when they are only written, synced and renamed.
//! `… -- --case NAME CHUNKS VALUES` runs one case.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;

use deaflow::base::{Canonical, Document, Fields, InputError, Node, Schema};
use deaflow::orchestrator::{
    Chunk, Environment, Event, Input, Job, Kind, MOST_STAGES, Needs, Pipeline, Plan, Registry, RunOptions, Stage,
    StageError, run,
};
use deaflow::store::{Data, Dataset, Object, Store};
use rayon::prelude::*;

/// Name, chunks and numbers in a chunk of each case.
const CASES: [(&str, u64, u64); 4] = [
    ("7 stages", 7, 8),
    ("1000 chunks", 1000, 8),
    ("1000 chunks of 800 kB", 1000, 100_000),
    ("10,000 chunks", 10_000, 8),
];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(at) = arguments.iter().position(|word| word == "--case") {
        let number = |i: usize| arguments[at + i].parse().expect("a whole number");
        return case(&arguments[at + 1], number(2), number(3));
    }
    println!("case                     build ms/chunk  disk alone  manifest ms    MiB    no-op ms best  median");
    for (name, chunks, values) in CASES {
        let program = std::env::current_exe().expect("this program has a path");
        let status = Command::new(program)
            .args(["--case", name, &chunks.to_string(), &values.to_string()])
            .status()
            .expect("this program runs");
        assert!(status.success(), "{name}: {status}");
    }
}

/// Builds a pipeline, then runs it again and again.
fn case(name: &str, chunks: u64, values: u64) {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder can be made");
    let registry = Registry {
        kinds: vec![&Toy],
        check_scene: |_| Ok(()),
        complete_scene: |_| Ok(()),
        scene_schema: Schema::text,
        most_stages: MOST_STAGES,
    };
    let text = match name {
        "7 stages" => chain(chunks),
        _ => format!(
            "version: 1\nname: toy\nstages:\n  toy: {{ kind: toy, chunks: {chunks}, values: {values}, salt: 0 }}\n"
        ),
    };
    let document = Document::from_text(Path::new("toy.yaml"), &text).expect("the pipeline is YAML");
    let pipeline = Pipeline::read(document, &[], &registry).expect("the pipeline is valid");
    let root = folder.path().join("store");

    let start = Instant::now();
    let manifest = once(&root, &pipeline, true);
    let built = 1e3 * start.elapsed().as_secs_f64() / chunks as f64;
    let memory = peak_memory();
    let disk = disk_alone(folder.path(), &root, chunks);

    let mut times: Vec<f64> = (0..15)
        .map(|_| {
            let start = Instant::now();
            once(&root, &pipeline, false);
            1e3 * start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!(
        "{name:<24} {built:>14.2} {disk:>11.2} {:>12.1} {memory:>6.0} {:>16.2} {:>7.2}",
        1e3 * manifest,
        times[0],
        times[times.len() / 2]
    );
}

/// Stages that need each other in a row.
fn chain(stages: u64) -> String {
    let mut text = String::from("version: 1\nname: toy\nstages:\n");
    for i in 0..stages {
        let needs = match i {
            0 => String::new(),
            _ => format!(", needs: [s{}]", i - 1),
        };
        text += &format!("  s{i}: {{ kind: toy, chunks: 1, values: 8, salt: {i}{needs} }}\n");
    }
    text
}

/// Opens the store and runs; gives the seconds from the last chunk to the end of its stage.
fn once(root: &Path, pipeline: &Pipeline, builds: bool) -> f64 {
    let store = Store::open(root).expect("the store opens");
    let (chunk, manifest) = (Mutex::new(Instant::now()), Mutex::new(0.0));
    let outcome = run(
        pipeline,
        &store,
        &RunOptions::default(),
        &Environment::system(),
        &|event| match event {
            Event::ChunkBuilt { .. } => {
                assert!(builds, "a rerun builds nothing");
                *chunk.lock().expect("no panic") = Instant::now();
            }
            Event::StageFinished(_) => {
                *manifest.lock().expect("no panic") = chunk.lock().expect("no panic").elapsed().as_secs_f64();
            }
            _ => {}
        },
    );
    let failures = outcome.expect("the store can be used").failures;
    assert!(failures.is_empty(), "{failures:?}");
    *manifest.lock().expect("no panic")
}

/// What one of `chunks` artifacts and its record cost when they are only written, synced and renamed, ms.
fn disk_alone(folder: &Path, root: &Path, chunks: u64) -> f64 {
    let (artifact, record) = (a_file(&root.join("objects")), a_file(&root.join("records")));
    let places: Vec<_> = (0..256).map(|i| folder.join(format!("{i:02x}"))).collect();
    for place in &places {
        fs::create_dir(place).expect("a folder can be made");
    }
    let some = chunks.clamp(100, 1000);
    let start = Instant::now();
    (0..some).into_par_iter().for_each(|i| {
        for (name, bytes) in [("artifact", &artifact), ("record", &record)] {
            let place = &places[i as usize % places.len()];
            let aside = folder.join(format!("{name}-{i}"));
            let mut file = File::create(&aside).expect("a file can be made");
            file.write_all(bytes)
                .and_then(|()| file.sync_all())
                .and_then(|()| fs::rename(&aside, place.join(format!("{name}-{i}"))))
                .and_then(|()| File::open(place)?.sync_all())
                .expect("a file can be written");
        }
    });
    1e3 * start.elapsed().as_secs_f64() / some as f64
}

fn a_file(folder: &Path) -> Vec<u8> {
    let within = |folder: &Path| {
        let entry = fs::read_dir(folder).expect("the folder can be read").next();
        entry.expect("it is not empty").expect("it can be read").path()
    };
    fs::read(within(&within(folder))).expect("the file can be read")
}

/// The peak of resident memory, MiB.
fn peak_memory() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}

/// Chunks of numbers that are a function of their index.
struct Toy;

struct ToyStage {
    chunks: u64,
    values: u64,
    salt: u64,
}

impl Kind for Toy {
    fn name(&self) -> &'static str {
        "toy"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["toy"],
            least: 0,
            most: 1,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let whole = || Schema::integer(0, u64::MAX);
        let fields = Fields::new("A toy.");
        vec![
            ["chunks", "values", "salt"]
                .iter()
                .fold(fields, |fields, key| fields.required(key, whole())),
        ]
    }

    fn read(&self, stage: &Node, _: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("a toy", &["kind", "needs", "chunks", "values", "salt"])?;
        let whole = |key: &str| map.required("a toy", key)?.integer(key, 0, u64::MAX);
        Ok(Box::new(ToyStage {
            chunks: whole("chunks")?,
            values: whole("values")?,
            salt: whole("salt")?,
        }))
    }
}

impl ToyStage {
    fn chunk(&self, index: u64, inputs: &[Input]) -> Chunk {
        Chunk {
            parameters: Canonical::map([
                ("index", index.into()),
                ("values", self.values.into()),
                ("salt", self.salt.into()),
            ]),
            inputs: inputs.iter().map(|input| input.digest).collect(),
            samples: 1,
        }
    }
}

impl Stage for ToyStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([
            ("chunks", self.chunks.into()),
            ("values", self.values.into()),
            ("salt", self.salt.into()),
        ])
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Chunks((0..self.chunks).map(|index| self.chunk(index, inputs)).collect())
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let chunk = job.chunk.ok_or_else(|| StageError::failed("a toy has chunks"))?;
        // Whatever tells the chunks apart is a seed of their numbers.
        let seed = chunk.parameters.to_string().bytes().fold(self.salt, |seed, byte| {
            seed.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(u64::from(byte))
        });
        let numbers: Vec<u64> = (0..self.values).map(|i| seed.wrapping_add(i)).collect();
        let shape = [numbers.len()];
        Ok(Object::default().with(
            "numbers",
            Dataset::new("1", "Numbers of a toy", &shape, Data::U64(numbers)),
        ))
    }
}
