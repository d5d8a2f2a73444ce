//! Our side of the comparison with public codes: `benches/peers/run.sh` runs it.
//!
//! `cargo bench --bench peers -- PATTERNS.npy` prints a line of JSON per mesh: milliseconds of one core per pattern and
//! the largest displacement of each pattern in mm.

use deaflow::base::thread_seconds;
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Simulator};
use deaflow::pattern::{CELLS, DrawingOptions, Pattern, PatternForm, read_patterns};
use deaflow::scene::Scene;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Cargo itself appends `--bench`.
    let Some(path) = std::env::args().skip(1).find(|argument| argument.ends_with(".npy")) else {
        println!("no PATTERNS.npy given: nothing to compare");
        return Ok(());
    };
    let patterns = read_patterns(&path, PatternForm::PAPER, &DrawingOptions::default())
        .map_err(|e| e.to_string())?
        .patterns;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for elements_per_cell in [1, 2, 4] {
        let options = SolveOptions::on(Mesh::bilinear(elements_per_cell));
        let solver = MembraneSolver::new(&Scene::vhb4910(), options)?;
        let batch: Vec<Pattern> = patterns.iter().cycle().take(32).cloned().collect();
        let mut best = f64::INFINITY;
        let mut largest = Vec::new();
        for _ in 0..3 {
            let (seconds, results) = pool.install(|| {
                let start = thread_seconds();
                let results = solver.simulate(&batch);
                (thread_seconds() - start, results)
            });
            best = best.min(seconds);
            let fields = results[..patterns.len()]
                .iter()
                .filter_map(|result| result.field.as_ref());
            largest = fields.map(deaflow::field::Field::max_magnitude).collect();
        }
        let line = serde_json::json!({
            "code": "deaflow",
            "elements": CELLS * elements_per_cell,
            "ms": 1e3 * best / batch.len() as f64,
            "max_mm": largest,
        });
        println!("{line}");
    }
    Ok(())
}
