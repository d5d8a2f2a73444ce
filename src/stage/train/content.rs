//! What the artifact of a training says.

use super::examples::{LeftOut, Why};
use crate::stage::arrays;
use crate::store::{Data, Dataset, Object};
use crate::surrogate::{Ending, EpochReport, Metrics, Trained};

/// Labels that a warning names one by one.
const NAMED: usize = 5;

/// What a user should know: a line each.
pub fn warnings(unstable: u64, left_out: &[LeftOut], trained: &Trained) -> Vec<String> {
    let mut lines = Vec::new();
    if unstable > 0 {
        lines.push(format!("{unstable} samples without a stable solution are left out"));
    }
    // What is held out stands in another input: nothing is lost.
    let left_out: Vec<&LeftOut> = left_out.iter().filter(|label| label.why != Why::HeldOut).collect();
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
            "the training diverged in epoch {epoch}: the weights of epoch {} are kept; a smaller learning rate may help",
            trained.best_epoch
        ));
    }
    lines
}

/// The arrays of a training.
pub fn describe(trained: &Trained, unstable: u64, left_out: &[LeftOut]) -> Object {
    let weights = Data::U8(trained.weights.clone());
    let object = Object::default()
        .with(
            "weights",
            Dataset::new(
                "1",
                "the model as the bytes of a safetensors file",
                &[trained.weights.len()],
                weights,
            ),
        )
        .with(
            "best_epoch",
            arrays::wholes(
                "1",
                "epoch whose weights are kept, from 1",
                vec![u64::from(trained.best_epoch)],
            ),
        )
        .with(
            "counts/unstable",
            arrays::wholes(
                "1",
                "samples left out because they have no stable solution",
                vec![unstable],
            ),
        );
    let object = add_curves(object, &trained.curves);
    let object = add_left_out(object, left_out);
    add_metrics(object, &trained.metrics)
}

fn add_curves(object: Object, curves: &[EpochReport]) -> Object {
    let curve = |units, description, value: fn(&EpochReport) -> f64| {
        arrays::reals(units, description, curves.iter().map(value).collect())
    };
    // Where nothing is shown more than once epochs are judged by the validation error.
    let object = match curves.iter().any(|e| e.judged_rmse_mm != e.validation_rmse_mm) {
        true => object.with(
            "curves/judged_rmse",
            curve(
                "mm",
                "RMSE per component by which epochs are judged: with verified designs",
                |e| e.judged_rmse_mm,
            ),
        ),
        false => object,
    };
    object
        .with(
            "curves/train_loss",
            curve("1", "training loss of each epoch", |e| e.train_loss),
        )
        .with(
            "curves/validation_loss",
            curve("1", "validation loss of each epoch", |e| e.validation_loss),
        )
        .with(
            "curves/validation_rmse",
            curve("mm", "validation RMSE per component of each epoch", |e| {
                e.validation_rmse_mm
            }),
        )
        .with(
            "curves/learning_rate",
            curve("1", "learning rate at the end of each epoch", |e| e.learning_rate),
        )
}

fn add_left_out(object: Object, left_out: &[LeftOut]) -> Object {
    let wholes = |description, value: fn(&LeftOut) -> usize| {
        arrays::wholes("1", description, left_out.iter().map(|l| value(l) as u64).collect())
    };
    object
        .with(
            "left_out/input",
            wholes("input that a label left out stands in, from 0", |l| l.input),
        )
        .with("left_out/row", wholes("its row in that input, from 0", |l| l.row))
        .with(
            "left_out/displacement",
            arrays::reals(
                "mm",
                "the displacement that shows it; 0 where it is not a number",
                left_out.iter().map(|l| l.found_mm).collect(),
            ),
        )
        .with(
            "left_out/why",
            arrays::texts("what is wrong with it", left_out.iter().map(|l| l.why.name())),
        )
}

fn add_metrics(object: Object, metrics: &[Metrics]) -> Object {
    let metric = |units, description, value: fn(&Metrics) -> f64| {
        arrays::reals(units, description, metrics.iter().map(value).collect())
    };
    object
        .with(
            "metrics/family",
            arrays::texts(
                "family that the metrics are over",
                metrics.iter().map(|m| m.family.as_str()),
            ),
        )
        .with(
            "metrics/split",
            arrays::texts(
                "split that the metrics are over",
                metrics.iter().map(|m| m.split.name()),
            ),
        )
        .with(
            "metrics/samples",
            arrays::wholes(
                "1",
                "samples that the metrics are over",
                metrics.iter().map(|m| m.samples).collect(),
            ),
        )
        .with(
            "metrics/rmse",
            metric("mm", "root mean square error per component", |m| m.rmse_mm),
        )
        .with("metrics/r2", metric("1", "coefficient of determination", |m| m.r2))
        .with(
            "metrics/max_error",
            metric("mm", "largest absolute error of a component", |m| m.max_error_mm),
        )
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn what_a_user_should_know_is_told_and_nothing_else() {
        assert_eq!(warnings(0, &[], &trained(Ending::Complete)), Vec::<String>::new());
        assert_eq!(warnings(0, &[], &trained(Ending::Patience)), Vec::<String>::new());
        let left_out = |row| LeftOut {
            input: 1,
            row,
            found_mm: 100.0,
            why: Why::BeyondSide(50.0),
        };
        let many: Vec<LeftOut> = (0..8).map(left_out).collect();
        let told = warnings(3, &many, &trained(Ending::Diverged(4)));
        assert_eq!(told[0], "3 samples without a stable solution are left out");
        assert!(
            told[1].starts_with("8 labels are left out: row 0 of input 2: 100.000 mm are more than"),
            "{told:?}"
        );
        assert!(told[1].ends_with("; and 3 more, under `left_out/`"), "{told:?}");
        assert!(
            told[2].starts_with("the training diverged in epoch 4: the weights of epoch 2 are kept"),
            "{told:?}"
        );
        assert_eq!(told.len(), 3);
    }

    #[test]
    fn labels_left_out_stand_in_the_artifact() {
        let left_out = LeftOut {
            input: 1,
            row: 7,
            found_mm: 100.0,
            why: Why::BeyondSide(50.0),
        };
        let object = describe(&trained(Ending::Complete), 5, &[left_out]);
        let data = |path: &str| object.datasets[path].data.clone();
        assert_eq!(data("left_out/input"), Data::U64(vec![1]));
        assert_eq!(data("left_out/row"), Data::U64(vec![7]));
        assert_eq!(data("left_out/displacement"), Data::F64(vec![100.0]));
        assert_eq!(data("left_out/why"), Data::Text(vec!["beyond-the-side".to_owned()]));
        assert_eq!(data("counts/unstable"), Data::U64(vec![5]));
    }
}
