//! Patterns and scenes that are difficult for simulators, with known answers if there are any.
//!
//! `cargo bench --bench hard_cases` prints a page of Markdown; docs/accuracy.md has a summary.

#[allow(dead_code, reason = "other benchmarks take the effects one by one")]
mod effect_set;

use std::time::Instant;

use deaflow::base::Stream;
use deaflow::fem::{LoadPath, MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Order, Outcome, Simulator};
use deaflow::pattern::{Pattern, Raster};
use deaflow::scene::Scene;
use effect_set::{THREE_TERMS, all_with, gent, ogden};

const INTRODUCTION: &str = "# Hard cases

Patterns and scenes that are difficult for simulators: features of one cell, patterns that are nearly empty or
nearly full, loads close to and beyond the loss of stability, low and high prestretch.

Each outcome is either a stable and elliptic equilibrium, or a reason with the two voltages between which stability is
lost. The tests `fem::tests::hard` and `fem::tests::paths` recompute residuals and the inertia of the tangent for cases
like these, and compare with known answers.

Features of one cell need more than one bilinear element. With a single element under voltage the critical voltage
is too high by a tenth. With one element per cell a checkerboard does not move: the forces of neighbours cancel.";

const ABOUT_PATHS: &str = "\
Load paths at 25 kPa and λp = 3 (`deaflow solve --path`), with one element per cell of each order, and the outcome of
the solver 1 % below and 1 % above the critical voltage. Known values: for `full` the closed form √κ = √(λ⁻² + 3λ⁻⁸),
for the others an independent analysis with one element per cell of unknown order, in kV with two decimals.";

const ABOUT_EFFECTS: &str = "\
All patterns above at 45 kPa and 3, 6, 9, 20 and 50 kV, one bilinear element per cell, with a stiffening law, a fringe
field, wrinkling, permittivity that decreases with stretch, and stiff electrodes. A solve that exceeds the
work limit (docs/effects.md) ends as `work-limit`.";

fn scattered(share: f64, seed: u64) -> Pattern {
    let mut stream = Stream::new(seed, "hard cases", 0);
    let on: Vec<bool> = (0..2500).map(|_| stream.chance(share)).collect();
    Pattern::from_fn(Raster::PAPER, |x, y| on[y * 50 + x])
}

fn radius(x: usize, y: usize) -> f64 {
    (x as f64 - 24.5).hypot(y as f64 - 24.5)
}

/// Name, pattern, and the voltage in V at which stability is lost at 25 kPa and λp = 3, where it is known.
fn patterns() -> Vec<(&'static str, Pattern, Option<f64>)> {
    vec![
        ("half", Pattern::from_fn(Raster::PAPER, |x, _| x < 25), Some(5500.0)),
        (
            "one cell",
            Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25)),
            Some(4550.0),
        ),
        (
            "disc of radius 15 mm",
            Pattern::from_fn(Raster::PAPER, |x, y| radius(x, y) < 15.0),
            Some(5140.0),
        ),
        (
            "full",
            Pattern::from_fn(Raster::PAPER, |_, _| true),
            Some(1e3 * (closed_form(3.0) / at(3.0, 25e3, 1e3).kappa()).sqrt()),
        ),
        ("empty", Pattern::from_fn(Raster::PAPER, |_, _| false), None),
        (
            "one hole",
            Pattern::from_fn(Raster::PAPER, |x, y| (x, y) != (25, 25)),
            None,
        ),
        (
            "checkerboard",
            Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0),
            None,
        ),
        (
            "stripes of one cell",
            Pattern::from_fn(Raster::PAPER, |x, _| x % 2 == 0),
            None,
        ),
        ("staircase", Pattern::from_fn(Raster::PAPER, |x, y| x > y), None),
        (
            "ring one cell wide",
            Pattern::from_fn(Raster::PAPER, |x, y| (14.0..15.0).contains(&radius(x, y))),
            None,
        ),
        (
            "along the frame",
            Pattern::from_fn(Raster::PAPER, |x, y| x.min(y) < 2 || x.max(y) > 47),
            None,
        ),
        ("1 % at random", scattered(0.01, 1), None),
        ("50 % at random", scattered(0.5, 2), None),
        ("99 % at random", scattered(0.99, 3), None),
    ]
}

fn closed_form(prestretch: f64) -> f64 {
    prestretch.powi(-2) + 3.0 * prestretch.powi(-8)
}

fn at(prestretch: f64, modulus: f64, voltage: f64) -> Scene {
    Scene::with_values(50.0, 1.0, prestretch, modulus, 4.7, voltage)
}

fn solver(scene: &Scene, elements_per_cell: usize, order: Order) -> MembraneSolver {
    let options = SolveOptions::on(Mesh::new(elements_per_cell, order));
    MembraneSolver::new(scene, options).expect("a valid mesh")
}

/// Kind, critical voltage, the known one, their difference, and the displacement there.
fn limit_columns(path: &LoadPath, known: Option<f64>) -> String {
    let Some(limit) = path.limit() else {
        return "none | – | – | – | –".to_owned();
    };
    let (shown, difference) = known.map_or(("–".to_owned(), "–".to_owned()), |known| {
        (
            format!("{known:.1}"),
            format!("{:+.2} %", 100.0 * (limit.voltage / known - 1.0)),
        )
    });
    let displacement = path.points[limit.point].max_displacement;
    format!(
        "{} | {:.1} | {shown} | {difference} | {displacement:.4}",
        limit.kind.name(),
        limit.voltage
    )
}

fn paths() {
    println!("\n## Critical voltages\n");
    println!("{ABOUT_PATHS}\n");
    println!(
        "| pattern | order | limit | critical V | known V | difference | displacement mm | path s | 1 % below \
         | 1 % above |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (name, pattern, known) in patterns() {
        for order in [Order::Bilinear, Order::Biquadratic] {
            let start = Instant::now();
            let path = solver(&at(3.0, 25e3, 1e3), 1, order)
                .path(&pattern)
                .expect("enough memory");
            let seconds = start.elapsed().as_secs_f64();
            let said = [0.99, 1.01].map(|share| {
                path.limit().map_or("–", |limit| {
                    let solver = solver(&at(3.0, 25e3, share * limit.voltage), 1, order);
                    solver.simulate(std::slice::from_ref(&pattern))[0].outcome.name()
                })
            });
            println!(
                "| {name} | {} | {} | {seconds:.1} | {} | {} |",
                order.degree(),
                limit_columns(&path, known),
                said[0],
                said[1]
            );
        }
    }
}

fn uniform() {
    println!("\n## Fully active membrane\n");
    println!("It never moves, and becomes unstable at √κ = √(λ⁻² + 3λ⁻⁸), here at 45 kPa on bilinear elements.\n");
    println!("| λp | limit | critical V | known V | difference | displacement mm |");
    println!("|---|---|---|---|---|---|");
    for prestretch in [1.2, 1.5, 2.0, 3.0, 4.0, 6.0] {
        let scene = at(prestretch, 45e3, 1e3);
        let known = 1e3 * (closed_form(prestretch) / scene.kappa()).sqrt();
        let path = solver(&scene, 1, Order::Bilinear).path(&Pattern::from_fn(Raster::PAPER, |_, _| true));
        println!(
            "| {prestretch} | {} |",
            limit_columns(&path.expect("enough memory"), Some(known))
        );
    }
}

/// How often each outcome occurs, and the slowest solve.
#[derive(Default)]
struct Tally {
    converged: u32,
    pull_in: u32,
    not_elliptic: u32,
    slack: u32,
    work_limit: u32,
    other: u32,
    slowest: f64,
    case: String,
}

impl Tally {
    fn solve_all(&mut self, solver: &MembraneSolver, kilovolts: f64) {
        for (name, pattern, _) in patterns() {
            let start = Instant::now();
            let result = solver.simulate(std::slice::from_ref(&pattern)).remove(0);
            let seconds = start.elapsed().as_secs_f64();
            self.add(result.outcome, seconds, || format!("{name}, {kilovolts} kV"));
        }
    }

    fn add(&mut self, outcome: Outcome, seconds: f64, case: impl FnOnce() -> String) {
        match outcome {
            Outcome::Converged => self.converged += 1,
            Outcome::PullIn { .. } => self.pull_in += 1,
            Outcome::NotElliptic { .. } => self.not_elliptic += 1,
            Outcome::Slack { .. } => self.slack += 1,
            Outcome::WorkLimit => self.work_limit += 1,
            _ => self.other += 1,
        }
        if seconds > self.slowest {
            (self.slowest, self.case) = (seconds, case());
        }
    }
}

fn sweep() {
    println!("\n## Outcomes and times\n");
    println!(
        "All patterns above at 45 kPa and ten voltages from 1 kV to 50 kV. Every solve ends; seconds are those of one \
         core.\n"
    );
    println!("| elements per cell | λp | converged | pull-in | not elliptic | other | slowest s | slowest case |");
    println!("|---|---|---|---|---|---|---|---|");
    for elements_per_cell in [1, 2] {
        for prestretch in [1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 6.0] {
            let mut tally = Tally::default();
            for kilovolts in [1.0, 3.0, 5.0, 6.0, 7.0, 8.0, 9.0, 12.0, 20.0, 50.0] {
                let solver = solver(
                    &at(prestretch, 45e3, 1e3 * kilovolts),
                    elements_per_cell,
                    Order::Bilinear,
                );
                tally.solve_all(&solver, kilovolts);
            }
            println!(
                "| {elements_per_cell} | {prestretch} | {} | {} | {} | {} | {:.2} | {} |",
                tally.converged,
                tally.pull_in,
                tally.not_elliptic,
                tally.slack + tally.work_limit + tally.other,
                tally.slowest,
                tally.case
            );
        }
    }
}

fn all_effects() {
    println!("\n## With all effects on\n");
    println!("{ABOUT_EFFECTS}\n");
    println!(
        "| law | λp | converged | pull-in | not elliptic | slack | work-limit | other | slowest s | slowest case |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (law, stiffening) in [("Gent", gent()), ("Ogden, three terms", ogden(&THREE_TERMS))] {
        for prestretch in [1.05, 1.5, 3.0, 5.0] {
            let mut tally = Tally::default();
            for kilovolts in [3.0, 6.0, 9.0, 20.0, 50.0] {
                let scene = Scene {
                    effects: all_with(stiffening.clone()),
                    ..at(prestretch, 45e3, 1e3 * kilovolts)
                };
                tally.solve_all(&solver(&scene, 1, Order::Bilinear), kilovolts);
            }
            println!(
                "| {law} | {prestretch} | {} | {} | {} | {} | {} | {} | {:.2} | {} |",
                tally.converged,
                tally.pull_in,
                tally.not_elliptic,
                tally.slack,
                tally.work_limit,
                tally.other,
                tally.slowest,
                tally.case
            );
        }
    }
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("one thread");
    pool.install(|| {
        println!("{INTRODUCTION}");
        paths();
        uniform();
        sweep();
        all_effects();
    });
}
