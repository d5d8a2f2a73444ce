//! Electrode groups with their own voltages.

use super::*;
use crate::GradientEvaluator;
use crate::effects::Model;
use crate::evaluator::Solver;
use deaflow_field::{Differentiable, InStates, Simulation, StateFields};

/// A scene of VHB 4910, 1 mm thick.
fn scene(geometry: &str, drive: &str, effects: &str) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ thickness: 1 mm, {geometry} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ {drive} }}\neffects: {effects}"
    ))
    .unwrap()
}

const PLATE: &str = "size: [40 mm, 30 mm], prestretch: [3, 3.5], cells: [20, 16]";

/// Three stripes along y: group 1, bare, group 2, with a corner of group 1 in the last.
fn stripes(scene: &Scene) -> Pattern {
    Pattern::from_groups(scene.membrane().raster, |x, y| match x {
        0..7 => 1,
        7..11 => 0,
        _ if x > 15 && y > 12 => 1,
        _ => 2,
    })
}

fn solved(scene: &Scene, pattern: &Pattern) -> Simulation {
    let solver = MembraneSolver::new(scene, options(1, Order::Biquadratic)).unwrap();
    solver.simulate(std::slice::from_ref(pattern)).remove(0)
}

fn moved(scene: &Scene, pattern: &Pattern) -> Field {
    let simulation = solved(scene, pattern);
    assert_eq!(simulation.outcome, Outcome::Converged);
    simulation.field.unwrap()
}

#[test]
fn groups_of_one_voltage_are_one_electrode_and_one_without_voltage_is_none() {
    for effects in ["{}", "{ fringe_field: {} }", "{ wrinkling: {} }"] {
        let one = scene(PLATE, "voltage: 4 kV", effects);
        let pattern = stripes(&one);
        let union = Pattern::from_fn(pattern.raster(), |x, y| pattern.is_active(x, y));
        let equal = scene(PLATE, "voltages: [4 kV, 4 kV]", effects);
        assert_eq!(moved(&equal, &pattern), moved(&one, &union), "{effects}");
        for (drive, group) in [("voltages: [4 kV, 0 V]", 1), ("voltages: [0 V, 4 kV]", 2)] {
            let alone = moved(&scene(PLATE, drive, effects), &pattern);
            // An electrode without voltage ends the fringe field of its neighbour, which otherwise reaches into bare
            // cells.
            if effects.contains("fringe") {
                continue;
            }
            assert_eq!(alone, moved(&one, &pattern.of_group(group)), "{effects} {drive}");
        }
        let exchanged = Pattern::from_groups(pattern.raster(), |x, y| (3 - pattern.group(x, y)) % 3);
        let [first, second] =
            ["voltages: [4 kV, 2.5 kV]", "voltages: [2.5 kV, 4 kV]"].map(|v| scene(PLATE, v, effects));
        assert_eq!(moved(&first, &pattern), moved(&second, &exchanged), "{effects}");
    }
}

#[test]
fn a_strip_of_two_voltages_has_the_closed_form_displacement() {
    // Halves along x: a − a⁻³λ₂⁻² − κ₁λ₂²a = b − b⁻³λ₂⁻² − κ₂λ₂²b with a = λ₁(1 + e), b = λ₁(1 − e).
    for ([along, across], [first, second]) in [
        ([3.0_f64, 3.0_f64], [4e3, 2e3]),
        ([3.0, 4.0], [5e3, 3e3]),
        ([2.0, 5.0], [1e3, 3e3]),
    ] {
        let geometry = format!("size: [50 mm, 30 mm], prestretch: [{along}, {across}], cells: [20, 8]");
        let scene = scene(&geometry, &format!("voltages: [{first} V, {second} V]"), "{}");
        let kappa = |volts: f64| scene.permittivity() * (volts / 1e-3).powi(2) / scene.shear_modulus_pa();
        let stress = |a: f64, volts: f64| a - (a.powi(3) * across.powi(2)).recip() - kappa(volts) * across.powi(2) * a;
        let gap = |e: f64| stress(along * (1.0 + e), first) - stress(along * (1.0 - e), second);
        let (mut low, mut high) = (-0.5, 0.5);
        assert!(gap(low) < 0.0 && gap(high) > 0.0);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            *(if gap(middle) < 0.0 { &mut low } else { &mut high }) = middle;
        }
        let exact = 25.0 * low;
        let pattern = Pattern::from_groups(scene.membrane().raster, |x, _| if x < 10 { 1 } else { 2 });
        let model = Model::new(&scene).unwrap();
        let grid = model.grid(Mesh::biquadratic(1)).unwrap();
        let material = AnyMaterial::from(NeoHookean::new(scene.mean_prestretch(), scene.kappa()));
        let activity = model.activity(&grid, &pattern);
        let operator = Operator::new(&material, &activity);
        let (layout, [columns, rows]) = (grid.layout(), grid.layout().nodes());
        let mut u = vec![0.0; layout.vector_len()];
        // The strip is prescribed on the frame and must come out inside.
        for row in 0..rows {
            for column in 0..columns {
                let share = column.min(columns - 1 - column) as f64 / ((columns - 1) / 2) as f64;
                u[layout.index(0, column, row)] = exact / grid.unit_mm() * share;
            }
        }
        newton_by_factors(&operator, &vec![0.0; layout.vector_len()], &mut u);
        let found = grid.unit_mm() * u[layout.index(0, (columns - 1) / 2, rows / 2)];
        assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
        // E = V/h with h = H/(λ₁λ₂) times the change of area.
        let states = cell_states(&scene, Mesh::biquadratic(1), &pattern, &u).unwrap();
        for (x, volts) in [(3, first), (15, second)] {
            let state = states[4 * 20 + x];
            let field = volts / 1e-3 * state.stretches[0] * state.stretches[1];
            assert!((state.electric_field / field - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn limits_and_brackets_are_of_the_largest_voltage() {
    // If group 2 has no electrodes, the critical voltage is that of group 1, whatever the voltage of group 2.
    let bare = |x: usize, y: usize| u8::from((5..12).contains(&x) && (4..11).contains(&y));
    let one = scene(PLATE, "voltage: 12 kV", "{}");
    let two = scene(PLATE, "voltages: [6 kV, 12 kV]", "{}");
    let first = Pattern::from_groups(one.membrane().raster, bare);
    let second = Pattern::from_groups(one.membrane().raster, |x, y| 2 * bare(x, y));
    let [single, weak, strong] = [(&one, &first), (&two, &first), (&two, &second)].map(|(scene, pattern)| {
        let search = CriticalSearch::new(&scene.at_voltage(40e3), SolveOptions::on(Mesh::biquadratic(1))).unwrap();
        critical_voltage(&search, pattern).unwrap().voltage
    });
    assert!((strong / single - 1.0).abs() < 1e-3, "{strong} {single}");
    assert!((weak / single - 2.0).abs() < 2e-3, "{weak} {single}");
}

#[test]
fn gradients_say_what_each_group_adds() {
    let of = |second: f64| scene(PLATE, &format!("voltages: [4 kV, {second} V]"), "{}");
    let (at, raster) = (of(2800.0), of(0.0).membrane().raster);
    let pattern = stripes(&at);
    let weights = (0..2 * raster.corners()).map(|i| if i % 61 == 7 { 1.0 } else { 0.0 });
    let weights = Field::from_values(raster, weights.collect()).unwrap();
    let value = |field: &Field| -> f64 { field.values().iter().zip(weights.values()).map(|(u, w)| u * w).sum() };
    let states = InStates::new(vec![
        Box::new(GradientEvaluator::new(&at).unwrap()),
        Box::new(GradientEvaluator::new(&of(0.0)).unwrap()),
    ]);
    let slope = |fields: &StateFields| {
        let scaled = |by: f64| Field::from_values(raster, weights.values().iter().map(|w| by * w).collect()).unwrap();
        assert_eq!(fields.len(), 2);
        // Of the first state unchanged, of the second three times and reversed.
        vec![scaled(1.0), scaled(-3.0)]
    };
    let (fields, gradient) = states.gradient(&pattern, &slope).unwrap().unwrap();
    assert!(fields[0].max_difference(&moved(&at, &pattern)) < 1e-7 && fields.len() == 2);
    let [first, second] = [0, 1].map(|group| &gradient[group * raster.cells()..][..raster.cells()]);
    // Group 2 has the load (2.8/4)² in the first state and none in the second.
    let alone = InStates::one(Box::new(GradientEvaluator::new(&at).unwrap()));
    let (_, alone) = alone.gradient(&pattern, &|_| vec![weights.clone()]).unwrap().unwrap();
    for (cell, second) in second.iter().enumerate() {
        assert!((second - 0.49 * alone[cell]).abs() < 1e-9 * alone[cell].abs().max(1e-6));
    }
    assert_ne!(first, &alone[..raster.cells()]);
    // The derivative with respect to the load of group 2 is the sum over its cells.
    let share = |load: f64| value(&moved(&of(4000.0 * load.sqrt()), &pattern));
    let step = 1e-3;
    let slope = (8.0 * (share(0.49 + step) - share(0.49 - step)) - share(0.49 + 2.0 * step) + share(0.49 - 2.0 * step))
        / (12.0 * step);
    let cells = pattern.cells().iter().zip(&alone).filter(|(group, _)| **group == 2);
    let sum: f64 = cells.map(|(_, gradient)| gradient).sum();
    assert!((sum - slope).abs() < 1e-5 * slope.abs(), "{sum} {slope}");
}

#[test]
fn what_electrodes_move_is_roughly_a_sum_over_their_cells() {
    let of = |second: f64| scene(PLATE, &format!("voltages: [4 kV, {second} V]"), "{}");
    let (at, other) = (of(2800.0), of(0.0));
    let (pattern, raster) = (stripes(&at), at.membrane().raster);
    let weights = (0..2 * raster.corners()).map(|i| if i % 61 == 7 { 1.0 } else { 0.0 });
    let weights = Field::from_values(raster, weights.collect()).unwrap();
    let value = |field: &Field| -> f64 { field.values().iter().zip(weights.values()).map(|(u, w)| u * w).sum() };
    let states = InStates::new(
        [&at, &other]
            .map(|scene| Box::new(GradientEvaluator::new(scene).unwrap()))
            .into(),
    );
    let functionals = [
        vec![weights.clone(), Field::zero(raster)],
        vec![Field::zero(raster), weights.clone()],
        vec![weights.clone(), weights.scaled(-3.0)],
    ];
    let found = states.linear_response(&functionals).unwrap().unwrap();
    let rough = found.iter().map(|(unloaded, gradient)| {
        let cells = pattern.cells().iter().enumerate().filter(|(_, group)| **group > 0);
        let added = cells.map(|(cell, group)| gradient[(usize::from(*group) - 1) * raster.cells() + cell]);
        unloaded + added.sum::<f64>()
    });
    let rough: Vec<f64> = rough.collect();
    let exact = [&at, &other].map(|scene| value(&moved(scene, &pattern)));
    for (rough, exact) in rough.iter().zip([exact[0], exact[1], exact[0] - 3.0 * exact[1]]) {
        assert!((rough - exact).abs() < 0.1 * exact.abs(), "{rough} {exact}");
    }
    assert!((rough[2] - rough[0] + 3.0 * rough[1]).abs() < 1e-9 && exact[1].abs() > 0.01);
}

#[test]
fn what_no_group_stands_for_is_refused() {
    let two = scene(PLATE, "voltages: [4 kV, 3 kV]", "{}");
    let parameters = SolverParameters::new(Method::Newton, Mesh::bilinear(1));
    let solver = Solver::new(&two, &parameters).unwrap();
    let third = Pattern::from_groups(two.membrane().raster, |x, y| if (x, y) == (7, 3) { 3 } else { 1 });
    let refusal = solver.simulate(&[third]).unwrap_err();
    assert_eq!(
        refusal,
        SetupError::Group {
            y: 3,
            x: 7,
            group: 3,
            groups: 2
        }
    );
    let stiff = "{ electrode_stiffness: { shear_modulus: 1 MPa, thickness: 2 um } }";
    let square = "side: 40 mm, prestretch: 3, cells: 20";
    let refusal = Model::new(&scene(square, "voltages: [4 kV, 3 kV]", stiff)).unwrap_err();
    assert_eq!(refusal, SetupError::StiffGroups);
    assert!(Model::new(&scene(square, "voltages: [4 kV, 4 kV]", stiff)).is_ok());
}
