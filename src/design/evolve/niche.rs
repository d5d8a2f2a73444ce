//! Several designs in one search: niches, each with a winner.
//!
//! Clearing (Pétrowski, "A clearing procedure as a niching method for genetic algorithms", ICEC 1996, doi
//! 10.1109/ICEC.1996.542703): from the best down, an individual that differs enough from all winners wins a niche of its own, and
//! any other belongs to the winner nearest to it. Cleared individuals are not struck out but ranked behind: first the best of all
//! niches, then the second of all, and so on, so that each niche has the same share of the parents.

use deaflow_pattern::{Layers, PatternEquivalence};

/// Winners of niches, added one after another.
pub(super) struct Niches<'l> {
    images: Vec<Vec<Layers>>,
    most: usize,
    distance: f64,
    equivalence: &'l PatternEquivalence,
}

impl<'l> Niches<'l> {
    /// No winner yet, of at most so many that are at least so far apart.
    pub fn new(most: usize, distance: f64, equivalence: &'l PatternEquivalence) -> Self {
        Self {
            images: Vec::new(),
            most,
            distance,
            equivalence,
        }
    }

    /// Whether there are as many winners as wanted.
    pub fn are_full(&self) -> bool {
        self.images.len() >= self.most
    }

    /// Whether a pattern is far enough from all winners.
    pub fn are_far_from(&self, layers: &Layers) -> bool {
        let layers = self.equivalence.merged(layers);
        self.images
            .iter()
            .all(|images| layers.distance_to(images) >= self.distance)
    }

    /// Makes a pattern a winner.
    pub fn add(&mut self, layers: &Layers) {
        self.images.push(self.equivalence.images(layers));
    }

    /// The niche of a pattern: that of the winner nearest to it, or a new one that it wins.
    fn of(&mut self, layers: &Layers) -> usize {
        let merged = self.equivalence.merged(layers);
        let distances = self.images.iter().map(|images| merged.distance_to(images));
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        match nearest {
            Some((niche, distance)) if distance < self.distance || self.are_full() => niche,
            _ => {
                self.add(layers);
                self.images.len() - 1
            }
        }
    }
}

/// The order of individuals that are sorted from the best down: the best of each niche, then the second of each, and so on.
pub(super) fn order(sorted: &[Layers], most: usize, distance: f64, equivalence: &PatternEquivalence) -> Vec<usize> {
    let mut niches = Niches::new(most, distance, equivalence);
    let mut sizes: Vec<usize> = Vec::new();
    let mut places: Vec<(usize, usize, usize)> = Vec::with_capacity(sorted.len());
    for (index, layers) in sorted.iter().enumerate() {
        let niche = niches.of(layers);
        sizes.resize(niches.images.len(), 0);
        places.push((sizes[niche], niche, index));
        sizes[niche] += 1;
    }
    places.sort_unstable();
    places.into_iter().map(|(_, _, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::{Bits, Raster, Symmetries};

    fn bar(from: usize) -> Layers {
        Layers::new(vec![Bits::from_fn(Raster::PAPER, |x, _| (from..from + 5).contains(&x))])
    }

    fn square() -> PatternEquivalence {
        PatternEquivalence::new(Symmetries::SQUARE, vec![1])
    }

    #[test]
    fn a_device_without_symmetries_has_more_designs() {
        let none = PatternEquivalence::new(
            Symmetries::SQUARE.filter(|g| g == deaflow_pattern::Symmetry::IDENTITY),
            vec![1],
        );
        assert_eq!(order(&[bar(0), bar(1), bar(45)], 8, 0.1, &none), [0, 2, 1]);
    }

    #[test]
    fn the_best_of_each_niche_come_first() {
        // Bars shifted by a column differ in 4 % of the cells; turned over they are the same.
        let square = square();
        let order = |sorted: &[Layers], most, distance| order(sorted, most, distance, &square);
        let sorted = [bar(0), bar(1), bar(45), bar(20), bar(21), bar(10)];
        assert_eq!(order(&sorted, 8, 0.1), [0, 3, 5, 1, 4, 2]);
        // With two niches, the others belong to the nearer winner.
        assert_eq!(order(&sorted, 2, 0.1), [0, 3, 1, 4, 2, 5]);
        // With one, nothing changes.
        assert_eq!(order(&sorted, 1, 0.1), [0, 1, 2, 3, 4, 5]);
        assert_eq!(order(&[], 3, 0.1), [] as [usize; 0]);
    }

    #[test]
    fn winners_are_as_far_apart_as_wanted() {
        let square = square();
        let mut niches = Niches::new(2, 0.1, &square);
        assert!(niches.are_far_from(&bar(0)) && !niches.are_full());
        niches.add(&bar(0));
        assert!(!niches.are_far_from(&bar(45)) && !niches.are_far_from(&bar(2)) && niches.are_far_from(&bar(3)));
    }
}
