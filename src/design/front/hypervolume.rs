//! The hypervolume of a front: the area between its points and a reference point, which every point exceeds.
//!
//! It grows with each point that no other one dominates, and so compares fronts by one number (Zitzler and Thiele, IEEE
//! Transactions on Evolutionary Computation 3(4), 1999). Fronts with different numbers of points are only compared on
//! equal limits, since more points have a larger hypervolume.

/// A point of a front: a value that should be large, at a cost that should be small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontPoint {
    /// What the first objective gains over the membrane at rest.
    pub value: f64,
    /// The second one.
    pub cost: f64,
}

impl FrontPoint {
    /// Whether it is at least as good as another one in both objectives.
    #[must_use]
    pub fn covers(&self, other: &Self) -> bool {
        self.value >= other.value && self.cost <= other.cost
    }
}

/// Returns the hypervolume of points with respect to a reference, in units of value times cost. Points that do not
/// exceed the reference add nothing.
#[must_use]
pub fn hypervolume(points: &[FrontPoint], reference: FrontPoint) -> f64 {
    let exceeds = |point: &&FrontPoint| point.value > reference.value && point.cost < reference.cost;
    let mut sorted: Vec<FrontPoint> = points.iter().filter(exceeds).copied().collect();
    sorted.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let (mut sum, mut best, mut from) = (0.0, reference.value, reference.cost);
    for point in sorted {
        sum += (best - reference.value) * (point.cost - from).max(0.0);
        (best, from) = (point.value.max(best), point.cost);
    }
    sum + (best - reference.value) * (reference.cost - from).max(0.0)
}

/// Returns the hypervolume of points with any number of objectives, all of which should be large.
#[must_use]
pub fn hypervolume_of(points: &[Vec<f64>], reference: &[f64]) -> f64 {
    let exceeds = |point: &&Vec<f64>| point.iter().zip(reference).all(|(of_point, least)| of_point > least);
    let mut above: Vec<&Vec<f64>> = points.iter().filter(exceeds).collect();
    match *reference {
        [] => 0.0,
        [least] => above.iter().map(|point| point[0] - least).fold(0.0, f64::max),
        [value, least] => {
            let points: Vec<FrontPoint> = above
                .iter()
                .map(|point| FrontPoint {
                    value: point[0],
                    cost: -point[1],
                })
                .collect();
            hypervolume(&points, FrontPoint { value, cost: -least })
        }
        [ref others @ .., least] => {
            // Slices between the values of the last objective, each with the points that reach it.
            let last = others.len();
            above.sort_by(|a, b| b[last].total_cmp(&a[last]));
            let mut within: Vec<Vec<f64>> = Vec::new();
            let mut sum = 0.0;
            for (at, point) in above.iter().enumerate() {
                within.push(point[..last].to_vec());
                let below = above.get(at + 1).map_or(least, |next| next[last]);
                if point[last] > below {
                    sum += (point[last] - below) * hypervolume_of(&within, others);
                }
            }
            sum
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(pairs: &[(f64, f64)]) -> Vec<FrontPoint> {
        let point = |&(cost, value): &(f64, f64)| FrontPoint { value, cost };
        pairs.iter().map(point).collect()
    }

    const REFERENCE: FrontPoint = FrontPoint { value: 0.0, cost: 0.5 };

    #[test]
    fn it_is_the_area_below_the_steps_of_the_front() {
        let known = [1.0346, 1.3996, 1.6657, 1.8284, 1.9757, 2.1008, 2.1764, 2.2229, 2.2406];
        let front: Vec<(f64, f64)> = (1..).map(|k| 0.04 * f64::from(k)).zip(known).collect();
        // An independent program: displacement against area, on 20 × 20 units of the default scene.
        assert!((hypervolume(&points(&front), REFERENCE) - 0.88990).abs() < 1e-4);
        let mut reversed = front.clone();
        reversed.reverse();
        assert_eq!(
            hypervolume(&points(&reversed), REFERENCE),
            hypervolume(&points(&front), REFERENCE)
        );
    }

    #[test]
    fn points_that_are_dominated_or_worse_than_the_reference_add_nothing() {
        let alone = hypervolume(&points(&[(0.1, 1.0)]), REFERENCE);
        assert!((alone - 0.4).abs() < 1e-15);
        for other in [(0.2, 0.9), (0.1, 1.0), (0.6, 3.0), (0.05, -1.0), (0.5, 2.0)] {
            assert_eq!(
                hypervolume(&points(&[(0.1, 1.0), other]), REFERENCE),
                alone,
                "{other:?}"
            );
        }
        assert_eq!(hypervolume(&[], REFERENCE), 0.0);
        let [a, b] = [(0.1, 1.0), (0.2, 0.9)].map(|(cost, value)| FrontPoint { value, cost });
        assert!(a.covers(&b) && !b.covers(&a) && a.covers(&a));
    }

    #[test]
    fn it_is_the_volume_of_the_union_of_boxes() {
        assert_eq!(hypervolume_of(&[vec![3.0], vec![2.0]], &[0.5]), 2.5);
        let pair = [vec![1.0, -0.2], vec![2.0, -0.4]];
        assert!((hypervolume_of(&pair, &[0.0, -0.5]) - (0.3 + 0.1)).abs() < 1e-15);
        // Three boxes of 2, each along an axis, share the unit cube.
        let axes = [vec![2.0, 1.0, 1.0], vec![1.0, 2.0, 1.0], vec![1.0, 1.0, 2.0]];
        assert!((hypervolume_of(&axes, &[0.0; 3]) - 4.0).abs() < 1e-15);
        let more = [&axes[..], &[vec![0.5, 0.5, 1.5], vec![-1.0, 9.0, 9.0]]].concat();
        assert!((hypervolume_of(&more, &[0.0; 3]) - 4.0).abs() < 1e-15);
        assert_eq!(hypervolume_of(&[], &[0.0; 3]), 0.0);
        // Against counting the points of a lattice that a box contains.
        let side = 12_usize;
        let of = |k: usize| {
            (0..3)
                .map(|axis| ((k * (7 + 5 * axis) + 3 * axis) % side) as f64 + 1.0)
                .collect()
        };
        let boxes: Vec<Vec<f64>> = (0..9).map(of).collect();
        let inside = |cell: usize| {
            let corner = [cell % side, cell / side % side, cell / side / side];
            boxes
                .iter()
                .any(|edges| (0..3).all(|axis| (corner[axis] as f64) < edges[axis]))
        };
        let counted = (0..side.pow(3)).filter(|cell| inside(*cell)).count() as f64;
        assert!((hypervolume_of(&boxes, &[0.0; 3]) - counted).abs() < 1e-9);
    }
}
