//! The search of one target: what is tried, and what the artifact says of it.

use std::time::Instant;

use super::content::{Climbing, Heading, Role, Row, describe, with_probes};
use super::evaluator::{Evaluator, Wanted};
use super::options::Method;
use super::probe::{self, Probe};
use super::target::Target;
use super::{DesignStage, Ready, shortage};
use crate::base::Stream;
use crate::design::{
    Admission, Climb, GenerationReport, Genome, Intuitive, Setting, StateError, Step, Terrain, UNITS, Watch, evolve,
    first_generation,
};
use crate::field::{Field, Predictor};
use crate::orchestrator::{Job, StageError};
use crate::pattern::{CELLS, Pattern};
use crate::stage::model;
use crate::store::Object;

/// What a pattern is whose field is not known.
pub const NO_FIELD: &str = "no stable field";

/// How coarse the random starts of a climb are: a handful of regions.
const START_GRAIN: usize = 6;

/// Starts that are finished by exchanges, the best ones.
const FINISHED: usize = 2;

/// How far behind the best of several designs one may be before others are searched in its place: as a share of the merit, and
/// in merit (0.5 µm).
const LAG: f64 = 0.008;
const NOTABLE: f64 = 2e-4;

/// How often that is done, and from how many random patterns near the best each time.
const SWEEPS: usize = 2;
const SPREADS: u64 = 4;

/// A pattern that was found, with its field where a climb knows it.
struct Found {
    role: Role,
    units: usize,
    member: usize,
    pattern: Pattern,
}

/// What a search came to.
struct Findings {
    found: Vec<Found>,
    history: Vec<GenerationReport>,
    climbs: Vec<Climbing>,
    evaluations: usize,
}

/// Searches one target of a stage.
///
/// # Errors
/// When there is no evaluator, or nothing that is tried has a field.
pub fn search(stage: &DesignStage, target: &Target, job: &Job<'_>) -> Result<Object, StageError> {
    let start = Instant::now();
    let searching = Searching { stage, target, job };
    let object = match stage.options.method {
        Method::Ga => searching.genetic(),
        Method::Adjoint => searching.adjoint(),
    }?;
    job.measure(format!("search; {}", target.name), start.elapsed().as_secs_f64());
    Ok(object)
}

struct Searching<'a> {
    stage: &'a DesignStage,
    target: &'a Target,
    job: &'a Job<'a>,
}

fn failed(error: &dyn std::fmt::Display) -> StageError {
    StageError::Failed(error.to_string())
}

impl Searching<'_> {
    fn genetic(&self) -> Result<Object, StageError> {
        let (evaluator, probes) = self.evaluator()?;
        let settings = evaluator.settings;
        let predictor = evaluator
            .predictor
            .map_err(|why| StageError::Failed(format!("{{ {settings} }}: {why}")))?;
        let options = &self.stage.options;
        let constraints = self.stage.constraints.constraints();
        let setting = Setting {
            predictor: predictor.as_ref(),
            goal: &self.target.goal,
            constraints,
            admission: self.admission()?,
        };
        let evolution = evolve(&setting, &options.evolve, &Follow(self.job)).map_err(|e| self.explained(&e))?;
        let found = evolution.winners.into_iter().enumerate().map(|(member, winner)| Found {
            role: Role::Ga,
            units: UNITS,
            member,
            pattern: winner.pattern,
        });
        let mut findings = Findings {
            found: found.collect(),
            climbs: Vec::new(),
            evaluations: evolution.evaluations,
            history: evolution.history,
        };
        if options.refine {
            self.refine(&mut findings)?;
        }
        self.describe(&settings, predictor.as_ref(), findings, &probes)
    }

    /// What says whether a pattern keeps the margins, where any are asked for.
    fn admission(&self) -> Result<Option<&dyn Admission>, StageError> {
        let limits = self.stage.constraints.constraints().limits();
        if limits.pull_in_margin.is_none() && limits.breakdown_margin.is_none() {
            return Ok(None);
        }
        let margins = self.stage.ready()?.margins.as_ref();
        Ok(margins.map(|margins| margins as &dyn Admission))
    }

    fn explained(&self, error: &dyn std::fmt::Display) -> StageError {
        StageError::Failed(format!("`{}`: {error}", self.target.name))
    }

    /// Adds what climbs make of the designs that were found; each differs from those before as much as it must.
    fn refine(&self, findings: &mut Findings) -> Result<(), StageError> {
        let started: Vec<(usize, Pattern)> = findings.found.iter().map(|f| (f.member, f.pattern.clone())).collect();
        let mut refined: Vec<(usize, Climb)> = Vec::new();
        for (member, start) in started {
            let others: Vec<Pattern> = refined.iter().map(|(_, climb)| climb.pattern.clone()).collect();
            let terrain = self.terrain(self.stage.ready()?, &others)?;
            let climb = terrain.climb(&start, &self.tell()).map_err(|e| failed(&e))?;
            self.job.progress.advance(1);
            match climb {
                Some(climb) => refined.push((member, climb)),
                // Others of several designs may stand without one; the rows tell that there are fewer.
                None if member > 0 => {}
                None => {
                    let why = "the design cannot be refined: brought to the wanted area and the constraints it has no stable field";
                    return Err(self.explained(&why));
                }
            }
        }
        for _ in 0..SWEEPS {
            self.raise_laggards(&mut refined)?;
        }
        for (member, climb) in refined {
            findings.keep(Role::Refined, member, self.stage.options.units, climb);
        }
        Ok(())
    }

    /// Searches the neighbourhood of the best of several designs for better ones in place of those that are far behind it.
    fn raise_laggards(&self, refined: &mut [(usize, Climb)]) -> Result<(), StageError> {
        let Some(best) = refined.iter().map(|(_, climb)| climb.merit).reduce(f64::max) else {
            return Ok(());
        };
        let leader = refined.iter().find(|(_, climb)| climb.merit == best);
        let leader = leader.map(|(_, climb)| climb.pattern.clone());
        for at in 0..refined.len() {
            let behind = best - refined[at].1.merit;
            let Some(leader) = leader.as_ref().filter(|_| behind > (LAG * best.abs()).max(NOTABLE)) else {
                continue;
            };
            let others = refined.iter().enumerate().filter(|(other, _)| *other != at);
            let others: Vec<Pattern> = others.map(|(_, (_, climb))| climb.pattern.clone()).collect();
            let terrain = self.terrain(self.stage.ready()?, &others)?;
            let mut starts = vec![leader.clone()];
            for draw in 0..SPREADS {
                let index = (refined[at].0 as u64) * SPREADS + draw;
                let mut stream = Stream::new(self.stage.options.evolve.seed, "spread design", index);
                starts.extend(terrain.spread(leader, &mut stream).map_err(|e| failed(&e))?);
            }
            for start in starts {
                let climb = terrain.climb(&start, &self.tell()).map_err(|e| failed(&e))?;
                if let Some(climb) = climb.filter(|climb| climb.merit > refined[at].1.merit) {
                    refined[at].1 = climb;
                }
            }
        }
        Ok(())
    }

    fn adjoint(&self) -> Result<Object, StageError> {
        let ready = self.stage.ready()?;
        let options = &self.stage.options;
        let mut findings = Findings {
            found: Vec::new(),
            history: Vec::new(),
            climbs: Vec::new(),
            evaluations: 0,
        };
        let starts = self.starts();
        let mut optima: Vec<Pattern> = Vec::new();
        for member in 0..options.evolve.designs {
            let terrain = self.terrain(ready, &optima)?;
            let Some(best) = self.highest(&terrain, &starts)? else {
                if member > 0 {
                    break;
                }
                let why = "no pattern that was tried can be brought to the wanted area and the constraints and has a stable field";
                return Err(self.explained(&why));
            };
            optima.push(best.pattern.clone());
            findings.keep(Role::Optimum, member, options.units, best);
        }
        let settings = "method: newton, elements_per_cell: 1, order: 2";
        self.describe(settings, &ready.physics, findings, &[])
    }

    /// The highest that climbs lead to from some starts: the gradient is followed from all, and the best are finished by
    /// exchanges.
    fn highest(&self, terrain: &Terrain<'_>, starts: &[Pattern]) -> Result<Option<Climb>, StageError> {
        let mut ascents: Vec<Climb> = Vec::new();
        for start in starts {
            ascents.extend(terrain.ascend(start, &self.tell()).map_err(|e| failed(&e))?);
            self.job.progress.advance(1);
        }
        // Starts that lead to the same place count once.
        ascents.sort_by(|a, b| b.merit.total_cmp(&a.merit));
        ascents.dedup_by(|a, b| a.pattern == b.pattern);
        ascents.truncate(FINISHED);
        let mut best: Option<Climb> = None;
        for ascent in ascents {
            let climb = terrain.climb(&ascent.pattern, &self.tell()).map_err(|e| failed(&e))?;
            let climb = climb.map(|climb| joined(ascent, climb));
            best = best
                .into_iter()
                .chain(climb)
                .reduce(|a, b| if b.merit > a.merit { b } else { a });
        }
        self.job.progress.advance(1);
        Ok(best)
    }

    fn terrain<'p>(&'p self, ready: &'p Ready, others: &[Pattern]) -> Result<Terrain<'p>, StageError> {
        let options = &self.stage.options;
        let constraints = self.stage.constraints.constraints();
        let terrain = Terrain::new(
            &ready.physics,
            &self.target.goal,
            options.units,
            self.range(),
            constraints,
        );
        Ok(terrain
            .admitting(self.admission()?)
            .apart_from(others, options.evolve.distance))
    }

    /// The area fractions that a climb may have.
    fn range(&self) -> (f64, f64) {
        let tolerance = self.stage.options.tolerance.to_f64();
        let around = |area: f64| (area - tolerance, area + tolerance);
        self.target.area.fraction().map_or((0.0, 1.0), around)
    }

    fn tell(&self) -> impl Fn(&Step) {
        |step: &Step| {
            self.job
                .progress
                .note(&format!("{:.4} mm at area {:.3}", step.value_mm, step.area));
        }
    }

    /// The intuitive design at the wanted area, or at its own where any will do.
    fn intuitive_start(&self) -> Pattern {
        let intuitive = Intuitive::of(&self.target.goal);
        let area = self.target.area.fraction();
        area.map_or_else(|| intuitive.at_own_area(), |area| intuitive.at_area(area))
    }

    /// The intuitive design, an empty membrane from which the gradient picks the best cells, and random coarse patterns.
    fn starts(&self) -> Vec<Pattern> {
        let area = self.target.area.fraction();
        let drawn = |index: usize| match index {
            0 => self.intuitive_start(),
            1 => Pattern::from_fn(|_, _| false),
            _ => {
                let mut stream = Stream::new(self.stage.options.evolve.seed, "start of a climb", index as u64);
                let area = area.unwrap_or_else(|| stream.uniform());
                Genome::random(area, START_GRAIN, &mut stream).pattern()
            }
        };
        (0..self.stage.options.starts).map(drawn).collect()
    }

    fn describe(
        &self,
        settings: &str,
        predictor: &dyn Predictor,
        mut findings: Findings,
        probes: &[Probe],
    ) -> Result<Object, StageError> {
        let target = self.target;
        let intuitive = Intuitive::of(&target.goal);
        let designed = findings.found.last().map_or(0.5, |best| best.pattern.area_fraction());
        for (role, pattern) in [
            (Role::Intuitive, intuitive.at_own_area()),
            (Role::IntuitiveEqualArea, intuitive.at_area(designed)),
        ] {
            findings.found.push(Found {
                role,
                units: CELLS,
                member: 0,
                pattern,
            });
        }
        let patterns: Vec<Pattern> = findings.found.iter().map(|found| found.pattern.clone()).collect();
        let fields = predictor.predict_some(&patterns).map_err(|e| failed(&e))?;
        let admitted = self.admitted(&patterns)?;
        let mut rows: Vec<Row> = findings
            .found
            .into_iter()
            .zip(fields)
            .zip(admitted)
            .map(|((found, field), admitted)| self.row(found, field, admitted))
            .collect();
        let options = &self.stage.options.evolve;
        shortage::tell(&mut rows, options.designs, options.distance);
        let heading = Heading {
            case: self.stage.case.clone(),
            name: target.name.clone(),
            objective: target.objective.to_text(),
            area: target.area.text(),
            constraints: self.stage.constraints.to_text(),
            evaluator: settings.to_owned(),
        };
        let object = describe(&heading, &rows, &findings.history, &findings.climbs);
        Ok(with_probes(object, &target.name, findings.evaluations, probes)
            .attribute("scene", self.stage.scene.to_text())
            .attribute("method", self.stage.options.method.name()))
    }

    /// Whether each pattern keeps the margins.
    fn admitted(&self, patterns: &[Pattern]) -> Result<Vec<bool>, StageError> {
        match self.admission()? {
            Some(admission) => admission.admissible(patterns).map_err(|e| failed(&e)),
            None => Ok(vec![true; patterns.len()]),
        }
    }

    fn row(&self, found: Found, field: Option<Field>, admitted: bool) -> Row {
        let goal = &self.target.goal;
        let status = match &field {
            None => NO_FIELD.to_owned(),
            Some(_) => self.status(&found, admitted),
        };
        let field = field.unwrap_or_else(Field::zero);
        Row {
            value_mm: goal.value_mm(&field),
            fitness: goal.fitness(&found.pattern, &field),
            role: found.role,
            member: found.member,
            units: found.units,
            pattern: found.pattern,
            predicted: field,
            status,
        }
    }

    /// `met`, or in words what of the wishes is not. The intuitive design at its own area has no area to meet.
    fn status(&self, found: &Found, admitted: bool) -> String {
        let (low, high) = self.range();
        let area = found.pattern.area_fraction();
        let mut lines = Vec::new();
        if found.role != Role::Intuitive && !(low - 1e-9..=high + 1e-9).contains(&area) {
            let tolerance = self.stage.options.tolerance;
            lines.push(format!(
                "area {area:.4}, wanted {} within {tolerance}",
                self.target.area.text()
            ));
        }
        lines.extend(self.stage.constraints.constraints().violations(&found.pattern).lines());
        if !admitted {
            lines.push("the margins from pull-in or breakdown are not kept".to_owned());
        }
        match lines.is_empty() {
            true => "met".to_owned(),
            false => lines.join("; "),
        }
    }

    /// What judges the patterns, with what every candidate said of some where it had to be chosen.
    fn evaluator(&self) -> Result<(Evaluator, Vec<Probe>), StageError> {
        let (scene, options) = (&self.stage.scene, &self.stage.options);
        let surrogate = self
            .job
            .inputs
            .first()
            .map(|input| model::in_scene(input, scene))
            .transpose()?;
        match (options.evaluator, surrogate) {
            (Wanted::Elements(method), _) => Ok((Evaluator::elements(scene, method, 1), Vec::new())),
            (Wanted::Surrogate, Some(surrogate)) => Ok((Evaluator::network(surrogate), Vec::new())),
            (Wanted::Surrogate, None) => Err(StageError::Input(
                "`evaluator: surrogate` judges by a network, and the stage needs none".to_owned(),
            )),
            (Wanted::Auto, surrogate) => {
                let count = options.evolve.population.min(probe::PATTERNS);
                let constraints = self.stage.constraints.constraints();
                let genomes = first_generation(self.target.area.fraction(), constraints, options.evolve.seed, count);
                let patterns: Vec<Pattern> = genomes.iter().map(Genome::pattern).collect();
                let candidates = probe::candidates(scene, surrogate);
                let (designs, values_mm) = self.like_designs()?;
                let designs = probe::Designs {
                    patterns: &designs,
                    values_mm: &values_mm,
                    value_mm: &|field| self.target.goal.value_mm(field),
                };
                probe::cheapest(candidates, &patterns, &designs, options.accuracy.value()).map_err(|e| failed(&e))
            }
        }
    }

    /// Patterns like those that the search will come to, with their displacements: errors on the best patterns are other than
    /// those on patterns that are drawn. They are the intuitive design, and where the gradient leads on the units of the genetic
    /// algorithm.
    fn like_designs(&self) -> Result<(Vec<Pattern>, Vec<f64>), StageError> {
        let ready = self.stage.ready()?;
        let (goal, constraints) = (&self.target.goal, self.stage.constraints.constraints());
        let terrain = Terrain::new(&ready.physics, goal, UNITS, self.range(), constraints);
        let intuitive = self.intuitive_start();
        let ascent = terrain.ascend(&intuitive, &|_| ()).map_err(|e| failed(&e))?;
        let patterns: Vec<Pattern> = [intuitive]
            .into_iter()
            .chain(ascent.map(|climb| climb.pattern))
            .collect();
        let fields = ready.physics.predict_some(&patterns).map_err(|e| failed(&e))?;
        let known = patterns.into_iter().zip(fields);
        let known = known.filter_map(|(pattern, field)| Some((pattern, goal.value_mm(&field?))));
        Ok(known.unzip())
    }
}

impl Findings {
    fn keep(&mut self, role: Role, member: usize, units: usize, climb: Climb) {
        self.found.push(Found {
            role,
            units,
            member,
            pattern: climb.pattern,
        });
        self.climbs.push(Climbing {
            role,
            member,
            steps: climb.steps,
        });
    }
}

/// Follows the genetic algorithm: tells of it, and keeps what it needs to be gone on with.
struct Follow<'a>(&'a Job<'a>);

/// Under which the state of a search is kept.
const STATE: &str = "search";

impl Watch for Follow<'_> {
    fn generation(&self, report: &GenerationReport) {
        self.0
            .progress
            .note(&format!("best {:.4} mm at area {:.3}", report.value_mm, report.area));
        self.0.progress.advance(1);
    }

    fn kept(&self) -> Option<Vec<u8>> {
        self.0.scratch.kept(STATE)
    }

    fn keep(&self, state: &dyn Fn() -> Option<Vec<u8>>) {
        self.0.scratch.keep(STATE, state);
    }

    fn resumed(&self, report: &GenerationReport) {
        self.0.progress.resume(report.generation as u64 + 1);
    }

    fn unusable(&self, error: &StateError) {
        self.0.scratch.ignore(&error.to_string());
    }
}

/// A climb that went on from another one.
fn joined(first: Climb, then: Climb) -> Climb {
    let before = first.steps.last().map_or(0, |step| step.simulations);
    let later = then.steps.iter().skip(1).map(|step| Step {
        simulations: before + step.simulations,
        ..*step
    });
    Climb {
        steps: first.steps.iter().copied().chain(later).collect(),
        ..then
    }
}
