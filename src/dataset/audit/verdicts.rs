//! Findings about wrong and inaccurate labels.

use std::collections::BTreeMap;

use super::diagnosis::Fault;
use super::finding::{Finding, Severity};
use super::labels::LabelCheck;
use super::resimulate::{Resimulated, is_wrong};

/// Rows with the same fault.
#[derive(Default)]
struct Wrong {
    rows: Vec<usize>,
    ratios: Vec<f64>,
    /// The largest difference, mm.
    off: f64,
}

/// Returns the findings about wrong labels, by fault.
#[must_use]
pub fn of_labels(labels: &[LabelCheck]) -> Vec<Finding> {
    let mut wrong: BTreeMap<&str, Wrong> = BTreeMap::new();
    let (mut unstable, mut stable) = (Vec::new(), Vec::new());
    for (index, label) in labels.iter().enumerate() {
        match *label {
            LabelCheck::Wrong(fault, off) => {
                let own = wrong.entry(fault.check()).or_default();
                own.rows.push(index);
                own.off = own.off.max(off);
                if let Fault::Scale(ratio) = fault {
                    own.ratios.push(ratio);
                }
            }
            LabelCheck::NoSolution => unstable.push(index),
            LabelCheck::Stable => stable.push(index),
            LabelCheck::Absent | LabelCheck::Agrees | LabelCheck::Compared { .. } => {}
        }
    }
    let finding = |(check, own): (&str, Wrong)| {
        let message = message(check, &own.ratios, own.off);
        Finding::rows(check, Severity::Error, &own.rows, message)
    };
    let mut findings: Vec<Finding> = wrong.into_iter().map(finding).collect();
    if !unstable.is_empty() {
        let message = "the row has a field, and its pattern has no stable solution";
        findings.push(Finding::rows("outcome", Severity::Error, &unstable, message));
    }
    if !stable.is_empty() {
        let message = "the row has no field, and its pattern has a stable solution";
        findings.push(Finding::rows("outcome", Severity::Error, &stable, message));
    }
    findings
}

fn message(check: &str, ratios: &[f64], off: f64) -> String {
    match check {
        "sign" => "the field has the wrong sign".to_owned(),
        "scale" => {
            let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
            let most = ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let number = |ratio: f64| match ratio.abs() {
                1e-3..1e4 => format!("{ratio:.4}"),
                _ => format!("{ratio:.3e}"),
            };
            let by = match most - least < 1e-4 {
                true => number(least),
                false => format!("{} to {}", number(least), number(most)),
            };
            format!("the field is {by} times what the pattern gives")
        }
        "rotation" => {
            "the field has been turned or mirrored, and its components have not, or the other way round".to_owned()
        }
        "frame" => "the field is that of another image of the pattern".to_owned(),
        _ => format!("the field is not what the pattern gives: it is off by up to {off:.3e} mm"),
    }
}

/// Returns the findings of finer meshes about labels that are right on their own mesh.
#[must_use]
pub fn of_accuracy(resimulated: &[Resimulated], labels: &[LabelCheck]) -> Vec<Finding> {
    let right = |row: &&Resimulated| !is_wrong(labels[row.index]);
    let resimulated: Vec<Resimulated> = resimulated.iter().filter(right).copied().collect();
    let rows = |wanted: fn(&Resimulated) -> bool| -> Vec<usize> {
        let wanted = resimulated.iter().filter(|row| wanted(row));
        wanted.map(|row| row.index).collect()
    };
    let mut findings = Vec::new();
    let inaccurate = rows(Resimulated::exceeds);
    if !inaccurate.is_empty() {
        let worst = resimulated.iter().filter(|row| row.exceeds());
        let worst = worst.filter_map(|row| row.error);
        let message = format!(
            "on a finer mesh the field differs by up to {:.3e} mm, more than is declared",
            worst.fold(0.0, f64::max)
        );
        findings.push(Finding::rows("accuracy", Severity::Error, &inaccurate, message));
    }
    let unstable = rows(Resimulated::is_unstable);
    if !unstable.is_empty() {
        let message = "on a finer mesh the pattern has no stable solution: it is close to where stability is lost, and \
                       the mesh of the label too coarse to tell";
        findings.push(Finding::rows("stability", Severity::Warning, &unstable, message));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_show_ratios_with_a_few_digits() {
        assert!(message("scale", &[1.03], 0.1).contains("1.0300 times"));
        assert!(message("scale", &[1e300, 0.97], 0.1).contains("0.9700 to 1.000e300 times"));
    }
}
