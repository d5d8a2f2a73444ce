//! Membranes with effects: closed forms, symmetry, signs of changes, and errors.

use super::scenes::{PointWork, arruda_boyce, combinations, decay, electrode, gent, ogden, scene, with_law, yeoh};
use super::*;
use deaflow_scene::{Effects, On, PermittivityReference, Stiffening};

fn stiffening(law: Stiffening) -> Effects {
    Effects {
        strain_stiffening: Some(law),
        ..Effects::default()
    }
}

fn wrinkling() -> Effects {
    Effects {
        wrinkling: Some(On {}),
        ..Effects::default()
    }
}

/// One of each effect.
fn single_effects() -> Vec<(&'static str, Effects)> {
    vec![
        ("gent", stiffening(gent(60.0))),
        ("yeoh", stiffening(yeoh(0.0, 5.0))),
        ("arruda-boyce", stiffening(arruda_boyce(4.0))),
        ("ogden", stiffening(ogden(&[(40e3, 1.9), (50.0, 6.0), (-3e3, -2.0)]))),
        (
            "electrode",
            Effects {
                electrode_stiffness: Some(electrode(0.3)),
                ..Effects::default()
            },
        ),
        (
            "permittivity",
            Effects {
                stretch_dependent_permittivity: Some(decay(0.2, PermittivityReference::Prestretched)),
                ..Effects::default()
            },
        ),
        (
            "fringe",
            Effects {
                fringe_field: Some(On {}),
                ..Effects::default()
            },
        ),
        ("wrinkling", wrinkling()),
    ]
}

fn solve(scene: &Scene, pattern: &Pattern) -> MeshSolution {
    solver(scene, 1).solve(pattern)
}

fn size(solution: &MeshSolution) -> f64 {
    norm(&solution.displacement)
}

fn largest(solution: &MeshSolution) -> f64 {
    solution.displacement.iter().map(|u| u.abs()).fold(0.0, f64::max)
}

#[test]
fn each_effect_moves_the_membrane_the_way_it_should() {
    let disc = Pattern::from_fn(Raster::PAPER, |x, y| (x as f64 - 24.5).hypot(y as f64 - 24.5) < 8.0);
    // The field at the cell corners: a fringe field has more elements.
    let solved = |effects| {
        let solver = solver(&scene(3.0, 5.25e3, effects), 2);
        let solution = solver.solve(&disc);
        let size = solver
            .simulation(&disc, &solution)
            .field
            .map(|field| field.rms_difference(&Field::zero(Raster::PAPER)));
        (solution, size)
    };
    let (base, base_size) = solved(Effects::default());
    for (name, effects) in single_effects() {
        let (solution, size) = solved(effects);
        assert_eq!(solution.outcome, Outcome::Converged, "{name}");
        assert!(solution.newton_iterations <= base.newton_iterations + 2, "{name}");
        let ratio = size.unwrap() / base_size.unwrap();
        match name {
            "fringe" => assert!(ratio > 1.001 && ratio < 1.05, "{name}: {ratio}"),
            // Nothing wrinkles in this scene.
            "wrinkling" => assert!((ratio - 1.0).abs() < 1e-12, "{name}: {ratio}"),
            _ => assert!(ratio > 0.3 && ratio < 0.97, "{name}: {ratio}"),
        }
    }
}

#[test]
fn results_with_effects_follow_the_symmetries_of_the_square() {
    let pattern = random(0);
    for effects in combinations() {
        let effects = Effects {
            fringe_field: Some(On {}),
            ..effects
        };
        let solver = solver(&scene(3.0, 5.25e3, effects), 1);
        let images: Vec<Pattern> = Symmetry::ALL.iter().map(|&g| pattern.transformed(g)).collect();
        let results = solver.simulate(&images);
        let field = results[0].field.clone().unwrap();
        let upright = Symmetry::ALL
            .iter()
            .position(|&g| pattern.transformed(g) == pattern)
            .unwrap();
        assert_eq!(upright, 0);
        for (g, image) in Symmetry::ALL.iter().zip(&results) {
            let gap = image.field.as_ref().unwrap().rms_difference(&field.transformed(*g));
            assert!(gap < 1e-9, "{gap:e}");
        }
    }
}

/// Nodal displacements of the half-active strip, affine in each half.
fn strip(grid: Grid, e: f64) -> Vec<f64> {
    let (last, degree) = (grid.layout().nodes()[0] - 1, grid.order().degree() as f64);
    let mut u = vec![0.0; grid.layout().vector_len()];
    for (row, column) in places(&grid) {
        u[grid.layout().index(0, column, row)] = e * column.min(last - column) as f64 / degree;
    }
    u
}

fn bisect(rising: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 0.6);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if rising(middle) < 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

/// ‖R‖ of the strip at e with the law of a scene.
struct StripResidual(f64);

impl PointWork for StripResidual {
    type Output = f64;
    fn run<L: Material>(self, material: &L) -> f64 {
        let grid = Grid::paper(Mesh::new(1, Order::Biquadratic));
        let activity = Activity::new(&grid, &half());
        let operator = Operator::new(material, &activity);
        let mut residual = vec![0.0; grid.layout().vector_len()];
        operator.residual(&strip(grid, self.0), &mut residual);
        norm(&residual)
    }
}

#[test]
fn a_stiffening_strip_is_in_equilibrium_where_the_closed_form_says() {
    // As H5, with 2ψ′/μ = m(I₁): m(I)(a − a⁻³/9) − 9κa = m(I′)(b − b⁻³/9), I = a² + 9 + 1/(9a²).
    let scene = scene(3.0, 5e3, stiffening(gent(40.0)));
    let kappa = scene.kappa();
    let elastic = |a: f64| {
        let m = 1.0 / (1.0 - (a * a + 6.0 + 1.0 / (9.0 * a * a)) / 40.0);
        m * (a - a.powi(-3) / 9.0)
    };
    let gap = |e: f64| {
        let (a, b) = (3.0 * (1.0 + e), 3.0 * (1.0 - e));
        elastic(a) - 9.0 * kappa * a - elastic(b)
    };
    let e = bisect(gap);
    assert!(e > 0.03 && e < 0.1156, "{e}");
    assert!(with_law(&scene, StripResidual(e)) < 1e-11);
    assert!(with_law(&scene, StripResidual(e * (1.0 + 1e-8))) > 1e-9);
}

#[test]
fn a_wrinkled_strip_is_in_equilibrium_where_the_closed_form_says() {
    // As H5 at λp = 1.2 with the tension field in the active half: P₁ = a − a⁻²s − κ/s, s = √(1 − κa²), except for the
    // share of the flat membrane; P₁₁ = b − b⁻³/λp² in the other half.
    let share = crate::energy::RESIDUAL;
    let scene = scene(1.2, 20_797.0, wrinkling());
    let kappa = scene.kappa();
    let bare = |b: f64| b - b.powi(-3) / 1.44;
    let flat = |a: f64| bare(a) - 1.44 * kappa * a;
    let wrinkled = |a: f64| {
        let s = (1.0 - kappa * a * a).max(1e-9).sqrt();
        a - s / (a * a) - kappa / s
    };
    let halves = |e: f64| (1.2 * (1.0 + e), 1.2 * (1.0 - e));
    let (mut low, mut high) = (0.15, 0.18);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        let (a, b) = halves(middle);
        let gap = (1.0 - share) * wrinkled(a) + share * flat(a) - bare(b);
        if gap < 0.0 { low = middle } else { high = middle }
    }
    let (a, b) = halves(low);
    assert!(low > 0.16 && low < 0.17 && wrinkled(a) > 0.0 && flat(a) - bare(b) > 0.03);
    assert!(with_law(&scene, StripResidual(low)) < 1e-11);
    assert!(with_law(&scene, StripResidual(low * (1.0 + 1e-8))) > 1e-9);
}

#[test]
fn a_uniform_active_membrane_goes_slack_at_its_critical_voltage() {
    // H12: √κ = √(λ⁻² − λ⁻⁸) = 0.333104631191 at λ = 3, which is 10.9538 kV; at λ = 1.5 it is 0.636705, 20.937 kV.
    let all = [Pattern::from_fn(Raster::PAPER, |_, _| true)];
    let outcome = |prestretch, voltage| solver(&scene(prestretch, voltage, wrinkling()), 1).simulate(&all)[0].outcome;
    assert_eq!(outcome(3.0, 10_953.0), Outcome::Converged);
    assert_eq!(outcome(3.0, 10_955.0).name(), "slack");
    let critical = (1.5_f64.powi(-2) - 1.5_f64.powi(-8)).sqrt()
        * 1e-3
        * (45e3 / scene(1.5, 0.0, wrinkling()).permittivity()).sqrt();
    assert_eq!(outcome(1.5, 0.9999 * critical), Outcome::Converged);
    for voltage in [1.0001 * critical, 1.1 * critical, 1e6] {
        let Outcome::Slack {
            last_stable,
            first_unstable,
        } = outcome(1.5, voltage)
        else {
            panic!("{} at {voltage} V", outcome(1.5, voltage));
        };
        assert!(last_stable < critical && first_unstable > critical && first_unstable < 1.0011 * last_stable);
    }
}

#[test]
fn a_membrane_without_prestretch_and_voltage_is_not_slack() {
    for effects in combinations() {
        for pattern in [half(), random(2)] {
            let result = solve(&scene(1.0, 0.0, effects.clone()), &pattern);
            assert_eq!(result.outcome, Outcome::Converged);
            assert_eq!(largest(&result), 0.0);
        }
    }
}

#[test]
fn a_wrinkled_membrane_has_no_compression_and_is_softer() {
    // At λp = 1.2 and 19 kV the middle of the sides of the frame wrinkles; there the compression of the flat membrane
    // is 0.18 μ.
    for law in [None, Some(gent(30.0))] {
        let at = |wrinkling: bool| {
            let effects = Effects {
                strain_stiffening: law.clone(),
                wrinkling: wrinkling.then_some(On {}),
                ..Effects::default()
            };
            let scene = scene(1.2, 19e3, effects);
            let solver = solver(&scene, 1);
            let solution = solver.solve(&half());
            assert_eq!(solution.outcome, Outcome::Converged);
            let cells = solver.cell_states(&half(), &solution);
            assert!(cells.iter().any(|cell| cell.tension == Tension::Wrinkled));
            let stresses = cells.iter().map(|cell| cell.stresses[1] / scene.shear_modulus_pa());
            (size(&solution), stresses.fold(f64::INFINITY, f64::min))
        };
        let ((flat, compressed), (relaxed, wrinkled)) = (at(false), at(true));
        assert!(compressed < -0.15 && wrinkled > -5e-4);
        assert!(relaxed > 1.0001 * flat && relaxed < 1.02 * flat, "{relaxed} {flat}");
    }
}

#[test]
fn cells_of_a_fully_active_membrane_have_the_homogeneous_state() {
    let scene = scene(3.0, 5e3, stiffening(gent(60.0)));
    let solver = solver(&scene, 2);
    let pattern = Pattern::from_fn(Raster::PAPER, |_, _| true);
    let cells = solver.cell_states(&pattern, &solver.solve(&pattern));
    let first = 18.0 + 1.0 / 81.0 - 3.0;
    let modulus = 1.0 / (1.0 - first / 60.0);
    let stress = modulus * (9.0 - 1.0 / 81.0) - 81.0 * scene.kappa();
    for cell in cells {
        assert!((cell.stresses[1] / scene.shear_modulus_pa() - stress).abs() < 1e-12);
        assert!(cell.stretches.iter().all(|stretch| (stretch - 3.0).abs() < 1e-12));
        assert!((cell.electric_field - 5e3 / 1e-3 * 9.0).abs() < 1e-6);
        assert_eq!(cell.tension, Tension::Taut);
    }
}

#[test]
fn states_of_cells_are_the_closed_forms_at_any_deformation() {
    // P = μ(F − J⁻²F⁻ᵀ) − ε(V/H)²J²F⁻ᵀ, principal values of σ = PFᵀ, and E = VJ/H, at 45 kPa, 1 mm, λp = 3 and 5.25 kV,
    // by mpmath; electrodes with χ = 0.3 add μλpχ(f − j⁻²f⁻ᵀ) to P.
    let coated = Effects {
        electrode_stiffness: Some(electrode(0.3)),
        ..Effects::default()
    };
    let mesh = Mesh::new(1, Order::Bilinear);
    let grid = Grid::paper(mesh);
    let mut u = vec![0.0; grid.layout().vector_len()];
    for (row, column) in places(&grid) {
        let (x, y) = (column as f64, row as f64);
        u[grid.layout().index(0, column, row)] = 0.12 * x + 0.07 * y;
        u[grid.layout().index(1, column, row)] = -0.11 * x - 0.07 * y;
    }
    let close = |found: f64, exact: f64| assert!((found / exact - 1.0).abs() < 1e-11, "{found} {exact}");
    for (effects, piola, stresses) in [
        (
            Effects::default(),
            [
                [120_829.738_71, 5_857.818_557_092],
                [-12_564.066_354_51, 88_975.061_672_21],
            ],
            [410_715.123_691_9, 248_889.504_233],
        ),
        (
            coated,
            [
                [133_588.135_814_6, 4_836.714_988_827],
                [-14_565.182_265_62, 87_377.916_249_87],
            ],
            [454_418.024_133_1, 244_044.718_836_5],
        ),
    ] {
        let all = Pattern::from_fn(Raster::PAPER, |_, _| true);
        for cell in cell_states(&scene(3.0, 5.25e3, effects), mesh, &all, &u).unwrap() {
            for k in 0..2 {
                close(cell.stretches[k], [3.378_078_216_743, 2.795_583_581_574][k]);
                close(cell.stresses[k], stresses[k]);
                close(cell.piola[k][0], piola[k][0]);
                close(cell.piola[k][1], piola[k][1]);
            }
            close(cell.electric_field, 49_579_425.0);
            assert_eq!(cell.tension, Tension::Taut);
        }
    }
}

#[test]
fn gradients_are_given_where_the_energy_is_linear_in_the_activity() {
    struct Linear;
    impl PointWork for Linear {
        type Output = bool;
        fn run<L: Material>(self, material: &L) -> bool {
            let gradient = [[0.12, 0.07], [-0.11, -0.17]];
            let [bare, half, full] = [0.0, 0.5, 1.0].map(|active| material.stress(gradient, active));
            let gap = |i: usize, k: usize| (0.5 * (bare[i][k] + full[i][k]) - half[i][k]).abs();
            gap(0, 0).max(gap(0, 1)).max(gap(1, 0)).max(gap(1, 1)) < 1e-14
        }
    }
    let weights = Field::from_values(
        Raster::PAPER,
        (0..CORNERS * CORNERS * 2)
            .map(|i| f64::from(u8::from(i % 97 == 5)))
            .collect(),
    );
    for (name, effects) in single_effects() {
        let scene = scene(3.0, 5e3, effects);
        assert!(with_law(&scene, Linear), "{name}");
        let solver = solver(&scene, 1);
        let gradient = solver.gradient(&half(), &solver.solve(&half()), weights.as_ref().unwrap());
        assert_eq!(gradient.is_none(), ["fringe", "wrinkling"].contains(&name), "{name}");
    }
}

/// Forces and tangent of an undisplaced membrane, which are computed without a loop over elements.
struct AtRest<'a>(&'a Activity);

impl PointWork for AtRest<'_> {
    type Output = ();

    fn run<L: Material>(self, material: &L) {
        let operator = Operator::new(material, self.0);
        let rest = vec![0.0; operator.layout().vector_len()];
        let [mut found, mut expected] = [rest.clone(), rest.clone()];
        operator.residual_at_rest(&rest, &mut found);
        operator.residual(&rest, &mut expected);
        assert!(norm(&expected) > 0.0 && found == expected);

        let step = self
            .0
            .grid()
            .random_load(&mut Stream::new(0, "tangent at rest", 0), &rest);
        let mut moduli = Vec::new();
        operator.linearise(&rest, &mut moduli);
        assert!(moduli.is_empty());
        operator.tangent_at(&rest, &moduli, &step, &mut found);
        operator.tangent(&rest, &step, &mut expected);
        let difference: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| a - b).collect();
        assert!(norm(&difference) < 1e-13 * norm(&expected));

        let moved: Vec<f64> = step.iter().map(|u| 0.05 * u / norm(&step)).collect();
        operator.linearise(&moved, &mut moduli);
        assert_eq!(moduli.is_empty(), !material.stores_moduli());
    }
}

#[test]
fn an_undisplaced_membrane_is_what_its_elements_are() {
    for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
        let activity = Activity::new(&Grid::paper(mesh), &random(2));
        for (_, effects) in single_effects() {
            with_law(&scene(3.0, 5.25e3, effects), AtRest(&activity));
        }
    }
}
