//! Membranes of many cells: seconds to set a solver up, to solve and to find a critical voltage, and peak memory.
//!
//! `cargo bench --bench large`, on one thread; with names behind `--` only cases that begin so are measured. Each case
//! runs in a process of its own, so that its peak memory is its own. A solve is that of `deaflow solve` without its
//! checks, on two bilinear elements along a cell, at 3.5 kV with the law named; the search is that for the critical
//! voltage on one and on two biquadratic elements along a cell.

use std::process::Command;
use std::time::Instant;

use deaflow::fem::{CriticalSearch, MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Simulator};
use deaflow::pattern::Pattern;
use deaflow::scene::Scene;

/// Name, geometry and stiffening law.
type Case = (&'static str, &'static str, &'static str);

const SQUARE: &str = "side: 60 mm";
const DISC: &str = "side: 60 mm, frame: { opening: { disc: { centre: [30 mm, 30 mm], radius: 30 mm } } }";
const RING: &str = "side: 60 mm, frame: { opening: { disc: { centre: [30 mm, 30 mm], radius: 30 mm } } }, bodies: [{ \
                    disc: { centre: [30 mm, 30 mm], radius: 8 mm } }]";
const YEOH: &str = "{ model: yeoh, c2: -888 Pa, c3: 16.7 Pa }";
const GENT: &str = "{ model: gent, jm: 120 }";
const OGDEN: &str = "{ model: ogden, terms: [{ mu: 154 kPa, alpha: 1.8 }] }";

const CASES: [(Case, [usize; 2]); 11] = [
    (("square", SQUARE, ""), [100, 100]),
    (("square", SQUARE, ""), [200, 200]),
    (("square", SQUARE, ""), [400, 400]),
    (("strip", "size: [100 mm, 0.25 mm]", ""), [400, 1]),
    (("strip", "size: [0.25 mm, 100 mm]", ""), [1, 400]),
    (("disc", DISC, YEOH), [60, 60]),
    (("disc", DISC, YEOH), [120, 120]),
    (("disc", DISC, GENT), [128, 128]),
    (("disc", DISC, YEOH), [240, 240]),
    (("ring", RING, OGDEN), [240, 240]),
    (("disc", DISC, ""), [400, 400]),
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    if let [case, number] = &arguments[..]
        && case == "case"
    {
        let number: usize = number.parse().expect("a number of a case");
        return measure(CASES[number]);
    }
    println!(
        "membrane  cells      elements  unknowns  set up s  solve s  CG iterations  search s  peak MB  critical voltage"
    );
    let program = std::env::current_exe().expect("the path of this program");
    for (number, ((name, ..), _)) in CASES.iter().enumerate() {
        if arguments.is_empty() || arguments.iter().any(|wanted| name.starts_with(wanted.as_str())) {
            let status = Command::new(&program)
                .args(["case", &number.to_string()])
                .env("RAYON_NUM_THREADS", "1")
                .status();
            assert!(status.expect("the program starts").success());
        }
    }
}

fn measure(((name, geometry, law), [columns, rows]): (Case, [usize; 2])) {
    let effects = match law {
        "" => String::new(),
        law => format!("strain_stiffening: {law}"),
    };
    let scene = Scene::from_text(&format!(
        "{{ geometry: {{ {geometry}, thickness: 1 mm, prestretch: 3, cells: [{columns}, {rows}] }}, material: {{ model: \
         neo-hookean, shear_modulus: 138.6 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 3.5 kV }}, effects: \
         {{ {effects} }} }}"
    ))
    .expect("the scene is valid");
    let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| {
        let [x, y] = [
            (x as f64 + 0.5) / columns as f64 - 0.4,
            (y as f64 + 0.5) / rows as f64 - 0.5,
        ];
        x.hypot(y) < 0.3
    });
    let start = Instant::now();
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(2))).expect("the options are valid");
    let set_up = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let iterations = solver.solve(&pattern).krylov_iterations;
    assert!(
        solver.simulate(std::slice::from_ref(&pattern))[0]
            .outcome
            .is_converged()
    );
    let solve = start.elapsed().as_secs_f64() / 2.0;
    let [across, along] = solver.grid().elements();
    let unknowns = solver.grid().layout().nodes().iter().product::<usize>() * 2;
    drop(solver);
    let start = Instant::now();
    let far = scene.at_voltage(20e3);
    let search = CriticalSearch::new(&far, SolveOptions::on(Mesh::biquadratic(1))).expect("the options are valid");
    let found = search.near_on_coarse(&pattern, 12e3);
    let found = found.map(|coarse| search.refine(&pattern, coarse.voltage));
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{name:<8} {:>9}  {:>10} {unknowns:>9} {set_up:>9.2} {solve:>8.2} {iterations:>14} {seconds:>9.2} {:>8.0}  {}",
        format!("{columns} × {rows}"),
        format!("{across} × {along}"),
        peak_memory(),
        found.map_or_else(String::new, |found| format!("{:.0} V", found.voltage)),
    );
}

/// The peak of resident memory, MB.
fn peak_memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) * 1024e-6
}
