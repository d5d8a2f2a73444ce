//! A design that moves as the voltage rises.

use maud::{Markup, html};

use super::cards::drawing_with;
use crate::designs::Design;
use crate::drawing::{DeformedMembrane, exaggeration};
use crate::format::three;
use deaflow_field::Field;

/// A design at rising voltages.
#[derive(Clone, Debug)]
pub struct VoltageSweep {
    /// Name of the design.
    pub design: String,
    /// The voltage of the scene in V.
    pub voltage: f64,
    /// Voltages in V from 0, each with the displacement from the mount in mm.
    pub states: Vec<(f64, Field)>,
    /// What happens at the last voltage.
    pub end: SweepEnd,
}

/// What happens at the last voltage of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SweepEnd {
    /// Nothing: it is the voltage of the scene.
    Scene,
    /// The electric field reaches the breakdown field.
    Breakdown,
    /// Stability is lost.
    Limit,
}

/// Duration of the animation, in seconds.
const SECONDS: u32 = 6;
/// Shares of the duration after which the last voltage is reached, and until which it stays.
const REACHED: f64 = 0.6;
const STAYS: f64 = 0.85;

/// Height of the bar of the voltage, in thousandths of the longer side.
const BELOW: f64 = 50.0;

/// Draws the design as it moves, with the voltage as a bar below, and describes it; `None` if the sweep is of another
/// design.
pub fn moving(design: &Design, sweep: Option<&VoltageSweep>) -> Option<(Markup, String)> {
    let sweep = sweep.filter(|sweep| sweep.design == design.name)?;
    let (last, _) = sweep.states.last().filter(|(volts, _)| *volts > 0.0)?;
    let membranes: Option<Vec<DeformedMembrane>> = sweep.states.iter().map(|(_, field)| design.with(field)).collect();
    let membranes = membranes?;
    let scale = exaggeration(&membranes);
    let rise = sweep.states.iter().map(|(volts, _)| REACHED * volts / last);
    let times: Vec<String> = rise.chain([STAYS, 1.0]).map(|time| format!("{time:.3}")).collect();
    let times = times.join(";");
    // Up, a rest, and back.
    let along = |of: &dyn Fn(usize) -> String| -> Vec<String> {
        let end = sweep.states.len() - 1;
        (0..=end).chain([end, 0]).map(of).collect()
    };
    let animated = |name: &str, values: &[String]| {
        html! {
            animate attributeName=(name) dur={ (SECONDS) "s" } repeatCount="indefinite" keyTimes=(times)
                values=(values.join(";")) {}
        }
    };
    let paths: Vec<Vec<(&str, String)>> = membranes.iter().map(|membrane| membrane.steady_paths(scale)).collect();
    let along_bar = |volts: f64| format!("{:.0}", 1000.0 * volts / last);
    let at = |state: usize| along_bar(sweep.states[state].0);
    let points: Vec<Vec<(f64, f64)>> = membranes.iter().map(|membrane| membrane.moved_points(scale)).collect();
    let coordinate = |point: usize, axis: usize| {
        along(&|state| {
            let (x, y) = points[state][point];
            format!("{:.0}", [x, y][axis])
        })
    };
    let [_, top, _, height] = design.background.view();
    let bar = (top + height + 0.5 * BELOW).round();
    let content = html! {
        @for part in 0..paths[0].len() {
            @let values = along(&|state| paths[state][part].1.clone());
            path class=(paths[0][part].0) d=(paths[paths.len() - 1][part].1) { (animated("d", &values)) }
        }
        @for point in 0..points[0].len() {
            @let (x, y) = points[points.len() - 1][point];
            circle class="point" cx={ (x.round()) } cy={ (y.round()) } r="13" {
                (animated("cx", &coordinate(point, 0)))
                (animated("cy", &coordinate(point, 1)))
            }
        }
        path class="volts" d={ "M0 " (bar) "h1000M" (along_bar(sweep.voltage)) " " (bar - 14.0) "v28" } {}
        circle class="voltage" cx="1000" cy=(bar) r="13" { (animated("cx", &along(&at))) }
    };
    let kilovolts = |volts: f64| format!("{} kV", three(volts / 1000.0));
    let times = match scale {
        1.0 => "true to scale".to_owned(),
        scale => format!("displacements drawn {scale} times as large"),
    };
    let until = |why: &str| {
        format!(
            "about {}, where {why} (mark: {})",
            kilovolts(*last),
            kilovolts(sweep.voltage)
        )
    };
    let until = match sweep.end {
        SweepEnd::Scene => kilovolts(*last),
        SweepEnd::Breakdown => until("the electric field reaches the breakdown field"),
        SweepEnd::Limit => until("it loses stability"),
    };
    let caption = format!("From 0 to {until}, {times}");
    let description = format!("Deformed membrane of {} as the voltage rises. {caption}", design.name);
    Some((drawing_with(design, &description, &content, BELOW), caption))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::tests::design;
    use deaflow_pattern::{Pattern, Raster, Role};

    #[test]
    fn paths_have_the_same_commands_in_all_states() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| x < 20 && !(5..8).contains(&y));
        let design = Design {
            pattern,
            ..design(Role::Refined, 50, Some(1.0))
        };
        let state = |mm: f64| {
            let moved = |k: usize| if k.is_multiple_of(2) { mm } else { 0.3 * mm };
            Field::from_values(Raster::PAPER, (0..2 * 51 * 51).map(moved).collect()).unwrap()
        };
        let mut sweep = VoltageSweep {
            design: design.name.clone(),
            voltage: 3000.0,
            states: vec![(0.0, state(0.0)), (3000.0, state(0.7)), (6000.0, state(3.0))],
            end: SweepEnd::Limit,
        };
        let (markup, caption) = moving(&design, Some(&sweep)).unwrap();
        assert_eq!(
            caption,
            "From 0 to about 6.00 kV, where it loses stability (mark: 3.00 kV), true to scale"
        );
        let markup = markup.into_string();
        let values: Vec<Vec<&str>> = markup
            .split(" values=\"")
            .skip(1)
            .map(|rest| rest.split('"').next().unwrap().split(';').collect())
            .collect();
        // The electrode, the grid, the point and the voltage.
        assert_eq!(values.len(), 5);
        for of in &values {
            assert_eq!((of.len(), of[2], of[0]), (5, of[3], of[4]));
            let commands = |value: &str| value.chars().filter(char::is_ascii_alphabetic).collect::<String>();
            assert!(of.iter().all(|value| commands(value) == commands(of[0])));
        }
        assert_eq!(values[2][..3], ["500", "514", "560"]);
        assert_eq!(values[4], ["0", "500", "1000", "1000", "0"]);
        assert!(
            markup.contains("keyTimes=\"0.000;0.300;0.600;0.850;1.000\""),
            "{markup}"
        );
        sweep.design = "another".to_owned();
        assert!(moving(&design, Some(&sweep)).is_none() && moving(&design, None).is_none());
    }
}
