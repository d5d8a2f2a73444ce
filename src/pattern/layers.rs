//! Patterns of one or several groups of electrodes as bits: those of each group.

use std::borrow::Cow;

use super::bits::Bits;
use super::raster::{Pattern, PatternForm};
use super::symmetry::Symmetries;

/// The cells of each group of electrodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layers(Vec<Bits>);

impl Layers {
    /// The groups of a pattern, as many as it may have.
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

    /// Of the cells of each group, which share none.
    #[must_use]
    pub fn new(groups: Vec<Bits>) -> Self {
        Self(groups)
    }

    /// Patterns on its raster with as many groups.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm {
            raster: self.0[0].raster(),
            groups: self.0.len(),
        }
    }

    /// The cells of each group, from the first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Bits> {
        self.0.iter()
    }

    /// The pattern.
    #[must_use]
    pub fn pattern(&self) -> Pattern {
        match &self.0[..] {
            [only] => only.pattern(),
            _ => Pattern::from_groups(self.form().raster, |x, y| self.group(x, y)),
        }
    }

    /// The group of the cell at column `x`, row `y`, from 1; 0 where it is bare.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        let found = self.0.iter().position(|bits| bits.has(x, y));
        found.map_or(0, |group| group as u8 + 1)
    }

    /// How many cells carry an electrode.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().map(Bits::count).sum()
    }

    /// In how many cells another one differs: in whether they carry an electrode, or of which group.
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

    /// The images under those of some symmetries that leave the raster as it is, itself first.
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

    /// The share of cells in which it differs from the nearest of some images of another one.
    #[must_use]
    pub fn distance_to(&self, images: &[Self]) -> f64 {
        let least = images.iter().map(|image| self.differing(image)).min();
        least.unwrap_or_default() as f64 / self.form().raster.cells() as f64
    }
}

/// Which patterns of a device move it alike: images under what maps it to itself, and those that differ in groups of electrodes with equal
/// voltages.
#[derive(Clone, Debug, PartialEq)]
pub struct Likeness {
    symmetries: Symmetries,
    /// Of each group the first that has its voltages.
    first: Vec<u8>,
}

impl Likeness {
    /// By the symmetries of a device, and for each group of electrodes the first that has its voltages in every state.
    #[must_use]
    pub fn new(symmetries: Symmetries, first: Vec<u8>) -> Self {
        Self { symmetries, first }
    }

    /// The first group with the voltages of a group; 0 for a bare cell.
    #[must_use]
    pub fn first(&self, group: u8) -> u8 {
        let known = usize::from(group).checked_sub(1).and_then(|at| self.first.get(at));
        known.copied().unwrap_or(group)
    }

    /// The pattern with all cells in the first of alike groups.
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

    /// The images of a merged pattern, itself first.
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
    fn patterns_survive_the_way_to_layers_and_back() {
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
    fn they_differ_where_groups_do() {
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
        let likeness = Likeness::new(Symmetries::RECTANGLE, vec![1, 2, 1]);
        let one = pattern(1, 3);
        let turned = Pattern::from_groups(one.raster(), |x, y| match one.group(69 - x, 29 - y) {
            1 => 3,
            3 => 1,
            group => group,
        });
        let [one, turned, other] = [&one, &turned, &pattern(2, 3)].map(|pattern| Layers::of(pattern, 3));
        let distance = |a: &Layers, b: &Layers| likeness.merged(a).distance_to(&likeness.images(b));
        assert_eq!(distance(&one, &turned), 0.0);
        assert!(distance(&one, &other) > 0.1);
        assert!(one.distance_to(&turned.images(Symmetries::RECTANGLE)) > 0.1);
        let apart = Likeness::new(Symmetries::RECTANGLE, vec![1, 2, 3]);
        assert!(matches!(apart.merged(&one), Cow::Borrowed(_)));
        assert_eq!([0, 1, 3].map(|group| likeness.first(group)), [0, 1, 1]);
    }
}
