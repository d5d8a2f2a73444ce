//! What a calibrated network says of designs: its prediction with the interval of 95 %, and whether that is to be relied on.

use std::fmt;

use serde::Serialize;

use super::artifacts::Source;
use super::error::ReportError;
use super::format::mm;
use deaflow_content::{DesignInterval, DesignIntervals, DesignRowsView, Designs};

/// The displacement of a design along the wanted directions as a network predicts it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NetworkInterval {
    /// Probability that the interval covers, for patterns like those of the calibration.
    pub coverage: f64,
    /// The prediction in mm.
    pub predicted_mm: f64,
    /// Lower end in mm.
    pub lower_mm: f64,
    /// Upper end in mm.
    pub upper_mm: f64,
    /// How far the pattern is from those of the training: above 1 it is out of distribution.
    pub novelty: f64,
    /// Whether it is, so that nothing is promised.
    pub out_of_distribution: bool,
    /// The families that the calibration was made from.
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
    /// Whether it covers a number in mm.
    #[must_use]
    pub fn covers(&self, value_mm: f64) -> bool {
        (self.lower_mm..=self.upper_mm).contains(&value_mm)
    }

    /// Its ends in mm.
    #[must_use]
    pub fn ends(&self) -> String {
        format!("{} to {}", mm(self.lower_mm), mm(self.upper_mm))
    }
}

impl fmt::Display for NetworkInterval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = 100.0 * self.coverage;
        write!(
            f,
            "network {} mm, {share:.0} %: {} mm",
            mm(self.predicted_mm),
            self.ends()
        )?;
        match self.out_of_distribution {
            true => write!(f, " (out of distribution, novelty {:.1})", self.novelty),
            false => Ok(()),
        }
    }
}

/// The intervals of the rows of an artifact, one entry for each row.
///
/// # Errors
/// When the artifact does not hold what its kind promises.
pub fn of_rows(
    source: &Source<'_>,
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

/// What intervals of some designs amount to, each with what was simulated; none where there are none.
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
        0 => "none is simulated".to_owned(),
        n => format!(
            "{} of {n} simulated ones lie in theirs",
            simulated().filter(|c| *c).count()
        ),
    };
    let flagged = designs.iter().filter(|(interval, _)| interval.out_of_distribution);
    Some(format!(
        "intervals of {:.0} %, calibrated on {}: {covered}, and {} of {} designs are out of distribution, where nothing is promised; \
         searches find patterns on which a network errs, so that intervals cover designs less often than patterns that are drawn",
        100.0 * first.coverage,
        first.calibrated_on,
        flagged.count(),
        designs.len()
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

/// A design with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DesignWithInterval {
    /// Name of the target.
    pub name: String,
    /// How it was found.
    pub role: &'static str,
    /// Which of several designs of the target.
    pub member: u64,
    /// What the network says of it.
    pub interval: NetworkInterval,
}

/// The designs of a design stage that have intervals; none where no calibration was there.
///
/// # Errors
/// When the artifact does not hold what its kind promises.
pub fn of_stage(source: &Source<'_>) -> Result<Option<StageIntervals>, ReportError> {
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
        writeln!(f, "{}: designs as the calibrated network predicts them", self.stage)?;
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
    fn the_verdict_counts_what_is_covered_and_what_is_flagged() {
        let all = [interval(1.0, 0.5), interval(2.0, 3.0), interval(3.0, 0.9)];
        let simulated = [Some(1.04), Some(2.06), None];
        let said = verdict(all.iter().zip(simulated)).unwrap();
        assert!(said.contains("1 of 2 simulated ones lie in theirs"), "{said}");
        assert!(said.contains("1 of 3 designs are out of distribution"), "{said}");
        assert!(said.contains("calibrated on bezier 80"), "{said}");
        assert_eq!(verdict(std::iter::empty()), None);
        assert_eq!(
            all[1].to_string(),
            "network 2.0000 mm, 95 %: 1.9500 to 2.0500 mm (out of distribution, novelty 3.0)"
        );
    }
}
