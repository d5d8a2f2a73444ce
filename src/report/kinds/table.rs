//! Table stages: results of sweeps, as a table and as curves.

use std::path::Path;

use serde_json::{Value, json};

use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::figures::{Curves, curves_chart, draw_curves};
use crate::format::counted;
use crate::headline::Headline;
use crate::html::Page;
use crate::presenter::{DrawFigure, Presenter, Results};
use crate::tables::Collected;
use deaflow_content as content;

/// Shows table stages.
pub struct Table;

/// Rows that a run tells of.
const TOLD: usize = 40;

impl Presenter for Table {
    fn kind(&self) -> &'static str {
        "table"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let tables = run.each(self.kind(), |source| Ok((source.stage.stage.clone(), read(source)?)))?;
        if tables.is_empty() {
            return Ok(Vec::new());
        }
        let value = |(stage, table): &(String, Collected)| {
            let mut value = table.document();
            value["stage"] = json!(stage);
            value
        };
        let text = |(stage, table): &(String, Collected)| {
            let mut text = format!("{stage}\n{}", table.text(TOLD));
            if table.rows.len() > TOLD {
                let more = counted(table.rows.len() - TOLD, "row", "rows");
                text += &format!("\nand {more} more: `deaflow show {stage} --csv`");
            }
            text
        };
        Ok(vec![Results {
            key: "tables".to_owned(),
            value: tables.iter().map(value).collect::<Value>(),
            text: tables.iter().map(text).collect(),
            warnings: Vec::new(),
        }])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let tables = run.each(self.kind(), |source| Ok((source.stage.stage.clone(), read(source)?)))?;
        let line = |(stage, table): &(String, Collected)| {
            let rows = counted(table.rows.len(), "row", "rows");
            Headline::good(format!(
                "{stage}: a table of {rows}: `deaflow show {stage} --csv` prints it"
            ))
        };
        Ok(tables.iter().map(line).collect())
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("table", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let tables = run.each(self.kind(), |source| {
            let table = read(source)?;
            let chart = table
                .curves()
                .map(|curves| source.drawn(curves_chart(&curves)))
                .transpose()?;
            Ok((source.stage.stage.clone(), table, chart))
        })?;
        for (stage, table, chart) in &tables {
            page.open("Tables", "Results of sweeps: a row for each combination of values.");
            page.part(stage);
            page.charts(chart);
            let header = table.header();
            page.table(&header.iter().map(String::as_str).collect::<Vec<_>>(), &table.shown());
        }
        Ok(())
    }
}

fn read(source: &Source<'_>) -> Result<Collected, ReportError> {
    let table = source.of(content::Table::read(source.artifact))?;
    Ok(Collected::new(table))
}

fn figure(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let curves: Option<Curves> = read(source)?.curves();
    curves.map_or(Ok(()), |curves| source.drawn(draw_curves(path, &curves)))
}
