//! Draws the figures that the artifacts of a run give rise to.
//!
//! A figure's file carries the digest of its artifact in its name: one that is there need not be drawn again, and a rerun
//! that builds nothing opens no artifact for figures either.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::designs::Wanted;
use super::figures::{
    Case, Cost, Evaluated, EvaluatedPredictor, Evolution, FamilyCosts, FamilyDeformation, FigureError, Histogram,
    Membrane, Training, draw_accuracy, draw_agreement, draw_audit, draw_deformation, draw_evaluation, draw_evolution,
    draw_gallery, draw_histogram, draw_membrane, draw_training,
};
use crate::base::ArtifactId;
use crate::content::{
    self, Accuracy, Audit, Balanced, ContentError, DesignRowsView, Designs, Evaluation, Solutions, StoredAttribute,
    Verification,
};
use crate::field::Field;
use crate::scene::Scene;
use crate::store::{Artifact, Store, StoreError};

/// What one stage of a run made.
#[derive(Clone, Debug)]
pub struct Made {
    /// Name of the stage.
    pub stage: String,
    /// Its kind.
    pub kind: String,
    /// Its artifact.
    pub digest: ArtifactId,
}

/// A figure or summary that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The artifact cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The artifact does not hold what its kind promises.
    #[error("artifact {digest} of stage `{stage}`: {reason}", digest = digest.short())]
    Content {
        /// Name of the stage.
        stage: String,
        /// Its artifact.
        digest: ArtifactId,
        /// What is wrong.
        reason: String,
    },
    /// A file of a report cannot be written.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The drawing failed.
    #[error("stage `{stage}`: {source}")]
    Figure {
        /// Name of the stage.
        stage: String,
        /// Why.
        source: FigureError,
    },
    /// The folder of the figures cannot be made.
    #[error("cannot make the folder {path}: {source}", path = path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

type Drawing = fn(&Path, &Source<'_>) -> Result<(), ReportError>;

/// Draws every figure of the stages that is not there yet, and returns the paths of all, in the order of the stages:
/// `<store>/figures/<pipeline>/<stage>-<digest>-<figure>.png`.
///
/// # Errors
/// When an artifact cannot be read or a figure not be written.
pub fn draw_figures(store: &Store, pipeline: &str, made: &[Made]) -> Result<Vec<PathBuf>, ReportError> {
    let folder = store.root().join("figures").join(file_name(pipeline));
    let mut paths = Vec::new();
    for stage in made {
        let drawings = drawings(&stage.kind);
        let path = |figure: &str| {
            let digest = stage.digest.to_string();
            folder.join(format!("{}-{}-{figure}.png", file_name(&stage.stage), &digest[..8]))
        };
        let wanted: Vec<(PathBuf, Drawing)> = drawings.iter().map(|(name, draw)| (path(name), *draw)).collect();
        if wanted.iter().any(|(path, _)| !path.exists()) {
            fs::create_dir_all(&folder).map_err(|source| ReportError::Folder {
                path: folder.clone(),
                source,
            })?;
            let source = Source {
                stage,
                artifact: &store.artifact(&stage.digest)?,
                run: made,
            };
            for (path, draw) in wanted.iter().filter(|(path, _)| !path.exists()) {
                draw(path, &source)?;
            }
        }
        paths.extend(wanted.into_iter().map(|(path, _)| path).filter(|path| path.exists()));
    }
    Ok(paths)
}

fn drawings(kind: &str) -> &'static [(&'static str, Drawing)] {
    match kind {
        "solve" => &[("deformation", deformation)],
        "balance" => &[("histogram", histogram)],
        "train" => &[("training", training)],
        "design" => &[("evolution", evolution), ("best", best)],
        "verify" => &[("verification", verification)],
        "accuracy" => &[("accuracy", accuracy)],
        "audit" => &[("audit", audit)],
        "evaluate" => &[("evaluation", evaluation)],
        _ => &[],
    }
}

/// Names are free in a pipeline; in the name of a file they must not lead elsewhere.
pub(super) fn file_name(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || c == '-' || c == '_' {
            c
        } else {
            '-'
        }
    };
    let safe: String = name.chars().take(60).map(safe).collect();
    if safe.is_empty() { "unnamed".into() } else { safe }
}

/// An artifact with the stage that made it, for messages.
pub(super) struct Source<'a> {
    pub(super) stage: &'a Made,
    pub(super) artifact: &'a Artifact,
    /// All that the run made: whose names artifacts go by.
    pub(super) run: &'a [Made],
}

/// What `read` makes of every artifact of a kind in a run.
///
/// # Errors
/// When an artifact cannot be read, or `read` fails.
pub(super) fn each<T>(
    store: &Store,
    made: &[Made],
    kind: &str,
    read: impl Fn(&Source<'_>) -> Result<T, ReportError>,
) -> Result<Vec<T>, ReportError> {
    let of_kind = made.iter().filter(|stage| stage.kind == kind);
    of_kind
        .map(|stage| {
            let artifact = store.artifact(&stage.digest)?;
            read(&Source {
                stage,
                artifact: &artifact,
                run: made,
            })
        })
        .collect()
}

impl Source<'_> {
    pub(super) fn wrong(&self, reason: impl Into<String>) -> ReportError {
        ReportError::Content {
            stage: self.stage.stage.clone(),
            digest: self.stage.digest,
            reason: reason.into(),
        }
    }

    /// What was read of the artifact.
    pub(super) fn of<T>(&self, read: Result<T, ContentError>) -> Result<T, ReportError> {
        read.map_err(|error| match error {
            ContentError::Store(error) => ReportError::Store(error),
            ContentError::Fault { fault, .. } => self.wrong(fault.to_string()),
        })
    }

    pub(super) fn drawn<T>(&self, outcome: Result<T, FigureError>) -> Result<T, ReportError> {
        outcome.map_err(|source| ReportError::Figure {
            stage: self.stage.stage.clone(),
            source,
        })
    }
}

/// Where no sample has a field there is nothing to draw; the run says so.
fn deformation(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let families = families(source)?;
    if families.is_empty() {
        return Ok(());
    }
    source.drawn(draw_deformation(path, &families))
}

/// The largest displacements of the samples of a solve stage, by family.
pub(super) fn families(source: &Source<'_>) -> Result<Vec<FamilyDeformation>, ReportError> {
    let view = source.of(Solutions::open(source.artifact))?;
    let names = source.of(view.rows().family().read())?;
    let mut families: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (family, peak) in names.into_iter().zip(source.of(view.max_displacement().read())?) {
        families.entry(family).or_default().push(peak);
    }
    let family = |(family, peaks)| FamilyDeformation { family, peaks };
    Ok(families.into_iter().map(family).collect())
}

fn histogram(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    source.drawn(draw_histogram(path, &counts_by_bin(source)?))
}

/// The histograms of a balance stage.
pub(super) fn counts_by_bin(source: &Source<'_>) -> Result<Histogram, ReportError> {
    let view = source.of(Balanced::open(source.artifact))?;
    let histogram = view.histogram();
    let after = source.of(histogram.after().read())?;
    // Rows that are no images are samples as they were drawn.
    let mut levelled = vec![0; after.len()];
    let (bins, symmetries) = (source.of(view.bin().read())?, source.of(view.symmetry().read())?);
    let drawn = bins.into_iter().zip(symmetries).filter(|(_, symmetry)| *symmetry == 0);
    for (bin, _) in drawn {
        let count = usize::try_from(bin).ok().and_then(|bin| levelled.get_mut(bin));
        *count.ok_or_else(|| source.wrong(format!("it has no bin {bin}")))? += 1;
    }
    Ok(Histogram {
        edges: source.of(histogram.edges().read())?,
        before: source.of(histogram.before().read())?,
        augmented: source.of(histogram.augmented().read())?,
        levelled,
        after,
    })
}

fn training(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    source.drawn(draw_training(path, &curves(source)?))
}

/// The curves of a train stage.
pub(super) fn curves(source: &Source<'_>) -> Result<Training, ReportError> {
    let view = source.of(content::Training::open(source.artifact))?;
    let curves = source.of(view.curves().read())?;
    let [kept] = source.of(view.best_epoch().read())?;
    Ok(Training {
        train_loss: curves.train_loss,
        validation_loss: curves.validation_loss,
        validation_rmse: curves.validation_rmse,
        learning_rate: curves.learning_rate,
        kept,
    })
}

/// How a search went, where the stage has one alone; a page tells of all.
fn evolution(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let history = source.of(Designs::open(source.artifact))?.history();
    let mut names = source.of(history.name().read())?;
    names.dedup();
    if names.len() != 1 {
        return Ok(());
    }
    let data = Evolution {
        best: source.of(history.best().read())?,
        mean: source.of(history.mean().read())?,
        value: source.of(history.value().read())?,
        area: source.of(history.area().read())?,
    };
    source.drawn(draw_evolution(path, &data))
}

/// The patterns of some rows of a design or its verification, each with a field.
fn membranes<'f>(
    source: &Source<'_>,
    rows: &DesignRowsView<'_>,
    scene: &StoredAttribute<'_, Scene>,
    wanted: impl Iterator<Item = (usize, &'f Field)>,
) -> Result<Vec<Membrane>, ReportError> {
    let (patterns, objectives) = (source.of(rows.patterns().read())?, source.of(rows.objective().read())?);
    let side = source.of(scene.read())?.side_mm();
    let membrane = |(row, field): (usize, &Field)| {
        let objective = Wanted::read(&objectives.0[row]).map_err(|e| source.wrong(e.to_string()))?;
        let points = objective.aims.iter().map(|aim| aim.point).collect();
        source.drawn(Membrane::new(patterns[row].cells(), field.values(), side, points))
    };
    wanted.map(membrane).collect()
}

/// The last design of a stage that has one target: the refined one where there is one.
fn best(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let rows = view.rows();
    let (names, roles) = (source.of(rows.name().read())?, source.of(rows.role().read())?);
    let last = roles.iter().rposition(|role| role.is_found());
    let Some(last) = last.filter(|_| names.iter().all(|name| *name == names[0])) else {
        return Ok(());
    };
    let predicted = source.of(rows.predicted().read())?;
    for data in membranes(source, &rows, &view.scene(), std::iter::once((last, &predicted[last])))? {
        source.drawn(draw_membrane(path, "Best design, as predicted", &data))?;
    }
    Ok(())
}

/// Patterns without a stable solution have no field to draw, and without any there is no figure; the summary names them. Of many
/// targets each one's best design is drawn.
fn verification(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let summary = super::summary::read(source)?;
    let mut rows: Vec<(usize, usize)> = Vec::new();
    for (row, case) in summary.rows.iter().enumerate() {
        if case.simulated_mm.is_some() {
            rows.push((row, rows.len()));
        }
    }
    if rows.len() > MOST_COMPARED {
        rows = best_of_targets(&summary, &rows);
    }
    let view = source.of(Verification::open(source.artifact))?;
    let fields = source.of(view.displacement().read())?;
    let wanted = rows.iter().map(|&(row, at)| (row, &fields[at]));
    let drawn = membranes(source, &view.rows(), &view.scene(), wanted)?;
    let case = |(&(row, _), membrane): (&(usize, usize), Membrane)| {
        let summary = &summary.rows[row];
        Case {
            name: summary.title(),
            membrane,
            predicted: summary.predicted_mm.unwrap_or(0.0),
            simulated: summary.simulated_mm.unwrap_or(0.0),
        }
    };
    let cases: Vec<Case> = rows.iter().zip(drawn).map(case).collect();
    match cases.len() {
        0 => Ok(()),
        1..=MOST_COMPARED => source.drawn(draw_agreement(path, &cases)),
        _ => source.drawn(draw_gallery(path, &cases)),
    }
}

/// Patterns that are drawn beside each other with their numbers as bars.
const MOST_COMPARED: usize = 6;

/// The refined design of each target and member where there is one, else the genetic algorithm's, else the optimum.
fn best_of_targets(summary: &super::Summary, rows: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut best: Vec<(usize, usize)> = Vec::new();
    for &(row, field) in rows {
        let case = &summary.rows[row];
        if !case.role.is_found() {
            continue;
        }
        let identity = |case: &super::RowSummary| (case.case.clone(), case.name.clone(), case.member);
        let place = best
            .iter()
            .position(|&(other, _)| identity(&summary.rows[other]) == identity(case));
        match place {
            None => best.push((row, field)),
            Some(place) => {
                if case.role < summary.rows[best[place].0].role {
                    best[place] = (row, field);
                }
            }
        }
    }
    best
}

fn accuracy(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let costs = costs(source)?;
    match moves(&costs) {
        true => source.drawn(draw_accuracy(path, &costs)),
        false => Ok(()),
    }
}

/// Whether there is an error to draw: patterns that do not move have none.
pub(super) fn moves(costs: &[FamilyCosts]) -> bool {
    costs.iter().flat_map(|family| &family.costs).any(|cost| cost.error > 0.0)
}

/// Error and time of the methods of an accuracy stage, by family. Times are no content: they stand in the provenance.
pub(super) fn costs(source: &Source<'_>) -> Result<Vec<FamilyCosts>, ReportError> {
    let view = source.of(Accuracy::open(source.artifact))?;
    let (methods, families) = (source.of(view.methods().read())?, source.of(view.families().read())?);
    let errors = source.of(view.error().rms().read())?;
    let times: BTreeMap<String, f64> = source.artifact.measurements()?.into_iter().collect();
    let cost = |(m, settings): (usize, &String), f: usize| {
        Some(Cost {
            settings: settings.clone(),
            seconds: *times.get(&format!("{settings}; {}", families[f]))?,
            error: errors[m * families.len() + f],
        })
    };
    let of_family = |(f, family): (usize, &String)| FamilyCosts {
        family: family.clone(),
        costs: methods
            .iter()
            .enumerate()
            .filter_map(|method| cost(method, f))
            .collect(),
    };
    Ok(families.iter().enumerate().map(of_family).collect())
}

/// An audit that ended before it looked at rows has nothing to draw.
fn audit(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    match super::audited(&source.of(Audit::read(source.artifact))?) {
        Some(figure) => source.drawn(draw_audit(path, &figure)),
        None => Ok(()),
    }
}

fn evaluation(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    source.drawn(draw_evaluation(path, &evaluated(source)?))
}

/// The errors of an evaluate stage by family, and the peaks of its patterns.
pub(super) fn evaluated(source: &Source<'_>) -> Result<Evaluated, ReportError> {
    let found = super::evaluation::read(source)?;
    let patterns = source.of(Evaluation::open(source.artifact))?.pattern();
    let simulated = source.of(patterns.simulated_max().read())?;
    let predicted = source.of(patterns.predicted_max().read())?;
    let known = source.of(patterns.predicted().read())?;
    let n = simulated.len();
    let predictor = |(k, predictor): (usize, &super::Predicted)| {
        let rmse = predictor.rmse_mm.iter().zip(&predictor.samples);
        let rows = (0..n).filter(|row| known[k * n + row] == 1);
        EvaluatedPredictor {
            name: predictor.name.clone(),
            rmse: rmse.map(|(rmse, samples)| (*samples > 0).then_some(*rmse)).collect(),
            peaks: rows.map(|row| (simulated[row], predicted[k * n + row])).collect(),
            peak_r2: predictor.max_displacement_r2.last().copied().unwrap_or_default(),
        }
    };
    Ok(Evaluated {
        predictors: found.predictors.iter().enumerate().map(predictor).collect(),
        families: found.families,
    })
}
