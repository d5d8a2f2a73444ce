//! `deaflow screen`: lists the significant effects of a scene.

use std::path::PathBuf;

use clap::Args;

use super::arguments::{StateArguments, TimeArguments};
use super::pipeline::warn_of_scene;
use super::text::Text;
use super::{CliError, Exit, Output, table};
use deaflow_base::{InputError, rounded_by};
use deaflow_fem::WorkLimit;
use deaflow_fem::screening::{self, Row, Screening, Status, TestPattern};
use deaflow_pattern::{DrawingOptions, PatternForm};
use deaflow_report::three;
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::direct;

/// Show which effects are significant in a scene, with thresholds and costs
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow screen scene.yaml", "deaflow screen scene.yaml mine.csv"))]
pub struct ScreenArguments {
    /// The scene: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    /// Patterns to evaluate: FILE.npy, FILE.csv, FILE.png, FILE.dxf, FILE.svg or FILE.h5:/dataset [default: extreme patterns]
    #[arg(value_name = "PATTERN")]
    pub patterns: Vec<String>,
    /// Screen at this voltage instead of the scene's, as in "4 kV"
    #[arg(long, value_name = "VOLTAGE", allow_hyphen_values = true)]
    voltage: Option<String>,
    /// Override a value of the scene, such as drive.voltage="4 kV"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    #[command(flatten)]
    pub time: TimeArguments,
    #[command(flatten)]
    pub state: StateArguments,
}

pub fn execute(arguments: &ScreenArguments, output: &Output) -> Result<Exit, CliError> {
    let changes = direct::Changes {
        sets: &arguments.sets,
        voltage: arguments.voltage.as_deref(),
    };
    let read = direct::read_scene_with(&arguments.scene, changes)?;
    warn_of_scene(&read, output);
    let scene = arguments.state.of(read.scene)?;
    if let Some(faint) = stage::weak_drive_warning(&scene.at_largest_voltages()) {
        output.warn(format_args!("{faint}"));
    }
    let patterns = match arguments.patterns.is_empty() {
        true => None,
        false => Some(named(&arguments.patterns, scene.form(), output)?),
    };
    let screening = screen(scene, patterns, arguments.time.work_limit())?;
    output.result(|| screening.document(), || text(&screening))
}

/// Formats the table: two lines per effect, so that it stays narrow.
fn text(screening: &Screening) -> Text {
    let header = [
        "effect and number",
        "value",
        "above",
        "significant",
        "now",
        "change if switched on; cost",
    ];
    let mut table = table::table(&header, &["value", "above"]).flowing(&[header[0], header[5]]);
    for row in &screening.rows {
        let arises = row.assessment.quantity != "–";
        let formula = if arises {
            format!("\n  {}", row.assessment.quantity)
        } else {
            String::new()
        };
        table.add_row([
            format!("{}{formula}", row.effect),
            row.assessment.number.map_or_else(
                || "–".to_owned(),
                |number| match row.assessment.error {
                    Some(error) => rounded_by(number, error),
                    None => three(number),
                },
            ),
            if arises {
                row.assessment.threshold.to_string()
            } else {
                "–".to_owned()
            },
            row.assessment.verdict.name().to_owned(),
            match row.status {
                Status::NotAvailable => "–".to_owned(),
                known => known.name().to_owned(),
            },
            format!("{}\n{}", row.assessment.change, row.cost),
        ]);
    }
    let simulated = format!("simulated: effects: {}", screening.scene.effects.to_text());
    let is_missing = |row: &Row| row.status == Status::NotAvailable;
    let legend = match screening.rows.iter().any(is_missing) {
        true => "now: on or off in the scene; –: cannot be simulated".to_owned(),
        false => "now: on or off in the scene".to_owned(),
    };
    let warnings = screening
        .warnings()
        .into_iter()
        .map(|warning| format!("model warning: {warning}"));
    let lines: Vec<String> = [legend, simulated].into_iter().chain(warnings).collect();
    let mut text = Text::of(table);
    text.line("").line(lines.join("\n"));
    text
}

/// Screens a scene at the largest voltages of all its states, with given patterns, or else with reference patterns.
///
/// # Errors
/// When the effects cannot be simulated.
pub fn screen(scene: Scene, patterns: Option<Vec<TestPattern>>, limit: WorkLimit) -> Result<Screening, CliError> {
    let scene = scene.at_largest_voltages();
    let own = patterns.is_some();
    let patterns = patterns.unwrap_or_else(|| screening::reference_patterns(&scene));
    // `auto` always depends on the reference patterns and the default limit.
    let scene = match own || limit != WorkLimit::default() {
        true => screening::resolve(&scene)?,
        false => scene,
    };
    Ok(screening::screen_within(&scene, &patterns, limit)?)
}

/// Reads the patterns of each argument, and names them after it.
fn named(arguments: &[String], form: PatternForm, output: &Output) -> Result<Vec<TestPattern>, InputError> {
    let direct::NamedPatterns {
        patterns,
        names,
        notes,
        drawings,
    } = direct::patterns(arguments, form, &DrawingOptions::default())?;
    notes.iter().for_each(|note| output.warn(note));
    let named = names.iter().zip(patterns).zip(drawings);
    Ok(named
        .map(|((name, pattern), drawing)| TestPattern::new(name, pattern).drawn(drawing))
        .collect())
}
