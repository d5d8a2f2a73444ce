//! Electrodes that are drawn as shapes, with their exact edges.

use std::cmp::Ordering;
use std::hash::{Hash, Hasher};

use super::polygons::Polygons;
use super::symmetry::Symmetry;

/// Decimal places of coordinates in mm.
const DECIMALS: i32 = 9;

/// The shapes of electrodes on a membrane, whose edges elements follow.
#[derive(Clone, Debug)]
pub struct Electrodes {
    groups: Vec<(u8, Polygons)>,
    size_mm: [f64; 2],
}

impl Electrodes {
    /// Creates electrodes from the regions of groups in mm. What lies outside a membrane with these sides in mm is left
    /// out, and what a group shares with an earlier one.
    #[must_use]
    pub fn new(groups: &[(u8, Polygons)], size_mm: [f64; 2]) -> Self {
        let membrane = Polygons::of_rectangle(size_mm);
        let mut taken = Polygons::default();
        let mut own: Vec<(u8, Polygons)> = Vec::new();
        for (group, region) in groups {
            let region = region.intersection(&membrane).without(&taken).without_slivers();
            taken = taken.union(&region);
            match own.iter_mut().find(|(known, _)| known == group) {
                Some((_, known)) => *known = known.union(&region),
                None => own.push((*group, region)),
            }
        }
        own.retain(|(_, region)| !region.is_empty());
        own.sort_by_key(|(group, _)| *group);
        Self::of_parts(own, size_mm)
    }

    /// Creates electrodes from groups that do not overlap, in ascending order, and the sides of the membrane in mm.
    #[must_use]
    pub fn of_parts(groups: Vec<(u8, Polygons)>, size_mm: [f64; 2]) -> Self {
        let rounded = |(group, region): (u8, Polygons)| (group, region.rounded(DECIMALS));
        Self {
            groups: groups.into_iter().map(rounded).collect(),
            size_mm,
        }
    }

    /// Returns each group, from 1, with its region in mm from the lower left corner of the membrane. They do not
    /// overlap.
    #[must_use]
    pub fn groups(&self) -> &[(u8, Polygons)] {
        &self.groups
    }

    /// Returns the sides of the membrane in mm.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    /// Returns the image under a symmetry.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let [width, height] = self.size_mm;
        let size_mm = if g.exchanges_axes() {
            [height, width]
        } else {
            self.size_mm
        };
        let image = |[x, y]: [f64; 2]| {
            let [x, y] = g.apply_vector([x - 0.5 * width, y - 0.5 * height]);
            [x + 0.5 * size_mm[0], y + 0.5 * size_mm[1]]
        };
        let groups = self.groups.iter();
        let groups = groups.map(|(group, region)| (*group, region.moved(image)));
        Self::of_parts(groups.collect(), size_mm)
    }

    /// Returns all numbers as bytes, for digests: equal exactly if the electrodes are.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        self.numbers().flat_map(u64::to_le_bytes).collect()
    }

    fn numbers(&self) -> impl Iterator<Item = u64> {
        let of_ring = |ring: &Vec<[f64; 2]>| {
            let points: Vec<u64> = ring.iter().flatten().map(|at| at.to_bits()).collect();
            std::iter::once(ring.len() as u64).chain(points)
        };
        let groups = self.groups.iter().flat_map(move |(group, region)| {
            let head = [u64::from(*group), region.rings().len() as u64];
            head.into_iter().chain(region.rings().iter().flat_map(of_ring))
        });
        self.size_mm.into_iter().map(f64::to_bits).chain(groups)
    }
}

impl PartialEq for Electrodes {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Electrodes {}

impl PartialOrd for Electrodes {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Electrodes {
    fn cmp(&self, other: &Self) -> Ordering {
        self.numbers().cmp(other.numbers())
    }
}

impl Hash for Electrodes {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.numbers().for_each(|number| state.write_u64(number));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: f64, high: f64) -> Vec<[f64; 2]> {
        vec![[low, low], [high, low], [high, high], [low, high]]
    }

    #[test]
    fn groups_share_nothing_and_stay_on_the_membrane() {
        let ring = Polygons::new(&[square(1.0, 9.0 + 1.0 / 3.0), square(3.0, 7.0)]);
        let other = Polygons::new(&[square(4.0, 6.0), square(9.0, 20.0)]);
        let electrodes = Electrodes::new(&[(2, ring.clone()), (1, other)], [10.0, 12.0]);
        let [(1, first), (2, second)] = electrodes.groups() else {
            panic!("{electrodes:?}")
        };
        assert_eq!((first.rings().len(), second.rings().len()), (2, 2));
        // Group 1 has what lies on the membrane and is not of group 2, which came first.
        assert!((second.area() - ring.area()).abs() < 1e-6, "{}", second.area());
        let expected = 4.0 + 1.0 * 3.0 - 1.0 / 9.0;
        assert!((first.area() - expected).abs() < 1e-6, "{}", first.area());
    }

    #[test]
    fn symmetries_map_electrodes_as_they_map_cells() {
        let region = Polygons::new(&[vec![[1.0, 1.0], [4.0, 2.0], [2.0, 5.0]]]);
        let area = region.area();
        let electrodes = Electrodes::new(&[(1, region)], [10.0, 6.0]);
        for g in Symmetry::ALL {
            let image = electrodes.transformed(g);
            assert_eq!(image.transformed(g.inverse()), electrodes);
            assert!((image.groups()[0].1.area() - area).abs() < 1e-6);
            assert_eq!(image == electrodes, g == Symmetry::IDENTITY);
            assert_eq!(image.bytes() == electrodes.bytes(), g == Symmetry::IDENTITY);
        }
        // A quarter turn carries the lower left corner to the lower right.
        let turned = electrodes.transformed(Symmetry::ALL[1]);
        let expected = Polygons::new(&[vec![[5.0, 1.0], [4.0, 4.0], [1.0, 2.0]]]);
        assert!(turned.groups()[0].1.is_within(1e-6, &expected), "{turned:?}");
    }
}
