//! `kind: table` collects results of the stages of sweeps by name: a row for each combination of values.

mod cells;
mod columns;

use std::collections::BTreeMap;

use super::results::named;
use deaflow_base::{Canonical, Fields, InputError, Map, Node, Schema};
use deaflow_content::{Lines, Table};
use deaflow_orchestrator::{Job, Kind, MANY_STAGES, Needs, Stage, StageError};
use deaflow_store::{Artifact, Object};

use cells::Cells;
use columns::{Column, MOST_COLUMNS};

/// The kind `table`.
pub struct TableKind {
    /// The kinds whose results it collects.
    pub collected: &'static [&'static dyn Kind],
}

impl Kind for TableKind {
    fn name(&self) -> &'static str {
        "table"
    }

    fn recipe(&self) -> u32 {
        // 2: of several designs of a target, the best one counts.
        2
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Table::open(artifact)?;
        let cells = view.text().read()?.len();
        let rows = cells.checked_div(view.columns().rows()?).unwrap_or_default();
        Ok(named([("rows", rows as f64)]))
    }

    fn needs(&self) -> Needs {
        Needs::new(
            &[
                "patterns",
                "import",
                "sample",
                "solve",
                "balance",
                "train",
                "calibrate",
                "measure",
                "fit",
                "compare",
                "evaluate",
                "design",
                "verify",
                "yield",
                "accuracy",
                "audit",
            ],
            1,
            MANY_STAGES,
        )
    }

    fn collects(&self) -> bool {
        true
    }

    fn schema(&self) -> Vec<Fields> {
        let plot = Fields::new("The figure of the table.")
            .required("x", Schema::text().description("The column of the horizontal axis."))
            .required("y", Schema::text().description("The column of the vertical axis."))
            .optional(
                "series",
                Schema::text().description("The column whose values give separate curves."),
            );
        let columns = Schema::list(Schema::text(), 1, MOST_COLUMNS).distinct();
        vec![
            Fields::new("Collects results of the stages of sweeps: a row for each combination of values.")
                .required(
                    "columns",
                    columns.description("Axes, and results by their names in `deaflow log`: RESULT or STAGE.RESULT."),
                )
                .optional("plot", plot.into()),
        ]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a table stage";
        let rows = columns::rows(stage.peek("rows"))?;
        let kinds = columns::kinds(stage.peek("kinds"))?;
        // The orchestrator adds these from the needs of the stage and the axes.
        let own = stage.without("rows").without("kinds");
        let map = own.fields(what, &["kind", "needs", "columns", "plot"])?;
        let columns = columns::columns(map.required(what, "columns")?, &rows, &kinds)?;
        Cells::check(&columns, &rows)?;
        Ok(Box::new(TableStage {
            plot: plot(&map, &columns)?,
            collected: self.collected,
            cells: Cells::new(&columns, &rows),
            columns,
        }))
    }
}

/// Returns the columns of a figure: x, y and, if given, series; empty without a figure.
fn plot(map: &Map<'_>, columns: &[Column]) -> Result<Vec<String>, InputError> {
    let Some(plot) = map.optional("plot") else {
        return Ok(Vec::new());
    };
    let what = "the plot of a table";
    let keys = plot.fields(what, &["x", "y", "series"])?;
    let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    let nodes = [
        ("plot.x", Some(keys.required(what, "x")?)),
        ("plot.y", Some(keys.required(what, "y")?)),
        ("plot.series", keys.optional("series")),
    ];
    let column = |(key, node): (&str, Option<&Node>)| Some(node?.word(key, &names).map(str::to_owned));
    nodes.into_iter().filter_map(column).collect()
}

struct TableStage {
    collected: &'static [&'static dyn Kind],
    columns: Vec<Column>,
    cells: Cells,
    plot: Vec<String>,
}

impl Stage for TableStage {
    fn parameters(&self) -> Canonical {
        let columns = self.columns.iter().map(|column| Canonical::from(column.name.as_str()));
        Canonical::map([
            ("columns", columns.collect::<Canonical>()),
            ("rows", self.cells.canonical()),
            (
                "plot",
                self.plot.iter().map(|name| Canonical::from(name.as_str())).collect(),
            ),
        ])
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let mut results = Vec::with_capacity(job.inputs.len());
        for input in job.inputs {
            results.push(self.results_of(input)?);
            job.progress.advance(1);
        }
        let mut table = Table {
            columns: Vec::new(),
            units: Vec::new(),
            text: Vec::new(),
            value: Vec::new(),
            is_number: Vec::new(),
            plot: Lines(self.plot.clone()),
        };
        let mut values = Vec::with_capacity(self.columns.len());
        for (at, column) in self.columns.iter().enumerate() {
            let (cells, unit) = self.cells.column(at, column, &results)?;
            table.columns.push(column.name.clone());
            table.units.push(unit.to_owned());
            values.push(cells);
        }
        for row in 0..self.cells.rows() {
            for cells in &values {
                let cell = &cells[row];
                table.text.push(cell.text());
                table.value.push(cell.number().unwrap_or_default());
                table.is_number.push(u8::from(cell.number().is_some()));
            }
        }
        Ok(table.object())
    }
}

impl TableStage {
    /// Returns the finite results of an artifact by name.
    fn results_of(&self, artifact: &Artifact) -> Result<BTreeMap<String, f64>, StageError> {
        let kind = self.collected.iter().find(|kind| kind.name() == artifact.kind());
        let results = kind.map(|kind| kind.results(artifact)).transpose()?.unwrap_or_default();
        Ok(results.into_iter().filter(|(_, value)| value.is_finite()).collect())
    }
}
