//! Fits free numbers of a scene to fields and curves of devices, and to curves of specimens.

use serde_json::{Value, json};

use super::{FitArguments, estimate_document, exit_of};
use crate::compared::{notes, summary, write_with_figure};
use crate::progress::{ProgressMode, show_count};
use crate::text::Text;
use crate::{CliError, Exit, Output, table};
use deaflow_base::{Node, four_significant, listed};
use deaflow_fit::{CurveResiduals, Parameter, Verdict};
use deaflow_scene::Tolerances;
use deaflow_stage::direct::{self, Changes, ReadScene};
use deaflow_stage::measured::{
    Compared, Device, FreeKey, MeasuredFile, MeasuredSet, SceneFit, compare_all, fit_scene, read_sets, with_interval,
};

/// Fits a scene to the files of lists.
pub fn execute(arguments: &FitArguments, files: &[(MeasuredFile, Node)], output: &Output) -> Result<Exit, CliError> {
    if arguments.free.is_empty() {
        return Err(CliError::bad_input("a fit to a device needs free parameters")
            .help("name numbers of the scene, as in --free shear_modulus --free voltage_offset"));
    }
    let ReadScene { scene, tolerances, .. } = direct::read_scene_with(&arguments.scene, Changes::default())?;
    let device = Device::new(&scene, &arguments.free, arguments.mesh.options())?;
    let sets = read_sets(files, &device, &scene, arguments.measured.noise())?;
    notes(&sets, output);
    let shown = show_count(ProgressMode::Bars, ["fit", "simulations"], device.simulations(), 0);
    let found = fit_scene(&device, &sets, !arguments.mesh.is_chosen());
    drop(shown);
    let found = found?;
    let values = found.values();
    let device = found.mesh.map_or_else(|| device.clone(), |mesh| device.on(mesh));
    let (compared, _) = compare_all(&device, &sets, &values, false)?;
    let warnings = found.warnings(&device)?;
    warnings.iter().for_each(|warning| output.warn(warning));
    let written = match &arguments.output {
        Some(file) => {
            let yaml = yaml(&found, tolerances.as_ref(), device.keys(), &sets);
            write_with_figure(file, yaml.as_bytes(), &compared, &scene, output)?
        }
        None => Vec::new(),
    };
    let document = || {
        let mut document = document(&found, device.effects(), &compared);
        document["scene"] = json!(found.scene.to_text_with(tolerances.as_ref()));
        document["files"] = json!(written);
        document["warnings"] = json!(warnings);
        document
    };
    output.result(document, || {
        let mut text = text(&found, &device, &compared);
        written.iter().for_each(|file| {
            text.line(file);
        });
        text
    })?;
    Ok(exit_of(found.fit.estimate.converged))
}

fn pairs<'a>(found: &'a SceneFit, keys: &'a [FreeKey]) -> impl Iterator<Item = (&'a Parameter, &'a FreeKey)> {
    found.fit.estimate.parameters.iter().zip(keys)
}

fn text(found: &SceneFit, device: &Device, compared: &[Compared]) -> Text {
    let (keys, effects) = (device.keys(), device.effects());
    let header = ["parameter", "value", "interval of 95 %"];
    let mut parameters = table::table(&header, &["value"]);
    for (parameter, key) in pairs(found, keys) {
        let [value, interval] = with_interval(parameter, key, found.fit.estimate.converged);
        parameters.add_row([key.path.clone(), value, interval]);
    }
    let mut text = Text::of(parameters);
    text.append(summary(compared));
    if !effects.is_empty() {
        text.line(format!("simulated effects: {}", listed(effects)));
    }
    if let Some(mesh) = found.mesh {
        let shift = found.shift.map_or_else(String::new, |shift| {
            format!(
                "; with elements of twice the size the parameters change by at most {} standard errors",
                four_significant(shift)
            )
        });
        text.line(format!("mesh: {mesh}{shift}"));
    }
    text
}

/// Returns the fitted scene, with a comment on its source.
fn yaml(found: &SceneFit, tolerances: Option<&Tolerances>, keys: &[FreeKey], sets: &[MeasuredSet]) -> String {
    let files: Vec<String> = sets
        .iter()
        .map(|set| format!("{} ({})", set.name, set.test.name()))
        .collect();
    let parameter = |(parameter, key): (&Parameter, &FreeKey)| {
        let [value, interval] = with_interval(parameter, key, found.fit.estimate.converged);
        format!("{} {value} ({interval})", key.path)
    };
    let parameters: Vec<String> = pairs(found, keys).map(parameter).collect();
    let verdict = match found.fit.verdict {
        Verdict::Determined => String::new(),
        ref other => format!("# {other}.\n"),
    };
    format!(
        "# Fitted by `deaflow fit` to {}.\n# With intervals of 95 %: {}.\n{verdict}{}",
        files.join(", "),
        parameters.join("; "),
        found.scene.to_yaml_with(tolerances)
    )
}

fn document(found: &SceneFit, effects: &[String], compared: &[Compared]) -> Value {
    let fit = &found.fit;
    let residuals = |set: &deaflow_fit::SetResult| CurveResiduals {
        name: set.name.clone(),
        residuals: set.residuals.clone(),
    };
    let residuals: Vec<CurveResiduals> = fit.sets.iter().map(residuals).collect();
    let mut document = estimate_document(&fit.estimate, &fit.verdict, &residuals, &fit.outliers);
    document["effects"] = json!(effects);
    document["mesh"] = json!(found.mesh.map(|mesh| mesh.to_string()));
    document["mesh_shift"] = json!(found.shift);
    document["compared"] = crate::compared::document(compared);
    document
}
