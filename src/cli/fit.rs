//! `deaflow fit`: fits the elastomer of a scene to measured curves.

mod scene;

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::arguments::integer;
use super::measured_files::MeasuredArguments;
use super::text::Text;
use super::{CliError, Exit, Output, table, write};
use deaflow_base::{Dimension, Node, four_significant};
use deaflow_fem::SolveOptions;
use deaflow_fit::{
    Candidate, Curve, CurveResiduals, Estimate, HistoryCurve, Law, LawKind, Outlier, Parameter, RelaxationFit, Sigma,
    Test, Verdict,
};
use deaflow_report::figures::{ComparedCurve, FigureError, FittedCurve, compared_laws_sheet, fit_sheet};
use deaflow_scene::Scene;
use deaflow_stage::direct::{self, ReadScene};
use deaflow_stage::measured::{
    MOST_BRANCHES, MeasuredFile, MeasuredTable, MeshChoice, SpecimenFit, dimension_of, law_named, name_of_law,
};

/// Fit a scene to measurements of specimens and devices
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow fit scene.yaml uniaxial=ut.csv equibiaxial=et.csv -o fitted.yaml",
    "deaflow fit fitted.yaml uniaxial=relaxation.csv -o creeping.yaml",
    "deaflow fit scene.yaml measured.yaml --free shear_modulus --free voltage_offset -o fitted.yaml",
))]
pub struct FitArguments {
    /// The scene that is fitted: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    #[command(flatten)]
    measured: MeasuredArguments,
    /// A number of the scene to fit, by the end of its path, with bounds as in shear_modulus="1 kPa..1 MPa";
    /// voltage_offset is added to all voltages. Several can be given
    #[arg(long, value_name = "KEY", conflicts_with = "absolute")]
    free: Vec<String>,
    #[command(flatten)]
    mesh: MeshArguments,
    /// A law to fit: neo-hookean, gent, yeoh, mooney-rivlin, arruda-boyce, ogden or ogden:N with N terms; several are
    /// compared [default: all, ogden with 1 to 3 terms]
    #[arg(long = "law", value_name = "LAW", value_parser = law, conflicts_with = "free")]
    laws: Vec<LawKind>,
    /// The largest number of viscoelastic branches, which relaxation compares
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = integer::<u64>(0..=MOST_BRANCHES))]
    branches: u64,
    /// The file for the scene with the fitted elastomer; the figure OUT.png is drawn next to it [default: none, results
    /// are only printed]
    #[arg(short, long, value_name = "OUT.yaml")]
    output: Option<PathBuf>,
}

/// The mesh of the simulations of devices.
#[derive(Debug, Args)]
pub struct MeshArguments {
    /// Elements along one side of a cell, for devices [default: 1, and more until parameters no longer change]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=8), help_heading = METHOD)]
    elements_per_cell: Option<u64>,
    /// Polynomial order of the elements, for devices [default: 2]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=2), help_heading = METHOD)]
    order: Option<u64>,
}

/// The heading of options about the numerical method.
const METHOD: &str = "Method";

impl MeshArguments {
    /// Returns mesh and tolerance.
    pub fn options(&self) -> SolveOptions {
        let mesh = MeshChoice {
            elements_per_cell: self.elements_per_cell,
            order: self.order.unwrap_or(2),
        };
        mesh.options()
    }

    /// Returns whether the mesh is chosen.
    pub fn is_chosen(&self) -> bool {
        self.elements_per_cell.is_some()
    }
}

fn law(text: &str) -> Result<LawKind, String> {
    law_named(text).map_err(|allowed| format!("allowed: {allowed}"))
}

pub fn execute(arguments: &FitArguments, output: &Output) -> Result<Exit, CliError> {
    let files = arguments.measured.files.entries()?;
    if let Some(file) = &arguments.output {
        let inputs = [
            arguments.measured.files.names(&files),
            direct::files_read(&arguments.scene),
        ]
        .concat();
        write::check_output(file, &inputs)?;
        write::check_not_read(&file.with_extension("png"), &inputs)?;
    }
    let has_device = files.iter().any(|(file, _)| file.test.of_specimen().is_none());
    if has_device || !arguments.free.is_empty() {
        return scene::execute(arguments, &files, output);
    }
    let scene = direct::read_scene(&arguments.scene)?;
    let fitted = fit(arguments, &files, &scene)?;
    let (Some(sets), mut warnings) = (fitted.changes(&scene), fitted.warnings()) else {
        return Err(CliError::bad_input("no law fits the curves").help(fitted.verdicts().join("; ")));
    };
    warnings.extend(fitted.doubt_at_prestretch(&scene));
    let changes = direct::Changes {
        sets: &sets,
        voltage: None,
    };
    // A law may not reach the prestretch of the scene.
    let own = match direct::read_scene_with(&arguments.scene, changes) {
        Ok(read) => Some(read),
        Err(error) if arguments.output.is_some() => return Err(error.into()),
        Err(error) => {
            warnings.push(format!("the scene cannot have the fitted elastomer: {error}"));
            None
        }
    };
    warnings.iter().for_each(|warning| output.warn(warning));
    let mut files = Vec::new();
    if let Some((file, own)) = arguments.output.as_ref().zip(own.as_ref()) {
        write::file(file, yaml(&fitted, own).as_bytes())?;
        files.push(file.clone());
        let draw = |path: &Path| draw(&fitted, path);
        files.extend(write::drawn(file.with_extension("png"), draw, output));
    }
    let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    let document = || {
        let mut document = laws_document(&fitted);
        let text = |own: &ReadScene| own.scene.to_text_with(own.tolerances.as_ref());
        document["scene"] = json!(own.as_ref().map(text));
        document["files"] = json!(files);
        document["warnings"] = json!(warnings);
        document
    };
    output.result(document, || {
        let mut text = text(&fitted);
        files.iter().for_each(|file| {
            text.line(file);
        });
        text
    })?;
    Ok(exit_of(
        fitted.chosen().is_some_and(|(estimate, ..)| estimate.converged),
    ))
}

/// Returns the exit code of a fit whose results are written.
fn exit_of(converged: bool) -> Exit {
    match converged {
        true => Exit::Done,
        false => Exit::NotConverged,
    }
}

/// Reads the files and fits them.
fn fit(arguments: &FitArguments, files: &[(MeasuredFile, Node)], scene: &Scene) -> Result<SpecimenFit, CliError> {
    let tables = MeasuredTable::read_all(files, Some(scene.form()), arguments.measured.noise())?;
    let measured = tables.iter().filter_map(MeasuredTable::of_specimen).collect();
    let branches = arguments.branches as usize;
    Ok(SpecimenFit::new(measured, scene, &arguments.laws, branches)?)
}

/// Writes a parameter with its interval of 95 %.
fn with_interval(parameter: &Parameter) -> String {
    let dimension = dimension_of(&parameter.name);
    let value = |value: f64| four_significant(dimension.display_unit().0 * value);
    let interval = match parameter.profile.or(parameter.interval) {
        Some((low, high)) => format!(" ({} to {})", value(low), value(high)),
        None if parameter.at_bound => " (at its bound)".to_owned(),
        None => String::new(),
    };
    format!("{} {}{interval}", parameter.name, dimension.with_unit(parameter.value))
}

/// Writes the root mean square of residuals.
fn root_mean_square(value: f64, sigma: &Sigma) -> String {
    match sigma {
        Sigma::Stated(_) | Sigma::StatedFraction(_) => format!("{} σ", four_significant(value)),
        Sigma::UnstatedRelative => format!("{} %", four_significant(100.0 * value)),
        Sigma::UnstatedAbsolute => Dimension::Stress.with_unit(value),
    }
}

/// Writes how far the model is from the data: χ² per degree of freedom, or the root mean square of the residuals.
fn misfit(estimate: &Estimate, sigma: &Sigma) -> String {
    let (sum, dof) = (estimate.sum_of_squares, estimate.degrees_of_freedom as f64);
    match estimate.stated {
        true => format!("χ²/dof {}", four_significant(sum / dof)),
        false => root_mean_square((sum / estimate.points as f64).sqrt(), sigma),
    }
}

/// Returns the columns of both tables that describe an estimate; `best` is the least AICc.
fn columns(estimate: &Estimate, sigma: &Sigma, best: f64) -> [String; 3] {
    let parameters: Vec<String> = estimate.parameters.iter().map(with_interval).collect();
    let above = estimate.information.aicc - best;
    [
        parameters.join("\n"),
        misfit(estimate, sigma),
        format!("+{}", four_significant(above)),
    ]
}

fn text(fitted: &SpecimenFit) -> Text {
    match fitted {
        SpecimenFit::Laws(curves, candidates) => {
            let sigma = &curves[0].sigma;
            let tests: Vec<Test> = candidates
                .first()
                .map(|found| found.left_out.iter().map(|(test, _)| *test).collect())
                .unwrap_or_default();
            let left_out: Vec<String> = tests.iter().map(|test| format!("without {}", test.name())).collect();
            let header: Vec<&str> = ["law", "parameters (95 %)", "misfit", "AICc"]
                .into_iter()
                .chain(left_out.iter().map(String::as_str))
                .chain(["verdict"])
                .collect();
            let mut table = table::table(&header, &["misfit", "AICc"]).flowing(&["parameters (95 %)", "verdict"]);
            let best = candidates.first().map_or(0.0, Candidate::aicc);
            for found in candidates {
                let mut row = vec![name_of_law(found.kind)];
                match &found.fit {
                    Ok(fit) => row.extend(columns(&fit.estimate, sigma, best)),
                    Err(_) => row.extend(["–", "–", "–"].map(str::to_owned)),
                }
                let left_out = found.left_out.iter().map(|(_, error)| *error);
                row.extend(left_out.map(|error| error.map_or("–".to_owned(), |error| root_mean_square(error, sigma))));
                row.push(match &found.fit {
                    Ok(fit) => fit.verdict.to_string(),
                    Err(error) => error.to_string(),
                });
                table.add_row(row);
            }
            let mut text = Text::of(table);
            text.line("AICc: above the best; without: root mean square at a test after a fit to the others");
            if let Some(fit) = fitted.chosen_law() {
                let reason = fitted.reason().map_or_else(String::new, |reason| format!("; {reason}"));
                text.line(format!("chosen: {}{reason}", name_of_law(fit.law.kind())));
            }
            if let Some(other) = fitted.better_left_out() {
                let other = name_of_law(other);
                text.line(format!(
                    "{other} is better at tests that are left out: the curves do not decide"
                ));
            }
            text
        }
        SpecimenFit::Branches(curves, fits) => {
            let sigma = &curves[0].sigma;
            let header = ["branches", "parameters (95 %)", "misfit", "AICc", "verdict"];
            let mut table = table::table(&header, &["misfit", "AICc"]).flowing(&["parameters (95 %)", "verdict"]);
            let best = fits.first().map_or(0.0, |fit| fit.estimate.information.aicc);
            for fit in fits {
                let [parameters, misfit, above] = columns(&fit.estimate, sigma, best);
                let branches = fit.branches().to_string();
                table.add_row([branches, parameters, misfit, above, fit.verdict.to_string()]);
            }
            Text::of(table)
        }
    }
}

fn laws_document(fitted: &SpecimenFit) -> Value {
    match fitted {
        SpecimenFit::Laws(_, candidates) => {
            let law = |found: &Candidate| {
                let mut law = match &found.fit {
                    Ok(fit) => estimate_document(&fit.estimate, &fit.verdict, &fit.residuals, &fit.outliers),
                    Err(error) => json!({ "error": error.to_string() }),
                };
                let left_out = found
                    .left_out
                    .iter()
                    .map(|(test, error)| (test.name().to_owned(), json!(error)));
                law["law"] = json!(name_of_law(found.kind));
                law["left_out"] = Value::Object(left_out.collect());
                law
            };
            json!({
                "laws": candidates.iter().map(law).collect::<Vec<_>>(),
                "chosen": fitted.chosen_law().map(|fit| name_of_law(fit.law.kind())),
                "reason": fitted.reason(),
            })
        }
        SpecimenFit::Branches(_, fits) => {
            let fit = |fit: &RelaxationFit| {
                let mut found = estimate_document(&fit.estimate, &fit.verdict, &fit.residuals, &fit.outliers);
                found["branches"] = json!(fit.branches());
                found
            };
            json!({
                "relaxation": fits.iter().map(fit).collect::<Vec<_>>(),
                "chosen": fits.first().map(RelaxationFit::branches),
            })
        }
    }
}

/// Returns the fitted scene, with a comment on its source.
fn yaml(fitted: &SpecimenFit, own: &ReadScene) -> String {
    let parameters = fitted
        .chosen()
        .into_iter()
        .flat_map(|(estimate, ..)| &estimate.parameters);
    let parameters: Vec<String> = parameters.map(with_interval).collect();
    let files: Vec<String> = match fitted {
        SpecimenFit::Laws(curves, _) => curves
            .iter()
            .map(|own| format!("{} ({})", own.name, own.test.name()))
            .collect(),
        SpecimenFit::Branches(curves, _) => curves
            .iter()
            .map(|own| format!("{} ({})", own.name, own.test.name()))
            .collect(),
    };
    format!(
        "# The elastomer is fitted by `deaflow fit` to {}.\n# With intervals of 95 %: {}.\n{}",
        files.join(", "),
        parameters.join("; "),
        own.scene.to_yaml_with(own.tolerances.as_ref())
    )
}

/// Points of a curve in a figure.
const POINTS: usize = 100;

/// The label of the stresses in a figure.
const STRESS: &str = "nominal stress, kPa";

/// Draws the measured points and the fit, or all fits that were compared.
fn draw(fitted: &SpecimenFit, path: &Path) -> Result<(), FigureError> {
    let (title, label, curves) = match fitted {
        SpecimenFit::Laws(curves, candidates) => {
            let laws = named_laws(fitted, candidates);
            let curves: Vec<ComparedCurve> = curves.iter().map(|curve| compared_curve(curve, &laws)).collect();
            let name = fitted.chosen_law().map(|fit| name_of_law(fit.law.kind()));
            (name.unwrap_or_default(), "stretch", curves)
        }
        SpecimenFit::Branches(curves, fits) => {
            let fits = named_fits(fits);
            let curves = curves.iter().map(|curve| compared_history(curve, &fits));
            ("relaxation".to_owned(), "time, s", curves.collect())
        }
    };
    let only = |curve: &ComparedCurve| FittedCurve {
        name: curve.name.clone(),
        measured: curve.measured.clone(),
        fitted: curve.laws.first().map(|(_, points)| points.clone()).unwrap_or_default(),
    };
    let sheet = match curves.iter().all(|curve| curve.laws.len() <= 1) {
        true => fit_sheet(&title, [label, STRESS], &curves.iter().map(only).collect::<Vec<_>>())?,
        false => compared_laws_sheet([label, STRESS], &curves)?,
    };
    sheet.write_png(path)
}

/// Returns the fitted laws with their names for a figure, the chosen one first.
fn named_laws<'f>(fitted: &'f SpecimenFit, candidates: &'f [Candidate]) -> Vec<(String, &'f Law)> {
    let chosen = fitted.chosen_law().map(|fit| fit.law.kind());
    let best = candidates.first().map_or(0.0, Candidate::aicc);
    let fits = candidates
        .iter()
        .filter_map(|found| Some((found, found.fit.as_ref().ok()?)));
    let named = fits.map(|(found, fit)| match Some(found.kind) == chosen {
        true => (format!("{}, chosen", name_of_law(found.kind)), &fit.law),
        false => {
            let above = four_significant(found.aicc() - best);
            (format!("{}, AICc +{above}", name_of_law(found.kind)), &fit.law)
        }
    });
    let mut named: Vec<(String, &Law)> = named.collect();
    named.sort_by_key(|(_, law)| Some(law.kind()) != chosen);
    named
}

/// Returns the fits of branches with their names for a figure, the best one first.
fn named_fits(fits: &[RelaxationFit]) -> Vec<(String, &RelaxationFit)> {
    let best = fits.first().map_or(0.0, |fit| fit.estimate.information.aicc);
    let named = fits.iter().enumerate().map(|(at, fit)| {
        let branches = table::counted(fit.branches() as u64, "branches");
        match at {
            0 => (format!("{branches}, chosen"), fit),
            _ => {
                let above = four_significant(fit.estimate.information.aicc - best);
                (format!("{branches}, AICc +{above}"), fit)
            }
        }
    });
    named.collect()
}

/// Returns equal steps between two numbers.
fn between(low: f64, high: f64) -> impl Iterator<Item = f64> {
    (0..=POINTS).map(move |k| low + (high - low) * k as f64 / POINTS as f64)
}

/// Pairs numbers with stresses in Pa, which become those in kPa.
fn pairs(x: &[f64], y: &[f64]) -> Vec<(f64, f64)> {
    x.iter().copied().zip(y.iter().map(|y| 1e-3 * y)).collect()
}

/// Returns a measured curve with those of laws; a law ends where it has no stress.
fn compared_curve(curve: &Curve, laws: &[(String, &Law)]) -> ComparedCurve {
    let largest = curve.stretch.iter().copied().fold(1.0, f64::max);
    let smallest = curve.stretch.iter().copied().fold(1.0, f64::min);
    let of = |(name, law): &(String, &Law)| {
        let points = between(smallest, largest)
            .filter_map(|stretch| Some((stretch, 1e-3 * law.nominal_stress(curve.test, stretch)?)));
        (name.clone(), points.collect())
    };
    ComparedCurve {
        name: format!("{} ({})", curve.name, curve.test.name()),
        measured: pairs(&curve.stretch, &curve.stress_pa),
        laws: laws.iter().map(of).collect(),
    }
}

/// Returns a measured history with those of fits of branches.
fn compared_history(curve: &HistoryCurve, fits: &[(String, &RelaxationFit)]) -> ComparedCurve {
    let latest = curve.time_s.iter().copied().fold(0.0, f64::max);
    let times: Vec<f64> = between(0.0, latest).collect();
    let of = |(name, fit): &(String, &RelaxationFit)| {
        let stresses = fit.stresses(curve.test, &curve.history, &times).ok();
        (name.clone(), pairs(&times, &stresses.unwrap_or_default()))
    };
    ComparedCurve {
        name: format!("{} ({})", curve.name, curve.test.name()),
        measured: pairs(&curve.time_s, &curve.stress_pa),
        laws: fits.iter().map(of).collect(),
    }
}

fn estimate_document(
    estimate: &Estimate,
    verdict: &Verdict,
    residuals: &[CurveResiduals],
    outliers: &[Outlier],
) -> Value {
    // Open ends have no number in JSON.
    let ends = |ends: (f64, f64)| [ends.0, ends.1].map(|end| end.is_finite().then_some(end));
    let parameter = |parameter: &Parameter| {
        json!({
            "name": parameter.name,
            "value": parameter.value,
            "standard_error": parameter.standard_error,
            "is_of_logarithm": parameter.logarithmic,
            "interval": parameter.interval.map(ends),
            "profile": parameter.profile.map(ends),
            "at_bound": parameter.at_bound,
        })
    };
    let residual = |own: &CurveResiduals| json!({ "file": own.name, "values": own.residuals });
    json!({
        "parameters": estimate.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "points": estimate.points,
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "sum_of_squares": estimate.sum_of_squares,
        "sigma_stated": estimate.stated,
        "aicc": Some(estimate.information.aicc).filter(|aicc| aicc.is_finite()),
        "bic": estimate.information.bic,
        "converged": estimate.converged,
        "verdict": verdict.to_string(),
        "residuals": residuals.iter().map(residual).collect::<Vec<_>>(),
        "outliers": outliers.iter().map(|own| json!({
            "file": own.curve,
            "row": own.row,
            "deviations": own.deviations,
        })).collect::<Vec<_>>(),
    })
}
