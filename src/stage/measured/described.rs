//! Fitted parameters and outliers in words.

use super::free::FreeKey;
use deaflow_base::{Dimension, with_minus};
use deaflow_fit::{Outlier, Parameter};

/// Returns four significant digits, also of infinite numbers.
#[must_use]
pub fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return with_minus(&value.to_string()).replace("inf", "∞");
    }
    let decimals = 3 - value.abs().log10().floor() as i32;
    match (-2..=9).contains(&decimals) {
        true => with_minus(&format!("{value:.*}", decimals.max(0) as usize)),
        false => with_minus(&format!("{value:.3e}")),
    }
}

/// Describes an outlier.
#[must_use]
pub fn outlier(outlier: &Outlier) -> String {
    format!(
        "{}, row {}: {} standard deviations",
        outlier.curve,
        outlier.row,
        digits(outlier.deviations)
    )
}

/// Returns the dimension of a parameter of a law or of branches.
#[must_use]
pub fn dimension_of(parameter: &str) -> Dimension {
    let is = |starts: &[&str]| starts.iter().any(|start| parameter.starts_with(start));
    if is(&["shear_modulus", "branch_modulus", "g_", "c2", "c3"]) {
        Dimension::Stress
    } else if is(&["branch_time", "tau_"]) {
        Dimension::Time
    } else {
        Dimension::Number
    }
}

/// Returns the factor and the unit in which people read a quantity.
#[must_use]
pub fn unit_of(dimension: Dimension) -> (f64, String) {
    match dimension {
        Dimension::Stress => (1e-3, " kPa".to_owned()),
        Dimension::Voltage => (1e-3, " kV".to_owned()),
        Dimension::Number => (1.0, String::new()),
        other => (1.0, format!(" {}", other.base_unit())),
    }
}

/// Returns the value of a parameter, and its interval of 95 % if the search `converged`.
#[must_use]
pub fn with_interval(parameter: &Parameter, key: &FreeKey, converged: bool) -> [String; 2] {
    let (factor, unit) = unit_of(key.dimension);
    let value = |value: f64| digits(factor * value);
    let known = |(low, high): &(f64, f64)| !low.is_nan() && !high.is_nan();
    let interval = match parameter
        .profile
        .or(parameter.interval)
        .filter(known)
        .filter(|_| converged)
    {
        Some((low, high)) => format!("{} to {}{unit}", value(low), value(high)),
        None if parameter.at_bound => "at its bound".to_owned(),
        None => "unknown".to_owned(),
    };
    [format!("{}{unit}", value(parameter.value)), interval]
}
