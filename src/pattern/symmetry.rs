//! The dihedral group D4: the eight symmetries of the square.

/// One of the eight symmetries of the square: an optional mirror x → −x, then a rotation by quarter turns, about the
/// centre of the membrane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Symmetry(u8);

/// A group of symmetries: those that map a membrane to itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Symmetries {
    /// Bit i is set if the group contains symmetry i.
    members: u8,
}

impl Symmetries {
    /// The symmetries of the square.
    pub const SQUARE: Self = Self { members: 0b1111_1111 };

    /// The symmetries of a rectangle: half a turn, and the mirrors along its sides.
    pub const RECTANGLE: Self = Self { members: 0b0101_0101 };

    /// Returns the members, the identity first.
    pub fn iter(self) -> impl Iterator<Item = Symmetry> {
        Symmetry::ALL.into_iter().filter(move |g| self.contains(*g))
    }

    /// Returns the members that satisfy a condition. They must form a group: with the identity, products and inverses.
    #[must_use]
    pub fn filter(self, condition: impl Fn(Symmetry) -> bool) -> Self {
        let members = self.iter().filter(|g| condition(*g));
        Self {
            members: members.fold(0, |members, g| members | 1 << g.0),
        }
    }

    /// Returns whether a symmetry is a member.
    #[must_use]
    pub fn contains(self, g: Symmetry) -> bool {
        self.members >> g.0 & 1 == 1
    }

    /// Returns the number of members.
    #[must_use]
    pub fn count(self) -> usize {
        self.members.count_ones() as usize
    }
}

impl Symmetry {
    /// The identity.
    pub const IDENTITY: Self = Self(0);

    /// All eight: rotations by 0, 90, 180, 270 degrees, then the same after the mirror.
    pub const ALL: [Self; 8] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5), Self(6), Self(7)];

    /// Returns the position in [`Symmetry::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        usize::from(self.0)
    }

    /// Returns the integer matrix that acts on points and vectors.
    #[must_use]
    pub fn matrix(self) -> [[i32; 2]; 2] {
        let (c, s) = [(1, 0), (0, 1), (-1, 0), (0, -1)][usize::from(self.0 % 4)];
        let mirror = if self.0 >= 4 { -1 } else { 1 };
        [[c * mirror, -s], [s * mirror, c]]
    }

    /// Returns the image of a vector.
    #[must_use]
    pub fn apply_vector(self, v: [f64; 2]) -> [f64; 2] {
        let m = self.matrix();
        // Multiplies by 0 and ±1 only. Adding a zero could turn −0 into 0, so the component is picked instead.
        let pick = |row: [i32; 2]| {
            if row[0] != 0 {
                f64::from(row[0]) * v[0]
            } else {
                f64::from(row[1]) * v[1]
            }
        };
        [pick(m[0]), pick(m[1])]
    }

    /// Returns whether x and y are exchanged, as in a quarter turn.
    #[must_use]
    pub fn exchanges_axes(self) -> bool {
        self.0 % 2 == 1
    }

    /// Returns the image of a position (column, row) in a grid of this size. If axes are exchanged, the grid of the
    /// image has as many columns as this one has rows.
    ///
    /// # Panics
    /// When the position is outside the grid.
    #[must_use]
    pub fn apply_index(self, x: usize, y: usize, [columns, rows]: [usize; 2]) -> (usize, usize) {
        assert!(
            x < columns && y < rows,
            "({x}, {y}) is outside a grid of {columns} × {rows}"
        );
        let m = self.matrix();
        let last = [columns as i32 - 1, rows as i32 - 1];
        let to = if self.exchanges_axes() {
            [last[1], last[0]]
        } else {
            last
        };
        let (a, b) = (2 * x as i32 - last[0], 2 * y as i32 - last[1]);
        let (ga, gb) = (m[0][0] * a + m[0][1] * b, m[1][0] * a + m[1][1] * b);
        (((ga + to[0]) / 2) as usize, ((gb + to[1]) / 2) as usize)
    }

    /// Returns the new index of each position of a grid, both counted row by row; it permutes whole arrays.
    pub fn permutation(self, sides: [usize; 2]) -> impl Iterator<Item = usize> {
        let [columns, rows] = sides;
        let width = if self.exchanges_axes() { rows } else { columns };
        let flat = move |x: usize, y: usize| {
            let (x, y) = self.apply_index(x, y, sides);
            (y * width + x) as isize
        };
        // The map is affine, so three positions define it.
        let origin = if columns * rows > 0 { flat(0, 0) } else { 0 };
        let right = if columns > 1 { flat(1, 0) - origin } else { 0 };
        let up = if rows > 1 { flat(0, 1) - origin } else { 0 };
        (0..columns * rows)
            .map(move |i| (origin + (i % columns) as isize * right + (i / columns) as isize * up) as usize)
    }

    /// Returns the symmetry that applies `other`, then `self`.
    #[must_use]
    pub fn compose(self, other: Self) -> Self {
        let (a, b) = (self.matrix(), other.matrix());
        let product = std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]));
        Self::ALL
            .into_iter()
            .find(|g| g.matrix() == product)
            .expect("the group is closed")
    }

    /// Returns the inverse.
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
    fn groups_hold_what_their_members_make() {
        for (group, count) in [(Symmetries::SQUARE, 8), (Symmetries::RECTANGLE, 4)] {
            assert_eq!((group.count(), group.iter().next()), (count, Some(Symmetry::IDENTITY)));
            for (a, b) in group.iter().flat_map(|a| group.iter().map(move |b| (a, b))) {
                assert!(group.contains(a.compose(b)) && group.contains(a.inverse()));
            }
        }
        assert!(Symmetries::RECTANGLE.iter().all(|g| !g.exchanges_axes()));
    }

    #[test]
    fn permutations_agree_with_single_positions() {
        for g in Symmetry::ALL {
            for [columns, rows] in [[2, 2], [7, 7], [50, 50], [3, 8], [9, 1], [1, 1]] {
                let width = if g.exchanges_axes() { rows } else { columns };
                let single = |i: usize| g.apply_index(i % columns, i / columns, [columns, rows]);
                let places = (0..columns * rows).map(|i| single(i).1 * width + single(i).0);
                assert!(g.permutation([columns, rows]).eq(places));
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
                let sides = [40, 50];
                let turned = if b.exchanges_axes() { [50, 40] } else { sides };
                let place = b.apply_index(3, 11, sides);
                assert_eq!(both.apply_index(3, 11, sides), a.apply_index(place.0, place.1, turned));
            }
        }
        let mut matrices: Vec<_> = Symmetry::ALL.iter().map(|g| g.matrix()).collect();
        matrices.sort_unstable();
        matrices.dedup();
        assert_eq!(matrices.len(), 8);
    }
}
