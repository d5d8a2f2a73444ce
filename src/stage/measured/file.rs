//! Files of measurements with what is known about them, as a list in YAML.

use std::path::{Path, PathBuf};

use super::curve;
use crate::files::FileName;
use deaflow_base::{
    Angle, Canonical, Declared, Dimension, Document, Force, InputError, Length, Map, Node, NodeValue, Parameter,
    Quantity, Schema, Stress, Voltage, parameters, words,
};
use deaflow_fit::Test;
use deaflow_pattern::Edges;
use deaflow_scene::Position;

/// The largest voltage in V.
const MOST_VOLTS: f64 = 1e6;
/// The largest coordinate in mm at which the origin of a table may lie.
const FARTHEST: f64 = 1e6;

words! {
    /// What was measured.
    pub enum Measurement {
        /// Stress against stretch along one direction, free across it.
        Uniaxial = "uniaxial",
        /// Stress against stretch, equal along both directions.
        Equibiaxial = "equibiaxial",
        /// Stress against stretch along one direction, held across it.
        PureShear = "pure-shear",
        /// The stretch of a homogeneous sheet against the voltage.
        VoltageStretch = "voltage-stretch",
        /// The stretch of a homogeneous sheet over time after a load and a voltage have acted.
        Creep = "creep",
        /// Displacements of many points of a device, as digital image correlation gives them.
        Field = "field",
        /// The displacement of a point of a device against the voltage.
        VoltageDisplacement = "voltage-displacement",
        /// The displacement of a point of a device over time.
        TimeDisplacement = "time-displacement",
        /// Amplitude and phase of the displacement of a point of a device under a small alternating voltage.
        FrequencyResponse = "frequency-response",
    }
}

words! {
    /// Where the points of a field are.
    pub enum Coordinates {
        /// On the membrane at rest.
        Reference = "reference",
        /// On the deformed membrane.
        Deformed = "deformed",
    }
}

words! {
    /// How a sheet stretches.
    pub enum Sheet {
        /// Along one direction, free across it; without a voltage.
        Uniaxial = "uniaxial",
        /// Equally along both directions.
        Equibiaxial = "equibiaxial",
        /// Along one direction, held across it.
        PureShear = "pure-shear",
    }
}

impl Sheet {
    /// Returns how it stretches.
    #[must_use]
    pub fn test(self) -> Test {
        match self {
            Self::Uniaxial => Test::Uniaxial,
            Self::Equibiaxial => Test::Equibiaxial,
            Self::PureShear => Test::PureShear,
        }
    }
}

words! {
    /// The direction in which the second coordinate of a table grows.
    pub enum Upward {
        /// Upwards, as on the membrane.
        Up = "up",
        /// Downwards, as in pictures.
        Down = "down",
    }
}

impl Measurement {
    /// Returns how a specimen is stretched; `None` for a device.
    #[must_use]
    pub fn of_specimen(self) -> Option<Test> {
        match self {
            Self::Uniaxial => Some(Test::Uniaxial),
            Self::Equibiaxial => Some(Test::Equibiaxial),
            Self::PureShear => Some(Test::PureShear),
            Self::VoltageStretch
            | Self::Creep
            | Self::Field
            | Self::VoltageDisplacement
            | Self::TimeDisplacement
            | Self::FrequencyResponse => None,
        }
    }
}

/// The standard deviation of the noise: a share of the measured values, or a quantity of their dimension.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Noise(String);

impl Noise {
    /// Returns the share, as of `3 %`; `None` for a quantity.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        let percent = self.0.trim().strip_suffix('%')?;
        percent.trim().parse::<f64>().ok().map(|percent| 0.01 * percent)
    }

    /// Returns the quantity in the base unit.
    #[must_use]
    pub fn quantity(&self, dimension: Dimension) -> Option<f64> {
        Quantity::parse(&self.0, dimension).ok().map(|found| found.value())
    }
}

impl Parameter for Noise {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let found = Self(node.text(key)?.to_owned());
        let stress = Dimension::Stress;
        let length = Dimension::Length;
        let value = found
            .share()
            .or_else(|| found.quantity(stress))
            .or_else(|| found.quantity(length));
        match value.is_some_and(|value| value > 0.0 && value.is_finite()) {
            true => Ok(found),
            false => Err(node
                .error(format!("`{key}` is {}", node.found()))
                .help("allowed: a positive share or quantity, as in `3 %`, `2 kPa` or `0.01 mm`")),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(self.0.as_str()))
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: &'static str) -> Self {
        Self(literal.to_owned())
    }

    fn example() -> String {
        "3 %".to_owned()
    }
}

/// The size of a pixel: `21.3 um/px`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelSize(Length);

impl PixelSize {
    /// Returns the size in mm.
    #[must_use]
    pub fn mm(self) -> f64 {
        self.0.value()
    }
}

impl Parameter for PixelSize {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let text = node.text(key)?;
        let size = text
            .trim()
            .strip_suffix("/px")
            .map(|size| Quantity::parse(size, Dimension::Length));
        let size = size
            .and_then(Result::ok)
            .and_then(|size| Length::from_f64(size.value()));
        match size.filter(|size| size.value() > 0.0) {
            Some(size) => Ok(Self(size)),
            None => Err(node
                .error(format!("`{key}` is {}", node.found()))
                .help("allowed: the size of a pixel, as in `21.3 um/px`")),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        self.0.canonical()
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: &'static str) -> Self {
        Self(<Length as Parameter>::literal(literal))
    }

    fn example() -> String {
        "21.3 um/px".to_owned()
    }
}

parameters! {
    /// A file of measurements.
    pub struct MeasuredFile as "a measured file" {
        /// A table, relative to the file that names it. Its columns have units: stretch and nominal_stress_kPa; x_mm,
        /// y_mm, ux_mm and uy_mm; voltage_kV or time_s, and displacement_mm; frequency_Hz and amplitude_mm. A column
        /// sigma_… has standard deviations.
        file: FileName,
        /// What was measured.
        pub test: Measurement,
        /// The standard deviation of the noise, if there is no column of it.
        pub sigma: Option<Noise>,
        /// The pattern of electrodes of the device.
        pattern: Option<FileName>,
        /// How the edges of electrodes of a drawn pattern are followed: by elements (`fitted`), by the share of each cell
        /// that they cover (`coverage`), or by the cells whose centre is in an electrode.
        pub edges: Edges = Edges::Cells,
        /// How a sheet stretches.
        pub sheet: Sheet = Sheet::Equibiaxial,
        /// The nominal stress of a dead load on a sheet; without it and `force` the sheet is held at the prestretch of
        /// the scene before the voltage acts.
        pub load: Option<Stress> [-1e12..=1e12],
        /// The force of a dead load on a sheet, with its `width`.
        pub force: Option<Force> [-1e9..=1e9],
        /// The undeformed width on which the force acts.
        pub width: Option<Length> [1e-6..=FARTHEST],
        /// The voltage of a field, that of the scene if it is not given; or of creep, none if it is not given. Of a
        /// displacement over time that of the waveform of the scene, and of a frequency response the voltage about which
        /// the alternating one is.
        pub voltage: Option<Voltage> [0.0..=MOST_VOLTS],
        /// The amplitude of the alternating voltage of a frequency response.
        pub alternating: Option<Voltage> [1e-9..=MOST_VOLTS],
        /// The point of a device whose displacement was measured.
        pub point: Option<Position> [0.0..=FARTHEST],
        /// The direction in which its displacement was measured, from the x axis anticlockwise.
        pub direction: Option<Angle> [-360.0..=360.0],
        /// Where the points of a field are.
        pub coordinates: Coordinates = Coordinates::Reference,
        /// The size of a pixel, for columns in px.
        pub scale: Option<PixelSize>,
        /// Where the origin of the coordinates of a field lies on the membrane.
        pub origin: Option<Position> [-FARTHEST..=FARTHEST],
        /// The angle of the x axis of a field to that of the membrane, anticlockwise.
        pub turn: Option<Angle> [-360.0..=360.0],
        /// The direction in which y grows in a field.
        pub y: Upward = Upward::Up,
        /// The distance over which the noise of a field is correlated at most: some subsets of the correlation.
        pub correlated_within: Option<Length> [0.0..=FARTHEST],
    }
    check(check_keys)
}

/// Checks that the keys belong to the test.
fn check_keys(file: &MeasuredFile, map: &Map<'_>) -> Result<(), InputError> {
    let (needed, possible): (&[&str], &[&str]) = match file.test {
        Measurement::Uniaxial | Measurement::Equibiaxial | Measurement::PureShear => (&[], &[]),
        Measurement::Field => (
            &["pattern"],
            &[
                "edges",
                "voltage",
                "coordinates",
                "scale",
                "origin",
                "turn",
                "y",
                "correlated_within",
            ],
        ),
        Measurement::VoltageDisplacement => (&["pattern", "point", "direction"], &["edges"]),
        Measurement::TimeDisplacement => (&["pattern", "point", "direction"], &["edges", "voltage"]),
        Measurement::FrequencyResponse => (&["pattern", "point", "direction", "alternating"], &["edges", "voltage"]),
        Measurement::VoltageStretch => (&[], &["sheet", "load", "force", "width"]),
        Measurement::Creep => (&[], &["sheet", "load", "force", "width", "voltage"]),
    };
    let test = file.test;
    for key in needed {
        map.required(&format!("a file of the test `{}`", test.name()), key)?;
    }
    if let (Some(_), Some(node)) = (map.optional("load"), map.optional("force")) {
        return Err(node.error("`load` and `force` exclude each other").help("remove one"));
    }
    if let (None, Some(node)) = (map.optional("width"), map.optional("force")) {
        return Err(node
            .error("a force needs the undeformed `width` on which it acts")
            .help("write it as in `width: 10 mm`, or give the nominal stress as `load`"));
    }
    let of_all = ["file", "test", "sigma"];
    let is_foreign = |key: &&'static str| !of_all.contains(key) && !needed.contains(key) && !possible.contains(key);
    let foreign = MeasuredFile::keys().into_iter().filter(is_foreign);
    match foreign.into_iter().find_map(|key| Some((key, map.optional(key)?))) {
        Some((key, node)) => Err(node
            .error(format!("`{key}` does not belong to the test `{}`", test.name()))
            .help("remove it")),
        None => Ok(()),
    }
}

impl MeasuredFile {
    /// Returns the entry for a file with a curve of a specimen.
    ///
    /// # Errors
    /// When its name cannot be written in YAML.
    pub fn curve(name: &str, test: Measurement) -> Result<(Self, Node), InputError> {
        let quoted = serde_json::Value::from(name).to_string();
        let text = format!("{{ file: {quoted}, test: {} }}", test.name());
        let node = Document::from_text(Path::new(""), &text)?.root;
        Ok((Self::read_with(&node, &[])?, node))
    }

    /// Returns the name of the file.
    #[must_use]
    pub fn file(&self) -> &str {
        self.file.as_str()
    }

    /// Returns the name of the file of the pattern.
    #[must_use]
    pub fn pattern(&self) -> Option<&str> {
        self.pattern.as_ref().map(FileName::as_str)
    }

    /// Returns the noise of a file with stresses, if it is stated.
    ///
    /// # Errors
    /// When it is not a share or a stress.
    pub fn noise_of_stress(&self) -> Result<Option<curve::Noise>, InputError> {
        let Some(sigma) = &self.sigma else { return Ok(None) };
        let share = sigma.share().map(curve::Noise::Share);
        let found = share.or_else(|| sigma.quantity(Dimension::Stress).map(curve::Noise::Stress));
        found.map(Some).ok_or_else(|| {
            InputError::new(format!(
                "{}: the standard deviation of stresses is a share or a stress",
                self.file()
            ))
            .help("write it as in `sigma: 3 %` or `sigma: 2 kPa`")
        })
    }

    /// Reads the list `files` of a document.
    ///
    /// # Errors
    /// When it cannot be read, or an entry is not valid.
    pub fn load(path: &Path) -> Result<Vec<(Self, Node)>, InputError> {
        let root = Document::load(path)?.root;
        if let NodeValue::List(_) = root.value() {
            return Err(root
                .error("a list of measurements must be under the key `files`")
                .help("write `files:` above it"));
        }
        let map = root.fields("a list of measurements", &["files"])?;
        let node = map.required("a list of measurements", "files")?;
        let files = node.list("files")?;
        if files.is_empty() {
            return Err(node
                .error("`files` is empty")
                .help("name at least one file of measurements"));
        }
        files
            .iter()
            .map(|node| Ok((Self::read_with(node, &[])?, node.clone())))
            .collect()
    }
}

impl MeasuredFile {
    /// Returns the files that an entry names, with their folders.
    #[must_use]
    pub fn paths(&self, node: &Node) -> Vec<PathBuf> {
        let named = [Some(self.file()), self.pattern()].into_iter().flatten();
        named.map(|name| path_of(node, name)).collect()
    }
}

/// Returns the path of a file that a node names, relative to the folder of the document.
#[must_use]
pub fn path_of(node: &Node, name: &str) -> PathBuf {
    node.file().parent().unwrap_or(Path::new("")).join(name)
}
