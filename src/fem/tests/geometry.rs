//! Errors of cells that stand for the shapes of frames, bodies and electrodes.

use std::sync::Arc;

use super::*;
use deaflow_base::Length;
use deaflow_pattern::{Electrodes, Polygons};

fn scene(geometry: &str, voltage: f64, effects: &str) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, {geometry} }}\nmaterial: {{ model: neo-hookean, \
         shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\ndrive: {{ voltage: {voltage} V }}\neffects: {effects}"
    ))
    .unwrap()
}

fn accuracy(mm: f64) -> SolverParameters {
    let length = Length::from_f64(mm).unwrap();
    SolverParameters::new(Method::Newton, MeshRequest::Accuracy(*length))
}

/// An ellipse turned anticlockwise by an angle in degrees.
fn ellipse([x, y]: [f64; 2], [along, across]: [f64; 2], angle: f64) -> Polygons {
    let (sin, cos) = angle.to_radians().sin_cos();
    let point = |at: i32| {
        let t = std::f64::consts::TAU * f64::from(at) / 4000.0;
        let [u, v] = [along * t.cos(), across * t.sin()];
        [x + cos * u - sin * v, y + sin * u + cos * v]
    };
    Polygons::new(&[(0..4000).map(point).collect()])
}

/// A pattern on the cells whose centre is in a region, and as drawn.
fn drawn(scene: &Scene, region: &Polygons) -> [Pattern; 2] {
    let membrane = scene.membrane();
    let on_cells = Pattern::from_fn(membrane.raster, |x, y| region.contains(membrane.centre_mm(x, y)));
    let electrodes = Electrodes::new(&[(1, region.clone())], membrane.size_mm);
    let drawing = on_cells.clone().with_electrodes(Some(Arc::new(electrodes)));
    [on_cells, drawing]
}

/// A random device whose shapes are followed by cells, and its electrode on cells and as drawn.
fn random_device(kind: usize, stream: &mut Stream) -> (Scene, [Pattern; 2]) {
    let cells = 20 + (20.0 * stream.uniform()) as usize;
    let mut near = |middle: f64, spread: f64| middle + spread * (stream.uniform() - 0.5);
    let ([x, y], r, angle) = ([near(25.0, 3.0), near(25.0, 3.0)], near(20.0, 3.0), near(45.0, 90.0));
    let parts = match kind % 5 {
        0 => format!("frame: {{ opening: {{ disc: {{ centre: [{x} mm, {y} mm], radius: {r} mm }} }} }}"),
        1 => format!(
            "frame: {{ opening: {{ ring: {{ centre: [{x} mm, {y} mm], radii: [{} mm, {r} mm] }} }} }}",
            0.25 * r
        ),
        2 => format!(
            "frame: {{ opening: {{ ellipse: {{ centre: [{x} mm, {y} mm], semiaxes: [{r} mm, {} mm], angle: \
             {angle} deg }} }} }}",
            0.7 * r
        ),
        3 => format!(
            "frame: {{ opening: {{ rectangle: {{ corners: [[{} mm, 12 mm], [{} mm, 39 mm]], angle: {angle} deg \
             }} }} }}",
            x - 0.8 * r,
            x + 0.8 * r
        ),
        _ => format!(
            "frame: {{ opening: {{ disc: {{ centre: [25 mm, 25 mm], radius: {r} mm }} }} }}, bodies: [{{ disc: {{ \
             centre: [{} mm, {y} mm], radius: 4.2 mm }} }}]",
            x + 6.0
        ),
    };
    let voltage = near(4000.0, 2500.0);
    let scene = scene(&format!("cells: {cells}, {parts}"), voltage, "{}");
    let centre = match kind % 5 {
        1 => [25.0, 25.0],
        _ => [near(22.0, 6.0), near(25.0, 8.0)],
    };
    let region = ellipse(centre, [near(9.0, 4.0), near(8.0, 4.0)], angle);
    let patterns = drawn(&scene, &region);
    (scene, patterns)
}

#[test]
fn stated_errors_cover_the_difference_from_the_shapes() {
    let mut stream = Stream::new(17, "geometry", 0);
    let (mut ratios, mut unknown) = (Vec::new(), 0);
    for kind in 0..40 {
        let (scene, [on_cells, drawing]) = random_device(kind, &mut stream);
        // Every other electrode is known on cells alone, so that the device with these cells is the truth.
        let drawing = if kind % 2 == 0 { drawing } else { on_cells.clone() };
        let parameters = accuracy(0.02);
        let errors = GeometryErrors::new(&scene, &parameters, true).unwrap().unwrap();
        let one = std::slice::from_ref(&on_cells);
        let mut found = parameters.build(&scene).unwrap().simulate(one).unwrap();
        errors.add_to(&mut found, one, std::slice::from_ref(&drawing)).unwrap();
        let Some(stated) = found[0].error_mm() else {
            unknown += 1;
            continue;
        };
        let fine = SolverParameters::new(Method::Newton, Mesh::biquadratic(3));
        let truth = fine.build(&scene.with_fitted_curves().unwrap()).unwrap();
        let truth = truth.simulate(std::slice::from_ref(&drawing)).unwrap().remove(0);
        let (field, truth) = (found[0].simulation.field.as_ref(), truth.simulation.field);
        let error = field.unwrap().max_difference(&truth.unwrap());
        ratios.push(error / stated);
    }
    let covered = ratios.iter().filter(|ratio| **ratio <= 1.0).count();
    assert!(
        unknown <= 2 && 20 * covered >= 19 * ratios.len(),
        "{unknown} {ratios:?}"
    );
    // No error is stated far too large.
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    assert!(mean > 0.5, "{mean}");
}

#[test]
fn cells_that_are_the_shape_have_no_error_of_geometry() {
    for parts in [
        "cells: 20",
        "cells: 20, frame: { opening: { rectangle: [[5 mm, 5 mm], [45 mm, 40 mm]] } }",
        "cells: 20, frame: { curves: fitted, opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }",
        "cells: 2, frame: { held: [{ mask: { columns: 2, rows: 2, runs: [3, 1] } }] }",
    ] {
        let scene = scene(parts, 3000.0, "{}");
        assert!(scene.with_fitted_curves().is_none(), "{parts}");
        assert!(GeometryErrors::new(&scene, &accuracy(0.01), false).unwrap().is_none());
        assert_eq!(geometry_revision(&scene), 0);
    }
    // A rectangle that ends within cells has one.
    let within = scene(
        "cells: 20, frame: { opening: { rectangle: [[6 mm, 5 mm], [45 mm, 40 mm]] } }",
        3000.0,
        "{}",
    );
    assert_eq!(geometry_revision(&within), 64);
}

#[test]
fn an_error_of_geometry_is_found_with_effects_of_cells_and_unknown_without_a_solution_on_the_shapes() {
    let disc = "cells: 25, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20.3 mm } } }";
    let region = ellipse([25.0; 2], [10.0; 2], 0.0);
    let estimate = |parts: &str, voltage: f64, effects: &str| {
        let scene = scene(parts, voltage, effects);
        let [on_cells, drawing] = drawn(&scene, &region);
        let errors = GeometryErrors::new(&scene, &accuracy(0.01), true).unwrap().unwrap();
        errors.estimates(&[on_cells], &[drawing]).unwrap()[0]
    };
    let plain = estimate(disc, 4000.0, "{}");
    assert!(plain.mm().unwrap() > 1e-3);
    assert_eq!(estimate(disc, 4000.0, "{ fringe_field: {} }"), plain);
    assert_eq!(estimate(disc, 9000.0, "{}"), GeometryError::Unknown);
    // A hub of a tenth of an element.
    let hub = "cells: 25, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20.3 mm } }, held: [{ disc: { \
               centre: [37 mm, 25 mm], radius: 0.1 mm } }] }";
    assert_eq!(estimate(hub, 4000.0, "{}"), GeometryError::Unknown);
}

#[test]
fn critical_voltages_on_cells_have_the_error_of_their_geometry() {
    let parts = "cells: 24, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 22 mm } } }";
    let limit = |scene: &Scene, pattern: &Pattern| {
        let search = CriticalSearch::new(scene, SolveOptions::on(Mesh::biquadratic(1))).unwrap();
        search.from(pattern, Mesh::bilinear(1), 6700.0)
    };
    let on_cells = scene(parts, 6000.0, "{}");
    let on_shapes = on_cells.with_fitted_curves().unwrap();
    let [pattern, _] = drawn(&on_cells, &ellipse([25.0; 2], [10.0; 2], 0.0));
    let (found, truth) = (limit(&on_cells, &pattern), limit(&on_shapes, &pattern));
    let mesh = CriticalVoltage::new(found.coarse, found.fine);
    let geometry = found.error.unwrap() - mesh.error.unwrap();
    let difference = (found.coarse.voltage - truth.coarse.voltage).abs();
    // A search ends within some volts of the limit.
    assert!((geometry - 1.25 * difference).abs() < 15.0, "{geometry} {difference}");
    assert!(difference > 15.0, "{difference}");
    let [low, high] = found.interval();
    assert!(low <= truth.voltage && truth.voltage <= high);
}

#[test]
fn critical_voltages_of_drawn_electrodes_on_cells_have_the_error_of_their_steps() {
    let scene = scene("cells: 25", 4000.0, "{}");
    let [on_cells, drawing] = drawn(&scene, &ellipse([25.0; 2], [10.0; 2], 0.0));
    let search = |scene: &Scene| CriticalSearch::new(scene, SolveOptions::on(Mesh::biquadratic(1))).unwrap();
    let (mesh, guess) = (Mesh::bilinear(1), 6700.0);
    let truth = search(&scene.with_electrodes_of(&drawing)).from(&drawing, mesh, guess);
    let of_cells = search(&scene).from(&on_cells, mesh, guess);
    let found = search(&scene).from_drawn([&on_cells, &drawing], mesh, guess);
    // The steps of the edge lower the limit by more than the error of the mesh.
    assert!(truth.voltage > of_cells.interval()[1], "{truth:?} {of_cells:?}");
    let [low, high] = found.interval();
    assert!(low <= truth.voltage && truth.voltage <= high, "{truth:?} {found:?}");
    assert_eq!(found.voltage, of_cells.voltage);
    assert!(found.error.unwrap() < 0.05 * found.voltage, "{found:?}");
}
