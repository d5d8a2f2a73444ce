//! What drives a device: a voltage for each group of electrodes, in one state or in several.

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

/// Most states of a device.
pub const MOST_STATES: usize = 16;

/// Longest name of a state.
const LONGEST_NAME: usize = 64;

parameters! {
    /// The voltages of the electrode groups.
    pub struct Voltages as "voltages" {
        /// Between the electrodes, where they are one group.
        pub voltage: Option<Voltage> [VOLTAGES],
        /// Those of the electrode groups 1, 2, … in place of `voltage`.
        pub voltages: Option<Vec<Voltage>> [(VOLTAGES, 1..=Pattern::MOST_GROUPS)],
    }
    check(check)
}

fn voltage_or_voltages(fields: Fields) -> Fields {
    fields.rule(json!({ "oneOf": [{ "required": ["voltage"] }, { "required": ["voltages"] }] }))
}

/// The same, but that a table brings its own voltage, and a charge stands in place of one.
fn voltages_or_table(fields: Fields) -> Fields {
    let both = json!({ "required": ["voltage", "voltages"] });
    let with_table = json!({ "properties": { "waveform": { "required": ["table"] } }, "required": ["waveform"] });
    let with_voltage = json!({ "anyOf": [{ "required": ["voltage"] }, { "required": ["voltages"] }, with_table] });
    let driven = json!({ "anyOf": [{ "required": ["voltage"] }, { "required": ["voltages"] }, { "required": ["waveform"] }, { "required": ["source"] }] });
    fields.rule(json!({
        "not": { "anyOf": [both, { "required": ["voltages", "source"], "properties": { "voltages": { "minItems": 2 } } }] },
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
                "`voltage` is that of one group of electrodes, and `voltages` has {}",
                both.len()
            ))
            .help("give `voltage`, or `voltages: [of group 1, of group 2, …]`")),
    }
}

impl Voltages {
    /// That of one group.
    #[must_use]
    pub fn one(voltage: Voltage) -> Self {
        Self {
            voltage: Some(voltage),
            voltages: None,
        }
    }

    /// The same in the one way of saying it that is canonical: one group has a voltage.
    #[must_use]
    pub fn normalised(self) -> Self {
        match self.voltages.as_deref() {
            Some([one]) => Self::one(*one),
            _ => self,
        }
    }

    /// Those of the groups, in V.
    #[must_use]
    pub fn in_volts(&self) -> Vec<f64> {
        let several = self.voltages.iter().flatten();
        self.voltage
            .iter()
            .chain(several)
            .map(|voltage| voltage.value())
            .collect()
    }

    /// The largest, in V.
    #[must_use]
    pub fn most_v(&self) -> f64 {
        self.in_volts().into_iter().fold(0.0, f64::max)
    }

    /// The larger of each group's.
    #[must_use]
    pub fn largest(&self, other: &Self) -> Self {
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

    /// The same with the largest changed to this one in V, and the others in proportion; where there is none, all of them.
    ///
    /// # Panics
    /// When the voltage is not finite.
    #[must_use]
    pub fn with_largest(&self, largest: f64) -> Self {
        let now = self.most_v();
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
        /// Where the voltage alternates. Only screening looks at it.
        pub frequency: Option<Frequency> [1e-9..=1e9],
        /// How long the voltage is held, and how long a history lasts unless it is asked for at given times.
        pub duration: Option<Time> [1e-9..=1e9],
        /// How the voltage changes in time; without it all of it is there from 0 s on.
        pub waveform: Option<Waveform>,
        /// Time at the prestretch before the drive; without it the elastomer has relaxed.
        pub rest: Option<Time> [0.0..=1e12],
        /// The charge of the electrodes, in place of a voltage.
        pub charge: Option<Charge>,
        /// What feeds the electrodes, where that matters; without it they have the voltage at once.
        pub source: Option<Source>,
    }
    include {
        /// The voltages.
        pub voltages: Voltages,
    }
    rules(voltages_or_table)
}

impl Drive {
    /// That of one group of electrodes, without time.
    #[must_use]
    pub fn one(voltage: Voltage) -> Self {
        Self::of(Voltages::one(voltage))
    }

    /// That of voltages, without time.
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

    /// The same in the one way of saying it that is canonical.
    #[must_use]
    pub fn normalised(self) -> Self {
        Self {
            voltages: self.voltages.normalised(),
            ..self
        }
    }

    /// The same without time: what decides about an equilibrium.
    #[must_use]
    pub fn without_time(&self) -> Self {
        Self {
            charge: self.charge.clone(),
            ..Self::of(self.voltages.clone())
        }
    }

    /// The frequency of the voltage in Hz, where it oscillates; else that of which the time within which it changes, or for which it lasts, is
    /// the time; none where the drive is static.
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

    /// Whether the voltage oscillates.
    #[must_use]
    pub fn oscillates(&self) -> bool {
        self.frequency.is_some() || self.waveform.as_ref().is_some_and(|waveform| waveform.sine.is_some())
    }

    /// The frequency of the force in Hz, as [`Drive::voltage_frequency_hz`]: that of V², which of an oscillation without bias has twice the frequency.
    #[must_use]
    pub fn force_frequency_hz(&self) -> Option<f64> {
        let sine = self.waveform.as_ref().and_then(|waveform| waveform.sine.as_ref());
        let is_biased = sine.is_some_and(|sine| sine.bias.value() > 0.0);
        let times = if self.oscillates() && !is_biased { 2.0 } else { 1.0 };
        self.voltage_frequency_hz().map(|frequency| times * frequency)
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

/// The drives of one device by their names, in the order of these.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct States(Vec<(String, State)>);

/// A state that a scene does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no state `{found}`")]
pub struct UnknownState {
    pub(super) found: String,
    pub(super) known: Vec<String>,
}

impl UnknownState {
    /// What there is.
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

    /// Reads the states of devices with so many groups of electrodes.
    ///
    /// # Errors
    /// When a name cannot be one, there are too many or none, or one has another number of voltages.
    pub fn read(node: &Node, groups: usize) -> Result<Self, InputError> {
        let mut states = Vec::new();
        for (key, value) in node.entries(Self::WHAT)? {
            let name = key.text(Self::WHAT)?;
            if !is_plain_name(name, LONGEST_NAME) {
                return Err(key
                    .error(format!("{} is no name of a state", key.found()))
                    .help(format!("allowed: letters, digits, `-` and `_`, at most {LONGEST_NAME}")));
            }
            let state = State::read_with(value, &[])?;
            let own = state.voltages.in_volts().len();
            if own != groups {
                return Err(value
                    .error(format!(
                        "state `{name}` has voltages of {own} electrode groups, and the drive those of {groups}"
                    ))
                    .help("give each state a voltage for each group; a group may have 0 V"));
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

    /// The voltages in the first of the states that a document has, by their names, as a drive.
    ///
    /// # Errors
    /// When they cannot be read.
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

    /// What [`States::read`] accepts.
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

    /// The regular expression of their names.
    #[must_use]
    pub fn name_pattern() -> String {
        format!("^[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}$")
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Their names and drives, in the order of their names.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &Voltages)> {
        self.0.iter().map(|(name, state)| (name.as_str(), &state.voltages))
    }

    /// The states as a canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        Canonical::map(self.0.iter().map(|(name, state)| (name.as_str(), state.to_canonical())))
    }
}
