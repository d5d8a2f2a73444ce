//! What a run found out: the design's displacement as predicted and as simulated, and its gain over the intuitive
//! design, at the latter's own area and at equal area. A gain at unequal areas alone would not be a gain.

use std::fmt;

use serde::Serialize;

use super::gather::{Made, ReportError, Source, each};
use crate::store::Store;

/// The result of a verify stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the stage.
    pub stage: String,
    /// The design and what it is compared with.
    pub cases: Vec<CaseSummary>,
    /// Gain in displacement over the intuitive design at its own area, a fraction; none where one of the two has no
    /// stable solution.
    pub gain_own_area: Option<f64>,
    /// Gain over the intuitive design at the area of the design.
    pub gain_equal_area: Option<f64>,
}

/// One verified pattern. Displacements are those of the wanted point along the wanted direction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseSummary {
    /// `design`, `intuitive` or `intuitive-equal-area`.
    pub case: String,
    /// Electrode area, a fraction of the membrane.
    pub area: f64,
    /// By the surrogate, in mm.
    pub predicted_mm: f64,
    /// By finite elements, in mm; none where there is no stable solution.
    pub simulated_mm: Option<f64>,
    /// Predicted less simulated, in mm.
    pub difference_mm: Option<f64>,
    /// How the simulation ended.
    pub outcome: String,
}

impl CaseSummary {
    /// The name as a title.
    #[must_use]
    pub fn title(&self) -> String {
        match self.case.as_str() {
            "design" => "Design".into(),
            "intuitive" => "Intuitive".into(),
            "intuitive-equal-area" => "Intuitive, equal area".into(),
            other => other.into(),
        }
    }
}

/// The results of all verify stages of a run.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn summarise(store: &Store, made: &[Made]) -> Result<Vec<Summary>, ReportError> {
    each(store, made, "verify", read)
}

/// Whether a case that ended so has simulated numbers.
fn has_field(outcome: &str) -> bool {
    matches!(outcome, "converged" | "estimated")
}

pub(super) fn read(source: &Source<'_>) -> Result<Summary, ReportError> {
    let (names, outcomes) = (source.artifact.texts("case")?.1, source.artifact.texts("outcome")?.1);
    let predicted = source.reals("component/predicted")?;
    let simulated = source.reals("component/simulated")?;
    let area = source.reals("area")?;
    let n = names.len();
    // Simulated arrays have a row for each case with a field only.
    let solved = outcomes.iter().filter(|o| has_field(o)).count();
    if n == 0 || [outcomes.len(), predicted.len(), area.len()] != [n; 3] || simulated.len() != solved {
        return Err(source.wrong("its arrays differ in length"));
    }
    let case = |k: usize| {
        let row = outcomes[..k].iter().filter(|o| has_field(o)).count();
        let simulated = has_field(&outcomes[k]).then(|| simulated[row]);
        CaseSummary {
            case: names[k].clone(),
            area: area[k],
            predicted_mm: predicted[k],
            simulated_mm: simulated,
            difference_mm: simulated.map(|s| predicted[k] - s),
            outcome: outcomes[k].clone(),
        }
    };
    let cases: Vec<CaseSummary> = (0..n).map(case).collect();
    let stable = |name: &str| cases.iter().any(|c| c.case == name && c.simulated_mm.is_some());
    let gain = |path: &str, other: &str| -> Result<Option<f64>, ReportError> {
        let value = source.reals(path)?.first().copied();
        Ok(value.filter(|_| stable("design") && stable(other)))
    };
    Ok(Summary {
        stage: source.stage.stage.clone(),
        gain_own_area: gain("gain/own_area", "intuitive")?,
        gain_equal_area: gain("gain/equal_area", "intuitive-equal-area")?,
        cases,
    })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: displacement of the wanted point along the wanted direction",
            self.stage
        )?;
        for case in &self.cases {
            write!(
                f,
                "  {:<22} area {:>5.1} %  predicted {:>7.3} mm",
                case.title(),
                100.0 * case.area,
                case.predicted_mm
            )?;
            match (case.simulated_mm, case.difference_mm) {
                (Some(simulated), Some(difference)) => {
                    let word = if case.outcome == "estimated" {
                        "estimated"
                    } else {
                        "simulated"
                    };
                    writeln!(f, "  {word} {simulated:>7.3} mm  difference {difference:>+7.3} mm")?;
                }
                _ => writeln!(f, "  no stable solution: {}", case.outcome)?,
            }
        }
        let gain = |gain: Option<f64>| gain.map_or("unknown".to_owned(), |g| format!("{:+.2} %", 100.0 * g));
        write!(
            f,
            "  gain over the intuitive design: {} at its own area, {} at equal area",
            gain(self.gain_own_area),
            gain(self.gain_equal_area)
        )
    }
}
