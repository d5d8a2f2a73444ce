//! Compare stages: measured beside simulated numbers.

use serde::Serialize;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::html::Page;
use crate::measured::{FileAgreement, charts, sheet};
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_base::listed;
use deaflow_content::Comparison;

/// Presents compare stages.
pub struct ComparePresenter;

/// What a compare stage found.
#[derive(Debug, Serialize)]
struct Found {
    /// The stage.
    stage: String,
    /// How well each file agrees.
    files: Vec<FileAgreement>,
    /// The root mean square of each file with one more effect.
    with_effects: Vec<WithEffect>,
}

#[derive(Debug, Serialize)]
struct WithEffect {
    effect: String,
    /// By file; `None` if there is no simulation with it.
    rms: Option<Vec<f64>>,
}

fn read(source: &ArtifactReader<'_>) -> Result<Found, ReportError> {
    let view = source.of(Comparison::open(source.artifact))?;
    let files = FileAgreement::read(source, &view.files())?;
    let effects = source.of(view.read())?.effects.unwrap_or_default();
    let of = |(at, effect): (usize, &String)| WithEffect {
        effect: effect.clone(),
        rms: (effects.simulated[at] == 1).then(|| effects.rms[at * files.len()..(at + 1) * files.len()].to_vec()),
    };
    Ok(Found {
        stage: source.stage.stage.clone(),
        with_effects: effects.name.iter().enumerate().map(of).collect(),
        files,
    })
}

impl Found {
    fn lines(&self) -> Vec<String> {
        let with = |one: &WithEffect| {
            let numbers = one.rms.as_ref().map(|rms| {
                let each = self.files.iter().zip(rms).map(|(file, rms)| file.with_unit(*rms));
                listed(&each.collect::<Vec<_>>())
            });
            format!(
                "RMS with {}: {}",
                one.effect,
                numbers.unwrap_or_else(|| "no equilibrium".to_owned())
            )
        };
        let effects = self.with_effects.iter().map(with);
        self.files.iter().map(FileAgreement::line).chain(effects).collect()
    }
}

impl Presenter for ComparePresenter {
    fn kind(&self) -> &'static str {
        "compare"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let text = found
            .iter()
            .map(|found| format!("{}: {}", found.stage, found.lines().join("\n  ")));
        Ok(vec![Results::new("comparisons", &found, text)])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let lines = |found: &Found| {
            let files = found.files.iter();
            let lines = files.map(|file| Headline::good(format!("{}: {}", found.stage, file.line())));
            lines.collect::<Vec<_>>()
        };
        Ok(found.iter().flat_map(lines).collect())
    }

    fn figures(&self) -> Figures {
        &[("measured", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let found = run.each(self.kind(), |source| {
            let view = source.of(Comparison::open(source.artifact))?;
            let scene = source.of(view.scene().read())?;
            Ok((read(source)?, charts(source, &view.files(), &view.rows(), &scene)?))
        })?;
        for (found, charts) in &found {
            page.open("Measured and simulated", "Dots are measured, lines simulated.");
            page.part(&found.stage);
            page.lines(&found.lines());
            page.charts(charts);
        }
        Ok(())
    }
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let view = source.of(Comparison::open(source.artifact))?;
    let scene = source.of(view.scene().read())?;
    sheet(source, &view.files(), &view.rows(), &scene)
}
