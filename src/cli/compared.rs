//! How measured numbers agree with simulated ones, for people and scripts.

use serde_json::{Value, json};

use super::table;
use super::text::Text;
use deaflow_base::{four_digits, with_minus};
use deaflow_report::figures::{FigureError, FittedCurve, MeasuredFigure};
use deaflow_scene::Scene;
use deaflow_stage::measured::{Agreement, Compared, Values};

/// Returns a table with a row for each file.
pub fn summary(compared: &[Compared]) -> Text {
    let header = ["file", "points", "bias", "RMS", "largest", "R²", "χ²/dof"];
    let numbers = &header[1..];
    let mut table = table::table(&header, numbers);
    for one in compared {
        let Agreement {
            points,
            bias,
            rms,
            largest,
            r_squared,
            chi2_per_dof,
        } = &one.agreement;
        let bias = bias.map_or_else(|| "–".to_owned(), |bias| with_unit(bias, &one.values));
        table.add_row([
            one.name.clone(),
            points.to_string(),
            bias,
            with_unit(*rms, &one.values),
            format!("{} (row {})", with_unit(largest.0, &one.values), largest.1),
            r_squared.map_or_else(|| "–".to_owned(), |r| with_minus(&format!("{r:.4}"))),
            chi2_per_dof.map_or_else(|| "–".to_owned(), four_digits),
        ]);
    }
    let mut text = Text::of(table);
    for one in compared {
        if let Values::Field { result, .. } = &one.values {
            let [x, y] = result.translation_mm.map(|at| with_minus(&four_digits(at)));
            let degrees = with_minus(&four_digits(result.rotation.to_degrees()));
            text.line(format!("{}: motion of the camera {x}, {y} mm and {degrees}°", one.name));
        }
    }
    text
}

/// The factor and the unit in which people read the numbers.
fn unit_of(values: &Values) -> (f64, &'static str) {
    match values {
        Values::Field { .. } | Values::Series { .. } => (1.0, "mm"),
        Values::Curve { .. } => (1e-3, "kPa"),
        Values::Sheet { .. } => (1.0, ""),
    }
}

/// Writes a number with its unit.
pub fn with_unit(value: f64, values: &Values) -> String {
    let (factor, unit) = unit_of(values);
    let number = with_minus(&four_digits(factor * value));
    format!("{number} {unit}").trim_end().to_owned()
}

/// Returns the figures of all files.
///
/// # Errors
/// If a number is not finite.
pub fn figures(compared: &[Compared], scene: &Scene) -> Result<Vec<MeasuredFigure>, FigureError> {
    let pair = |x: &[f64], y: &[f64], factor: f64| -> Vec<(f64, f64)> {
        let mut pairs: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().map(|y| factor * y)).collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        pairs
    };
    let figure = |one: &Compared| match &one.values {
        Values::Field { points_mm, result, .. } => MeasuredFigure::Map {
            name: one.name.clone(),
            size_mm: scene.membrane().size_mm,
            points_mm: points_mm.clone(),
            differences_mm: result.residual_mm.iter().map(|[x, y]| x.hypot(*y)).collect(),
        },
        Values::Series {
            voltages_v,
            measured_mm,
            simulated_mm,
        } => {
            let kilovolts: Vec<f64> = voltages_v.iter().map(|volts| 1e-3 * volts).collect();
            MeasuredFigure::Curve {
                labels: ["voltage, kV", "displacement, mm"],
                curve: FittedCurve {
                    name: one.name.clone(),
                    measured: pair(&kilovolts, measured_mm, 1.0),
                    fitted: pair(&kilovolts, simulated_mm, 1.0),
                },
            }
        }
        Values::Sheet {
            is_creep,
            at,
            measured,
            simulated,
        } => {
            let factor = if *is_creep { 1.0 } else { 1e-3 };
            let at: Vec<f64> = at.iter().map(|at| factor * at).collect();
            MeasuredFigure::Curve {
                labels: [if *is_creep { "time, s" } else { "voltage, kV" }, "stretch"],
                curve: FittedCurve {
                    name: one.name.clone(),
                    measured: pair(&at, measured, 1.0),
                    fitted: pair(&at, simulated, 1.0),
                },
            }
        }
        Values::Curve {
            stretch,
            measured_pa,
            simulated_pa,
        } => MeasuredFigure::Curve {
            labels: ["stretch", "nominal stress, kPa"],
            curve: FittedCurve {
                name: one.name.clone(),
                measured: pair(stretch, measured_pa, 1e-3),
                fitted: pair(stretch, simulated_pa, 1e-3),
            },
        },
    };
    Ok(compared.iter().map(figure).collect())
}

/// Describes all files.
pub fn document(compared: &[Compared]) -> Value {
    let one = |one: &Compared| {
        let own = &one.agreement;
        let mut found = json!({
            "file": one.name,
            "points": own.points,
            "bias": own.bias,
            "rms": own.rms,
            "largest": own.largest.0,
            "largest_row": own.largest.1,
            "r_squared": own.r_squared,
            "chi2_per_dof": own.chi2_per_dof,
        });
        if let Values::Field { result, .. } = &one.values {
            found["camera"] = json!({ "translation_mm": result.translation_mm, "rotation_rad": result.rotation });
        }
        found
    };
    compared.iter().map(one).collect()
}
