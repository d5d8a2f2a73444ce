//! Objectives that count for electrodes as they may be fabricated, and not only as drawn.

use serde_json::json;

use crate::text::flow_value;
use deaflow_base::{
    Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, parameters,
};
use deaflow_pattern::{MaskOffsets, Membrane};
use deaflow_scene::{Both, Tolerances};

/// Largest length in mm.
const LONGEST: f64 = 1e3;

/// Largest number of masks in a list.
const MOST_MASKS: usize = 16;

/// Offsets are at most so many cells: each cell depends on all cells around it within twice that distance.
const MOST_CELLS: f64 = 4.0;

/// The mask as drawn.
pub(crate) const DRAWN: MaskOffsets = MaskOffsets {
    wider_mm: 0.0,
    shift_mm: [0.0; 2],
};

/// How far electrodes differ from those drawn, in cells along x and y.
pub(crate) fn reach(offsets: &MaskOffsets, cell_mm: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| (offsets.wider_mm.abs() + offsets.shift_mm[axis].abs()) / cell_mm[axis])
}

/// How sharply the derivative of the worst score distinguishes between scores: 0.01 mm is a factor of 7.
const SHARPNESS: f64 = 500.0;

parameters! {
    /// How electrodes differ from those drawn.
    struct NamedOffset as "a mask of `robust`" {
        /// By how much electrodes are wider at each edge than drawn; narrower if negative.
        mask: Length [-LONGEST..=LONGEST] = "0 mm",
        /// Where the upper electrode lies against the lower one, along x and y.
        misregistration: Option<Both<Length>> [-LONGEST..=LONGEST],
    }
}

/// A [`NamedOffset`]; in short its `mask`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Offset(NamedOffset);

parameters! {
    /// Which value counts if electrodes differ from those drawn.
    pub struct Robust as "`robust`" {
        /// The worst value of these masks: by how much electrodes are wider at each edge than drawn, or `{ mask,
        /// misregistration }`.
        worst: Option<Vec<Offset>> [((), 1..=MOST_MASKS)],
        /// The mean less so many standard deviations.
        mean_minus: Option<Decimal> [0.0..=10.0],
        /// With `mean_minus`: standard deviation of the width at each edge; by default that in the `tolerances` of the
        /// scene.
        mask: Option<Length> [0.0..=LONGEST],
        /// With `mean_minus`: standard deviation of the place of the upper electrode; by default that in the
        /// `tolerances` of the scene.
        misregistration: Option<Both<Length>> [0.0..=LONGEST],
    }
    rules(one_of_two)
    check(Robust::check)
}

fn one_of_two(fields: Fields) -> Fields {
    let has = |key: &str| json!({ "required": [key] });
    let deviations = json!({ "anyOf": [has("mask"), has("misregistration")] });
    fields
        .exactly_one(&["worst", "mean_minus"])
        .rule(json!({ "if": deviations, "then": has("mean_minus") }))
}

/// The masks of a `robust` objective, and how their values make one.
#[derive(Clone, Debug, PartialEq)]
pub struct Masks {
    /// The mask as drawn, then those that differ.
    pub offsets: Vec<MaskOffsets>,
    /// How their scores make one.
    pub criterion: Criterion,
}

/// How the scores of several masks make one. The first mask is that as drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// The smallest score.
    Worst {
        /// Whether the mask as drawn counts.
        counts_drawn: bool,
    },
    /// The mean less so many standard deviations. After the mask as drawn there are two for each independent deviation:
    /// at −√3 and at √3 standard deviations.
    MeanMinus(f64),
}

impl Robust {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let misplaced = ["mask", "misregistration"]
            .into_iter()
            .find_map(|key| map.optional(key));
        match (&self.worst, &self.mean_minus, misplaced) {
            (None, None, _) => Err(map
                .error("`robust` needs `worst` or `mean_minus`")
                .help("for example `robust: { worst: [-0.3 mm, 0 mm, 0.3 mm] }`")),
            (Some(_), Some(_), _) => Err(map
                .error("`worst` cannot be used with `mean_minus`")
                .help("remove one of them")),
            (Some(_), None, Some(node)) => Err(node
                .error("standard deviations are those of `mean_minus`")
                .help("give the masks of `worst` as a list, such as `worst: [-0.3 mm, 0 mm, 0.3 mm]`")),
            _ => Ok(()),
        }
    }

    /// Whether its standard deviations are those of the tolerances of a scene.
    pub(super) fn takes_tolerances(&self) -> bool {
        self.mean_minus.is_some() && self.mask.is_none() && self.misregistration.is_none()
    }

    /// Takes the standard deviations that are not given from tolerances.
    #[must_use]
    pub(super) fn with_tolerances(mut self, tolerances: &Tolerances) -> Self {
        if self.takes_tolerances() {
            self.mask = tolerances.mask;
            self.misregistration.clone_from(&tolerances.misregistration);
        }
        self
    }

    /// Returns the masks on a membrane.
    ///
    /// # Errors
    /// If no mask differs from that drawn, or one differs by too many cells; the text says so.
    pub(super) fn masks(&self, membrane: Membrane) -> Result<Masks, String> {
        let (offsets, criterion) = match (&self.worst, &self.mean_minus) {
            (Some(listed), _) => {
                let all: Vec<MaskOffsets> = listed.iter().map(|Offset(one)| one.offsets()).collect();
                let counts_drawn = all.contains(&DRAWN);
                (all, Criterion::Worst { counts_drawn })
            }
            (None, factor) => {
                let factor = factor.map_or(0.0, Decimal::to_f64);
                (self.around(), Criterion::MeanMinus(factor))
            }
        };
        let mut masks = vec![DRAWN];
        masks.extend(offsets.into_iter().filter(|one| *one != DRAWN));
        if masks.len() == 1 {
            return Err(match self.worst {
                Some(_) => "`worst` names no mask that differs from that drawn".to_owned(),
                None => "`mean_minus` needs the standard deviation of `mask` or `misregistration`".to_owned(),
            });
        }
        let cell_mm = membrane.cell_mm();
        let is_far = |one: &&MaskOffsets| reach(one, cell_mm).into_iter().any(|cells| cells > MOST_CELLS);
        match masks.iter().find(is_far) {
            Some(mask) => Err(format!(
                "a mask of `robust` differs by {:.3} cells from that drawn, allowed: at most {MOST_CELLS} cells of {} \
                 mm",
                reach(mask, cell_mm).into_iter().fold(0.0, f64::max),
                cell_mm[0].min(cell_mm[1])
            )),
            None => Ok(Masks {
                offsets: masks,
                criterion,
            }),
        }
    }

    /// Two masks for each deviation, at −√3 and √3 standard deviations: with the weights 1/6, 2/3 and 1/6 of a normal
    /// distribution they integrate polynomials up to order 5 exactly.
    fn around(&self) -> Vec<MaskOffsets> {
        let wide = self.mask.map_or(0.0, |mask| mask.value());
        let shifts = self.misregistration.as_ref();
        let [x, y] = shifts.map_or([0.0; 2], |both| both.0.each_ref().map(|shift| shift.value()));
        let each = [(wide, [0.0; 2]), (0.0, [x, 0.0]), (0.0, [0.0, y])];
        let both = |(wide, shift): (f64, [f64; 2])| {
            let at = |side: f64| MaskOffsets {
                wider_mm: side * wide,
                shift_mm: shift.map(|mm| side * mm),
            };
            [at(-f64::sqrt(3.0)), at(f64::sqrt(3.0))]
        };
        let differ = each.into_iter().filter(|one| *one != (0.0, [0.0; 2]));
        differ.flat_map(both).collect()
    }

    /// The mapping in YAML on one line.
    pub(super) fn to_text(&self) -> String {
        flow_value(&self.to_canonical())
    }
}

impl NamedOffset {
    fn offsets(&self) -> MaskOffsets {
        let shift = self.misregistration.as_ref();
        MaskOffsets {
            wider_mm: self.mask.value(),
            shift_mm: shift.map_or([0.0; 2], |both| both.0.each_ref().map(|shift| shift.value())),
        }
    }
}

impl Parameter for Offset {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::Map(_) => NamedOffset::read_with(node, &[]).map(Self),
            _ => Length::read(node, key, &(-LONGEST..=LONGEST)).map(|mask| {
                Self(NamedOffset {
                    mask,
                    misregistration: None,
                })
            }),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match &self.0.misregistration {
            None => self.0.mask.canonical(),
            Some(_) => Some(self.0.to_canonical()),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Length::schema(&(-LONGEST..=LONGEST)), NamedOffset::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Criterion {
    /// Returns the score of a pattern from those with each mask.
    #[must_use]
    pub fn score(self, scores: &[f64]) -> f64 {
        match self {
            Self::Worst { .. } => self.counting(scores).iter().copied().fold(f64::INFINITY, f64::min),
            Self::MeanMinus(factor) => {
                let (shift, variance) = moments(scores);
                scores.first().copied().unwrap_or(0.0) + shift - factor * variance.sqrt()
            }
        }
    }

    /// Returns the derivative of the score with respect to that with each mask. The smallest score has none where two
    /// are equal, so its derivative is that of a smooth minimum.
    #[must_use]
    pub(super) fn weights(self, scores: &[f64]) -> Vec<f64> {
        match self {
            Self::Worst { .. } => {
                let least = self.score(scores);
                let skipped = scores.len() - self.counting(scores).len();
                let share = |(at, score): (usize, &f64)| match at < skipped {
                    true => 0.0,
                    false => (-SHARPNESS * (score - least)).exp(),
                };
                let shares: Vec<f64> = scores.iter().enumerate().map(share).collect();
                let sum: f64 = shares.iter().sum();
                shares.into_iter().map(|share| share / sum).collect()
            }
            Self::MeanMinus(factor) => {
                let (_, variance) = moments(scores);
                let per_deviation = if variance > 0.0 { factor / variance.sqrt() } else { 0.0 };
                let drawn = scores.first().copied().unwrap_or(0.0);
                let of_pair = |pair: &[f64; 2]| {
                    let [a, b] = pair.map(|score| score - drawn);
                    let weight = |own: f64| 1.0 / 6.0 - per_deviation * (own / 6.0 - (a + b) / 36.0);
                    [weight(a), weight(b)]
                };
                let pairs = scores.get(1..).unwrap_or_default().as_chunks().0;
                let around: Vec<f64> = pairs.iter().flat_map(of_pair).collect();
                // A shift of all scores shifts the result.
                let of_drawn = 1.0 - around.iter().sum::<f64>();
                std::iter::once(of_drawn).chain(around).collect()
            }
        }
    }

    /// The scores that count for the smallest.
    fn counting(self, scores: &[f64]) -> &[f64] {
        match self {
            Self::Worst { counts_drawn: false } => scores.get(1..).unwrap_or_default(),
            _ => scores,
        }
    }
}

/// The mean above the score as drawn, and the variance: the sums over independent deviations, whose effects add up.
fn moments(scores: &[f64]) -> (f64, f64) {
    let drawn = scores.first().copied().unwrap_or(0.0);
    let pairs = scores.get(1..).unwrap_or_default().as_chunks::<2>().0;
    let of_pair = |pair: &[f64; 2]| {
        let [a, b] = pair.map(|score| score - drawn);
        let mean = (a + b) / 6.0;
        (mean, (a * a + b * b) / 6.0 - mean * mean)
    };
    pairs
        .iter()
        .map(of_pair)
        .fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    fn read(text: &str) -> Result<Robust, InputError> {
        Robust::read_with(&Document::from_text(Path::new("robust"), text).unwrap().root, &[])
    }

    fn masks(text: &str) -> Result<Masks, String> {
        read(text).unwrap().masks(Membrane::square(50.0))
    }

    #[test]
    fn masks_begin_with_that_drawn() {
        let found = masks("{ worst: [-0.3 mm, 0 mm, { mask: 0.3 mm, misregistration: [0.2 mm, 0 mm] }] }").unwrap();
        let [drawn, narrow, wide] = &found.offsets[..] else {
            panic!("{found:?}");
        };
        assert_eq!(*drawn, DRAWN);
        assert_eq!((narrow.wider_mm, narrow.shift_mm), (-0.3, [0.0; 2]));
        assert_eq!((wide.wider_mm, wide.shift_mm), (0.3, [0.2, 0.0]));
        assert_eq!(found.criterion, Criterion::Worst { counts_drawn: true });
        let without = masks("{ worst: [0.3 mm] }").unwrap();
        assert_eq!(without.criterion, Criterion::Worst { counts_drawn: false });
        let around = masks("{ mean_minus: 2, mask: 0.15 mm, misregistration: [0 mm, 0.1 mm] }").unwrap();
        assert_eq!(around.offsets.len(), 5, "{around:?}");
    }

    #[test]
    fn what_says_nothing_is_refused() {
        for text in [
            "{}",
            "{ worst: [] }",
            "{ worst: [0.3 mm], mean_minus: 2 }",
            "{ worst: [0.3 mm], mask: 0.1 mm }",
            "{ mean_minus: -1, mask: 0.1 mm }",
            "{ worst: [0.3 V] }",
            "{ mask: 0.1 mm }",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
        for text in [
            "{ worst: [0 mm] }",
            "{ worst: [5 mm] }",
            "{ mean_minus: 2 }",
            "{ mean_minus: 2, mask: 0 mm }",
        ] {
            assert!(masks(text).is_err(), "{text}");
        }
    }

    #[test]
    fn equal_masks_have_equal_canonical_values() {
        let canonical = |text: &str| read(text).unwrap().to_canonical();
        assert_eq!(
            canonical("{ worst: [0.3 mm] }"),
            canonical("{ worst: [{ mask: 300 um }] }")
        );
        assert_ne!(canonical("{ worst: [0.3 mm] }"), canonical("{ worst: [0.31 mm] }"));
        let text = read("{ worst: [-0.3 mm, { misregistration: [0.1 mm, 0 mm] }] }")
            .unwrap()
            .to_text();
        assert_eq!(read(&text).unwrap().to_text(), text);
    }

    #[test]
    fn weights_are_the_derivative_of_the_score() {
        let scores = [0.84, 0.81, 0.83, 0.845, 0.79];
        let criterion = Criterion::MeanMinus(2.0);
        let weights = criterion.weights(&scores);
        for (at, weight) in weights.iter().enumerate() {
            let shifted = |by: f64| {
                let mut scores = scores;
                scores[at] += by;
                criterion.score(&scores)
            };
            let difference = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            assert!((difference - weight).abs() < 1e-8, "{at}: {difference} {weight}");
        }
        let worst = Criterion::Worst { counts_drawn: false };
        assert_eq!(worst.score(&scores), 0.79);
        let weights = worst.weights(&scores);
        assert!(weights[0] == 0.0 && weights[4] > 0.99, "{weights:?}");
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn mean_and_deviation_of_a_quadratic_are_exact() {
        // u = 1 + 0.2 z₁ − 0.1 z₁² + 0.3 z₂ has the mean 0.9 and the variance 0.04 + 2·0.01 + 0.09.
        let root = f64::sqrt(3.0);
        let first = |z: f64| 1.0 + 0.2 * z - 0.1 * z * z;
        let scores = [1.0, first(-root), first(root), 1.0 - 0.3 * root, 1.0 + 0.3 * root];
        let score = Criterion::MeanMinus(1.5).score(&scores);
        assert!((score - (0.9 - 1.5 * f64::sqrt(0.15))).abs() < 1e-14, "{score}");
    }
}
