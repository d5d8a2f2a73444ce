//! Checks whether the stages that a calibration needs can have enough patterns, as far as the file says it.

use std::collections::BTreeMap;

use crate::{needed, sample};
use deaflow_base::{InputError, Parameter};
use deaflow_content::FROM_FILE;
use deaflow_orchestrator::StageDeclaration;
use deaflow_pattern::Symmetry;
use deaflow_surrogate::MIN_PATTERNS;

/// One row in so many of a balanced set is a test row.
const TEST_SHARE: u64 = 10;

/// The largest number of labelled patterns of a stage.
struct Most {
    /// Of each family.
    families: BTreeMap<String, u64>,
    /// Of all families.
    total: u64,
    /// As far as known: how many there probably are.
    likely: u64,
}

impl Most {
    /// Returns what a stage with labels has at most; `None` if the file does not say it.
    fn of(stage: &StageDeclaration<'_>) -> Option<Self> {
        let sum = |families: &BTreeMap<String, u64>| families.values().fold(0, |sum: u64, n| sum.saturating_add(*n));
        match stage.kind {
            "solve" => {
                let mut families = BTreeMap::new();
                for samples in stage.needs() {
                    add(&mut families, drawn(&samples)?);
                }
                let total = sum(&families);
                Some(Self {
                    families,
                    total,
                    likely: total,
                })
            }
            "balance" => {
                let target = stage.node.peek("target")?;
                let target = u64::read(target, "target", &(1..=u64::MAX)).ok()?;
                let mut families = BTreeMap::new();
                for solved in stage.needs() {
                    add(&mut families, Self::of(&solved)?.families);
                }
                for count in families.values_mut() {
                    *count = count.saturating_mul(Symmetry::ALL.len() as u64);
                }
                let total = sum(&families).min(target);
                Some(Self {
                    families,
                    total,
                    likely: total / TEST_SHARE,
                })
            }
            _ => None,
        }
    }

    /// Returns the largest number of patterns of some families.
    fn of_families(&self, trained: &BTreeMap<String, u64>) -> u64 {
        let own = self.families.iter().filter(|(family, _)| trained.contains_key(*family));
        own.fold(0, |sum: u64, (_, count)| sum.saturating_add(*count))
            .min(self.total)
    }
}

fn add(families: &mut BTreeMap<String, u64>, more: BTreeMap<String, u64>) {
    for (family, count) in more {
        let sum = families.entry(family).or_default();
        *sum = sum.saturating_add(count);
    }
}

/// Returns the number of patterns of each family of a stage without labels. Patterns from files are not counted.
fn drawn(samples: &StageDeclaration<'_>) -> Option<BTreeMap<String, u64>> {
    match samples.kind {
        "sample" => sample::drawn(samples),
        "patterns" => Some(BTreeMap::from([(FROM_FILE.to_owned(), u64::MAX)])),
        _ => None,
    }
}

/// Returns the families that a model is trained on, as keys.
fn trained(model: &StageDeclaration<'_>) -> Option<BTreeMap<String, u64>> {
    let mut families = BTreeMap::new();
    for labels in model.needs().filter(|need| !["train", "audit"].contains(&need.kind)) {
        match labels.kind {
            "verify" => {}
            _ => add(&mut families, Most::of(&labels)?.families),
        }
    }
    Some(families)
}

/// Refuses balanced sets that are too small, and patterns of families that the model is not trained on; returns a
/// warning if a balanced set probably has too few test rows.
///
/// # Errors
/// If there are certainly too few patterns.
pub fn check(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<Vec<String>, InputError> {
    let labels: Vec<&StageDeclaration<'_>> = needs.iter().filter(|need| super::LABELS.contains(&need.kind)).collect();
    let Some(most) = labels.iter().map(|need| Most::of(need)).collect::<Option<Vec<Most>>>() else {
        return Ok(Vec::new());
    };
    let least = MIN_PATTERNS as u64;
    let sum = |count: &dyn Fn(&Most) -> u64| most.iter().map(count).fold(0, u64::saturating_add);
    let total = sum(&|most| most.total);
    let balanced = labels.iter().find(|need| need.kind == "balance");
    if let Some(balanced) = balanced.filter(|_| total < least) {
        return Err(needed::named(stage, balanced.name)
            .error(format!(
                "a calibration needs {MIN_PATTERNS} patterns that were not used in training, and `needs` has at most \
                 {total}"
            ))
            .help("increase `target`: about a tenth of the rows of a balanced set are test rows"));
    }
    let models = needs.iter().filter(|need| need.kind == "train");
    let families = models.map(trained).next().flatten();
    // Fewer patterns than that are refused by their number.
    if let Some(families) = families.filter(|_| total >= least) {
        let familiar = sum(&|most| most.of_families(&families));
        if familiar < least {
            let names: Vec<&str> = families.keys().map(String::as_str).collect();
            return Err(needed::wrong_number(
                stage,
                format!(
                    "a calibration needs {MIN_PATTERNS} patterns of the training families, and `needs` has at most \
                     {familiar}; these are: {}",
                    names.join(", ")
                ),
                "draw patterns of these families, or train on the others too",
            ));
        }
    }
    let likely = sum(&|most| most.likely);
    Ok(match balanced.filter(|_| likely < least) {
        None => Vec::new(),
        Some(balanced) => vec![format!(
            "a calibration needs {MIN_PATTERNS} patterns that were not used in training, and `needs` probably has only \
             {likely}: about a tenth of the rows of `{}` are test rows",
            balanced.name
        )],
    })
}
