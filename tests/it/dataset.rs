//! A dataset from end to end: every family is drawn, solved, balanced and augmented.

use std::collections::BTreeMap;

use deaflow::dataset::{BalanceOptions, Bins, Candidate, Split, SymmetryGroup, balance};
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Field, Mesh, Simulator};
use deaflow::pattern::{Pattern, Symmetries};
use deaflow::sample::{AreaSweep, Bezier, Canvas, Ends, Family, LargeGrid, SmallGrid};
use deaflow::scene::Scene;

fn drawn() -> Vec<Pattern> {
    let families: [&dyn Family; 4] = [
        &SmallGrid::new(Canvas::PAPER, 0.5).unwrap(),
        &LargeGrid::new(Canvas::PAPER, 7).unwrap(),
        &Bezier::new(Canvas::PAPER, None, Ends::Opposite).unwrap(),
        &AreaSweep::new(Canvas::PAPER, 0.05, 0.95).unwrap(),
    ];
    let sample = |family: &&dyn Family| family.sample(3, 1).unwrap();
    families.iter().map(sample).collect()
}

fn solver() -> MembraneSolver {
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    };
    MembraneSolver::new(&Scene::vhb4910(), options).unwrap()
}

fn solved(solver: &MembraneSolver, patterns: &[Pattern]) -> Vec<Field> {
    let simulations = solver.simulate(patterns).into_iter();
    simulations.map(|simulation| simulation.field.unwrap()).collect()
}

/// All images of all patterns: bin, level and target leave nothing out.
fn everything() -> BalanceOptions {
    BalanceOptions {
        bins: Bins::new(0.0, 2.5, 1).unwrap(),
        target: 1000,
        symmetry: SymmetryGroup::D4,
        group: Symmetries::SQUARE,
        seed: 9,
    }
}

#[test]
fn augmentation_commutes_with_solving() {
    let (solver, patterns) = (solver(), drawn());
    let fields = solved(&solver, &patterns);
    let candidates: Vec<Candidate<'_>> = patterns
        .iter()
        .zip(&fields)
        .map(|(pattern, field)| Candidate {
            pattern,
            max_displacement: Some(field.max_magnitude()),
        })
        .collect();
    let rows = balance(&candidates, &everything()).unwrap().rows;
    assert_eq!(rows.len(), 8 * patterns.len());
    let images: Vec<Pattern> = rows.iter().map(|row| row.pattern(&patterns[row.source])).collect();
    let mut splits: BTreeMap<_, Split> = BTreeMap::new();
    for ((row, image), simulated) in rows.iter().zip(&images).zip(solved(&solver, &images)) {
        let carried = row.field(&fields[row.source]);
        let pairs = carried.values().iter().zip(simulated.values());
        let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-10, "{:?}: {difference:e} mm", row.symmetry);
        assert_eq!(image.orbit(Symmetries::SQUARE), row.orbit);
        assert_eq!(*splits.entry(row.orbit).or_insert(row.split), row.split);
    }
    assert_eq!(splits.len(), patterns.len());
}

#[test]
fn families_lie_where_the_paper_says() {
    let fields = solved(&solver(), &drawn());
    let peaks: Vec<f64> = fields.iter().map(Field::max_magnitude).collect();
    // Small grids hardly move, large grids about a millimetre, curves about two.
    assert!((0.15..0.45).contains(&peaks[0]), "{peaks:?}");
    assert!((0.6..1.7).contains(&peaks[1]), "{peaks:?}");
    assert!((1.4..2.5).contains(&peaks[2]), "{peaks:?}");
}
