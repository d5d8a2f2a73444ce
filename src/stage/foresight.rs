//! Checks of the scenes of stages that simulate, done before a run.

use super::checked_scene;
use deaflow_base::Node;
use deaflow_fem::{FIRST_LOST, MOST_LOST, Method, covered_limit};
use deaflow_orchestrator::{StageCheck, StageDeclaration};
use deaflow_scene::Scene;

/// What is foreseen of a stage that simulates patterns: what is said of its drive, and whether most of them will be lost.
pub fn of_simulations(stage: &StageDeclaration<'_>) -> StageCheck {
    let scene = scene_of(stage);
    let found = scene.as_ref().and_then(stability);
    // An estimate does not look for what is stable.
    let method = stage.node.peek("method").and_then(|node| node.text("method").ok());
    let finds_out = method.is_none_or(|method| method == Method::Newton.to_string());
    // An accuracy asks finer meshes itself.
    let has_one_mesh = finds_out && stage.node.peek("accuracy").is_none();
    let is_lost = finds_out && found.as_ref().is_some_and(|found| found.is_lost);
    let warning = match found {
        Some(found) => Some(found.warning),
        None => {
            let near = || scene.as_ref().filter(|_| has_one_mesh).and_then(near);
            scene.as_ref().and_then(of_no_drive).or_else(near)
        }
    };
    StageCheck {
        mostly_unstable: is_lost,
        warnings: warning.into_iter().collect(),
        ..StageCheck::default()
    }
}

/// What is said of a drive beyond the voltage at which membranes lose stability; nothing where it is surely below.
///
/// A scene that cannot be read or simulated has been refused by then, so nothing is said of it here.
pub fn of_stability(stage: &StageDeclaration<'_>) -> Option<String> {
    scene_of(stage).as_ref().and_then(stability).map(|found| found.warning)
}

/// What is known of a drive by which patterns may be lost.
struct Beyond {
    warning: String,
    /// Whether most are.
    is_lost: bool,
}

/// What is said of a scene that nothing drives.
fn of_no_drive(scene: &Scene) -> Option<String> {
    let drive = &scene.drive;
    let is_driven =
        scene.voltage_v() > 0.0 || drive.charge.is_some() || drive.waveform.is_some() || drive.source.is_some();
    let moves = is_driven || scene.geometry.has_forces();
    (!moves).then(|| {
        "the voltage is 0 V: nothing moves, so networks cannot be trained and designs cannot be compared".to_owned()
    })
}

/// What is said of a voltage that moves next to nothing: most likely a number without its unit.
pub fn of_faint_drive(scene: &Scene) -> Option<String> {
    let volts = scene.voltage_v();
    let limit = covered_limit(scene, FAR).ok().flatten()?;
    (volts < FAINT * limit).then(|| {
        format!(
            "{volts} V causes almost no displacement; a fully covered membrane is stable up to {}. A number without a unit is in V",
            kilovolts(limit)
        )
    })
}

/// The scene of a stage, in its state or at the largest voltages of any.
fn scene_of(stage: &StageDeclaration<'_>) -> Option<Scene> {
    let scene = checked_scene(stage.scene?).ok()?;
    let state = stage.node.peek(super::STATE);
    match state.and_then(|node: &Node| node.text(super::STATE).ok()) {
        Some(name) => scene.in_state(name).ok(),
        None => Some(scene.at_largest_voltages()),
    }
}

fn stability(scene: &Scene) -> Option<Beyond> {
    let faint = || {
        let warning = of_faint_drive(scene)?;
        Some(Beyond {
            warning,
            is_lost: false,
        })
    };
    beyond(scene).or_else(faint)
}

/// What makes patterns of a scene stable of which none is.
pub fn advice(scene: &Scene) -> String {
    let known = match covered_limit(scene, 1.0 / FIRST_LOST) {
        Ok(Some(limit)) => format!(
            ": single cells are lost above about {}, a membrane that is covered everywhere above {}",
            kilovolts(FIRST_LOST * limit),
            kilovolts(limit)
        ),
        Ok(None) | Err(_) => String::new(),
    };
    format!(
        "a lower voltage, a thicker or a stiffer membrane stays stable{known}; `deaflow screen` finds the voltage of one cell"
    )
}

/// The share of the voltage that a covered membrane bears below which next to nothing moves: displacements go with its square.
const FAINT: f64 = 0.01;

/// How far beyond a voltage that of a covered membrane is looked for.
const FAR: f64 = 1e5;

/// By which part of the voltage a coarse mesh may lose stability too late.
const TOO_LATE: f64 = 0.08;

/// What is said of a voltage at which patterns that one mesh finds stable may not be so on a finer one.
fn near(scene: &Scene) -> Option<String> {
    let first = FIRST_LOST * (1.0 - TOO_LATE);
    let limit = covered_limit(&reckoned(scene), 1.0 / first).ok()??;
    (scene.voltage_v() > first * limit).then(|| {
        format!(
            "at {} some patterns are next to the voltage at which they lose stability, single cells from about {} on, which one mesh finds a \
             little too high: `accuracy` in place of a mesh asks finer ones, and `effects.electromechanical_stability` tells how near each is",
            kilovolts(scene.voltage_v()),
            kilovolts(FIRST_LOST * limit)
        )
    })
}

/// The scene with what is reckoned with: chains that lock keep a membrane stable, so they are where they are turned on as they matter.
fn reckoned(scene: &Scene) -> Scene {
    if !scene.auto {
        return scene.clone();
    }
    let mut effects = scene.effects.clone();
    effects.strain_stiffening = scene.properties.strain_stiffening.clone();
    scene.with_effects(effects)
}

fn beyond(scene: &Scene) -> Option<Beyond> {
    let limit = covered_limit(&reckoned(scene), 1.0 / FIRST_LOST).ok()??;
    let (drive, limit_text) = (kilovolts(scene.voltage_v()), kilovolts(limit));
    let lowest = kilovolts(FIRST_LOST * limit);
    let model = if scene.auto {
        ", without what `effects: auto` may add"
    } else {
        ""
    };
    let most = MOST_LOST * limit;
    let most_text = kilovolts(most);
    let volts = scene.voltage_v();
    let is_lost = volts > most;
    let rest = "patterns that are unstable get no result, and to find that out takes many times as long as to solve; these voltages are \
                estimates: `deaflow screen` finds that of one cell on two meshes";
    let warning = if volts > limit {
        format!(
            "the voltage of {drive} is beyond what membranes bear: one that is covered everywhere is unstable above {limit_text}, \
             and patterns with bare parts from about {lowest} on, most from about {most_text}{model}; {rest}"
        )
    } else if is_lost {
        format!(
            "at {drive} most patterns are unstable: single cells are so above about {lowest}, large areas with straight edges above \
             {most_text}, and a membrane that is covered everywhere above {limit_text}{model}; {rest}"
        )
    } else {
        format!(
            "at {drive} some patterns may be unstable: single cells are so above about {lowest}, most patterns above {most_text}, one that is \
             covered everywhere above {limit_text}{model}; {rest}"
        )
    };
    Some(Beyond { warning, is_lost })
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
    fn a_voltage_without_its_unit_is_told_of() {
        let at = |volts: f64| of_faint_drive(&Scene::vhb4910().at_voltage(volts));
        let told = at(5.25).unwrap();
        assert!(
            told.starts_with("5.25 V causes almost no displacement")
                && told.ends_with("A number without a unit is in V"),
            "{told}"
        );
        assert_eq!((at(200.0), at(5250.0), at(0.0)), (None, None, None));
        let still = |volts: f64| of_no_drive(&Scene::vhb4910().at_voltage(volts));
        assert!(still(0.0).unwrap().starts_with("the voltage is 0 V: nothing moves"));
        assert_eq!(still(5.25), None);
    }

    #[test]
    fn what_is_said_depends_on_the_voltage() {
        // H12: √κ = √(λp⁻² + 3λp⁻⁸) is 10.98 kV here, and a single cell is lost at 6.1 kV.
        let at = |volts: f64| beyond(&Scene::vhb4910().at_voltage(volts));
        assert!(at(5250.0).is_none());
        let next_to_it = |volts: f64| near(&Scene::vhb4910().at_voltage(volts));
        assert!(next_to_it(5250.0).is_none());
        let said = next_to_it(5700.0).unwrap();
        assert!(
            said.starts_with("at 5.70 kV some patterns are next to") && said.contains("from about 5.93 kV on"),
            "{said}"
        );
        let told = |volts: f64, words: [&str; 2]| {
            let Beyond { warning, is_lost } = at(volts).unwrap();
            assert!(words.iter().all(|word| warning.contains(word)), "{warning}");
            is_lost
        };
        assert!(!told(
            6800.0,
            ["some patterns may be unstable", "most patterns above 7.38 kV"]
        ));
        assert!(told(
            9000.0,
            ["most patterns are unstable", "covered everywhere above 10.98 kV"]
        ));
        let Beyond {
            warning: above,
            is_lost,
        } = at(12e3).unwrap();
        assert!(is_lost);
        assert!(
            above.starts_with("the voltage of 12.00 kV is beyond") && above.contains("unstable above 10.98 kV"),
            "{above}"
        );
    }
}
