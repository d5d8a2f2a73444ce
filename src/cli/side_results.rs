//! The motions of bars and the forces of sides in a solution.

use serde_json::{Value, json};

use deaflow_base::four_digits;
use deaflow_field::{Motion, Simulation};
use deaflow_scene::{Edge, Scene};

/// What the sides do in a solution.
#[derive(Clone, Debug)]
pub struct SideResults {
    bars: Vec<BarResult>,
    /// The force in N of each side that holds something on the membrane; none along components that it does not hold.
    reactions: Vec<(Edge, [Option<f64>; 2])>,
    /// The largest displacement from rest in mm.
    from_rest_mm: f64,
    /// What fixes motions of the whole that nothing resists, if there are any.
    gauge: Option<String>,
}

#[derive(Clone, Debug)]
struct BarResult {
    edge: Edge,
    motion: Motion,
    /// The translation from rest in mm.
    stroke: [f64; 2],
}

impl SideResults {
    /// Returns what the sides do; `None` if all are held, or without a solution.
    pub fn of(scene: &Scene, solution: &Simulation) -> Option<Self> {
        let (sides, observation) = (scene.geometry.sides.as_ref()?, &solution.observation);
        let moved = solution.stroke()?;
        let cells = moved.raster().sides();
        // The middle of a bar moves as the mean of its ends.
        let stroke = |edge: Edge| {
            let [a, b] = edge.ends(cells).map(|[x, y]| moved.at_corner(x, y));
            [0, 1].map(|c| 0.5 * (a[c] + b[c]))
        };
        let bars = sides.bars().zip(observation.bars.iter().flatten());
        let bars = bars.map(|((edge, _), motion)| BarResult {
            edge,
            motion: *motion,
            stroke: stroke(edge),
        });
        let reactions = sides.iter().zip(observation.reactions.iter().flatten());
        let reactions = reactions.map(|((edge, side), force)| {
            let holds = |c: usize| side.holds(edge)[c] || side.bar().is_some();
            (edge, [0, 1].map(|c| holds(c).then_some(force[c])))
        });
        Some(Self {
            bars: bars.collect(),
            reactions: reactions.filter(|(_, force)| *force != [None; 2]).collect(),
            from_rest_mm: moved.largest().1,
            gauge: gauge(scene),
        })
    }

    /// Describes them in lines.
    pub fn lines(&self) -> Vec<String> {
        let pair = |[x, y]: [f64; 2]| format!("({}, {})", four_digits(x), four_digits(y));
        let bars = self.bars.iter().map(|bar| {
            format!(
                "the bar on the {} side moves by {} mm from rest, {} mm from the mount, and is turned by {} deg",
                bar.edge.name(),
                pair(bar.stroke),
                pair(bar.motion.translation),
                four_digits(bar.motion.rotation)
            )
        });
        let reactions = self.reactions.iter().map(|(edge, force)| {
            let part = |part: Option<f64>| part.map_or_else(|| "-".to_owned(), four_digits);
            format!(
                "the {} side pulls the membrane with ({}, {}) N",
                edge.name(),
                part(force[0]),
                part(force[1])
            )
        });
        let moved = format!(
            "the largest displacement from rest is {} mm",
            four_digits(self.from_rest_mm)
        );
        let gauge = self.gauge.iter().cloned();
        gauge
            .chain(std::iter::once(moved))
            .chain(bars)
            .chain(reactions)
            .collect()
    }

    /// Describes them for programs.
    pub fn document(&self) -> Value {
        let bars = self.bars.iter().map(|bar| {
            let own = json!({
                "translation_mm": bar.motion.translation,
                "from_rest_mm": bar.stroke,
                "rotation_deg": bar.motion.rotation,
            });
            (bar.edge.name().to_owned(), own)
        });
        let reactions = self
            .reactions
            .iter()
            .map(|(edge, force)| (edge.name().to_owned(), json!(force)));
        json!({
            "bars": Value::Object(bars.collect()),
            "reactions_n": Value::Object(reactions.collect()),
            "max_displacement_from_rest_mm": self.from_rest_mm,
        })
    }
}

/// Describes what fixes motions of the whole that nothing resists, if there are any.
fn gauge(scene: &Scene) -> Option<String> {
    let floating = scene.geometry.floating();
    let fixed = match (floating.along, floating.turn) {
        ([false, false], _) => "its mean turn is zero",
        ([true, true], None) => "its mean displacement is zero",
        (_, None) => "its mean displacement along it is zero",
        ([true, true], Some(_)) => "its mean displacement and its mean turn are zero",
        (_, Some(_)) => "its mean displacement along it and its mean turn are zero",
    };
    Some(format!("{}: {fixed}", floating.description()?))
}
