//! Quantities as people write them ("5.25 kV", "50 mm", "0 deg"), kept as exact decimals.
//!
//! Exactness matters for identity: a quantity's key must not depend on the unit it was written in, which binary
//! floating point cannot promise. Conversion to `f64` happens once, correctly rounded, where numerics begin.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::digits::four_significant;

/// An exact decimal number `mantissa · 10^exponent`, normalised so that equal numbers are equal values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Decimal {
    mantissa: i64,
    exponent: i32,
}

/// Why a text is not a quantity of a dimension.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QuantityError {
    /// Not a decimal number.
    #[error("{0:?} is not a decimal number such as 5250, 5.25 or 5.25e3")]
    NotANumber(String),
    /// A number that no double holds.
    #[error("{0} is out of range: numbers other than 0 have a size from 5e-324 to 1.8e308")]
    OutOfRange(String),
    /// An unknown unit, or a unit of another dimension.
    #[error("unknown unit {found:?} for {}; allowed: {allowed}", .dimension.with_article())]
    UnknownUnit {
        /// The unit in the text.
        found: String,
        /// The dimension.
        dimension: Dimension,
        /// The allowed units.
        allowed: String,
    },
}

impl QuantityError {
    fn unknown_unit(unit: &str, dimension: Dimension) -> Self {
        let symbols = dimension.symbols();
        let similar: Vec<_> = symbols
            .iter()
            .filter(|symbol| symbol.eq_ignore_ascii_case(unit))
            .collect();
        let allowed = match (symbols.join(", "), &similar[..]) {
            (none, _) if none.is_empty() => "none".to_owned(),
            (allowed, [similar]) => format!("{allowed} (did you mean {similar}?)"),
            (allowed, _) => allowed,
        };
        Self::UnknownUnit {
            found: unit.to_owned(),
            dimension,
            allowed,
        }
    }
}

impl Decimal {
    /// Zero.
    pub const ZERO: Self = Self {
        mantissa: 0,
        exponent: 0,
    };

    /// Returns the shortest decimal that reads as this double; `None` for infinities and NaN.
    #[must_use]
    pub fn from_f64(value: f64) -> Option<Self> {
        value.is_finite().then(|| exact(&format!("{value:e}")))?
    }

    /// Reads a number that must not be rounded; `None` if it has too many digits, or is not a number.
    pub(crate) fn exact(text: &str) -> Option<Self> {
        exact(text)
    }

    /// Returns the nearest double.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        // The standard library's parser rounds correctly; a product of two doubles would not.
        format!("{}e{}", self.mantissa, self.exponent)
            .parse()
            .expect("an integer with an exponent is a valid float literal")
    }

    /// Returns the number as an integer, if it is one and fits.
    #[must_use]
    pub fn to_u64(self) -> Option<u64> {
        let mantissa = u64::try_from(self.mantissa).ok()?;
        let power = 10u64.checked_pow(u32::try_from(self.exponent).ok()?)?;
        mantissa.checked_mul(power)
    }

    /// Returns this number times a power of ten.
    #[must_use]
    pub fn scaled(self, power: i32) -> Self {
        if self.mantissa == 0 {
            return self;
        }
        Self {
            exponent: self.exponent + power,
            ..self
        }
    }

    /// Returns this number times an integer, rounded if the digits do not fit.
    fn times(self, factor: i64) -> Result<Self, QuantityError> {
        let product = i128::from(self.mantissa) * i128::from(factor);
        format!("{product}e{}", self.exponent).parse()
    }

    fn normalised(mut mantissa: i64, mut exponent: i32) -> Self {
        if mantissa == 0 {
            return Self::ZERO;
        }
        while mantissa % 10 == 0 {
            mantissa /= 10;
            exponent += 1;
        }
        Self { mantissa, exponent }
    }
}

impl From<u64> for Decimal {
    fn from(value: u64) -> Self {
        // Integers beyond 2^63 do not occur: seeds and counts above i64::MAX are rejected on reading.
        Self::normalised(i64::try_from(value).unwrap_or(i64::MAX), 0)
    }
}

/// Reads a number. One with at most 18 significant digits is exact; another is rounded to the nearest double, since
/// programs write doubles with more digits than these hold (`numpy.savetxt` with 19).
impl FromStr for Decimal {
    type Err = QuantityError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(exact) = exact(text) {
            return Ok(exact);
        }
        let is_decimal = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
        let Some(nearest) = text.parse::<f64>().ok().filter(|_| is_decimal) else {
            return Err(QuantityError::NotANumber(text.to_owned()));
        };
        Self::from_f64(nearest).ok_or_else(|| QuantityError::OutOfRange(text.to_owned()))
    }
}

/// Significant digits that are kept exactly.
const DIGITS: usize = 18;

/// Returns a decimal number with all its digits; `None` if they are too many, no double has its size, or the text is
/// not a number.
fn exact(text: &str) -> Option<Decimal> {
    let (number, exponent) = match text.find(['e', 'E']) {
        Some(at) => (&text[..at], text[at + 1..].parse::<i32>().ok()?),
        None => (text, 0),
    };
    let (negative, digits) = match number.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, number.strip_prefix('+').unwrap_or(number)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let all: String = format!("{whole}{fraction}");
    if all.is_empty() || !all.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let trimmed = all.trim_start_matches('0');
    let kept = trimmed.trim_end_matches('0');
    if kept.is_empty() {
        return Some(Decimal::ZERO);
    }
    if kept.len() > DIGITS {
        return None;
    }
    let dropped = i32::try_from(trimmed.len() - kept.len()).ok()?;
    let places = i32::try_from(fraction.len()).ok()?;
    let exponent = exponent.checked_sub(places)?.checked_add(dropped)?;
    let mantissa: i64 = kept.parse().ok()?;
    let read = Decimal::normalised(if negative { -mantissa } else { mantissa }, exponent);
    // Doubles have sizes from 5e-324 to 1.8e308.
    let leading = exponent.checked_add(kept.len() as i32 - 1)?;
    let is_double = match leading {
        -323..=307 => true,
        -324 | 308 => read.to_f64().is_normal() || read.to_f64().is_subnormal(),
        _ => false,
    };
    is_double.then_some(read)
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if (-12..=15).contains(&self.exponent) {
            let digits = self.mantissa.unsigned_abs().to_string();
            let sign = if self.mantissa < 0 { "-" } else { "" };
            if self.exponent >= 0 {
                let zeros = "0".repeat(self.exponent as usize);
                return write!(f, "{sign}{digits}{zeros}");
            }
            let places = self.exponent.unsigned_abs() as usize;
            let padded = format!("{digits:0>width$}", width = places + 1);
            let (whole, fraction) = padded.split_at(padded.len() - places);
            return write!(f, "{sign}{whole}.{fraction}");
        }
        write!(f, "{}e{}", self.mantissa, self.exponent)
    }
}

/// The dimension of a quantity. Keys and files use its base unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Dimension {
    /// A pure number.
    Number,
    /// A length, base unit mm.
    Length,
    /// A voltage, base unit V.
    Voltage,
    /// A stress or modulus, base unit Pa.
    Stress,
    /// A plane angle, base unit deg.
    Angle,
    /// An electric field, base unit V/m.
    Field,
    /// A frequency, base unit Hz.
    Frequency,
    /// A time, base unit s.
    Time,
    /// A mass, base unit kg.
    Mass,
    /// A density of mass, base unit kg/m3.
    Density,
    /// An electric resistance, base unit Ohm.
    Resistance,
    /// A force, base unit N.
    Force,
    /// The stiffness of a spring, base unit N/m.
    SpringRate,
    /// An electric charge, base unit C.
    Charge,
    /// An electric current, base unit A.
    Current,
    /// A volume, base unit ml.
    Volume,
}

impl Dimension {
    /// All dimensions.
    pub const ALL: [Self; 16] = [
        Self::Number,
        Self::Length,
        Self::Voltage,
        Self::Stress,
        Self::Angle,
        Self::Field,
        Self::Frequency,
        Self::Time,
        Self::Mass,
        Self::Density,
        Self::Resistance,
        Self::Force,
        Self::SpringRate,
        Self::Charge,
        Self::Current,
        Self::Volume,
    ];

    /// The symbol of the base unit, which bare numbers and files have.
    #[must_use]
    pub fn base_unit(self) -> &'static str {
        self.units().first().map_or("", |unit| unit.0)
    }

    /// Whether it has a unit with this symbol.
    #[must_use]
    pub fn has_unit(self, symbol: &str) -> bool {
        self.units().iter().any(|(unit, _)| *unit == symbol)
    }

    /// Returns the dimension whose base unit has this symbol.
    #[must_use]
    pub fn of_base_unit(symbol: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|dimension| dimension.base_unit() == symbol)
    }

    /// Returns the unit in which people read measured and fitted numbers, and the number of it in a base unit.
    #[must_use]
    pub fn display_unit(self) -> (f64, &'static str) {
        match self {
            Self::Stress => (1e-3, "kPa"),
            Self::Voltage => (1e-3, "kV"),
            other => (1.0, other.base_unit()),
        }
    }

    /// Writes a number that is in the base unit with four digits in the unit in which people read it.
    #[must_use]
    pub fn with_unit(self, value: f64) -> String {
        let (factor, unit) = self.display_unit();
        format!("{} {unit}", four_significant(factor * value))
            .trim_end()
            .to_owned()
    }

    /// The symbols of the units, base unit first.
    #[must_use]
    pub fn symbols(self) -> Vec<&'static str> {
        self.units().iter().map(|unit| unit.0).collect()
    }

    /// The factor of a unit in addition to the power of ten in [`Dimension::units`].
    fn multiple(self, symbol: &str) -> i64 {
        match (self, symbol) {
            (Self::Time, "min") => 60,
            (Self::Time, "h") => 36,
            _ => 1,
        }
    }

    /// The units and their powers of ten relative to the base unit, base unit first.
    fn units(self) -> &'static [(&'static str, i32)] {
        match self {
            Self::Number => &[],
            Self::Length => &[
                ("mm", 0),
                ("m", 3),
                ("cm", 1),
                ("um", -3),
                ("µm", -3),
                ("μm", -3),
                ("nm", -6),
            ],
            Self::Voltage => &[("V", 0), ("kV", 3), ("MV", 6), ("mV", -3)],
            Self::Stress => &[("Pa", 0), ("kPa", 3), ("MPa", 6), ("GPa", 9)],
            Self::Angle => &[("deg", 0), ("°", 0)],
            Self::Field => &[("V/m", 0), ("kV/m", 3), ("MV/m", 6), ("V/um", 6), ("kV/mm", 6)],
            Self::Frequency => &[("Hz", 0), ("kHz", 3), ("MHz", 6), ("mHz", -3)],
            Self::Time => &[("s", 0), ("ms", -3), ("us", -6), ("ks", 3), ("min", 0), ("h", 2)],
            Self::Mass => &[("kg", 0), ("g", -3), ("mg", -6)],
            Self::Density => &[("kg/m3", 0), ("g/cm3", 3)],
            Self::Resistance => &[("Ohm", 0), ("kOhm", 3), ("MOhm", 6), ("GOhm", 9)],
            Self::Force => &[("N", 0), ("mN", -3), ("uN", -6), ("kN", 3)],
            Self::SpringRate => &[("N/m", 0), ("mN/m", -3), ("N/mm", 3), ("kN/m", 3)],
            Self::Charge => &[
                ("C", 0),
                ("mC", -3),
                ("uC", -6),
                ("µC", -6),
                ("μC", -6),
                ("nC", -9),
                ("pC", -12),
            ],
            Self::Volume => &[("ml", 0), ("l", 3), ("ul", -3), ("mm3", -3), ("cm3", 0), ("m3", 6)],
            Self::Current => &[
                ("A", 0),
                ("mA", -3),
                ("uA", -6),
                ("µA", -6),
                ("μA", -6),
                ("nA", -9),
                ("pA", -12),
            ],
        }
    }

    /// Returns the name with an article: "a voltage", "an angle".
    #[must_use]
    pub fn with_article(self) -> String {
        let name = self.to_string();
        let article = if name.starts_with(['a', 'e']) { "an" } else { "a" };
        format!("{article} {name}")
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Number => "number",
            Self::Length => "length",
            Self::Voltage => "voltage",
            Self::Stress => "stress",
            Self::Angle => "angle",
            Self::Field => "electric field",
            Self::Frequency => "frequency",
            Self::Time => "time",
            Self::Mass => "mass",
            Self::Density => "density",
            Self::Resistance => "resistance",
            Self::Force => "force",
            Self::SpringRate => "spring rate",
            Self::Charge => "charge",
            Self::Current => "current",
            Self::Volume => "volume",
        })
    }
}

/// An exact number with a dimension, stored in the dimension's base unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Quantity {
    base: Decimal,
    dimension: Dimension,
}

impl Quantity {
    /// Reads "5.25 kV", "5250V" or a bare "5250" (in the base unit) as a quantity of `dimension`.
    ///
    /// # Errors
    /// When the number is malformed or the unit is not one of the dimension's.
    pub fn parse(text: &str, dimension: Dimension) -> Result<Self, QuantityError> {
        let text = text.trim();
        let end = number_end(text);
        let (number, unit) = (&text[..end], text[end..].trim());
        if unit.starts_with(',') {
            // A decimal comma is not a unit.
            return Err(QuantityError::NotANumber(text.to_owned()));
        }
        let refused = |error: QuantityError| match error {
            QuantityError::OutOfRange(_) => QuantityError::OutOfRange(text.to_owned()),
            _ => QuantityError::NotANumber(text.to_owned()),
        };
        let value: Decimal = number.parse().map_err(refused)?;
        let mantissa = number.split(['e', 'E']).next().unwrap_or_default();
        if value == Decimal::ZERO && mantissa.bytes().any(|b| matches!(b, b'1'..=b'9')) {
            return Err(QuantityError::OutOfRange(text.to_owned()));
        }
        if unit.is_empty() {
            return Ok(Self { base: value, dimension });
        }
        let Some((_, power)) = dimension.units().iter().find(|(symbol, _)| *symbol == unit) else {
            return Err(QuantityError::unknown_unit(unit, dimension));
        };
        let base = value.times(dimension.multiple(unit)).map_err(refused)?.scaled(*power);
        let found = base.to_f64();
        match found.is_finite() && (found == 0.0) == (value == Decimal::ZERO) {
            true => Ok(Self { base, dimension }),
            false => Err(QuantityError::OutOfRange(text.to_owned())),
        }
    }

    /// Whether it was read from a text without a unit although its dimension has units; zero needs none.
    #[must_use]
    pub fn is_bare_in(&self, text: &str) -> bool {
        let text = text.trim();
        !self.dimension.units().is_empty() && self.base != Decimal::ZERO && number_end(text) == text.len()
    }

    /// Creates a quantity from an exact number in the base unit.
    #[must_use]
    pub fn new(base: Decimal, dimension: Dimension) -> Self {
        Self { base, dimension }
    }

    /// Creates a quantity from a number in the base unit; `None` unless finite.
    #[must_use]
    pub fn from_f64(value: f64, dimension: Dimension) -> Option<Self> {
        Some(Self {
            base: Decimal::from_f64(value)?,
            dimension,
        })
    }

    /// The exact number in the base unit.
    #[must_use]
    pub fn base(&self) -> Decimal {
        self.base
    }

    /// The number in the base unit (mm, V, Pa, deg), correctly rounded.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.base.to_f64()
    }

    /// The dimension.
    #[must_use]
    pub fn dimension(&self) -> Dimension {
        self.dimension
    }
}

/// Returns where the number ends and the unit begins: "1e3 V" has an exponent, "1 eV" has not.
fn number_end(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let numeric = match bytes[i] {
            b'0'..=b'9' | b'.' => true,
            b'+' | b'-' => i == 0 || matches!(bytes[i - 1], b'e' | b'E'),
            b'e' | b'E' => {
                let rest = &bytes[i + 1..];
                let signed = rest.first().is_some_and(|c| matches!(c, b'+' | b'-'));
                i > 0 && rest.get(usize::from(signed)).is_some_and(u8::is_ascii_digit)
            }
            _ => false,
        };
        if !numeric {
            break;
        }
        i += 1;
    }
    i
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.dimension.base_unit() {
            "" => write!(f, "{}", self.base),
            unit => write!(f, "{} {unit}", self.base),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_quantities_are_equal_whatever_their_unit() {
        let volts = |text| Quantity::parse(text, Dimension::Voltage).unwrap();
        for text in ["5250 V", "5.25kV", "5250", "5.250e3 V", "0.00525 MV", "5250.0"] {
            assert_eq!(volts(text), volts("5.25 kV"), "{text}");
        }
        assert_eq!(volts("-0"), volts("0"));
        assert_eq!(volts("5.25 kV").value(), 5250.0);
        assert_eq!(volts("5.25 kV").to_string(), "5250 V");
    }

    #[test]
    fn conversion_to_f64_is_correctly_rounded() {
        let length = |text| Quantity::parse(text, Dimension::Length).unwrap().value();
        assert_eq!(length("0.1 um"), 0.0001);
        assert_eq!(length("0.3"), 0.3);
        assert_eq!(length("2.5 cm"), 25.0);
    }

    #[test]
    fn a_number_without_a_unit_is_bare_unless_it_is_zero_or_has_no_dimension() {
        let is_bare = |text: &str, dimension| Quantity::parse(text, dimension).unwrap().is_bare_in(text);
        assert!(is_bare("5.25", Dimension::Voltage) && is_bare(" 1e3 ", Dimension::Length));
        assert!(!is_bare("5.25 V", Dimension::Voltage) && !is_bare("1e3mm", Dimension::Length));
        assert!(!is_bare("0", Dimension::Angle) && !is_bare("3", Dimension::Number));
    }

    #[test]
    fn measured_numbers_are_read_in_usual_units() {
        let texts = [
            Dimension::Stress.with_unit(45_172.2),
            Dimension::Voltage.with_unit(-120.0),
            Dimension::Time.with_unit(0.828_24),
            Dimension::Number.with_unit(4.7),
        ];
        assert_eq!(texts, ["45.17 kPa", "−0.1200 kV", "0.8282 s", "4.700"]);
        for dimension in Dimension::ALL {
            assert_eq!(Dimension::of_base_unit(dimension.base_unit()), Some(dimension));
        }
        assert_eq!(Dimension::of_base_unit("kV"), None);
    }

    #[test]
    fn minutes_and_hours_are_times() {
        let time = |text| Quantity::parse(text, Dimension::Time);
        assert_eq!(time("10 min"), time("600 s"));
        assert_eq!(time("1.5h"), time("5400 s"));
        assert_eq!(
            time("999999999999999999 min").unwrap().value(),
            6e19,
            "rounded to a double"
        );
    }

    #[test]
    fn errors_name_what_was_found() {
        let error = Quantity::parse("5 mm", Dimension::Voltage).unwrap_err().to_string();
        assert_eq!(error, "unknown unit \"mm\" for a voltage; allowed: V, kV, MV, mV");
        let error = Quantity::parse("5 mm", Dimension::Number).unwrap_err().to_string();
        assert_eq!(error, "unknown unit \"mm\" for a number; allowed: none");
        let error = Quantity::parse("5 mm", Dimension::Field).unwrap_err().to_string();
        assert!(error.contains("for an electric field; allowed: V/m"), "{error}");
        for text in ["", "kV", "1.2.3 V", "--5", "1e999", "NaN", "inf", "1,5", "1e308 MV"] {
            assert!(Quantity::parse(text, Dimension::Voltage).is_err(), "{text}");
        }
        let error = Quantity::parse("1e999 V", Dimension::Voltage).unwrap_err().to_string();
        let range = "is out of range: numbers other than 0 have a size from 5e-324 to 1.8e308";
        assert_eq!(error, format!("1e999 V {range}"));
        for text in ["1e-400 V", "1e-2000000000 V", "0.01e-330", "1e-999", "1e-323 mV"] {
            let error = Quantity::parse(text, Dimension::Voltage).unwrap_err().to_string();
            assert_eq!(error, format!("{text} {range}"));
        }
        assert!(Quantity::parse("-0.00e-999 V", Dimension::Voltage).is_ok());
    }

    /// `numpy.savetxt` writes 19 digits, C++ with `max_digits10` 17, MATLAB's `format long` 16.
    #[test]
    fn more_digits_than_a_double_holds_are_rounded_to_the_double() {
        for (text, shortest) in [
            ("5.000000000000000409e-06", "5e-6"),
            ("2.061664879999778677e+01", "20.61664879999778677"),
            ("1.000000000000000056e-01", "0.1"),
            ("-5.000000000000000277e-02", "-0.05"),
            ("5.000000000000000000e+03", "5000"),
            ("12345678901234567890123", "12345678901234567890123"),
            ("3.000000000000000000000000000000000000000001", "3"),
            ("1.7976931348623157e308", "1.7976931348623157e308"),
            ("4.940656458412465442e-324", "5e-324"),
            ("2.5e-310", "2.5e-310"),
            ("1e-400", "0"),
        ] {
            let read: Decimal = text.parse().unwrap();
            assert_eq!(read.to_f64(), text.parse::<f64>().unwrap(), "{text}");
            assert_eq!(read, Decimal::from_f64(shortest.parse().unwrap()).unwrap(), "{text}");
        }
        // Up to 18 digits a number is exact, as before.
        let exact: Decimal = "0.123456789012345678".parse().unwrap();
        assert_eq!(exact.to_string(), "123456789012345678e-18");
        for refused in ["1.8e308", "1e999", "1e99999999999"] {
            assert!(
                matches!(refused.parse::<Decimal>(), Err(QuantityError::OutOfRange(_))),
                "{refused}"
            );
        }
    }

    #[test]
    fn decimals_are_printed_in_usual_notation() {
        for text in ["0", "5250", "0.5", "-12.75", "0.000001"] {
            assert_eq!(text.parse::<Decimal>().unwrap().to_string(), text);
        }
        assert_eq!(Decimal::from_f64(0.1).unwrap().to_string(), "0.1");
        assert_eq!(Decimal::from_f64(f64::NAN), None);
    }
}
