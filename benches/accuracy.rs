//! What accuracy costs: error of the displacement and time of a solve, by mesh and kind of pattern.
//!
//! `cargo bench --bench accuracy` prints the table of docs/accuracy.md. Errors are relative, root mean square over the
//! field, against biquadratic elements, 8 per cell; times are those of one core, the mean over a batch.

use std::time::Instant;

use deaflow::base::Stream;
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Field, Mesh, Order, Simulator};
use deaflow::pattern::{Pattern, Raster};
use deaflow::scene::Scene;

/// Patterns with features from half the membrane down to single cells.
fn patterns() -> Vec<(&'static str, Vec<Pattern>)> {
    let grid = |units: usize, seed: u64| {
        let mut stream = Stream::new(seed, "accuracy", units as u64);
        let on: Vec<bool> = (0..units * units).map(|_| stream.chance(0.5)).collect();
        Pattern::from_fn(Raster::PAPER, |x, y| on[y * units / 50 * units + x * units / 50])
    };
    let disc = |seed: u64| {
        let mut stream = Stream::new(seed, "accuracy disc", 0);
        let (x0, y0, r) = (
            stream.range(15.0, 35.0),
            stream.range(15.0, 35.0),
            stream.range(6.0, 14.0),
        );
        Pattern::from_fn(Raster::PAPER, |x, y| {
            (x as f64 + 0.5 - x0).hypot(y as f64 + 0.5 - y0) < r
        })
    };
    let stripes = |width: usize| Pattern::from_fn(Raster::PAPER, |x, _| (x / width).is_multiple_of(2));
    vec![
        ("half plane", vec![Pattern::from_fn(Raster::PAPER, |x, _| x < 25)]),
        ("discs", (0..8).map(disc).collect()),
        ("10 × 10 units", (0..8).map(|s| grid(10, s)).collect()),
        ("stripes of 5 cells", vec![stripes(5)]),
        ("25 × 25 units", (0..8).map(|s| grid(25, s)).collect()),
        ("stripes of 1 cell", vec![stripes(1)]),
        ("50 × 50 units (small grid)", (0..8).map(|s| grid(50, s)).collect()),
        (
            "one single cell",
            vec![Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (20, 30))],
        ),
    ]
}

fn fields(elements_per_cell: usize, order: Order, patterns: &[Pattern]) -> (Vec<Field>, f64) {
    let options = SolveOptions::on(Mesh::new(elements_per_cell, order));
    let solver = MembraneSolver::new(&Scene::vhb4910(), options).expect("a valid mesh");
    let start = Instant::now();
    let solved = solver.simulate(patterns);
    let milliseconds = start.elapsed().as_secs_f64() * 1e3 / patterns.len() as f64;
    (
        solved.into_iter().map(|s| s.field.expect("a stable pattern")).collect(),
        milliseconds,
    )
}

fn rms(field: &Field) -> f64 {
    field.rms_difference(&Field::zero(Raster::PAPER))
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("one thread");
    pool.install(|| {
        let meshes = [
            (1, Order::Bilinear),
            (2, Order::Bilinear),
            (4, Order::Bilinear),
            (1, Order::Biquadratic),
            (2, Order::Biquadratic),
            (4, Order::Biquadratic),
        ];
        let classes = patterns();
        let references: Vec<Vec<Field>> = classes
            .iter()
            .map(|(_, p)| fields(8, Order::Biquadratic, p).0)
            .collect();
        print!("| order, elements per cell |");
        classes.iter().for_each(|(name, _)| print!(" {name} |"));
        println!(" ms per solve |\n|---|{}---|", "---|".repeat(classes.len()));
        for (elements, order) in meshes {
            print!("| {}, {elements} |", if order == Order::Bilinear { 1 } else { 2 });
            let mut times = Vec::new();
            for ((_, patterns), reference) in classes.iter().zip(&references) {
                let (found, milliseconds) = fields(elements, order, patterns);
                let errors = found.iter().zip(reference).map(|(a, b)| a.rms_difference(b) / rms(b));
                print!(" {:.3} % |", 100.0 * errors.sum::<f64>() / found.len() as f64);
                if patterns.len() > 1 {
                    times.push(milliseconds);
                }
            }
            println!(" {:.1} |", times.iter().sum::<f64>() / times.len() as f64);
        }
    });
}
