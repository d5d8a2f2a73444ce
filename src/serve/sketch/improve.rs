//! A search along the gradient from a drawn pattern, shown as it goes.
//!
//! It is that of a design stage ([`SearchProblem::follow_gradient`]). Each step of it asks for the gradient at the pattern it has reached;
//! there it is told, and there it ends once nobody listens.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use serde_json::{Value, json};

use super::drawn::Drawn;
use crate::base::{Document, Stopped};
use crate::design::{ConstraintParameters, Constraints, Goal, SearchProblem};
use crate::fem::GradientEvaluator;
use crate::field::{Differentiable, Field, InStates, PredictError, Predictor, StateFields, WithGradient};
use crate::pattern::Pattern;
use crate::serve::held::lock;
use crate::serve::http::{Answer, Lines, Refusal, Request};
use crate::serve::state::ServedState;

/// By how much the area may differ from the one that is asked for: half a per cent of the membrane.
const AREA_TOLERANCE: f64 = 0.005;

/// One search at a time: it takes all threads.
static BUSY: AtomicBool = AtomicBool::new(false);

/// Held while a search goes on.
struct Turn;

impl Turn {
    fn take() -> Option<Self> {
        (!BUSY.swap(true, Ordering::AcqRel)).then_some(Self)
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        BUSY.store(false, Ordering::Release);
    }
}

/// Begins a search. Its steps come as lines; who closes the connection ends it.
///
/// # Errors
/// When the request is not understood, the scene has no gradient, or another search goes on.
pub fn improve(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let drawn: Drawn = request.json()?;
    let setting = drawn.setting(state)?;
    let pattern = drawn.pattern(&setting.scene)?;
    if let Some(area) = drawn.area.filter(|area| !(0.0..=1.0).contains(area)) {
        return Err(Refusal::bad(format!("`area` cannot be {area}")).help("allowed: 0 to 1"));
    }
    if setting.scene.drive.charge.is_some() {
        return Err(Refusal::bad("under a charge there is no gradient to follow"));
    }
    let goal = drawn.goal(&setting.scene, drawn.area)?;
    let goal = goal.ok_or_else(|| Refusal::bad("a search needs a `point` and a `direction`"))?;
    let constraints = constraints(&drawn, &setting.scene)?;
    let gradient = state.benches.gradient(&setting.scene)?;
    let turn = Turn::take()
        .ok_or_else(|| Refusal::new(409, "another search goes on").help("stop it first, or wait for it"))?;
    let (lines, answer) = Lines::new();
    let search = Searching {
        gradient,
        goal,
        constraints,
        area: drawn.area,
        lines,
    };
    let begun = std::thread::Builder::new().name("improve".to_owned()).spawn(move || {
        search.run(&pattern);
        drop(turn);
    });
    begun.map_err(|error| Refusal::new(503, format!("the search cannot begin: {error}")))?;
    Ok(answer)
}

fn constraints(drawn: &Drawn, scene: &crate::scene::Scene) -> Result<Constraints, Refusal> {
    let Some(wanted) = &drawn.constraints else {
        return Ok(ConstraintParameters::none_in(scene)?.constraints().clone());
    };
    let document = Document::from_text(std::path::Path::new("constraints"), &wanted.to_string())?;
    let read = ConstraintParameters::read(&document.root, scene)?;
    if read.constraints().limits().has_margins() {
        return Err(Refusal::bad(
            "margins from pull-in and breakdown are kept by design stages, not here",
        ));
    }
    Ok(read.constraints().clone())
}

struct Searching {
    gradient: Arc<GradientEvaluator>,
    goal: Goal,
    constraints: Constraints,
    area: Option<f64>,
    lines: Lines,
}

impl Searching {
    fn run(&self, start: &Pattern) {
        let began = Instant::now();
        let physics = Told {
            inner: InStates::one(&*self.gradient),
            goal: &self.goal,
            lines: &self.lines,
            steps: AtomicUsize::new(0),
            best: Mutex::new(f64::NEG_INFINITY),
        };
        let range = self
            .area
            .map_or((0.0, 1.0), |area| (area - AREA_TOLERANCE, area + AREA_TOLERANCE));
        let sides = start.raster().sides();
        let problem = SearchProblem::new(&physics, &self.goal, sides, range, &self.constraints);
        let last = match problem.follow_gradient(start, &|_| ()) {
            Ok(Ok(found)) => json!({
                "done": true,
                "value": self.goal.value_mm(&found.fields),
                "max_displacement": found.fields.first().map(Field::max_magnitude),
                "area": found.pattern.area_fraction(),
                "pattern": rows(&found.pattern),
                "simulations": found.steps.last().map_or(0, |step| step.simulations),
                "seconds": began.elapsed().as_secs_f64(),
            }),
            Ok(Err(unsuited)) => failed(format!("the pattern {unsuited}")),
            Err(error) => failed(error.to_string()),
        };
        // Nobody may be listening any more, who then wants to know nothing.
        let _ = self.lines.send(&last);
    }
}

fn failed(message: String) -> Value {
    json!({ "done": true, "error": { "message": message, "help": null } })
}

fn rows(pattern: &Pattern) -> Vec<&[u8]> {
    pattern.cells().chunks(pattern.raster().columns()).collect()
}

/// Fields, and a line for each pattern that the search has reached.
struct Told<'a> {
    inner: InStates<&'a GradientEvaluator>,
    goal: &'a Goal,
    lines: &'a Lines,
    steps: AtomicUsize,
    best: Mutex<f64>,
}

impl Told<'_> {
    fn go_on(&self) -> Result<(), PredictError> {
        match self.lines.is_closed() {
            true => Err(PredictError::failed(Stopped)),
            false => Ok(()),
        }
    }
}

impl Predictor<StateFields> for Told<'_> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.go_on()?;
        self.inner.predict_some(patterns)
    }
}

impl Differentiable<StateFields> for Told<'_> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.go_on()?;
        let found = self.inner.gradient(pattern, slope)?;
        if let Some((fields, _)) = &found {
            let value = self.goal.value_mm(fields);
            let mut best = lock(&self.best);
            if value > *best {
                *best = value;
                let step = json!({
                    "step": self.steps.fetch_add(1, Ordering::Relaxed),
                    "value": value,
                    "max_displacement": fields.first().map(Field::max_magnitude),
                    "area": pattern.area_fraction(),
                    "pattern": rows(pattern),
                });
                if !self.lines.send(&step) {
                    return Err(PredictError::failed(Stopped));
                }
            }
        }
        Ok(found)
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.go_on()?;
        self.inner.predict_near(base, patterns)
    }
}
