//! The gradient search from several start patterns.

use super::finished::{Ended, Finished, Followed};
use super::found::Findings;
use super::{Search, SearchError, SearchResult};
use crate::genome::{Genome, Units};
use crate::local_search::{LocalOptimum, SearchProblem, SearchStep, StartError};
use deaflow_base::Stream;
use deaflow_pattern::{Pattern, PatternForm, Role};

/// The grain of random start patterns: a handful of regions.
const START_GRAIN: usize = 6;

/// Number of the best results that are refined by exchanges.
const REFINED: usize = 2;

impl Search<'_> {
    pub(super) fn along_gradient(&self) -> Result<SearchResult, SearchError> {
        let elements = self.elements.gradient()?;
        let mut findings = Findings::default();
        let (starts, on_step) = (self.starts(), self.report_step());
        let form = PatternForm::of_square_cells(self.target.goal.raster(), self.constraints.groups());
        let finished = Finished::resumed(self.progress, form);
        let mut optima: Vec<Pattern> = Vec::new();
        for member in 0..self.options.designs {
            let problem = self.problem(&optima)?;
            let follow = |start: &Pattern| finished.or_else(|| followed(&problem, start, &on_step));
            let best = best_refined(&problem, &starts, &follow, &on_step)?;
            self.progress.searched();
            let best = match best {
                Ok(best) => best,
                Err(_) if member > 0 => break,
                Err(why) => return Err(self.no_start(why)),
            };
            optima.push(best.pattern.clone());
            findings.add(Role::Optimum, member, self.options.units, best);
        }
        self.result(self.elements.settings(), elements, findings, Vec::new())
    }

    /// The best local optimum from several starts. `on_step` is called after each step, `searched` after each start,
    /// and at the end.
    pub(super) fn best_of(
        &self,
        problem: &SearchProblem<'_>,
        starts: &[Pattern],
        on_step: &dyn Fn(&SearchStep),
        searched: &dyn Fn(),
    ) -> Result<Result<LocalOptimum, StartError>, SearchError> {
        let follow = |start: &Pattern| {
            let ended = followed(problem, start, on_step)?;
            searched();
            Ok(ended)
        };
        let best = best_refined(problem, starts, &follow, on_step)?;
        searched();
        Ok(best)
    }

    /// The start patterns: the intuitive design, an empty membrane, and random coarse patterns.
    pub(super) fn starts(&self) -> Vec<Pattern> {
        let (area, raster) = (self.target.area.fraction(), self.target.goal.raster());
        let drawn = |index: usize| match index {
            0 => self.intuitive_start(),
            1 => Pattern::from_fn(raster, |_, _| false),
            _ => {
                // The stream name determines the random numbers, and so the designs.
                let mut stream = Stream::new(self.options.seed.0, "start of a climb", index as u64);
                let area = area.unwrap_or_else(|| stream.uniform());
                let groups = self.constraints.groups();
                Genome::random_within(&Units::all(), area, groups, START_GRAIN, &mut stream).pattern(raster)
            }
        };
        (0..self.options.starts).map(drawn).collect()
    }
}

/// Follows the gradient from a start.
fn followed(problem: &SearchProblem<'_>, start: &Pattern, on_step: &dyn Fn(&SearchStep)) -> Result<Ended, SearchError> {
    Ok(problem.follow_gradient(start, on_step)?.map(Followed::from))
}

/// The best local optimum from several starts: the gradient is followed from all of them by `follow`, and the best
/// results are refined by exchanges. `on_step` is called after each step of these.
fn best_refined(
    problem: &SearchProblem<'_>,
    starts: &[Pattern],
    follow: &dyn Fn(&Pattern) -> Result<Ended, SearchError>,
    on_step: &dyn Fn(&SearchStep),
) -> Result<Result<LocalOptimum, StartError>, SearchError> {
    let (mut followed, mut why) = (Vec::<Followed>::new(), StartError::NoPattern);
    for start in starts {
        match follow(start)? {
            Ok(optimum) => followed.push(optimum),
            Err(StartError::NoField) => why = StartError::NoField,
            Err(StartError::NoPattern) => {}
        }
    }
    // Several starts may lead to the same pattern.
    followed.sort_by(|a, b| b.score.total_cmp(&a.score));
    followed.dedup_by(|a, b| a.pattern == b.pattern);
    followed.truncate(REFINED);
    let mut best: Option<LocalOptimum> = None;
    for first in followed {
        let then = problem.refine(&first.pattern, on_step)?.ok();
        let joined = then.map(|then| joined(first, then));
        best = best
            .into_iter()
            .chain(joined)
            .reduce(|a, b| if b.score > a.score { b } else { a });
    }
    Ok(best.ok_or(why))
}

/// Joins the steps of a local search and its continuation.
fn joined(first: Followed, then: LocalOptimum) -> LocalOptimum {
    let before = first.steps.last().map_or(0, |step| step.simulations);
    let later = then.steps.iter().skip(1).map(|step| SearchStep {
        simulations: before + step.simulations,
        ..*step
    });
    LocalOptimum {
        steps: first.steps.iter().copied().chain(later).collect(),
        ..then
    }
}
