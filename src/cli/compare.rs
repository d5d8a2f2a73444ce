//! `deaflow compare`: measured beside simulated numbers.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::quantity;
use super::compared::{document, notes, summary, with_unit, write_with_figure};
use super::fit::MeshArguments;
use super::measured_files::FileArguments;
use super::text::Text;
use super::{CliError, Exit, Output, csv, table, write};
use deaflow_base::Dimension;
use deaflow_content::MeasuredQuantity;
use deaflow_stage::direct;
use deaflow_stage::measured::curve::Noise;
use deaflow_stage::measured::{
    Compared, Device, MeasuredSet, VOLTAGE_OFFSET, Values, WithEffect, compare_all, read_sets, with_neglected_effects,
};

/// Compare measurements with a simulation at the same points
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow compare scene.yaml measured.yaml",
    "deaflow compare fitted.yaml uniaxial=ut.csv",
    "deaflow compare fitted.yaml measured.yaml -o compared.csv",
))]
pub struct CompareArguments {
    /// The scene: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    #[command(flatten)]
    measured: FileArguments,
    /// Override a value of the scene, such as material.shear_modulus="40 kPa"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    /// A voltage that is added to all voltages, such as the offset that fit has found
    #[arg(long, value_name = "VOLTAGE", allow_hyphen_values = true, value_parser = voltage)]
    voltage_offset: Option<f64>,
    /// Also simulate with each neglected effect whose data the scene has, and say how well that agrees
    #[arg(long)]
    effects: bool,
    #[command(flatten)]
    mesh: MeshArguments,
    /// The table for measured and simulated numbers by row; the figure OUT.png is drawn next to it [default: none, only
    /// a summary is printed]
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
}

fn voltage(text: &str) -> Result<f64, String> {
    Ok(quantity(text, Dimension::Voltage)?.value())
}

pub fn execute(arguments: &CompareArguments, output: &Output) -> Result<Exit, CliError> {
    let files = arguments.measured.entries()?;
    if let Some(file) = &arguments.output {
        let inputs = [direct::files_read(&arguments.scene), arguments.measured.names(&files)].concat();
        write::check_output(file, &inputs)?;
        write::check_not_read(&file.with_extension("png"), &inputs)?;
    }
    let changes = direct::Changes {
        sets: &arguments.sets,
        voltage: None,
    };
    let scene = direct::read_scene_with(&arguments.scene, changes)?.scene;
    let (keys, offset): (Vec<String>, Vec<f64>) = arguments
        .voltage_offset
        .iter()
        .map(|offset| (VOLTAGE_OFFSET.to_owned(), *offset))
        .unzip();
    let device = Device::new(&scene, &keys, arguments.mesh.options())?;
    let sets = read_sets(&files, &device, &scene, Noise::Relative)?;
    let notes = notes(&sets, output);
    let (compared, mesh) = compare_all(&device, &sets, &offset, !arguments.mesh.is_chosen())?;
    let device = device.on(mesh);
    // Specimens are not simulated on a mesh.
    let mesh = sets.iter().any(MeasuredSet::is_of_device).then(|| mesh.to_string());
    let neglected = match arguments.effects {
        true => with_neglected_effects(&scene, &device, (&sets, &compared), &offset)?,
        false => Vec::new(),
    };
    let written = match &arguments.output {
        Some(file) => write_with_figure(file, rows(&compared)?.as_bytes(), &compared, &scene, output)?,
        None => Vec::new(),
    };
    let all = || {
        let mut all = json!({
            "compared": document(&compared),
            "mesh": mesh,
            "files": written,
            "notes": notes,
        });
        if arguments.effects {
            all["effects"] = neglected.iter().map(effect_document).collect();
        }
        all
    };
    output.result(all, || {
        let mut text = summary(&compared);
        if let Some(mesh) = &mesh {
            text.line(format!("mesh: {mesh}"));
        }
        if arguments.effects {
            text.append(effects(&compared, &neglected));
        }
        written.iter().for_each(|file| {
            text.line(file);
        });
        text
    })
}

/// Returns a table of the root mean squares with each neglected effect.
fn effects(compared: &[Compared], neglected: &[WithEffect]) -> Text {
    let header: Vec<&str> = ["RMS with"]
        .into_iter()
        .chain(compared.iter().map(|one| one.name.as_str()))
        .collect();
    let mut table = table::table(&header, &header[1..]);
    let row = |name: &str, agreements: &mut dyn Iterator<Item = f64>| {
        let numbers = agreements.zip(compared).map(|(rms, one)| with_unit(rms, &one.values));
        std::iter::once(name.to_owned()).chain(numbers).collect::<Vec<_>>()
    };
    table.add_row(row("this scene", &mut compared.iter().map(|one| one.agreement.rms)));
    let mut failed = Vec::new();
    for one in neglected {
        match &one.agreements {
            Ok(agreements) => {
                table.add_row(row(one.effect, &mut agreements.iter().map(|own| own.rms)));
            }
            Err(why) => failed.push(format!("{}: {why}", one.effect)),
        }
    }
    let mut text = Text::of(table);
    failed.into_iter().for_each(|line| {
        text.line(line);
    });
    text
}

fn effect_document(one: &WithEffect) -> Value {
    match &one.agreements {
        Ok(agreements) => json!({
            "effect": one.effect,
            "rms": agreements.iter().map(|own| own.rms).collect::<Vec<_>>(),
            "chi2_per_dof": agreements.iter().map(|own| own.chi2_per_dof).collect::<Vec<_>>(),
        }),
        Err(why) => json!({ "effect": one.effect, "error": why }),
    }
}

/// Writes all numbers: a row for each point, with empty fields where a quantity does not belong to its file. Measured
/// displacements of fields are without the motion of the camera.
///
/// # Errors
/// When memory is short.
fn rows(compared: &[Compared]) -> Result<String, CliError> {
    const HEADER: [&str; 12] = [
        "file",
        "row",
        "x_mm",
        "y_mm",
        "time_s",
        "voltage_V",
        "frequency_Hz",
        "stretch",
        "component",
        "measured",
        "simulated",
        "unit",
    ];
    /// The quantities of the columns with units.
    const PLACES: [&str; 6] = ["x", "y", "time", "voltage", "frequency", "stretch"];
    let mut all = Vec::new();
    for one in compared {
        let mut add =
            |row: usize, place: [Option<f64>; 6], component: &str, [measured, simulated]: [f64; 2], unit: &str| {
                let place = place.map(|number| number.map_or_else(String::new, |number| number.to_string()));
                let start = [one.name.clone(), row.to_string()];
                let end = [
                    component.to_owned(),
                    measured.to_string(),
                    simulated.to_string(),
                    unit.to_owned(),
                ];
                all.push([&start[..], &place[..], &end[..]].concat());
            };
        match &one.values {
            Values::Field {
                points_mm,
                rows,
                simulated_mm,
                result,
                ..
            } => {
                let differences = result.residual_mm.iter();
                for (((at, row), simulated), difference) in
                    points_mm.iter().zip(rows).zip(simulated_mm).zip(differences)
                {
                    for (c, component) in ["ux", "uy"].into_iter().enumerate() {
                        let numbers = [simulated[c] + difference[c], simulated[c]];
                        add(
                            *row,
                            [Some(at[0]), Some(at[1]), None, None, None, None],
                            component,
                            numbers,
                            "mm",
                        );
                    }
                }
            }
            Values::Series {
                quantities,
                rows,
                at,
                measured,
                simulated,
            } => {
                let MeasuredQuantity { symbol, dimension, .. } = quantities.measured();
                let unit = if dimension == Dimension::Number {
                    "1"
                } else {
                    dimension.base_unit()
                };
                let column = PLACES.into_iter().position(|place| place == quantities.against().name);
                for (at, (row, number)) in rows.iter().zip(at).enumerate() {
                    let place = std::array::from_fn(|own| (Some(own) == column).then_some(*number));
                    add(*row, place, symbol, [measured[at], simulated[at]], unit);
                }
            }
        }
    }
    csv::text(&HEADER.map(str::to_owned), all.into_iter())
}
