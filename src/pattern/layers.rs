//! Patterns of one or several electrode groups as bits: one set of cells per group.

use std::borrow::Cow;

use super::bits::Bits;
use super::raster::{Pattern, PatternForm};
use super::symmetry::Symmetries;

/// The cells of each electrode group.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layers(Vec<Bits>);

impl Layers {
    /// Returns the cells of each of `groups` groups of a pattern.
    #[must_use]
    pub fn of(pattern: &Pattern, groups: usize) -> Self {
        match groups {
            1 => Self(vec![Bits::of(pattern)]),
            _ => {
                let of_group = |group: usize| Bits::of(&pattern.of_group(group as u8));
                Self((1..=groups).map(of_group).collect())
            }
        }
    }

    /// Builds layers from the cells of each group, which must not overlap.
    #[must_use]
    pub fn new(groups: Vec<Bits>) -> Self {
        Self(groups)
    }

    /// Returns the form of patterns on this raster with as many groups.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm::of_square_cells(self.0[0].raster(), self.0.len())
    }

    /// Returns the cells of each group, from the first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Bits> {
        self.0.iter()
    }

    /// Returns the pattern.
    #[must_use]
    pub fn pattern(&self) -> Pattern {
        match &self.0[..] {
            [only] => only.pattern(),
            _ => Pattern::from_groups(self.form().raster, |x, y| self.group(x, y)),
        }
    }

    /// Returns the group of the cell at column `x`, row `y`, from 1; 0 for a bare cell.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        let found = self.0.iter().position(|bits| bits.has(x, y));
        found.map_or(0, |group| group as u8 + 1)
    }

    /// Returns the number of cells with an electrode.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().map(Bits::count).sum()
    }

    /// Returns the number of cells with another group, or with an electrode in only one of the two.
    #[must_use]
    pub fn differing(&self, other: &Self) -> usize {
        match (&self.0[..], &other.0[..]) {
            ([one], [other]) => one.differing(other),
            (groups, others) => {
                let pairs = groups.iter().zip(others);
                let differ = pairs.map(|(one, other)| one.without(other).or(&other.without(one)));
                differ.reduce(|all, one| all.or(&one)).map_or(0, |all| all.count())
            }
        }
    }

    /// Returns the images under those symmetries that keep the raster; the first is the pattern itself.
    #[must_use]
    pub fn images(&self, symmetries: Symmetries) -> Vec<Self> {
        let mut images: Vec<Self> = Vec::new();
        for bits in &self.0 {
            for (at, image) in bits.images(symmetries).into_iter().enumerate() {
                match images.get_mut(at) {
                    Some(layers) => layers.0.push(image),
                    None => images.push(Self(vec![image])),
                }
            }
        }
        images
    }

    /// Returns the fraction of cells in which it differs from the nearest of these images of another pattern.
    #[must_use]
    pub fn distance_to(&self, images: &[Self]) -> f64 {
        let least = images.iter().map(|image| self.differing(image)).min();
        least.unwrap_or_default() as f64 / self.form().raster.cells() as f64
    }
}

/// Decides which patterns of a device are equivalent, that is, move it in the same way: images under the symmetries of
/// the device, and patterns that exchange electrode groups of equal voltages.
#[derive(Clone, Debug, PartialEq)]
pub struct PatternEquivalence {
    symmetries: Symmetries,
    /// For each group, the first group with its voltages.
    first: Vec<u8>,
}

impl PatternEquivalence {
    /// Builds the equivalence from the symmetries of a device and, for each electrode group, the first group with its
    /// voltages in every state.
    #[must_use]
    pub fn new(symmetries: Symmetries, first: Vec<u8>) -> Self {
        Self { symmetries, first }
    }

    /// Returns the first group with the voltages of this group; 0 for a bare cell.
    #[must_use]
    pub fn first(&self, group: u8) -> u8 {
        let known = usize::from(group).checked_sub(1).and_then(|at| self.first.get(at));
        known.copied().unwrap_or(group)
    }

    /// Returns the pattern with each cell in the first group of its voltages.
    #[must_use]
    pub fn merged<'l>(&self, layers: &'l Layers) -> Cow<'l, Layers> {
        let groups = 1..=layers.0.len() as u8;
        if groups.clone().all(|group| self.first(group) == group) {
            return Cow::Borrowed(layers);
        }
        let mut merged = vec![Bits::empty(layers.form().raster); layers.0.len()];
        for (group, bits) in groups.zip(layers.iter()) {
            let to = &mut merged[usize::from(self.first(group)) - 1];
            *to = to.or(bits);
        }
        Cow::Owned(Layers(merged))
    }

    /// Returns the images of a merged pattern; the first is the pattern itself.
    #[must_use]
    pub fn images(&self, layers: &Layers) -> Vec<Layers> {
        self.merged(layers).images(self.symmetries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Raster, distance};

    fn pattern(seed: usize, groups: u8) -> Pattern {
        let raster = Raster::new(70, 30).unwrap();
        Pattern::from_groups(raster, |x, y| ((seed + 3 * x + x * y) % 7) as u8 % (groups + 1))
    }

    #[test]
    fn patterns_survive_the_conversion_to_layers() {
        for groups in 1..=3 {
            let pattern = pattern(1, groups);
            let layers = Layers::of(&pattern, usize::from(groups));
            assert_eq!(layers.pattern(), pattern);
            assert_eq!(
                (layers.count(), layers.group(5, 2)),
                (pattern.active_cells(), pattern.group(5, 2))
            );
        }
    }

    #[test]
    fn layers_differ_where_groups_differ() {
        let (one, other) = (pattern(1, 3), pattern(2, 3));
        let differ = one.cells().iter().zip(other.cells()).filter(|(a, b)| a != b).count();
        let [one, other] = [&one, &other].map(|pattern| Layers::of(pattern, 3));
        assert_eq!(one.differing(&other), differ);
        let nearest = one.distance_to(&other.images(Symmetries::SQUARE));
        let each = other
            .images(Symmetries::SQUARE)
            .iter()
            .map(|image| one.differing(image))
            .min()
            .unwrap();
        assert_eq!(nearest, each as f64 / 2100.0);
        let (one, other) = (pattern(1, 1), pattern(2, 1));
        let layers = [&one, &other].map(|pattern| Layers::of(pattern, 1));
        assert_eq!(
            layers[0].distance_to(&layers[1].images(Symmetries::SQUARE)),
            distance(&one, &other)
        );
    }

    #[test]
    fn groups_with_equal_voltages_are_one() {
        let equivalence = PatternEquivalence::new(Symmetries::RECTANGLE, vec![1, 2, 1]);
        let one = pattern(1, 3);
        let turned = Pattern::from_groups(one.raster(), |x, y| match one.group(69 - x, 29 - y) {
            1 => 3,
            3 => 1,
            group => group,
        });
        let [one, turned, other] = [&one, &turned, &pattern(2, 3)].map(|pattern| Layers::of(pattern, 3));
        let distance = |a: &Layers, b: &Layers| equivalence.merged(a).distance_to(&equivalence.images(b));
        assert_eq!(distance(&one, &turned), 0.0);
        assert!(distance(&one, &other) > 0.1);
        assert!(one.distance_to(&turned.images(Symmetries::RECTANGLE)) > 0.1);
        let apart = PatternEquivalence::new(Symmetries::RECTANGLE, vec![1, 2, 3]);
        assert!(matches!(apart.merged(&one), Cow::Borrowed(_)));
        assert_eq!([0, 1, 3].map(|group| equivalence.first(group)), [0, 1, 1]);
    }
}
