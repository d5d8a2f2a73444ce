//! The voltage at which a membrane that is covered everywhere loses stability, which no solution is needed for.
//!
//! Held along its edge and covered everywhere, a membrane does not move, whatever the voltage, since the stress of the electrodes is the
//! same everywhere. Such a uniform state is stable as long as the law is strongly elliptic there, and no longer (van Hove, Proc. K. Ned.
//! Akad. Wet. 50 (1947) 18). Rigid bodies inside give way, so that with them stability is lost at that voltage at the latest.

use super::effects::{Model, WithMaterial};
use super::error::SetupError;
use super::material::Material;
use super::sheet::Sheet;
use deaflow_scene::Scene;

/// The share of that voltage from which on other patterns lose stability: a single cell, which goes first, at 0.29 to 0.30 of the load.
pub const FIRST_LOST: f64 = 0.54;

/// The share from which on most are lost: those of large areas with straight edges, which bear most of those with bare parts, go at 0.45 of the
/// load. It is that of one half, and of a square of 0.64 of the membrane (`deaflow solve --path`, two meshes).
pub const MOST_LOST: f64 = 0.672;

/// Halvings of the interval of loads: as far as a double tells them apart.
const HALVINGS: usize = 52;

/// The load at which ellipticity is lost, in units of that of the scene.
struct Lost {
    distortion: [f64; 2],
    /// The largest load that is looked at.
    most: f64,
}

impl WithMaterial for Lost {
    type Output = Option<f64>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<f64> {
        let [along, across] = self.distortion;
        let is_lost = |share: f64| material(share).ellipticity([[along, 0.0], [0.0, across]], 1.0) <= 0.0;
        if material(0.0).wrinkles() || !is_lost(self.most) {
            return None;
        }
        let [mut stable, mut lost] = [0.0, self.most];
        for _ in 0..HALVINGS {
            let middle = 0.5 * (stable + lost);
            *(if is_lost(middle) { &mut lost } else { &mut stable }) = middle;
        }
        Some(stable)
    }
}

/// The voltage in V at which a membrane that is covered everywhere loses stability, where that is less than `reach` times the voltage of the
/// scene; `None` where it is more, nothing is driven by a voltage, or the membrane wrinkles. Effects are those that the scene names.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn covered_limit(scene: &Scene, reach: f64) -> Result<Option<f64>, SetupError> {
    let voltage = scene.voltage_v();
    if scene.drive.charge.is_some() || voltage <= 0.0 {
        return Ok(None);
    }
    let lost = Lost {
        distortion: Sheet::of(scene).distortion(),
        most: reach * reach,
    };
    let share = Model::new(scene)?.with(lost);
    Ok(share.map(|share| voltage * share.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_covered_membrane_is_lost_where_the_closed_form_says() {
        // H12: √κ = √(λp⁻² + 3λp⁻⁸), and κ grows with V².
        let scene = Scene::vhb4910().at_voltage(1000.0);
        let lambda: f64 = 3.0;
        let critical = lambda.powi(-2) + 3.0 * lambda.powi(-8);
        let expected = 1000.0 * (critical / scene.kappa()).sqrt();
        let found = covered_limit(&scene, 20.0).unwrap().unwrap();
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        // The same from above, and nothing from far below.
        let above = covered_limit(&scene.at_voltage(2.0 * expected), 1.0).unwrap().unwrap();
        assert!((above / expected - 1.0).abs() < 1e-9, "{above}");
        assert_eq!(covered_limit(&scene.at_voltage(0.9 * expected), 1.0), Ok(None));
        assert_eq!(covered_limit(&scene.at_voltage(0.0), 20.0), Ok(None));
    }
}
