//! The canonical value of a scene, its text, and the parts that a simulation depends on.

use super::drive::Drive;
use super::effects::{AUTO, Properties};
use super::leads::Leads;
use super::model::{SECTIONS, Scene};
use super::tolerances::Tolerances;
use super::waveform::Waveform;
use deaflow_base::{Canonical, Declared, Parameter, Time};

impl Scene {
    /// Returns the canonical value by section. In flow style it is also the YAML of the scene.
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
        if let Some(loads) = &self.loads {
            sections.push(("loads", loads.to_canonical()));
        }
        if let Some(leads) = self.leads.as_ref().and_then(Leads::canonical) {
            sections.push(("leads", leads));
        }
        if !self.properties.is_empty() {
            sections.push(("properties", self.properties.to_canonical()));
        }
        Canonical::map(sections)
    }

    /// Returns the drive; a charge makes its nominal voltage redundant.
    fn canonical_drive(&self) -> Canonical {
        let mut drive = self.drive.to_canonical();
        if let (Some(_), Canonical::Map(entries)) = (&self.drive.charge, &mut drive) {
            entries.remove("voltage");
        }
        drive
    }

    /// Returns the scene in YAML on one line, for artifacts and [`Scene::from_text`].
    #[must_use]
    pub fn to_text(&self) -> String {
        self.to_text_with(None)
    }

    /// Returns the text of [`Scene::to_text`] with the tolerances of the scene, which are no part of it.
    #[must_use]
    pub fn to_text_with(&self, tolerances: Option<&Tolerances>) -> String {
        format!("{{ {} }}", self.written(tolerances).join(", "))
    }

    /// Returns the scene in YAML, with a line for each section; a drive that follows from its states is left out.
    #[must_use]
    pub fn to_yaml(&self) -> String {
        self.to_yaml_with(None)
    }

    /// Returns the text of [`Scene::to_yaml`] with the tolerances of the scene.
    #[must_use]
    pub fn to_yaml_with(&self, tolerances: Option<&Tolerances>) -> String {
        let mut lines = self.written(tolerances);
        let of_states = self
            .states
            .iter()
            .next()
            .map(|(_, first)| Drive::of(first.clone()).normalised());
        if of_states.is_some_and(|drive| drive == self.drive) {
            lines.retain(|section| !section.starts_with("drive:"));
        }
        lines.into_iter().map(|section| section + "\n").collect()
    }

    /// Returns the sections in YAML, in the usual order.
    fn written(&self, tolerances: Option<&Tolerances>) -> Vec<String> {
        let Canonical::Map(mut sections) = self.canonical() else {
            return Vec::new();
        };
        sections.extend(tolerances.map(|own| ("tolerances".to_owned(), own.to_canonical())));
        let section = |name: &&str| Some(format!("{name}: {}", sections.get(*name)?));
        SECTIONS.iter().filter_map(section).collect()
    }

    /// Returns the scene without data that does not affect the simulation: the time course of the drive, properties
    /// that no effect uses, and masses without inertia. If screening chooses the effects, everything can affect it.
    #[must_use]
    pub fn simulated(&self) -> Self {
        match self.auto {
            true => self.clone(),
            false => self.without_time(),
        }
    }

    /// Returns the scene without the time course of the drive, without properties, and without masses if there is no
    /// inertia, which all simulations of one device share.
    #[must_use]
    pub fn without_time(&self) -> Self {
        Self {
            drive: self.drive.without_time(),
            properties: Properties::default(),
            geometry: match self.has_masses() {
                true => self.geometry.clone(),
                false => self.geometry.without_masses(),
            },
            ..self.clone()
        }
    }

    /// As [`Scene::simulated`], for a simulation in time of which the last state is used.
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

    /// As [`Scene::simulated`], for a simulation that depends on the bias of the voltage.
    #[must_use]
    pub fn simulated_about_bias(&self) -> Self {
        let is_biased = |waveform: &Waveform| waveform.sine.as_ref().is_some_and(|sine| sine.bias.value() > 0.0);
        let simulated = self.simulated();
        Self {
            drive: Drive {
                waveform: self.drive.waveform.clone().filter(is_biased),
                ..simulated.drive.clone()
            },
            ..simulated
        }
    }
}
