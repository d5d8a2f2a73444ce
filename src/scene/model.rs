//! The valid scene. Construction is the only validation: a `Scene` at hand can be simulated.

use std::path::Path;
use std::sync::Arc;

use super::charge::Charge;
use super::drive::{Drive, States, UnknownState, Voltages};
use super::effects::{Effects, On, names, switched_on};
use super::geometry::{Body, Geometry, Outline};
use super::leads::Leads;
use super::properties::Properties;
use super::waveform::Waveform;
use deaflow_base::{
    Canonical, Decimal, Declared, Document, Fields, InputError, Map, Node, NodeValue, Parameter, Schema, Stress, Time,
    Voltage, parameters, words,
};
use deaflow_pattern::{Bits, Membrane, Parts, PatternForm, Symmetries};

/// ε₀ in F/m (CODATA 2018).
pub const VACUUM_PERMITTIVITY: f64 = 8.854_187_812_8e-12;

words! {
    /// The elastic law of the base model.
    pub enum ElasticModel {
        /// Incompressible neo-Hookean: W = ½μ(I₁ − 3).
        NeoHookean = "neo-hookean",
    }
}

parameters! {
    /// The elastomer.
    pub struct Material as "`material`" {
        /// The elastic law.
        pub model: ElasticModel,
        /// Small-strain shear modulus.
        pub shear_modulus: Stress [1.0..=1e9],
        /// Relative permittivity.
        pub relative_permittivity: Decimal [1.0..=1e4],
    }
}

/// One membrane with its drive, and the effects that are simulated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scene {
    /// Shape and prestretch.
    pub geometry: Geometry,
    /// Elastomer.
    pub material: Material,
    /// Drive.
    pub drive: Drive,
    /// Its drives in several states, where it has such.
    pub states: States,
    /// Where its electrodes are wired, where that is known.
    pub leads: Option<Leads>,
    /// What is simulated beyond the base model.
    pub effects: Effects,
    /// Whether screening is to turn effects on; until then `effects` is empty.
    pub auto: bool,
    /// What is known beyond the base model.
    pub properties: Properties,
}

/// The largest voltage that a charge may make.
const MOST_VOLTS: f64 = 1e6;

/// What a scene is, in messages.
pub(super) const WHAT: &str = "the scene";

/// The word in place of effects that leaves them to screening.
pub const AUTO: &str = "auto";

/// The sections of a scene.
pub(super) const SECTIONS: [&str; 7] = [
    "geometry",
    "material",
    "drive",
    "states",
    "leads",
    "effects",
    "properties",
];

impl Scene {
    /// Reads a scene from a YAML file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a scene.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::read(&Document::load(path)?.root)
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
        let material: Material = section(&map, "material")?;
        let modulus = material.shear_modulus.value();
        let known = map.optional("properties").map(with_law_of_branches);
        let properties = match &known {
            Some(node) => Properties::read_with(node, &[])?,
            None => Properties::default(),
        };
        let (effects, auto) = read_effects(&map, known.as_ref())?;
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
        let mut effects = effects;
        match (&drive.charge, &effects.charge_control) {
            (Some(_), _) => effects.charge_control = Some(On {}),
            (None, Some(_)) => {
                return Err(map
                    .required(WHAT, "effects")?
                    .error("`charge_control` is on, and the drive is a voltage")
                    .help("give the drive `charge: { total: 2.8 uC }` in place of `voltage`"));
            }
            (None, None) => {}
        }
        if let (Some(_), Some(groups)) = (&drive.charge, map.optional("states")) {
            return Err(groups
                .error("states have voltages, and the drive is a charge")
                .help("leave out `states` or `charge`"));
        }
        let states = match map.optional("states") {
            Some(node) => States::read(node, drive.voltages.in_volts().len())?,
            None => States::default(),
        };
        let leads = match map.optional("leads") {
            Some(node) => {
                let leads = Leads::read(node, "leads", &())?;
                leads.check(node, geometry.membrane())?;
                Some(leads)
            }
            None => None,
        };
        let scene = Self {
            geometry,
            material,
            drive,
            states,
            leads,
            effects,
            auto,
            properties,
        };
        scene.check_resistance(&map)?;
        Ok(scene)
    }

    /// Refuses electrodes with a resistance where they are not wired, or beside what they cannot be simulated with.
    fn check_resistance(&self, map: &Map<'_>) -> Result<(), InputError> {
        if self.effects.electrode_resistance.is_none() {
            return Ok(());
        }
        let section = map.required(WHAT, "effects")?;
        let node = section.peek(names::RESISTANCE).unwrap_or(section);
        if self.leads.is_none() {
            return Err(node
                .error(format!(
                    "`{}` needs `leads`: current must come from somewhere",
                    names::RESISTANCE
                ))
                .help(
                    "give where the electrodes are wired, beside `drive`: leads: [left], or leads: { cells: [[0, 0]] }",
                ));
        }
        match self.conflict_of_resistance(&self.effects) {
            Some(other) => Err(node
                .error(format!(
                    "`{}` is not simulated together with {other}",
                    names::RESISTANCE
                ))
                .help("leave out one of the two")),
            None => Ok(()),
        }
    }

    /// What [`Scene::read`] accepts.
    #[must_use]
    pub fn schema() -> Schema {
        let effects = Schema::any_of([Schema::word(&[AUTO]), Effects::schema(&())])
            .description("What is simulated beyond the base model; auto: what is called for.");
        Fields::new("A membrane on a frame, its drive, and the effects that are simulated.")
            .required("geometry", Geometry::schema(&()))
            .required("material", Material::schema(&()))
            .optional("drive", Drive::schema(&()))
            .optional(
                "states",
                States::schema().description("One device, several drives, by their names. Without `drive` the first is the drive of what knows one."),
            )
            .rule(serde_json::json!({ "anyOf": [{ "required": ["drive"] }, { "required": ["states"] }] }))
            .optional("leads", Leads::schema(&()))
            .optional("effects", effects.default(serde_json::json!({})))
            .optional("properties", Properties::schema(&()))
            .into()
    }

    /// The default scene: VHB 4910 as in the source paper, κ = 0.0255.
    #[must_use]
    pub fn vhb4910() -> Self {
        Self::with_values(50.0, 1.0, 3.0, 45e3, 4.7, 5250.0)
    }

    /// A scene from numbers: side and thickness in mm, prestretch, shear modulus in Pa, relative permittivity, voltage in V.
    ///
    /// # Panics
    /// When a number is not finite. It is for tests and benchmarks; scenes of users are read from documents.
    #[must_use]
    pub fn with_values(
        side: f64,
        thickness: f64,
        prestretch: f64,
        shear_modulus: f64,
        permittivity: f64,
        voltage: f64,
    ) -> Self {
        let finite = "a finite number";
        Self {
            geometry: Geometry::square(side, thickness, prestretch),
            material: Material {
                model: ElasticModel::NeoHookean,
                shear_modulus: Stress::from_f64(shear_modulus).expect(finite),
                relative_permittivity: Decimal::from_f64(permittivity).expect(finite),
            },
            drive: Drive::one(Voltage::from_f64(voltage).expect(finite)),
            states: States::default(),
            leads: None,
            effects: Effects::default(),
            auto: false,
            properties: Properties::default(),
        }
    }

    /// The same scene at another voltage in V: the largest of all groups of electrodes, with the others in proportion.
    ///
    /// # Panics
    /// When the voltage is not finite.
    #[must_use]
    pub fn at_voltage(&self, voltage: f64) -> Self {
        self.with_voltages(self.drive.voltages.with_largest(voltage))
    }

    /// The same scene at other voltages, in no other state.
    #[must_use]
    pub fn with_voltages(&self, voltages: Voltages) -> Self {
        Self {
            effects: self.named_effects(),
            drive: Drive {
                voltages,
                charge: None,
                ..self.drive.clone()
            },
            states: States::default(),
            ..self.clone()
        }
    }

    /// The scene at the largest voltage that each group of electrodes has in any state.
    #[must_use]
    pub fn at_largest_voltages(&self) -> Self {
        let all = self.states.iter().map(|(_, voltages)| voltages);
        let largest = all.cloned().reduce(|a, b| a.largest(&b));
        largest.map_or_else(|| self.clone(), |largest| self.with_voltages(largest))
    }

    /// The scene in each of its states, with their names; of a scene without states itself, without a name.
    #[must_use]
    pub fn in_states(&self) -> Vec<(&str, Self)> {
        let states = self.states.iter();
        let several: Vec<_> = states
            .map(|(name, voltages)| (name, self.with_voltages(voltages.clone())))
            .collect();
        if several.is_empty() {
            vec![("", self.clone())]
        } else {
            several
        }
    }

    /// The scene in one of its states.
    ///
    /// # Errors
    /// When it has no state of that name.
    pub fn in_state(&self, name: &str) -> Result<Self, UnknownState> {
        let found = self.states.iter().find(|(known, _)| *known == name);
        let found = found.map(|(_, voltages)| self.with_voltages(voltages.clone()));
        found.ok_or_else(|| UnknownState {
            found: name.to_owned(),
            known: self.states.iter().map(|(name, _)| name.to_owned()).collect(),
        })
    }

    /// The same scene with exactly these effects, but for that which the drive turns on.
    #[must_use]
    pub fn with_effects(&self, effects: Effects) -> Self {
        Self {
            effects: Effects {
                charge_control: self.drive.charge.as_ref().map(|_| On {}),
                ..effects
            },
            auto: false,
            ..self.clone()
        }
    }

    /// What patterns are drawn on.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        self.geometry.membrane()
    }

    /// What maps the membrane to itself: of the symmetries of the square, or of those of a rectangle where it, its cells or its prestretch are
    /// one, those that map frame, leads and bodies to themselves, a body perhaps to one that is pulled alike.
    #[must_use]
    pub fn symmetries(&self) -> Symmetries {
        let [along, across] = self.prestretch();
        let group = match along == across {
            true => self.membrane().symmetries(),
            false => Symmetries::RECTANGLE,
        };
        let group = match &self.leads {
            None => group,
            Some(leads) => {
                let touched = leads.touched(self.membrane().raster).pattern();
                group.filter(|g| touched.transformed(g) == touched)
            }
        };
        let Some(parts) = self.parts() else {
            return group;
        };
        let bodies: Vec<&Body> = self.geometry.bodies.iter().flatten().collect();
        parts.symmetries(group, |g, from, to| {
            let (from, to) = (bodies[from], bodies[to]);
            g.apply_vector(from.load_n()) == to.load_n() && from.spring_n_per_m() == to.spring_n_per_m()
        })
    }

    /// Of each group of electrodes the first that has its voltage in every state, from 1.
    #[must_use]
    pub fn alike_groups(&self) -> Vec<u8> {
        let states = self.in_states();
        let volts: Vec<Vec<f64>> = states
            .iter()
            .map(|(_, scene)| scene.drive.voltages.in_volts())
            .collect();
        let of_group = |group: usize| -> Vec<f64> { volts.iter().map(|volts| volts[group]).collect() };
        let first = |group| {
            (0..group)
                .find(|&other| of_group(other) == of_group(group))
                .unwrap_or(group)
        };
        (0..self.groups()).map(|group| first(group) as u8 + 1).collect()
    }

    /// What the cells of the membrane are; nothing where all of them are membrane.
    #[must_use]
    pub fn parts(&self) -> Option<Arc<Parts>> {
        self.geometry.parts()
    }

    /// The cells of a rigid body, by column and row; none where there is no such body.
    #[must_use]
    pub fn cells_of_body(&self, body: usize) -> Vec<[usize; 2]> {
        let Some(parts) = self.parts() else {
            return Vec::new();
        };
        let [columns, rows] = parts.raster().sides();
        let all = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        all.filter(|[x, y]| parts.at(*x, *y).body() == Some(body)).collect()
    }

    /// The centroid of a rigid body in mm; none where there is no such body.
    #[must_use]
    pub fn centroid_of_body(&self, body: usize) -> Option<[f64; 2]> {
        let (cells, membrane) = (self.cells_of_body(body), self.membrane());
        let mean = |axis: usize| {
            let sum: f64 = cells.iter().map(|[x, y]| membrane.centre_mm(*x, *y)[axis]).sum();
            sum / cells.len() as f64
        };
        (!cells.is_empty()).then(|| [mean(0), mean(1)])
    }

    /// The cells that may carry electrodes; none are told where all of them may.
    #[must_use]
    pub fn room(&self) -> Option<Bits> {
        self.parts().map(|parts| parts.free_cells())
    }

    /// The side in mm of a square of the area of the prestretched membrane: a length to compare others with.
    #[must_use]
    pub fn side_mm(&self) -> f64 {
        let [x, y] = self.membrane().size_mm;
        (x * y).sqrt()
    }

    /// Undeformed thickness H in mm.
    #[must_use]
    pub fn thickness_mm(&self) -> f64 {
        self.geometry.thickness.value()
    }

    /// Thickness of the prestretched membrane, H/(λ₁λ₂), in mm.
    #[must_use]
    pub fn prestretched_thickness_mm(&self) -> f64 {
        self.thickness_mm() / self.mean_prestretch().powi(2)
    }

    /// Prestretch λ₁ along x and λ₂ along y.
    #[must_use]
    pub fn prestretch(&self) -> [f64; 2] {
        self.geometry.prestretch.0.each_ref().map(|stretch| stretch.to_f64())
    }

    /// √(λ₁λ₂): the equibiaxial prestretch that stretches areas as much, λp where it is equibiaxial.
    #[must_use]
    pub fn mean_prestretch(&self) -> f64 {
        let [along, across] = self.prestretch();
        (along * across).sqrt()
    }

    /// Shear modulus μ in Pa.
    #[must_use]
    pub fn shear_modulus_pa(&self) -> f64 {
        self.material.shear_modulus.value()
    }

    /// Density in kg/m³: that of its effect, or what is known of the material.
    #[must_use]
    pub fn density(&self) -> Option<f64> {
        let simulated = self.effects.inertia.as_ref().map(|inertia| &inertia.density);
        let known = simulated.or(self.properties.density.as_ref());
        known.map(|density| density.value())
    }

    /// Permittivity ε = εr ε₀ in F/m.
    #[must_use]
    pub fn permittivity(&self) -> f64 {
        self.material.relative_permittivity.to_f64() * VACUUM_PERMITTIVITY
    }

    /// Voltage V in V: the largest of all groups of electrodes.
    #[must_use]
    pub fn voltage_v(&self) -> f64 {
        self.drive.voltages.most_v()
    }

    /// The largest voltage, as it is written.
    ///
    /// # Panics
    /// Never: a voltage is a finite number.
    #[must_use]
    pub fn voltage(&self) -> Voltage {
        Voltage::from_f64(self.voltage_v()).expect("a finite number")
    }

    /// How many groups of electrodes there are.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.drive.voltages.in_volts().len()
    }

    /// The first group of electrodes with the largest voltage.
    #[must_use]
    pub fn strongest_group(&self) -> u8 {
        let largest = self.voltage_v();
        let at = self
            .drive
            .voltages
            .in_volts()
            .iter()
            .position(|&voltage| voltage == largest);
        at.map_or(1, |at| at as u8 + 1)
    }

    /// What those see of it who draw on it.
    #[must_use]
    pub fn outline(&self) -> Outline {
        self.geometry.outline(self.groups())
    }

    /// What patterns of this scene are.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm {
            raster: self.membrane().raster,
            groups: self.groups(),
        }
    }

    /// Of each group its voltage over the largest, squared: its share of the load.
    #[must_use]
    pub fn group_loads(&self) -> Vec<f64> {
        let largest = self.voltage_v();
        let share = |voltage: f64| {
            if voltage < largest {
                (voltage / largest).powi(2)
            } else {
                1.0
            }
        };
        self.drive.voltages.in_volts().into_iter().map(share).collect()
    }

    /// The number that drives the statics: κ = ε (V/H)² / μ, without unit.
    #[must_use]
    pub fn kappa(&self) -> f64 {
        let nominal_field = self.voltage_v() / (self.thickness_mm() * 1e-3);
        self.permittivity() * nominal_field * nominal_field / self.shear_modulus_pa()
    }

    /// The scene without what decides nothing about its simulation: how the drive goes on in time, and properties that no effect uses. Where
    /// screening is to turn effects on, all of it may decide.
    #[must_use]
    pub fn simulated(&self) -> Self {
        match self.auto {
            true => self.clone(),
            false => self.without_time(),
        }
    }

    /// The scene without how the drive goes on in time and without properties, whatever they decide: what all simulations of one device have in
    /// common.
    #[must_use]
    pub fn without_time(&self) -> Self {
        Self {
            drive: self.drive.without_time(),
            properties: Properties::default(),
            ..self.clone()
        }
    }

    /// The same of a simulation in time, of which the last state is kept.
    #[must_use]
    pub fn simulated_until(&self, time: Time) -> Self {
        Self {
            drive: Drive {
                frequency: None,
                duration: Some(time),
                ..self.drive.clone()
            },
            ..self.simulated()
        }
    }

    /// The same of a simulation that knows about which voltage the drive swings.
    #[must_use]
    pub fn simulated_about_bias(&self) -> Self {
        let swings = |waveform: &Waveform| waveform.sine.as_ref().is_some_and(|sine| sine.bias.value() > 0.0);
        let simulated = self.simulated();
        Self {
            drive: Drive {
                waveform: self.drive.waveform.clone().filter(swings),
                ..simulated.drive.clone()
            },
            ..simulated
        }
    }

    /// How the voltage changes in time.
    #[must_use]
    pub fn waveform(&self) -> Waveform {
        self.drive.waveform.clone().unwrap_or_else(Waveform::of_step)
    }

    /// The scene as a canonical value, by section; in flow style also its YAML.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let effects = match self.auto {
            true => AUTO.into(),
            false => self.named_effects().to_canonical(),
        };
        let mut sections = vec![
            ("geometry", self.geometry.to_canonical()),
            ("material", self.material.to_canonical()),
            ("drive", self.canonical_drive()),
            ("effects", effects),
        ];
        if !self.states.is_empty() {
            sections.push(("states", self.states.canonical()));
        }
        if let Some(leads) = self.leads.as_ref().and_then(Leads::canonical) {
            sections.push(("leads", leads));
        }
        if !self.properties.is_empty() {
            sections.push(("properties", self.properties.to_canonical()));
        }
        Canonical::map(sections)
    }

    /// The effects but that which the drive turns on.
    fn named_effects(&self) -> Effects {
        Effects {
            charge_control: None,
            ..self.effects.clone()
        }
    }

    /// A charge says all that its voltage does.
    fn canonical_drive(&self) -> Canonical {
        let mut drive = self.drive.to_canonical();
        if let (Some(_), Canonical::Map(entries)) = (&self.drive.charge, &mut drive) {
            entries.remove("voltage");
        }
        drive
    }

    /// The scene in its own YAML syntax on one line: what artifacts carry, and [`Scene::from_text`] reads.
    #[must_use]
    pub fn to_text(&self) -> String {
        let Canonical::Map(sections) = self.canonical() else {
            return String::new();
        };
        // In the order in which people write them.
        let written = SECTIONS
            .iter()
            .filter_map(|name| Some(format!("{name}: {}", sections.get(*name)?)));
        format!("{{ {} }}", written.collect::<Vec<_>>().join(", "))
    }
}

fn section<T: Declared>(map: &Map<'_>, key: &str) -> Result<T, InputError> {
    T::read_with(map.required(WHAT, key)?, &[])
}

/// Properties in which a list of branches is one of the linear law, which scenes used to say so.
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

/// The effects that are named, or that screening is to find them.
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

/// The drive; without one that of the first state.
fn read_drive(map: &Map<'_>, geometry: &Geometry, material: &Material) -> Result<Drive, InputError> {
    let drive = match (map.optional("drive"), map.optional("states")) {
        (None, Some(states)) => States::first_drive(states)?,
        _ => Drive::read_with(
            &with_own_voltage(map.required(WHAT, "drive")?, geometry, material)?,
            &[],
        )?,
    };
    Ok(drive.normalised())
}

/// A drive with the voltage that it is compared by where it says none: the largest of its table, or that at which half of the membrane at rest
/// has its charge.
fn with_own_voltage(drive: &Node, geometry: &Geometry, material: &Material) -> Result<Node, InputError> {
    let said = |key: &str| drive.peek(key);
    let voltage = said("voltage").or_else(|| said("voltages"));
    let with = |volts: f64| {
        let mut drive = drive.clone();
        drive.put("voltage", drive.with_value(NodeValue::Text(format!("{volts} V"))));
        drive
    };
    if let Some(node) = said("charge") {
        if let Some(other) = voltage.or_else(|| said("waveform")).or_else(|| said("source")) {
            return Err(other
                .error("a charge stands in place of a voltage, and this drive has both")
                .help("leave out `voltage`, `waveform` and `source`, or `charge`"));
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
                    "{charge:e} C on half of the membrane is a voltage of {volts:.0} V"
                ))
                .help(format!("allowed: charges of up to {MOST_VOLTS:e} V")));
        }
        return Ok(with(volts));
    }
    if let (Some(source), Some(several)) = (said("source"), said("voltages"))
        && several.list("voltages").is_ok_and(|each| each.len() > 1)
    {
        return Err(source
            .error("a source feeds electrodes of one voltage, and this drive has several")
            .help("leave out `source`, or give `voltage`"));
    }
    let Some(waveform) = said("waveform").filter(|_| voltage.is_none()) else {
        return Ok(drive.clone());
    };
    let largest = Waveform::read_with(waveform, &[])?.own_voltage_v();
    Ok(largest.map_or_else(|| drive.clone(), with))
}
