//! Errors of predicted fields.

use std::collections::BTreeSet;

use super::example::{Example, Label};
use deaflow_dataset::Split;

/// Name of the group of all families.
pub(crate) const ALL: &str = "all";

/// Errors of predicted fields over a group of examples.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics {
    /// The family, or "all".
    pub family: String,
    /// The split.
    pub split: Split,
    /// Number of examples.
    pub samples: u64,
    /// Root mean square error in mm over both components at all corners.
    pub rmse_mm: f64,
    /// Coefficient of determination over all components: 1 − Σ error² / Σ (value − mean)². For constant values it is 1
    /// for a perfect prediction and 0 otherwise.
    pub r2: f64,
    /// Largest absolute error of a component in mm.
    pub max_error_mm: f64,
}

/// Contribution of one prediction to the metrics of its groups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ErrorSums {
    /// Number of components of the field: both at all corners, the edges included, which are zero.
    components: f64,
    /// Sum of the squared errors of the components, mm².
    error: f64,
    /// Largest absolute error of a component, mm.
    largest: f64,
    /// Sum of the simulated components, mm.
    sum: f64,
    /// Sum of the squares of the simulated components, mm².
    squares: f64,
}

impl ErrorSums {
    /// Compares a label with a prediction at the same inner corners in units of `scale` mm.
    pub(crate) fn of(label: &Label, predicted: &[f32], scale: f64) -> Self {
        let mut sums = Self {
            components: (2 * label.raster().corners()) as f64,
            error: 0.0,
            largest: 0.0,
            sum: 0.0,
            squares: 0.0,
        };
        for (value, predicted) in label.values().iter().zip(predicted) {
            let value = f64::from(*value);
            let error = f64::from(*predicted) * scale - value;
            sums.error += error * error;
            sums.largest = sums.largest.max(error.abs());
            sums.sum += value;
            sums.squares += value * value;
        }
        sums
    }
}

/// Returns the root mean square error in mm over all components.
pub(crate) fn rmse_mm(sums: &[ErrorSums]) -> f64 {
    let errors: f64 = sums.iter().map(|a| a.error).sum();
    let components: f64 = sums.iter().map(|a| a.components).sum();
    (errors / components).sqrt()
}

/// Returns the root mean square error in mm with each prediction weighted by its count.
pub(crate) fn weighted_rmse_mm(sums: impl Iterator<Item = (ErrorSums, u32)>) -> f64 {
    let (errors, count) = sums.fold((0.0, 0.0), |(errors, count), (sums, weight)| {
        let weight = f64::from(weight);
        (errors + weight * sums.error, count + weight * sums.components)
    });
    (errors / count).sqrt()
}

/// Returns the metrics of every group with examples: for each split "all", then the families by name.
pub(crate) fn measure(examples: &[Example], sums: &[ErrorSums]) -> Vec<Metrics> {
    let families: BTreeSet<&str> = examples.iter().map(|e| e.family.as_str()).collect();
    let names: Vec<&str> = std::iter::once(ALL).chain(families).collect();
    let mut metrics = Vec::new();
    for split in Split::ALL {
        for &name in &names {
            let group: Vec<ErrorSums> = examples
                .iter()
                .zip(sums)
                .filter(|(e, _)| e.split == split && (name == ALL || e.family == name))
                .map(|(_, sums)| *sums)
                .collect();
            if !group.is_empty() {
                metrics.push(of_group(name, split, &group));
            }
        }
    }
    metrics
}

fn of_group(family: &str, split: Split, group: &[ErrorSums]) -> Metrics {
    let total = |part: fn(&ErrorSums) -> f64| group.iter().map(part).sum::<f64>();
    let (error, sum, squares) = (total(|a| a.error), total(|a| a.sum), total(|a| a.squares));
    let count = total(|a| a.components);
    let variation = squares - sum * sum / count;
    let r2 = if variation > 0.0 {
        1.0 - error / variation
    } else {
        f64::from(u8::from(error == 0.0))
    };
    Metrics {
        family: family.to_owned(),
        split,
        samples: group.len() as u64,
        rmse_mm: (error / count).sqrt(),
        r2,
        max_error_mm: group.iter().map(|a| a.largest).fold(0.0, f64::max),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;
    use deaflow_pattern::{Pattern, Raster};

    const COMPONENTS: f64 = (2 * CORNERS * CORNERS) as f64;

    /// A label that is zero except for the first components.
    fn label(first: &[f64]) -> Label {
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        values[2 * (CORNERS + 1)..][..first.len()].copy_from_slice(first);
        Label::from_values(Raster::PAPER, &values).unwrap()
    }

    fn example(family: &str, split: Split, first: &[f64]) -> Example {
        Example {
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| false),
            label: label(first),
            family: family.to_owned(),
            split,
            repeats: 1,
        }
    }

    fn measured(examples: &[Example], predicted: &[&[f64]]) -> Vec<Metrics> {
        let pairs = examples.iter().zip(predicted);
        let sums: Vec<ErrorSums> = pairs
            .map(|(example, first)| ErrorSums::of(&example.label, &label(first).values(), 1.0))
            .collect();
        measure(examples, &sums)
    }

    #[test]
    fn by_hand() {
        let examples = [example("a", Split::Test, &[3.0, -1.0])];
        let found = measured(&examples, &[&[1.0, 0.0]]);
        let variation = 10.0 - 4.0 / COMPONENTS;
        assert_eq!(found.len(), 2);
        assert!((found[1].rmse_mm - (5.0 / COMPONENTS).sqrt()).abs() < 1e-15);
        assert!((found[1].r2 - (1.0 - 5.0 / variation)).abs() < 1e-12);
        assert_eq!((found[1].max_error_mm, found[1].samples), (2.0, 1));
    }

    #[test]
    fn predictions_are_in_units_of_the_scale() {
        let found = ErrorSums::of(&label(&[0.5, 1.0]), &label(&[1.0, 2.5]).values(), 0.5);
        let expected = ErrorSums {
            components: COMPONENTS,
            error: 0.0625,
            largest: 0.25,
            sum: 1.5,
            squares: 1.25,
        };
        assert_eq!(found, expected);
        assert!((rmse_mm(&[found, found]) - (0.0625 / COMPONENTS).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn groups_have_a_fixed_order_and_empty_groups_are_omitted() {
        let examples = [
            example("b", Split::Test, &[1.0]),
            example("b", Split::Train, &[1.0]),
            example("a", Split::Train, &[1.0]),
        ];
        let found = measured(&examples, &[&[1.0], &[], &[2.0]]);
        let groups: Vec<_> = found.iter().map(|m| (m.split, m.family.as_str(), m.samples)).collect();
        use Split::{Test, Train};
        let expected = [
            (Train, "all", 2),
            (Train, "a", 1),
            (Train, "b", 1),
            (Test, "all", 1),
            (Test, "b", 1),
        ];
        assert_eq!(groups, expected);
        assert_eq!(found[4].rmse_mm, 0.0);
    }

    #[test]
    fn zero_fields_have_a_coefficient_of_determination() {
        let examples = [example("a", Split::Test, &[])];
        assert_eq!(measured(&examples, &[&[]])[0].r2, 1.0);
        assert_eq!(measured(&examples, &[&[1.0]])[0].r2, 0.0);
    }
}
