//! Kinds of rows, and what is usual among the rows of one kind.

use std::collections::BTreeMap;

use super::facts::Facts;
use super::labels::LabelCheck;

/// Fewer rows of a kind than this say nothing of what is usual among them: all of them are suspects.
pub const FEWEST: usize = 12;

/// Deviations by which a row is an outlier: so many robust standard deviations, and so much more.
const DEVIATIONS: f64 = 4.0;
const MARGIN: f64 = 2e-3;

/// A row with its ratio and rest.
pub type Comparison = (usize, [f64; 2]);

/// Ratios outside these, and rests above this, are suspect whatever is usual: among many wrong rows a right one is the outlier.
const STRANGE: [f64; 2] = [0.5, 2.0];
const STRANGE_REST: f64 = 0.5;

/// The rows that compare with their estimates otherwise than their like, the most unlike first.
///
/// Rows are alike that are of one family or, where that is not known, whose patterns have as many edges but for a factor
/// of two.
#[must_use]
pub fn suspects(kinds: &[Vec<Comparison>]) -> Vec<usize> {
    let mut found: Vec<(f64, usize)> = kinds.iter().flat_map(|rows| outliers(rows)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, index)| index).collect()
}

/// The rows that have been compared with estimates, by kind.
#[must_use]
pub fn kinds(labels: &[LabelCheck], facts: &[Facts], families: Option<&[String]>) -> Vec<Vec<Comparison>> {
    let mut kinds: BTreeMap<(&str, u32), Vec<Comparison>> = BTreeMap::new();
    for (index, label) in labels.iter().enumerate() {
        if let LabelCheck::Compared { ratio, rest } = label {
            let kind = match families {
                Some(families) => (families[index].as_str(), 0),
                None => ("", facts[index].edges.max(1).ilog2()),
            };
            kinds.entry(kind).or_default().push((index, [*ratio, *rest]));
        }
    }
    kinds.into_values().collect()
}

/// Middle and robust standard deviation of numbers; `None` without numbers.
#[must_use]
pub fn usual(values: &[f64]) -> Option<(f64, f64)> {
    let middle = median(values.to_vec())?;
    let far = values.iter().map(|v| (v - middle).abs()).collect();
    Some((middle, 1.4826 * median(far)?))
}

/// The outliers among rows of one kind, with how far out they are.
fn outliers(rows: &[Comparison]) -> Vec<(f64, usize)> {
    if rows.len() < FEWEST {
        return rows.iter().map(|(index, _)| (0.0, *index)).collect();
    }
    let usual = [0, 1].map(|k: usize| {
        let values: Vec<f64> = rows.iter().map(|(_, numbers)| numbers[k]).collect();
        let (middle, spread) = usual(&values).unwrap_or_default();
        (middle, DEVIATIONS * spread + MARGIN)
    });
    let out = |numbers: &[f64; 2]| {
        if !(STRANGE[0]..=STRANGE[1]).contains(&numbers[0]) || numbers[1] > STRANGE_REST {
            return f64::INFINITY;
        }
        let ratio = (numbers[0] - usual[0].0).abs() / usual[0].1;
        // A label that is nearer to its estimate than usual is no worse for that.
        ratio.max((numbers[1] - usual[1].0) / usual[1].1)
    };
    let all = rows.iter().map(|(index, numbers)| (out(numbers), *index));
    all.filter(|(out, _)| *out > 1.0).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_are_told_from_the_spread_of_their_like() {
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
    fn what_is_strange_is_suspect_even_where_it_is_usual() {
        for strange in [[0.0, 1.0], [-1.0, 0.01], [0.0, 0.0], [3.0, 0.01]] {
            let rows: Vec<Comparison> = (0..40)
                .map(|i| (i, if i < 30 { strange } else { [0.96, 0.01] }))
                .collect();
            let found: Vec<usize> = suspects(&[rows]);
            assert!((0..30).all(|i| found[..30].contains(&i)), "{strange:?}: {found:?}");
        }
    }
}
