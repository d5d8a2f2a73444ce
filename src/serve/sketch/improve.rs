//! A search along the gradient from a drawn pattern, shown as it goes.
//!
//! It is that of a design stage ([`SearchProblem::follow_gradient`]). Each step of it asks for the gradient at the pattern it has reached;
//! there it is told, and there it ends once nobody listens, or once a wanted value has been passed: it is between the last two patterns then,
//! and is looked for there ([`super::approach`]).

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::approach::{Passed, between, is_reached};
use super::drawn::{Drawn, quantity};
use crate::held::lock;
use crate::http::{Answer, Lines, Refusal, Request};
use crate::state::ServedState;
use deaflow_base::{Dimension, Document, Stopped};
use deaflow_design::{ConstraintParameters, Constraints, Goal, SearchProblem};
use deaflow_fem::GradientEvaluator;
use deaflow_field::{Differentiable, Field, InStates, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// By how much the area may differ from the one that is asked for: half a per cent of the membrane.
const AREA_TOLERANCE: f64 = 0.005;

/// How long a search that was told to end may take for it: until the solutions under way are found.
const PATIENCE: Duration = Duration::from_secs(20);

/// The search that goes on: one at a time, since it takes all threads.
static GOING: Mutex<Going> = Mutex::new(Going {
    last: 0,
    is_held: false,
});

/// Told when a search has ended.
static ENDED: Condvar = Condvar::new();

struct Going {
    /// The number of the search that was begun last: all others are over, or are to end.
    last: u64,
    /// Whether a search goes on.
    is_held: bool,
}

/// Held while a search goes on.
struct Turn(u64);

impl Turn {
    /// Tells the search that goes on to end, and waits for that: who begins another has done with it, and may not be able to stop it, since it
    /// is that of a tab which was closed a moment ago. None where a still later one was begun, or it does not end.
    fn take() -> Option<Self> {
        let mut going = lock(&GOING);
        going.last += 1;
        let own = going.last;
        let waits = |going: &mut Going| going.is_held && going.last == own;
        let waited = ENDED.wait_timeout_while(going, PATIENCE, waits);
        let (mut going, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if going.is_held || going.last != own {
            return None;
        }
        going.is_held = true;
        Some(Self(own))
    }

    /// Whether another was begun.
    fn is_over(&self) -> bool {
        lock(&GOING).last != self.0
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        lock(&GOING).is_held = false;
        ENDED.notify_all();
    }
}

/// What the last line of a search says that has ended for another, and the refusal of one that was never begun.
const OTHER_BEGUN: &str = "another search was begun, which ends this one";

/// Begins a search. Its steps come as lines; who closes the connection ends it.
///
/// # Errors
/// When the request is not understood, the scene has no gradient, or yet another search was begun while this one waited.
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
    let wanted = drawn.wanted.as_ref();
    let wanted = wanted.map(|wanted| quantity("wanted", wanted, Dimension::Length, -1e3..=1e3));
    let wanted = wanted.transpose()?;
    let constraints = constraints(&drawn, &setting.scene)?;
    let gradient = state.benches.gradient(&setting.scene)?;
    let (goal, sign) = followed(&drawn, &setting.scene, &gradient, &pattern, wanted)?;
    let turn = Turn::take().ok_or_else(|| Refusal::new(409, OTHER_BEGUN))?;
    let (lines, answer) = Lines::new();
    let search = Searching {
        gradient,
        goal,
        sign,
        wanted,
        constraints,
        area: drawn.area,
        lines,
        turn,
    };
    let begun = std::thread::Builder::new()
        .name("improve".to_owned())
        .spawn(move || search.run(&pattern));
    begun.map_err(|error| Refusal::new(503, format!("the search cannot begin: {error}")))?;
    Ok(answer)
}

/// What a search follows, and the sign by which its values are those along the direction that is asked for: what is wanted may lie on either
/// side of what there is.
fn followed(
    drawn: &Drawn,
    scene: &Scene,
    gradient: &GradientEvaluator,
    pattern: &Pattern,
    wanted: Option<f64>,
) -> Result<(Goal, f64), Refusal> {
    let goal = |backwards: bool| {
        let goal = drawn.goal(scene, drawn.area, backwards)?;
        goal.ok_or_else(|| Refusal::bad("a search needs a `point` and a `direction`"))
    };
    let ahead = goal(false)?;
    let Some(wanted) = wanted else {
        return Ok((ahead, 1.0));
    };
    let found = gradient.predict_some(std::slice::from_ref(pattern));
    let found = found
        .map_err(|error| Refusal::new(409, error.to_string()))?
        .swap_remove(0);
    match found.is_some_and(|field| ahead.value_mm(&[field]) > wanted) {
        true => Ok((goal(true)?, -1.0)),
        false => Ok((ahead, 1.0)),
    }
}

fn constraints(drawn: &Drawn, scene: &Scene) -> Result<Constraints, Refusal> {
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
    /// What is followed: the displacement along the direction that was asked for, or against it.
    goal: Goal,
    /// By which its values are those along the direction that was asked for.
    sign: f64,
    wanted: Option<f64>,
    constraints: Constraints,
    area: Option<f64>,
    lines: Lines,
    turn: Turn,
}

/// What a search has come to.
struct Reached {
    pattern: Pattern,
    fields: StateFields,
}

impl Searching {
    fn run(&self, start: &Pattern) {
        let began = Instant::now();
        let physics = Told {
            inner: InStates::one(&*self.gradient),
            search: self,
            steps: AtomicUsize::new(0),
            best: Mutex::new(f64::NEG_INFINITY),
            last: Mutex::default(),
            passed: Mutex::default(),
        };
        let range = self.range();
        let sides = start.raster().sides();
        let problem = SearchProblem::new(&physics, &self.goal, sides, range, &self.constraints);
        let found = problem.follow_gradient(start, &|_| ());
        let passed = lock(&physics.passed).take();
        let last = match (passed, found) {
            (Some(passed), _) => match self.approach(&physics, &passed) {
                Ok(reached) => self.done(&reached, began),
                Err(error) => failed(error.to_string()),
            },
            (None, Ok(Ok(found))) => {
                let (pattern, fields) = (found.pattern, found.fields);
                self.done(&Reached { pattern, fields }, began)
            }
            (None, Ok(Err(unsuited))) => failed(format!("the pattern {unsuited}")),
            (None, Err(error)) => failed(error.to_string()),
        };
        let last = match self.turn.is_over() {
            true => failed(OTHER_BEGUN.to_owned()),
            false => last,
        };
        // Nobody may be listening any more, who then wants to know nothing.
        let _ = self.lines.send(&last);
    }

    /// The area fractions that are allowed.
    fn range(&self) -> (f64, f64) {
        self.area
            .map_or((0.0, 1.0), |area| (area - AREA_TOLERANCE, area + AREA_TOLERANCE))
    }

    /// The pattern nearest to what is wanted, between the two on either side of it.
    fn approach(&self, physics: &Told<'_>, passed: &Passed) -> Result<Reached, PredictError> {
        let wanted = self.sign * self.wanted.unwrap_or_default();
        let (least, most) = self.range();
        let may_be = |pattern: &Pattern| {
            let area = pattern.area_fraction();
            self.constraints.hold(pattern) && (least..=most).contains(&area)
        };
        let value = |pattern: &Pattern| -> Result<Option<f64>, PredictError> {
            let found = physics.predict_some(std::slice::from_ref(pattern))?.swap_remove(0);
            let value = found.as_ref().map(|fields| self.goal.value_mm(fields));
            if let Some(fields) = &found {
                physics.tell(pattern, fields)?;
            }
            Ok(value)
        };
        let pattern = between(passed, wanted, &may_be, &value)?;
        let fields = physics.predict_some(std::slice::from_ref(&pattern))?.swap_remove(0);
        let fields = fields.ok_or_else(|| PredictError::failed(Stopped))?;
        Ok(Reached { pattern, fields })
    }

    fn done(&self, reached: &Reached, began: Instant) -> Value {
        let value = self.sign * self.goal.value_mm(&reached.fields);
        json!({
            "done": true,
            "value": value,
            "wanted": self.wanted,
            "reached": self.wanted.map(|wanted| is_reached(value, wanted)),
            "max_displacement": reached.fields.first().map(Field::max_magnitude),
            "area": reached.pattern.area_fraction(),
            "pattern": rows(&reached.pattern),
            "seconds": began.elapsed().as_secs_f64(),
        })
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
    search: &'a Searching,
    steps: AtomicUsize,
    /// The best score that was told: the value, or how near it is to the wanted one.
    best: Mutex<f64>,
    /// The last pattern below what is wanted, with its gradient.
    last: Mutex<Option<(Pattern, Vec<f64>)>>,
    passed: Mutex<Option<Passed>>,
}

impl Told<'_> {
    fn go_on(&self) -> Result<(), PredictError> {
        match self.search.lines.is_closed() || self.search.turn.is_over() {
            true => Err(PredictError::failed(Stopped)),
            false => Ok(()),
        }
    }

    /// Tells of a pattern where it is better than all before.
    fn tell(&self, pattern: &Pattern, fields: &StateFields) -> Result<(), PredictError> {
        let search = self.search;
        let value = search.sign * search.goal.value_mm(fields);
        let score = match search.wanted {
            Some(wanted) => -(value - wanted).abs(),
            None => value,
        };
        let mut best = lock(&self.best);
        if score <= *best {
            return Ok(());
        }
        *best = score;
        let step = json!({
            "step": self.steps.fetch_add(1, Ordering::Relaxed),
            "value": value,
            "max_displacement": fields.first().map(Field::max_magnitude),
            "area": pattern.area_fraction(),
            "pattern": rows(pattern),
        });
        match search.lines.send(&step) {
            true => Ok(()),
            false => Err(PredictError::failed(Stopped)),
        }
    }

    /// Ends the search where it has passed what is wanted, and remembers between which patterns.
    fn watch(&self, pattern: &Pattern, fields: &StateFields, gradient: &[f64]) -> Result<(), PredictError> {
        let search = self.search;
        let Some(wanted) = search.wanted else { return Ok(()) };
        if search.goal.value_mm(fields) < search.sign * wanted {
            *lock(&self.last) = Some((pattern.clone(), gradient.to_vec()));
            return Ok(());
        }
        let last = lock(&self.last).take();
        // Where nothing lies below, the start itself is what is wanted, or beyond it.
        let (below, gradient) = last.unwrap_or_else(|| (pattern.clone(), gradient.to_vec()));
        *lock(&self.passed) = Some(Passed {
            below,
            above: pattern.clone(),
            gradient,
        });
        Err(PredictError::failed(Stopped))
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
        if let Some((fields, gradient)) = &found {
            self.tell(pattern, fields)?;
            self.watch(pattern, fields, gradient)?;
        }
        Ok(found)
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.go_on()?;
        self.inner.predict_near(base, patterns)
    }
}
