//! What columns claim of the making of their rows: the sample and the symmetry that gave a row, its bin, its family.
//!
//! Where the samples are at hand, each row is made from its own once more. A file that stands for itself has to agree with
//! itself: rows of one source are images of one pattern by the symmetries that they name, and a larger displacement lies in no
//! lower bin.

use std::collections::BTreeMap;

use super::facts::Facts;
use super::finding::{Finding, Severity};
use super::rows::{Columns, Dataset, NO_NUMBER};
use crate::{Bins, Place};
use deaflow_base::Digest;
use deaflow_pattern::{Pattern, Symmetries};

/// Part of a displacement by which it may lie on the other side of the edge of a bin: images have it but for rounding.
const EDGE: f64 = 1e-9;

/// Knows what patterns a family has.
pub trait Families: Sync {
    /// Whether a family of this name may have drawn a pattern; `None` where no such family is known.
    fn admits(&self, family: &str, pattern: &Pattern) -> Option<bool>;
}

/// A sample that rows were made from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Identity of its pattern.
    pub pattern: Digest,
    /// Its family.
    pub family: String,
}

/// What is wrong with the columns `source`, `symmetry`, `bin` and `family`.
#[must_use]
pub fn findings(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<Finding> {
    let columns = &dataset.columns;
    let error = |rows: Vec<usize>, message: &str| derived(Severity::Error, &rows, message);
    let unknown = rows(facts, |row, facts| {
        columns.family.is_some() && facts[row].is_pattern && facts[row].fits_family.is_none()
    });
    let symmetries = match dataset.device.symmetries {
        Symmetries::SQUARE => "0 to 7".to_owned(),
        group => group
            .iter()
            .map(|g| g.index().to_string())
            .collect::<Vec<_>>()
            .join(", "),
    };
    let found = [
        error(unturnable(dataset), &format!("`symmetry` is none of {symmetries}")),
        error(
            misled(facts, dataset),
            "`source` and `symmetry` do not lead to the pattern of the row",
        ),
        error(
            misplaced(facts, columns, dataset.bins),
            "`bin` is not that of the largest displacement",
        ),
        error(
            misnamed(facts, dataset),
            "`family` is not that of the sample that the row was made from",
        ),
        error(
            rows(facts, |row, facts| facts[row].fits_family == Some(false)),
            "the pattern is none that its `family` draws",
        ),
        derived(
            Severity::Warning,
            &unknown,
            "`family` is none that deaflow knows: whether it is true cannot be told",
        ),
    ];
    found.into_iter().flatten().collect()
}

fn derived(severity: Severity, rows: &[usize], message: &str) -> Option<Finding> {
    (!rows.is_empty()).then(|| Finding::rows("derived", severity, rows, message))
}

fn rows(facts: &[Facts], wanted: impl Fn(usize, &[Facts]) -> bool) -> Vec<usize> {
    (0..facts.len()).filter(|&row| wanted(row, facts)).collect()
}

fn unturnable(dataset: &Dataset<'_>) -> Vec<usize> {
    let group = dataset.device.symmetries;
    let is_known = |symmetry: u64| group.iter().any(|g| g.index() as u64 == symmetry);
    let symmetries = dataset.columns.symmetry.iter().flatten().enumerate();
    let wrong = symmetries.filter(|(_, symmetry)| !is_known(**symmetry));
    wrong.map(|(row, _)| row).collect()
}

/// Rows that their source and symmetry do not give.
fn misled(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<usize> {
    let columns = &dataset.columns;
    let Some(source) = &columns.source else {
        return Vec::new();
    };
    if let (Some(origins), Some(_)) = (dataset.origins, &columns.symmetry) {
        let of_source = |row: usize| {
            origins
                .get(usize::try_from(source[row]).ok()?)
                .map(|origin| origin.pattern)
        };
        return rows(facts, |row, facts| {
            facts[row].is_pattern && of_source(row).is_none_or(|wanted| facts[row].unturned != Some(wanted))
        });
    }
    let is_turned = columns.symmetry.is_some();
    let came_from = |row: usize| match is_turned {
        true => facts[row].unturned.map(|pattern| pattern.to_string()),
        false => facts[row].identity.as_ref().map(|(_, orbit)| orbit.to_string()),
    };
    let with_pattern = (0..facts.len()).filter(|&row| facts[row].is_pattern);
    unlike(with_pattern.map(|row| (row, source[row], came_from(row))))
}

/// Rows whose family is not that of their source, or of the other rows of that.
fn misnamed(facts: &[Facts], dataset: &Dataset<'_>) -> Vec<usize> {
    let columns = &dataset.columns;
    let (Some(source), Some(family)) = (&columns.source, &columns.family) else {
        return Vec::new();
    };
    if let Some(origins) = dataset.origins {
        let of_source = |row: usize| origins.get(usize::try_from(source[row]).ok()?);
        return rows(facts, |row, _| {
            of_source(row).is_some_and(|origin| origin.family != family[row])
        });
    }
    unlike((0..facts.len()).map(|row| (row, source[row], &family[row])))
}

/// Rows whose value is not that of most rows of their group; all of a group, where no value is that of most.
fn unlike<G: Ord, V: Ord + Clone>(rows: impl Iterator<Item = (usize, G, V)>) -> Vec<usize> {
    let mut groups: BTreeMap<G, Vec<(usize, V)>> = BTreeMap::new();
    for (row, group, value) in rows {
        groups.entry(group).or_default().push((row, value));
    }
    let mut wrong = Vec::new();
    for members in groups.into_values() {
        let mut counts: BTreeMap<&V, usize> = BTreeMap::new();
        members
            .iter()
            .for_each(|(_, value)| *counts.entry(value).or_default() += 1);
        let most = counts.values().copied().max().unwrap_or(0);
        let usual: Vec<&V> = counts
            .iter()
            .filter(|(_, n)| **n == most)
            .map(|(value, _)| *value)
            .collect();
        let is_usual = |value: &V| matches!(usual[..], [one] if one == value);
        wrong.extend(
            members
                .iter()
                .filter(|(_, value)| !is_usual(value))
                .map(|(row, _)| *row),
        );
    }
    wrong.sort_unstable();
    wrong
}

/// Rows whose largest displacement lies in another bin.
fn misplaced(facts: &[Facts], columns: &Columns, bins: Option<Bins>) -> Vec<usize> {
    let Some(bin) = &columns.bin else {
        return Vec::new();
    };
    let with_field: Vec<usize> = rows(facts, |row, facts| facts[row].has_field);
    if let Some(bins) = bins {
        let is_in = |row: usize| {
            let places = [-EDGE, 0.0, EDGE].map(|off| bins.place(facts[row].peak * (1.0 + off)));
            places
                .iter()
                .any(|place| matches!(place, Place::Bin(found) if *found as u64 == bin[row]))
        };
        return with_field.into_iter().filter(|&row| !is_in(row)).collect();
    }
    let (mut ordered, mut wrong): (Vec<usize>, Vec<usize>) =
        with_field.into_iter().partition(|&row| bin[row] != NO_NUMBER);
    ordered.sort_by(|&a, &b| facts[a].peak.total_cmp(&facts[b].peak).then(bin[a].cmp(&bin[b])));
    wrong.extend(outside_the_order(&ordered, |row| bin[row]));
    wrong.sort_unstable();
    wrong
}

/// The fewest rows without which the values of the others do not fall.
fn outside_the_order(ordered: &[usize], value: impl Fn(usize) -> u64) -> Vec<usize> {
    // The longest sequence that does not fall: of each length the one with the lowest last value, and what stands before it.
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
    let mut wrong: Vec<usize> = ordered
        .iter()
        .zip(kept)
        .filter(|(_, kept)| !kept)
        .map(|(row, _)| *row)
        .collect();
    wrong.sort_unstable();
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_row_that_differs_from_most_of_its_group_is_named() {
        let rows = [
            (0, 'a', 1),
            (1, 'a', 1),
            (2, 'a', 2),
            (3, 'b', 5),
            (4, 'c', 1),
            (5, 'c', 2),
        ];
        assert_eq!(unlike(rows.into_iter()), [2, 4, 5]);
    }

    #[test]
    fn as_few_rows_as_possible_stand_outside_the_order() {
        let bins = [0, 0, 7, 1, 1, 2, 0, 3, 3];
        let ordered: Vec<usize> = (0..bins.len()).collect();
        assert_eq!(outside_the_order(&ordered, |row| bins[row]), [2, 6]);
        assert_eq!(outside_the_order(&[], |_| 0), [0_usize; 0]);
    }
}
