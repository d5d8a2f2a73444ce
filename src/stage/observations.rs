//! What effects say beside the displacement, as datasets: one for each effect that is on, none for those that are off.

use super::arrays;
use crate::field::Observation;
use crate::pattern::CELLS;
use crate::scene::Effects;
use crate::store::{Data, Dataset, Object};

/// The datasets for some samples; `None` where a sample has no solution, which becomes NaN.
pub fn datasets(effects: &Effects, observations: &[Option<&Observation>]) -> Vec<(&'static str, Dataset)> {
    let reals = |value: &dyn Fn(&Observation) -> Option<f64>| -> Vec<f64> {
        let value = |o: &Option<&Observation>| o.and_then(value).unwrap_or(f64::NAN);
        observations.iter().map(value).collect()
    };
    let mut found = Vec::new();
    if effects.dielectric_breakdown.is_some() {
        let note = "largest true field over the breakdown field, E/E_B; the membrane fails at 1";
        found.push((
            "breakdown_ratio",
            arrays::reals("1", note, reals(&|o| o.breakdown_ratio)),
        ));
    }
    if effects.wrinkling {
        found.push(("wrinkling", cells(observations)));
        let note = "part of the membrane whose cells are wrinkled or slack";
        found.push(("wrinkled_fraction", arrays::reals("1", note, reals(&wrinkled))));
    }
    if effects.electromechanical_stability {
        let note = "smallest eigenvalue of the tangent relative to the Laplacian; zero where stability is lost";
        found.push((
            "smallest_eigenvalue",
            arrays::reals("1", note, reals(&|o| o.smallest_eigenvalue)),
        ));
        found.push(("critical_voltage", critical(observations)));
    }
    found
}

fn wrinkled(observation: &Observation) -> Option<f64> {
    let tension = observation.tension.as_ref()?;
    let wrinkled = tension.iter().filter(|&&code| code > 0).count();
    Some(wrinkled as f64 / tension.len() as f64)
}

/// No state of a cell has this number.
const UNKNOWN: u8 = 255;

fn cells(observations: &[Option<&Observation>]) -> Dataset {
    let note = "how each cell bears its load [sample][y][x]: 0 taut, 1 wrinkled, 2 slack, 255 no stable solution";
    let unknown = vec![UNKNOWN; CELLS * CELLS];
    let codes = observations.iter().flat_map(|observation| {
        let tension = observation.and_then(|o| o.tension.as_ref());
        tension.unwrap_or(&unknown).iter().copied()
    });
    let codes = codes.collect();
    Dataset::new("1", note, &[observations.len(), CELLS, CELLS], Data::U8(codes))
}

fn critical(observations: &[Option<&Observation>]) -> Dataset {
    let note = "voltages between which stability is lost; 0, 0 where it is not lost up to 3 times the limit of a fully active membrane";
    let bracket = |o: &Option<&Observation>| o.and_then(|o| o.critical_voltage).unwrap_or_default();
    let values = observations.iter().flat_map(bracket).collect();
    Dataset::new("V", note, &[observations.len(), 2], Data::F64(values))
}

/// An object with the datasets of some samples.
pub fn add(object: Object, effects: &Effects, observations: &[Option<&Observation>]) -> Object {
    let datasets = datasets(effects, observations).into_iter();
    datasets.fold(object, |object, (path, dataset)| object.with(path, dataset))
}
