//! Results of the rounds of a stage: the differences between prediction and simulation, and the best design of each
//! target, round by round.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::artifacts::StageArtifact;
use super::error::ReportError;
use super::figures::{Round, rounds_sheet};
use super::format::{figure_name, mm, percents};
use super::summary::{VerificationSummary, best_rows};
use deaflow_base::Digest;
use deaflow_orchestrator::Rounds;
use deaflow_pattern::Role;

/// The rounds of a verify stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundsSummary {
    /// Name of the stage in the first round.
    pub stage: String,
    /// The rounds that are done, from the first.
    pub rounds: Vec<RoundSummary>,
}

/// One round. Differences are of displacements along the target directions, of the searched designs that have a
/// simulated field; `None` if there is no such design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundSummary {
    /// Name of the stage in this round.
    pub stage: String,
    /// Designs with both a prediction and a simulation.
    pub designs: usize,
    /// Largest absolute difference between prediction and simulation, mm.
    pub largest_mm: Option<f64>,
    /// Root mean square of the differences, mm.
    pub rms_mm: Option<f64>,
    /// Largest absolute difference as a fraction of the simulated.
    pub largest_relative: Option<f64>,
    /// Root mean square of the differences as fractions of the simulated.
    pub rms_relative: Option<f64>,
    /// The best design of each target, in the order of the artifact.
    pub best: Vec<BestOfTarget>,
}

/// The best design of a target by simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BestOfTarget {
    /// Name of the design stage.
    pub case: String,
    /// Name of the target.
    pub name: String,
    /// Its displacement, mm: the largest, or the one nearest to the target displacement if there is one.
    pub simulated_mm: f64,
}

/// Summarizes the rounds of a pipeline that are done; stages with less than two rounds are left out.
#[must_use]
pub fn by_round(rounds: &[Rounds], summaries: &[VerificationSummary]) -> Vec<RoundsSummary> {
    let of_stage = |rounds: &Rounds| {
        let found = rounds
            .stages
            .iter()
            .map_while(|name| summaries.iter().find(|s| s.stage == *name));
        RoundsSummary {
            stage: rounds.stages.first().cloned().unwrap_or_default(),
            rounds: found.map(round).collect(),
        }
    };
    rounds
        .iter()
        .map(of_stage)
        .filter(|of_stage| of_stage.rounds.len() > 1)
        .collect()
}

/// Draws the missing figure of the rounds of each stage, and returns the paths of all: `<stage>-<digest>-rounds.png` in
/// the folder, with a digest of all rounds.
///
/// # Errors
/// If a figure cannot be written.
pub fn draw_by_round(
    folder: &Path,
    stages: &[StageArtifact],
    found: &[RoundsSummary],
    summaries: &[VerificationSummary],
) -> Result<Vec<PathBuf>, ReportError> {
    let mut paths = Vec::new();
    for of_stage in found {
        let own = |made: &&StageArtifact| of_stage.rounds.iter().any(|round| round.stage == made.stage);
        let digests: Vec<String> = stages.iter().filter(own).map(|made| made.digest.to_string()).collect();
        let digest = Digest::of(digests.concat().as_bytes()).to_string();
        let path = folder.join(figure_name(&of_stage.stage, &digest, "rounds"));
        if !path.exists() {
            fs::create_dir_all(folder).map_err(|source| ReportError::Folder {
                path: folder.to_owned(),
                source,
            })?;
            let sheet = rounds_sheet(&drawn(of_stage, summaries));
            let written = sheet.and_then(|sheet| sheet.write_png(&path));
            written.map_err(|source| ReportError::Figure {
                stage: of_stage.stage.clone(),
                source,
            })?;
        }
        paths.push(path);
    }
    Ok(paths)
}

/// Returns the data of the figure of the rounds of a stage.
pub fn drawn(of_stage: &RoundsSummary, summaries: &[VerificationSummary]) -> Vec<Round> {
    let relative = |round: &RoundSummary| -> Vec<f64> {
        let summary = summaries.iter().find(|summary| summary.stage == round.stage);
        let designs = summary.map(designs).unwrap_or_default();
        designs.iter().filter_map(|design| design.relative()).collect()
    };
    let round = |round: &RoundSummary| Round {
        differences: relative(round),
        best: round
            .best
            .iter()
            .map(|best| (best.title(), best.simulated_mm))
            .collect(),
    };
    of_stage.rounds.iter().map(round).collect()
}

/// A design with its prediction and its simulation, mm.
struct PredictionPair {
    predicted: f64,
    simulated: f64,
}

impl PredictionPair {
    fn difference(&self) -> f64 {
        (self.predicted - self.simulated).abs()
    }

    /// Returns the difference as a fraction of the simulated value; `None` if that is zero.
    fn relative(&self) -> Option<f64> {
        (self.simulated.abs() > 1e-9).then(|| self.difference() / self.simulated.abs())
    }
}

fn designs(summary: &VerificationSummary) -> Vec<PredictionPair> {
    let searched = summary.rows.iter().filter(|row| row.role.is_searched());
    let both = searched.filter_map(|row| {
        Some(PredictionPair {
            predicted: row.comparable_prediction_mm()?,
            simulated: row.simulated_mm?,
        })
    });
    both.collect()
}

fn round(summary: &VerificationSummary) -> RoundSummary {
    let designs = designs(summary);
    let absolute: Vec<f64> = designs.iter().map(PredictionPair::difference).collect();
    let relative: Vec<f64> = designs.iter().filter_map(PredictionPair::relative).collect();
    let largest = |values: &[f64]| values.iter().copied().reduce(f64::max);
    RoundSummary {
        stage: summary.stage.clone(),
        designs: designs.len(),
        largest_mm: largest(&absolute),
        rms_mm: rms(&absolute),
        largest_relative: largest(&relative),
        rms_relative: rms(&relative),
        best: best(summary),
    }
}

fn rms(values: &[f64]) -> Option<f64> {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (!values.is_empty()).then(|| (squares / values.len() as f64).sqrt())
}

fn best(summary: &VerificationSummary) -> Vec<BestOfTarget> {
    let of_target = |at: usize| {
        let row = &summary.rows[at];
        Some(BestOfTarget {
            case: row.case.clone(),
            name: row.name.clone(),
            simulated_mm: row.simulated_mm?,
        })
    };
    let best = best_rows(&summary.rows, Role::is_searched).into_iter();
    best.filter_map(of_target).collect()
}

impl BestOfTarget {
    fn title(&self) -> String {
        match self.case.as_str() {
            "" => self.name.clone(),
            case => format!("{case} {}", self.name),
        }
    }
}

impl RoundsSummary {
    /// Lists the best displacement of a target in each round.
    fn best_by_round(&self, target: &BestOfTarget) -> String {
        let same = |best: &&BestOfTarget| (&best.case, &best.name) == (&target.case, &target.name);
        let of_round = |round: &RoundSummary| match round.best.iter().find(same) {
            Some(best) => mm(best.simulated_mm),
            None => "–".to_owned(),
        };
        self.rounds.iter().map(of_round).collect::<Vec<_>>().join(", ")
    }
}

impl fmt::Display for RoundsSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: |predicted − simulated| of the designs in each round",
            self.stage
        )?;
        for (k, round) in self.rounds.iter().enumerate() {
            write!(f, "\n  round {:>2}  {:>4} designs  ", k + 1, round.designs)?;
            match (round.largest_mm, round.rms_mm) {
                (Some(largest), Some(rms)) => write!(f, "at most {} mm, RMS {} mm", mm(largest), mm(rms))?,
                _ => write!(f, "none with both a prediction and a simulation")?,
            }
            if let (Some(largest), Some(rms)) = (round.largest_relative, round.rms_relative) {
                write!(
                    f,
                    "; at most {}, RMS {} of the simulated",
                    percents(largest),
                    percents(rms)
                )?;
            }
        }
        let mut targets: Vec<&BestOfTarget> = Vec::new();
        for best in self.rounds.iter().flat_map(|round| &round.best) {
            if !targets.iter().any(|t| (&t.case, &t.name) == (&best.case, &best.name)) {
                targets.push(best);
            }
        }
        let width = targets.iter().map(|t| t.title().chars().count()).max().unwrap_or(0);
        for target in targets {
            let (title, values) = (target.title(), self.best_by_round(target));
            write!(f, "\n  best of {title:<width$}  {values} mm simulated")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::designs::Comparison;
    use super::super::summary::RowSummary;
    use super::*;
    use deaflow_field::OutcomeKind;

    fn row(name: &str, role: Role, predicted: f64, simulated: Option<f64>, distance: Option<f64>) -> RowSummary {
        RowSummary {
            case: "I".into(),
            name: name.into(),
            role,
            member: 0,
            units: 20,
            area: 0.5,
            area_mm2: 1250.0,
            predicted_mm: Some(predicted),
            robust_mm: None,
            predicted_deg: None,
            simulated_deg: None,
            predicted_ml: None,
            simulated_ml: None,
            simulated_error_ml: None,
            simulated_mm: simulated,
            simulated_error_mm: None,
            difference_mm: simulated.map(|simulated| predicted - simulated),
            distance_mm: distance,
            interval: None,
            outcome: OutcomeKind::Converged,
            status: "met".into(),
            best: false,
            gain_own_area: None,
            gain_equal_area: None,
            gain_own_area_mm: None,
            gain_equal_area_mm: None,
            ratio_to_optimum: None,
            difference_to_optimum_mm: None,
            optimum_is: None,
            compared: Comparison::default(),
            other_scene: None,
            objective: Arc::default(),
            constraints: String::new(),
            area_target: String::new(),
            small_islands: None,
        }
    }

    fn summary(stage: &str, rows: Vec<RowSummary>) -> VerificationSummary {
        VerificationSummary {
            stage: stage.into(),
            rows,
            largest_difference: None,
            not_stable: 0,
            unit: "mm",
        }
    }

    fn summaries() -> [VerificationSummary; 2] {
        let first = vec![
            row("a", Role::Ga, 2.5, Some(2.0), None),
            row("a", Role::Refined, 2.2, Some(2.2), None),
            row("b", Role::Ga, 1.3, Some(1.0), Some(0.0)),
            row("b", Role::Refined, 1.0, None, None),
            // These are not searched with the predictor.
            row("a", Role::Intuitive, 9.0, Some(1.0), None),
            row("a", Role::Optimum, 9.0, Some(3.0), None),
        ];
        let second = vec![
            row("a", Role::Ga, 2.31, Some(2.3), None),
            RowSummary {
                status: "area 0.7, wanted 0.5 within 0.02".into(),
                ..row("a", Role::Refined, 2.41, Some(2.4), None)
            },
            row("b", Role::Ga, 1.2, Some(1.1), Some(0.1)),
            row("b", Role::Refined, 1.0, Some(1.01), Some(0.01)),
        ];
        [summary("v", first), summary("v-2", second)]
    }

    fn rounds(names: &[&str]) -> Vec<Rounds> {
        let stages = names.iter().map(ToString::to_string).collect();
        vec![Rounds { stages }]
    }

    #[test]
    fn each_round_has_its_differences_and_best_designs() {
        let found = by_round(&rounds(&["v", "v-2", "v-3"]), &summaries());
        let [of_stage] = &found[..] else {
            panic!("{found:?}");
        };
        let first = &of_stage.rounds[0];
        assert_eq!((of_stage.rounds.len(), first.designs), (2, 3));
        let close = |found: Option<f64>, expected: f64| assert!((found.unwrap() - expected).abs() < 1e-12, "{found:?}");
        close(first.largest_mm, 0.5);
        close(first.rms_mm, ((0.25f64 + 0.09) / 3.0).sqrt());
        close(first.largest_relative, 0.3);
        close(first.rms_relative, ((0.0625f64 + 0.09) / 3.0).sqrt());
        let best = |k: usize| -> Vec<(String, f64)> {
            let best = of_stage.rounds[k].best.iter();
            best.map(|best| (best.name.clone(), best.simulated_mm)).collect()
        };
        assert_eq!(best(0), [("a".to_owned(), 2.2), ("b".to_owned(), 1.0)]);
        // One that satisfies the constraints; if there is a target displacement, the nearest one.
        assert_eq!(best(1), [("a".to_owned(), 2.3), ("b".to_owned(), 1.01)]);
        let text = of_stage.to_string();
        for part in [
            "round  1     3 designs  at most 0.5000 mm, RMS 0.3367 mm; at most 30.0 %, RMS 22.5 % of the simulated",
            "best of I a  2.200, 2.300 mm simulated",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn a_single_round_and_one_without_designs_are_handled() {
        assert_eq!(by_round(&rounds(&["v", "v-2"]), &summaries()[..1]), []);
        let empty = [summary("v", Vec::new()), summary("v-2", Vec::new())];
        let found = by_round(&rounds(&["v", "v-2"]), &empty);
        assert_eq!((found[0].rounds[1].designs, found[0].rounds[1].rms_mm), (0, None));
        assert!(found[0].to_string().contains("none with both"));
    }

    #[test]
    fn the_figure_is_drawn_once_for_the_artifacts_of_all_rounds() {
        let folder = tempfile::tempdir().unwrap();
        let summaries = summaries();
        let found = by_round(&rounds(&["v", "v-2"]), &summaries);
        let draw = |first: &[u8]| {
            let made = [("v", first), ("v-2", b"2")].map(|(stage, bytes)| StageArtifact {
                stage: stage.into(),
                kind: "verify".into(),
                digest: deaflow_base::ArtifactId::of(bytes),
            });
            draw_by_round(folder.path(), &made, &found, &summaries).unwrap()
        };
        let paths = draw(b"1");
        assert!(paths.len() == 1 && paths[0].exists() && paths == draw(b"1"));
        assert_ne!(paths, draw(b"0"));
    }
}
