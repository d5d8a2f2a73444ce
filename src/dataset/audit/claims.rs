//! Checks the columns that state the origin of rows: `source` (the sample), `symmetry`, `bin` and `family`.
//!
//! If the samples are available, each row is compared with its sample. Otherwise the columns must be consistent: rows
//! with the same source are images of one pattern under their symmetries, and a larger displacement is not in a lower
//! bin.

use std::collections::BTreeMap;

use super::facts::Facts;
use super::finding::{Finding, Severity};
use super::rows::{Columns, Dataset, NO_NUMBER};
use crate::{BinIndex, Bins};
use deaflow_pattern::Symmetries;

/// Relative tolerance at the edges of bins: displacements of images differ by rounding.
const EDGE: f64 = 1e-9;

/// Returns the findings about the columns `source`, `symmetry`, `bin` and `family`.
#[must_use]
pub fn findings(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<Finding> {
    let columns = &dataset.columns;
    let unknown_families = rows(facts, |row| {
        columns.family.is_some() && facts[row].is_pattern && facts[row].fits_family.is_none()
    });
    let impossible = rows(facts, |row| facts[row].fits_family == Some(false));
    let symmetries = match dataset.device.symmetries {
        Symmetries::SQUARE => "0 to 7".to_owned(),
        group => group
            .iter()
            .map(|g| g.index().to_string())
            .collect::<Vec<_>>()
            .join(", "),
    };
    let symmetries = format!("`symmetry` is none of {symmetries}");
    let error = |rows: Vec<usize>, message: &str| finding(Severity::Error, &rows, message);
    let found = [
        error(unknown_symmetries(dataset), &symmetries),
        error(
            wrong_sources(facts, dataset),
            "`source` and `symmetry` do not lead to the pattern of the row",
        ),
        error(
            wrong_bins(facts, columns, dataset.bins),
            "`bin` is not that of the largest displacement",
        ),
        error(
            wrong_families(facts, dataset),
            "`family` is not that of the sample that the row was made from",
        ),
        error(impossible, "the pattern is none that its `family` draws"),
        finding(
            Severity::Warning,
            &unknown_families,
            "`family` is none that deaflow knows: whether it is true cannot be told",
        ),
    ];
    found.into_iter().flatten().collect()
}

fn finding(severity: Severity, rows: &[usize], message: &str) -> Option<Finding> {
    (!rows.is_empty()).then(|| Finding::rows("derived", severity, rows, message))
}

fn rows(facts: &[Facts], wanted: impl Fn(usize) -> bool) -> Vec<usize> {
    (0..facts.len()).filter(|&row| wanted(row)).collect()
}

fn unknown_symmetries(dataset: &Dataset<'_>) -> Vec<usize> {
    let group = dataset.device.symmetries;
    let is_known = |symmetry: u64| group.iter().any(|g| g.index() as u64 == symmetry);
    let symmetries = dataset.columns.symmetry.iter().flatten().enumerate();
    let wrong = symmetries.filter(|(_, symmetry)| !is_known(**symmetry));
    wrong.map(|(row, _)| row).collect()
}

/// Returns rows whose pattern is not the image of their source under their symmetry.
fn wrong_sources(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<usize> {
    let columns = &dataset.columns;
    let Some(source) = &columns.source else {
        return Vec::new();
    };
    if let (Some(samples), Some(_)) = (dataset.source_samples, &columns.symmetry) {
        let pattern = |row: usize| Some(samples.get(usize::try_from(source[row]).ok()?)?.pattern);
        return rows(facts, |row| {
            facts[row].is_pattern && pattern(row).is_none_or(|pattern| facts[row].source_pattern != Some(pattern))
        });
    }
    let has_symmetry = columns.symmetry.is_some();
    let identity = |row: usize| match has_symmetry {
        true => facts[row].source_pattern.map(|pattern| pattern.to_string()),
        false => facts[row].identity.as_ref().map(|(_, orbit)| orbit.to_string()),
    };
    let with_pattern = (0..facts.len()).filter(|&row| facts[row].is_pattern);
    minority(with_pattern.map(|row| (row, source[row], identity(row))))
}

/// Returns rows whose family differs from that of their source, or of the other rows with the same source.
fn wrong_families(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<usize> {
    let columns = &dataset.columns;
    let (Some(source), Some(family)) = (&columns.source, &columns.family) else {
        return Vec::new();
    };
    if let Some(samples) = dataset.source_samples {
        let sample = |row: usize| samples.get(usize::try_from(source[row]).ok()?);
        return rows(facts, |row| {
            sample(row).is_some_and(|sample| sample.family != family[row])
        });
    }
    minority((0..facts.len()).map(|row| (row, source[row], &family[row])))
}

/// Returns rows whose value differs from the most frequent value of their group. If several values are most frequent,
/// it returns the whole group.
pub fn minority<G: Ord, V: Ord>(rows: impl Iterator<Item = (usize, G, V)>) -> Vec<usize> {
    let mut groups: BTreeMap<G, BTreeMap<V, Vec<usize>>> = BTreeMap::new();
    for (row, group, value) in rows {
        groups.entry(group).or_default().entry(value).or_default().push(row);
    }
    let mut wrong = Vec::new();
    for values in groups.into_values() {
        let most = values.values().map(Vec::len).max();
        let is_only = values.values().filter(|rows| Some(rows.len()) == most).count() == 1;
        let others = values.into_values().filter(|rows| !is_only || Some(rows.len()) != most);
        wrong.extend(others.flatten());
    }
    wrong.sort_unstable();
    wrong
}

/// Returns rows whose largest displacement is in another bin.
fn wrong_bins(facts: &[Facts], columns: &Columns, bins: Option<Bins>) -> Vec<usize> {
    let Some(bin) = &columns.bin else {
        return Vec::new();
    };
    let with_field: Vec<usize> = rows(facts, |row| facts[row].has_field);
    if let Some(bins) = bins {
        let is_in = |row: usize| {
            let found = [-EDGE, 0.0, EDGE].map(|off| bins.index_of(facts[row].peak * (1.0 + off)));
            found.contains(&BinIndex::Bin(usize::try_from(bin[row]).unwrap_or(usize::MAX)))
        };
        return with_field.into_iter().filter(|&row| !is_in(row)).collect();
    }
    let (mut ordered, mut wrong): (Vec<usize>, Vec<usize>) =
        with_field.into_iter().partition(|&row| bin[row] != NO_NUMBER);
    ordered.sort_by(|&a, &b| facts[a].peak.total_cmp(&facts[b].peak).then(bin[a].cmp(&bin[b])));
    wrong.extend(out_of_order(&ordered, |row| bin[row]));
    wrong.sort_unstable();
    wrong
}

/// Returns the smallest set of rows without which the values do not decrease.
fn out_of_order(ordered: &[usize], value: impl Fn(usize) -> u64) -> Vec<usize> {
    // Longest non-decreasing subsequence. `last` holds for each length the end with the lowest value, `before` the
    // predecessor of each element.
    let (mut last, mut before): (Vec<usize>, Vec<Option<usize>>) = (Vec::new(), vec![None; ordered.len()]);
    for at in 0..ordered.len() {
        let length = last.partition_point(|&end| value(ordered[end]) <= value(ordered[at]));
        before[at] = length.checked_sub(1).map(|shorter| last[shorter]);
        if length == last.len() {
            last.push(at);
        } else {
            last[length] = at;
        }
    }
    let mut kept = vec![false; ordered.len()];
    let mut at = last.last().copied();
    while let Some(here) = at {
        kept[here] = true;
        at = before[here];
    }
    let wrong = ordered.iter().zip(kept).filter(|(_, kept)| !kept);
    let mut wrong: Vec<usize> = wrong.map(|(row, _)| *row).collect();
    wrong.sort_unstable();
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_in_the_minority_of_their_group_are_found() {
        let rows = [
            (0, 'a', 1),
            (1, 'a', 1),
            (2, 'a', 2),
            (3, 'b', 5),
            (4, 'c', 1),
            (5, 'c', 2),
        ];
        assert_eq!(minority(rows.into_iter()), [2, 4, 5]);
    }

    #[test]
    fn the_fewest_rows_are_out_of_order() {
        let bins = [0, 0, 7, 1, 1, 2, 0, 3, 3];
        let ordered: Vec<usize> = (0..bins.len()).collect();
        assert_eq!(out_of_order(&ordered, |row| bins[row]), [2, 6]);
        assert_eq!(out_of_order(&[], |_| 0), [0_usize; 0]);
    }
}
