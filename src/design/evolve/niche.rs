//! Several designs in one search: niches, each with a winner.
//!
//! Clearing (Pétrowski, "A clearing procedure as a niching method for genetic algorithms", ICEC 1996, doi
//! 10.1109/ICEC.1996.542703): in the order of fitness, an individual that differs enough from all winners starts a new
//! niche, and any other joins the niche of the nearest winner. Cleared individuals are not removed but ranked lower:
//! first the best of all niches, then the second of all, and so on, so that each niche has the same share of the
//! parents.

use deaflow_pattern::{Layers, PatternEquivalence};

/// The winners of niches.
pub(super) struct Niches<'l> {
    /// All symmetric images of each winner.
    images: Vec<Vec<Layers>>,
    max: usize,
    distance: f64,
    equivalence: &'l PatternEquivalence,
}

impl<'l> Niches<'l> {
    /// No niches yet. `max` is the maximum number, `distance` the minimum distance between winners.
    pub fn new(max: usize, distance: f64, equivalence: &'l PatternEquivalence) -> Self {
        Self {
            images: Vec::new(),
            max,
            distance,
            equivalence,
        }
    }

    /// Whether the maximum number is reached.
    pub fn are_full(&self) -> bool {
        self.images.len() >= self.max
    }

    /// Whether a pattern has the minimum distance from all winners.
    pub fn are_far_from(&self, layers: &Layers) -> bool {
        let layers = self.equivalence.merged(layers);
        self.images
            .iter()
            .all(|images| layers.distance_to(images) >= self.distance)
    }

    /// Starts a niche with a pattern as its winner.
    pub fn add(&mut self, layers: &Layers) {
        self.images.push(self.equivalence.images(layers));
    }

    /// The niche of a pattern: that of the nearest winner, or a new one.
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

/// Reorders individuals that are sorted by fitness: the best of each niche, then the second of each, and so on.
pub(super) fn order(sorted: &[Layers], max: usize, distance: f64, equivalence: &PatternEquivalence) -> Vec<usize> {
    let mut niches = Niches::new(max, distance, equivalence);
    let mut sizes: Vec<usize> = Vec::new();
    let mut ranks: Vec<(usize, usize, usize)> = Vec::with_capacity(sorted.len());
    for (index, layers) in sorted.iter().enumerate() {
        let niche = niches.of(layers);
        sizes.resize(niches.images.len(), 0);
        ranks.push((sizes[niche], niche, index));
        sizes[niche] += 1;
    }
    ranks.sort_unstable();
    ranks.into_iter().map(|(_, _, index)| index).collect()
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
    fn a_device_without_symmetries_has_more_niches() {
        let none = PatternEquivalence::new(
            Symmetries::SQUARE.filter(|g| g == deaflow_pattern::Symmetry::IDENTITY),
            vec![1],
        );
        assert_eq!(order(&[bar(0), bar(1), bar(45)], 8, 0.1, &none), [0, 2, 1]);
    }

    #[test]
    fn the_best_of_each_niche_come_first() {
        // Bars shifted by a column differ in 4 % of the cells; their mirror images are the same.
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
    fn winners_have_the_minimum_distance() {
        let square = square();
        let mut niches = Niches::new(2, 0.1, &square);
        assert!(niches.are_far_from(&bar(0)) && !niches.are_full());
        niches.add(&bar(0));
        assert!(!niches.are_far_from(&bar(45)) && !niches.are_far_from(&bar(2)) && niches.are_far_from(&bar(3)));
    }
}
