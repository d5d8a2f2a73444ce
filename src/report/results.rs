//! Results of a run of a pipeline: as JSON, as text, and as figures.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::artifacts::{ArtifactReader, RunArtifacts, StageArtifact};
use super::drawing::{FigureError, with_texts};
use super::error::ReportError;
use super::format::{figure_name, file_name};
use super::headline::headlines;
use super::kinds::PRESENTERS;
use super::observed::observed_warnings;
use super::presenter::{DrawFigure, Headline, Presenter, Results};
use deaflow_base::{Digest, is_dangling_link, read_own, software, write_output};
use deaflow_store::Store;

/// If there are more figures of sweeps, only their number is printed.
const MAX_SWEEP_FIGURES: usize = 8;

/// The results of a run.
#[derive(Debug, Serialize, Deserialize)]
pub struct RunResults {
    of_kinds: Vec<Results>,
    headlines: Vec<Headline>,
    /// The number of further lines of the same kinds as the headlines.
    more: usize,
    model_warnings: Vec<String>,
    figures: Vec<String>,
    /// The figures of stages of sweeps.
    of_sweeps: BTreeSet<String>,
    /// Why figures are missing.
    #[serde(skip)]
    figure_warning: Option<String>,
}

impl RunResults {
    /// Reads the artifacts of a run and draws the missing figures. `model_warnings` are the neglected effects that are
    /// significant; `observing` are the stages whose scene may have effects with warnings about what is observed.
    ///
    /// A figure that cannot be written (disk full) is a warning.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    pub fn of(
        run: &RunArtifacts<'_>,
        pipeline: &str,
        model_warnings: Vec<String>,
        observing: &[String],
    ) -> Result<Self, ReportError> {
        let mut of_kinds = Vec::new();
        for presenter in PRESENTERS {
            of_kinds.extend(presenter.results(run)?);
        }
        let (figures, figure_warning) = match draw_figures(PRESENTERS, run, pipeline) {
            Err(error) if error.is_of_writing() => (Vec::new(), Some(format!("figures are missing: {error}"))),
            figures => (figures?, None),
        };
        let swept = run.stages.iter().filter(|made| made.stage.contains('@'));
        let swept: BTreeSet<String> = swept
            .map(|made| figure_name(&made.stage, &made.digest.to_string(), "").replace("-.png", ""))
            .collect();
        let is_swept = |path: &&PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            name.rsplit_once('-').is_some_and(|(stage, _)| swept.contains(stage))
        };
        let of_sweeps = figures.iter().filter(is_swept).map(|path| path.display().to_string());
        let (headlines, more) = headlines(run)?;
        Ok(Self {
            of_sweeps: of_sweeps.collect(),
            of_kinds,
            headlines,
            more,
            model_warnings: model_warnings
                .into_iter()
                .chain(observed_warnings(run, observing)?)
                .collect(),
            figures: figures.iter().map(|path| path.display().to_string()).collect(),
            figure_warning,
        })
    }

    /// Returns the results for programs.
    #[must_use]
    pub fn document(&self) -> Map<String, Value> {
        let of_kinds = self.of_kinds.iter();
        let mut document: Map<String, Value> = of_kinds
            .map(|results| (results.key.to_owned(), results.value.clone()))
            .collect();
        document.insert("warnings".to_owned(), json!(self.warnings().collect::<Vec<_>>()));
        document.insert("figures".to_owned(), json!(self.figures));
        document
    }

    /// Returns the main results, and the number of further lines of the same kinds.
    #[must_use]
    pub fn headlines(&self) -> (&[Headline], usize) {
        (&self.headlines, self.more)
    }

    /// Returns the folder of the figures of a run.
    pub(super) fn folder(run: &RunArtifacts<'_>, pipeline: &str) -> PathBuf {
        folder_of(run.store, run.file, pipeline)
    }

    /// Whether all figures could be written.
    pub(super) fn has_all_figures(&self) -> bool {
        self.figure_warning.is_none()
    }

    /// Returns the files of the figures.
    pub(super) fn figure_paths(&self) -> impl Iterator<Item = &Path> {
        self.figures.iter().map(Path::new)
    }

    /// Adds the file of a figure.
    #[cfg(test)]
    pub(super) fn add_figure(&mut self, path: &Path) {
        self.figures.push(path.display().to_string());
    }

    /// Returns the number of figures, and the folder of the first one.
    #[must_use]
    pub fn figures(&self) -> Option<(usize, &Path)> {
        let folder = self.figures.first().and_then(|path| Path::new(path).parent())?;
        Some((self.figures.len(), folder))
    }

    /// Returns the results for people, in paragraphs.
    #[must_use]
    pub fn text(&self) -> Vec<String> {
        let mut parts: Vec<String> = self
            .of_kinds
            .iter()
            .flat_map(|results| &results.text)
            .cloned()
            .collect();
        let warnings = self.model_warnings.iter().cloned().chain(self.warnings_note());
        for (title, lines) in [
            ("model warnings", &warnings.collect()),
            ("figures", &self.figure_lines()),
        ] {
            if !lines.is_empty() {
                parts.push(format!("{title}:\n  {}", lines.join("\n  ")));
            }
        }
        parts
    }

    /// Returns the paths of the figures, or their number for a large sweep.
    fn figure_lines(&self) -> Vec<String> {
        if self.of_sweeps.len() <= MAX_SWEEP_FIGURES {
            return self.figures.clone();
        }
        let others = self.figures.iter().filter(|path| !self.of_sweeps.contains(*path));
        let folder = self.of_sweeps.first().and_then(|path| Path::new(path).parent());
        let folder = folder.map_or_else(String::new, |folder| folder.display().to_string());
        let many = format!("and {} figures of sweeps in {folder}", self.of_sweeps.len());
        others.cloned().chain([many]).collect()
    }

    /// Explains the model warnings, if there are any: `deaflow screen` is more accurate, so its numbers differ.
    fn warnings_note(&self) -> Option<String> {
        let note = "checked on simulated patterns and a coarse mesh; `deaflow screen` is more accurate";
        (!self.model_warnings.is_empty()).then(|| note.to_owned())
    }

    /// Returns the warnings, a line for each.
    pub fn warning_lines(&self) -> impl Iterator<Item = String> {
        self.warnings().map(|text| format!("warning: {text}"))
    }

    /// Returns the warnings: first those about the model, then those of the stages and that of the figures.
    pub fn warnings(&self) -> impl Iterator<Item = &String> {
        let found = self.of_kinds.iter().flat_map(|results| &results.warnings);
        self.model_warnings.iter().chain(found).chain(&self.figure_warning)
    }
}

/// Draws the missing figures of a run, and returns the paths of all, in the order of the stages:
/// `<store>/figures/<pipeline>/<stage>-<digest>-<figure>.png`. If two files have the same pipeline name, the second one
/// gets the folder `<pipeline>-<digits>`.
///
/// The file name has the digest of the artifact, so an existing figure is never drawn again, and a run that builds
/// nothing opens no artifact for figures.
///
/// # Errors
/// If an artifact cannot be read or a figure cannot be written.
pub fn draw_figures(
    presenters: &[&dyn Presenter],
    run: &RunArtifacts<'_>,
    pipeline: &str,
) -> Result<Vec<PathBuf>, ReportError> {
    let folder = folder_of(run.store, run.file, pipeline);
    let mut paths = Vec::new();
    for stage in run.stages {
        paths.extend(draw_of_stage(presenters, run, stage, (pipeline, &folder))?);
    }
    for presenter in presenters {
        let before = if run.rounds.is_empty() {
            BTreeSet::new()
        } else {
            files(&folder)
        };
        let common = presenter.common_figures(run, &folder)?;
        for path in common.iter().filter(|path| !before.contains(*path)) {
            let made = run.stages.iter().map(|made| made.digest.to_string());
            stamp(path, pipeline, "all stages", &made.collect::<Vec<_>>().join(" "))?;
        }
        paths.extend(common);
    }
    Ok(paths)
}

/// Draws the missing figures of a stage into the folder of its pipeline, and returns the paths of all.
pub(super) fn draw_of_stage(
    presenters: &[&dyn Presenter],
    run: &RunArtifacts<'_>,
    stage: &StageArtifact,
    (pipeline, folder): (&str, &Path),
) -> Result<Vec<PathBuf>, ReportError> {
    let presenter = presenters.iter().find(|presenter| presenter.kind() == stage.kind);
    let path = |figure: &str| folder.join(figure_name(&stage.stage, &stage.digest.to_string(), figure));
    let figures = presenter.map_or(&[][..], |presenter| presenter.figures());
    let requested: Vec<(PathBuf, DrawFigure)> = figures.iter().map(|(name, draw)| (path(name), *draw)).collect();
    if requested.iter().any(|(path, _)| is_missing(path)) {
        fs::create_dir_all(folder).map_err(|source| ReportError::Folder {
            path: folder.to_owned(),
            source,
        })?;
        write_owner(folder, run.file)?;
        draw(run, stage, &requested, pipeline)?;
    }
    let paths = requested.into_iter().map(|(path, _)| path);
    Ok(paths.filter(|path| path.exists()).collect())
}

/// The file in a folder of figures that has the path of their pipeline.
pub const OWNER_FILE: &str = "pipeline.txt";

/// Returns the folder with the name of a pipeline, unless it belongs to another file that still exists.
pub(super) fn folder_of(store: &Store, file: &Path, pipeline: &str) -> PathBuf {
    let named = store.root().join("figures").join(file_name(pipeline));
    let Ok(owner) = read_own(&named.join(OWNER_FILE), MAX_PATH) else {
        return named;
    };
    let own = file.as_os_str().as_encoded_bytes();
    match String::from_utf8(owner) {
        Ok(owner) if owner.trim_end().as_bytes() != own && Path::new(owner.trim_end()).exists() => {
            let digits = Digest::of(own).short();
            named.with_file_name(format!("{}-{}", file_name(pipeline), &digits[..6]))
        }
        _ => named,
    }
}

/// Bytes of a path.
const MAX_PATH: u64 = 1 << 16;

fn write_owner(folder: &Path, file: &Path) -> Result<(), ReportError> {
    let path = folder.join(OWNER_FILE);
    let text = format!("{}\n", file.display());
    if read_own(&path, MAX_PATH).is_ok_and(|there| there == text.as_bytes()) {
        return Ok(());
    }
    Ok(write_output(&path, text.as_bytes())?)
}

/// Returns the figures of a stage that exist, sorted by name. Links are ignored.
#[must_use]
pub fn figure_files(store: &Store, file: &Path, pipeline: &str, stage: &str, digest: &str) -> Vec<PathBuf> {
    let folder = folder_of(store, file, pipeline);
    let begin = figure_name(stage, digest, "");
    let begin = begin.trim_end_matches(".png");
    let is_figure = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let is_file = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file());
        name.starts_with(begin) && name.ends_with(".png") && is_file
    };
    files(&folder).into_iter().filter(is_figure).collect()
}

/// Returns the entries of the folder of figures; none if it cannot be read.
fn files(folder: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.filter_map(|entry| Some(entry.ok()?.path())).collect()
}

/// Writes the origin of a figure into its file, so that a copy of it leads back to its artifact.
fn stamp(path: &Path, pipeline: &str, stage: &str, digests: &str) -> Result<(), ReportError> {
    let failed = |source: FigureError| ReportError::Figure {
        stage: stage.to_owned(),
        source,
    };
    let image = fs::read(path).map_err(|error| failed(FigureError::Draw(error.to_string())))?;
    let texts = [
        ("Title", format!("{pipeline}: {stage}")),
        ("Source", digests.to_owned()),
        ("Software", software()),
    ];
    let stamped = with_texts(&image, &texts).map_err(failed)?;
    write_output(path, &stamped).map_err(|error| {
        // A figure without its origin would never be drawn again, and `gc` would not remove it.
        let _ = fs::remove_file(path);
        failed(error.into())
    })
}

fn draw(
    run: &RunArtifacts<'_>,
    stage: &StageArtifact,
    requested: &[(PathBuf, DrawFigure)],
    pipeline: &str,
) -> Result<(), ReportError> {
    let source = ArtifactReader {
        stage,
        artifact: &run.store.artifact(&stage.digest)?,
        run: run.stages,
    };
    for (path, draw) in requested.iter().filter(|(path, _)| is_missing(path)) {
        // Some artifacts have nothing to draw.
        if let Some(sheet) = draw(&source)? {
            source.drawn(sheet.write_png(path))?;
            stamp(path, pipeline, &stage.stage, &stage.digest.to_string())?;
        }
    }
    Ok(())
}

/// Whether a figure has to be drawn. A dangling link is not: somebody else created it.
pub(super) fn is_missing(figure: &Path) -> bool {
    !figure.exists() && !is_dangling_link(figure)
}
