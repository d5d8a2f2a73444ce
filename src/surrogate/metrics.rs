//! How well predictions agree with simulations.

use std::collections::BTreeSet;

use super::example::Example;
use crate::dataset::Split;
use crate::field::Field;

/// The name under which all families are measured together.
const ALL: &str = "all";

/// Agreement of predicted with simulated fields over a group of examples.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics {
    /// The family, or "all".
    pub family: String,
    /// The part of the dataset.
    pub split: Split,
    /// How many examples.
    pub samples: u64,
    /// Root mean square error in mm over both components at all 51 × 51 corners.
    pub rmse_mm: f64,
    /// Coefficient of determination over all components: 1 − Σ error² / Σ (value − mean)². Where the values do not vary
    /// it is 1 for a perfect prediction and 0 otherwise.
    pub r2: f64,
    /// Largest absolute error of a component in mm.
    pub max_error_mm: f64,
}

/// The metrics of every group that has examples: for each part of the dataset "all", then the families by name.
pub(crate) fn measure(examples: &[Example], predicted: &[Field]) -> Vec<Metrics> {
    let families: BTreeSet<&str> = examples.iter().map(|e| e.family.as_str()).collect();
    let names: Vec<&str> = std::iter::once(ALL).chain(families).collect();
    let mut metrics = Vec::new();
    for split in Split::ALL {
        for &name in &names {
            let pairs: Vec<(&Field, &Field)> = examples
                .iter()
                .zip(predicted)
                .filter(|(e, _)| e.split == split && (name == ALL || e.family == name))
                .map(|(e, p)| (&e.field, p))
                .collect();
            if !pairs.is_empty() {
                metrics.push(compare(name, split, &pairs));
            }
        }
    }
    metrics
}

fn compare(family: &str, split: Split, pairs: &[(&Field, &Field)]) -> Metrics {
    let values = || pairs.iter().flat_map(|(t, p)| t.values().iter().zip(p.values()));
    let count = values().count() as f64;
    let mean = values().map(|(t, _)| t).sum::<f64>() / count;
    let variation: f64 = values().map(|(t, _)| (t - mean).powi(2)).sum();
    let error: f64 = values().map(|(t, p)| (t - p).powi(2)).sum();
    let r2 = if variation > 0.0 {
        1.0 - error / variation
    } else {
        f64::from(u8::from(error == 0.0))
    };
    Metrics {
        family: family.to_owned(),
        split,
        samples: pairs.len() as u64,
        rmse_mm: (error / count).sqrt(),
        r2,
        max_error_mm: values().map(|(t, p)| (t - p).abs()).fold(0.0, f64::max),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::CORNERS;
    use crate::pattern::Pattern;

    /// A field that is zero but for the first components.
    fn field(first: &[f64]) -> Field {
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        values[..first.len()].copy_from_slice(first);
        Field::from_values(values).unwrap()
    }

    fn example(family: &str, split: Split, first: &[f64]) -> Example {
        let pattern = Pattern::from_fn(|_, _| false);
        Example {
            pattern,
            field: field(first),
            family: family.to_owned(),
            split,
        }
    }

    #[test]
    fn by_hand() {
        let examples = [example("a", Split::Test, &[3.0, -1.0])];
        let found = measure(&examples, &[field(&[1.0, 0.0])]);
        let n = (CORNERS * CORNERS * 2) as f64;
        let variation = 10.0 - 4.0 / n;
        assert_eq!(found.len(), 2);
        assert!((found[1].rmse_mm - (5.0 / n).sqrt()).abs() < 1e-15);
        assert!((found[1].r2 - (1.0 - 5.0 / variation)).abs() < 1e-12);
        assert_eq!((found[1].max_error_mm, found[1].samples), (2.0, 1));
    }

    #[test]
    fn groups_stand_in_fixed_order_and_empty_ones_are_left_out() {
        let examples = [
            example("b", Split::Test, &[1.0]),
            example("b", Split::Train, &[1.0]),
            example("a", Split::Train, &[1.0]),
        ];
        let predicted = [field(&[1.0]), field(&[]), field(&[2.0])];
        let found = measure(&examples, &predicted);
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
    fn still_fields_have_a_coefficient_of_determination() {
        let examples = [example("a", Split::Test, &[])];
        assert_eq!(measure(&examples, &[field(&[])])[0].r2, 1.0);
        assert_eq!(measure(&examples, &[field(&[1.0])])[0].r2, 0.0);
    }
}
