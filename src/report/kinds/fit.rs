//! Fit stages: parameters of a scene that agree best with measurements.

use serde::Serialize;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::html::Page;
use crate::measured::{FileAgreement, charts, sheet};
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_base::{Dimension, four_significant, listed};
use deaflow_content::{FitCandidates, FittedScene};

/// Presents fit stages.
pub struct FitPresenter;

/// What a fit stage found.
#[derive(Debug, Serialize)]
struct Found {
    /// The stage.
    stage: String,
    /// The fitted parameters.
    parameters: Vec<FittedParameter>,
    /// The law or the number of branches, if several were compared.
    chosen: Option<String>,
    /// The laws or numbers of branches that were compared, with AICc above the best; `None` if it is not known.
    candidates: Vec<(String, Option<f64>)>,
    /// What the measurements determine.
    verdict: String,
    /// χ² per degree of freedom, if all standard deviations are stated.
    chi2_per_dof: Option<f64>,
    /// How well each file agrees.
    files: Vec<FileAgreement>,
}

/// χ² per degree of freedom above which a warning says that the fit does not agree with the measurements.
const LARGE_CHI2: f64 = 2.0;

/// A fitted parameter.
#[derive(Debug, Serialize)]
struct FittedParameter {
    name: String,
    value: f64,
    unit: String,
    /// Ends of the interval of 95 %; `None` where it is open or not known.
    interval: [Option<f64>; 2],
    at_bound: bool,
}

/// The parameter that is no part of a scene.
const OFFSET: &str = "voltage_offset";

impl FittedParameter {
    fn dimension(&self) -> Dimension {
        Dimension::of_base_unit(&self.unit).unwrap_or(Dimension::Number)
    }

    fn number(&self) -> String {
        self.dimension().with_unit(self.value)
    }

    fn line(&self) -> String {
        let with_unit = |value: f64| self.dimension().with_unit(value);
        let interval = match self.interval {
            [Some(low), Some(high)] => format!(
                " ({} to {})",
                four_significant(self.dimension().display_unit().0 * low),
                with_unit(high)
            ),
            [Some(low), None] => format!(" (above {})", with_unit(low)),
            [None, Some(high)] => format!(" (below {})", with_unit(high)),
            [None, None] if self.at_bound => " (at its bound)".to_owned(),
            [None, None] => " (not determined)".to_owned(),
        };
        format!("{} {}{interval}", self.name, self.number())
    }
}

fn read(source: &ArtifactReader<'_>) -> Result<Found, ReportError> {
    let view = source.of(FittedScene::open(source.artifact))?;
    let files = FileAgreement::read(source, &view.files())?;
    let fitted = source.of(view.read())?;
    let own = fitted.parameters;
    let parameter = |(at, name): (usize, &String)| FittedParameter {
        name: name.clone(),
        value: own.value[at],
        unit: own.unit[at].clone(),
        interval: [0, 1].map(|end| (own.bounded[at][end] == 1).then_some(own.interval[at][end])),
        at_bound: own.at_bound[at] == 1,
    };
    let candidates = fitted.candidates.unwrap_or_default();
    let mut chosen = candidates.name.iter().zip(&candidates.chosen);
    Ok(Found {
        stage: source.stage.stage.clone(),
        parameters: own.name.0.iter().enumerate().map(parameter).collect(),
        chosen: chosen.find(|(_, chosen)| **chosen == 1).map(|(name, _)| name.clone()),
        candidates: compared_candidates(&candidates),
        verdict: fitted.verdict,
        chi2_per_dof: (fitted.stated == [1] && fitted.degrees_of_freedom[0] > 0)
            .then(|| fitted.sum_of_squares[0] / fitted.degrees_of_freedom[0] as f64),
        files,
    })
}

/// Returns AICc of each candidate above that of the best.
fn compared_candidates(candidates: &FitCandidates) -> Vec<(String, Option<f64>)> {
    let known = |at: usize| (candidates.fitted[at] == 1 && candidates.aicc[at] != 0.0).then_some(candidates.aicc[at]);
    let count = candidates.name.len();
    let best = (0..count).filter_map(known).reduce(f64::min).unwrap_or_default();
    let of = |at: usize| (candidates.name[at].clone(), known(at).map(|aicc| aicc - best));
    (0..count).map(of).collect()
}

impl Found {
    fn parameters(&self) -> String {
        let all: Vec<String> = self.parameters.iter().map(FittedParameter::line).collect();
        // The number of branches follows from the parameters.
        let law = self.chosen.iter().filter(|chosen| chosen.parse::<u64>().is_err());
        let law = law.map(|law| format!("{law}: ")).next().unwrap_or_default();
        format!("{law}{}", listed(&all))
    }

    fn warnings(&self) -> Vec<String> {
        let of = |parameter: &FittedParameter| {
            let name = &parameter.name;
            match parameter.interval {
                _ if parameter.at_bound => Some(format!("{name} is at its bound: its value says nothing")),
                [None, None] => Some(format!("the measurements do not determine {name}")),
                [Some(_), None] | [None, Some(_)] => Some(format!("the measurements bound {name} on one side only")),
                _ if name == OFFSET => Some(format!(
                    "a scene has no voltage offset: add {} to the voltages of the supply",
                    parameter.number()
                )),
                _ => None,
            }
        };
        let mut warnings: Vec<String> = self.parameters.iter().filter_map(of).collect();
        // One direction may be a combination of parameters that have intervals of their own.
        if self.verdict == "not-determined" {
            warnings.push("the measurements determine only combinations of the parameters".to_owned());
        }
        if self.verdict == "not-converged" {
            warnings.push("the search did not converge".to_owned());
        }
        if let Some(chi2) = self.chi2_per_dof.filter(|chi2| *chi2 > LARGE_CHI2) {
            warnings.push(format!(
                "χ²/dof is {}: the fit does not agree with the measurements within their noise",
                four_significant(chi2)
            ));
        }
        warnings
            .iter()
            .map(|warning| format!("{}: {warning}", self.stage))
            .collect()
    }

    fn lines(&self) -> Vec<String> {
        let files = self.files.iter().map(FileAgreement::line);
        let warnings = self.warnings().into_iter();
        let above = |(name, aicc): &(String, Option<f64>)| match aicc {
            Some(aicc) => format!("{name} +{}", four_significant(*aicc)),
            None => format!("{name} –"),
        };
        let several = Some(&self.candidates).filter(|all| all.len() > 1);
        let several = several.map(|all| {
            let all: Vec<String> = all.iter().map(above).collect();
            format!("AICc above the best: {}", all.join(", "))
        });
        std::iter::once(self.parameters())
            .chain(several)
            .chain(files)
            .chain(warnings)
            .collect()
    }
}

impl Presenter for FitPresenter {
    fn kind(&self) -> &'static str {
        "fit"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let text = found
            .iter()
            .map(|found| format!("{}: {}", found.stage, found.lines().join("\n  ")));
        let warnings = found.iter().flat_map(Found::warnings).collect();
        Ok(vec![Results::new("fits", &found, text).with_warnings(warnings)])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let of = |found: &Found| {
            let parameters = Headline::good(format!("{}: {}", found.stage, found.parameters()));
            let warnings = found.warnings().into_iter().map(Headline::bad);
            std::iter::once(parameters).chain(warnings).collect::<Vec<_>>()
        };
        Ok(found.iter().flat_map(of).collect())
    }

    fn figures(&self) -> Figures {
        &[("fit", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let found = run.each(self.kind(), |source| {
            let view = source.of(FittedScene::open(source.artifact))?;
            let scene = source.of(view.scene().read())?;
            Ok((read(source)?, charts(source, &view.files(), &view.rows(), &scene)?))
        })?;
        for (found, charts) in &found {
            page.open(
                "Fits",
                "Parameters with intervals of 95 %. Dots are measured, lines fitted.",
            );
            page.part(&found.stage);
            page.lines(&found.lines());
            page.charts(charts);
        }
        Ok(())
    }
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let view = source.of(FittedScene::open(source.artifact))?;
    let scene = source.of(view.scene().read())?;
    sheet(source, &view.files(), &view.rows(), &scene)
}
