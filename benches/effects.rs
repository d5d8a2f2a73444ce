//! What each effect costs: a solve with it against one without any, side by side in one run.
//!
//! `cargo bench --bench effects`. Bilinear elements, 100² of them, random small-grid patterns (1250 of 2500 cells
//! active) in the default scene, relative residual 1e-8. Times are those that the thread was on a core
//! (`/proc/thread-self/schedstat`); all effects take turns, and the best of five rounds counts.

mod effect_set;

use deaflow::base::{Stream, thread_seconds};
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::Simulator;
use deaflow::pattern::{CELLS, Pattern, Raster};
use deaflow::scene::laws::{ArrudaBoyce, Yeoh};
use deaflow::scene::{Effects, On, Scene, Stiffening};
use effect_set::{THREE_TERMS, all_with, decay, decimal, electrode, gent, ogden, stress};

const PATTERNS: u64 = 24;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread can be started");
    let patterns: Vec<Pattern> = (0..PATTERNS).map(small_grid).collect();
    let solvers: Vec<(&str, MembraneSolver)> = cases().into_iter().map(|(name, e)| (name, solver(e))).collect();
    let mut best = vec![f64::INFINITY; solvers.len()];
    let mut steps = vec![0; solvers.len()];
    for _ in 0..5 {
        for (at, (_, solver)) in solvers.iter().enumerate() {
            pool.install(|| {
                let start = thread_seconds();
                let results = solver.simulate(&patterns);
                best[at] = best[at].min(thread_seconds() - start);
                assert!(results.iter().all(|result| result.outcome.is_converged()));
                steps[at] = results.iter().map(|result| result.newton_iterations).sum();
            });
        }
    }
    println!("effect                      ms per solve  ratio  Newton steps");
    for (at, (name, _)) in solvers.iter().enumerate() {
        println!(
            "{name:<26}  {:>12.3}  {:>5.2}  {:>12.2}",
            1e3 * best[at] / PATTERNS as f64,
            best[at] / best[0],
            f64::from(steps[at]) / PATTERNS as f64
        );
    }
}

fn solver(effects: Effects) -> MembraneSolver {
    let scene = Scene {
        effects,
        ..Scene::vhb4910()
    };
    MembraneSolver::new(&scene, SolveOptions::default()).expect("a valid scene")
}

fn cases() -> Vec<(&'static str, Effects)> {
    let stiffening = |law| Effects {
        strain_stiffening: Some(law),
        ..Effects::default()
    };
    vec![
        ("none", Effects::default()),
        ("Gent", stiffening(gent())),
        (
            "Yeoh",
            stiffening(Stiffening::Yeoh(Yeoh {
                c2: stress(0.0),
                c3: stress(3.0),
            })),
        ),
        (
            "Arruda-Boyce",
            stiffening(Stiffening::ArrudaBoyce(ArrudaBoyce {
                locking_stretch: decimal(6.0),
            })),
        ),
        ("Ogden, one term", stiffening(ogden(&[(45e3, 2.0)]))),
        ("Ogden, three terms", stiffening(ogden(&THREE_TERMS))),
        (
            "electrode stiffness",
            Effects {
                electrode_stiffness: Some(electrode()),
                ..Effects::default()
            },
        ),
        (
            "falling permittivity",
            Effects {
                stretch_dependent_permittivity: Some(decay()),
                ..Effects::default()
            },
        ),
        (
            "fringe field",
            Effects {
                fringe_field: Some(On {}),
                ..Effects::default()
            },
        ),
        (
            "wrinkling",
            Effects {
                wrinkling: Some(On {}),
                ..Effects::default()
            },
        ),
        ("Gent and all others", all_with(gent())),
    ]
}

/// Half of the cells, drawn without replacement.
fn small_grid(index: u64) -> Pattern {
    let mut stream = Stream::new(1, "effects benchmark", index);
    let mut active = vec![0; CELLS * CELLS];
    for cell in stream.choose(CELLS * CELLS, CELLS * CELLS / 2) {
        active[cell] = 1;
    }
    Pattern::from_cells(Raster::PAPER, &active).expect("cells are 0 or 1")
}
