//! The energies of a step: stored, electric, dissipated and supplied.

use std::mem;

use super::super::bodies;
use super::super::transient::FixedCharge;
use super::March;
use crate::charge;
use crate::material::Material;
use crate::operator::{Activity, metrics};
use crate::stored::{Content, content};

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    /// Balances the energies of a step.
    pub(super) fn account(&mut self, [before, now]: [f64; 2], jump: bool) {
        let transient = self.transient;
        let (measured, electric) = self.measure();
        if transient.held.is_some_and(|held| held.uncharged.is_some()) && measured.charge > 0.0 {
            // The mean voltage over the charge.
            self.volts = 2.0 * electric / measured.charge;
        }
        let content_before = mem::replace(&mut self.content, measured);
        let voltage = self.volts;
        let electric_before = mem::replace(&mut self.electric, electric);
        let loaded = self.viscous.loaded();
        let stored = self.units.energy * self.viscous.stored(&loaded, transient.problem.activity);
        let earlier = mem::replace(&mut self.loaded, loaded);
        let [springs, work] = bodies::energies(self.units, transient.problem.activity.grid(), &self.u);
        let springs_before = mem::replace(&mut self.springs, springs);
        let work_before = mem::replace(&mut self.work, work);
        let change = stored - mem::replace(&mut self.stored, stored);
        if jump {
            let before = if self.pass.instants.is_empty() {
                self.elastic_at_rest
            } else {
                content_before.elastic
            };
            let elastic = self.content.elastic - before + springs - springs_before;
            self.supplied += elastic + change + self.electric - electric_before;
        } else {
            self.dissipated += self.units.energy * earlier.work_to(&self.loaded, transient.problem.activity) - change;
            let charged = self.content.driven - content_before.driven;
            let to_electrodes = match &self.charged {
                None => 0.5 * (self.volts_before + voltage) * charged,
                Some(charged) => charged.work,
            };
            let from_source = match transient.is_fed_slowly() {
                false => to_electrodes,
                true => transient.mean_voltage(&self.smoothed, [before, now]) * charged,
            };
            self.supplied += from_source + work - work_before;
            self.dissipated += from_source - to_electrodes;
        }
        self.volts_before = voltage;
    }

    /// Returns the content of the membrane in its current state, and the electric energy in J.
    pub(super) fn measure(&self) -> (Content, f64) {
        if let Some(FixedCharge {
            charge,
            uncharged: Some(uncharged),
        }) = self.transient.held
        {
            let activity = self.transient.problem.activity;
            let elastic = self.content(uncharged, 0.0);
            let content = Content {
                charge,
                driven: charge,
                ..elastic
            };
            return (
                content,
                self.units.energy * charge::energy_of_sprayed(activity, &self.u),
            );
        }
        let Some(charged) = &self.charged else {
            let activity = self.transient.problem.activity;
            // Branches that have followed include the current state.
            let content = match self.viscous.metric() {
                Some(metric) => self.content_at(metric, activity, self.volts),
                None => self.content(activity, self.volts),
            };
            return (content, 0.5 * content.driven * self.volts);
        };
        let volts = charged.share.sqrt() * self.transient.scene.voltage_v();
        let content = self.content(&charged.activity, volts);
        let charge = charged.charge.iter().sum();
        let whole = Content {
            charge,
            driven: charge,
            ..content
        };
        (whole, 0.5 * content.driven * volts)
    }

    /// Returns the content of the membrane in its current state, with this voltage on its electrodes.
    pub(super) fn measure_at(&self, volts: f64) -> Content {
        self.content(self.transient.problem.activity, volts)
    }

    /// Returns the content of the membrane in its current state, with this voltage on electrodes with an activity.
    pub(super) fn content(&self, activity: &Activity, volts: f64) -> Content {
        self.content_at(&metrics(activity, &self.u), activity, volts)
    }

    /// Returns the content of the membrane at a metric, with this voltage on electrodes with an activity.
    pub(super) fn content_at(&self, metric: &[f64], activity: &Activity, volts: f64) -> Content {
        let transient = self.transient;
        let full = transient.scene.voltage_v();
        let ratio = if full > 0.0 { volts / full } else { 0.0 };
        // The electric energy is a difference, which rounding destroys at low voltages. It is proportional to the
        // squared voltage unless the membrane wrinkles.
        let unloaded = (transient.problem.material)(0.0);
        let (at, scale) = match unloaded.wrinkles() {
            true => (ratio, 1.0),
            false => (1.0, ratio),
        };
        let loaded = (transient.problem.material)(at * at);
        let found = content([&unloaded, &loaded], activity, metric, at * full, self.units);
        Content {
            charge: scale * found.charge,
            driven: scale * found.driven,
            ..found
        }
    }
}
