//! Where the time of a solve goes: each phase on its own, and the share of the machine's bound that it reaches.
//!
//! `cargo bench --bench phases`. The arithmetic bound is measured: independent fused multiply–adds in the registers
//! that the kernels use. Operations are counted from the sources of the kernels, padding not included; a division
//! counts as one. Vectors are streamed by conjugate gradients, so their bound is the speed of a sum of two vectors in
//! as much memory: the last table says what share of a solve the arithmetic takes at its bound, and what share the
//! vectors at theirs.

mod bound;

use std::hint::black_box;

use bound::{Work, arithmetic32, arithmetic64, memory, row, seconds};
use deaflow::fem::energy::NeoHookean;
use deaflow::fem::grid::Grid;
use deaflow::fem::operator::{Activity, Operator};
use deaflow::fem::precondition::Laplacian;
use deaflow::fem::sheet::Sheet;
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Order, Simulator};
use deaflow::pattern::{Pattern, Raster};
use deaflow::scene::Scene;

fn main() {
    let (double, single) = (1e-9 * arithmetic64(), 1e-9 * arithmetic32());
    println!("arithmetic bound of one core: {double:.0} Gflop/s in f64, {single:.0} Gflop/s in f32");
    println!(
        "memory bound of one core: {:.0} GB/s in 100 kB, {:.0} GB/s in 4 MB, {:.0} GB/s in 256 MB\n",
        1e-9 * memory(100 << 10),
        1e-9 * memory(4 << 20),
        1e-9 * memory(256 << 20)
    );
    println!("order       elements  phase           µs    Gflop/s  of bound  calls  share of solve");
    let mut rows = Vec::new();
    for (order, per_cell) in [
        (Order::Bilinear, 1),
        (Order::Bilinear, 2),
        (Order::Bilinear, 4),
        (Order::Biquadratic, 1),
        (Order::Biquadratic, 2),
    ] {
        rows.push(report(order, per_cell, double, single));
    }
    bound::print(&rows);
}

/// Prints the phases of a solve, and gives the row of the whole.
fn report(order: Order, per_cell: usize, double: f64, single: f64) -> String {
    let mesh = Mesh::new(per_cell, order);
    let scene = Scene::vhb4910();
    let pattern = Pattern::from_fn(Raster::PAPER, |x, y| {
        (x * x * 7 + y * y * 13 + x * y * (x + 3)) % 17 < 8
    });
    let grid = Grid::uniform(mesh, &Sheet::of(&scene));
    let material = NeoHookean::new(scene.mean_prestretch(), scene.kappa());
    let activity = Activity::new(&grid, &pattern);
    let operator = Operator::new(&material, &activity);
    let laplacian = Laplacian::new(&grid).expect("the eigenvectors converge");
    let len = grid.layout().vector_len();
    let (u, mut r) = (vec![0.0_f64; len], vec![0.0_f64; len]);
    let (small, mut image) = (vec![0.0_f32; len], vec![0.0_f32; len]);
    let mut scratch = laplacian.scratch();

    let residual = seconds(|| operator.residual(black_box(&u), &mut r));
    let tangent = seconds(|| operator.tangent(black_box(&small), &small, &mut image));
    let inverse = seconds(|| laplacian.solve(black_box(&small), &[], &mut image, &mut scratch));
    let options = SolveOptions::on(mesh);
    let solver = MembraneSolver::new(&scene, options).expect("the options are valid");
    let batch = vec![pattern.clone(); 16];
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread can be started");
    let solve = pool.install(|| seconds(|| solver.simulate(black_box(&batch)))) / batch.len() as f64;

    let counts = solver.solve(&pattern);
    let (residuals, iterations) = (
        f64::from(counts.newton_iterations) + 1.0,
        f64::from(counts.krylov_iterations),
    );

    let [side, _] = grid.elements();
    let elements = (side * side) as f64;
    let (stress_flops, tangent_flops) = element_flops(order);
    let half = (grid.layout().nodes()[0] - 1) as f64 / 2.0;
    let columns = 2.0 * order.degree() as f64 + 1.0;
    let rows = 2.0 * grid.layout().nodes()[0] as f64;
    let inverse_flops = rows * (2.0 * 2.0 * 2.0 * half * half + 2.0 * half * 2.0 * columns);
    let rows = [
        ("residual", residual, stress_flops * elements, double, residuals),
        ("tangent", tangent, tangent_flops * elements, single, iterations),
        ("preconditioner", inverse, inverse_flops, single, iterations),
    ];
    let known: f64 = rows.iter().map(|row| row.1 * row.4).sum();
    for (name, time, flops, bound, calls) in rows {
        println!(
            "{:<11} {:>4}²     {name:<14}{:>8.1} {:>8.1}   {:>5.0} %  {calls:>5}  {:>5.0} %",
            format!("{order:?}"),
            side,
            1e6 * time,
            1e-9 * flops / time,
            1e-7 * flops / time / bound,
            100.0 * calls * time / solve
        );
    }
    println!(
        "{:<11} {:>4}²     everything else{:>7.1}                              {:>5.0} %   (solve {:.2} ms)",
        format!("{order:?}"),
        side,
        1e6 * (solve - known),
        100.0 * (1.0 - known / solve),
        1e3 * solve
    );
    let work = Work {
        double: residuals * stress_flops * elements,
        single: iterations * (tangent_flops * elements + inverse_flops),
        bytes: len as f64 * (iterations * ITERATION_BYTES + residuals * RESIDUAL_BYTES),
        held: 6 * 4 * len,
    };
    row(&format!("solve, {order:?} {side}²"), solve, work)
}

/// Bytes for each number of a vector that an iteration of conjugate gradients reads and writes: a product with the
/// tangent has three, the preconditioner four, the three updates three each and the two inner products two each, in
/// single precision.
const ITERATION_BYTES: f64 = 4.0 * (3.0 + 4.0 + 9.0 + 4.0);
/// The same of a residual: the displacement, the forces and their norm, in double precision.
const RESIDUAL_BYTES: f64 = 8.0 * 3.0;

/// Operations per element of a residual and of a tangent product, from the formulas: gradients and forces of the
/// element, and the law at each point (residual 36, det f included; tangent 58).
fn element_flops(order: Order) -> (f64, f64) {
    match order {
        // Per component: gradients 4 + 4·2, forces 13.
        Order::Bilinear => (2.0 * (12.0 + 13.0) + 4.0 * 36.0, 2.0 * (2.0 * 12.0 + 13.0) + 4.0 * 58.0),
        // Per component: gradients 3·(3·2·5 + 3·2·5), forces 3·3·(2·5 + 3·4).
        Order::Biquadratic => (
            2.0 * (180.0 + 198.0) + 9.0 * 36.0,
            2.0 * (2.0 * 180.0 + 198.0) + 9.0 * 58.0,
        ),
    }
}
