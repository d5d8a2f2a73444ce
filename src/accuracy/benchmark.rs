//! Measures methods one after another against a reference.

use super::bound::upper_bound;
use super::candidate::Candidate;
use super::error::AccuracyError;
use super::families::Families;
use super::reference::Reference;
use super::timing::timed;
use deaflow_base::{Interrupt, Progress};
use deaflow_fem::GeometryError;
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Patterns of several families with their reference solutions.
pub struct Benchmark {
    /// The scene.
    pub scene: Scene,
    /// The names of the families.
    pub families: Vec<String>,
    /// For each pattern, the index of its family.
    pub family: Vec<usize>,
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// The reference.
    pub reference: Reference,
    /// The reference solutions; `None` without a stable one.
    pub fields: Vec<Option<Field>>,
    /// The errors of their meshes, in mm.
    pub errors: Vec<f64>,
    /// Their errors of geometry, of all methods alike; `None` if elements follow all shapes.
    pub geometry: Option<Vec<GeometryError>>,
}

/// The errors and times of a method.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The settings.
    pub settings: String,
    /// Whether its fields are stable equilibria.
    pub equilibria: bool,
    /// The comparison on each pattern.
    pub patterns: Vec<Comparison>,
    /// The errors on each family.
    pub families: Vec<FamilyError>,
    /// Seconds of one core per pattern, for each family.
    pub seconds: Vec<f64>,
    /// The size of a batch, if the method was also timed on one, and the seconds of one core for it.
    pub batch: Option<(usize, f64)>,
}

/// The comparison of a method with the reference on one pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Comparison {
    /// Both have a field.
    Known {
        /// Root mean square over the components, mm.
        rms: f64,
        /// Largest displacement error over the corners, mm.
        max: f64,
    },
    /// Only the method has a field.
    Missed,
    /// Only the reference has a field.
    FalseAlarm,
    /// Neither has a field.
    BothNone,
}

/// The errors on the patterns of a family.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FamilyError {
    /// Root mean square over patterns and components, mm.
    pub rms: f64,
    /// Largest displacement error over patterns and corners, mm.
    pub max: f64,
    /// Upper bound of the error in mm, also for patterns that were not measured: for 99 % of them with 95 % confidence.
    /// It includes the errors of the reference and of geometry; infinite if the latter is unknown.
    pub bound: f64,
    /// Patterns that count as [`Comparison::Known`].
    pub known: u64,
    /// Patterns that count as [`Comparison::Missed`].
    pub missed: u64,
    /// Patterns that count as [`Comparison::FalseAlarm`].
    pub false_alarms: u64,
}

impl Benchmark {
    /// Solves patterns by a reference. `drawings` are those of the first family as drawn, where cells stand for shapes.
    /// Progress counts patterns.
    ///
    /// # Errors
    /// When the reference cannot be set up.
    pub fn new(
        scene: Scene,
        reference: Reference,
        families: Families,
        drawings: &[Pattern],
        progress: &dyn Progress,
    ) -> Result<Self, AccuracyError> {
        let names = families.keys().cloned().collect();
        let each = families.into_values().enumerate();
        let (family, patterns): (Vec<usize>, Vec<Pattern>) = each
            .flat_map(|(k, patterns)| patterns.into_iter().map(move |pattern| (k, pattern)))
            .unzip();
        let (fields, errors) = reference.solve(&scene, &patterns, progress)?;
        let geometry = reference.geometry_errors(&scene, &patterns, drawings)?;
        Ok(Self {
            scene,
            families: names,
            family,
            patterns,
            reference,
            fields,
            errors,
            geometry,
        })
    }

    /// Returns the indices of the patterns of a family.
    fn members(&self, family: usize) -> Vec<usize> {
        (0..self.patterns.len()).filter(|&i| self.family[i] == family).collect()
    }

    /// Returns the number of patterns of a family, and the number of those without a stable solution.
    #[must_use]
    pub fn counts(&self, family: usize) -> [usize; 2] {
        let members = self.members(family);
        let unstable = members.iter().filter(|&&i| self.fields[i].is_none()).count();
        [members.len(), unstable]
    }

    /// Returns the largest error of geometry on the stable patterns of a family in mm; infinite if one is unknown, and
    /// `None` if elements follow all shapes.
    #[must_use]
    pub fn geometry_error(&self, family: usize) -> Option<f64> {
        let errors = self.geometry.as_ref()?;
        let stable = self.members(family).into_iter().filter(|&i| self.fields[i].is_some());
        let each = stable.map(|i| errors[i].mm().unwrap_or(f64::INFINITY));
        Some(each.fold(0.0, f64::max))
    }

    /// Returns the largest error of the mesh that the reference may have on the patterns of a family, in mm.
    #[must_use]
    pub fn reference_error(&self, family: usize) -> f64 {
        let members = self.members(family);
        members.iter().map(|&i| self.errors[i]).fold(0.0, f64::max)
    }

    /// Measures each method in turn, on one thread, so that times are those of one core. Progress counts methods. An
    /// interrupt of this thread ends the measurements; they are then without meaning.
    ///
    /// # Errors
    /// When a method is not coarser than the reference, or cannot be evaluated.
    pub fn measure(&self, candidates: &[&Candidate], progress: &dyn Progress) -> Result<Vec<Measured>, AccuracyError> {
        self.reference.check(candidates.iter().copied())?;
        let interrupt = Interrupt::watched();
        let watch = move |_| interrupt.clone().into_iter().for_each(Interrupt::watch);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .start_handler(watch)
            .build()?;
        candidates
            .iter()
            .map(|candidate| {
                let measured = pool.install(|| self.measure_one(candidate, progress));
                progress.advance(1);
                measured.map_err(|why| why.of(candidate.settings()))
            })
            .collect()
    }

    /// Returns every measured time with its name.
    #[must_use]
    pub fn measurements(&self, measured: &[Measured]) -> Vec<(String, f64)> {
        let of_method = |method: &Measured| {
            let pairs = self.families.iter().zip(&method.seconds);
            let named = pairs.map(|(family, seconds)| (measurement(&method.settings, family), *seconds));
            let batch = method
                .batch
                .map(|(size, seconds)| (measurement(&method.settings, &format!("{size} patterns")), seconds));
            named.chain(batch).collect::<Vec<_>>()
        };
        measured.iter().flat_map(of_method).collect()
    }

    fn measure_one(&self, candidate: &Candidate, progress: &dyn Progress) -> Result<Measured, AccuracyError> {
        let evaluator = candidate.prepare(&self.scene, self.reference.settings().time())?;
        let mut patterns = vec![Comparison::BothNone; self.patterns.len()];
        let (mut families, mut seconds) = (Vec::new(), Vec::new());
        for family in 0..self.families.len() {
            let members = self.members(family);
            let own: Vec<Pattern> = members.iter().map(|&i| self.patterns[i].clone()).collect();
            let (fields, taken) = timed(|| evaluator.predict_some(&own))?;
            for (&i, field) in members.iter().zip(&fields) {
                patterns[i] = compare(field.as_ref(), self.fields[i].as_ref());
            }
            let errors: Vec<Comparison> = members.iter().map(|&i| patterns[i]).collect();
            families.push(of_family(
                &errors,
                evaluator.promised_error_mm(),
                self.reference_error(family),
                self.geometry_error(family),
            ));
            seconds.push(taken / own.len() as f64);
            progress.part((family + 1) as f64 / (self.families.len() + 1) as f64);
        }
        let batch = evaluator.batch().filter(|_| !self.patterns.is_empty());
        let batch = batch.map(|size| {
            let many: Vec<Pattern> = self.patterns.iter().cycle().take(size).cloned().collect();
            timed(|| evaluator.predict_some(&many)).map(|(_, seconds)| (size, seconds))
        });
        Ok(Measured {
            batch: batch.transpose()?,
            settings: candidate.settings(),
            equilibria: evaluator.finds_equilibria(),
            patterns,
            families,
            seconds,
        })
    }
}

/// Returns the name for the seconds per pattern of a method on a family.
#[must_use]
pub fn measurement(settings: &str, family: &str) -> String {
    format!("{settings}; {family}")
}

impl Comparison {
    /// Returns the root mean square and the largest error in mm, if known.
    #[must_use]
    pub fn known(&self) -> Option<(f64, f64)> {
        match *self {
            Self::Known { rms, max } => Some((rms, max)),
            Self::Missed | Self::FalseAlarm | Self::BothNone => None,
        }
    }
}

impl Measured {
    /// Returns the name of the network, if the method is one.
    #[must_use]
    pub fn network(&self) -> Option<&str> {
        self.settings.strip_prefix("network: ")
    }

    /// Returns the root mean square over the families in mm, with equal weights.
    #[must_use]
    pub fn rms(&self) -> f64 {
        let squares: f64 = self.families.iter().map(|family| family.rms.powi(2)).sum();
        (squares / self.families.len().max(1) as f64).sqrt()
    }

    /// Returns the largest value over the families.
    #[must_use]
    pub fn largest(&self, value: fn(&FamilyError) -> f64) -> f64 {
        self.families.iter().map(value).fold(0.0, f64::max)
    }

    /// Returns the mean over the families of the seconds of one core per pattern.
    #[must_use]
    pub fn seconds_per_pattern(&self) -> f64 {
        self.seconds.iter().sum::<f64>() / self.seconds.len().max(1) as f64
    }

    /// Returns the number of patterns with a known error.
    #[must_use]
    pub fn known(&self) -> u64 {
        self.families.iter().map(|family| family.known).sum()
    }

    /// Returns the number of patterns for which only one of method and reference has a field.
    #[must_use]
    pub fn mismatches(&self) -> u64 {
        self.families.iter().map(|f| f.missed + f.false_alarms).sum()
    }
}

fn compare(found: Option<&Field>, reference: Option<&Field>) -> Comparison {
    match (found, reference) {
        (Some(found), Some(reference)) => Comparison::Known {
            rms: found.rms_difference(reference),
            max: found.max_difference(reference),
        },
        (Some(_), None) => Comparison::Missed,
        (None, Some(_)) => Comparison::FalseAlarm,
        (None, None) => Comparison::BothNone,
    }
}

/// The bound of a method that estimates its own error is that estimate, as long as no measured error exceeds it. The
/// error of geometry comes in addition.
fn of_family(
    errors: &[Comparison],
    promise_mm: Option<f64>,
    reference_error: f64,
    geometry_error: Option<f64>,
) -> FamilyError {
    let known: Vec<(f64, f64)> = errors.iter().filter_map(Comparison::known).collect();
    let largest: Vec<f64> = known.iter().map(|(_, max)| *max).collect();
    let max = largest.iter().copied().fold(0.0, f64::max);
    let bound = match promise_mm {
        Some(promise) if max <= promise => promise,
        _ => upper_bound(&largest) + reference_error,
    };
    // The sum of an empty list is −0.
    let squares = known.iter().fold(0.0, |sum, (rms, _)| sum + rms.powi(2));
    let count = |kind: Comparison| errors.iter().filter(|error| **error == kind).count() as u64;
    FamilyError {
        rms: (squares / known.len().max(1) as f64).sqrt(),
        max,
        bound: bound + geometry_error.unwrap_or_default(),
        known: known.len() as u64,
        missed: count(Comparison::Missed),
        false_alarms: count(Comparison::FalseAlarm),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn errors_are_those_of_the_difference_and_disagreements_are_counted() {
        let field = |u: f64| {
            let mut values = vec![0.0; 51 * 51 * 2];
            values[..2].copy_from_slice(&[3.0 * u, 4.0 * u]);
            Field::from_values(Raster::PAPER, values).unwrap()
        };
        let error = compare(Some(&field(0.1)), Some(&field(0.0)));
        let (rms, max) = error.known().unwrap();
        assert!((max - 0.5).abs() < 1e-15 && (rms - 0.5 / (51.0 * 51.0 * 2.0_f64).sqrt()).abs() < 1e-15);
        let some = field(0.0);
        let all = [
            error,
            compare(Some(&some), None),
            compare(None, Some(&some)),
            compare(None, None),
        ];
        let family = of_family(&all, None, 0.125, None);
        assert_eq!((family.known, family.missed, family.false_alarms), (1, 1, 1));
        assert_eq!(family.max, 0.5);
        assert_eq!(family.bound, 0.625, "one error says nothing about others");
        let bound = |promise, geometry| of_family(&all, Some(promise), 0.125, geometry).bound;
        assert_eq!(bound(0.75, None), 0.75, "a promise that is kept");
        assert_eq!(bound(0.25, None), 0.625, "a promise that is broken");
        assert_eq!(bound(0.75, Some(0.5)), 1.25, "no mesh reduces an error of geometry");
        assert_eq!(bound(0.25, Some(f64::INFINITY)), f64::INFINITY);
    }
}
