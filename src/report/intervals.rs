//! Prediction intervals of calibrated networks for designs.

use std::fmt;

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use deaflow_base::rounded_by;
use deaflow_content::{DesignInterval, DesignIntervals, DesignRowsView, Designs};

/// The displacement of a design along the target directions, predicted by a network.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NetworkInterval {
    /// Coverage of the interval for patterns like those of the calibration.
    pub coverage: f64,
    /// The prediction in mm.
    pub predicted_mm: f64,
    /// Lower end in mm.
    pub lower_mm: f64,
    /// Upper end in mm.
    pub upper_mm: f64,
    /// Distance from the training patterns; above 1 the pattern is out of distribution.
    pub novelty: f64,
    /// Whether it is out of distribution, so that the interval does not hold.
    pub out_of_distribution: bool,
    /// The families of the calibration.
    pub calibrated_on: String,
}

impl From<DesignInterval> for NetworkInterval {
    fn from(interval: DesignInterval) -> Self {
        let [lower_mm, upper_mm] = interval.ends_mm;
        Self {
            coverage: interval.coverage,
            predicted_mm: interval.predicted_mm,
            lower_mm,
            upper_mm,
            novelty: interval.novelty,
            out_of_distribution: interval.out_of_distribution,
            calibrated_on: interval.basis,
        }
    }
}

impl NetworkInterval {
    /// Whether it contains a value in mm.
    #[must_use]
    pub fn covers(&self, value_mm: f64) -> bool {
        (self.lower_mm..=self.upper_mm).contains(&value_mm)
    }

    /// Returns its ends in mm.
    #[must_use]
    pub fn ends(&self) -> String {
        format!("{} to {}", self.rounded(self.lower_mm), self.rounded(self.upper_mm))
    }

    /// Rounds a length in mm by half of the interval.
    fn rounded(&self, mm: f64) -> String {
        rounded_by(mm, 0.5 * (self.upper_mm - self.lower_mm))
    }
}

impl fmt::Display for NetworkInterval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "network {} mm, {:.0} %: {} mm",
            self.rounded(self.predicted_mm),
            100.0 * self.coverage,
            self.ends()
        )?;
        match self.out_of_distribution {
            true => write!(f, " (out of distribution, novelty {:.1})", self.novelty),
            false => Ok(()),
        }
    }
}

/// Reads the intervals of the rows of an artifact, one entry for each row.
///
/// # Errors
/// If the artifact does not have the content of its kind.
pub fn of_rows(
    source: &ArtifactReader<'_>,
    rows: &DesignRowsView<'_>,
    count: usize,
) -> Result<Vec<Option<NetworkInterval>>, ReportError> {
    let view = rows.interval();
    if !source.of(view.is_there())? {
        return Ok(vec![None; count]);
    }
    let found: DesignIntervals = source.of(view.read())?;
    Ok((0..count).map(|row| found.of_row(row).map(Into::into)).collect())
}

/// Compares the intervals of designs with the simulated values; `None` without designs.
#[must_use]
pub fn verdict<'i>(designs: impl Iterator<Item = (&'i NetworkInterval, Option<f64>)>) -> Option<String> {
    let designs: Vec<(&NetworkInterval, Option<f64>)> = designs.collect();
    let (first, _) = designs.first()?;
    let simulated = || {
        designs
            .iter()
            .filter_map(|(interval, value)| Some(interval.covers((*value)?)))
    };
    let covered = match simulated().count() {
        0 => "no design is simulated".to_owned(),
        n => format!(
            "{} of {n} simulated values lie in their interval",
            simulated().filter(|c| *c).count()
        ),
    };
    let flagged = designs.iter().filter(|(interval, _)| interval.out_of_distribution);
    let flagged = match flagged.count() {
        0 => String::new(),
        n => format!(
            "; {n} of {} designs are out of distribution, so their intervals do not hold",
            designs.len()
        ),
    };
    Some(format!(
        "intervals of {:.0} %, calibrated on {}: {covered}{flagged}; a search finds patterns with errors of the \
         network, so intervals cover designs less often than samples",
        100.0 * first.coverage,
        first.calibrated_on,
    ))
}

/// The intervals of the designs of a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageIntervals {
    /// Name of the stage.
    pub stage: String,
    /// Its designs, without the intuitive ones.
    pub designs: Vec<DesignWithInterval>,
}

/// A design with its prediction interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DesignWithInterval {
    /// Name of the target.
    pub name: String,
    /// How it was found.
    pub role: &'static str,
    /// Number of the design of the target, from 0.
    pub member: u64,
    /// The prediction of the network.
    pub interval: NetworkInterval,
}

/// Reads the designs of a design stage that have intervals; `None` without a calibration.
///
/// # Errors
/// If the artifact does not have the content of its kind.
pub fn of_stage(source: &ArtifactReader<'_>) -> Result<Option<StageIntervals>, ReportError> {
    let rows = source.of(Designs::open(source.artifact))?.rows();
    let (names, roles) = (source.of(rows.name().read())?, source.of(rows.role().read())?);
    let members = source.of(rows.member().read())?;
    let intervals = of_rows(source, &rows, names.len())?;
    let design = |(row, interval): (usize, Option<NetworkInterval>)| {
        Some(DesignWithInterval {
            name: names[row].clone(),
            role: roles[row].name(),
            member: members[row],
            interval: interval.filter(|_| roles[row].is_found())?,
        })
    };
    let designs: Vec<DesignWithInterval> = intervals.into_iter().enumerate().filter_map(design).collect();
    Ok((!designs.is_empty()).then(|| StageIntervals {
        stage: source.stage.stage.clone(),
        designs,
    }))
}

impl fmt::Display for StageIntervals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: predictions of the calibrated network for the designs",
            self.stage
        )?;
        for design in &self.designs {
            let number = if design.member > 0 {
                format!(" {}", design.member + 1)
            } else {
                String::new()
            };
            writeln!(f, "  {}{number}: {}, {}", design.name, design.role, design.interval)?;
        }
        let verdict = verdict(self.designs.iter().map(|design| (&design.interval, None)));
        write!(f, "  {}", verdict.unwrap_or_default())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// An interval of ± 0.05 mm.
    pub fn interval(predicted_mm: f64, novelty: f64) -> NetworkInterval {
        NetworkInterval {
            coverage: 0.95,
            predicted_mm,
            lower_mm: predicted_mm - 0.05,
            upper_mm: predicted_mm + 0.05,
            novelty,
            out_of_distribution: novelty > 1.0,
            calibrated_on: "bezier 80 (families of its training)".into(),
        }
    }

    #[test]
    fn the_verdict_counts_covered_and_flagged_designs() {
        let all = [interval(1.0, 0.5), interval(2.0, 3.0), interval(3.0, 0.9)];
        let simulated = [Some(1.04), Some(2.06), None];
        let verdict = verdict(all.iter().zip(simulated)).unwrap();
        for part in [
            "1 of 2 simulated",
            "1 of 3 designs are out of distribution",
            "calibrated on bezier 80",
        ] {
            assert!(verdict.contains(part), "{part}: {verdict}");
        }
        let without = super::verdict([(&all[0], None), (&all[2], None)].into_iter()).unwrap();
        assert!(!without.contains("out of distribution"), "{without}");
        assert_eq!(super::verdict(std::iter::empty()), None);
        assert_eq!(
            all[1].to_string(),
            "network 2.000 mm, 95 %: 1.950 to 2.050 mm (out of distribution, novelty 3.0)"
        );
    }
}
