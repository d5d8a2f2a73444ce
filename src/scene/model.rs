//! The scene and the values derived from it. Every `Scene` is valid, since reading checks it.

use std::borrow::Cow;
use std::sync::Arc;

use super::drive::{Drive, States, UnknownState, Voltages};
use super::effects::{Breakdown, Effects, On, Properties};
use super::geometry::{Body, Geometry};
use super::leads::Leads;
use super::loads::Loads;
use super::sides::Sides;
use super::waveform::Waveform;
use deaflow_base::{Decimal, Stress, Voltage, parameters, words};
use deaflow_pattern::{Bits, Borders, Electrodes, Membrane, Parts, Pattern, PatternForm, Polygons, Symmetries};

/// Share of the area of a body by which its border may differ from that of its cells by rounding.
const SAME_BORDER: f64 = 1e-9;

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
    /// The voltages of the states, if there are several.
    pub states: States,
    /// What moves the membrane out of its plane.
    pub loads: Option<Loads>,
    /// Where the electrodes are wired, if known.
    pub leads: Option<Leads>,
    /// The effects beyond the base model that are simulated.
    pub effects: Effects,
    /// Whether screening chooses the effects; until then `effects` is empty.
    pub auto: bool,
    /// Known data beyond the base model.
    pub properties: Properties,
    /// The drawn electrodes of a pattern, which elements follow; not part of a file. Without them, electrodes are those
    /// of the cells of any pattern.
    pub electrodes: Option<Arc<Electrodes>>,
}

/// The name of a scene in messages.
pub(super) const WHAT: &str = "the scene";

/// The sections of a scene.
pub(super) const SECTIONS: [&str; 9] = [
    "geometry",
    "material",
    "drive",
    "states",
    "loads",
    "leads",
    "effects",
    "properties",
    "tolerances",
];

impl Scene {
    /// Returns the default scene: VHB 4910 as in the source paper, κ = 0.0255.
    #[must_use]
    pub fn vhb4910() -> Self {
        Self::with_values(50.0, 1.0, 3.0, 45e3, 4.7, 5250.0)
    }

    /// Creates a scene from side and thickness in mm, prestretch, shear modulus in Pa, relative permittivity and
    /// voltage in V, for tests and benchmarks.
    ///
    /// # Panics
    /// When a number is not finite.
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
            loads: None,
            leads: None,
            effects: Effects::default(),
            auto: false,
            properties: Properties::default(),
            electrodes: None,
        }
    }

    /// Returns the scene with the drawn electrodes of a pattern, if it has any.
    #[must_use]
    pub fn with_electrodes_of(&self, pattern: &Pattern) -> Cow<'_, Self> {
        match pattern.electrodes() == self.electrodes.as_ref() {
            true => Cow::Borrowed(self),
            false => Cow::Owned(Self {
                electrodes: pattern.electrodes().cloned(),
                ..self.clone()
            }),
        }
    }

    /// Returns the scene with elements along the shapes of its frame and bodies, if they follow cells that differ from
    /// these shapes.
    #[must_use]
    pub fn with_fitted_curves(&self) -> Option<Self> {
        Some(Self {
            geometry: self.geometry.with_fitted_curves()?,
            ..self.clone()
        })
    }

    /// Returns the scene at another voltage in V: the largest of all electrode groups, with the others in proportion.
    ///
    /// # Panics
    /// When the voltage is not finite.
    #[must_use]
    pub fn at_voltage(&self, voltage: f64) -> Self {
        self.with_voltages(self.drive.voltages.with_largest(voltage))
    }

    /// Returns the scene without forces on sides, bars and bodies; `None` if there are none.
    #[must_use]
    pub fn without_loads(&self) -> Option<Self> {
        let geometry = &self.geometry;
        let sides = geometry.sides.as_ref().and_then(Sides::without_loads);
        let has_load = |body: &Body| body.load_n() != [0.0; 2];
        let are_bodies_loaded = geometry.bodies.iter().flatten().any(has_load);
        (sides.is_some() || are_bodies_loaded).then(|| {
            let unloaded = |body: &Body| Body {
                load: None,
                ..body.clone()
            };
            let bodies = geometry.bodies.as_ref();
            self.with_geometry(Geometry {
                bodies: bodies.map(|bodies| bodies.iter().map(unloaded).collect()),
                sides: sides.or_else(|| geometry.sides.clone()),
                ..geometry.clone()
            })
        })
    }

    /// Returns the scene with bars of given motions in their initial position; `None` if there are none.
    #[must_use]
    pub fn without_displacements(&self) -> Option<Self> {
        let sides = self.geometry.sides.as_ref()?.without_displacements()?;
        Some(self.with_geometry(Geometry {
            sides: Some(sides),
            ..self.geometry.clone()
        }))
    }

    fn with_geometry(&self, geometry: Geometry) -> Self {
        Self {
            geometry,
            ..self.clone()
        }
    }

    /// Returns the scene with the voltages of a table in the course of time, in which the groups of electrodes keep their
    /// proportions.
    #[must_use]
    pub fn with_table(&self, table: Waveform) -> Self {
        let mut scene = self.at_voltage(table.table_voltage_v().unwrap_or_default());
        scene.drive.waveform = Some(table);
        scene
    }

    /// Returns the scene at other voltages, without states.
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

    /// Returns the scene with the largest voltage of each electrode group in any state.
    #[must_use]
    pub fn at_largest_voltages(&self) -> Self {
        let all = self.states.iter().map(|(_, voltages)| voltages);
        let largest = all.cloned().reduce(|a, b| a.max(&b));
        largest.map_or_else(|| self.clone(), |largest| self.with_voltages(largest))
    }

    /// Returns the scene in each state with the name of the state; without states, the scene itself with an empty name.
    #[must_use]
    pub fn in_states(&self) -> Vec<(&str, Self)> {
        if self.states.is_empty() {
            return vec![("", self.clone())];
        }
        let states = self.states.iter();
        states
            .map(|(name, voltages)| (name, self.with_voltages(voltages.clone())))
            .collect()
    }

    /// Returns the scene in one of its states.
    ///
    /// # Errors
    /// When no state has this name.
    pub fn in_state(&self, name: &str) -> Result<Self, UnknownState> {
        let found = self.states.iter().find(|(known, _)| *known == name);
        let found = found.map(|(_, voltages)| self.with_voltages(voltages.clone()));
        found.ok_or_else(|| UnknownState {
            found: name.to_owned(),
            known: self.states.iter().map(|(name, _)| name.to_owned()).collect(),
        })
    }

    /// Returns the scene with exactly these effects and charge control if the drive is a charge.
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

    /// The membrane, on which patterns are drawn.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        self.geometry.membrane()
    }

    /// Returns the symmetries of the device: those of the square, or of a rectangle if sides, cells or prestretch
    /// differ, that map frame, leads, bodies and the supports of sides to themselves. A body can be mapped to another
    /// one with the same load and spring.
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
        let group = match &self.geometry.sides {
            Some(sides) if self.has_masses() => sides.symmetries(group),
            Some(sides) => sides.without_masses().symmetries(group),
            None => group,
        };
        let Some(parts) = self.parts() else {
            return group;
        };
        let bodies: Vec<&Body> = self.geometry.bodies.iter().flatten().collect();
        let group = match self.borders() {
            Some(borders) => borders.symmetries(group, self.membrane().size_mm),
            None => group,
        };
        parts.symmetries(group, |g, from, to| {
            let (from, to) = (bodies[from], bodies[to]);
            let is_loaded_so = g.apply_vector(from.load_n()) == to.load_n() && from.lift_n() == to.lift_n();
            let [x, y, height] = from.springs_n_per_m();
            let [x, y] = g.apply_vector([x, y]).map(f64::abs);
            is_loaded_so && [x, y, height] == to.springs_n_per_m()
        })
    }

    /// Returns for each electrode group the first group with the same voltages in all states, counted from 1.
    #[must_use]
    pub fn equivalent_groups(&self) -> Vec<u8> {
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

    /// Returns whether elements follow the borders of frames, bodies or electrodes.
    #[must_use]
    pub fn follows_borders(&self) -> bool {
        self.geometry.has_fitted_curves() || self.electrodes.is_some()
    }

    /// Returns the borders that elements follow; `None` if all are those of cells.
    #[must_use]
    pub fn borders(&self) -> Option<Arc<Borders>> {
        self.geometry.borders(self.electrodes.as_deref())
    }

    /// Returns the part of the device that each cell belongs to; `None` if all are membrane.
    #[must_use]
    pub fn parts(&self) -> Option<Arc<Parts>> {
        self.geometry.parts()
    }

    /// Returns the cells of a rigid body by column and row; none if there is no such body.
    #[must_use]
    pub fn cells_of_body(&self, body: usize) -> Vec<[usize; 2]> {
        let Some(parts) = self.parts() else {
            return Vec::new();
        };
        let [columns, rows] = parts.raster().sides();
        let all = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        all.filter(|[x, y]| parts.at(*x, *y).body() == Some(body)).collect()
    }

    /// Returns the centroid of a rigid body in mm, if it exists.
    #[must_use]
    pub fn centroid_of_body(&self, body: usize) -> Option<[f64; 2]> {
        let (cells, membrane) = (self.cells_of_body(body), self.membrane());
        let mean = |axis: usize| {
            let sum: f64 = cells.iter().map(|[x, y]| membrane.centre_mm(*x, *y)[axis]).sum();
            sum / cells.len() as f64
        };
        (!cells.is_empty()).then(|| [mean(0), mean(1)])
    }

    /// Returns the border of a rigid body in mm that elements follow, if that is not the border of its cells.
    #[must_use]
    pub fn border_of_body(&self, body: usize) -> Option<Polygons> {
        let borders = self.borders()?;
        let (border, membrane) = (borders.bodies.get(body)?, self.membrane());
        let parts = self.parts()?;
        let cells = Bits::from_fn(membrane.raster, |x, y| parts.at(x, y).body() == Some(body));
        let of_cells = Polygons::of_cells(&cells, membrane);
        let differs = border.without(&of_cells).area() + of_cells.without(border).area();
        (differs > SAME_BORDER * border.area()).then(|| border.clone())
    }

    /// Returns a number to add to the RECIPE of kinds that measure bodies: they took points beside a body whose border
    /// elements follow.
    #[must_use]
    pub fn body_revision(&self) -> u32 {
        let bodies = self.geometry.bodies.as_ref().map_or(0, Vec::len);
        1024 * u32::from((0..bodies).any(|body| self.border_of_body(body).is_some()))
    }

    /// Returns the breakdown strength of the elastomer, from the effects or the properties.
    #[must_use]
    pub fn breakdown_strength(&self) -> Option<&Breakdown> {
        let properties = self.properties.dielectric_breakdown.as_ref();
        self.effects.dielectric_breakdown.as_ref().or(properties)
    }

    /// Returns the cells that can carry electrodes; `None` if all can.
    #[must_use]
    pub fn free_cells(&self) -> Option<Bits> {
        self.parts().map(|parts| parts.free_cells())
    }

    /// Returns the area fraction of an electrode: the share of the free membrane, without frame and bodies.
    #[must_use]
    pub fn area_fraction(&self, pattern: &Pattern) -> f64 {
        pattern.area_fraction(self.free_cells().as_ref())
    }

    /// Returns the area of the free, prestretched membrane in mm², without frame and bodies: within their curves where
    /// elements follow these, else of cells.
    #[must_use]
    pub fn free_area_mm2(&self) -> f64 {
        let membrane = self.membrane();
        if let Some(borders) = self.borders() {
            return borders.on_membrane(&Polygons::of_membrane(membrane)).area();
        }
        let cells = self.free_cells().map_or(membrane.raster.cells(), |free| free.count());
        let [width, height] = membrane.cell_mm();
        cells as f64 * width * height
    }

    /// Returns a number to add to the RECIPE of kinds that compute area fractions: these are of the free membrane, and
    /// were once of all cells.
    #[must_use]
    pub fn area_revision(free: Option<&Bits>) -> u32 {
        let is_covered = free.is_some_and(|free| free.count() < free.raster().cells());
        32 * u32::from(is_covered)
    }

    /// Returns the side in mm of a square with the area of the prestretched membrane, a characteristic length.
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

    /// √(λ₁λ₂), the equibiaxial prestretch with the same area stretch.
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

    /// Returns whether masses can affect the simulation: with inertia, or if screening decides about it.
    pub(super) fn has_masses(&self) -> bool {
        self.auto || self.effects.inertia.is_some()
    }

    /// Density in kg/m³, from the effect `inertia` or from the properties.
    #[must_use]
    pub fn density(&self) -> Option<f64> {
        let of_effect = self.effects.inertia.as_ref().map(|inertia| &inertia.density);
        let density = of_effect.or(self.properties.density.as_ref());
        density.map(|density| density.value())
    }

    /// Permittivity ε = εr ε₀ in F/m.
    #[must_use]
    pub fn permittivity(&self) -> f64 {
        self.material.relative_permittivity.to_f64() * VACUUM_PERMITTIVITY
    }

    /// Voltage V in V: the largest of all electrode groups.
    #[must_use]
    pub fn voltage_v(&self) -> f64 {
        self.drive.voltages.largest_v()
    }

    /// The largest voltage as a quantity.
    ///
    /// # Panics
    /// Never, since voltages are finite.
    #[must_use]
    pub fn voltage(&self) -> Voltage {
        Voltage::from_f64(self.voltage_v()).expect("a finite number")
    }

    /// The number of electrode groups.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.drive.voltages.in_volts().len()
    }

    /// The first electrode group with the largest voltage.
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

    /// The form of patterns of this scene.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm::on(&self.membrane(), self.groups())
    }

    /// Returns the load of each group relative to the largest: the squared ratio of the voltages.
    #[must_use]
    pub fn group_loads(&self) -> Vec<f64> {
        let largest = self.voltage_v();
        let load = |voltage: f64| {
            if voltage < largest {
                (voltage / largest).powi(2)
            } else {
                1.0
            }
        };
        self.drive.voltages.in_volts().into_iter().map(load).collect()
    }

    /// The dimensionless load κ = ε (V/H)² / μ.
    #[must_use]
    pub fn kappa(&self) -> f64 {
        let nominal_field = self.voltage_v() / (self.thickness_mm() * 1e-3);
        self.permittivity() * nominal_field * nominal_field / self.shear_modulus_pa()
    }

    /// The waveform of the voltage; a step by default.
    #[must_use]
    pub fn waveform(&self) -> Waveform {
        self.drive.waveform.clone().unwrap_or_else(Waveform::of_step)
    }

    /// Returns the effects without charge control, which the drive switches on.
    pub(super) fn named_effects(&self) -> Effects {
        Effects {
            charge_control: None,
            ..self.effects.clone()
        }
    }
}
