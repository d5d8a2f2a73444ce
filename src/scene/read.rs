//! Reads and checks a scene.

use std::path::Path;

use super::charge::Charge;
use super::drive::{Drive, States};
use super::effects::{AUTO, Effects, On, Properties, names, switched_on};
use super::geometry::Geometry;
use super::leads::Leads;
use super::library::{self, refuse_file, splice_material};
use super::loads::Loads;
use super::model::{Material, SECTIONS, Scene, VACUUM_PERMITTIVITY, WHAT};
use super::shape::Shape;
use super::sides::SideSupport;
use super::tolerances::Tolerances;
use super::waveform::Waveform;
use deaflow_base::{Declared, Document, Fields, InputError, Map, Node, NodeValue, Parameter, Schema};

/// The largest voltage that a charge may need.
const MOST_VOLTS: f64 = 1e6;

impl Scene {
    /// Reads a scene from a YAML file.
    ///
    /// # Errors
    /// When the file cannot be read, or is not a scene.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        let mut root = Document::load(path)?.root;
        splice_material(&mut root)?;
        Self::read(&root)
    }

    /// Reads a scene from text, such as an artifact's `scene` attribute.
    ///
    /// # Errors
    /// When the text is not a scene.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read(&Document::from_text(Path::new("scene"), text)?.root)
    }

    /// Reads a scene from a node of a document.
    ///
    /// # Errors
    /// When a key is unknown or missing, or a value is out of range.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let map = node.fields(WHAT, &SECTIONS)?;
        refuse_file(node)?;
        let material: Material = section(&map, "material")?;
        let modulus = material.shear_modulus.value();
        let known = map.optional("properties").map(with_law_of_branches);
        let properties = match &known {
            Some(node) => Properties::read_with(node, &[])?,
            None => Properties::default(),
        };
        let (mut effects, auto) = read_effects(&map, known.as_ref())?;
        for (section, law) in [
            ("effects", &effects.strain_stiffening),
            ("properties", &properties.strain_stiffening),
        ] {
            if let (Some(law), Some(at)) = (law, map.optional(section)) {
                law.law()
                    .check_modulus(at.peek("strain_stiffening").unwrap_or(at), modulus)?;
            }
        }
        let geometry = section::<Geometry>(&map, "geometry")?.normalised();
        let drive = read_drive(&map, &geometry, &material)?;
        match (&drive.charge, &effects.charge_control) {
            (Some(_), _) => effects.charge_control = Some(On {}),
            (None, Some(_)) => {
                return Err(map
                    .required(WHAT, "effects")?
                    .error("`charge_control` is on, but the drive is a voltage")
                    .help("give the drive `charge: { total: 2.8 uC }` instead of `voltage`"));
            }
            (None, None) => {}
        }
        if let (Some(_), Some(groups)) = (&drive.charge, map.optional("states")) {
            return Err(groups
                .error("`states` have voltages, but the drive is a charge")
                .help("remove `states` or `charge`"));
        }
        let states = match map.optional("states") {
            Some(node) => States::read(node, drive.voltages.in_volts().len())?,
            None => States::default(),
        };
        let leads = match map.optional("leads") {
            Some(node) => {
                let leads = Leads::read(node, "leads", &())?;
                leads.check(node, geometry.membrane(), geometry.sides.as_ref())?;
                Some(leads)
            }
            None => None,
        };
        let loads = map
            .optional("loads")
            .map(|node| Loads::read_with(node, &[]))
            .transpose()?;
        // They are no part of what a simulation depends on.
        Tolerances::of_scene(node)?;
        let scene = Self {
            geometry,
            material,
            drive,
            states,
            loads,
            leads,
            effects,
            auto,
            properties,
            electrodes: None,
        };
        scene.check_resistance(&map)?;
        Ok(scene)
    }

    /// Checks that electrodes with a resistance have leads, and that nothing else in the scene excludes them.
    fn check_resistance(&self, map: &Map<'_>) -> Result<(), InputError> {
        if self.effects.electrode_resistance.is_none() {
            return Ok(());
        }
        let section = map.required(WHAT, "effects")?;
        let node = section.peek(names::RESISTANCE).unwrap_or(section);
        if self.leads.is_none() {
            return Err(node
                .error(format!(
                    "`{}` needs `leads`, where the current enters",
                    names::RESISTANCE
                ))
                .help("add the position of the leads to the scene: leads: [left], or leads: { cells: [[0, 0]] }"));
        }
        match self.resistance_conflict(&self.effects) {
            Some(other) => Err(node
                .error(format!(
                    "`{}` cannot be simulated together with {other}",
                    names::RESISTANCE
                ))
                .help("remove one of the two")),
            None => Ok(()),
        }
    }

    /// Returns the schema of [`Scene::read`].
    #[must_use]
    pub fn schema() -> Schema {
        let effects = Schema::any_of([Schema::word(&[AUTO]), Effects::schema(&())])
            .description("The effects beyond the base model; auto: those that are significant.");
        let scene = Fields::new("A membrane on a frame, its drive and its effects.")
            .required("geometry", Geometry::schema(&()))
            .required("material", library::schema())
            .optional("drive", Drive::schema(&()))
            .optional(
                "states",
                States::schema().description(
                    "Several drives of one device, by name. Without `drive`, the first by name is the drive.",
                ),
            )
            .at_least_one(&["drive", "states"])
            .optional("loads", Loads::schema(&()))
            .optional("leads", Leads::schema(&()))
            .optional("effects", effects.default(serde_json::json!({})))
            .optional("properties", Properties::schema(&()))
            .optional("tolerances", Tolerances::schema(&()));
        let shapes = Schema::from(scene).define(Shape::DEFINITION, Shape::fields().into());
        shapes.define(SideSupport::DEFINITION, SideSupport::definition())
    }

    /// Returns what excludes electrodes with a resistance in this scene with these effects.
    #[must_use]
    pub fn resistance_conflict(&self, effects: &Effects) -> Option<&'static str> {
        let loads = self.in_states().into_iter().flat_map(|(_, scene)| scene.group_loads());
        let conflicts = [
            (
                loads.into_iter().any(|load| load != 1.0),
                "voltages that differ by group",
            ),
            (self.drive.source.is_some(), "a `source`"),
            (self.drive.charge.is_some(), "a `charge`"),
            (effects.inertia.is_some(), "`inertia`"),
            (effects.fringe_field.is_some(), "`fringe_field`"),
            (effects.electrode_stiffness.is_some(), "`electrode_stiffness`"),
        ];
        conflicts
            .into_iter()
            .find_map(|(is_there, what)| is_there.then_some(what))
    }
}

fn section<T: Declared>(map: &Map<'_>, key: &str) -> Result<T, InputError> {
    T::read_with(map.required(WHAT, key)?, &[])
}

/// Converts a list of branches in the properties to a mapping with the linear law; older scenes have a list.
fn with_law_of_branches(properties: &Node) -> Node {
    let mut properties = properties.clone();
    let key = "viscoelasticity";
    if let Some(list) = properties
        .peek(key)
        .filter(|node| matches!(node.value(), NodeValue::List(_)))
        .cloned()
    {
        let mapping = NodeValue::Map(vec![(
            list.with_value(NodeValue::Text("branches".to_owned())),
            list.clone(),
        )]);
        properties.replace(key, list.with_value(mapping));
    }
    properties
}

/// Reads the effects, and whether screening chooses them.
fn read_effects(map: &Map<'_>, properties: Option<&Node>) -> Result<(Effects, bool), InputError> {
    let Some(node) = map.optional("effects") else {
        return Ok((Effects::default(), false));
    };
    match node.value() {
        NodeValue::Text(text) if text == AUTO => return Ok((Effects::default(), true)),
        NodeValue::Text(_) => {
            return Err(node
                .error(format!("`effects` must be a mapping or {AUTO}, found {}", node.found()))
                .help(format!("allowed: {AUTO}, {{}}, or a mapping of effects")));
        }
        _ => {}
    }
    let named = switched_on(node, properties)?;
    Ok((Effects::read_with(&named, &[])?, false))
}

/// Reads the drive, or that of the first state if there is none.
fn read_drive(map: &Map<'_>, geometry: &Geometry, material: &Material) -> Result<Drive, InputError> {
    let drive = match (map.optional("drive"), map.optional("states")) {
        (None, Some(states)) => States::first_drive(states)?,
        _ => Drive::read_with(
            &with_nominal_voltage(map.required(WHAT, "drive")?, geometry, material)?,
            &[],
        )?,
    };
    Ok(drive.normalised())
}

/// Adds a nominal voltage to a drive without one: the largest of its table, or the voltage at which half of the
/// undeflected membrane holds its charge.
fn with_nominal_voltage(drive: &Node, geometry: &Geometry, material: &Material) -> Result<Node, InputError> {
    let given = |key: &str| drive.peek(key);
    let voltage = given("voltage").or_else(|| given("voltages"));
    let with = |volts: f64| {
        let mut drive = drive.clone();
        drive.put("voltage", drive.with_value(NodeValue::Text(format!("{volts} V"))));
        drive
    };
    if let Some(node) = given("charge") {
        if let Some(other) = voltage.or_else(|| given("waveform")).or_else(|| given("source")) {
            return Err(other
                .error("the drive has a charge, so it cannot have this key")
                .help("remove `voltage`, `waveform` and `source`, or `charge`"));
        }
        let charge = Charge::read_with(node, &[])?.in_coulombs();
        let [width, height] = geometry.membrane().size_mm;
        let half = 0.5 * 1e-6 * width * height;
        let thickness = 1e-3 * geometry.thickness.value();
        let stretched: f64 = geometry.prestretch.0.iter().map(|stretch| stretch.to_f64()).product();
        let permittivity = material.relative_permittivity.to_f64() * VACUUM_PERMITTIVITY;
        let volts = charge * thickness / (permittivity * stretched * half);
        if volts > MOST_VOLTS {
            return Err(node
                .error(format!(
                    "{charge:e} C on half of the membrane needs a voltage of {volts:.0} V"
                ))
                .help(format!("allowed: charges that need up to {MOST_VOLTS:e} V")));
        }
        return Ok(with(volts));
    }
    if let (Some(source), Some(several)) = (given("source"), given("voltages"))
        && several.list("voltages").is_ok_and(|each| each.len() > 1)
    {
        return Err(source
            .error("a source feeds electrodes at one voltage, but this drive has several")
            .help("remove `source`, or give `voltage`"));
    }
    let Some(waveform) = given("waveform").filter(|_| voltage.is_none()) else {
        return Ok(drive.clone());
    };
    let largest = Waveform::read_with(waveform, &[])?.table_voltage_v();
    Ok(largest.map_or_else(|| drive.clone(), with))
}
