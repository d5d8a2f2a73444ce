//! Solver throughput: milliseconds of one core per pattern, by mesh and order, and by device.
//!
//! `cargo bench --bench solver`. The patterns are random small-grid ones (1250 of 2500 cells active), κ = 0.0255,
//! relative residual 1e-8. Times are those that the thread was on a core (`/proc/thread-self/schedstat`), so other work
//! on the machine disturbs them little; the best of three rounds counts. Devices have as many elements as the square,
//! and take turns with it.

use deaflow::base::{Stream, thread_seconds};
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Order, Simulator};
use deaflow::pattern::{CELLS, Pattern, Raster};
use deaflow::scene::Scene;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread can be started");
    println!("order       elements  ms per solve  Newton steps");
    for (order, per_cell, count) in [
        (Order::Bilinear, 1, 256),
        (Order::Bilinear, 2, 64),
        (Order::Bilinear, 4, 16),
        (Order::Biquadratic, 1, 64),
        (Order::Biquadratic, 2, 16),
    ] {
        let options = SolveOptions::on(Mesh::new(per_cell, order));
        let solver = MembraneSolver::new(&Scene::vhb4910(), options).expect("the options are valid");
        let patterns: Vec<Pattern> = (0..count).map(small_grid).collect();
        let mut best = f64::INFINITY;
        let mut steps = 0;
        for _ in 0..3 {
            let results = pool.install(|| {
                let start = thread_seconds();
                let results = solver.simulate(&patterns);
                best = best.min(thread_seconds() - start);
                results
            });
            assert!(results.iter().all(|result| result.outcome.is_converged()));
            steps = results.iter().map(|result| result.newton_iterations).sum();
        }
        println!(
            "{:<11} {:>4}²     {:>9.3}     {:>9.2}",
            format!("{order:?}"),
            solver.grid().elements()[0],
            1e3 * best / count as f64,
            f64::from(steps) / count as f64
        );
    }
    devices(&pool);
}

/// Devices by name and geometry. The thickness makes all as far from rest: ε V² λ1 λ2 / (μ H²) is that of the square.
const DEVICES: [(&str, &str); 5] = [
    ("square", "side: 50 mm, prestretch: 3, thickness: 1 mm"),
    (
        "rectangle",
        "size: [60 mm, 40 mm], prestretch: [3, 3.2], thickness: 1.0328 mm",
    ),
    (
        "disc frame",
        "side: 50 mm, prestretch: 3, thickness: 1 mm, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }",
    ),
    (
        "square tip",
        "side: 50 mm, prestretch: 3, thickness: 1 mm, bodies: [{ rectangle: [[22 mm, 22 mm], [28 mm, 28 mm]] }]",
    ),
    (
        "disc with rotor",
        "side: 50 mm, prestretch: 3, thickness: 1 mm, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 22 \
         mm } } }, bodies: [{ disc: { centre: [25 mm, 25 mm], radius: 5 mm } }]",
    ),
];

fn devices(pool: &rayon::ThreadPool) {
    const ROUNDS: usize = 5;
    println!("\ndevice            elements  ms per solve  times the square  Newton steps  CG iterations  s to set up");
    // The time of a thread is told in steps of some ms.
    for (mesh, count) in [
        (Mesh::bilinear(1), 512),
        (Mesh::bilinear(2), 128),
        (Mesh::biquadratic(1), 128),
    ] {
        let patterns: Vec<Pattern> = (0..count).map(small_grid).collect();
        let solvers = DEVICES.map(|(name, geometry)| {
            let text = format!(
                "{{ geometry: {{ {geometry}, cells: 50 }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
                 relative_permittivity: 4.7 }}, drive: {{ voltage: 5.25 kV }} }}"
            );
            let scene = Scene::from_text(&text).expect("the scene is valid");
            let start = thread_seconds();
            let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).expect("the options are valid");
            (name, solver, thread_seconds() - start)
        });
        let mut best = [f64::INFINITY; DEVICES.len()];
        let mut steps = [0; DEVICES.len()];
        for _ in 0..ROUNDS {
            for (at, (_, solver, _)) in solvers.iter().enumerate() {
                let results = pool.install(|| {
                    let start = thread_seconds();
                    let results = solver.simulate(&patterns);
                    best[at] = best[at].min(thread_seconds() - start);
                    results
                });
                assert!(results.iter().all(|result| result.outcome.is_converged()));
                steps[at] = results.iter().map(|result| result.newton_iterations).sum();
            }
        }
        for (at, (name, solver, set_up)) in solvers.iter().enumerate() {
            println!(
                "{name:<16} {:>5}² {:<11} {:>8.3} {:>14.2} {:>14.2} {:>14.2} {set_up:>12.3}",
                solver.grid().elements()[0],
                format!("{:?}", mesh.order()).to_lowercase(),
                1e3 * best[at] / count as f64,
                best[at] / best[0],
                f64::from(steps[at]) / count as f64,
                iterations(solver, &patterns),
            );
        }
    }
}

/// The mean number of iterations of conjugate gradients over a few patterns.
fn iterations(solver: &MembraneSolver, patterns: &[Pattern]) -> f64 {
    let few = &patterns[..16];
    let all: u32 = few.iter().map(|pattern| solver.solve(pattern).krylov_iterations).sum();
    f64::from(all) / few.len() as f64
}

/// Half of the cells, drawn without replacement.
fn small_grid(index: u64) -> Pattern {
    let mut stream = Stream::new(1, "solver benchmark", index);
    let mut order: Vec<usize> = (0..CELLS * CELLS).collect();
    for last in (1..order.len()).rev() {
        order.swap(last, stream.index(last + 1));
    }
    let half = CELLS * CELLS / 2;
    let mut active = vec![0; CELLS * CELLS];
    order[..half].iter().for_each(|&cell| active[cell] = 1);
    Pattern::from_cells(Raster::PAPER, &active).expect("cells are 0 or 1")
}
