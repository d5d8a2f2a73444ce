//! Improve: a gradient search that starts at a drawn pattern and reports its steps.
//!
//! The search is that of a design stage ([`SearchProblem::follow_gradient`]). Each step asks for the gradient at its
//! pattern; the step is reported there, and the search ends there if the client has left or the target value was
//! passed. The target then lies between the last two patterns, and [`super::bisection`] finds the pattern nearest to
//! it.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::bisection::{PatternBracket, between, is_reached};
use super::request::{SketchRequest, quantity};
use crate::cache::lock;
use crate::compute::interruptible;
use crate::http::{ApiError, LineSender, Request, Response};
use crate::state::ServerState;
use deaflow_base::{Dimension, Document, Interrupt, Stopped};
use deaflow_design::{ConstraintParameters, Constraints, Goal, SearchProblem};
use deaflow_fem::GradientEvaluator;
use deaflow_field::{Differentiable, Field, InStates, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Tolerance of the area fraction.
const AREA_TOLERANCE: f64 = 0.005;

/// Time that the search before has to end: it ends within an iteration of its current solution.
const PATIENCE: Duration = Duration::from_secs(20);

/// The running search: one at a time, since a search uses all threads.
static RUNNING: Mutex<RunningSearch> = Mutex::new(RunningSearch {
    last: 0,
    is_running: false,
});

/// Notified when a search has ended.
static ENDED: Condvar = Condvar::new();

struct RunningSearch {
    /// The number of the last search. All others have ended, or are about to.
    last: u64,
    is_running: bool,
}

/// The right to search, held while a search runs.
struct SearchPermit(u64);

impl SearchPermit {
    /// Stops the running search, which may be that of a closed tab, and waits for its end. `None` if a later search was
    /// started meanwhile, or the running one does not end.
    fn acquire() -> Option<Self> {
        let mut running = lock(&RUNNING);
        running.last += 1;
        let own = running.last;
        let waits = |running: &mut RunningSearch| running.is_running && running.last == own;
        let waited = ENDED.wait_timeout_while(running, PATIENCE, waits);
        let (mut running, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if running.is_running || running.last != own {
            return None;
        }
        running.is_running = true;
        Some(Self(own))
    }

    /// Whether another search was started.
    fn is_superseded(&self) -> bool {
        lock(&RUNNING).last != self.0
    }
}

impl Drop for SearchPermit {
    fn drop(&mut self) {
        lock(&RUNNING).is_running = false;
        ENDED.notify_all();
    }
}

/// The error of a search that was stopped for another one.
const SUPERSEDED: &str = "another search was started, which stops this one";

/// Starts a search. Its steps are sent as lines; closing the connection stops it.
///
/// # Errors
/// If the request is invalid, the scene has no gradient, or another search was started meanwhile.
pub fn improve(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    let setup = drawn.setup(state)?;
    let pattern = drawn.pattern(&setup.scene)?;
    if let Some(area) = drawn.area.filter(|area| !(0.0..=1.0).contains(area)) {
        return Err(ApiError::bad_request(format!("invalid `area`: {area}")).help("allowed: 0 to 1"));
    }
    if setup.scene.drive.charge.is_some() {
        return Err(ApiError::bad_request("there is no gradient if the drive is a charge"));
    }
    let target = drawn.wanted.as_ref();
    let target = target.map(|value| quantity("wanted", value, Dimension::Length, -1e3..=1e3));
    let target = target.transpose()?;
    let constraints = constraints(&drawn, &setup.scene)?;
    let gradient = state.solvers.gradient(&setup.scene)?;
    let (goal, sign) = goal_and_sign(&drawn, &setup.scene, &gradient, &pattern, target)?;
    let permit = SearchPermit::acquire().ok_or_else(|| ApiError::new(409, SUPERSEDED))?;
    let (lines, response) = LineSender::new();
    let search = Improvement {
        gradient,
        goal,
        sign,
        target,
        constraints,
        area: drawn.area,
        lines,
        permit: Arc::new(permit),
    };
    let started = std::thread::Builder::new()
        .name("improve".to_owned())
        .spawn(move || search.start(&pattern));
    started.map_err(|error| ApiError::new(503, format!("cannot start the search: {error}")))?;
    Ok(response)
}

/// Returns the objective of a search, and the sign of its values: if the target lies below the present value, the
/// search goes against the requested direction.
fn goal_and_sign(
    drawn: &SketchRequest,
    scene: &Scene,
    gradient: &GradientEvaluator,
    pattern: &Pattern,
    target: Option<f64>,
) -> Result<(Goal, f64), ApiError> {
    let goal = |backwards: bool| {
        let goal = drawn.goal(scene, drawn.area, backwards)?;
        goal.ok_or_else(|| ApiError::bad_request("a search needs `point` and `direction`"))
    };
    let forward = goal(false)?;
    let Some(target) = target else {
        return Ok((forward, 1.0));
    };
    let field = gradient.predict_some(std::slice::from_ref(pattern))?.swap_remove(0);
    match field.is_some_and(|field| forward.value_mm(&[field]) > target) {
        true => Ok((goal(true)?, -1.0)),
        false => Ok((forward, 1.0)),
    }
}

fn constraints(drawn: &SketchRequest, scene: &Scene) -> Result<Constraints, ApiError> {
    let Some(constraints) = &drawn.constraints else {
        return Ok(ConstraintParameters::none_in(scene)?.constraints().clone());
    };
    let document = Document::from_text(std::path::Path::new("constraints"), &constraints.to_string())?;
    let read = ConstraintParameters::read(&document.root, scene)?;
    if read.constraints().limits().has_margins() {
        return Err(
            ApiError::bad_request("the page does not support margins from pull-in and breakdown")
                .help("use a design stage"),
        );
    }
    Ok(read.constraints().clone())
}

struct Improvement {
    gradient: Arc<GradientEvaluator>,
    /// The displacement along the requested direction, or against it.
    goal: Goal,
    /// −1 if the search goes against the requested direction.
    sign: f64,
    target: Option<f64>,
    constraints: Constraints,
    area: Option<f64>,
    lines: LineSender,
    permit: Arc<SearchPermit>,
}

/// A pattern with its fields.
struct EvaluatedPattern {
    pattern: Pattern,
    fields: StateFields,
}

impl Improvement {
    /// Searches until the client leaves or another search is started.
    fn start(&self, pattern: &Pattern) {
        let (lines, permit) = (self.lines.clone(), Arc::downgrade(&self.permit));
        let is_superseded = move || permit.upgrade().is_none_or(|permit| permit.is_superseded());
        let interrupt = Interrupt::when(move || lines.is_closed() || is_superseded());
        if let Err(error) = interruptible(&interrupt, || self.run(pattern)) {
            // The client may be gone.
            let _ = self.lines.send(&failed(error.message_with_help()));
        }
    }

    fn run(&self, start: &Pattern) {
        let began = Instant::now();
        let evaluator = ReportingEvaluator {
            inner: InStates::one(&*self.gradient),
            search: self,
            steps: AtomicUsize::new(0),
            best: Mutex::new(f64::NEG_INFINITY),
            last: Mutex::default(),
            bracket: Mutex::default(),
        };
        let range = self.range();
        let sides = start.raster().sides();
        let problem = SearchProblem::new(&evaluator, &self.goal, sides, range, &self.constraints);
        let found = problem.follow_gradient(start, &|_| ());
        let bracket = lock(&evaluator.bracket).take();
        let last = match (bracket, found) {
            (Some(bracket), _) => match self.bisect(&evaluator, &bracket) {
                Ok(reached) => self.done(&reached, began),
                Err(error) => failed(error.to_string()),
            },
            (None, Ok(Ok(found))) => {
                let (pattern, fields) = (found.pattern, found.fields);
                self.done(&EvaluatedPattern { pattern, fields }, began)
            }
            (None, Ok(Err(unsuited))) => failed(format!("the pattern {unsuited}")),
            (None, Err(error)) => failed(error.to_string()),
        };
        let last = match self.permit.is_superseded() {
            true => failed(SUPERSEDED.to_owned()),
            false => last,
        };
        // The client may be gone.
        let _ = self.lines.send(&last);
    }

    /// Returns the allowed area fractions.
    fn range(&self) -> (f64, f64) {
        self.area
            .map_or((0.0, 1.0), |area| (area - AREA_TOLERANCE, area + AREA_TOLERANCE))
    }

    /// Finds the pattern nearest to the target, between two patterns on either side of it.
    fn bisect(
        &self,
        evaluator: &ReportingEvaluator<'_>,
        bracket: &PatternBracket,
    ) -> Result<EvaluatedPattern, PredictError> {
        let target = self.sign * self.target.unwrap_or_default();
        let (least, most) = self.range();
        let is_allowed = |pattern: &Pattern| {
            let area = self.constraints.area_fraction(pattern);
            self.constraints.satisfied_by(pattern) && (least..=most).contains(&area)
        };
        let value = |pattern: &Pattern| -> Result<Option<f64>, PredictError> {
            let found = evaluator.predict_some(std::slice::from_ref(pattern))?.swap_remove(0);
            if let Some(fields) = &found {
                evaluator.report(pattern, fields)?;
            }
            Ok(found.map(|fields| self.goal.value_mm(&fields)))
        };
        let pattern = between(bracket, target, &is_allowed, &value)?;
        let fields = evaluator.predict_some(std::slice::from_ref(&pattern))?.swap_remove(0);
        let fields = fields.ok_or_else(|| PredictError::failed(Stopped))?;
        Ok(EvaluatedPattern { pattern, fields })
    }

    fn done(&self, reached: &EvaluatedPattern, began: Instant) -> Value {
        let value = self.sign * self.goal.value_mm(&reached.fields);
        json!({
            "done": true,
            "value": value,
            "wanted": self.target,
            "reached": self.target.map(|target| is_reached(value, target)),
            "max_displacement": reached.fields.first().map(Field::max_magnitude),
            "area": self.constraints.area_fraction(&reached.pattern),
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

/// An evaluator that reports each better pattern of the search.
struct ReportingEvaluator<'a> {
    inner: InStates<&'a GradientEvaluator>,
    search: &'a Improvement,
    steps: AtomicUsize,
    /// The best score that was reported: the value, or minus the distance from the target.
    best: Mutex<f64>,
    /// The last pattern below the target, with its gradient.
    last: Mutex<Option<(Pattern, Vec<f64>)>>,
    /// The patterns on either side of the target, once it was passed.
    bracket: Mutex<Option<PatternBracket>>,
}

impl ReportingEvaluator<'_> {
    fn check_stopped(&self) -> Result<(), PredictError> {
        match self.search.lines.is_closed() || self.search.permit.is_superseded() {
            true => Err(PredictError::failed(Stopped)),
            false => Ok(()),
        }
    }

    /// Sends a pattern if it is better than all before.
    fn report(&self, pattern: &Pattern, fields: &StateFields) -> Result<(), PredictError> {
        let search = self.search;
        let value = search.sign * search.goal.value_mm(fields);
        let score = match search.target {
            Some(target) => -(value - target).abs(),
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
            "area": search.constraints.area_fraction(pattern),
            "pattern": rows(pattern),
        });
        match search.lines.send(&step) {
            true => Ok(()),
            false => Err(PredictError::failed(Stopped)),
        }
    }

    /// Ends the search if the target was passed, and stores the patterns on either side of it.
    fn check_target(&self, pattern: &Pattern, fields: &StateFields, gradient: &[f64]) -> Result<(), PredictError> {
        let search = self.search;
        let Some(target) = search.target else { return Ok(()) };
        if search.goal.value_mm(fields) < search.sign * target {
            *lock(&self.last) = Some((pattern.clone(), gradient.to_vec()));
            return Ok(());
        }
        let last = lock(&self.last).take();
        // Without a pattern below, the start is at the target or above it.
        let (below, gradient) = last.unwrap_or_else(|| (pattern.clone(), gradient.to_vec()));
        *lock(&self.bracket) = Some(PatternBracket {
            below,
            above: pattern.clone(),
            gradient,
        });
        Err(PredictError::failed(Stopped))
    }
}

impl Predictor<StateFields> for ReportingEvaluator<'_> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.check_stopped()?;
        self.inner.predict_some(patterns)
    }
}

impl Differentiable<StateFields> for ReportingEvaluator<'_> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.check_stopped()?;
        let found = self.inner.gradient(pattern, slope)?;
        if let Some((fields, gradient)) = &found {
            self.report(pattern, fields)?;
            self.check_target(pattern, fields, gradient)?;
        }
        Ok(found)
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.check_stopped()?;
        self.inner.predict_near(base, patterns)
    }
}
