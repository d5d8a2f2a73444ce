//! The law of a point that an electrode covers in part: a laminate of a covered and a bare layer.
//!
//! Let the share S be covered, with the unit normal n of the edge in the undeformed plane. Displacements are continuous
//! across the edge, so the gradients of the layers differ by a⊗n, and their mean is f:
//!
//! ```text
//! f₁ = f + (1 − S) a⊗n    f₀ = f − S a⊗n
//! w(f; S, n) = min over a of S ψ₁(f₁) + (1 − S) ψ₀(f₀)        (ψ₁ − ψ₀ = energy of the voltage)
//! ```
//!
//! This is the energy of fine layers (Kohn and Strang, Comm. Pure Appl. Math. 39 (1986) 113), and of an element that is
//! cut by a straight edge if the fields on both sides are uniform. With stresses p₁ and p₀, moduli C₁ and C₀, D = C₁ −
//! C₀ and products with n on the last index, written Dₙ:
//!
//! ```text
//! (p₁ − p₀) n = 0                                              condition of the minimum
//! K = (1 − S) C₁ₙₙ + S C₀ₙₙ                                    its derivative along a
//! p = S p₁ + (1 − S) p₀
//! C = S C₁ + (1 − S) C₀ − S (1 − S) Dₙ K⁻¹ Dₙᵀ
//! ∂w/∂S = ψ₁ − ψ₀ − p : a⊗n
//! ∂p/∂S = p₁ − p₀ − (S C₁ + (1 − S) C₀) : a⊗n + S (1 − S) Dₙ a′,   K a′ = Dₙᵀ : a⊗n
//! ```
//!
//! A null Lagrangian drops out: it is affine along a⊗n, and its stress has no jump across the edge.

use super::coverage::Laminate;
use super::energy::{MODULI, Margins, tangent_from};
use super::kinematics::{Tensor, add_scaled, cofactor, deformation};
use super::material::Material;

/// Number of moduli: a symmetric matrix of the four entries of a gradient.
pub const LAMINATE_MODULI: usize = 10;

/// Most steps to the jump.
const MOST_STEPS: u32 = 60;
/// Most halvings of a step.
const MOST_HALVINGS: i32 = 40;
/// Length of a step after which the jump is exact to rounding: the next step would be of the order of its square.
const LAST_STEP: f64 = 1e-9;

/// Length of a step after which K is not computed anew: it changes by about as much.
const SHORT_STEP: f64 = 1e-3;

/// A vector of a plane.
type Vector = [f64; 2];
/// Moduli as a matrix of the entries of gradients, row by row.
type Moduli = [[f64; 4]; 4];

/// The deformation of both layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layers {
    /// The jump a of the gradient along the normal.
    pub jump: Vector,
    /// f₁ − I.
    pub covered: Tensor<f64>,
    /// f₀ − I.
    pub bare: Tensor<f64>,
}

impl Laminate {
    fn layers_at(&self, gradient: Tensor<f64>, jump: Vector) -> Layers {
        let step = dyad(jump, self.normal);
        Layers {
            jump,
            covered: add_scaled(gradient, 1.0 - self.share, step),
            bare: add_scaled(gradient, -self.share, step),
        }
    }

    /// Returns (p₁ − p₀) n.
    fn traction(&self, material: &impl Material, layers: &Layers) -> Vector {
        apply(self.jump_of_stress(material, layers), self.normal)
    }

    fn points(&self, material: &impl Material, layers: &Layers) -> [Point; 2] {
        [
            Point::new(material, layers.covered, self.load),
            Point::new(material, layers.bare, 0.0),
        ]
    }

    /// Returns K, if it is positive definite.
    fn stiffness(&self, points: &[Point; 2]) -> Option<Tensor<f64>> {
        let [covered, bare] = [points[0].acoustic(self.normal), points[1].acoustic(self.normal)];
        let mean = |at: usize| (1.0 - self.share) * covered[at] + self.share * bare[at];
        let stiffness = [[mean(0), mean(1)], [mean(1), mean(2)]];
        is_positive(stiffness).then_some(stiffness)
    }

    /// Returns the layers of least energy at f − I; `None` if a layer is not admissible there, or loses ellipticity
    /// along the normal.
    pub fn layers(&self, material: &impl Material, gradient: Tensor<f64>) -> Option<Layers> {
        let is_admissible =
            |layers: &Layers| material.admissible(layers.covered) > 0.0 && material.admissible(layers.bare) > 0.0;
        let mut layers = Some(self.layers_at(gradient, [0.0; 2])).filter(is_admissible)?;
        let mut traction = self.traction(material, &layers);
        let mut known = None;
        for _ in 0..MOST_STEPS {
            let stiffness = match known {
                Some(stiffness) => stiffness,
                None => self.stiffness(&self.points(material, &layers))?,
            };
            let step = divide(traction, stiffness);
            let at = |length: f64| {
                let [x, y] = layers.jump;
                self.layers_at(gradient, [x - length * step[0], y - length * step[1]])
            };
            let size = length(step);
            if size < LAST_STEP {
                return Some(at(1.0)).filter(is_admissible);
            }
            known = (size < SHORT_STEP).then_some(stiffness);
            let lengths = (0..MOST_HALVINGS).map(|halvings| 0.5_f64.powi(halvings));
            let (next, smaller) = lengths
                .map(at)
                .filter(is_admissible)
                .map(|next| (next, self.traction(material, &next)))
                .find(|(_, smaller)| length(*smaller) < length(traction))?;
            (layers, traction) = (next, smaller);
        }
        None
    }

    /// Returns p without the null Lagrangian.
    pub fn stress(&self, material: &impl Material, layers: &Layers) -> Tensor<f64> {
        self.mean(
            material.stress(layers.covered, self.load),
            material.stress(layers.bare, 0.0),
        )
    }

    fn mean(&self, covered: Tensor<f64>, bare: Tensor<f64>) -> Tensor<f64> {
        let of_covered = add_scaled([[0.0; 2]; 2], self.share, covered);
        add_scaled(of_covered, 1.0 - self.share, bare)
    }

    /// Returns p minus the stress of an energy that is linear in the share, which kernels compute.
    pub fn excess_stress(&self, material: &impl Material, gradient: Tensor<f64>, layers: &Layers) -> Tensor<f64> {
        let linear = material.stress(gradient, self.share * self.load);
        add_scaled(self.stress(material, layers), -1.0, linear)
    }

    /// Returns the tangents of the layers; `None` if K is not positive definite.
    fn tangents(&self, material: &impl Material, layers: &Layers) -> Option<Tangents> {
        let points = self.points(material, layers);
        let [covered, bare] = points.each_ref().map(Point::matrix);
        Some(Tangents {
            stiffness: self.stiffness(&points)?,
            covered,
            bare,
        })
    }

    /// Returns C; `None` if a layer loses ellipticity along the normal.
    fn moduli(&self, material: &impl Material, layers: &Layers) -> Option<Moduli> {
        let tangents = self.tangents(material, layers)?;
        let (share, rest) = (self.share, 1.0 - self.share);
        let jumps = tangents.jumps().map(|row| along_normal(row, self.normal));
        let moduli = |r: usize, c: usize| {
            let relaxed = divide(jumps[c], tangents.stiffness);
            share * tangents.covered[r][c] + rest * tangents.bare[r][c] - share * rest * dot(jumps[r], relaxed)
        };
        Some(std::array::from_fn(|r| std::array::from_fn(|c| moduli(r, c))))
    }

    /// Returns C minus the moduli of an energy that is linear in the share, on and above the diagonal; `None` as
    /// [`Laminate::layers`].
    pub fn excess_moduli(&self, material: &impl Material, gradient: Tensor<f64>) -> Option<[f64; LAMINATE_MODULI]> {
        let layers = self.layers(material, gradient)?;
        let moduli = self.moduli(material, &layers)?;
        let linear = Point::new(material, gradient, self.share * self.load).matrix();
        let mut excess = [0.0; LAMINATE_MODULI];
        let pairs = (0..4).flat_map(|r| (r..4).map(move |c| (r, c)));
        for (excess, (r, c)) in excess.iter_mut().zip(pairs) {
            *excess = 0.5 * (moduli[r][c] + moduli[c][r] - linear[r][c] - linear[c][r]);
        }
        Some(excess)
    }

    /// Returns the margins of stability. Both layers with the full load of the electrode must be elliptic, and the
    /// laminate; if both are convex with the same null Lagrangian, so is the laminate, as a minimum over the jump.
    pub fn margins(&self, material: &impl Material, gradient: Tensor<f64>) -> Margins<f64> {
        let lost = Margins {
            ellipticity: -1.0,
            convexity: -1.0,
            tension: 1.0,
        };
        let Some(layers) = self.layers(material, gradient) else {
            return lost;
        };
        let covered = material.margins(deformation(layers.covered), self.load);
        let bare = material.margins(deformation(layers.bare), 0.0);
        let both = Margins {
            ellipticity: covered.ellipticity.min(bare.ellipticity),
            convexity: covered.convexity.min(bare.convexity),
            tension: covered.tension.min(bare.tension),
        };
        if both.convexity > 0.0 {
            return both;
        }
        match self.moduli(material, &layers) {
            Some(moduli) => Margins {
                ellipticity: both.ellipticity.min(smallest_acoustic(&moduli)),
                ..both
            },
            None => lost,
        }
    }

    /// Returns the stress of the covered layer minus that of the bare one.
    fn jump_of_stress(&self, material: &impl Material, layers: &Layers) -> Tensor<f64> {
        let covered = material.stress(layers.covered, self.load);
        add_scaled(covered, -1.0, material.stress(layers.bare, 0.0))
    }

    /// Returns ∂p/∂S; `None` if K is not positive definite.
    pub fn slope_of_share(&self, material: &impl Material, layers: &Layers) -> Option<Tensor<f64>> {
        let tangents = self.tangents(material, layers)?;
        let (jump, jumps) = (dyad(layers.jump, self.normal), tangents.jumps());
        let more = divide(apply(product(&jumps, jump), self.normal), tangents.stiffness);
        let of_layers = self.mean(product(&tangents.covered, jump), product(&tangents.bare, jump));
        let of_jump = product(&jumps, dyad(more, self.normal));
        let direct = add_scaled(self.jump_of_stress(material, layers), -1.0, of_layers);
        Some(add_scaled(direct, self.share * (1.0 - self.share), of_jump))
    }

    /// Returns the derivative of p as the normal turns anticlockwise, per radian; `None` if K is not positive definite.
    pub fn slope_of_angle(&self, material: &impl Material, layers: &Layers) -> Option<Tensor<f64>> {
        let tangents = self.tangents(material, layers)?;
        let turned = [-self.normal[1], self.normal[0]];
        let turn = dyad(layers.jump, turned);
        let exchanged = Self {
            share: 1.0 - self.share,
            ..*self
        };
        // The weights of K, not of p.
        let of_layers = exchanged.mean(product(&tangents.covered, turn), product(&tangents.bare, turn));
        let of_stress = apply(self.jump_of_stress(material, layers), turned);
        let of_layers = apply(of_layers, self.normal);
        let more = divide([0, 1].map(|i| -of_layers[i] - of_stress[i]), tangents.stiffness);
        let change = product(&tangents.jumps(), add_scaled(turn, 1.0, dyad(more, self.normal)));
        let weight = self.share * (1.0 - self.share);
        Some(add_scaled([[0.0; 2]; 2], weight, change))
    }
}

/// The tangents of both layers.
struct Tangents {
    /// K.
    stiffness: Tensor<f64>,
    /// C₁.
    covered: Moduli,
    /// C₀.
    bare: Moduli,
}

impl Tangents {
    /// Returns D.
    fn jumps(&self) -> Moduli {
        std::array::from_fn(|r| std::array::from_fn(|c| self.covered[r][c] - self.bare[r][c]))
    }
}

/// Returns the stress of moduli on and above the diagonal along a change.
#[inline(always)]
#[must_use]
pub fn excess_tangent(moduli: &[f64; LAMINATE_MODULI], [[a, b], [c, d]]: Tensor<f64>) -> Tensor<f64> {
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = *moduli;
    [
        [aa * a + ab * b + ac * c + ad * d, ab * a + bb * b + bc * c + bd * d],
        [ac * a + bc * b + cc * c + cd * d, ad * a + bd * b + cd * c + dd * d],
    ]
}

/// Number of directions that are tried for the smallest acoustic eigenvalue.
const DIRECTIONS: i32 = 64;

/// Returns the smallest acoustic eigenvalue of moduli: over 64 directions, and then near the least.
fn smallest_acoustic(moduli: &Moduli) -> f64 {
    let step = std::f64::consts::PI / f64::from(DIRECTIONS);
    let at = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        let acoustic = |i: usize, j: usize| {
            let row = |r: usize| along_normal(moduli[r], [cos, sin])[j];
            cos * row(2 * i) + sin * row(2 * i + 1)
        };
        let shear = 0.5 * (acoustic(0, 1) + acoustic(1, 0));
        let (mean, gap) = (
            0.5 * (acoustic(0, 0) + acoustic(1, 1)),
            0.5 * (acoustic(0, 0) - acoustic(1, 1)),
        );
        mean - gap.hypot(shear)
    };
    let tried = (0..DIRECTIONS).map(|direction| f64::from(direction) * step);
    let least = tried
        .min_by(|one, other| at(*one).total_cmp(&at(*other)))
        .unwrap_or_default();
    // Golden sections.
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = (least - step, least + step);
    for _ in 0..40 {
        let (left, right) = (high - ratio * (high - low), low + ratio * (high - low));
        if at(left) < at(right) {
            high = right;
        } else {
            low = left;
        }
    }
    at(least).min(at(0.5 * (low + high)))
}

/// A deformation with the moduli of a material there. They are evaluated once for all directions.
struct Point {
    gradient: Tensor<f64>,
    moduli: [f64; MODULI],
}

impl Point {
    fn new(material: &impl Material, gradient: Tensor<f64>, active: f64) -> Self {
        Self {
            gradient,
            moduli: material.moduli(gradient, active),
        }
    }

    fn tangent(&self, along: Tensor<f64>) -> Tensor<f64> {
        tangent_from(self.gradient, self.moduli, along)
    }

    /// Returns the acoustic tensor of a unit normal along xx, xy and yy: the tangent along a⊗n times n. The part with
    /// the cofactor of a⊗n vanishes.
    fn acoustic(&self, normal: Vector) -> [f64; 3] {
        let [i, _, ii, ij, jj] = self.moduli;
        let f = deformation(self.gradient);
        let (a, b) = (apply(f, normal), apply(cofactor(f), normal));
        let entry = |r: usize, c: usize| ii * a[r] * a[c] + ij * (a[r] * b[c] + b[r] * a[c]) + jj * b[r] * b[c];
        [i + entry(0, 0), entry(0, 1), i + entry(1, 1)]
    }

    /// Returns the tangent as a matrix.
    fn matrix(&self) -> Moduli {
        let columns: [[f64; 4]; 4] = std::array::from_fn(|c| {
            let mut unit = [[0.0; 2]; 2];
            unit[c / 2][c % 2] = 1.0;
            entries(self.tangent(unit))
        });
        std::array::from_fn(|r| std::array::from_fn(|c| columns[c][r]))
    }
}

fn entries([[a, b], [c, d]]: Tensor<f64>) -> [f64; 4] {
    [a, b, c, d]
}

fn product(moduli: &Moduli, along: Tensor<f64>) -> Tensor<f64> {
    let along = entries(along);
    let row = |r: usize| -> f64 {
        moduli[r]
            .iter()
            .zip(along)
            .map(|(modulus, entry)| modulus * entry)
            .sum()
    };
    [[row(0), row(1)], [row(2), row(3)]]
}

/// Returns the product of a row of moduli with a normal on the last index.
fn along_normal([a, b, c, d]: [f64; 4], [x, y]: Vector) -> Vector {
    [a * x + b * y, c * x + d * y]
}

fn dyad([a, b]: Vector, [c, d]: Vector) -> Tensor<f64> {
    [[a * c, a * d], [b * c, b * d]]
}

fn apply([first, second]: Tensor<f64>, vector: Vector) -> Vector {
    [dot(first, vector), dot(second, vector)]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(vector: Vector) -> f64 {
    dot(vector, vector).sqrt()
}

fn is_positive([[a, b], [c, d]]: Tensor<f64>) -> bool {
    a > 0.0 && a * d - b * c > 0.0
}

/// Returns the solution of a system of two equations.
fn divide(vector: Vector, [[a, b], [c, d]]: Tensor<f64>) -> Vector {
    let determinant = a * d - b * c;
    [
        (d * vector[0] - b * vector[1]) / determinant,
        (a * vector[1] - c * vector[0]) / determinant,
    ]
}
