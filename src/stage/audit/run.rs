//! Runs an audit on a dataset.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::content::content;
use super::contradictions::{other_effects, other_scene};
use super::label_limits::{Trust, USUAL_ACCURACY, label_limits};
use super::source::Source;
use crate::direct::DirectError;
use crate::scene::device_of;
use deaflow_base::{InputError, Progress, Quantity, open_regular};
use deaflow_content::{Audit, FROM_FILE};
use deaflow_dataset::audit::{AuditError, Dataset, Families, Options, Report, audit, sort, work};
use deaflow_field::SimulatorError;
use deaflow_pattern::{Pattern, Raster};
use deaflow_sample as sample;
use deaflow_scene::{Outline, Scene};
use deaflow_store::StoreError;

/// Steps of the progress bar: the number of rows is not known in advance.
pub const STEPS: u64 = 100;

/// Rounding error of displacements if the dataset declares no error, as a fraction of the side: 1e-4 mm of 50 mm.
const ROUNDING: f64 = 2e-6;

/// The options of an audit.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Random rows to simulate on a finer mesh; `None` for all.
    pub samples: Option<u64>,
    /// Seed of the random choice.
    pub seed: u64,
    /// The allowed error of labels.
    pub accuracy: Option<Quantity>,
}

/// Audits a file in the layout of `deaflow solve` by simulations in a scene. Returns the content that the artifact of
/// an audit stage would have.
///
/// # Errors
/// If the file cannot be read, or a simulator cannot be set up.
pub fn audit_file(file: &Path, scene: Scene, request: &Request, progress: &dyn Progress) -> Result<Audit, DirectError> {
    let unreadable = |e: StoreError| {
        let help = "the arrays must be in the file itself; or give the stage: deaflow audit PIPELINE.yaml:STAGE";
        InputError::new(e.to_string()).help(help)
    };
    // Opening a pipe would block, and a device may have no end.
    open_regular(file).map_err(|e| InputError::new(format!("cannot read {}: {e}", file.display())))?;
    let mut source = Source::of_file(file, scene.membrane().raster).map_err(unreadable)?;
    let failed = |e: &dyn std::fmt::Display| DirectError::Failed(e.to_string());
    let contradictions = [other_scene(&source, &scene), other_effects(&source, &scene)];
    for finding in contradictions {
        source.findings.extend(finding.map_err(|e| failed(&e))?);
    }
    let report = run(&source, &scene, request, Trust::Nothing, progress).map_err(|e| failed(&e))?;
    content(report, None, scene).map_err(|e| failed(&e))
}

/// The families of the sample stage. A pattern from a file may be any; on a device other than that of the source paper
/// the patterns of a family are not known.
struct KnownFamilies {
    is_paper: bool,
}

impl Families for KnownFamilies {
    fn admits(&self, family: &str, pattern: &Pattern) -> Option<bool> {
        match family {
            FROM_FILE => Some(true),
            drawn => sample::admits(drawn, pattern).map(|fits| fits || !self.is_paper),
        }
    }
}

/// Whether a device is that of the source paper: a square of 50 × 50 cells with equal prestretch, clamped at its edges,
/// with one group of electrodes.
fn is_of_paper(outline: &Outline) -> bool {
    let Outline {
        membrane,
        prestretch: [along, across],
        has_frame,
        has_bodies,
        groups,
    } = outline;
    let [width, height] = membrane.size_mm;
    let is_plain = !has_frame && !has_bodies && *groups == 1;
    is_plain && membrane.raster == Raster::PAPER && width == height && along == across
}

/// Audits a dataset in its scene.
///
/// # Errors
/// If its rows cannot be read or simulated.
pub fn run(
    source: &Source,
    scene: &Scene,
    request: &Request,
    trust: Trust,
    progress: &dyn Progress,
) -> Result<Report, AuditError> {
    if !source.is_readable() {
        return Ok(Report {
            findings: source.findings.clone(),
            ..Report::default()
        });
    }
    let allowed_mm = request.accuracy.map(|accuracy| accuracy.value());
    let (limits, loose) = label_limits(source, scene, allowed_mm, trust);
    let simulators = source
        .simulators(scene, limits.method, limits.residual)
        .map_err(SimulatorError::new)?;
    let device = device_of(scene);
    let dataset = Dataset {
        device: &device,
        len: source.len(),
        rows: source,
        columns: source.columns.clone(),
        declared: source.declared,
        source_samples: source.source_samples.as_deref(),
        bins: source.bins,
        families: &KnownFamilies {
            is_paper: is_of_paper(&scene.outline()),
        },
    };
    let options = Options {
        samples: request
            .samples
            .map(|samples| usize::try_from(samples).unwrap_or(usize::MAX)),
        seed: request.seed,
        accuracy: limits.accuracy,
        default_accuracy: USUAL_ACCURACY * scene.side_mm(),
        tolerance: limits.tolerance,
        max_declared_error: limits.most_declared,
        rounding: ROUNDING * scene.side_mm(),
        balance: source.balance.clone(),
        // Random samples of a pipeline may repeat; balancing removes repeats. Of other datasets nothing is known.
        repeats_are_usual: trust == Trust::Pipeline && source.balance.is_none() && source.solver.is_some(),
    };
    let reached = Mutex::new((0_usize, 0_u64));
    let advance = |amount: usize| {
        let mut reached = reached.lock().unwrap_or_else(PoisonError::into_inner);
        reached.0 += amount;
        let now = STEPS * reached.0 as u64 / work(dataset.len, &options).max(1) as u64;
        progress.advance(now - reached.1);
        reached.1 = now;
    };
    let mut report = audit(&dataset, &simulators, &options, &advance)?;
    let reached = reached.into_inner().unwrap_or_else(PoisonError::into_inner);
    progress.advance(STEPS - reached.1);
    report.findings.extend(loose);
    report.findings.extend(source.findings.iter().cloned());
    sort(&mut report.findings);
    Ok(report)
}
