//! The rigid motion of a specimen or camera between images, which is fitted beside the parameters.
//!
//! The misfit of an image is r = R(θ)(X + u) + t − X − u_meas. For given u the θ and t with the least Σ|r|²/σ² have a
//! closed form. A motion must not be subtracted from the data beforehand, since simulated displacements may contain one
//! too.

use crate::field::FieldImage;

/// Whether images may have moved as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// Each image has its own rotation and translation, which are fitted.
    #[default]
    Fitted,
    /// The images have not moved.
    None,
}

/// A rotation in rad about the origin, then a translation in mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rigid {
    pub rotation: f64,
    pub translation: [f64; 2],
}

impl Rigid {
    /// Returns the motion that brings points X + u nearest to the measured ones.
    pub fn of(image: &FieldImage, simulated: &[[f64; 2]], motion: Motion) -> Self {
        if motion == Motion::None {
            return Self::default();
        }
        let from: Vec<[f64; 2]> = sums(image.points(), simulated);
        let to = sums(image.points(), image.measured());
        let (start, end) = (mean(image, &from), mean(image, &to));
        let (mut cross, mut dot) = (0.0, 0.0);
        for (at, (from, to)) in from.iter().zip(&to).enumerate() {
            let weight = image.scale(at).powi(-2);
            let (a, b) = (difference(*from, start), difference(*to, end));
            cross += weight * (a[0] * b[1] - a[1] * b[0]);
            dot += weight * (a[0] * b[0] + a[1] * b[1]);
        }
        let rotation = cross.atan2(dot);
        let turned = Self {
            rotation,
            translation: [0.0; 2],
        };
        Self {
            rotation,
            translation: difference(end, turned.turn(start)),
        }
    }

    /// Rotates a vector.
    pub fn turn(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sine, cosine) = self.rotation.sin_cos();
        [cosine * x - sine * y, sine * x + cosine * y]
    }

    /// Returns the displacement of a point with simulated displacement as the image shows it.
    pub fn displacement(self, point: [f64; 2], u: [f64; 2]) -> [f64; 2] {
        let turned = self.turn([point[0] + u[0], point[1] + u[1]]);
        [
            turned[0] + self.translation[0] - point[0],
            turned[1] + self.translation[1] - point[1],
        ]
    }
}

/// Returns the orthonormal derivatives of the residuals of an image, components in turn, with respect to its motion.
/// The one of the rotation is taken at the measured points; it is left out if all points are one.
pub(crate) fn nuisance(image: &FieldImage, motion: Motion) -> Vec<Vec<f64>> {
    if motion == Motion::None {
        return Vec::new();
    }
    let places = sums(image.points(), image.measured());
    let centre = mean(image, &places);
    let column = |of: &dyn Fn([f64; 2]) -> [f64; 2]| -> Vec<f64> {
        let numbers = places.iter().enumerate();
        numbers
            .flat_map(|(at, place)| of(*place).map(|number| number / image.scale(at)))
            .collect()
    };
    let columns = [
        column(&|_| [1.0, 0.0]),
        column(&|_| [0.0, 1.0]),
        column(&|place| {
            let [x, y] = difference(place, centre);
            [-y, x]
        }),
    ];
    let mut basis = Vec::new();
    for mut column in columns {
        let length = column.iter().map(|number| number * number).sum::<f64>().sqrt();
        if length > 0.0 {
            column.iter_mut().for_each(|number| *number /= length);
            basis.push(column);
        }
    }
    basis
}

fn sums(a: &[[f64; 2]], b: &[[f64; 2]]) -> Vec<[f64; 2]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1]]).collect()
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// Returns the mean of points with the weights of an image.
fn mean(image: &FieldImage, points: &[[f64; 2]]) -> [f64; 2] {
    let (mut total, mut sum) = (0.0, [0.0; 2]);
    for (at, point) in points.iter().enumerate() {
        let weight = image.scale(at).powi(-2);
        total += weight;
        sum = [sum[0] + weight * point[0], sum[1] + weight * point[1]];
    }
    sum.map(|sum| sum / total)
}
