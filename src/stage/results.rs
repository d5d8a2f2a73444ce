//! The numbers that artifacts are worth, as kinds of stages name them.

use deaflow_content::{Samples, Solutions};
use deaflow_orchestrator::StageError;
use deaflow_store::Artifact;

/// Results by their names.
pub fn named<const N: usize>(results: [(&str, f64); N]) -> Vec<(String, f64)> {
    results.map(|(name, value)| (name.to_owned(), value)).into()
}

/// The first words of the results that an artifact of a kind may have.
pub fn words_of(kind: &str) -> &'static [&'static str] {
    match kind {
        "sample" | "patterns" => &["samples", "area"],
        "solve" | "import" => &["samples", "unstable", "max_displacement", "mean_displacement"],
        "balance" => &["rows", "max_displacement"],
        "train" => &["rmse", "best_epoch"],
        "calibrate" => &["samples", "novelty_threshold"],
        "evaluate" => &["rmse", "max_error"],
        "design" => &["predicted", "area"],
        "verify" => &["displacement", "area", "predicted"],
        "accuracy" => &["max_error"],
        "audit" => &["rows", "errors", "warnings"],
        _ => &[],
    }
}

/// The unit of a result, by its first word.
pub fn unit(name: &str) -> &'static str {
    const LENGTHS: [&str; 7] = [
        "max_displacement",
        "mean_displacement",
        "displacement",
        "predicted",
        "rmse",
        "max_error",
        "error",
    ];
    let word = name.split('.').next().unwrap_or(name);
    if LENGTHS.contains(&word) { "mm" } else { "1" }
}

/// What samples are worth: how many there are, and their mean area.
///
/// # Errors
/// When the artifact cannot be read.
pub fn of_samples(artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
    let area = Samples::open(artifact)?.area().read()?;
    Ok(named([("samples", area.len() as f64), ("area", mean(&area))]))
}

/// What samples with fields are worth: how many there are with and without, and how far they move.
///
/// # Errors
/// When the artifact cannot be read.
pub fn of_solutions(artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
    let view = Solutions::open(artifact)?;
    let largest = view.max_displacement().read()?;
    Ok(named([
        ("samples", largest.len() as f64),
        ("unstable", view.unstable().outcome().rows()? as f64),
        ("max_displacement", most(&largest)),
        ("mean_displacement", mean(&largest)),
    ]))
}

/// The mean; not a number where there is nothing.
pub fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// The largest; not a number where there is nothing.
pub fn most(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(f64::NAN, f64::max)
}

/// Columns of designs: of each target the last row, under the name of the column, and of the target where there are several.
/// `rows` are targets and their rows.
pub fn of_targets(rows: &[(&str, usize)], columns: &[(&str, &[f64])]) -> Vec<(String, f64)> {
    let mut last: Vec<(&str, usize)> = Vec::new();
    for (target, row) in rows {
        match last.iter_mut().find(|(other, _)| other == target) {
            Some(known) => known.1 = *row,
            None => last.push((target, *row)),
        }
    }
    let alone = last.len() == 1;
    let of = |(column, numbers): &(&str, &[f64])| {
        let named = |(target, row): &(&str, usize)| {
            let name = if alone {
                (*column).to_owned()
            } else {
                format!("{column}.{target}")
            };
            Some((name, *numbers.get(*row)?))
        };
        last.iter().filter_map(named).collect::<Vec<_>>()
    };
    columns.iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_each_target_the_last_design_counts() {
        let numbers = [1.0, 2.0, 3.0, 4.0];
        let one = of_targets(&[("a", 0), ("a", 2)], &[("value", &numbers), ("area", &numbers)]);
        assert_eq!(one, named([("value", 3.0), ("area", 3.0)]));
        let two = of_targets(&[("a", 0), ("b", 1), ("a", 3)], &[("value", &numbers)]);
        assert_eq!(two, named([("value.a", 4.0), ("value.b", 2.0)]));
        assert_eq!(of_targets(&[], &[("value", &numbers)]), Vec::new());
    }

    #[test]
    fn of_nothing_there_is_no_number() {
        assert!(mean(&[]).is_nan() && most(&[]).is_nan());
        assert_eq!((mean(&[1.0, 3.0]), most(&[1.0, 3.0])), (2.0, 3.0));
    }
}
