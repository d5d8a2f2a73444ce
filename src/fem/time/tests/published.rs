//! Scenes of published data: their branches flow by the law of the authors. A bar is relaxed and loaded with the
//! branches and the equilibrium law of each scene; what it does by either law is known.

use std::path::Path;

use super::*;
use crate::time::finite;
use deaflow_scene::ViscousLaw;
use deaflow_scene::laws::{Form, Response};

/// Returns a scene of the repository.
fn published(name: &str) -> Scene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/scenes");
    Scene::load(&folder.join(name)).unwrap()
}

/// A bar under tension with the material of a scene; stresses are nominal, in kPa.
struct Bar {
    law: ViscousLaw,
    /// Shear modulus in kPa.
    modulus: f64,
    response: Response,
    /// Modulus in kPa, relaxation time in s and A of each branch.
    branches: Vec<(f64, f64, [f64; 4])>,
    stretch: f64,
}

/// C⁻¹ and j² of a bar, as at the points of a membrane.
fn metric(stretch: f64) -> [f64; 4] {
    [stretch.powi(-2), 0.0, stretch, stretch]
}

impl Bar {
    fn of(scene: &Scene) -> Self {
        let effect = scene.properties.viscoelasticity.as_ref().unwrap();
        let form = (scene.properties.strain_stiffening.as_ref()).map(|law| law.law().form(scene.shear_modulus_pa()));
        let Form::FirstInvariant(response) =
            form.unwrap_or(Form::FirstInvariant(Response::polynomial([1.0, 0.0, 0.0])))
        else {
            panic!("a law of the first invariant");
        };
        let branches = effect.branches.iter();
        Self {
            law: effect.law,
            modulus: 1e-3 * scene.shear_modulus_pa(),
            response,
            branches: branches
                .map(|branch| (1e-3 * branch.modulus.value(), branch.time.value(), metric(1.0)))
                .collect(),
            stretch: 1.0,
        }
    }

    /// Returns the states of the branches at the end of a step in s to a stretch.
    fn after(&self, seconds: f64, stretch: f64) -> Vec<[f64; 4]> {
        let [from, to] = [self.stretch, stretch].map(metric);
        let each = self.branches.iter().map(|(_, time, state)| match self.law {
            ViscousLaw::Linear => {
                let Coefficients { kept, before, now } = Coefficients::new(seconds / time);
                std::array::from_fn(|k| kept * state[k] + before * from[k] + now * to[k])
            }
            ViscousLaw::Finite => finite::Step::new(seconds / time).end(*state, from, to).0,
        });
        each.collect()
    }

    fn advance(&mut self, seconds: f64, stretch: f64) {
        let states = self.after(seconds, stretch);
        for ((.., state), found) in self.branches.iter_mut().zip(states) {
            *state = found;
        }
        self.stretch = stretch;
    }

    fn equilibrium_stress(&self, stretch: f64) -> f64 {
        let Response {
            polynomial: [c0, c1, c2],
            pole,
            origin,
            scale,
        } = self.response;
        let y = (stretch.powi(2) + 2.0 / stretch - origin) / scale;
        let response = c0 + y * (c1 + y * c2) + pole / (1.0 - y);
        self.modulus * response * (stretch - stretch.powi(-2))
    }

    fn branch_stress(&self, states: &[[f64; 4]], stretch: f64) -> f64 {
        let pairs = self.branches.iter().zip(states);
        pairs
            .map(|((modulus, ..), state)| modulus * (state[0] * stretch - state[3] * stretch.powi(-2)))
            .sum()
    }

    /// Returns the stress of the branches some seconds after a sudden stretch.
    fn relaxed(mut self, stretch: f64, seconds: f64, steps: u32) -> f64 {
        self.advance(0.0, stretch);
        (0..steps).for_each(|_| self.advance(seconds / f64::from(steps), stretch));
        let states = self.after(0.0, stretch);
        self.branch_stress(&states, stretch)
    }

    /// Returns the stretch some seconds after a sudden dead load in kPa.
    fn loaded(mut self, load: f64, seconds: f64, steps: u32) -> f64 {
        for step in 0..=steps {
            // The first one is sudden; later ones grow, as creep slows down.
            let place = |at: u32| seconds * f64::from(at * at) / f64::from(steps * steps);
            let length = if step == 0 { 0.0 } else { place(step) - place(step - 1) };
            let force = |stretch: f64| {
                self.equilibrium_stress(stretch) + self.branch_stress(&self.after(length, stretch), stretch) - load
            };
            let (mut low, mut high) = (1.0, 4.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if force(middle) < 0.0 {
                    low = middle
                } else {
                    high = middle
                }
            }
            self.advance(length, low);
        }
        self.stretch
    }
}

/// A scene with its law, the stress of its branches in kPa at these times after a stretch to 1.5, and its stretch at
/// these times under a dead load of 30 kPa.
struct Known {
    scene: &'static str,
    law: ViscousLaw,
    relaxation: [(f64, f64); 3],
    creep: [(f64, f64); 3],
}

/// Relaxation by the linear law is Σ G e^(−t/τ)(λ − λ⁻²). By the finite law the elastic stretch of a branch falls from
/// λ by dλₑ/dt = −(λₑ³ − 1)/(3τ), integrated in closed form. Creep was integrated with Radau's method to 1e-11, from
/// the laws as the authors write them: A by dA/dt = (C⁻¹ − A)/τ, and the viscous stretch by dλᵥ/dt = λᵥ(λₑ² −
/// 1/λₑ)/(3τ).
const KNOWN: [Known; 2] = [
    Known {
        scene: "vhb4910-wang.yaml",
        law: ViscousLaw::Linear,
        relaxation: [
            (1.0, 40.593_119_203_3),
            (10.0, 15.807_621_867_2),
            (60.0, 4.295_168_402_3),
        ],
        creep: [(1.0, 1.212_561_975_6), (10.0, 1.396_691_134_5), (60.0, 1.743_747_913_2)],
    },
    Known {
        scene: "vhb4910-hossain.yaml",
        law: ViscousLaw::Finite,
        relaxation: [
            (1.0, 61.368_254_130_2),
            (10.0, 29.526_762_230_8),
            (60.0, 17.234_738_605_6),
        ],
        creep: [(1.0, 1.137_850_979_7), (10.0, 1.258_521_223_9), (60.0, 1.427_114_048_1)],
    },
];

#[test]
fn branches_of_published_scenes_flow_by_the_law_of_their_authors() {
    for known in KNOWN {
        let scene = published(known.scene);
        assert_eq!(Bar::of(&scene).law, known.law, "{}", known.scene);
        for (time, stress) in known.relaxation {
            let [coarse, fine] = [400, 800].map(|steps| Bar::of(&scene).relaxed(1.5, time, steps));
            let found = fine + (fine - coarse) / 3.0;
            assert!(
                (found / stress - 1.0).abs() < 1e-6,
                "{} {time} s: {found} {stress}",
                known.scene
            );
        }
        for (time, stretch) in known.creep {
            let [coarse, fine] = [200, 400].map(|steps| Bar::of(&scene).loaded(30.0, time, steps));
            let found = fine + (fine - coarse) / 3.0;
            assert!(
                (found - stretch).abs() < 1e-5,
                "{} {time} s: {found} {stretch}",
                known.scene
            );
        }
        let relaxed = |law: ViscousLaw| Bar { law, ..Bar::of(&scene) }.relaxed(1.5, 10.0, 800);
        let [linear, finite] = [ViscousLaw::Linear, ViscousLaw::Finite].map(relaxed);
        assert!(linear > 1.1 * finite, "the laws can be told apart: {linear} {finite}");
    }
}

#[test]
fn the_equilibrium_of_hossain_is_that_of_the_measured_bars() {
    // Stretch and nominal stress in MPa of VHB 4910 at equilibrium, Hossain, Vu, Steinmann (2012), as digitised in
    // github.com/Chongran-Zhao/Hyperelastic-fitting, VHB_UT_eq_Hossain.
    let measured = [
        (1.505_147_78, 0.015_680_789_8),
        (2.001_413_98, 0.023_475_581_1),
        (2.502_003_85, 0.033_302_804_9),
        (3.006_561_15, 0.039_227_509_0),
        (3.498_508_55, 0.045_071_168_6),
        (4.011_576_57, 0.052_784_317_6),
        (4.490_923_82, 0.058_709_534_2),
        (5.020_808_30, 0.066_584_943_0),
    ];
    let bar = Bar::of(&published("vhb4910-hossain.yaml"));
    let off = measured.map(|(stretch, stress)| 1e-3 * bar.equilibrium_stress(stretch) / stress - 1.0);
    let mean = (off.iter().map(|off| off * off).sum::<f64>() / 8.0).sqrt();
    assert!(mean < 0.04 && off.iter().all(|off| off.abs() < 0.08), "{off:?}");
}
