//! Checks of rows with the same pattern or with images of it: repeats, leaks between splits, and fields that are not
//! images of each other.

use std::collections::BTreeMap;

use super::claims::minority;
use super::facts::Facts;
use super::finding::{Finding, Severity};
use super::labels::{LabelCheck, LabelChecker};
use super::rows::Columns;
use super::symmetric::{PROJECTIONS, distance};
use deaflow_base::{Digest, OrbitId};
use deaflow_field::Mesh;

/// Returns the rows of each orbit, in the order of their first row. Rows without a pattern are omitted.
#[must_use]
pub fn orbits(facts: &[Facts]) -> Vec<Vec<usize>> {
    grouped(facts, |(_, orbit)| *orbit)
}

fn grouped<T: Ord>(facts: &[Facts], by: fn(&(Digest, OrbitId)) -> T) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<T, Vec<usize>> = BTreeMap::new();
    for (index, identity) in facts.iter().enumerate() {
        if let Some(identity) = &identity.identity {
            groups.entry(by(identity)).or_default().push(index);
        }
    }
    let mut groups: Vec<Vec<usize>> = groups.into_values().collect();
    groups.sort_unstable();
    groups
}

/// Returns rows that repeat the pattern of an earlier row.
#[must_use]
pub fn repeats(facts: &[Facts]) -> Vec<usize> {
    let groups = grouped(facts, |(pattern, _)| *pattern);
    let mut repeats: Vec<usize> = groups.iter().flat_map(|group| group[1..].iter().copied()).collect();
    repeats.sort_unstable();
    repeats
}

/// Returns the findings about repeats and leaks. `repeats_are_usual` if later stages omit repeats.
#[must_use]
pub fn findings(facts: &[Facts], split: Option<&[String]>, repeats_are_usual: bool) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some(split) = split {
        findings.extend(leaks(facts, split));
    }
    let repeats = repeats(facts);
    if !repeats.is_empty() && !repeats_are_usual {
        let message = "the row repeats the pattern of an earlier one";
        findings.push(Finding::rows("duplicate", Severity::Warning, &repeats, message));
    }
    findings
}

/// Finds orbits in several splits. Rows outside the split with most rows of the orbit leak; all rows if several splits
/// have most.
fn leaks(facts: &[Facts], split: &[String]) -> Option<Finding> {
    let orbits = orbits(facts).into_iter().enumerate();
    let leaked = minority(orbits.flat_map(|(orbit, rows)| rows.into_iter().map(move |row| (row, orbit, &split[row]))));
    let message = "the pattern, or an image of it, stands in another part of the dataset too: what is measured on that \
                   part is flattered";
    (!leaked.is_empty()).then(|| Finding::rows("leak", Severity::Error, &leaked, message))
}

/// Finds rows whose field lacks the symmetry of its pattern, or contradicts the fields of images of the pattern. Of
/// contradicting rows only those with a wrong label are listed, if there are any.
#[must_use]
pub fn asymmetric(
    facts: &[Facts],
    labels: &[LabelCheck],
    checker: &LabelChecker<'_>,
    columns: &Columns,
) -> Option<Finding> {
    let tolerance = checker.tolerance;
    let usable = |&index: &usize| facts[index].is_usable();
    let mut found: Vec<usize> = (0..facts.len())
        .filter(|index| usable(index) && facts[*index].asymmetry > 2.0 * tolerance.of(facts[*index].peak))
        .collect();
    // Only fields on the same mesh must be images of each other.
    let alike = orbits(facts).into_iter().flat_map(|orbit| {
        let mut alike: BTreeMap<Option<Mesh>, Vec<usize>> = BTreeMap::new();
        for member in orbit.into_iter().filter(usable) {
            alike.entry(checker.mesh(columns, member)).or_default().push(member);
        }
        alike.into_values().filter(|members| members.len() > 1)
    });
    for members in alike {
        let median = median(facts, &members);
        let is_off = |&index: &usize| distance(&facts[index].projections, &median) > tolerance.of(facts[index].peak);
        let off: Vec<usize> = members.into_iter().filter(is_off).collect();
        let is_wrong = |index: &usize| matches!(labels[*index], LabelCheck::Wrong(..));
        let wrong: Vec<usize> = off.iter().copied().filter(is_wrong).collect();
        found.extend(if wrong.is_empty() { off } else { wrong });
    }
    found.sort_unstable();
    found.dedup();
    let message = "the field does not go with the fields of the pattern's images, or lacks the symmetry of its pattern";
    (!found.is_empty()).then(|| Finding::rows("symmetry", Severity::Error, &found, message))
}

/// Returns the median of each projection.
fn median(facts: &[Facts], members: &[usize]) -> [f64; PROJECTIONS] {
    std::array::from_fn(|k| {
        let mut values: Vec<f64> = members.iter().map(|&index| facts[index].projections[k]).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        0.5 * (values[(n - 1) / 2] + values[n / 2])
    })
}
