//! Table stages: results of sweeps, as a table and as curves.

use serde_json::{Value, json};

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::figures::{curves_chart, curves_sheet};
use crate::format::counted;
use crate::html::Page;
use crate::presenter::{Figures, Headline, Presenter, Results};
use crate::tables::ResultTable;
use deaflow_content as content;

/// Presents table stages.
pub struct TablePresenter;

/// Rows that a run prints.
const MAX_ROWS: usize = 40;

impl Presenter for TablePresenter {
    fn kind(&self) -> &'static str {
        "table"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let tables = run.each(self.kind(), |source| Ok((source.stage.stage.clone(), read(source)?)))?;
        if tables.is_empty() {
            return Ok(Vec::new());
        }
        let value = |(stage, table): &(String, ResultTable)| {
            let mut value = table.document();
            value["stage"] = json!(stage);
            value
        };
        let text = |(stage, table): &(String, ResultTable)| {
            let mut text = format!("{stage}\n{}", table.text(MAX_ROWS));
            if table.rows.len() > MAX_ROWS {
                let more = counted(table.rows.len() - MAX_ROWS, "row", "rows");
                text += &format!("\nand {more} more: `deaflow show {stage} --csv` prints all");
            }
            text
        };
        let values: Value = tables.iter().map(value).collect();
        Ok(vec![Results::new("tables", &values, tables.iter().map(text))])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let tables = run.each(self.kind(), |source| Ok((source.stage.stage.clone(), read(source)?)))?;
        let line = |(stage, table): &(String, ResultTable)| {
            let rows = counted(table.rows.len(), "row", "rows");
            Headline::good(format!(
                "{stage}: a table of {rows}; `deaflow show {stage} --csv` prints it"
            ))
        };
        Ok(tables.iter().map(line).collect())
    }

    fn figures(&self) -> Figures {
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
            page.open(
                "Tables",
                "Results of sweeps, with a row for each combination of values.",
            );
            page.part(stage);
            page.charts(chart);
            let header = table.header();
            page.table(&header.iter().map(String::as_str).collect::<Vec<_>>(), &table.shown());
        }
        Ok(())
    }
}

fn read(source: &ArtifactReader<'_>) -> Result<ResultTable, ReportError> {
    let table = source.of(content::Table::read(source.artifact))?;
    Ok(ResultTable::new(table))
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let curves = read(source)?.curves();
    curves.map(|curves| source.drawn(curves_sheet(&curves))).transpose()
}
