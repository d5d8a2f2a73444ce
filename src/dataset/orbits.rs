//! Groups samples into orbits: patterns that are images of one another under the symmetries of the device.
//!
//! Patterns of different families can coincide or be mirror images, and a symmetric pattern has fewer than eight
//! distinct images. Without orbits, a training set would contain the same row several times.

use std::collections::BTreeMap;

use rayon::prelude::*;

use deaflow_base::OrbitId;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

/// An image of the pattern of an orbit, and the sample from which it is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Image {
    /// Index of the sample.
    pub(super) source: usize,
    /// The symmetry that maps the sample to the image; the identity if the image itself was sampled.
    pub(super) symmetry: Symmetry,
}

/// A pattern with all its images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Orbit {
    /// The orbit.
    pub(super) id: OrbitId,
    /// The distinct images, at most eight. The first is a sample.
    pub(super) images: Vec<Image>,
    /// Samples that repeat the pattern of an earlier one.
    pub(super) repeats: Vec<usize>,
}

/// Groups samples (index and pattern, in increasing order of the index) into orbits, ordered by their first sample.
pub(super) fn orbits(samples: &[(usize, &Pattern)], group: Symmetries) -> Vec<Orbit> {
    let key = |(_, pattern): &(usize, &Pattern)| key(pattern, group);
    let keys: Vec<(OrbitId, Vec<Symmetry>)> = samples.par_iter().map(key).collect();
    let mut members: BTreeMap<OrbitId, Vec<usize>> = BTreeMap::new();
    for (at, (id, _)) in keys.iter().enumerate() {
        members.entry(*id).or_default().push(at);
    }
    let orbits = members.into_iter();
    let orbits = orbits.map(|(id, members)| orbit(id, &keys[members[0]].1, &members, samples));
    let mut orbits: Vec<Orbit> = orbits.collect();
    orbits.sort_by_key(|orbit| orbit.images[0].source);
    orbits
}

/// Returns the orbit of a pattern, and a symmetry for each of its distinct images.
fn key(pattern: &Pattern, group: Symmetries) -> (OrbitId, Vec<Symmetry>) {
    let mut distinct: Vec<(Symmetry, Pattern)> = Vec::new();
    for g in group.iter() {
        let image = pattern.transformed(g);
        if distinct.iter().all(|(_, other)| *other != image) {
            distinct.push((g, image));
        }
    }
    let symmetries = distinct.into_iter().map(|(g, _)| g).collect();
    (pattern.orbit(group), symmetries)
}

fn orbit(id: OrbitId, symmetries: &[Symmetry], members: &[usize], samples: &[(usize, &Pattern)]) -> Orbit {
    let (source, pattern) = samples[members[0]];
    let image = |&symmetry: &Symmetry| Image { source, symmetry };
    let mut images: Vec<Image> = symmetries.iter().map(image).collect();
    let mut repeats = Vec::new();
    for &member in &members[1..] {
        let (source, other) = samples[member];
        // Without a matching image (a hash collision) the sample counts as a repeat.
        match symmetries.iter().position(|&g| pattern.transformed(g) == *other) {
            Some(at) if images[at].symmetry != Symmetry::IDENTITY => {
                images[at] = Image {
                    source,
                    symmetry: Symmetry::IDENTITY,
                };
            }
            _ => repeats.push(source),
        }
    }
    Orbit { id, images, repeats }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn skew() -> Pattern {
        Pattern::from_fn(Raster::PAPER, |x, y| (3 * x + y * y) % 7 < 3 && x > y / 2)
    }

    fn found(patterns: &[Pattern]) -> Vec<Orbit> {
        orbits(&patterns.iter().enumerate().collect::<Vec<_>>(), Symmetries::SQUARE)
    }

    #[test]
    fn symmetric_patterns_have_fewer_images() {
        let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
        let cross = Pattern::from_fn(Raster::PAPER, |x, y| (20..30).contains(&x) || (20..30).contains(&y));
        let diagonal = Pattern::from_fn(Raster::PAPER, |x, y| x > y);
        let orbits = found(&[skew(), half, cross, diagonal]);
        let images: Vec<usize> = orbits.iter().map(|orbit| orbit.images.len()).collect();
        assert_eq!(images, [8, 4, 1, 4]);
    }

    #[test]
    fn samples_that_are_images_of_each_other_share_an_orbit() {
        let pattern = skew();
        let mirrored = pattern.transformed(Symmetry::ALL[5]);
        let orbits = found(&[
            pattern.clone(),
            Pattern::from_fn(Raster::PAPER, |x, _| x < 9),
            mirrored,
            pattern.clone(),
        ]);
        assert_eq!(orbits.len(), 2);
        assert_eq!(orbits[0].id, pattern.orbit(Symmetries::SQUARE));
        assert_eq!(orbits[0].repeats, [3]);
        let drawn = orbits[0].images.iter().filter(|i| i.symmetry == Symmetry::IDENTITY);
        let sampled: Vec<usize> = drawn.map(|i| i.source).collect();
        assert_eq!(sampled, [0, 2]);
        assert_eq!(orbits[0].images.len(), 8);
    }
}
