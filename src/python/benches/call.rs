//! The call that `Scene.solve` of the Python package makes, without Python: `benches/python.py` runs it by turns with
//! Python.
//!
//! `cargo bench -p deaflow-python --bench call -- SCENE PATTERN ELEMENTS_PER_CELL`. PATTERN is a file with a byte for
//! the electrode group of each cell. For each number that it reads from the standard input it makes as many calls, and
//! prints a line with the time of each in µs and its `solve_seconds` in µs.

use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;

use deaflow::base::Progress;
use deaflow::cli::{Equilibria, SolveRequest};
use deaflow::fem::SolverParameters;
use deaflow::pattern::{Pattern, PatternForm};
use deaflow::stage::direct::{self, Changes};
use deaflow::store::{Data, Object};

type Failure = Box<dyn std::error::Error>;

struct Unseen;

impl Progress for Unseen {
    fn advance(&self, _steps: u64) {}

    fn note(&self, _text: &str) {}
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    if arguments.is_empty() {
        println!("the call of Scene.solve in Rust: benches/python.py --core runs it by turns with Python");
        return Ok(());
    }
    let [scene, pattern, elements_per_cell] = arguments.as_slice() else {
        return Err("give a scene, a pattern and the number of elements along a cell".into());
    };
    let changes = Changes {
        sets: &[],
        voltage: None,
    };
    let scene = direct::read_scene_with(Path::new(scene), changes)?.scene;
    let groups = std::fs::read(pattern)?;
    let parameters = SolverParameters::from_text(&format!("{{ elements_per_cell: {elements_per_cell} }}"))?;
    let equilibria = Equilibria::new(&scene, &parameters).map_err(|error| error.to_text())?;
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let mut times = Vec::new();
        for _ in 0..line?.trim().parse::<usize>()? {
            let start = Instant::now();
            let within = seconds(&call(&equilibria, scene.form(), &groups)?);
            times.push((1e6 * start.elapsed().as_secs_f64(), 1e6 * within));
        }
        let words = times.iter().map(|(time, within)| format!("{time:.2} {within:.2}"));
        writeln!(out, "{}", words.collect::<Vec<_>>().join(" "))?;
        out.flush()?;
    }
    Ok(())
}

/// Simulates a pattern and makes the arrays and warnings that Python is given.
fn call(equilibria: &Equilibria, form: PatternForm, groups: &[u8]) -> Result<Object, Failure> {
    let patterns = [Pattern::of_form(form, groups)?];
    let request = SolveRequest {
        patterns: &patterns,
        drawings: &patterns,
        cells: false,
        checks: false,
    };
    let solved = equilibria.solve(&request, &Unseen).map_err(|error| error.to_text())?;
    std::hint::black_box(solved.warnings());
    Ok(solved.content().in_states(&equilibria.states()))
}

fn seconds(object: &Object) -> f64 {
    match object.datasets.get("solve_seconds").map(|dataset| &dataset.data) {
        Some(Data::F64(seconds)) => seconds.iter().sum(),
        _ => f64::NAN,
    }
}
