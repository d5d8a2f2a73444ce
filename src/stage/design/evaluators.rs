//! The evaluators of a design search: networks, estimates and Newton's method.

use std::fmt;
use std::sync::Arc;

use deaflow_base::{Canonical, Frequency, InputError, Node, Parameter, Schema, Time};
use deaflow_design::{Candidate, Cause, Evaluators, Goal, Masks, ResponseKind};
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{Method, SetupError, SolverParameters, Swing, ThreeSolves, UnknownMethod, creep_settings};
use deaflow_field::{Evaluator, Field, InStates, Mesh};
use deaflow_orchestrator::{Expectation, ResultSource, StageDeclaration};
use deaflow_scene::Scene;
use deaflow_surrogate::{NetworkKind, Surrogate};

const ALLOWED: &str = "allowed: auto, surrogate, newton, linear, chord:N with N from 1 to 50";

/// Elements along a side of a cell in the reference.
const REFERENCE: usize = 2;

/// The evaluator that a stage requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluatorChoice {
    /// The cheapest that is accurate enough.
    Auto,
    /// The network that the stage needs.
    Surrogate,
    /// A method on one bilinear element per cell.
    Elements(Method),
}

impl Parameter for EvaluatorChoice {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let text = node.text(key)?;
        match text {
            "auto" => Ok(Self::Auto),
            "surrogate" => Ok(Self::Surrogate),
            other => other.parse().map(Self::Elements).map_err(|_: UnknownMethod| {
                let message = format!("`{key}` cannot be {text:?}");
                node.error(message).help(ALLOWED)
            }),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.to_string().as_str().into())
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::word(&["auto", "surrogate"]), Method::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl fmt::Display for EvaluatorChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Surrogate => f.write_str("surrogate"),
            Self::Elements(method) => method.fmt(f),
        }
    }
}

impl EvaluatorChoice {
    /// Results of earlier runs that may exceed a maximum error in mm: for networks, the error on the held-out samples;
    /// for methods, the error in a stage of kind `accuracy`.
    pub fn expectations(self, max_mm: f64, needs: &[StageDeclaration<'_>]) -> Vec<Expectation> {
        let expected = |source: ResultSource, result: String, measured: &str| Expectation {
            source,
            result,
            limit: max_mm,
            warning: format!(
                "`evaluator: {self}` does not reach the `evaluator_accuracy` of {max_mm} mm: {measured} (stage \
                 `{{stage}}`)"
            ),
        };
        match self {
            Self::Auto => Vec::new(),
            Self::Surrogate => {
                let networks = needs.iter().filter(|need| need.kind == "train");
                let of = |need: &StageDeclaration<'_>| {
                    let measured = "its root mean square error on held-out samples is {value} mm";
                    expected(
                        ResultSource::Stage(need.name.to_owned()),
                        "rmse.test".to_owned(),
                        measured,
                    )
                };
                networks.map(of).collect()
            }
            Self::Elements(method) => {
                let settings = SolverParameters::new(method, Mesh::bilinear(1));
                let measured = "its largest error is {value} mm";
                vec![expected(
                    ResultSource::Kind("accuracy"),
                    format!("max_error.{settings}"),
                    measured,
                )]
            }
        }
    }
}

/// Returns networks, one for each state of the device, as an evaluator.
fn networks(each: Vec<Surrogate>) -> Candidate {
    let mut settings: Vec<String> = each.iter().map(Surrogate::settings).collect();
    settings.dedup();
    let each = each.into_iter().map(|network| Box::new(network) as Box<dyn Evaluator>);
    Candidate {
        settings: settings.join(", "),
        evaluator: Ok(InStates::new(each.collect())),
    }
}

/// Returns a method on bilinear elements as an evaluator in each state of a scene. The field at a time follows from
/// three equilibria.
fn elements(scene: &Scene, time: Option<Time>, method: Method, elements_per_cell: usize) -> Candidate {
    let parameters = SolverParameters::new(method, Mesh::bilinear(elements_per_cell));
    let one = |scene: &Scene| -> Result<Box<dyn Evaluator>, SetupError> {
        Ok(match time {
            None => Box::new(parameters.build(scene)?),
            Some(time) => Box::new(ThreeSolves::new(scene, time.value())?.evaluator(scene, &parameters)?),
        })
    };
    Candidate {
        settings: match time {
            None => parameters.to_string(),
            Some(_) => creep_settings(&parameters),
        },
        evaluator: each(scene, one).map(InStates::new),
    }
}

/// Returns time integration on bilinear elements as an evaluator in each state of a scene.
fn steps(scene: &Scene, time: Time, elements_per_cell: usize) -> Candidate {
    let parameters = SolverParameters::new(Method::Newton, Mesh::bilinear(elements_per_cell));
    let settings = parameters.settings_in_time("history");
    let parameters = parameters.up_to(time);
    Candidate {
        settings,
        evaluator: each(scene, |scene| {
            Ok(Box::new(parameters.build(scene)?) as Box<dyn Evaluator>)
        })
        .map(InStates::new),
    }
}

/// Builds an evaluator in each state of a scene.
fn each<E>(scene: &Scene, one: impl Fn(&Scene) -> Result<E, SetupError>) -> Result<Vec<E>, Cause> {
    let each = || {
        resolved_states(scene)?
            .iter()
            .map(one)
            .collect::<Result<_, SetupError>>()
    };
    each().map_err(Into::into)
}

/// Returns Newton's method on patterns with each of several masks, whose cells only it simulates.
pub fn with_masks(scene: &Scene, masks: &Masks) -> Evaluators {
    let parameters = SolverParameters::new(Method::Newton, Mesh::bilinear(1));
    let solvers = each(scene, |scene| Ok(Arc::new(parameters.build(scene)?)));
    let over = |solvers: Vec<_>| masks.over(&solvers, scene).into_iter();
    Evaluators::Named(Candidate {
        settings: parameters.to_string(),
        evaluator: solvers.map(|solvers| InStates::new(over(solvers).map(|one| one as Box<dyn Evaluator>).collect())),
    })
}

/// Returns the solver of amplitudes in a search: one bilinear element per cell has a small error.
pub fn amplitude_parameters() -> SolverParameters {
    SolverParameters::new(Method::Newton, Mesh::bilinear(1))
}

/// Returns the linear response at a frequency; there is no cheaper estimate.
fn amplitude_candidate(scene: &Scene, frequency: Frequency, goal: &Goal) -> Candidate {
    let parameters = amplitude_parameters();
    let one = |scene: &Scene| -> Result<Box<dyn Evaluator>, SetupError> {
        Ok(Box::new(amplitude_solver(scene, frequency, goal, &parameters)?))
    };
    Candidate {
        settings: parameters.settings_in_time("response"),
        evaluator: each(scene, one).map(InStates::new),
    }
}

/// Returns the solver of the amplitude that a goal measures.
///
/// # Errors
/// As [`Swing::new`].
pub fn amplitude_solver(
    scene: &Scene,
    frequency: Frequency,
    goal: &Goal,
    parameters: &SolverParameters,
) -> Result<Swing, SetupError> {
    let weights = goal.slope(&[Field::zero(goal.raster())]);
    let weights = weights.into_iter().next().unwrap_or_else(|| Field::zero(goal.raster()));
    Swing::new(scene, frequency.value(), weights, parameters)
}

/// Returns the evaluators of a search: the chosen one, or all in the order of their cost as measured by `deaflow
/// accuracy`, the reference last. The order is fixed, since times are not reproducible. `trained` are the networks
/// that the stage needs.
pub fn evaluators(
    choice: EvaluatorChoice,
    scene: &Scene,
    (response, goal): (ResponseKind, &Goal),
    trained: Option<Vec<Surrogate>>,
) -> Evaluators {
    let time = match response {
        ResponseKind::Equilibrium => None,
        ResponseKind::After(time) => Some(time),
        ResponseKind::Amplitude(frequency) => return Evaluators::Named(amplitude_candidate(scene, frequency, goal)),
    };
    match (choice, trained) {
        (EvaluatorChoice::Elements(method), _) => Evaluators::Named(elements(scene, time, method, 1)),
        (EvaluatorChoice::Surrogate, Some(trained)) => Evaluators::Named(networks(trained)),
        (EvaluatorChoice::Surrogate, None) => Evaluators::Named(Candidate {
            settings: choice.to_string(),
            evaluator: Err("the stage has no network".into()),
        }),
        (EvaluatorChoice::Auto, trained) => Evaluators::Cheapest(by_cost(scene, time, trained)),
    }
}

fn by_cost(scene: &Scene, time: Option<Time>, trained: Option<Vec<Surrogate>>) -> Vec<Candidate> {
    let estimates = [Method::Linear, Method::Chord(1), Method::Chord(2)].into_iter();
    // There are none in space.
    let methods = estimates.filter(|_| !scene.is_in_space()).chain([Method::Newton]);
    let mut all: Vec<Candidate> = methods.map(|method| elements(scene, time, method, 1)).collect();
    if let Some(trained) = trained {
        let is_cheap = trained.iter().all(|network| network.kind() == NetworkKind::Physics);
        all.insert(if is_cheap { 2 } else { all.len() }, networks(trained));
    }
    all.push(match time {
        None => elements(scene, None, Method::Newton, REFERENCE),
        Some(time) => steps(scene, time, REFERENCE),
    });
    all
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;
    use deaflow_design::{CandidateAccuracy, Constraints, DesignReferences, cheapest_evaluator, first_generation};
    use deaflow_field::{Field, Predictor};
    use deaflow_pattern::{Membrane, Pattern, Raster};

    #[test]
    fn evaluators_round_trip_through_text() {
        let read = |text: &str| {
            EvaluatorChoice::read(
                &Document::from_text(Path::new("e"), text).unwrap().root,
                "evaluator",
                &(),
            )
        };
        for text in ["auto", "surrogate", "linear", "chord:2", "newton"] {
            assert_eq!(read(text).unwrap().to_string(), text);
        }
        assert!(read("surogate").is_err() && read("chord:0").is_err());
    }

    #[test]
    fn estimates_find_unstable_patterns() {
        let scene = Scene::vhb4910().at_voltage(10e3);
        let patterns = [25, 0].map(|width| Pattern::from_fn(Raster::PAPER, |x, _| x < width));
        let linear = elements(&scene, None, Method::Linear, 1).evaluator.ok().unwrap();
        let fields = linear.predict_some(&patterns).unwrap();
        assert!(fields[0].is_none() && fields[1].is_some());
        assert!(
            linear
                .predict(&patterns)
                .unwrap_err()
                .to_string()
                .contains("pattern 0 has no field")
        );
        let hot = elements(&Scene::vhb4910().at_voltage(20e3), None, Method::Linear, 1);
        assert!(hot.evaluator.err().unwrap().to_string().contains("unstable"));
    }

    fn chosen(volts: f64, accuracy_mm: f64) -> (String, Vec<CandidateAccuracy>) {
        let scene = Scene::vhb4910().at_voltage(volts);
        let patterns: Vec<Pattern> = first_generation(Some(0.5), &Constraints::none(Membrane::square(50.0)), 1, 8)
            .iter()
            .map(|genome| genome.pattern(Raster::PAPER))
            .collect();
        let none = DesignReferences {
            patterns: &[],
            values_mm: &[],
            value_mm: &|_| 0.0,
        };
        let (evaluator, accuracies) =
            cheapest_evaluator(by_cost(&scene, None, None), &patterns, &none, accuracy_mm).unwrap();
        (evaluator.settings, accuracies)
    }

    #[test]
    fn the_cheapest_accurate_evaluator_is_selected() {
        let (_, accuracies) = chosen(5250.0, 1.0);
        let errors: Vec<f64> = accuracies.iter().map(|accuracy| accuracy.rmse_mm).collect();
        assert!(errors[0] > 2.0 * errors[1] && errors[1] > errors[2], "{errors:?}");
        assert_eq!(errors[4], 0.0, "the reference itself");
        for (accuracy, index) in [(1.0, 0), (0.5 * (errors[0] + errors[1]), 1), (1e-9, 4)] {
            assert_eq!(chosen(5250.0, accuracy).0, accuracies[index].settings, "{accuracy}");
        }
    }

    #[test]
    fn evaluators_that_miss_instability_are_not_selected() {
        let (settings, accuracies) = chosen(6800.0, 10.0);
        assert!(accuracies[0].disagree > 0, "{accuracies:?}");
        assert!(settings.starts_with("method: newton"), "{settings}");
    }

    #[test]
    fn an_evaluator_with_errors_at_designs_is_not_selected() {
        let scene = Scene::vhb4910();
        let patterns = [Pattern::from_fn(Raster::PAPER, |x, y| (x * 7 + y * 3) % 5 < 2)];
        let half = [Pattern::from_fn(Raster::PAPER, |x, _| x < 25)];
        let right = |fields: &[Field]| fields[0].at([25.0, 25.0])[0];
        let chosen = |values_mm: &[f64]| {
            let designs = DesignReferences {
                patterns: &half,
                values_mm,
                value_mm: &right,
            };
            cheapest_evaluator(by_cost(&scene, None, None), &patterns, &designs, 1.0).unwrap()
        };
        // H7: the half plane moves the centre by 2.119 mm; the linear response misses by several per cent.
        let (evaluator, accuracies) = chosen(&[2.119]);
        assert!(
            accuracies[0].design_error > 0.01 && accuracies[0].rmse_mm < 1.0,
            "{accuracies:?}"
        );
        assert!(!evaluator.settings.contains("linear"), "{}", evaluator.settings);
        // Nothing is as wrong as that: the last is taken.
        assert!(chosen(&[20.0]).0.settings.contains("elements_per_cell: 2"));
    }
}
