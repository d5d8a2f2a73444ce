//! Crossover, mutation and filter of genomes.
//!
//! The operators of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design", steps 5 and
//! 6): two-point crossover, inversion mutation, and a filter against checkerboards. The paper does not specify the
//! filter; here it is a 3 × 3 majority: units beyond the frame do not vote, and a tie leaves the unit unchanged.

use super::genome::{Genome, UNITS, around};
use deaflow_base::Stream;
use deaflow_pattern::Pattern;

/// Two-point crossover: exchanges the genes between two cuts; each pair of cuts is equally likely.
pub(super) fn cross(a: &mut Genome, b: &mut Genome, stream: &mut Stream) {
    let (from, to) = segment(stream);
    a.genes_mut()[from..to].swap_with_slice(&mut b.genes_mut()[from..to]);
}

/// Inversion mutation: reverses the genes between two cuts; each pair of cuts is equally likely.
pub(super) fn invert(genome: &mut Genome, stream: &mut Stream) {
    let (from, to) = segment(stream);
    genome.genes_mut()[from..to].reverse();
}

/// Exchanges two groups between two cuts; each pair of groups and of cuts is equally likely.
pub(super) fn exchange_groups(genome: &mut Genome, groups: usize, stream: &mut Stream) {
    let (from, to) = segment(stream);
    let pair = stream.choose(groups, 2);
    let [a, b] = [pair[0], pair[1]].map(|group| group as u8 + 1);
    for gene in &mut genome.genes_mut()[from..to] {
        *gene = match *gene {
            gene if gene == a => b,
            gene if gene == b => a,
            gene => gene,
        };
    }
}

/// Two different cuts among the 401 positions before, between and after the genes.
fn segment(stream: &mut Stream) -> (usize, usize) {
    let cuts = stream.choose(UNITS * UNITS + 1, 2);
    (cuts[0].min(cuts[1]), cuts[0].max(cuts[1]))
}

/// Sets each unit to the majority (bare or a group) of the 3 × 3 units around it, itself included.
pub(super) fn smooth(genome: &Genome, groups: usize) -> Genome {
    Genome::from_groups(|x, y| {
        let mut votes = [0; Pattern::MOST_GROUPS + 1];
        for (i, j) in around(x, y) {
            votes[usize::from(genome.group(i, j))] += 1;
        }
        let own = usize::from(genome.group(x, y));
        let most = (0..=groups).fold(own, |most, value| if votes[value] > votes[most] { value } else { most });
        most as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on(genome: &Genome) -> usize {
        genome.genes().iter().filter(|&&gene| gene != 0).count()
    }

    #[test]
    fn crossover_exchanges_one_segment() {
        for index in 0..50 {
            let (mut a, mut b) = (Genome::from_fn(|_, _| true), Genome::from_fn(|_, _| false));
            cross(&mut a, &mut b, &mut Stream::new(1, "test", index));
            assert!(a.genes().iter().zip(b.genes()).all(|(x, y)| x != y));
            let changes = a.genes().windows(2).filter(|pair| pair[0] != pair[1]).count();
            assert!(changes <= 2 && on(&b) > 0);
        }
    }

    #[test]
    fn inversion_reverses_one_segment() {
        for index in 0..50 {
            let start = Genome::random(0.5, 0, &mut Stream::new(2, "test", index));
            let mut inverted = start.clone();
            invert(&mut inverted, &mut Stream::new(1, "test", index));
            let differs: Vec<usize> = (0..400).filter(|&i| start.genes()[i] != inverted.genes()[i]).collect();
            assert_eq!(on(&start), on(&inverted));
            // Differences are symmetric about the middle of the segment.
            if let (Some(first), Some(last)) = (differs.first(), differs.last()) {
                for i in *first..=*last {
                    assert_eq!(inverted.genes()[i], start.genes()[first + last - i]);
                }
            }
        }
    }

    #[test]
    fn groups_are_exchanged_in_one_segment() {
        for index in 0..50 {
            let start = Genome::from_groups(|x, y| ((x * 7 + y * 3) % 4) as u8);
            let mut exchanged = start.clone();
            exchange_groups(&mut exchanged, 3, &mut Stream::new(4, "test", index));
            let differs: Vec<usize> = (0..400).filter(|&i| start.genes()[i] != exchanged.genes()[i]).collect();
            assert_eq!(on(&start), on(&exchanged));
            if let (Some(&first), Some(&last)) = (differs.first(), differs.last()) {
                let (a, b) = (start.genes()[first], exchanged.genes()[first]);
                let expected = |gene: u8| {
                    if gene == a {
                        b
                    } else if gene == b {
                        a
                    } else {
                        gene
                    }
                };
                assert!((first..=last).all(|i| exchanged.genes()[i] == expected(start.genes()[i])));
            }
        }
    }

    #[test]
    fn the_filter_removes_specks_and_keeps_half_planes() {
        let checkerboard = Genome::from_fn(|x, y| (x + y) % 2 == 0);
        let interior_changes = |g: &Genome| {
            let pairs = (1..19).flat_map(|y| (1..18).map(move |x| (x, y)));
            pairs.filter(|&(x, y)| g.group(x, y) != g.group(x + 1, y)).count()
        };
        let speck = Genome::from_fn(|x, y| (x, y) == (7, 7));
        assert_eq!(on(&smooth(&speck, 1)), 0);
        for half in [
            Genome::from_fn(|x, _| x < 9),
            Genome::from_fn(|_, y| y > 12),
            Genome::from_fn(|_, _| true),
        ] {
            assert_eq!(smooth(&half, 1), half);
        }
        // A perfect checkerboard is its own majority: 5 of 9 agree with the centre. Noise is not.
        assert_eq!(smooth(&checkerboard, 1), checkerboard);
        let noise = Genome::random(0.5, 0, &mut Stream::new(3, "test", 0));
        assert!(interior_changes(&smooth(&noise, 1)) < interior_changes(&noise) * 2 / 3);
    }

    #[test]
    fn the_frame_does_not_vote() {
        // The corner sees 2 × 2 units: two on, two off is a tie, so it stays.
        let edge = Genome::from_fn(|x, y| x == 0 && y < 2);
        assert!(smooth(&edge, 1).group(0, 0) == 1);
        let corner = Genome::from_fn(|x, y| x < 2 && y < 2 && (x, y) != (0, 0));
        assert!(smooth(&corner, 1).group(0, 0) == 1);
    }

    #[test]
    fn each_group_votes_separately() {
        // Left of column 9 group 2, right of it group 1, with a speck of group 3.
        let speck = Genome::from_groups(|x, y| if (x, y) == (5, 5) { 3 } else { 1 + u8::from(x < 9) });
        assert_eq!(smooth(&speck, 3), Genome::from_groups(|x, _| 1 + u8::from(x < 9)));
    }
}
