//! Which samples are images of one another, and which images of a pattern differ.
//!
//! Patterns drawn by different families can coincide, or be mirror images, and a symmetric pattern has fewer than eight
//! images. Both would put rows that look different but are the same into a training set.

use std::collections::BTreeMap;

use rayon::prelude::*;

use deaflow_base::OrbitId;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

/// One image of an orbit's pattern, and the sample that shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Image {
    /// Index of the sample.
    pub(super) source: usize,
    /// What carries the sample to the image; the identity where the image was itself sampled.
    pub(super) symmetry: Symmetry,
}

/// A pattern with all its images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Orbit {
    /// What the images share.
    pub(super) digest: OrbitId,
    /// The different images, at most eight. The first is a sample as it was drawn.
    pub(super) images: Vec<Image>,
    /// Samples that repeat the pattern of an earlier one.
    pub(super) repeats: Vec<usize>,
}

/// Sorts samples, given by index and pattern in increasing order of the index, into orbits under a group, ordered by their first sample.
pub(super) fn orbits(samples: &[(usize, &Pattern)], group: Symmetries) -> Vec<Orbit> {
    let key = |(_, pattern): &(usize, &Pattern)| key(pattern, group);
    let keys: Vec<(OrbitId, Vec<Symmetry>)> = samples.par_iter().map(key).collect();
    let mut members: BTreeMap<OrbitId, Vec<usize>> = BTreeMap::new();
    for (at, (digest, _)) in keys.iter().enumerate() {
        members.entry(*digest).or_default().push(at);
    }
    let mut orbits: Vec<Orbit> = members
        .into_iter()
        .map(|(digest, members)| orbit(digest, &keys[members[0]].1, &members, samples))
        .collect();
    orbits.sort_by_key(|orbit| orbit.images[0].source);
    orbits
}

/// The digest of a pattern's orbit, and one symmetry for each of its different images.
fn key(pattern: &Pattern, group: Symmetries) -> (OrbitId, Vec<Symmetry>) {
    let mut differing: Vec<(Symmetry, Pattern)> = Vec::new();
    for g in group.iter() {
        let image = pattern.transformed(g);
        if differing.iter().all(|(_, other)| *other != image) {
            differing.push((g, image));
        }
    }
    let symmetries = differing.into_iter().map(|(g, _)| g).collect();
    (pattern.orbit(group), symmetries)
}

fn orbit(digest: OrbitId, symmetries: &[Symmetry], members: &[usize], samples: &[(usize, &Pattern)]) -> Orbit {
    let (first, pattern) = samples[members[0]];
    let mut images: Vec<Image> = symmetries
        .iter()
        .map(|&symmetry| Image {
            source: first,
            symmetry,
        })
        .collect();
    let mut repeats = Vec::new();
    for &member in &members[1..] {
        let (source, twin) = samples[member];
        let at = symmetries.iter().position(|&g| pattern.transformed(g) == *twin);
        // Equal digests without equal images would be a collision of BLAKE3; the sample then only counts as a repeat.
        match at {
            Some(at) if images[at].symmetry != Symmetry::IDENTITY => {
                images[at] = Image {
                    source,
                    symmetry: Symmetry::IDENTITY,
                };
            }
            _ => repeats.push(source),
        }
    }
    Orbit {
        digest,
        images,
        repeats,
    }
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
        let images: Vec<usize> = found(&[skew(), half, cross, diagonal])
            .iter()
            .map(|o| o.images.len())
            .collect();
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
        assert_eq!(orbits[0].digest, pattern.orbit(Symmetries::SQUARE));
        assert_eq!(orbits[0].repeats, [3]);
        let drawn = orbits[0].images.iter().filter(|i| i.symmetry == Symmetry::IDENTITY);
        let sampled: Vec<usize> = drawn.map(|i| i.source).collect();
        assert_eq!(sampled, [0, 2]);
        assert_eq!(orbits[0].images.len(), 8);
    }
}
