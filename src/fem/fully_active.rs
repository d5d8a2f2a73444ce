//! The critical voltage of a fully active membrane, which needs no solution.
//!
//! A membrane that is held along its edge and active everywhere does not move at any voltage, because the stress of the
//! electrodes is uniform. Such a uniform state is stable exactly as long as the law is strongly elliptic there (van
//! Hove, Proc. K. Ned. Akad. Wet. 50 (1947) 18). With rigid bodies inside, stability is lost at that voltage at the
//! latest.

use super::effects::{Model, WithMaterial};
use super::error::SetupError;
use super::material::Material;
use super::sheet::Sheet;
use deaflow_scene::{Effects, Scene};

/// Lowest critical voltage of all patterns relative to that voltage: a single cell, at 0.29 to 0.30 of the load.
pub const FIRST_UNSTABLE: f64 = 0.54;

/// Critical voltage of large areas with straight edges relative to that voltage, at 0.45 of the load: most patterns are
/// unstable above it. It was computed for one half and for a square of 0.64 of the membrane (`deaflow solve --path`,
/// two meshes).
pub const MOST_UNSTABLE: f64 = 0.672;

/// Number of bisections, to the precision of a double.
const HALVINGS: usize = 52;

/// Finds the share of the load at which ellipticity is lost.
struct Lost {
    distortion: [f64; 2],
    /// Largest share to check.
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

/// Returns the critical voltage in V of a fully active membrane, if it is below `reach` times the voltage of the scene.
/// `None` if it is higher, the drive has no voltage, or the membrane can wrinkle. The effects are those that the scene
/// names.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn fully_active_limit(scene: &Scene, reach: f64) -> Result<Option<f64>, SetupError> {
    if scene.geometry.sides.is_some() {
        return Ok(None);
    }
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

/// Returns a voltage in V at which no pattern is stable, if it is below `reach` times the voltage of the scene: that of
/// a fully active membrane. `None` also for scenes in which other patterns might be stable at a higher voltage.
///
/// Along a stable path from rest ∫J² over the electrodes grows with the voltage, so they have a point with J ≥ J₀, the
/// area stretch at rest. A neo-Hookean membrane is strongly elliptic at a point as long as εE² < μ/σ² + 3μ/J⁴, where the
/// larger stretch σ has σ² ≥ J and E is the field per undeformed thickness. At that point the bound is at most μ/J₀ +
/// 3μ/J₀⁴, which is the bound of the fully active membrane with equal prestretches.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn no_pattern_limit(scene: &Scene, reach: f64) -> Result<Option<f64>, SetupError> {
    let drive = &scene.drive;
    let changes_in_time = drive.waveform.is_some() || drive.source.is_some();
    let [along, across] = scene.prestretch();
    // These effects only compare and report.
    let effects = Effects {
        dielectric_breakdown: None,
        electromechanical_stability: None,
        ..scene.effects.clone()
    };
    let is_base_model = effects.is_empty() && !scene.auto && !scene.geometry.has_forces();
    match is_base_model && along == across && !changes_in_time {
        true => fully_active_limit(scene, reach),
        false => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_of_a_fully_active_membrane_is_the_closed_form() {
        // H12: √κ = √(λp⁻² + 3λp⁻⁸), and κ grows with V².
        let scene = Scene::vhb4910().at_voltage(1000.0);
        let lambda: f64 = 3.0;
        let critical = lambda.powi(-2) + 3.0 * lambda.powi(-8);
        let expected = 1000.0 * (critical / scene.kappa()).sqrt();
        let found = fully_active_limit(&scene, 20.0).unwrap().unwrap();
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        // From above it is the same; from far below, nothing is found.
        let above = fully_active_limit(&scene.at_voltage(2.0 * expected), 1.0)
            .unwrap()
            .unwrap();
        assert!((above / expected - 1.0).abs() < 1e-9, "{above}");
        assert_eq!(fully_active_limit(&scene.at_voltage(0.9 * expected), 1.0), Ok(None));
        assert_eq!(fully_active_limit(&scene.at_voltage(0.0), 20.0), Ok(None));
    }
}
