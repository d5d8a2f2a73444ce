//! Refinement of designs of the genetic algorithm by local search.

use super::found::Findings;
use super::{Search, SearchError};
use crate::local_search::LocalOptimum;
use deaflow_base::Stream;
use deaflow_pattern::{Pattern, Role};

/// A design is weak if its score is lower than the best by more than this share of the best and by more than this
/// score (0.5 µm).
const WEAK_SHARE: f64 = 0.008;
const WEAK_SCORE: f64 = 2e-4;

/// Number of perturbed patterns from which a replacement of a weak design is searched.
const PERTURBATIONS: u64 = 4;

/// A refined design with its member number.
type Refined = (usize, LocalOptimum);

impl Search<'_> {
    /// Adds the refined designs; each has the minimum distance from those before.
    pub(super) fn refine(&self, findings: &mut Findings) -> Result<(), SearchError> {
        let mut refined: Vec<Refined> = Vec::new();
        for found in &findings.patterns {
            let problem = self.problem(&patterns(refined.iter()))?;
            let optimum = problem.refine(&found.pattern, &self.report_step())?;
            self.progress.searched();
            match optimum {
                Ok(optimum) => refined.push((found.member, optimum)),
                // Later designs may fail; the status then reports that there are fewer.
                Err(_) if found.member > 0 => {}
                Err(why) => {
                    let target = self.target.name.clone();
                    return Err(SearchError::Refine { target, why });
                }
            }
        }
        for _ in 0..self.options.sweeps() {
            self.replace_weak_designs(&mut refined)?;
        }
        for (member, optimum) in refined {
            findings.add(Role::Refined, member, self.options.units, optimum);
        }
        Ok(())
    }

    /// Replaces weak designs by better ones from the neighbourhood of the best design.
    fn replace_weak_designs(&self, refined: &mut [Refined]) -> Result<(), SearchError> {
        let optima = refined.iter().map(|(_, optimum)| optimum);
        let leader = optima.reduce(|best, one| if one.score > best.score { one } else { best });
        let Some((best, leader)) = leader.map(|leader| (leader.score, leader.pattern.clone())) else {
            return Ok(());
        };
        for at in 0..refined.len() {
            if best - refined[at].1.score > (WEAK_SHARE * best.abs()).max(WEAK_SCORE) {
                self.replace(refined, at, &leader)?;
            }
            self.progress.searched();
        }
        Ok(())
    }

    /// Replaces a design by the best result from another design and perturbations of it, if that is better.
    fn replace(&self, refined: &mut [Refined], at: usize, leader: &Pattern) -> Result<(), SearchError> {
        let others = refined.iter().enumerate().filter(|(other, _)| *other != at);
        let problem = self.problem(&patterns(others.map(|(_, refined)| refined)))?;
        let mut starts = vec![leader.clone()];
        for draw in 0..PERTURBATIONS {
            let index = (refined[at].0 as u64) * PERTURBATIONS + draw;
            // The stream name determines the random numbers, and so the designs.
            let mut stream = Stream::new(self.options.seed.0, "spread design", index);
            starts.extend(problem.perturb(leader, &mut stream)?);
        }
        let found = self.best_of(&problem, &starts, &self.report_step(), &|| ())?;
        if let Some(optimum) = found.ok().filter(|optimum| optimum.score > refined[at].1.score) {
            refined[at].1 = optimum;
        }
        Ok(())
    }
}

fn patterns<'a>(refined: impl Iterator<Item = &'a Refined>) -> Vec<Pattern> {
    refined.map(|(_, optimum)| optimum.pattern.clone()).collect()
}
