//! What a run of a pipeline found: as JSON, in words, and as figures.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::artifacts::{Made, RunArtifacts, Source};
use super::drawing::{FigureError, with_texts};
use super::error::ReportError;
use super::format::{figure_name, file_name};
use super::headline::{Headline, headlines};
use super::kinds::PRESENTERS;
use super::presenter::{DrawFigure, Presenter, Results};
use super::warnings::warnings;
use deaflow_base::{Digest, leads_nowhere_at, read_own, software, write_output};
use deaflow_store::Store;

/// Figures of sweeps that are told one by one.
const MOST_OF_SWEEPS: usize = 8;

/// What a run found.
#[derive(Debug, Serialize, Deserialize)]
pub struct RunResults {
    of_kinds: Vec<Results>,
    headlines: Vec<Headline>,
    /// How many more there are of the kinds that these are of.
    more: usize,
    model_warnings: Vec<String>,
    figures: Vec<String>,
    /// Those of stages of sweeps among them.
    of_sweeps: BTreeSet<String>,
}

impl RunResults {
    /// Reads the artifacts of a run and draws the figures that are not there yet. Effects that were neglected although they
    /// matter are told with the warnings; `may_break_down` are the stages whose scene may have dielectric breakdown.
    ///
    /// # Errors
    /// When an artifact cannot be read or does not hold what its kind promises, or a figure cannot be written.
    pub fn of(
        run: &RunArtifacts<'_>,
        pipeline: &str,
        neglected: Vec<String>,
        may_break_down: &[String],
    ) -> Result<Self, ReportError> {
        let mut of_kinds = Vec::new();
        for presenter in PRESENTERS {
            of_kinds.extend(presenter.results(run)?);
        }
        let figures = draw_figures(PRESENTERS, run, pipeline)?;
        let swept = run.made.iter().filter(|made| made.stage.contains('@'));
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
            model_warnings: neglected.into_iter().chain(warnings(run, may_break_down)?).collect(),
            figures: figures.iter().map(|path| path.display().to_string()).collect(),
        })
    }

    /// For programs.
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

    /// The lines that matter most, and how many more there are of the kinds that these are of.
    #[must_use]
    pub fn headlines(&self) -> (&[Headline], usize) {
        (&self.headlines, self.more)
    }

    /// The folder of the figures of a run.
    pub(super) fn folder(run: &RunArtifacts<'_>, pipeline: &str) -> PathBuf {
        folder_of(run.store, run.file, pipeline)
    }

    /// The files of the figures.
    pub(super) fn figure_paths(&self) -> impl Iterator<Item = &Path> {
        self.figures.iter().map(Path::new)
    }

    /// Adds the file of a figure.
    #[cfg(test)]
    pub(super) fn add_figure(&mut self, path: &Path) {
        self.figures.push(path.display().to_string());
    }

    /// How many figures there are, and the folder of the first.
    #[must_use]
    pub fn figures(&self) -> Option<(usize, &Path)> {
        let folder = self.figures.first().and_then(|path| Path::new(path).parent())?;
        Some((self.figures.len(), folder))
    }

    /// For people: paragraphs.
    #[must_use]
    pub fn text(&self) -> Vec<String> {
        let mut parts: Vec<String> = self
            .of_kinds
            .iter()
            .flat_map(|results| &results.text)
            .cloned()
            .collect();
        let warnings = self.model_warnings.iter().cloned().chain(self.about_warnings());
        for (title, lines) in [
            ("model warnings", &warnings.collect()),
            ("figures", &self.told_figures()),
        ] {
            if !lines.is_empty() {
                parts.push(format!("{title}:\n  {}", lines.join("\n  ")));
            }
        }
        parts
    }

    /// The paths of figures; of many of a sweep, how many there are.
    fn told_figures(&self) -> Vec<String> {
        if self.of_sweeps.len() <= MOST_OF_SWEEPS {
            return self.figures.clone();
        }
        let others = self.figures.iter().filter(|path| !self.of_sweeps.contains(*path));
        let folder = self.of_sweeps.first().and_then(|path| Path::new(path).parent());
        let folder = folder.map_or_else(String::new, |folder| folder.display().to_string());
        let many = format!("and {} of the stages of sweeps in {folder}", self.of_sweeps.len());
        others.cloned().chain([many]).collect()
    }

    /// What the warnings of the model are judged by, where there are any: `deaflow screen` looks at more, so its numbers are others.
    fn about_warnings(&self) -> Option<String> {
        let about = "judged by half the membrane and one cell, stability on a coarse mesh; `deaflow screen` looks at more patterns and at two meshes";
        (!self.model_warnings.is_empty()).then(|| about.to_owned())
    }

    /// The warnings alone, a line for each.
    pub fn warning_lines(&self) -> impl Iterator<Item = String> {
        self.warnings().map(|text| format!("warning: {text}"))
    }

    /// What is to be heeded: first about the model, then about what was found.
    pub fn warnings(&self) -> impl Iterator<Item = &String> {
        let found = self.of_kinds.iter().flat_map(|results| &results.warnings);
        self.model_warnings.iter().chain(found)
    }
}

/// Draws every figure of a run that its presenters have and that is not there yet, and returns the paths of all, in the order of the stages:
/// `<store>/figures/<pipeline>/<stage>-<digest>-<figure>.png`. Of two files with one name the second has a folder `<pipeline>-<digits>`.
///
/// A figure's file carries the digest of its artifact in its name: one that is there need not be drawn again, and a rerun that
/// builds nothing opens no artifact for figures either.
///
/// # Errors
/// When an artifact cannot be read or a figure not be written.
pub fn draw_figures(
    presenters: &[&dyn Presenter],
    run: &RunArtifacts<'_>,
    pipeline: &str,
) -> Result<Vec<PathBuf>, ReportError> {
    let folder = folder_of(run.store, run.file, pipeline);
    let mut paths = Vec::new();
    for stage in run.made {
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
            let made = run.made.iter().map(|made| made.digest.to_string());
            say_where_from(path, pipeline, "all stages", &made.collect::<Vec<_>>().join(" "))?;
        }
        paths.extend(common);
    }
    Ok(paths)
}

/// Draws the figures of a stage that are not there yet into the folder of its pipeline, and returns the paths of all.
pub(super) fn draw_of_stage(
    presenters: &[&dyn Presenter],
    run: &RunArtifacts<'_>,
    stage: &Made,
    (pipeline, folder): (&str, &Path),
) -> Result<Vec<PathBuf>, ReportError> {
    let presenter = presenters.iter().find(|presenter| presenter.kind() == stage.kind);
    let path = |figure: &str| folder.join(figure_name(&stage.stage, &stage.digest.to_string(), figure));
    let figures = presenter.map_or(&[][..], |presenter| presenter.figures());
    let wanted: Vec<(PathBuf, DrawFigure)> = figures.iter().map(|(name, draw)| (path(name), *draw)).collect();
    if wanted.iter().any(|(path, _)| is_missing(path)) {
        fs::create_dir_all(folder).map_err(|source| ReportError::Folder {
            path: folder.to_owned(),
            source,
        })?;
        say_whose(folder, run.file)?;
        draw(run, stage, &wanted, pipeline)?;
    }
    let paths = wanted.into_iter().map(|(path, _)| path);
    Ok(paths.filter(|path| path.exists()).collect())
}

/// The file in a folder of figures that says whose they are.
pub const WHOSE: &str = "pipeline.txt";

/// The folder of a pipeline's name, unless another file that is still there has it.
pub(super) fn folder_of(store: &Store, file: &Path, pipeline: &str) -> PathBuf {
    let named = store.root().join("figures").join(file_name(pipeline));
    let Ok(owner) = read_own(&named.join(WHOSE), LONGEST_PATH) else {
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
const LONGEST_PATH: u64 = 1 << 16;

fn say_whose(folder: &Path, file: &Path) -> Result<(), ReportError> {
    let path = folder.join(WHOSE);
    let text = format!("{}\n", file.display());
    if read_own(&path, LONGEST_PATH).is_ok_and(|there| there == text.as_bytes()) {
        return Ok(());
    }
    Ok(write_output(&path, text.as_bytes())?)
}

/// The figures of one stage that are drawn already, in the order of their names. Links are passed over: they are not ours.
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

/// What stands in the folder of figures; nothing where it cannot be read, and figures are then written as new ones.
fn files(folder: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.filter_map(|entry| Some(entry.ok()?.path())).collect()
}

/// Writes into a figure where it comes from: a figure in somebody's slides leads back to its artifact.
fn say_where_from(path: &Path, pipeline: &str, stage: &str, digests: &str) -> Result<(), ReportError> {
    let said = |source: FigureError| ReportError::Figure {
        stage: stage.to_owned(),
        source,
    };
    let image = fs::read(path).map_err(|error| said(FigureError::Draw(error.to_string())))?;
    let texts = [
        ("Title", format!("{pipeline}: {stage}")),
        ("Source", digests.to_owned()),
        ("Software", software()),
    ];
    let stamped = with_texts(&image, &texts).map_err(said)?;
    write_output(path, &stamped).map_err(|error| said(error.into()))
}

fn draw(
    run: &RunArtifacts<'_>,
    stage: &Made,
    wanted: &[(PathBuf, DrawFigure)],
    pipeline: &str,
) -> Result<(), ReportError> {
    let source = Source {
        stage,
        artifact: &run.store.artifact(&stage.digest)?,
        run: run.made,
    };
    let missing = wanted.iter().filter(|(path, _)| is_missing(path));
    for (path, draw) in missing {
        draw(path, &source)?;
        // Of some artifacts there is nothing to draw.
        if path.is_file() {
            say_where_from(path, pipeline, &stage.stage, &stage.digest.to_string())?;
        }
    }
    Ok(())
}

/// Whether a figure has to be drawn. A link that leads nowhere is passed over: it is not ours.
pub(super) fn is_missing(figure: &Path) -> bool {
    !figure.exists() && !leads_nowhere_at(figure)
}
