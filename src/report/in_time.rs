//! Verified designs at several times: what each is worth then, and whether the best one is the same.

use std::fmt;

use serde::Serialize;

use super::artifacts::Source;
use super::error::ReportError;
use super::format::{duration, mm, percent};
use super::html::{Column, Page};
use super::summary::read;
use deaflow_content::Verification;
use deaflow_pattern::Pattern;

/// Designs of a verify stage at the times that it was asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InTime {
    /// The stage.
    pub stage: String,
    /// Times in s.
    pub times: Vec<f64>,
    /// Patterns with a field at all of them.
    pub rows: Vec<TimedRow>,
    /// Whether the best pattern is the same at all times, for each thing that is wanted.
    pub verdicts: Vec<String>,
}

/// A pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimedRow {
    /// What it is called.
    pub title: String,
    /// Displacement along the wanted directions at each time, in mm.
    pub values_mm: Vec<f64>,
    /// What is wanted of it, whenever.
    #[serde(skip)]
    wanted: String,
    #[serde(skip)]
    pattern: Pattern,
}

/// Patterns that differ by less than this share are equally good.
const ALIKE: f64 = 5e-4;

impl InTime {
    /// Of a verify stage; none where it was asked for fewer than two times.
    ///
    /// # Errors
    /// When the artifact cannot be read or does not hold what its kind promises.
    pub fn read(source: &Source<'_>) -> Result<Option<Self>, ReportError> {
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
                wanted: timeless(&designs.objective.0[row]).to_owned(),
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

    /// Adds a section of a page.
    pub fn show(&self, page: &mut Page) {
        page.open(
            "Designs in time",
            "Each design was followed through all of these times, whichever it was made for. Numbers are displacements along the wanted \
             directions in mm.",
        );
        page.part(&self.stage);
        page.lines(&self.verdicts);
        let titles: Vec<String> = self
            .times
            .iter()
            .map(|time| format!("after {}", duration(*time)))
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
        write!(f, "{}: designs in time", self.stage)?;
        for verdict in &self.verdicts {
            write!(f, "\n  {verdict}")?;
        }
        Ok(())
    }
}

/// An objective without its time, which stands at its end.
fn timeless(objective: &str) -> &str {
    objective.split(", time: ").next().unwrap_or(objective)
}

/// One line or two for each thing that is wanted.
fn verdicts(times: &[f64], rows: &[TimedRow]) -> Vec<String> {
    let mut wanted: Vec<&str> = rows.iter().map(|row| row.wanted.trim_end_matches(" }")).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let several = wanted.len() > 1;
    let verdict = |wanted: &str| -> Option<String> {
        let own: Vec<&TimedRow> = rows
            .iter()
            .filter(|row| row.wanted.trim_end_matches(" }") == wanted)
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
        let of = if several {
            format!("{wanted} }}: ")
        } else {
            String::new()
        };
        let [early_time, late_time] = [times[first], times[last]].map(duration);
        if early.pattern == late.pattern || losses.iter().all(|loss| *loss < ALIKE) {
            return Some(format!(
                "{of}One pattern is the best after {early_time} and after {late_time}: {} ({} and {} mm)",
                early.title,
                mm(early.values_mm[first]),
                mm(early.values_mm[last])
            ));
        }
        Some(format!(
            "{of}The best pattern after {early_time} is another than after {late_time}: {} reaches {} mm after {early_time}, where {} falls short \
             by {}; that one reaches {} mm after {late_time}, where the first falls short by {}.",
            early.title,
            mm(early.values_mm[first]),
            late.title,
            percent(losses[0], 2),
            mm(late.values_mm[last]),
            percent(losses[1], 2),
        ))
    };
    wanted.into_iter().filter_map(verdict).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn row(title: &str, width: usize, values_mm: [f64; 2]) -> TimedRow {
        TimedRow {
            title: title.to_owned(),
            values_mm: values_mm.to_vec(),
            wanted: "{ point: [25, 25], direction: 0".to_owned(),
            pattern: Pattern::from_fn(Raster::PAPER, |x, _| x < width),
        }
    }

    #[test]
    fn whether_the_best_pattern_is_the_same_is_said() {
        let times = [0.1, 600.0];
        let said = verdicts(&times, &[row("early", 20, [1.0, 1.8]), row("late", 25, [0.95, 2.0])]);
        assert_eq!(said.len(), 1);
        assert!(
            said[0].starts_with("The best pattern after 0.1 s is another than after 10 min: early reaches 1.0000 mm")
                && said[0].contains("late falls short by 5.00 %")
                && said[0].ends_with("the first falls short by 10.00 %."),
            "{}",
            said[0]
        );
        for rows in [
            [row("early", 20, [1.0, 2.0]), row("late", 25, [0.95, 1.9])],
            [row("early", 20, [1.0, 2.0]), row("late", 20, [1.0, 2.0])],
            [row("early", 20, [1.0, 1.9999]), row("late", 21, [0.9999, 2.0])],
        ] {
            let said = verdicts(&times, &rows);
            assert!(said[0].starts_with("One pattern is the best"), "{}", said[0]);
        }
        assert!(verdicts(&times, &[]).is_empty());
        assert_eq!(timeless("{ point: [1, 2], time: 10 min }"), "{ point: [1, 2]");
    }
}
