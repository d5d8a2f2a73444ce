//! Where the electric field of a pattern comes close to the breakdown field: in a state, and along a path.

use crate::results::breakdown;
use deaflow_fem::effects::breakdown_strength;
use deaflow_scene::Scene;

/// Warns of an electric field in a state of a pattern, which has a name, that is close to the breakdown field or
/// exceeds it.
pub fn warning(scene: &Scene, name: &str, ratio: f64) -> Option<String> {
    let assumed = match breakdown_strength(scene) {
        Some(_) => "",
        None => " (Huang's law assumed)",
    };
    breakdown(ratio).map(|words| format!("{name}: {words}{assumed}"))
}

/// E/E_B at the points of a path, 0 where the state is not stable.
pub struct FieldAlongPath(pub Vec<f64>);

/// Where the electric field reaches the breakdown field, between two points of a path.
pub struct BreakdownPlace {
    points: [usize; 2],
    /// The share of the way from the first of them.
    part: f64,
}

impl BreakdownPlace {
    /// Returns a value there, given that at points.
    pub fn between(&self, value: impl Fn(usize) -> f64) -> f64 {
        let [from, to] = self.points.map(value);
        from + self.part * (to - from)
    }
}

impl FieldAlongPath {
    /// Returns where the field first reaches the breakdown field; `None` if it stays below.
    pub fn reached(&self) -> Option<BreakdownPlace> {
        let ratios = &self.0;
        let at = ratios.iter().position(|ratio| *ratio >= 1.0)?;
        let points = [at.saturating_sub(1), at];
        let step = ratios[points[1]] - ratios[points[0]];
        Some(BreakdownPlace {
            points,
            part: match step > 0.0 {
                true => (1.0 - ratios[points[0]]) / step,
                false => 0.0,
            },
        })
    }

    /// Warns of a field that is close to the breakdown field or exceeds it. `at` describes a place on the path, which
    /// may end by a loss of stability.
    pub fn warning(
        &self,
        scene: &Scene,
        index: usize,
        at: impl Fn(&BreakdownPlace) -> String,
        is_lost: bool,
    ) -> Option<String> {
        let largest = self.0.iter().copied().fold(0.0, f64::max);
        let Some(reached) = self.reached() else {
            return warning(scene, &format!("pattern {index}"), largest);
        };
        let from = at(&reached);
        let before = if is_lost { ", before the loss of stability" } else { "" };
        let assumed = match breakdown_strength(scene) {
            Some(_) => "",
            None => ", Huang's law assumed",
        };
        Some(format!(
            "pattern {index}: from {from} on the electric field exceeds the breakdown field{before} (E/E_B up to \
             {largest:.2}{assumed})"
        ))
    }
}
