//! The drive of a device: a voltage for each electrode group, in one or several states.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use serde_json::json;

use super::charge::Charge;
use super::source::Source;
use super::waveform::Waveform;
use deaflow_base::{
    Canonical, Declared, Fields, Frequency, InputError, Map, Node, Parameter, Schema, Time, Voltage, is_plain_name,
    parameters,
};
use deaflow_pattern::Pattern;

const VOLTAGES: RangeInclusive<f64> = 0.0..=1e6;

/// The largest number of states of a device.
pub const MOST_STATES: usize = 16;

/// The longest name of a state.
const LONGEST_NAME: usize = 64;

parameters! {
    /// The voltages of the electrode groups.
    pub struct Voltages as "voltages" {
        /// The voltage between the electrodes, for a single group.
        pub voltage: Option<Voltage> [VOLTAGES],
        /// The voltages of the electrode groups 1, 2, …, instead of `voltage`.
        pub voltages: Option<Vec<Voltage>> [(VOLTAGES, 1..=Pattern::MOST_GROUPS)],
    }
    check(check)
}

fn voltage_or_voltages(fields: Fields) -> Fields {
    fields.exactly_one(&["voltage", "voltages"])
}

/// The same, except that a table has its own voltage, and a charge replaces the voltage.
fn voltages_or_table(fields: Fields) -> Fields {
    let both = json!({ "required": ["voltage", "voltages"] });
    let with_table = json!({ "properties": { "waveform": { "required": ["table"] } }, "required": ["waveform"] });
    let with_voltage = json!({ "anyOf": [{ "required": ["voltage"] }, { "required": ["voltages"] }, with_table] });
    let driven = ["voltage", "voltages", "waveform", "source"].map(|key| json!({ "required": [key] }));
    let driven = json!({ "anyOf": driven });
    let several = json!({ "required": ["voltages", "source"], "properties": { "voltages": { "minItems": 2 } } });
    fields.rule(json!({
        "not": { "anyOf": [both, several] },
        "if": { "required": ["charge"] },
        "then": { "not": driven },
        "else": with_voltage,
    }))
}

fn check(voltages: &Voltages, map: &Map<'_>) -> Result<(), InputError> {
    match (&voltages.voltage, &voltages.voltages) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (None, None) => map.required("`drive`", "voltage").map(|_| ()),
        (Some(_), Some(both)) => Err(map
            .required("`drive`", "voltages")?
            .error(format!(
                "`voltage` is for a single electrode group, but `voltages` has {}",
                both.len()
            ))
            .help("give `voltage`, or `voltages: [group 1, group 2, …]`")),
    }
}

impl Voltages {
    /// Creates the voltage of a single group.
    #[must_use]
    pub fn one(voltage: Voltage) -> Self {
        Self {
            voltage: Some(voltage),
            voltages: None,
        }
    }

    /// Returns the canonical form, in which a single group has `voltage`.
    #[must_use]
    pub fn normalised(self) -> Self {
        match self.voltages.as_deref() {
            Some([one]) => Self::one(*one),
            _ => self,
        }
    }

    /// Returns the voltages of the groups in V.
    #[must_use]
    pub fn in_volts(&self) -> Vec<f64> {
        let several = self.voltages.iter().flatten();
        self.voltage
            .iter()
            .chain(several)
            .map(|voltage| voltage.value())
            .collect()
    }

    /// Returns the largest voltage in V.
    #[must_use]
    pub fn largest_v(&self) -> f64 {
        self.in_volts().into_iter().fold(0.0, f64::max)
    }

    /// Returns the larger of two voltages for each group.
    #[must_use]
    pub fn max(&self, other: &Self) -> Self {
        let larger = |a: &Voltage, b: &Voltage| if a.value() < b.value() { *b } else { *a };
        let both = |a: &[Voltage], b: &[Voltage]| a.iter().zip(b).map(|(a, b)| larger(a, b)).collect();
        Self {
            voltage: self
                .voltage
                .as_ref()
                .zip(other.voltage.as_ref())
                .map(|(a, b)| larger(a, b)),
            voltages: self
                .voltages
                .as_deref()
                .zip(other.voltages.as_deref())
                .map(|(a, b)| both(a, b)),
        }
    }

    /// Scales all voltages in proportion so that the largest has this value in V. If all are zero, all get this value.
    ///
    /// # Panics
    /// When the voltage is not finite.
    #[must_use]
    pub fn with_largest(&self, largest: f64) -> Self {
        let now = self.largest_v();
        let changed = |voltage: &Voltage| {
            let value = if now > 0.0 && voltage.value() < now {
                voltage.value() / now * largest
            } else {
                largest
            };
            Voltage::from_f64(value).expect("a finite number")
        };
        Self {
            voltage: self.voltage.as_ref().map(changed),
            voltages: self.voltages.as_ref().map(|all| all.iter().map(changed).collect()),
        }
    }
}

parameters! {
    /// What drives the actuator.
    pub struct Drive as "`drive`" {
        /// The frequency of an alternating voltage. Only screening uses it.
        pub frequency: Option<Frequency> [1e-9..=1e9],
        /// The time for which the voltage is held, and the length of a history without given times.
        pub duration: Option<Time> [1e-9..=1e9],
        /// How the voltage changes in time; without it the voltage is constant from 0 s on.
        pub waveform: Option<Waveform>,
        /// The time at prestretch before the drive; without it the elastomer has relaxed.
        pub rest: Option<Time> [0.0..=1e12],
        /// The charge of the electrodes, instead of a voltage.
        pub charge: Option<Charge>,
        /// The source that feeds the electrodes; without it they have the voltage at once.
        pub source: Option<Source>,
    }
    include {
        /// The voltages.
        pub voltages: Voltages,
    }
    rules(voltages_or_table)
}

impl Drive {
    /// Creates the drive of a single electrode group, without time.
    #[must_use]
    pub fn one(voltage: Voltage) -> Self {
        Self::of(Voltages::one(voltage))
    }

    /// Creates a drive of voltages, without time.
    #[must_use]
    pub fn of(voltages: Voltages) -> Self {
        Self {
            voltages,
            frequency: None,
            duration: None,
            waveform: None,
            rest: None,
            charge: None,
            source: None,
        }
    }

    /// Returns the canonical form.
    #[must_use]
    pub fn normalised(self) -> Self {
        Self {
            voltages: self.voltages.normalised(),
            ..self
        }
    }

    /// Returns the drive without time, which determines an equilibrium.
    #[must_use]
    pub fn without_time(&self) -> Self {
        Self {
            charge: self.charge.clone(),
            ..Self::of(self.voltages.clone())
        }
    }

    /// Returns the frequency f of the voltage in Hz. For a voltage that does not oscillate, f = 1/(2πt) with the time t
    /// in which it changes, or for which it lasts. `None` for a static drive.
    #[must_use]
    pub fn voltage_frequency_hz(&self) -> Option<f64> {
        let sine = self.waveform.as_ref().and_then(|waveform| waveform.sine.as_ref());
        let oscillation = sine.map(|sine| sine.frequency.value());
        oscillation
            .or_else(|| self.frequency.as_ref().map(|f| f.value()))
            .or_else(|| {
                let change = self.waveform.as_ref().and_then(Waveform::time_s);
                let time = change.or_else(|| self.duration.as_ref().map(|t| t.value()));
                time.map(|time| 1.0 / (TAU * time))
            })
    }

    /// Returns whether the voltage oscillates.
    #[must_use]
    pub fn oscillates(&self) -> bool {
        self.frequency.is_some() || self.waveform.as_ref().is_some_and(|waveform| waveform.sine.is_some())
    }

    /// Returns the frequency of the force in Hz, which is proportional to V²: twice that of the voltage for an
    /// oscillation without bias.
    #[must_use]
    pub fn force_frequency_hz(&self) -> Option<f64> {
        let sine = self.waveform.as_ref().and_then(|waveform| waveform.sine.as_ref());
        let is_biased = sine.is_some_and(|sine| sine.bias.value() > 0.0);
        let factor = if self.oscillates() && !is_biased { 2.0 } else { 1.0 };
        self.voltage_frequency_hz().map(|frequency| factor * frequency)
    }
}

parameters! {
    /// One of several drives of a device.
    pub struct State as "a state" {}
    include {
        /// The voltages.
        pub voltages: Voltages,
    }
    rules(voltage_or_voltages)
}

/// The voltages of one device in several states, sorted by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct States(Vec<(String, State)>);

/// An unknown state.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no state `{found}`")]
pub struct UnknownState {
    pub(super) found: String,
    pub(super) known: Vec<String>,
}

impl UnknownState {
    /// Returns advice.
    #[must_use]
    pub fn help(&self) -> String {
        match self.known.is_empty() {
            true => "the scene has no states".to_owned(),
            false => format!("allowed: {}", self.known.join(", ")),
        }
    }
}

impl States {
    const WHAT: &'static str = "`states`";

    /// Reads the states of a device with `groups` electrode groups.
    ///
    /// # Errors
    /// When a name is invalid, there are too many states or none, or a state has another number of voltages.
    pub fn read(node: &Node, groups: usize) -> Result<Self, InputError> {
        let mut states = Vec::new();
        for (key, value) in node.entries(Self::WHAT)? {
            let name = key.text(Self::WHAT)?;
            if !is_plain_name(name, LONGEST_NAME) {
                return Err(key
                    .error(format!("{} is not a valid name of a state", key.found()))
                    .help(format!("allowed: letters, digits, `-` and `_`, at most {LONGEST_NAME}")));
            }
            let state = State::read_with(value, &[])?;
            let own = state.voltages.in_volts().len();
            if own != groups {
                return Err(value
                    .error(format!(
                        "state `{name}` has voltages of {own} electrode groups, but the drive has {groups}"
                    ))
                    .help("give a voltage for each group, which may be 0 V"));
            }
            let voltages = state.voltages.normalised();
            states.push((name.to_owned(), State { voltages }));
        }
        if !(1..=MOST_STATES).contains(&states.len()) {
            return Err(node
                .error(format!("`states` has {} states", states.len()))
                .help(format!("allowed: 1 to {MOST_STATES}")));
        }
        states.sort_by(|(a, _), (b, _)| a.cmp(b));
        Ok(Self(states))
    }

    /// Reads the first state by name as a drive.
    ///
    /// # Errors
    /// When it is invalid.
    pub fn first_drive(node: &Node) -> Result<Drive, InputError> {
        let mut named = Vec::new();
        for (key, value) in node.entries(Self::WHAT)? {
            named.push((key.text(Self::WHAT)?, value));
        }
        let Some((_, first)) = named.into_iter().min_by_key(|(name, _)| *name) else {
            return Err(node
                .error("`states` has no state")
                .help(format!("allowed: 1 to {MOST_STATES}")));
        };
        Ok(Drive::of(State::read_with(first, &[])?.voltages))
    }

    /// Returns the schema of [`States::read`].
    #[must_use]
    pub fn schema() -> Schema {
        let state = serde_json::Value::from(State::schema(&()));
        Schema::new(json!({
            "type": "object",
            "propertyNames": { "type": "string", "pattern": Self::name_pattern() },
            "additionalProperties": state,
            "minProperties": 1,
            "maxProperties": MOST_STATES,
        }))
    }

    /// Returns the regular expression of the names.
    #[must_use]
    pub fn name_pattern() -> String {
        format!("^[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}$")
    }

    /// Returns whether there are no states.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the names and voltages, sorted by name.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &Voltages)> {
        self.0.iter().map(|(name, state)| (name.as_str(), &state.voltages))
    }

    /// Returns the canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        Canonical::map(self.0.iter().map(|(name, state)| (name.as_str(), state.to_canonical())))
    }
}
