//! Arguments that name files of measurements, and say what their noise is.

use std::path::PathBuf;

use clap::Args;

use super::CliError;
use super::arguments::quantity;
use deaflow_base::{Dimension, Node};
use deaflow_stage::measured::curve::Noise;
use deaflow_stage::measured::{MeasuredFile, Measurement};

/// Files of measurements.
#[derive(Debug, Args)]
pub struct FileArguments {
    /// Measured curves, uniaxial=FILE, equibiaxial=FILE or pure-shear=FILE: tables with the columns stretch and
    /// nominal_stress_kPa; with a column time_s, the stress along that history of stretch, after a sudden step if all
    /// stretches are equal. Or a list of measured files in YAML, with what
    /// is known about each
    #[arg(value_name = "TEST=FILE|MEASURED.yaml", required = true, value_parser = measured_file)]
    files: Vec<FileArgument>,
}

/// Files of measurements with their noise.
#[derive(Debug, Args)]
pub struct MeasuredArguments {
    #[command(flatten)]
    pub files: FileArguments,
    /// Standard deviation of the stresses of files without a column sigma_kPa, as in "3 %" or "2 kPa" [default:
    /// unknown]
    #[arg(long, value_name = "SIGMA", value_parser = sigma, conflicts_with = "absolute")]
    sigma: Option<StatedSigma>,
    /// Take the unknown noise as equal at all points, and not in proportion to the stress
    #[arg(long)]
    absolute: bool,
}

/// A file of measurements, or a list of them.
#[derive(Clone, Debug)]
enum FileArgument {
    /// A file with its test.
    Curve { test: Measurement, name: String },
    /// A list in YAML.
    List(PathBuf),
}

/// A stated standard deviation.
#[derive(Clone, Copy, Debug)]
struct StatedSigma(Noise);

fn measured_file(text: &str) -> Result<FileArgument, String> {
    let Some((word, name)) = text.split_once('=') else {
        let is_list = |ending: &str| text.to_ascii_lowercase().ends_with(ending);
        return match is_list(".yaml") || is_list(".yml") {
            true => Ok(FileArgument::List(PathBuf::from(text))),
            false => Err(format!(
                "name the test, as in uniaxial={text}; allowed: {}; others in a list in YAML",
                tests()
            )),
        };
    };
    match Measurement::from_name(word).filter(|test| test.of_specimen().is_some()) {
        Some(test) => Ok(FileArgument::Curve {
            test,
            name: name.to_owned(),
        }),
        None => Err(format!(
            "{word} is no test of a specimen; allowed: {}; others in a list in YAML",
            tests()
        )),
    }
}

/// The words of tests of specimens.
fn tests() -> String {
    let of_specimens = Measurement::ALL.into_iter().filter(|one| one.of_specimen().is_some());
    of_specimens.map(Measurement::name).collect::<Vec<_>>().join(", ")
}

fn sigma(text: &str) -> Result<StatedSigma, String> {
    let noise = match text.trim().strip_suffix('%') {
        Some(percent) => {
            let percent = percent.trim().parse::<f64>();
            Noise::Share(0.01 * percent.map_err(|_| format!("{text:?} is no percentage"))?)
        }
        None => Noise::Stress(quantity(text, Dimension::Stress)?.value()),
    };
    let (Noise::Share(value) | Noise::Stress(value)) = noise else {
        return Err("allowed: a percentage or a stress".to_owned());
    };
    match value > 0.0 && value.is_finite() {
        true => Ok(StatedSigma(noise)),
        false => Err(format!("{text:?} is not positive")),
    }
}

impl FileArguments {
    /// Returns the entries of all files, those of lists with what is known about them.
    ///
    /// # Errors
    /// When a list cannot be read.
    pub fn entries(&self) -> Result<Vec<(MeasuredFile, Node)>, CliError> {
        let mut all = Vec::new();
        for file in &self.files {
            match file {
                FileArgument::Curve { test, name } => all.push(MeasuredFile::curve(name, *test)?),
                FileArgument::List(path) => all.extend(MeasuredFile::load(path)?),
            }
        }
        Ok(all)
    }

    /// Returns the names of all files that are read: lists, tables and patterns.
    pub fn names(&self, entries: &[(MeasuredFile, Node)]) -> Vec<String> {
        let lists = self.files.iter().filter_map(|file| match file {
            FileArgument::List(path) => Some(path.clone()),
            FileArgument::Curve { .. } => None,
        });
        let listed = entries.iter().flat_map(|(file, node)| file.paths(node));
        lists.chain(listed).map(|path| path.display().to_string()).collect()
    }
}

impl MeasuredArguments {
    /// Returns the noise of stresses without a stated one.
    pub fn noise(&self) -> Noise {
        match (self.sigma, self.absolute) {
            (Some(StatedSigma(noise)), _) => noise,
            (None, true) => Noise::Absolute,
            (None, false) => Noise::Relative,
        }
    }
}
