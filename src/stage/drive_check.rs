//! Checks of the drive of a stage before a run: whether patterns are likely to be unstable, or hardly move.

use super::scene;
use deaflow_base::Node;
use deaflow_fem::{FIRST_UNSTABLE, MOST_UNSTABLE, Method, fully_active_limit};
use deaflow_orchestrator::{StageCheck, StageDeclaration};
use deaflow_scene::Scene;

/// Below this fraction of the voltage limit of a fully covered membrane displacements are negligible: they grow with
/// the square of the voltage.
const FAINT: f64 = 0.01;

/// The range, as a factor of the voltage, in which the limit of a fully covered membrane is searched for [`FAINT`].
const FAR: f64 = 1e5;

/// By which fraction of the voltage a coarse mesh may overestimate the stability limit.
const OVERESTIMATE: f64 = 0.08;

/// A drive at which patterns may be unstable.
struct Instability {
    warning: String,
    /// Whether most patterns are unstable.
    of_most: bool,
}

/// Checks the drive of a stage that simulates patterns.
pub fn check_simulations(stage: &StageDeclaration<'_>) -> StageCheck {
    let scene = scene_of(stage);
    let notes = scene.iter().flat_map(|scene| scene.geometry.notes());
    let found = scene.as_ref().and_then(instability);
    // Estimates do not detect instability.
    let method = stage.node.peek("method").and_then(|node| node.text("method").ok());
    let is_detected = method.is_none_or(|method| method == Method::Newton.to_string());
    // With `accuracy` finer meshes are used anyway.
    let has_one_mesh = is_detected && stage.node.peek("accuracy").is_none();
    let mostly_unstable = is_detected && found.as_ref().is_some_and(|found| found.of_most);
    let warning = match found {
        Some(found) => Some(found.warning),
        None => {
            let near = || scene.as_ref().filter(|_| has_one_mesh).and_then(near_limit_warning);
            scene.as_ref().and_then(no_drive_warning).or_else(near)
        }
    };
    StageCheck {
        mostly_unstable,
        warnings: warning.into_iter().chain(notes).collect(),
        ..StageCheck::default()
    }
}

/// Returns a warning if patterns may be unstable or hardly move at the drive of a stage. It ignores a scene that cannot
/// be read or simulated: such a scene has been refused before.
pub fn stability_warning(stage: &StageDeclaration<'_>) -> Option<String> {
    scene_of(stage)
        .as_ref()
        .and_then(instability)
        .map(|found| found.warning)
}

/// Returns a warning if the voltage causes almost no displacement: probably a number without its unit.
pub fn weak_drive_warning(scene: &Scene) -> Option<String> {
    let volts = scene.voltage_v();
    let limit = fully_active_limit(scene, FAR).ok().flatten()?;
    (volts < FAINT * limit).then(|| {
        format!(
            "{volts} V causes almost no displacement; a fully covered membrane is stable up to {}",
            kilovolts(limit)
        )
    })
}

/// Returns advice for a scene in which no pattern is stable.
pub fn stability_advice(scene: &Scene) -> String {
    if scene.is_in_space() {
        return "lower the voltage, the pressure or the volume, or use a thicker or stiffer membrane; `deaflow solve` \
                finds the largest load"
            .to_owned();
    }
    let limits = match fully_active_limit(scene, 1.0 / FIRST_UNSTABLE) {
        Ok(Some(limit)) => format!(
            ": single cells are unstable above about {}, a fully covered membrane above {}",
            kilovolts(FIRST_UNSTABLE * limit),
            kilovolts(limit)
        ),
        Ok(None) | Err(_) => String::new(),
    };
    format!(
        "lower the voltage, or use a thicker or stiffer membrane{limits}; `deaflow screen` computes the limit of one \
         cell. Where simulations end as work-limit, raise `time_limit` instead"
    )
}

/// Returns the scene of a stage in its state, or at the largest voltages of all states.
fn scene_of(stage: &StageDeclaration<'_>) -> Option<Scene> {
    // A pressure lowers the limits of voltages; they are estimates.
    let scene = scene::read(stage.scene?).ok()?.in_plane();
    let state = stage.node.peek(scene::STATE);
    match state.and_then(|node: &Node| node.text(scene::STATE).ok()) {
        Some(name) => scene.in_state(name).ok(),
        None => Some(scene.at_largest_voltages()),
    }
}

/// Returns a warning if nothing drives the membrane.
fn no_drive_warning(scene: &Scene) -> Option<String> {
    let drive = &scene.drive;
    let is_driven =
        scene.voltage_v() > 0.0 || drive.charge.is_some() || drive.waveform.is_some() || drive.source.is_some();
    let moves = is_driven || scene.geometry.has_forces();
    (!moves).then(|| {
        "the voltage is 0 V: nothing moves, so networks cannot be trained and designs cannot be compared".to_owned()
    })
}

/// Returns a warning if patterns that are stable on one mesh may be unstable on a finer one.
fn near_limit_warning(scene: &Scene) -> Option<String> {
    let first = FIRST_UNSTABLE * (1.0 - OVERESTIMATE);
    let limit = fully_active_limit(&with_stiffening(scene), 1.0 / first).ok()??;
    (scene.voltage_v() > first * limit).then(|| {
        format!(
            "at {} some patterns are close to their stability limit (single cells: about {}), which one mesh slightly \
             overestimates: set `accuracy` instead of a mesh to use finer ones; \
             `effects.electromechanical_stability` computes the limit of each pattern",
            kilovolts(scene.voltage_v()),
            kilovolts(FIRST_UNSTABLE * limit)
        )
    })
}

/// Returns the scene with strain stiffening if `effects: auto` may turn it on: it keeps membranes stable.
fn with_stiffening(scene: &Scene) -> Scene {
    if !scene.auto {
        return scene.clone();
    }
    let mut effects = scene.effects.clone();
    effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    scene.with_effects(effects)
}

fn instability(scene: &Scene) -> Option<Instability> {
    let weak = || {
        Some(Instability {
            warning: weak_drive_warning(scene)?,
            of_most: false,
        })
    };
    beyond_limit(scene).or_else(weak)
}

fn beyond_limit(scene: &Scene) -> Option<Instability> {
    let limit = fully_active_limit(&with_stiffening(scene), 1.0 / FIRST_UNSTABLE).ok()??;
    let volts = scene.voltage_v();
    let of_most = volts > MOST_UNSTABLE * limit;
    let what = match of_most {
        _ if volts > limit => "nearly all patterns are unstable",
        true => "most patterns are unstable",
        false => "some patterns may be unstable",
    };
    let model = match scene.auto {
        true => ", without the effects that `effects: auto` may turn on",
        false => "",
    };
    let warning = format!(
        "at {} {what}: single cells are unstable above about {}, most patterns above about {}, a fully covered \
         membrane above {}{model}. Unstable patterns get no result, and detecting the instability takes many times as \
         long as a solution. The voltages are estimates; `deaflow screen` computes the limit of one cell on two meshes",
        kilovolts(volts),
        kilovolts(FIRST_UNSTABLE * limit),
        kilovolts(MOST_UNSTABLE * limit),
        kilovolts(limit)
    );
    Some(Instability { warning, of_most })
}

fn kilovolts(volts: f64) -> String {
    match volts < 1000.0 {
        true => format!("{volts:.0} V"),
        false => format!("{:.2} kV", 1e-3 * volts),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voltage_without_its_unit_is_warned_of() {
        let at = |volts: f64| weak_drive_warning(&Scene::vhb4910().at_voltage(volts));
        let warning = at(5.25).unwrap();
        assert!(warning.contains("5.25 V") && warning.contains("10.98 kV"), "{warning}");
        assert_eq!((at(200.0), at(5250.0), at(0.0)), (None, None, None));
        let no_drive = |volts: f64| no_drive_warning(&Scene::vhb4910().at_voltage(volts));
        assert!(no_drive(0.0).is_some());
        assert_eq!(no_drive(5.25), None);
    }

    #[test]
    fn the_warning_depends_on_the_voltage() {
        // H12: √κ = √(λp⁻² + 3λp⁻⁸) is 10.98 kV here, and a single cell is lost at 6.1 kV.
        let at = |volts: f64| beyond_limit(&Scene::vhb4910().at_voltage(volts));
        assert!(at(5250.0).is_none());
        let near = |volts: f64| near_limit_warning(&Scene::vhb4910().at_voltage(volts));
        assert!(near(5250.0).is_none());
        let warning = near(5700.0).unwrap();
        assert!(warning.contains("5.70 kV") && warning.contains("5.93 kV"), "{warning}");
        for (volts, of_most, parts) in [
            (6800.0, false, ["6.80 kV some", "7.38 kV"]),
            (9000.0, true, ["9.00 kV most", "10.98 kV"]),
            (12e3, true, ["12.00 kV nearly all", "10.98 kV"]),
        ] {
            let found = at(volts).unwrap();
            assert_eq!(found.of_most, of_most);
            assert!(
                parts.iter().all(|part| found.warning.contains(part)),
                "{}",
                found.warning
            );
        }
    }
}
