//! The JSON document of a screening.

use serde_json::{Value, json};

use super::{Comparison, Row, Screening, Status};

impl Screening {
    /// Returns the rows, the simulated effects and the warnings, as `deaflow screen --json` prints them.
    #[must_use]
    pub fn document(&self) -> Value {
        let row = |row: &Row| {
            json!({
                "effect": row.effect,
                "quantity": row.assessment.quantity,
                "number": row.assessment.number,
                "error": row.assessment.error,
                "threshold": row.assessment.threshold,
                "called_for": row.assessment.verdict.name(),
                "status": row.status.name(),
                "change": row.assessment.change,
                "cost": row.cost,
                "patterns": row.comparisons.iter().map(comparison).collect::<Vec<_>>(),
            })
        };
        let on = self.rows.iter().filter(|row| row.status == Status::On);
        json!({
            "effects": self.rows.iter().map(row).collect::<Vec<_>>(),
            "simulated": on.map(|row| row.effect).collect::<Vec<_>>(),
            "warnings": self.warnings(),
        })
    }
}

fn comparison(one: &Comparison) -> Value {
    let [without, with] = one.outcomes.map(|outcome| outcome.name());
    json!({
        "pattern": one.pattern,
        "without": without,
        "with": with,
        "voltage": one.displacement.map(|d| d.voltage),
        "difference": one.displacement.map(|d| d.difference),
        "change": one.displacement.map(|d| d.change),
    })
}
