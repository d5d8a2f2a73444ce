//! The body of a request about a drawn pattern.

use serde::Deserialize;
use serde_json::Value;

use crate::cache::SimulationSetup;
use crate::http::ApiError;
use crate::left_out::check_in_plane;
use crate::state::ServerState;
use deaflow_base::{Dimension, Document, Quantity};
use deaflow_design::{Goal, Objective};
use deaflow_fem::effects::{EFFECTS, Effect, Model, Verdict};
use deaflow_fem::{Method, check_leads};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};
use deaflow_stage::direct;

/// Elements along a side of the membrane, times their order: finer meshes take too long for the page.
const MAX_ELEMENTS: usize = 1024;

/// Elements along a side of a cell and their order, by default.
pub const DEFAULT_MESH: (u64, u64) = (2, 1);

/// Whether a mesh on `[columns, rows]` cells is not too fine for the page.
#[must_use]
pub fn is_solved_here([columns, rows]: [usize; 2], mesh: Mesh) -> bool {
    columns.max(rows) * mesh.elements_per_cell() * mesh.order().degree() <= MAX_ELEMENTS
}

/// A pattern and how to simulate it. Numbers without a unit are in mm, V and degrees.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SketchRequest {
    /// The name of a scene that is served, or a scene as YAML or as a mapping.
    pub scene: Option<Value>,
    /// A state of the scene, if it has several; the first one by default.
    pub state: Option<String>,
    /// The cells, row by row from below: 0, or the number of an electrode group.
    pub pattern: Vec<Vec<u8>>,
    /// The voltage, instead of that of the scene.
    pub voltage: Option<Value>,
    /// `newton`, `linear` or `chord:N`.
    pub method: Option<String>,
    /// Elements along one side of a cell.
    pub elements_per_cell: Option<u64>,
    /// Polynomial order of the elements.
    pub order: Option<u64>,
    /// The names of the effects that are on, instead of those of the scene.
    pub effects: Option<Vec<String>>,
    /// A point whose displacement is reported.
    pub point: Option<[Value; 2]>,
    /// The direction of that displacement.
    pub direction: Option<Value>,
    /// Leaves out the critical voltage and the error, which take longer than the solution.
    pub quick: bool,
    /// Quantities that are reported for each corner or cell.
    pub fields: Vec<String>,
    /// The target of an improvement: the displacement of the point along the direction.
    pub wanted: Option<Value>,
    /// The area fraction that an improvement keeps.
    pub area: Option<f64>,
    /// Constraints of an improvement, as in a design stage.
    pub constraints: Option<Value>,
    /// The format of a file.
    pub format: Option<String>,
    /// The size of a mask: prestretched or undeformed.
    pub size: Option<String>,
    /// Whether the outline of a mask is rounded.
    pub smooth: bool,
    /// The name of the pattern as a file or a stage.
    pub name: Option<String>,
}

impl SketchRequest {
    /// Returns scene, method and mesh.
    ///
    /// # Errors
    /// If a value is invalid.
    pub fn setup(&self, state: &ServerState) -> Result<SimulationSetup, ApiError> {
        let scene = self.scene(state)?;
        check_in_plane(&scene, "SCENE")?;
        let method = self.method.as_deref().unwrap_or("newton");
        let method: Method = method.parse().map_err(|unknown| {
            ApiError::bad_request(format!("invalid `method`: {method:?}")).help(format!("{unknown}"))
        })?;
        let (elements, order) = DEFAULT_MESH;
        let (elements, order) = (self.elements_per_cell.unwrap_or(elements), self.order.unwrap_or(order));
        let mesh = Mesh::from_numbers(elements, order).ok_or_else(|| {
            ApiError::bad_request(format!("invalid mesh: {elements} elements per cell of order {order}"))
                .help("allowed: elements_per_cell 1 to 8, order 1 or 2")
        })?;
        if !is_solved_here(scene.membrane().raster.sides(), mesh) {
            return Err(ApiError::bad_request(format!(
                "a mesh of {elements} elements per cell of order {order} is too fine for the page"
            ))
            .help("use fewer elements, or `deaflow solve`"));
        }
        Ok(SimulationSetup { scene, method, mesh })
    }

    /// Returns the scene with all of its states.
    ///
    /// # Errors
    /// If there is no scene with that name, or it cannot be used.
    pub fn with_states(&self, state: &ServerState) -> Result<Scene, ApiError> {
        let scene = match &self.scene {
            None => state.scene(None),
            Some(Value::String(text)) => match state.scene(Some(text)) {
                Some(known) => Some(known),
                None if text.contains([':', '\n', '{']) => Some(direct::scene_of_text(text)?),
                None => None,
            },
            Some(mapping @ Value::Object(_)) => Some(direct::scene_of_text(&mapping.to_string())?),
            Some(_) => return Err(ApiError::bad_request("`scene` must be a name, YAML or a mapping")),
        };
        scene.ok_or_else(|| {
            ApiError::not_found("unknown scene")
                .help("GET /api/scenes lists the scenes; `scene` may also be YAML or a mapping")
        })
    }

    /// Returns the scene in the requested state, at the requested voltage and with the requested effects.
    ///
    /// # Errors
    /// If there is no scene with that name, or it cannot be used.
    pub fn scene(&self, state: &ServerState) -> Result<Scene, ApiError> {
        let scene = self.with_states(state)?;
        let scene = match &self.state {
            Some(name) => {
                let found = scene.in_state(name);
                found.map_err(|unknown| ApiError::bad_request(unknown.to_string()).help(unknown.help()))?
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

    /// Returns the pattern on the cells of a scene.
    ///
    /// # Errors
    /// If its size is wrong, or a value is not the number of an electrode group.
    pub fn pattern(&self, scene: &Scene) -> Result<Pattern, ApiError> {
        let form = scene.form();
        let [columns, rows] = form.raster.sides();
        let help = || format!("allowed: {rows} rows of {columns} cells, from below");
        if self.pattern.len() != rows {
            return Err(ApiError::bad_request(format!("the pattern has {} rows", self.pattern.len())).help(help()));
        }
        if let Some((y, row)) = self.pattern.iter().enumerate().find(|(_, row)| row.len() != columns) {
            return Err(ApiError::bad_request(format!("row {y} of the pattern has {} cells", row.len())).help(help()));
        }
        let pattern = Pattern::of_form(form, &self.pattern.concat());
        let pattern = pattern.map_err(|error| ApiError::bad_request(error.to_string()))?;
        check_leads(scene.leads.as_ref(), std::slice::from_ref(&pattern))?;
        Ok(pattern)
    }

    /// Returns the point in mm and the direction in degrees, if they are given.
    ///
    /// # Errors
    /// If the point lies outside of the membrane, or only one of them is given.
    pub fn point_and_direction(&self, scene: &Scene) -> Result<Option<([f64; 2], f64)>, ApiError> {
        let (point, direction) = match (&self.point, &self.direction) {
            (None, None) => return Ok(None),
            (Some(point), Some(direction)) => (point, direction),
            _ => {
                return Err(ApiError::bad_request(
                    "`point` and `direction` need each other: give both or none",
                ));
            }
        };
        let sides = scene.membrane().size_mm;
        let [x, y] = [0, 1].map(|axis| quantity("point", &point[axis], Dimension::Length, 0.0..=sides[axis]));
        let angle = quantity("direction", direction, Dimension::Angle, -360.0..=360.0)?;
        Ok(Some(([x?, y?], angle)))
    }

    /// Returns the objective of the point, if one is given; `backwards` reverses the direction.
    ///
    /// # Errors
    /// If the point lies outside of the membrane, or its direction is missing.
    pub fn goal(&self, scene: &Scene, area: Option<f64>, backwards: bool) -> Result<Option<Goal>, ApiError> {
        let Some(([x, y], angle)) = self.point_and_direction(scene)? else {
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

/// Returns the scene with exactly these effects, with the parameters of the scene.
///
/// # Errors
/// If an effect is unknown, lacks parameters, or is incompatible with another one.
pub fn with_effects(scene: &Scene, names: &[String]) -> Result<Scene, ApiError> {
    let mut effects = Effects::default();
    for name in names {
        let known = EFFECTS.iter().find(|effect| effect.name() == name);
        let effect = known.ok_or_else(|| {
            let all: Vec<&str> = EFFECTS.iter().map(|effect| effect.name()).collect();
            ApiError::bad_request(format!("unknown effect {name:?}")).help(format!("allowed: {}", all.join(", ")))
        })?;
        match effect.is_on(&scene.effects, scene) {
            // Keeps the parameters of the scene.
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
            return Err(missing_parameters(*effect, &scene));
        }
    }
    Ok(scene)
}

/// Explains why an effect cannot be switched on.
fn missing_parameters(effect: &dyn Effect, scene: &Scene) -> ApiError {
    let (name, found) = (effect.name(), effect.assess(scene));
    let lacks_data = found.as_ref().is_none_or(|found| found.verdict == Verdict::NoData);
    let error = ApiError::bad_request(match found {
        Some(found) => format!("`{name}`: {}", found.change),
        None => format!("`{name}`: no data"),
    });
    match lacks_data {
        true => error.help("add its parameters to `properties` of the scene"),
        false => error,
    }
}

/// Merges two sets of effects; an effect of the second one replaces that of the first.
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

/// Parses a number in its base unit, or a text with a unit.
///
/// # Errors
/// If it is neither, or out of range.
pub fn quantity(
    key: &str,
    value: &Value,
    dimension: Dimension,
    allowed: std::ops::RangeInclusive<f64>,
) -> Result<f64, ApiError> {
    let number = match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => Some(
            Quantity::parse(text, dimension)
                .map_err(|error| ApiError::bad_request(format!("`{key}`: {error}")))?
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
        ApiError::bad_request(format!("invalid `{key}`: {value}")).help(format!(
            "allowed: {} {unit} to {} {unit}",
            allowed.start(),
            allowed.end()
        ))
    })
}
