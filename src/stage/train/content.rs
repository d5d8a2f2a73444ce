//! The artifact of a train stage.

use crate::without::Dropped;
use deaflow_content::{Curves, LeftOutLabels, Lines, Metrics, Training};
use deaflow_scene::Scene;
use deaflow_surrogate as surrogate;
use deaflow_surrogate::{Ending, EpochReport, Examples, LeftOut, LeftOutReason, NetworkKind, Trained};

/// The number of labels that a warning lists.
const NAMED: usize = 5;

/// Returns the warnings of a training.
fn warnings(unstable: u64, left_out: &[LeftOut], trained: &Trained) -> Vec<String> {
    let mut lines = Vec::new();
    if unstable > 0 {
        lines.push(format!("{unstable} samples without a stable solution are left out"));
    }
    // Labels that are held out are in another input, so nothing is lost.
    let left_out: Vec<&LeftOut> = left_out
        .iter()
        .filter(|label| label.reason != LeftOutReason::HeldOut)
        .collect();
    if !left_out.is_empty() {
        let named: Vec<String> = left_out.iter().take(NAMED).map(ToString::to_string).collect();
        let more = match left_out.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!("; and {more} more, under `left_out/`"),
        };
        lines.push(format!(
            "{} labels are left out: {}{more}",
            left_out.len(),
            named.join("; ")
        ));
    }
    if let Ending::Diverged(epoch) = trained.ending {
        lines.push(format!(
            "the training diverged in epoch {epoch}: the weights of epoch {} are kept; try a smaller learning rate",
            trained.best_epoch
        ));
    }
    lines
}

/// Returns the artifact of a training.
pub fn training(
    trained: Trained,
    examples: &Examples,
    dropped: &Dropped,
    network: NetworkKind,
    scene: Scene,
) -> Training {
    let (dropped, without) = dropped.content();
    let warnings = warnings(examples.unstable, &examples.left_out, &trained);
    Training {
        best_epoch: [u64::from(trained.best_epoch)],
        unstable: [examples.unstable],
        curves: curves(&trained.curves),
        left_out: left_out(&examples.left_out),
        metrics: metrics(&trained.metrics),
        network: network.name().to_owned(),
        ending: ending(trained.ending).to_owned(),
        weights: trained.weights,
        dropped,
        without,
        scene,
        warnings: (!warnings.is_empty()).then_some(Lines(warnings)),
    }
}

fn curves(epochs: &[EpochReport]) -> Curves {
    let curve = |value: fn(&EpochReport) -> f64| epochs.iter().map(value).collect();
    // If no example is repeated, epochs are judged by the validation error.
    let is_judged = epochs.iter().any(|e| e.selection_rmse_mm != e.validation_rmse_mm);
    Curves {
        judged_rmse: is_judged.then(|| curve(|e| e.selection_rmse_mm)),
        train_loss: curve(|e| e.train_loss),
        validation_loss: curve(|e| e.validation_loss),
        validation_rmse: curve(|e| e.validation_rmse_mm),
        learning_rate: curve(|e| e.learning_rate),
    }
}

fn left_out(labels: &[LeftOut]) -> LeftOutLabels {
    LeftOutLabels {
        input: labels.iter().map(|label| label.input as u64).collect(),
        row: labels.iter().map(|label| label.row as u64).collect(),
        displacement: labels.iter().map(|label| label.found_mm).collect(),
        why: labels.iter().map(|label| label.reason.name().to_owned()).collect(),
    }
}

fn metrics(metrics: &[surrogate::Metrics]) -> Metrics {
    Metrics {
        family: metrics.iter().map(|m| m.family.clone()).collect(),
        split: metrics.iter().map(|m| m.split.name().to_owned()).collect(),
        samples: metrics.iter().map(|m| m.samples).collect(),
        rmse: metrics.iter().map(|m| m.rmse_mm).collect(),
        r2: metrics.iter().map(|m| m.r2).collect(),
        max_error: metrics.iter().map(|m| m.max_error_mm).collect(),
    }
}

/// Returns the word that is stored.
fn ending(ending: Ending) -> &'static str {
    match ending {
        Ending::Complete => "complete",
        Ending::Patience => "patience",
        Ending::Diverged(_) => "diverged",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_store::Data;

    fn trained(ending: Ending) -> Trained {
        Trained {
            weights: vec![1, 2, 3],
            curves: Vec::new(),
            metrics: Vec::new(),
            best_epoch: 2,
            ending,
        }
    }

    #[test]
    fn only_unusual_trainings_have_warnings() {
        assert_eq!(warnings(0, &[], &trained(Ending::Complete)), Vec::<String>::new());
        assert_eq!(warnings(0, &[], &trained(Ending::Patience)), Vec::<String>::new());
        let left_out = |row| LeftOut {
            input: 1,
            row,
            found_mm: 100.0,
            reason: LeftOutReason::BeyondSide(50.0),
        };
        let many: Vec<LeftOut> = (0..8).map(left_out).collect();
        let found = warnings(3, &many, &trained(Ending::Diverged(4)));
        assert_eq!(found[0], "3 samples without a stable solution are left out");
        assert!(
            found[1].starts_with("8 labels are left out: row 0 of input 2: displacement 100.000 mm exceeds the side"),
            "{found:?}"
        );
        assert!(found[1].ends_with("; and 3 more, under `left_out/`"), "{found:?}");
        assert!(
            found[2].starts_with("the training diverged in epoch 4: the weights of epoch 2 are kept"),
            "{found:?}"
        );
        assert_eq!(found.len(), 3);
    }

    #[test]
    fn labels_left_out_are_listed_in_the_artifact() {
        let left_out = LeftOut {
            input: 1,
            row: 7,
            found_mm: 100.0,
            reason: LeftOutReason::BeyondSide(50.0),
        };
        let examples = Examples {
            examples: Vec::new(),
            unstable: 5,
            left_out: vec![left_out],
        };
        let trained = trained(Ending::Complete);
        let object = training(
            trained,
            &examples,
            &Dropped::default(),
            NetworkKind::Qin2024,
            Scene::vhb4910(),
        )
        .object();
        let data = |path: &str| object.datasets[path].data.clone();
        assert_eq!(data("left_out/input"), Data::U64(vec![1]));
        assert_eq!(data("left_out/row"), Data::U64(vec![7]));
        assert_eq!(data("left_out/displacement"), Data::F64(vec![100.0]));
        assert_eq!(data("left_out/why"), Data::Text(vec!["beyond-the-side".to_owned()]));
        assert_eq!(data("counts/unstable"), Data::U64(vec![5]));
    }
}
