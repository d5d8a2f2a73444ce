//! Columns of tables by their names, with units: `x_mm`, `x [mm]`, `x (mm)` or `x/mm`.

use deaflow_base::listed;

/// Units with their size in the unit that readers use.
pub type Units<'a> = &'a [(&'static str, f64)];

/// Units of stress, in Pa.
pub const STRESS: Units<'static> = &[("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9), ("N/mm2", 1e6)];

/// Units of length, in mm.
pub const LENGTH: Units<'static> = &[
    ("mm", 1.0),
    ("nm", 1e-6),
    ("um", 1e-3),
    ("µm", 1e-3),
    ("μm", 1e-3),
    ("cm", 10.0),
    ("m", 1e3),
];

/// Units of voltage, in V.
pub const VOLTAGE: Units<'static> = &[("V", 1.0), ("kV", 1e3), ("MV", 1e6)];

/// Units of time, in s.
pub const TIME: Units<'static> = &[("s", 1.0), ("ms", 1e-3), ("min", 60.0), ("h", 3600.0)];

/// Units of frequency, in Hz.
pub const FREQUENCY: Units<'static> = &[("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6), ("mHz", 1e-3)];

/// Units of phase, in degrees.
pub const PHASE: Units<'static> = &[("deg", 1.0), ("°", 1.0), ("rad", 180.0 / std::f64::consts::PI)];

/// A column and the factor that converts its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Its place, from 0.
    pub at: usize,
    /// The size of its unit.
    pub factor: f64,
}

/// The names of the columns of a table.
pub struct Header(Vec<String>);

impl Header {
    /// Takes the fields of the first line.
    pub fn new(fields: Vec<String>) -> Self {
        Self(fields)
    }

    /// Lists the columns.
    pub fn listed(&self) -> String {
        listed(&self.0)
    }

    /// Finds a column without unit.
    ///
    /// # Errors
    /// When there are two.
    pub fn plain(&self, name: &str) -> Result<Option<usize>, String> {
        self.only(name, |own| own.eq_ignore_ascii_case(name))
    }

    /// Finds a column with a unit; one without has the `usual` one.
    ///
    /// # Errors
    /// When it has an unknown unit or none, or there are two.
    pub fn with_unit(&self, name: &str, units: Units<'_>, usual: Option<f64>) -> Result<Option<Column>, String> {
        let Some(at) = self.only(name, |own| unit_of(own, name).is_some())? else {
            return Ok(None);
        };
        let allowed = || units.iter().map(|(unit, _)| *unit).collect::<Vec<_>>().join(", ");
        let found = unit_of(&self.0[at], name).unwrap_or_default();
        let known = units.iter().find(|(unit, _)| *unit == found).map(|(_, factor)| *factor);
        let factor = match (known, found) {
            (Some(factor), _) => Ok(factor),
            (None, "") => {
                usual.ok_or_else(|| format!("the column `{name}` has no unit; write it as `{name}_{}`", units[0].0))
            }
            (None, _) => Err(format!(
                "the column `{}` has an unknown unit; allowed: {}",
                self.0[at],
                allowed()
            )),
        };
        factor.map(|factor| Some(Column { at, factor }))
    }

    fn only(&self, name: &str, is_named: impl Fn(&String) -> bool) -> Result<Option<usize>, String> {
        let mut found = (0..self.0.len()).filter(|at| is_named(&self.0[*at]));
        match (found.next(), found.next()) {
            (Some(_), Some(_)) => Err(format!("the file has two columns `{name}`")),
            (at, _) => Ok(at),
        }
    }
}

/// Returns the unit in the name of a column, empty if it has none; `None` for another column.
fn unit_of<'a>(own: &'a str, name: &str) -> Option<&'a str> {
    let (start, rest) = own.split_at_checked(name.len())?;
    if !start.eq_ignore_ascii_case(name) {
        return None;
    }
    let rest = rest.trim();
    let within = |open: char, close: char| rest.strip_prefix(open)?.strip_suffix(close);
    let unit = within('[', ']')
        .or_else(|| within('(', ')'))
        .or_else(|| rest.strip_prefix(['_', '/']));
    match (unit, rest) {
        (Some(unit), _) => Some(unit.trim()),
        (None, "") => Some(""),
        (None, _) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{Header, LENGTH};

    #[test]
    fn units_are_written_in_several_ways() {
        let header = |names: &[&str]| Header::new(names.iter().map(|name| (*name).to_owned()).collect());
        for (name, factor) in [
            ("x_mm", 1.0),
            ("X [um]", 1e-3),
            ("x (m)", 1e3),
            ("x/cm", 10.0),
            ("x", 0.5),
        ] {
            let found = header(&["ux_mm", name])
                .with_unit("x", LENGTH, Some(0.5))
                .unwrap()
                .unwrap();
            assert_eq!((found.at, found.factor), (1, factor), "{name}");
        }
        let refusal = |names: &[&str]| header(names).with_unit("x", LENGTH, None).unwrap_err();
        assert!(refusal(&["x"]).contains("`x_mm`"));
        assert!(refusal(&["x_kg"]).contains("unknown unit"));
        assert!(refusal(&["x_mm", "x [m]"]).contains("two columns"));
        assert_eq!(header(&["xx_mm", "ux"]).with_unit("x", LENGTH, None), Ok(None));
    }
}
