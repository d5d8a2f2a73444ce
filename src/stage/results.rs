//! The results of stages: numbers by name.

use std::path::Path;

use deaflow_base::Document;
use deaflow_content::{ArtifactKind, Samples, Solutions};
use deaflow_field::{CHARGE_UNIT, REACTION_UNIT};
use deaflow_orchestrator::StageError;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// Makes results from names and numbers.
pub fn named<const N: usize>(results: [(&str, f64); N]) -> Vec<(String, f64)> {
    results.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Returns the first words of the results that an artifact of a kind may have; none for an unknown kind.
pub fn words_of(kind: &str) -> &'static [&'static str] {
    let Some(kind) = ArtifactKind::from_name(kind) else {
        return &[];
    };
    match kind {
        ArtifactKind::Sample | ArtifactKind::Patterns => &["samples", "area"],
        ArtifactKind::Solve | ArtifactKind::Import => &["samples", "unstable", "max_displacement", "mean_displacement"],
        ArtifactKind::Balance => &["rows", "max_displacement"],
        ArtifactKind::Train => &["rmse", "best_epoch"],
        ArtifactKind::Calibrate => &["samples", "novelty_threshold"],
        ArtifactKind::Evaluate => &["rmse", "max_error"],
        ArtifactKind::Measure => &["files", "rows"],
        ArtifactKind::Fit => &["fitted", "chi2_per_dof"],
        ArtifactKind::Compare => &["rms", "r_squared", "chi2_per_dof"],
        ArtifactKind::Design => &[
            "predicted",
            "predicted_reaction",
            PREDICTED_VOLUME,
            "robust",
            "area",
            CHARGE,
            HYPERVOLUME,
            CHARGE_HYPERVOLUME,
        ],
        ArtifactKind::Verify => &[
            VOLUME,
            "displacement",
            "reaction",
            "area",
            PREDICTED_VOLUME,
            "predicted",
            "predicted_reaction",
        ],
        ArtifactKind::Yield => &["yield", "mean", "deviation", "failed"],
        ArtifactKind::Accuracy => &["max_error"],
        ArtifactKind::Audit => &["rows", "errors", "warnings"],
        ArtifactKind::Table => &[],
    }
}

/// Returns the unit of a result, by its first word.
pub fn unit(name: &str) -> &'static str {
    const LENGTHS: [&str; 11] = [
        "max_displacement",
        "mean_displacement",
        "displacement",
        "predicted",
        "robust",
        "rmse",
        "max_error",
        "error",
        "mean",
        "deviation",
        HYPERVOLUME,
    ];
    let word = name.split('.').next().unwrap_or(name);
    match word {
        REACTION | PREDICTED_REACTION => REACTION_UNIT,
        VOLUME | PREDICTED_VOLUME => "ml",
        CHARGE => CHARGE_UNIT,
        CHARGE_HYPERVOLUME => "mm nC",
        word if LENGTHS.contains(&word) => "mm",
        _ => "1",
    }
}

/// The simulated and the predicted value of a design whose objective is a `reaction`.
pub const REACTION: &str = "reaction";
pub const PREDICTED_REACTION: &str = "predicted_reaction";

/// The simulated and the predicted change of the volume of a design whose objective is a `volume`; its value in files
/// is the mean height, which is the result `displacement`.
pub const VOLUME: &str = "volume";
pub const PREDICTED_VOLUME: &str = "predicted_volume";

/// Returns the volume in ml of a mean height of 1 mm over the rectangle of a scene, if an objective is one volume or
/// several; `None` for others.
pub fn ml_per_mm(objective: &str, scene: &Scene) -> Option<f64> {
    let document = Document::from_text(Path::new("objective"), objective).ok()?;
    let root = &document.root;
    let targets = match root.peek("points") {
        Some(points) => points.list("points").ok()?,
        None => std::slice::from_ref(root),
    };
    let are_volumes = !targets.is_empty() && targets.iter().all(|target| target.peek("volume").is_some());
    are_volumes.then(|| scene.membrane().ml_per_mm())
}

/// The hypervolume of a front of displacements: in mm, as areas are fractions.
pub const HYPERVOLUME: &str = "hypervolume";

/// The same where designs are those for each charge, and the charge of each design.
pub const CHARGE_HYPERVOLUME: &str = "charge_hypervolume";
pub const CHARGE: &str = "charge";

/// Returns the results of samples: their number and mean area.
///
/// # Errors
/// If the artifact cannot be read.
pub fn of_samples(artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
    let area = Samples::open(artifact)?.area().read()?;
    Ok(named([("samples", area.len() as f64), ("area", mean(&area))]))
}

/// Returns the results of solved samples: the numbers of stable and unstable ones, and their largest displacements.
///
/// # Errors
/// If the artifact cannot be read.
pub fn of_solutions(artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
    let view = Solutions::open(artifact)?;
    let largest = view.max_displacement().read()?;
    Ok(named([
        ("samples", largest.len() as f64),
        ("unstable", view.unstable().outcome().rows()? as f64),
        ("max_displacement", most(&largest)),
        ("mean_displacement", mean(&largest)),
    ]))
}

/// Returns the mean; NaN if there are no numbers.
pub fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// Returns the largest; NaN if there are no numbers.
pub fn most(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(f64::NAN, f64::max)
}

/// Returns a result for each column and target. Its name is that of the column, followed by the target if there are
/// several. `rows` are the targets with their rows.
pub fn of_targets(rows: &[(&str, usize)], columns: &[(&str, &[f64])]) -> Vec<(String, f64)> {
    let is_single = rows.len() == 1;
    let of = |(column, numbers): &(&str, &[f64])| {
        let named = |(target, row): &(&str, usize)| {
            let name = if is_single {
                (*column).to_owned()
            } else {
                format!("{column}.{target}")
            };
            Some((name, *numbers.get(*row)?))
        };
        rows.iter().filter_map(named).collect::<Vec<_>>()
    };
    columns.iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_have_the_names_of_several_targets() {
        let numbers = [1.0, 2.0, 3.0, 4.0];
        let one = of_targets(&[("a", 2)], &[("value", &numbers), ("area", &numbers)]);
        assert_eq!(one, named([("value", 3.0), ("area", 3.0)]));
        let two = of_targets(&[("a", 3), ("b", 1)], &[("value", &numbers)]);
        assert_eq!(two, named([("value.a", 4.0), ("value.b", 2.0)]));
        assert_eq!(of_targets(&[], &[("value", &numbers)]), Vec::new());
    }

    #[test]
    fn objectives_are_volumes_if_all_their_targets_are() {
        let scene = Scene::vhb4910();
        let of = |text: &str| ml_per_mm(text, &scene);
        assert_eq!(of("{ volume: largest, measure: displacement }"), Some(2.5));
        assert_eq!(
            of("{ points: [{ volume: 1 ml, state: a }, { volume: 2 ml, state: b }] }"),
            Some(2.5)
        );
        assert_eq!(
            of("{ points: [{ volume: 1 ml }, { point: [1, 2], height: up }] }"),
            None
        );
        assert_eq!(of("{ point: [1, 2], direction: 0 }"), None);
    }

    #[test]
    fn the_mean_and_the_largest_of_no_numbers_are_nan() {
        assert!(mean(&[]).is_nan() && most(&[]).is_nan());
        assert_eq!((mean(&[1.0, 3.0]), most(&[1.0, 3.0])), (2.0, 3.0));
    }
}
