//! Rows that show one pattern, or images of one: repeats, leaks between the parts of a dataset, and fields that do not
//! move with their patterns.

use std::collections::BTreeMap;

use super::facts::Facts;
use super::finding::{Finding, Severity};
use super::labels::{Judge, LabelCheck};
use super::rows::Columns;
use super::symmetric::{PROJECTIONS, distance};
use deaflow_base::{Digest, OrbitId};
use deaflow_field::Mesh;

/// Rows by orbit, in the order of their first row; rows without a pattern are left out.
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

/// Rows that repeat the pattern of an earlier row.
#[must_use]
pub fn repeats(facts: &[Facts]) -> Vec<usize> {
    let groups = grouped(facts, |(pattern, _)| *pattern);
    let mut repeats: Vec<usize> = groups.iter().flat_map(|group| group[1..].iter().copied()).collect();
    repeats.sort_unstable();
    repeats
}

/// What is wrong with repeats and images. `repeats_are_usual` where later stages leave repeats out.
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

/// Rows of an orbit that lies in several parts, other than the part that holds most of the orbit; all, where no part does.
fn leaks(facts: &[Facts], split: &[String]) -> Option<Finding> {
    let mut leaked = Vec::new();
    for orbit in orbits(facts) {
        let mut parts: BTreeMap<&str, usize> = BTreeMap::new();
        orbit
            .iter()
            .for_each(|&row| *parts.entry(&split[row]).or_default() += 1);
        let most = parts.values().copied().max().unwrap_or(0);
        // Of parts that hold as much, neither is known to be the right one.
        let homes: Vec<&str> = parts
            .iter()
            .filter(|(_, rows)| **rows == most)
            .map(|(part, _)| *part)
            .collect();
        let is_home = |row: usize| homes == [split[row].as_str()];
        leaked.extend(orbit.iter().copied().filter(|&row| parts.len() > 1 && !is_home(row)));
    }
    leaked.sort_unstable();
    let message = "the pattern, or an image of it, stands in another part of the dataset too: what is measured on that part is \
                   flattered";
    (!leaked.is_empty()).then(|| Finding::rows("leak", Severity::Error, &leaked, message))
}

/// Rows whose field does not have the symmetry of its pattern, or does not move with it. Of two that contradict each other,
/// the one is named that is wrong for itself, where that is known.
#[must_use]
pub fn asymmetric(facts: &[Facts], labels: &[LabelCheck], judge: &Judge<'_>, columns: &Columns) -> Option<Finding> {
    let tolerance = judge.tolerance;
    let usable = |&index: &usize| facts[index].is_usable();
    let mut found: Vec<usize> = (0..facts.len())
        .filter(|index| usable(index) && facts[*index].asymmetry > 2.0 * tolerance.of(facts[*index].peak))
        .collect();
    // Fields on different meshes differ, and rightly.
    let alike = orbits(facts).into_iter().flat_map(|orbit| {
        let mut alike: BTreeMap<Option<Mesh>, Vec<usize>> = BTreeMap::new();
        for member in orbit.into_iter().filter(usable) {
            alike.entry(judge.mesh(columns, member)).or_default().push(member);
        }
        alike.into_values().filter(|members| members.len() > 1)
    });
    for members in alike {
        let usual = usual(facts, &members);
        let off = |&&index: &&usize| distance(&facts[index].projections, &usual) > tolerance.of(facts[index].peak);
        let off: Vec<usize> = members.iter().filter(off).copied().collect();
        let wrong: Vec<usize> = off
            .iter()
            .filter(|&&index| matches!(labels[index], LabelCheck::Wrong(..)))
            .copied()
            .collect();
        found.extend(if wrong.is_empty() { off } else { wrong });
    }
    found.sort_unstable();
    found.dedup();
    let message = "the field does not go with the fields of the pattern's images, or lacks the symmetry of its pattern";
    (!found.is_empty()).then(|| Finding::rows("symmetry", Severity::Error, &found, message))
}

/// The median of each projection.
fn usual(facts: &[Facts], members: &[usize]) -> [f64; PROJECTIONS] {
    std::array::from_fn(|k| {
        let mut values: Vec<f64> = members.iter().map(|&index| facts[index].projections[k]).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        0.5 * (values[(n - 1) / 2] + values[n / 2])
    })
}
