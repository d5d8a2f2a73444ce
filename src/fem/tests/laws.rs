//! Every law and combination of effects, at a point.

use std::path::Path;

use super::scenes::{
    Piola, PointWork, arruda_boyce, combinations, decay, electrode, gent, ogden, scene, stress, with_law, yeoh,
};
use super::*;
use crate::effects::Model;
use crate::kinematics::{Tensor, contract, deformation, determinant};
use deaflow_base::Document;
use deaflow_scene::laws::MooneyRivlin;
use deaflow_scene::{Effects, On, PermittivityReference, Stiffening};

const ENTRIES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// Checks energy, stress and tangent against each other at random gradients; returns the number of wrinkled points.
struct Derivatives {
    active: f64,
    size: f64,
}

impl PointWork for Derivatives {
    type Output = usize;
    fn run<L: Material>(self, material: &L) -> usize {
        let mut stream = Stream::new(11, "material test", 0);
        let mut wrinkled = 0;
        for _ in 0..40 {
            let mut entry = || stream.range(-self.size, self.size);
            let gradient = [[entry(), entry()], [entry(), entry()]];
            if determinant(deformation(gradient)) < 0.2 || material.admissible(gradient) < 0.05 {
                continue;
            }
            let f = deformation(gradient);
            let wrinkles = material.wrinkles() && material.margins(f, self.active).tension != 1.0;
            // Without a natural width the energy is not defined.
            if wrinkles && material.ellipticity(f, self.active) <= 0.0 {
                continue;
            }
            wrinkled += usize::from(wrinkles);
            check_derivatives(material, gradient, self.active);
        }
        wrinkled
    }
}

fn check_derivatives<L: Material>(material: &L, gradient: Tensor<f64>, active: f64) {
    let step = 1e-5;
    let nudged = |i: usize, k: usize, by: f64| {
        let mut moved = gradient;
        moved[i][k] += by;
        moved
    };
    let rest = material.self_stress(deformation(gradient));
    let stress = material.stress(gradient, active);
    for (i, k) in ENTRIES {
        let (up, down) = (nudged(i, k, step), nudged(i, k, -step));
        let slope =
            (material.energy(deformation(up), active) - material.energy(deformation(down), active)) / (2.0 * step);
        let piola = stress[i][k] + rest[i][k];
        assert!(
            (slope - piola).abs() < 1e-7 * (1.0 + piola.abs()),
            "{gradient:?}: {slope} {piola}"
        );
        let mut direction = [[0.0; 2]; 2];
        direction[i][k] = 1.0;
        let tangent = material.tangent(gradient, active, direction);
        let (p, m) = (material.stress(up, active), material.stress(down, active));
        let size = contract(tangent, tangent).sqrt();
        for (r, c) in ENTRIES {
            let slope = (p[r][c] - m[r][c]) / (2.0 * step);
            assert!(
                (slope - tangent[r][c]).abs() < 3e-6 * (1.0 + size),
                "{gradient:?}: {slope} {}",
                tangent[r][c]
            );
        }
    }
}

#[test]
fn stress_and_tangent_are_derivatives_of_the_energy_in_every_combination() {
    for effects in combinations() {
        let mut wrinkled = 0;
        for (prestretch, voltage) in [(1.3, 9e3), (3.0, 5.25e3), (3.0, 10e3)] {
            for active in [0.0, 0.4, 1.0] {
                let scene = scene(prestretch, voltage, effects.clone());
                wrinkled += with_law(&scene, Derivatives { active, size: 0.35 });
            }
        }
        assert_eq!(wrinkled > 0, effects.wrinkling.is_some());
    }
}

/// The effects of a scene with a stiffening law in YAML.
fn effects_with(law: &str) -> Effects {
    let document = Document::from_text(Path::new("law"), law).unwrap();
    Effects {
        strain_stiffening: Some(Stiffening::read_with(&document.root, &[]).unwrap()),
        ..Effects::default()
    }
}

#[test]
fn every_law_of_the_table_has_the_derivatives_of_its_energy_and_its_stress_at_rest() {
    for example in Stiffening::EXAMPLES {
        let effects = effects_with(example);
        for (prestretch, active) in [(1.3, 1.0), (3.0, 0.0), (3.0, 1.0)] {
            let scene = scene(prestretch, 5.25e3, effects.clone());
            with_law(&scene, Derivatives { active, size: 0.35 });
        }
    }
}

/// w at f = I + ∇u, per prestretched area and in units of μH.
struct EnergyAt(Tensor<f64>, f64);

impl PointWork for EnergyAt {
    type Output = f64;
    fn run<L: Material>(self, material: &L) -> f64 {
        material.energy(self.0, self.1)
    }
}

#[test]
fn energies_are_those_of_the_published_laws() {
    // W/μ per undeformed volume at λp = 1.3 and 3, by mpmath with 40 digits from the principal stretches of λp f: the
    // laws of docs/effects.md, that of Arruda and Boyce by quadrature of ½m from I₁ = 3. κ = 0.0254889931661.
    let law = |law| Effects {
        strain_stiffening: Some(law),
        ..Effects::default()
    };
    let mooney = Stiffening::MooneyRivlin(MooneyRivlin { c2: stress(800.0) });
    let coated = Effects {
        electrode_stiffness: Some(electrode(0.3)),
        ..Effects::default()
    };
    let decaying = |reference| Effects {
        stretch_dependent_permittivity: Some(decay(0.4, reference)),
        ..Effects::default()
    };
    let rubber = ogden(&[(40e3, 1.3), (300.0, 5.0), (-2e3, -2.0)]);
    let rows = [
        ("base", Effects::default(), 0.0, [0.464_173_545_787, 8.118_956_420_133]),
        (
            "voltage",
            Effects::default(),
            1.0,
            [0.424_096_524_047_9, 6.982_357_995_404],
        ),
        ("Gent", law(gent(60.0)), 0.0, [0.467_801_972_898_5, 9.467_301_289_183]),
        (
            "Yeoh",
            law(yeoh(-150.0, 4.0)),
            0.0,
            [0.461_371_902_562_6, 7.620_630_148_66],
        ),
        (
            "Arruda–Boyce",
            law(arruda_boyce(4.0)),
            0.0,
            [0.485_698_210_570_3, 9.674_196_557_304],
        ),
        (
            "Mooney–Rivlin",
            law(mooney),
            0.0,
            [0.470_651_710_543_1, 9.366_265_624_856],
        ),
        ("Ogden", law(rubber), 0.0, [0.310_171_223_968, 6.645_807_395_238]),
        ("electrodes", coated, 1.0, [0.435_387_429_649_4, 7.042_487_078_489]),
        (
            "ε of the prestretched membrane",
            decaying(PermittivityReference::Prestretched),
            1.0,
            [0.424_860_601_491_3, 7.004_027_500_294],
        ),
        (
            "ε of the undeformed elastomer",
            decaying(PermittivityReference::Undeformed),
            1.0,
            [0.432_303_631_962_3, 7.655_989_269_828],
        ),
    ];
    for (name, effects, active, energies) in rows {
        for (prestretch, exact) in [1.3, 3.0].into_iter().zip(energies) {
            let at = EnergyAt([[1.12, 0.07], [-0.11, 0.93]], active);
            let found = with_law(&scene(prestretch, 5.25e3, effects.clone()), at) * prestretch * prestretch;
            assert!(
                (found / exact - 1.0).abs() < 1e-11,
                "{name}, {prestretch}: {found} {exact}"
            );
        }
    }
}

#[test]
fn ellipticity_and_tension_are_lost_at_unequal_stretches_where_the_closed_forms_say() {
    // εE² = μ(λmin² + 3J⁻²) and μ(λmin² − J⁻²), with εE²/μ = κJ².
    let (prestretch, f) = (1.3, [[1.12, 0.0], [0.0, 0.93]]);
    let (least, area) = (prestretch * 0.93, prestretch * prestretch * 1.12 * 0.93);
    let unit = scene(prestretch, 1.0, Effects::default()).kappa();
    let voltage = |room: f64| ((least * least + room / (area * area)) / (area * area * unit)).sqrt();
    struct Margins(Tensor<f64>);
    impl PointWork for Margins {
        type Output = [f64; 2];
        fn run<L: Material>(self, material: &L) -> [f64; 2] {
            let [[_, _], [_, across]] = Piola(self.0, 1.0).run(material);
            [material.ellipticity(deformation(self.0), 1.0), across]
        }
    }
    // The base law, and that of isotropic energies.
    let isotropic = Effects {
        strain_stiffening: Some(yeoh(0.0, 0.0)),
        ..Effects::default()
    };
    for effects in [Effects::default(), isotropic] {
        let at = |voltage: f64| {
            let gradient = [[f[0][0] - 1.0, 0.0], [0.0, f[1][1] - 1.0]];
            with_law(&scene(prestretch, voltage, effects.clone()), Margins(gradient))
        };
        for (margin, critical) in [voltage(3.0), voltage(-1.0)].into_iter().enumerate() {
            let [below, above] = [1.0 - 1e-9, 1.0 + 1e-9].map(|share| at(share * critical)[margin]);
            assert!(below > 0.0 && above < 0.0, "{margin}: {below:e} {above:e}");
        }
    }
}

#[test]
fn only_the_voltage_stresses_an_undisplaced_membrane() {
    for effects in combinations() {
        let scene = scene(2.0, 5e3, effects);
        struct AtRest;
        impl PointWork for AtRest {
            type Output = ();
            fn run<L: Material>(self, material: &L) {
                let (bare, active) = (material.stress([[0.0; 2]; 2], 0.0), material.stress([[0.0; 2]; 2], 1.0));
                assert!(contract(bare, bare) < 1e-30);
                for (i, k) in ENTRIES {
                    let expected = if i == k { -material.load() } else { 0.0 };
                    assert!((active[i][k] - expected).abs() < 1e-15);
                }
            }
        }
        with_law(&scene, AtRest);
    }
}

/// Largest difference between the laws of two scenes, in stress and tangent, at some gradients and both activities.
fn law_gap(one: &Scene, other: &Scene) -> f64 {
    struct Samples;
    impl PointWork for Samples {
        type Output = Vec<f64>;
        fn run<L: Material>(self, material: &L) -> Vec<f64> {
            let mut values = Vec::new();
            for (gradient, active) in [[[0.12, 0.07], [-0.11, -0.07]], [[0.0; 2]; 2], [[0.2, 0.0], [0.1, 0.2]]]
                .into_iter()
                .flat_map(|g| [0.0, 1.0].map(|s| (g, s)))
            {
                let stress = material.stress(gradient, active);
                let tangent = material.tangent(gradient, active, [[0.3, -0.2], [0.5, 0.7]]);
                values.extend(stress.iter().chain(&tangent).flatten());
                values.push(material.ellipticity(deformation(gradient), active));
            }
            values
        }
    }
    let (a, b) = (with_law(one, Samples), with_law(other, Samples));
    a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn every_effect_reduces_to_the_base_model() {
    let base = scene(3.0, 5.25e3, Effects::default());
    let stiffened = |stiffening| {
        let effects = Effects {
            strain_stiffening: Some(stiffening),
            ..Effects::default()
        };
        law_gap(&base, &scene(3.0, 5.25e3, effects))
    };
    // The base law, and laws that approach it as a parameter grows.
    assert!(stiffened(yeoh(0.0, 0.0)) < 1e-14);
    assert!(stiffened(ogden(&[(45e3, 2.0)])) < 1e-13);
    for limit in [1e4, 1e6] {
        let gap = stiffened(gent(limit));
        assert!(gap > 1.0 / limit && gap < 100.0 / limit, "{gap:e}");
        let gap = stiffened(arruda_boyce(limit.sqrt()));
        assert!(gap > 0.1 / limit && gap < 100.0 / limit, "{gap:e}");
    }
    let with = |effects| law_gap(&base, &scene(3.0, 5.25e3, effects));
    for reference in [PermittivityReference::Prestretched, PermittivityReference::Undeformed] {
        let gap = |exponent: f64| {
            with(Effects {
                stretch_dependent_permittivity: Some(decay(exponent, reference)),
                ..Effects::default()
            })
        };
        assert!(gap(0.0) < 1e-14 && gap(1e-6) > 1e-8 && gap(1e-6) < 1e-5);
    }
    let coated = |ratio: f64| {
        with(Effects {
            electrode_stiffness: Some(electrode(ratio)),
            ..Effects::default()
        })
    };
    assert!(coated(0.0) < 1e-14 && coated(1e-6) > 1e-7 && coated(1e-6) < 1e-5);
    // Nothing wrinkles at these gradients.
    assert!(
        with(Effects {
            wrinkling: Some(On {}),
            ..Effects::default()
        }) < 1e-14
    );
}

#[test]
fn mooney_and_rivlins_law_is_the_sum_of_two_powers_and_reduces_to_the_base_model() {
    let mooney = |c2: f64| {
        let c2 = stress(c2);
        Effects {
            strain_stiffening: Some(Stiffening::MooneyRivlin(MooneyRivlin { c2 })),
            ..Effects::default()
        }
    };
    let base = scene(3.0, 5.25e3, Effects::default());
    assert!(law_gap(&base, &scene(3.0, 5.25e3, mooney(0.0))) < 1e-13);
    // C₁ = μ/2 − C₂ multiplies I₁ − 3 and C₂ I₂ − 3: Ogden's terms 2C₁ with exponent 2 and −2C₂ with exponent −2.
    for c2 in [800.0, -50.0] {
        let powers = Effects {
            strain_stiffening: Some(ogden(&[(45e3 - 2.0 * c2, 2.0), (-2.0 * c2, -2.0)])),
            ..Effects::default()
        };
        for prestretch in [1.0, 1.5, 3.0] {
            let [one, other] = [mooney(c2), powers.clone()].map(|effects| scene(prestretch, 3e3, effects));
            assert!(
                law_gap(&one, &other) < 1e-11,
                "{c2} {prestretch}: {:e}",
                law_gap(&one, &other)
            );
        }
    }
}

#[test]
fn a_permittivity_counted_from_the_undeformed_state_is_smaller_by_the_prestretch() {
    let at = |voltage, reference| {
        let effects = Effects {
            stretch_dependent_permittivity: Some(decay(0.3, reference)),
            ..Effects::default()
        };
        scene(3.0, voltage, effects)
    };
    let equal = at(5e3 * 3f64.powf(0.3), PermittivityReference::Undeformed);
    assert!(law_gap(&at(5e3, PermittivityReference::Prestretched), &equal) < 1e-13);
}

#[test]
fn what_cannot_be_stretched_so_far_is_refused() {
    // I₁ − 3 = 15.0123 and I₁/3 = 6.004 at λp = 3.
    let refusal = |stiffening| {
        let effects = Effects {
            strain_stiffening: Some(stiffening),
            ..Effects::default()
        };
        Model::new(&scene(3.0, 1e3, effects)).err()
    };
    let limit = SetupError::LimitingStretch { prestretch: 3.0 };
    assert_eq!(refusal(gent(15.01)), Some(limit.clone()));
    assert_eq!(refusal(gent(15.02)), None);
    assert_eq!(refusal(arruda_boyce(2.45)), Some(limit));
    assert_eq!(refusal(arruda_boyce(2.46)), None);
    assert_eq!(refusal(ogden(&[])), Some(SetupError::OgdenTerms));
    assert_eq!(refusal(ogden(&[(1e3, 0.0)])), Some(SetupError::OgdenTerms));
}

#[test]
fn a_state_beyond_the_limiting_stretch_is_not_admissible() {
    struct Admissible(Tensor<f64>);
    impl PointWork for Admissible {
        type Output = bool;
        fn run<L: Material>(self, material: &L) -> bool {
            material.admissible(self.0) > 0.0
        }
    }
    let effects = Effects {
        strain_stiffening: Some(gent(20.0)),
        ..Effects::default()
    };
    let scene = scene(3.0, 1e3, effects);
    // I₁ − 3 = 20 at equal stretches of 3.3911.
    for (stretch, inside) in [(3.38, true), (3.40, false)] {
        let strain = stretch / 3.0 - 1.0;
        assert_eq!(with_law(&scene, Admissible([[strain, 0.0], [0.0, strain]])), inside);
    }
}

/// The nominal field √κ of a free membrane at an equal stretch, from the stress of the law, which is linear in κ.
fn free_field(stiffening: &Stiffening, stretch: f64) -> f64 {
    let at = |voltage: f64| {
        let effects = Effects {
            strain_stiffening: Some(stiffening.clone()),
            ..Effects::default()
        };
        let scene = scene(1.0, voltage, effects);
        let strain = stretch - 1.0;
        (
            with_law(&scene, Piola([[strain, 0.0], [0.0, strain]], 1.0))[0][0],
            scene.kappa(),
        )
    };
    let ((without, _), (with, kappa)) = (at(0.0), at(1e4));
    (without * kappa / (without - with)).sqrt()
}

#[test]
fn a_free_gent_membrane_snaps_and_rests_where_the_closed_form_says() {
    // H4: √κ = √((λ⁻² − λ⁻⁸)/(1 − (2λ² + λ⁻⁴ − 3)/Jm)): peak λ and √κ, then valley λ and √κ.
    for (jm, peak, peak_field, valley, valley_field) in [
        (70.0, 1.265556012, 0.6902412159, 4.271562147, 0.3241554142),
        (100.0, 1.263804444, 0.689363222, 5.074259959, 0.2746005535),
        (125.0, 1.263005632, 0.6889580179, 5.656746332, 0.2470510571),
    ] {
        let field = |stretch: f64| free_field(&gent(jm), stretch);
        for (stretch, expected, sign) in [(peak, peak_field, 1.0), (valley, valley_field, -1.0)] {
            assert!(
                (field(stretch) / expected - 1.0).abs() < 1e-8,
                "{jm}: {}",
                field(stretch)
            );
            let slope = |at: f64| sign * (field(at + 1e-5) - field(at - 1e-5));
            let (mut low, mut high) = (stretch - 0.1, stretch + 0.1);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if slope(middle) > 0.0 {
                    low = middle
                } else {
                    high = middle
                }
            }
            assert!((low / stretch - 1.0).abs() < 1e-8, "{jm}: {low} {stretch}");
        }
    }
}

#[test]
fn arruda_and_boyces_response_is_the_inverse_langevin_function() {
    // 2ψ′/μ = 𝓛⁻¹(y)/3y with y² = I₁/3λL²: in uniaxial tension σ/μ = m (λ² − 1/λ), here at λp = 1 without voltage.
    let locking = 3.0;
    for stretch in [1.2_f64, 2.0, 3.0, 4.5] {
        let effects = Effects {
            strain_stiffening: Some(arruda_boyce(locking)),
            ..Effects::default()
        };
        let width = stretch.powf(-0.5);
        let gradient = [[stretch - 1.0, 0.0], [0.0, width - 1.0]];
        let p = with_law(&scene(1.0, 0.0, effects), Piola(gradient, 0.0));
        assert!(p[1][1].abs() < 1e-14);
        let found = p[0][0] * stretch / (stretch * stretch - 1.0 / stretch);
        let y = ((stretch * stretch + 2.0 / stretch) / (3.0 * locking * locking)).sqrt();
        let (mut low, mut high) = (1e-9, 1e6);
        for _ in 0..200 {
            let x: f64 = 0.5 * (low + high);
            if 1.0 / x.tanh() - 1.0 / x < y {
                low = x
            } else {
                high = x
            }
        }
        assert!((found / (low / (3.0 * y)) - 1.0).abs() < 3e-3, "{stretch}: {found}");
    }
}

#[test]
fn a_locking_stretch_raises_the_modulus_of_the_undeformed_elastomer() {
    // By 3/(5λL²) and terms in λL⁻⁴: at λL = 30 the latter are 1e-6. The modulus is that of small shear.
    let effects = Effects {
        strain_stiffening: Some(arruda_boyce(30.0)),
        ..Effects::default()
    };
    let shear = 1e-6;
    let p = with_law(&scene(1.0, 0.0, effects), Piola([[0.0, shear], [0.0, 0.0]], 0.0));
    let rise = p[0][1] / shear - 1.0;
    assert!((rise - 0.6 / 900.0).abs() < 2e-6, "{rise}");
}

#[test]
fn ogdens_energy_is_the_sum_of_powers_at_equal_and_unequal_stretches() {
    let terms = [(40e3, 1.3), (300.0, 5.0), (-2e3, -2.0)];
    let effects = Effects {
        strain_stiffening: Some(ogden(&terms)),
        ..Effects::default()
    };
    for prestretch in [1.0, 3.0] {
        for (a, b) in [(1.1, 1.1), (1.1, 1.1 + 1e-7), (0.8, 1.2), (1.5, 0.5), (2.0, 0.4)] {
            let third = 1.0 / (prestretch * prestretch * a * b);
            let sum = |alpha: f64| {
                let power = |s: f64| s.powf(alpha);
                power(prestretch * a) + power(prestretch * b) + power(third) - 3.0
            };
            let exact: f64 = terms.iter().map(|(m, alpha)| m / 45e3 / alpha * sum(*alpha)).sum();
            // Principal stretches a and b with some rotation and axes.
            let turn = |angle: f64| [[angle.cos(), -angle.sin()], [angle.sin(), angle.cos()]];
            let product = |p: Tensor<f64>, q: Tensor<f64>| -> Tensor<f64> {
                std::array::from_fn(|i| std::array::from_fn(|k| p[i][0] * q[0][k] + p[i][1] * q[1][k]))
            };
            let f = product(turn(0.4), product([[a, 0.0], [0.0, b]], turn(-1.1)));
            let found = with_law(&scene(prestretch, 0.0, effects.clone()), EnergyAt(f, 0.0)) * prestretch * prestretch;
            assert!(
                (found - exact).abs() < 1e-13 * (1.0 + exact.abs()),
                "{a} {b}: {found} {exact}"
            );
        }
    }
}
