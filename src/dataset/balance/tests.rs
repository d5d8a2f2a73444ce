use std::collections::{BTreeMap, HashSet};

use super::*;
use deaflow_pattern::Raster;

/// A distinct asymmetric pattern for each number below 65,536: the number in binary, and a mark.
fn pattern(number: usize) -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, y| match y {
        30 => (10..26).contains(&x) && (number >> (x - 10)) & 1 == 1,
        _ => x == 0 && y == 1,
    })
}

/// Samples with a given number in each bin of 1 mm.
fn samples(counts: &[usize]) -> (Vec<Pattern>, Vec<f64>) {
    let peaks: Vec<f64> = counts
        .iter()
        .enumerate()
        .flat_map(|(bin, &n)| vec![bin as f64 + 0.5; n])
        .collect();
    ((0..peaks.len()).map(pattern).collect(), peaks)
}

fn candidates<'a>(patterns: &'a [Pattern], peaks: &[f64]) -> Vec<Candidate<'a>> {
    let candidate = |(pattern, &peak)| Candidate {
        pattern,
        max_displacement: Some(peak),
    };
    patterns.iter().zip(peaks).map(candidate).collect()
}

fn options(bins: usize, target: u64) -> BalanceOptions {
    BalanceOptions {
        bins: Bins::new(0.0, bins as f64, bins).unwrap(),
        target,
        symmetry: SymmetryGroup::D4,
        group: Symmetries::SQUARE,
        seed: 4,
    }
}

fn balanced(counts: &[usize], options: &BalanceOptions) -> (Vec<Pattern>, Balanced) {
    let (patterns, peaks) = samples(counts);
    let result = balance(&candidates(&patterns, &peaks), options).unwrap();
    (patterns, result)
}

#[test]
fn full_bins_are_reduced_and_sparse_bins_augmented() {
    let (_, result) = balanced(&[200, 30, 3, 0, 10], &options(5, 164));
    // Capacities 1600, 240, 24, 0, 80: the third gives its 24 images, the others (164 − 24) / 3 each.
    assert_eq!(result.before.counts, [200, 30, 3, 0, 10]);
    assert_eq!(result.augmented.counts, [200, 240, 24, 0, 80]);
    assert_eq!(result.after.counts.iter().sum::<u64>(), 164);
    assert_eq!(result.after.counts[2], 24);
    for bin in [0, 1, 4] {
        assert!((46..=47).contains(&result.after.counts[bin]));
    }
    assert!((result.level - 140.0 / 3.0).abs() < 1e-12);
    assert_eq!(result.after.empty_bins(), [3]);
    assert_eq!(result.rows.len(), 164);
    // A bin with enough samples is not augmented; a sparse one keeps every sample.
    assert!(
        result
            .rows
            .iter()
            .all(|r| r.bin != 0 || r.symmetry == Symmetry::IDENTITY)
    );
    let kept = result
        .rows
        .iter()
        .filter(|r| r.bin == 1 && r.symmetry == Symmetry::IDENTITY);
    assert_eq!(kept.count(), 30);
}

#[test]
fn the_dataset_is_uniform_if_all_bins_have_enough_rows() {
    let (_, result) = balanced(&[500, 70, 40, 900, 33], &options(5, 1000));
    assert_eq!(result.after.counts, [200; 5]);
}

#[test]
fn rows_are_distinct_patterns_and_an_orbit_stays_in_one_split() {
    let (patterns, result) = balanced(&[5, 300, 12], &options(3, 150));
    let rows: HashSet<Pattern> = result.rows.iter().map(|r| r.pattern(&patterns[r.source])).collect();
    assert_eq!(rows.len(), result.rows.len());
    let mut splits = BTreeMap::new();
    for row in &result.rows {
        assert_eq!(row.orbit, patterns[row.source].orbit(Symmetries::SQUARE));
        assert_eq!(*splits.entry(row.orbit).or_insert(row.split), row.split);
    }
    assert_eq!(result.rows.iter().map(|r| r.split).collect::<HashSet<_>>().len(), 3);
}

#[test]
fn samples_that_are_images_of_each_other_are_not_rows_twice() {
    let base = pattern(77);
    let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
    let patterns = [
        base.transformed(Symmetry::ALL[3]),
        half.clone(),
        base.clone(),
        base,
        half,
    ];
    let result = balance(&candidates(&patterns, &[0.5; 5]), &options(1, 1000)).unwrap();
    assert_eq!(result.repeats, [3, 4]);
    assert_eq!(result.before.counts, [5]);
    // Eight images of `base`, four of the half plane.
    assert_eq!(result.after.counts, [12]);
    assert_eq!(result.level, 12.0);
    let rows: HashSet<Pattern> = result.rows.iter().map(|r| r.pattern(&patterns[r.source])).collect();
    assert_eq!(rows.len(), 12);
}

#[test]
fn fields_rotate_with_their_patterns() {
    let (patterns, result) = balanced(&[2], &options(1, 16));
    // A field that commutes with the symmetries: it points away from the centre at active cells.
    let field_of = |pattern: &Pattern| {
        let values = (0..51 * 51).flat_map(|i| {
            let (x, y) = (i % 51, i / 51);
            let on = x > 0 && x < 50 && y > 0 && y < 50 && touches(pattern, x, y);
            let weight = if on { 0.01 } else { 0.0 };
            [weight * (x as f64 - 25.0), weight * (y as f64 - 25.0)]
        });
        Field::from_values(Raster::PAPER, values.collect()).unwrap()
    };
    assert_eq!(result.rows.len(), 16);
    for row in &result.rows {
        let source = &patterns[row.source];
        assert_eq!(row.field(&field_of(source)), field_of(&row.pattern(source)));
    }
}

fn touches(pattern: &Pattern, x: usize, y: usize) -> bool {
    [(x - 1, y - 1), (x, y - 1), (x - 1, y), (x, y)]
        .iter()
        .any(|&(x, y)| pattern.is_active(x, y))
}

#[test]
fn omitted_candidates_are_reported() {
    let (patterns, mut peaks) = samples(&[4, 4]);
    peaks[1] = 7.0;
    peaks[2] = 0.05;
    let mut given = candidates(&patterns, &peaks);
    given[6].max_displacement = None;
    let options = BalanceOptions {
        bins: Bins::new(0.1, 2.0, 2).unwrap(),
        symmetry: SymmetryGroup::None,
        ..options(2, 100)
    };
    let result = balance(&given, &options).unwrap();
    assert_eq!((result.before.below, result.before.above), (1, 1));
    assert_eq!(result.unsolved, [6]);
    assert_eq!(
        result.rows.iter().map(|r| r.source).collect::<Vec<_>>(),
        [0, 3, 4, 5, 7]
    );
}

#[test]
fn without_symmetry_nothing_is_augmented() {
    let options = BalanceOptions {
        symmetry: SymmetryGroup::None,
        ..options(2, 60)
    };
    let (_, result) = balanced(&[50, 5], &options);
    assert_eq!(result.after.counts, [50, 5]);
    assert!(result.rows.iter().all(|r| r.symmetry == Symmetry::IDENTITY));
}

#[test]
fn the_selection_does_not_depend_on_the_order_of_the_samples() {
    let (patterns, peaks) = samples(&[60, 4]);
    let options = options(2, 40);
    let chosen = |patterns: &[Pattern], peaks: &[f64]| {
        let rows = balance(&candidates(patterns, peaks), &options).unwrap().rows;
        rows.iter()
            .map(|r| r.pattern(&patterns[r.source]))
            .collect::<HashSet<_>>()
    };
    let forth = chosen(&patterns, &peaks);
    let reversed: (Vec<_>, Vec<_>) = patterns.iter().cloned().zip(peaks).rev().unzip();
    assert_eq!(forth, chosen(&reversed.0, &reversed.1));
    assert_eq!(forth.len(), 40);
}

#[test]
fn the_seed_determines_the_selection() {
    let sources = |seed| {
        let options = BalanceOptions { seed, ..options(1, 10) };
        balanced(&[100], &options)
            .1
            .rows
            .iter()
            .map(|r| r.source)
            .collect::<Vec<_>>()
    };
    assert_eq!(sources(1), sources(1));
    assert_ne!(sources(1), sources(2));
}

#[test]
fn degenerate_inputs_have_valid_results() {
    let (_, nothing) = balanced(&[], &options(3, 10));
    assert!(nothing.rows.is_empty() && nothing.after.empty_bins().len() == 3);
    let (_, one) = balanced(&[0, 1], &options(3, 10));
    assert_eq!(one.after.counts, [0, 8, 0]);
    let (_, single) = balanced(&[0, 90], &options(3, 10));
    assert_eq!(single.after.counts, [0, 10, 0]);
    assert_eq!(balance(&[], &options(3, 0)), Err(BalanceError::NoTarget));
    let (patterns, _) = samples(&[1]);
    for found in [-0.1, f64::INFINITY] {
        let result = balance(&candidates(&patterns, &[found]), &options(3, 5));
        assert_eq!(result, Err(BalanceError::Displacement { index: 0, found }));
    }
}
