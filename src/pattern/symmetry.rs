//! The dihedral group D4: the eight symmetries of the square.

/// One of the eight symmetries of the square: an optional mirror x → −x, then a rotation by quarter turns, about the
/// centre of the membrane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Symmetry(u8);

impl Symmetry {
    /// Does nothing.
    pub const IDENTITY: Self = Self(0);

    /// All eight: rotations by 0, 90, 180, 270 degrees, then the same after the mirror.
    pub const ALL: [Self; 8] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5), Self(6), Self(7)];

    /// Position in [`Symmetry::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        usize::from(self.0)
    }

    /// The integer matrix that acts on points and vectors.
    #[must_use]
    pub fn matrix(self) -> [[i32; 2]; 2] {
        let (c, s) = [(1, 0), (0, 1), (-1, 0), (0, -1)][usize::from(self.0 % 4)];
        let mirror = if self.0 >= 4 { -1 } else { 1 };
        [[c * mirror, -s], [s * mirror, c]]
    }

    /// The image of a vector.
    #[must_use]
    pub fn apply_vector(self, v: [f64; 2]) -> [f64; 2] {
        let m = self.matrix();
        // Multiplication by 0 and ±1 only: adding a zero could turn −0 into 0, so entries are picked instead.
        let pick = |row: [i32; 2]| {
            if row[0] != 0 {
                f64::from(row[0]) * v[0]
            } else {
                f64::from(row[1]) * v[1]
            }
        };
        [pick(m[0]), pick(m[1])]
    }

    /// The image of a place in an n × n grid, as (column, row).
    ///
    /// # Panics
    /// When the place is outside the grid.
    #[must_use]
    pub fn apply_index(self, x: usize, y: usize, n: usize) -> (usize, usize) {
        assert!(x < n && y < n, "({x}, {y}) is outside a grid of {n} × {n}");
        let m = self.matrix();
        let last = n as i32 - 1;
        let (a, b) = (2 * x as i32 - last, 2 * y as i32 - last);
        let (ga, gb) = (m[0][0] * a + m[0][1] * b, m[1][0] * a + m[1][1] * b);
        (((ga + last) / 2) as usize, ((gb + last) / 2) as usize)
    }

    /// Where each place of an n × n grid goes, both counted row by row: what moves whole arrays.
    ///
    /// # Panics
    /// When the grid has fewer than 2 × 2 places.
    pub fn permutation(self, n: usize) -> impl Iterator<Item = usize> {
        let flat = |(x, y): (usize, usize)| (y * n + x) as isize;
        // The map is affine, so three places give it.
        let origin = flat(self.apply_index(0, 0, n));
        let right = flat(self.apply_index(1, 0, n)) - origin;
        let up = flat(self.apply_index(0, 1, n)) - origin;
        (0..n * n).map(move |i| (origin + (i % n) as isize * right + (i / n) as isize * up) as usize)
    }

    /// First `other`, then `self`.
    #[must_use]
    pub fn compose(self, other: Self) -> Self {
        let (a, b) = (self.matrix(), other.matrix());
        let product = std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]));
        Self::ALL
            .into_iter()
            .find(|g| g.matrix() == product)
            .expect("the group is closed")
    }

    /// What undoes it.
    #[must_use]
    pub fn inverse(self) -> Self {
        Self::ALL
            .into_iter()
            .find(|g| g.compose(self) == Self::IDENTITY)
            .expect("every element has an inverse")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permutations_agree_with_single_places() {
        for g in Symmetry::ALL {
            for n in [2, 7, 50] {
                let single = |i: usize| g.apply_index(i % n, i / n, n);
                let places = (0..n * n).map(|i| single(i).1 * n + single(i).0);
                assert!(g.permutation(n).eq(places));
            }
        }
    }

    #[test]
    fn it_is_the_group_of_eight() {
        for a in Symmetry::ALL {
            for b in Symmetry::ALL {
                let both = a.compose(b);
                let v = [0.3, -1.7];
                assert_eq!(both.apply_vector(v), a.apply_vector(b.apply_vector(v)));
                let place = b.apply_index(3, 11, 50);
                assert_eq!(both.apply_index(3, 11, 50), a.apply_index(place.0, place.1, 50));
            }
        }
        let mut matrices: Vec<_> = Symmetry::ALL.iter().map(|g| g.matrix()).collect();
        matrices.sort_unstable();
        matrices.dedup();
        assert_eq!(matrices.len(), 8);
    }
}
