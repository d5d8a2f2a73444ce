//! The prestretched sheet before its division into elements.

use std::sync::Arc;

use deaflow_pattern::{Borders, Membrane, Parts, Raster};
use deaflow_scene::{Edge, Floating, Scene};

use super::layout::SIDES;

/// Forces on a rigid body or bar, and what moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Dead force over μH, along x and y in mm.
    pub load: [f64; 2],
    /// Place of the force in mm from the centroid; it turns with the body.
    pub arm: [f64; 2],
    /// Stiffness of a spring on its centroid over μH, along x and y.
    pub spring: [f64; 2],
    /// Whether it moves along x, along y, and turns.
    pub moves: [bool; 3],
    /// A given translation in mm.
    pub given: [f64; 2],
    /// Mass over that of an area of the membrane, in mm², in addition to that of the membrane in its place.
    pub mass: f64,
}

impl Mount {
    /// A body that moves freely.
    pub const FREE: Self = Self {
        load: [0.0; 2],
        arm: [0.0; 2],
        spring: [0.0; 2],
        moves: [true; 3],
        given: [0.0; 2],
        mass: 0.0,
    };

    /// Converts lengths, the force over μH, and the mass over that of an area, from mm to a unit of length.
    #[must_use]
    pub fn in_units(self, unit_mm: f64) -> Self {
        let scaled = |lengths: [f64; 2]| lengths.map(|length| length / unit_mm);
        Self {
            load: scaled(self.load),
            arm: scaled(self.arm),
            given: scaled(self.given),
            mass: self.mass / unit_mm.powi(2),
            ..self
        }
    }

    /// Returns the energy of the load and the springs at a translation and a turned arm, with a share of the load.
    #[must_use]
    pub fn energy(&self, [x, y]: [f64; 2], moved_arm: [f64; 2], share: f64) -> f64 {
        let [a, b] = [0, 1].map(|c| moved_arm[c] - self.arm[c]);
        let [along, across] = self.spring;
        // Exactly that of a single rate, if both are equal.
        let spring = 0.5 * along * (x * x + y * y) + 0.5 * (across - along) * y * y;
        spring - share * (self.load[0] * (x + a) + self.load[1] * (y + b))
    }
}

/// The supports of the sides of a membrane, in the order of `Edge`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetSides {
    /// Components of the displacement that each holds.
    pub held: [[bool; 2]; SIDES],
    /// Total dead force over μH on each, along x and y in mm.
    pub loads: [[f64; 2]; SIDES],
    /// The bar on each.
    pub bars: [Option<Mount>; SIDES],
    /// The motions of the whole membrane that nothing resists.
    pub floating: Floating,
}

impl SheetSides {
    /// The sides of a membrane on which nothing acts, and which can move as a whole.
    pub const FREE: Self = Self {
        held: [[false; 2]; SIDES],
        loads: [[0.0; 2]; SIDES],
        bars: [None; SIDES],
        floating: Floating {
            along: [false; 2],
            turn: None,
        },
    };

    /// Converts lengths, and forces over μH, from mm to a unit of length.
    #[must_use]
    pub fn in_units(self, unit_mm: f64) -> Self {
        Self {
            loads: self.loads.map(|load| load.map(|force| force / unit_mm)),
            bars: self.bars.map(|bar| bar.map(|bar| bar.in_units(unit_mm))),
            ..self
        }
    }

    /// Returns the bars with their sides.
    pub fn bars(&self) -> impl Iterator<Item = (usize, Mount)> {
        let bars = self.bars.into_iter().enumerate();
        bars.filter_map(|(side, bar)| Some((side, bar?)))
    }
}

/// A prestretched rectangle of cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Cells and sides.
    pub membrane: Membrane,
    /// λ₁ along x and λ₂ along y.
    pub prestretch: [f64; 2],
    /// Parts of the sheet; `None` if all cells are membrane.
    pub parts: Option<Arc<Parts>>,
    /// Their exact borders, where elements follow them.
    pub borders: Option<Arc<Borders>>,
    /// Forces on each body.
    pub mounts: Vec<Mount>,
    /// Supports of the sides; `None` if all are held.
    pub sides: Option<SheetSides>,
}

/// Returns μH of a scene in N/m: N over it is a length in m.
fn stiffness_n_per_m(scene: &Scene) -> f64 {
    scene.shear_modulus_pa() * scene.thickness_mm() * 1e-3
}

/// Returns the mass of an area of the prestretched membrane of a scene in kg/mm², if its density is known.
fn mass_per_area(scene: &Scene) -> Option<f64> {
    let thickness_m = 1e-3 * scene.thickness_mm() / scene.mean_prestretch().powi(2);
    Some(1e-6 * scene.density()? * thickness_m)
}

/// Returns the forces on the bodies of a scene.
fn mounts(scene: &Scene) -> Vec<Mount> {
    let stiffness = stiffness_n_per_m(scene);
    let bodies = scene.geometry.bodies.iter().flatten().map(|body| Mount {
        load: body.load_n().map(|force| 1e3 * force / stiffness),
        spring: body.spring_n_per_m().map(|rate| rate / stiffness),
        ..Mount::FREE
    });
    bodies.collect()
}

/// What acts on a body out of the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lift {
    /// Dead force over μH in units of length.
    pub load: f64,
    /// Stiffness of a spring over μH.
    pub spring: f64,
}

/// Returns what acts out of the plane on the bodies of a scene, with lengths in a unit.
#[must_use]
pub fn lifts(scene: &Scene, unit_mm: f64) -> Vec<Lift> {
    let stiffness = stiffness_n_per_m(scene);
    let bodies = scene.geometry.bodies.iter().flatten().map(|body| {
        let [.., spring] = body.springs_n_per_m();
        Lift {
            load: 1e3 * body.lift_n() / stiffness / unit_mm,
            spring: spring / stiffness,
        }
    });
    bodies.collect()
}

/// Returns the supports of the sides of a scene; `None` if all are held.
fn sides(scene: &Scene) -> Option<SheetSides> {
    let (sides, stiffness) = (scene.geometry.sides.as_ref()?, stiffness_n_per_m(scene));
    // Without a density nothing moves in time.
    let mass_per_area = mass_per_area(scene).unwrap_or(f64::INFINITY);
    let bar = |edge: Edge| {
        let bar = sides.of(edge).bar()?;
        let mut arm = [0.0; 2];
        arm[1 - edge.normal_axis()] = bar.at_mm();
        Some(Mount {
            load: bar.load_n().map(|force| 1e3 * force / stiffness),
            arm,
            spring: [bar.spring_n_per_m() / stiffness; 2],
            moves: bar.moves(),
            given: bar.displacement_mm().unwrap_or_default(),
            mass: bar.mass_kg() / mass_per_area,
        })
    };
    let load = |edge: Edge| sides.of(edge).load_n().unwrap_or_default();
    Some(SheetSides {
        held: Edge::ALL.map(|edge| sides.of(edge).holds(edge)),
        loads: Edge::ALL.map(|edge| load(edge).map(|force| 1e3 * force / stiffness)),
        bars: Edge::ALL.map(bar),
        floating: scene.geometry.floating(),
    })
}

impl Sheet {
    /// Returns the sheet of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            prestretch: scene.prestretch(),
            parts: scene.parts(),
            borders: scene.borders(),
            mounts: mounts(scene),
            sides: sides(scene),
        }
    }

    /// Returns its raster.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.membrane.raster
    }

    /// Returns D = diag(λ₁, λ₂)/√(λ₁λ₂), the identity for equal prestretch.
    #[must_use]
    pub fn distortion(&self) -> [f64; 2] {
        let [along, across] = self.prestretch;
        let ratio = (along / across).sqrt();
        [ratio, 1.0 / ratio]
    }
}

impl Sheet {
    /// Returns the sheet of the source paper, a square of 50 mm at a prestretch of 3.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            membrane: Membrane::square(50.0),
            prestretch: [3.0; 2],
            parts: None,
            borders: None,
            mounts: Vec::new(),
            sides: None,
        }
    }
}
