//! What steps in time cost beside the static solve of the same mesh and law.
//!
//! `cargo bench --bench histories`. VHB 4910 with three branches (`pipelines/scenes/vhb4910-linear.yaml`), a step of
//! voltage held for 10 s, random patterns of 10² blocks, bilinear elements, one core. `Newton` solves for the state of
//! every step, `chord:1` estimates it by one chord step and `linear` by one linear system; `Newton, energies` has
//! charge and energies of every step too, as `deaflow solve --history` writes them. Steps are those of all passes.
//! Times are those that the thread was on a core; all kinds take turns, and the best of five rounds counts. With names
//! behind `--` only kinds that begin so are measured.

use std::path::Path;

use deaflow::base::{Stream, thread_seconds};
use deaflow::fem::{HistoryRequest, MembraneSolver, SolveOptions, StepEstimate};
use deaflow::field::{Mesh, Simulator};
use deaflow::pattern::{Pattern, Raster};
use deaflow::scene::Scene;

const PATTERNS: u64 = 4;
const ROUNDS: usize = 5;
/// Static solves of all patterns in a round.
const STATICS: usize = 20;

/// How states are found, and whether energies are wanted.
type Kind = (&'static str, Option<StepEstimate>, bool);

const KINDS: [Kind; 4] = [
    ("Newton", None, false),
    ("Newton, energies", None, true),
    ("chord:1", Some(StepEstimate::Chord(1)), false),
    ("linear", Some(StepEstimate::Linear), false),
];

fn main() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread can be started");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/scenes/vhb4910-linear.yaml");
    let scene = Scene::load(&file).expect("a scene of the repository");
    let patterns: Vec<Pattern> = (0..PATTERNS).map(blocks).collect();
    let names: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |(name, ..): &Kind| names.is_empty() || names.iter().any(|wanted| name.starts_with(wanted));
    let kinds: Vec<Kind> = KINDS.into_iter().filter(wanted).collect();
    println!("elements  method            ms per pattern    steps  ms per step  100 steps in statics");
    for per_cell in [1, 2] {
        let mesh = Mesh::bilinear(per_cell);
        let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).expect("a valid scene");
        pool.install(|| report(&solver, &patterns, &kinds, 50 * per_cell));
    }
}

fn report(solver: &MembraneSolver, patterns: &[Pattern], kinds: &[Kind], side: usize) {
    let (mut best_static, mut best) = (f64::INFINITY, vec![f64::INFINITY; kinds.len()]);
    let mut steps = vec![0; kinds.len()];
    let count = patterns.len() as f64;
    for _ in 0..ROUNDS {
        // Systems count time on a core in ticks of some milliseconds.
        let start = thread_seconds();
        for _ in 0..STATICS {
            let results = solver.simulate(patterns);
            assert!(results.iter().all(|result| result.outcome.is_converged()));
        }
        best_static = best_static.min((thread_seconds() - start) / (STATICS as f64 * count));
        for (at, (name, estimate, measures)) in kinds.iter().copied().enumerate() {
            let request = HistoryRequest {
                estimate,
                measures,
                ..HistoryRequest::at(vec![10.0])
            };
            let start = thread_seconds();
            let histories = patterns.iter().map(|pattern| solver.history(pattern, &request));
            let histories: Vec<_> = histories.collect::<Result<_, _>>().expect("the scene can be followed");
            best[at] = best[at].min((thread_seconds() - start) / count);
            assert!(histories.iter().all(|history| history.fields.len() == 1), "{name}");
            steps[at] = histories.iter().map(|history| history.steps).sum();
        }
    }
    println!("{side:>7}²  {:<16}  {:>14.2}", "static", 1e3 * best_static);
    for ((name, ..), (seconds, steps)) in kinds.iter().zip(best.into_iter().zip(steps)) {
        let steps = steps as f64 / count;
        println!(
            "{side:>7}²  {name:<16}  {:>14.2}  {steps:>7.1}  {:>11.3}  {:>20.1}",
            1e3 * seconds,
            1e3 * seconds / steps,
            100.0 * seconds / steps / best_static
        );
    }
}

/// Half of 10² blocks of cells, drawn without replacement.
fn blocks(index: u64) -> Pattern {
    let drawn = Stream::new(1, "histories benchmark", index).choose(100, 50);
    Pattern::from_fn(Raster::PAPER, |x, y| drawn.contains(&(y / 5 * 10 + x / 5)))
}
