//! Verified designs at several times: their displacements, and whether the best one is always the same.

use std::fmt;

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use super::format::{duration, mm, percent};
use super::html::{Column, Page};
use super::summary::read;
use deaflow_content::Verification;
use deaflow_pattern::Pattern;

/// The designs of a verify stage at several times.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InTime {
    /// The stage.
    pub stage: String,
    /// Times in s.
    pub times: Vec<f64>,
    /// Patterns that have a field at all times.
    pub rows: Vec<TimedRow>,
    /// For each objective, whether the best pattern is the same at all times.
    pub verdicts: Vec<String>,
}

/// A pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimedRow {
    /// Its title.
    pub title: String,
    /// Displacement along the target directions at each time, in mm.
    pub values_mm: Vec<f64>,
    /// Its objective without the time.
    #[serde(skip)]
    objective: String,
    #[serde(skip)]
    pattern: Pattern,
}

/// Patterns that differ by less than this fraction are equally good.
const TOLERANCE: f64 = 5e-4;

impl InTime {
    /// Reads a verify stage; `None` if it has fewer than two times.
    ///
    /// # Errors
    /// If the artifact cannot be read or does not have the content of its kind.
    pub fn read(source: &ArtifactReader<'_>) -> Result<Option<Self>, ReportError> {
        let view = source.of(Verification::open(source.artifact))?;
        let Some(times) = source.of(view.history().time().read_if_there())? else {
            return Ok(None);
        };
        let Some(values) = source.of(view.component().in_time().read())? else {
            return Ok(None);
        };
        let places = source.of(view.simulated_rows())?;
        let count = places.iter().flatten().count();
        let each = values.0.len().checked_div(count).unwrap_or(0);
        if each < 2 {
            return Ok(None);
        }
        let summary = read(source)?;
        let designs = source.of(view.rows().read())?;
        let row = |(row, place): (usize, &Option<usize>)| {
            let place = (*place)?;
            let case = &summary.rows[row];
            case.role.is_compared().then(|| TimedRow {
                title: case.title(),
                values_mm: values.0[place * each..][..each].to_vec(),
                objective: timeless(&designs.objective.0[row]).to_owned(),
                pattern: designs.patterns[row].clone(),
            })
        };
        let rows: Vec<TimedRow> = places.iter().enumerate().filter_map(row).collect();
        let times = times.0[..each].to_vec();
        Ok(Some(Self {
            verdicts: verdicts(&times, &rows),
            stage: source.stage.stage.clone(),
            times,
            rows,
        }))
    }

    /// Adds a section to a page.
    pub fn show(&self, page: &mut Page) {
        page.open(
            "Designs over time",
            "Each design was simulated at all of these times, whatever the time of its objective. Numbers are \
                 displacements along the target directions in mm.",
        );
        page.part(&self.stage);
        page.lines(&self.verdicts);
        let titles: Vec<String> = self
            .times
            .iter()
            .map(|time| format!("at {}", duration(*time)))
            .collect();
        let columns: Vec<(&str, Column)> = std::iter::once(("design", Column::Text))
            .chain(titles.iter().map(|title| (title.as_str(), Column::Number)))
            .collect();
        let row = |row: &TimedRow| {
            let values = row.values_mm.iter().map(|value| mm(*value));
            std::iter::once(row.title.clone()).chain(values).collect()
        };
        page.columns(
            "Designs at several times",
            &columns,
            &self.rows.iter().map(row).collect::<Vec<_>>(),
        );
    }
}

impl fmt::Display for InTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: designs over time", self.stage)?;
        for verdict in &self.verdicts {
            write!(f, "\n  {verdict}")?;
        }
        Ok(())
    }
}

/// Removes the time from an objective; it is at its end.
fn timeless(objective: &str) -> &str {
    objective.split(", time: ").next().unwrap_or(objective)
}

/// Compares the best patterns at the first and the last time, with a line for each objective.
fn verdicts(times: &[f64], rows: &[TimedRow]) -> Vec<String> {
    let mut objectives: Vec<&str> = rows.iter().map(|row| row.objective.trim_end_matches(" }")).collect();
    objectives.sort_unstable();
    objectives.dedup();
    let several = objectives.len() > 1;
    let verdict = |objective: &str| -> Option<String> {
        let own: Vec<&TimedRow> = rows
            .iter()
            .filter(|row| row.objective.trim_end_matches(" }") == objective)
            .collect();
        let best = |at: usize| {
            own.iter()
                .copied()
                .reduce(|a, b| if b.values_mm[at] > a.values_mm[at] { b } else { a })
        };
        let (first, last) = (0, times.len() - 1);
        let (early, late) = (best(first)?, best(last)?);
        let lost = |of: &TimedRow, to: &TimedRow, at: usize| 1.0 - of.values_mm[at] / to.values_mm[at];
        let losses = [lost(late, early, first), lost(early, late, last)];
        let of = match several {
            true => format!("{objective} }}: "),
            false => String::new(),
        };
        let [early_time, late_time] = [times[first], times[last]].map(duration);
        if early.pattern == late.pattern || losses.iter().all(|loss| *loss < TOLERANCE) {
            return Some(format!(
                "{of}The same pattern is the best at {early_time} and at {late_time}: {} ({} and {} mm)",
                early.title,
                mm(early.values_mm[first]),
                mm(early.values_mm[last])
            ));
        }
        Some(format!(
            "{of}The best patterns differ. At {early_time}, {} reaches {} mm, and {} is {} below it; at {late_time}, \
             the latter reaches {} mm, and the former is {} below it.",
            early.title,
            mm(early.values_mm[first]),
            late.title,
            percent(losses[0], 2),
            mm(late.values_mm[last]),
            percent(losses[1], 2),
        ))
    };
    objectives.into_iter().filter_map(verdict).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn row(title: &str, width: usize, values_mm: [f64; 2]) -> TimedRow {
        TimedRow {
            title: title.to_owned(),
            values_mm: values_mm.to_vec(),
            objective: "{ point: [25, 25], direction: 0".to_owned(),
            pattern: Pattern::from_fn(Raster::PAPER, |x, _| x < width),
        }
    }

    #[test]
    fn the_best_patterns_at_both_times_are_compared() {
        let times = [0.1, 600.0];
        let found = verdicts(&times, &[row("early", 20, [1.0, 1.8]), row("late", 25, [0.95, 2.0])]);
        assert_eq!(found.len(), 1);
        assert!(
            found[0].contains("At 0.1 s, early reaches 1.000 mm, and late is 5.00 % below")
                && found[0].contains("at 10 min")
                && found[0].ends_with("is 10.00 % below it."),
            "{}",
            found[0]
        );
        for rows in [
            [row("early", 20, [1.0, 2.0]), row("late", 25, [0.95, 1.9])],
            [row("early", 20, [1.0, 2.0]), row("late", 20, [1.0, 2.0])],
            [row("early", 20, [1.0, 1.9999]), row("late", 21, [0.9999, 2.0])],
        ] {
            let found = verdicts(&times, &rows);
            assert!(found[0].contains("same pattern is the best"), "{}", found[0]);
        }
        assert!(verdicts(&times, &[]).is_empty());
        assert_eq!(timeless("{ point: [1, 2], time: 10 min }"), "{ point: [1, 2]");
    }
}
