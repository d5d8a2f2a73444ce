//! What stands in a request about a drawn pattern.

use serde::Deserialize;
use serde_json::Value;

use crate::held::Setting;
use crate::http::Refusal;
use crate::state::ServedState;
use deaflow_base::{Dimension, Document, Quantity};
use deaflow_design::{Goal, Objective};
use deaflow_fem::effects::{EFFECTS, Effect, Model, Verdict};
use deaflow_fem::{Method, check_leads};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};
use deaflow_stage::direct;

/// Elements along a side of the membrane, times their order, that are solved for here.
const MOST_ALONG: usize = 1024;

/// A pattern and how it is to be simulated. Numbers without a unit are in mm, V and degrees.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The name of a scene that is served, or a scene as YAML or as a mapping.
    #[serde(default)]
    pub scene: Option<Value>,
    /// A state of the scene, where it has several; the first where none is named.
    #[serde(default)]
    pub state: Option<String>,
    /// The cells, row by row from below: 0, or the number of a group of electrodes.
    pub pattern: Vec<Vec<u8>>,
    /// The voltage in place of the scene's.
    #[serde(default)]
    pub voltage: Option<Value>,
    /// `newton`, `linear` or `chord:N`.
    #[serde(default)]
    pub method: Option<String>,
    /// Elements along one side of a cell.
    #[serde(default)]
    pub elements_per_cell: Option<u64>,
    /// Polynomial order of the elements.
    #[serde(default)]
    pub order: Option<u64>,
    /// The effects that are on, by their names, in place of the scene's.
    #[serde(default)]
    pub effects: Option<Vec<String>>,
    /// A point whose displacement is told.
    #[serde(default)]
    pub point: Option<[Value; 2]>,
    /// The direction along which it is told.
    #[serde(default)]
    pub direction: Option<Value>,
    /// Leaves out the critical voltage and the error, which take longer than the solution.
    #[serde(default)]
    pub quick: bool,
    /// What is told of each corner or cell.
    #[serde(default)]
    pub fields: Vec<String>,
    /// What an improvement is to reach: the displacement of the point along the direction.
    #[serde(default)]
    pub wanted: Option<Value>,
    /// What an improvement may not change: the area fraction.
    #[serde(default)]
    pub area: Option<f64>,
    /// What an improvement keeps to, as in a design stage.
    #[serde(default)]
    pub constraints: Option<Value>,
    /// The format of a file.
    #[serde(default)]
    pub format: Option<String>,
    /// The size of a mask: prestretched or undeformed.
    #[serde(default)]
    pub size: Option<String>,
    /// Whether the outline of a mask is rounded.
    #[serde(default)]
    pub smooth: bool,
    /// What the pattern is called where it is a file or a stage.
    #[serde(default)]
    pub name: Option<String>,
}

impl Drawn {
    /// How it is to be simulated.
    ///
    /// # Errors
    /// When something is out of range, or means nothing.
    pub fn setting(&self, state: &ServedState) -> Result<Setting, Refusal> {
        let scene = self.scene(state)?;
        let method = self.method.as_deref().unwrap_or("newton");
        let method: Method = method
            .parse()
            .map_err(|unknown| Refusal::bad(format!("`method` cannot be {method:?}")).help(format!("{unknown}")))?;
        let (elements, order) = (self.elements_per_cell.unwrap_or(2), self.order.unwrap_or(1));
        let mesh = Mesh::from_numbers(elements, order).ok_or_else(|| {
            Refusal::bad(format!(
                "there is no mesh of {elements} elements per cell of order {order}"
            ))
            .help("allowed: elements_per_cell 1 to 8, order 1 or 2")
        })?;
        let [columns, rows] = scene.membrane().raster.sides();
        if columns.max(rows) * mesh.elements_per_cell() * order as usize > MOST_ALONG {
            return Err(Refusal::bad(format!(
                "a mesh of {elements} elements per cell of order {order} is too fine here"
            ))
            .help("take fewer, or `deaflow solve`, which takes its time"));
        }
        Ok(Setting { scene, method, mesh })
    }

    /// The scene that is meant, with all of its states.
    ///
    /// # Errors
    /// When there is none of that name, or it cannot be used.
    pub fn with_states(&self, state: &ServedState) -> Result<Scene, Refusal> {
        let scene = match &self.scene {
            None => state.scene(None),
            Some(Value::String(text)) => match state.scene(Some(text)) {
                Some(known) => Some(known),
                None if text.contains([':', '\n', '{']) => Some(direct::scene_of_text(text)?),
                None => None,
            },
            Some(mapping @ Value::Object(_)) => Some(direct::scene_of_text(&mapping.to_string())?),
            Some(_) => return Err(Refusal::bad("`scene` is neither a name, nor YAML, nor a mapping")),
        };
        scene.ok_or_else(|| {
            Refusal::absent("there is no scene of that name")
                .help("GET /api/scenes lists them; a scene may also stand here as YAML")
        })
    }

    /// The scene that is meant, in the state, at the voltage and with the effects that are asked for.
    ///
    /// # Errors
    /// When there is none of that name, or it cannot be used.
    pub fn scene(&self, state: &ServedState) -> Result<Scene, Refusal> {
        let scene = self.with_states(state)?;
        let scene = match &self.state {
            Some(wanted) => {
                let found = scene.in_state(wanted);
                found.map_err(|unknown| Refusal::bad(unknown.to_string()).help(unknown.help()))?
            }
            None => scene.in_states().swap_remove(0).1,
        };
        let scene = match &self.voltage {
            None => scene,
            Some(value) => scene.at_voltage(quantity("voltage", value, Dimension::Voltage, 0.0..=1e6)?),
        };
        match &self.effects {
            None => Ok(scene),
            Some(names) => with_effects(&scene, names),
        }
    }

    /// The pattern on the cells of a scene.
    ///
    /// # Errors
    /// When it has other cells, or a value that means no group of electrodes.
    pub fn pattern(&self, scene: &Scene) -> Result<Pattern, Refusal> {
        let form = scene.form();
        let [columns, rows] = form.raster.sides();
        let help = || format!("allowed: {rows} rows of {columns} cells, from below");
        if self.pattern.len() != rows {
            return Err(Refusal::bad(format!("the pattern has {} rows", self.pattern.len())).help(help()));
        }
        if let Some((y, row)) = self.pattern.iter().enumerate().find(|(_, row)| row.len() != columns) {
            return Err(Refusal::bad(format!("row {y} of the pattern has {} cells", row.len())).help(help()));
        }
        let pattern = Pattern::of_form(form, &self.pattern.concat());
        let pattern = pattern.map_err(|error| Refusal::bad(error.to_string()))?;
        check_leads(scene.leads.as_ref(), std::slice::from_ref(&pattern))?;
        Ok(pattern)
    }

    /// The point in mm and the direction in degrees, where they are named.
    ///
    /// # Errors
    /// When it lies outside, or its direction is missing.
    pub fn place(&self, scene: &Scene) -> Result<Option<([f64; 2], f64)>, Refusal> {
        let (point, direction) = match (&self.point, &self.direction) {
            (None, None) => return Ok(None),
            (Some(point), Some(direction)) => (point, direction),
            _ => return Err(Refusal::bad("`point` and `direction` stand together")),
        };
        let sides = scene.membrane().size_mm;
        let [x, y] = [0, 1].map(|axis| quantity("point", &point[axis], Dimension::Length, 0.0..=sides[axis]));
        let angle = quantity("direction", direction, Dimension::Angle, -360.0..=360.0)?;
        Ok(Some(([x?, y?], angle)))
    }

    /// What is wanted of a point, where one is named; against its direction where that is said.
    ///
    /// # Errors
    /// When it lies outside, or its direction is missing.
    pub fn goal(&self, scene: &Scene, area: Option<f64>, backwards: bool) -> Result<Option<Goal>, Refusal> {
        let Some(([x, y], angle)) = self.place(scene)? else {
            return Ok(None);
        };
        let angle = match (backwards, angle > 0.0) {
            (false, _) => angle,
            (true, true) => angle - 180.0,
            (true, false) => angle + 180.0,
        };
        let text = format!("{{ point: [{x} mm, {y} mm], direction: {angle} deg }}");
        let document = Document::from_text(std::path::Path::new("the point"), &text)?;
        Ok(Some(Objective::read(&document.root)?.goal(scene, area, 0.0)?))
    }
}

/// The scene with exactly the effects of these names, with the parameters that it knows of them.
///
/// # Errors
/// When one is not known, lacks what it takes, or does not go with another.
pub fn with_effects(scene: &Scene, names: &[String]) -> Result<Scene, Refusal> {
    let mut effects = Effects::default();
    for name in names {
        let known = EFFECTS.iter().find(|effect| effect.name() == name);
        let effect = known.ok_or_else(|| {
            let all: Vec<&str> = EFFECTS.iter().map(|effect| effect.name()).collect();
            Refusal::bad(format!("there is no effect {name:?}")).help(format!("allowed: {}", all.join(", ")))
        })?;
        match effect.is_on(&scene.effects, scene) {
            // With the parameters that it has in the scene.
            Some(true) => {
                let mut own = scene.effects.clone();
                EFFECTS
                    .iter()
                    .filter(|other| other.name() != name)
                    .for_each(|other| other.turn_off(&mut own));
                effects = merged(effects, own);
            }
            _ => effect.turn_on(&mut effects, scene),
        }
    }
    let scene = scene.with_effects(effects);
    Model::new(&scene)?;
    for name in names {
        let effect = EFFECTS.iter().find(|effect| effect.name() == name);
        if let Some(effect) = effect.filter(|effect| effect.is_on(&scene.effects, &scene) == Some(false)) {
            return Err(lacking(*effect, &scene));
        }
    }
    Ok(scene)
}

/// Why an effect stays off: what screening says of it without its parameters.
fn lacking(effect: &dyn Effect, scene: &Scene) -> Refusal {
    let (name, found) = (effect.name(), effect.assess(scene));
    match found {
        Some(found) if found.verdict != Verdict::Unknown => Refusal::bad(format!("`{name}` {}", found.change)),
        Some(found) => {
            let why = format!("the scene does not know what `{name}` takes ({})", found.change);
            Refusal::bad(why).help("give its parameters under `properties` of the scene")
        }
        None => Refusal::bad(format!("the scene does not know what `{name}` takes"))
            .help("give its parameters under `properties` of the scene"),
    }
}

/// Effects of both, those of the second where both have them.
fn merged(one: Effects, other: Effects) -> Effects {
    Effects {
        strain_stiffening: other.strain_stiffening.or(one.strain_stiffening),
        electrode_stiffness: other.electrode_stiffness.or(one.electrode_stiffness),
        stretch_dependent_permittivity: other
            .stretch_dependent_permittivity
            .or(one.stretch_dependent_permittivity),
        fringe_field: other.fringe_field.or(one.fringe_field),
        wrinkling: other.wrinkling.or(one.wrinkling),
        dielectric_breakdown: other.dielectric_breakdown.or(one.dielectric_breakdown),
        viscoelasticity: other.viscoelasticity.or(one.viscoelasticity),
        inertia: other.inertia.or(one.inertia),
        electrode_resistance: other.electrode_resistance.or(one.electrode_resistance),
        charge_control: other.charge_control.or(one.charge_control),
        electromechanical_stability: other.electromechanical_stability.or(one.electromechanical_stability),
    }
}

/// A number in its base unit, or a text with a unit.
///
/// # Errors
/// When it is neither, or outside of what is allowed.
pub fn quantity(
    key: &str,
    value: &Value,
    dimension: Dimension,
    allowed: std::ops::RangeInclusive<f64>,
) -> Result<f64, Refusal> {
    let number = match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => Some(
            Quantity::parse(text, dimension)
                .map_err(|error| Refusal::bad(format!("`{key}`: {error}")))?
                .value(),
        ),
        _ => None,
    };
    let found = number.filter(|number| allowed.contains(number));
    found.ok_or_else(|| {
        let unit = match dimension {
            Dimension::Voltage => "V",
            Dimension::Length => "mm",
            _ => "deg",
        };
        Refusal::bad(format!("`{key}` cannot be {value}")).help(format!(
            "allowed: {} {unit} to {} {unit}",
            allowed.start(),
            allowed.end()
        ))
    })
}
