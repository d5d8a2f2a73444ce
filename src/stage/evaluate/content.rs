//! The artifact of an evaluate stage.

use std::collections::BTreeSet;

use super::calibrated::Calibrated;
use super::predictors::NamedPredictor;
use deaflow_content as content;
use deaflow_content::{ALL_FAMILIES, Evaluation, PatternScores, Scores};
use deaflow_scene::Scene;
use deaflow_surrogate::{Coverage, OBJECTIVES, PatternScore, RowScores, Score};

/// Bins of the area fraction between 0 and 1.
const BINS: f64 = 20.0;

/// The errors of all predictors on one pattern.
pub struct EvaluationRow {
    /// Family of the pattern.
    pub family: String,
    /// Its area fraction.
    pub area: f64,
    /// The errors.
    pub result: RowScores,
}

/// Returns the content of the artifact.
pub fn evaluation(
    predictors: &[NamedPredictor],
    calibrated: &[Calibrated],
    rows: &[EvaluationRow],
    scene: Scene,
) -> Evaluation {
    let known: BTreeSet<&str> = rows.iter().map(|row| row.family.as_str()).collect();
    let families: Vec<&str> = known.into_iter().chain([ALL_FAMILIES]).collect();
    let members = |family: &str| {
        let of_family = rows.iter().filter(|row| family == ALL_FAMILIES || row.family == family);
        of_family.collect::<Vec<&EvaluationRow>>()
    };
    let groups: Vec<Vec<&EvaluationRow>> = families.iter().map(|family| members(family)).collect();
    // The non-empty bins of the area fraction, 5 % wide, over all families.
    let bin = |row: &EvaluationRow| (row.area * BINS).round() as u64;
    let bins: BTreeSet<u64> = rows.iter().map(bin).collect();
    let in_bin = |k: &u64| rows.iter().filter(|row| bin(row) == *k).collect();
    let binned: Vec<Vec<&EvaluationRow>> = bins.iter().map(in_bin).collect();
    Evaluation {
        predictors: predictors.iter().map(|c| c.name().to_owned()).collect(),
        predictor_digests: predictors.iter().map(|c| c.digest().to_owned()).collect(),
        trained: trained(predictors, &families),
        score: scores(predictors.len(), &groups),
        area_centre: bins.iter().map(|&k| k as f64 / BINS).collect(),
        area: scores(predictors.len(), &binned),
        pattern: pattern_scores(predictors.len(), rows),
        coverage: (!calibrated.is_empty()).then(|| coverage(predictors, calibrated, &families, &groups)),
        families: families.into_iter().map(str::to_owned).collect(),
        scene,
    }
}

/// Returns whether each predictor was trained on each family; the last value of each is whether on all of them.
fn trained(predictors: &[NamedPredictor], families: &[&str]) -> Vec<u64> {
    let of_one = |predictor: &NamedPredictor| {
        let (_, single) = families.split_last().unwrap_or((&ALL_FAMILIES, &[]));
        let trained: Vec<bool> = single.iter().map(|family| predictor.is_trained_on(family)).collect();
        let every = trained.iter().all(|trained| *trained);
        trained.into_iter().chain([every]).map(u64::from).collect::<Vec<_>>()
    };
    predictors.iter().flat_map(of_one).collect()
}

fn scores(predictors: usize, groups: &[Vec<&EvaluationRow>]) -> Scores {
    let score =
        |k: usize, group: &[&EvaluationRow]| Score::of(group.iter().filter_map(|row| row.result.scores[k].as_ref()));
    let scores: Vec<Option<Score>> = (0..predictors)
        .flat_map(|k| groups.iter().map(move |group| score(k, group)))
        .collect();
    let floats = |value: fn(&Score) -> f64| -> Vec<f64> {
        let value = |score: &Option<Score>| score.as_ref().map_or(0.0, value);
        scores.iter().map(value).collect()
    };
    Scores {
        samples: scores.iter().map(|score| score.map_or(0, |s| s.samples)).collect(),
        rmse: floats(|s| s.rmse_mm),
        r2: floats(|s| s.r2),
        max_displacement_r2: floats(|s| s.max_r2),
        max_error: floats(|s| s.max_error_mm),
        max_displacement_error: floats(|s| s.max_displacement_error_mm),
        quantile95: floats(|s| s.quantile95_mm),
    }
}

fn pattern_scores(predictors: usize, rows: &[EvaluationRow]) -> PatternScores {
    let scores = || (0..predictors).flat_map(|k| rows.iter().map(move |row| row.result.scores[k].as_ref()));
    let floats = |value: fn(&PatternScore) -> f64| scores().map(|score| score.map_or(0.0, value)).collect();
    let simulated = |row: &EvaluationRow| {
        let mut known = row.result.scores.iter().flatten();
        known.next().map_or(0.0, |score| score.simulated_max_mm)
    };
    PatternScores {
        family: rows.iter().map(|row| row.family.clone()).collect(),
        area: rows.iter().map(|row| row.area).collect(),
        simulated_max: rows.iter().map(simulated).collect(),
        predicted: scores().map(|score| u8::from(score.is_some())).collect(),
        predicted_max: floats(|s| s.predicted_max_mm),
        rms: floats(|s| s.rms_mm),
        max_error: floats(|s| s.max_error_mm),
    }
}

fn coverage(
    predictors: &[NamedPredictor],
    calibrated: &[Calibrated],
    families: &[&str],
    groups: &[Vec<&EvaluationRow>],
) -> content::Coverage {
    let n = calibrated.len();
    let of_groups = |value: &dyn Fn(&[Coverage]) -> f64| by_group(n, groups, value);
    let share = |covered: &[Coverage], of: &dyn Fn(&Coverage) -> bool| {
        covered.iter().filter(|c| of(c)).count() as f64 / covered.len() as f64
    };
    let patterns = |c: &Calibrated| {
        let of_family = |family: &str| {
            let all = c.model.families.iter();
            let fitting = all.filter(|known| family == ALL_FAMILIES || known.name == family);
            fitting.map(|known| known.samples).sum::<u64>()
        };
        families.iter().map(|family| of_family(family)).collect::<Vec<_>>()
    };
    let unflagged = |covered: &[Coverage]| {
        let unflagged = covered.iter().filter(|c| !c.out_of_distribution);
        unflagged.copied().collect::<Vec<Coverage>>()
    };
    let by_objective = |value: &dyn Fn(&[Coverage], usize) -> f64| -> Vec<f64> {
        let objectives = 0..OBJECTIVES.len();
        objectives
            .flat_map(|o| of_groups(&|covered| value(covered, o)))
            .collect()
    };
    let model = |c: &Calibrated| predictors[c.predictor].digest().to_owned();
    content::Coverage {
        calibrations: calibrated.iter().map(|c| c.digest.clone()).collect(),
        models: calibrated.iter().map(model).collect(),
        calibrated: calibrated.iter().flat_map(patterns).collect(),
        objectives: OBJECTIVES.iter().map(|(name, _, _)| (*name).to_owned()).collect(),
        field: of_groups(&|c| share(c, &|c| c.field)),
        radius: of_groups(&|c| median(c.iter().map(|c| c.radius_mm))),
        out_of_distribution: of_groups(&|c| share(c, &|c| c.out_of_distribution)),
        unflagged: by_group(n, groups, &|c| unflagged(c).len() as u64),
        unflagged_field: of_groups(&|c| match &unflagged(c)[..] {
            [] => 0.0,
            some => share(some, &|c| c.field),
        }),
        objective: by_objective(&|covered, o| share(covered, &|c| c.objectives[o])),
        objective_half_width: by_objective(&|covered, o| median(covered.iter().map(|c| c.half_widths_mm[o]))),
    }
}

/// Returns a value for each of `n` calibrations and each group of patterns.
fn by_group<T>(n: usize, groups: &[Vec<&EvaluationRow>], value: &dyn Fn(&[Coverage]) -> T) -> Vec<T> {
    let of_one = |k: usize| {
        groups.iter().map(move |group| {
            let covered: Vec<Coverage> = group.iter().map(|row| row.result.coverage[k]).collect();
            value(&covered)
        })
    };
    (0..n).flat_map(of_one).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}
