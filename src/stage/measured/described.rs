//! Fitted parameters and outliers in words.

use super::free::FreeKey;
use deaflow_base::{Dimension, four_significant};
use deaflow_fit::{Outlier, Parameter};

/// Describes an outlier.
#[must_use]
pub fn outlier(outlier: &Outlier) -> String {
    format!(
        "{}, row {}: {} standard deviations",
        outlier.curve,
        outlier.row,
        four_significant(outlier.deviations)
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

/// Returns the value of a parameter, and its interval of 95 % if the search `converged`.
#[must_use]
pub fn with_interval(parameter: &Parameter, key: &FreeKey, converged: bool) -> [String; 2] {
    let (factor, _) = key.dimension.display_unit();
    let known = |(low, high): &(f64, f64)| !low.is_nan() && !high.is_nan();
    let interval = match parameter
        .profile
        .or(parameter.interval)
        .filter(known)
        .filter(|_| converged)
    {
        Some((low, high)) => format!(
            "{} to {}",
            four_significant(factor * low),
            key.dimension.with_unit(high)
        ),
        None if parameter.at_bound => "at its bound".to_owned(),
        None => "unknown".to_owned(),
    };
    [key.dimension.with_unit(parameter.value), interval]
}
