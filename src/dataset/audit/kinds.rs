//! Groups rows of one kind and finds outliers in each group.

use std::collections::BTreeMap;

use super::facts::Facts;
use super::labels::LabelCheck;

/// Smallest group in which outliers can be found. In smaller groups all rows are suspects.
pub const MIN_ROWS: usize = 12;

/// A row is an outlier if it differs from the median by more than this many robust standard deviations, plus a margin.
const DEVIATIONS: f64 = 4.0;
const MARGIN: f64 = 2e-3;

/// The index of a row, and its ratio and residual.
pub type Comparison = (usize, [f64; 2]);

/// Ratios outside this range and residuals above this limit are always suspect: in a group of mostly wrong rows a
/// right row would be the outlier.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.5..=2.0;
const MAX_RESIDUAL: f64 = 0.5;

/// Returns the outliers of all groups, the most distant first.
#[must_use]
pub fn suspects(kinds: &[Vec<Comparison>]) -> Vec<usize> {
    let mut found: Vec<(f64, usize)> = kinds.iter().flat_map(|rows| outliers(rows)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, index)| index).collect()
}

/// Groups the rows that were compared with estimates. A group has one family or, if the family is unknown, numbers of
/// edges within a factor of two.
#[must_use]
pub fn kinds(labels: &[LabelCheck], facts: &[Facts], families: Option<&[String]>) -> Vec<Vec<Comparison>> {
    let mut kinds: BTreeMap<(&str, u32), Vec<Comparison>> = BTreeMap::new();
    for (index, label) in labels.iter().enumerate() {
        if let LabelCheck::Compared { ratio, residual } = label {
            let kind = match families {
                Some(families) => (families[index].as_str(), 0),
                None => ("", facts[index].edges.max(1).ilog2()),
            };
            kinds.entry(kind).or_default().push((index, [*ratio, *residual]));
        }
    }
    kinds.into_values().collect()
}

/// Returns the median and the robust standard deviation (1.4826 median absolute deviations) of values.
#[must_use]
pub fn median_and_deviation(values: &[f64]) -> Option<(f64, f64)> {
    let median_value = median(values.to_vec())?;
    let distances = values.iter().map(|v| (v - median_value).abs()).collect();
    Some((median_value, 1.4826 * median(distances)?))
}

/// Returns the outliers of a group with their distances relative to the limit.
fn outliers(rows: &[Comparison]) -> Vec<(f64, usize)> {
    if rows.len() < MIN_ROWS {
        return rows.iter().map(|(index, _)| (0.0, *index)).collect();
    }
    let [(ratio_median, ratio_limit), (residual_median, residual_limit)] = [0, 1].map(|k: usize| {
        let values: Vec<f64> = rows.iter().map(|(_, numbers)| numbers[k]).collect();
        let (median, deviation) = median_and_deviation(&values).unwrap_or_default();
        (median, DEVIATIONS * deviation + MARGIN)
    });
    let distance = |&[ratio, residual]: &[f64; 2]| {
        if !PLAUSIBLE.contains(&ratio) || residual > MAX_RESIDUAL {
            return f64::INFINITY;
        }
        // A residual below the median is not a fault.
        let by_ratio = (ratio - ratio_median).abs() / ratio_limit;
        by_ratio.max((residual - residual_median) / residual_limit)
    };
    let all = rows.iter().map(|(index, numbers)| (distance(numbers), *index));
    all.filter(|(distance, _)| *distance > 1.0).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_exceed_the_deviation_of_their_group() {
        let rows: Vec<Comparison> = (0..40)
            .map(|i| {
                let wave = 1e-3 * (i as f64).sin();
                (i, [0.96 + wave + if i == 7 { 0.029 } else { 0.0 }, 0.02 + wave])
            })
            .collect();
        let found: Vec<usize> = outliers(&rows).iter().map(|(_, index)| *index).collect();
        assert_eq!(found, [7]);
        assert_eq!(outliers(&rows[..5]).len(), 5, "too few to say what is usual");
    }

    #[test]
    fn implausible_rows_are_suspects_even_if_most_rows_are_implausible() {
        for strange in [[0.0, 1.0], [-1.0, 0.01], [0.0, 0.0], [3.0, 0.01]] {
            let rows: Vec<Comparison> = (0..40)
                .map(|i| (i, if i < 30 { strange } else { [0.96, 0.01] }))
                .collect();
            let found: Vec<usize> = suspects(&[rows]);
            assert!((0..30).all(|i| found[..30].contains(&i)), "{strange:?}: {found:?}");
        }
    }
}
