use candle_core::Var;

use super::*;
use crate::Constants;
use crate::encode::{patterns_to_tensor, tensor_to_fields};
use crate::parameters::{RandomWeights, StoredWeights};
use crate::testing::response_at;
use deaflow_base::Stream;
use deaflow_fem::LinearResponse;
use deaflow_field::{Field, Mesh};
use deaflow_pattern::{Part, Pattern, Raster, Symmetry};
use deaflow_scene::Scene;

/// The constants of the default scene at a voltage, on the coarsest mesh.
fn constants(volts: f64) -> (LinearResponse, Constants) {
    let response = response_at(volts);
    let constants = Constants::new(&response, &Scene::vhb4910()).unwrap();
    (response, constants)
}

/// Relative loads of two electrode groups. Most devices here have the first only.
const LOADS: [f64; 2] = [1.0, 0.25];

/// A network with random laws, and its weights.
fn network(constants: &Constants) -> (Physics, Vec<(String, Var)>) {
    network_on(Raster::PAPER, constants)
}

fn network_on(raster: Raster, constants: &Constants) -> (Physics, Vec<(String, Var)>) {
    let weights = RandomWeights::new(&constants.tensors, 3);
    let network = Physics::new(&weights.builder(), raster).unwrap();
    let vars = weights.variables();
    for (name, var) in &vars {
        let mut stream = Stream::new(8, name, 0);
        let values: Vec<f32> = (0..var.elem_count()).map(|_| 0.2 * stream.normal() as f32).collect();
        var.set(&Tensor::from_vec(values, var.shape(), &Device::Cpu).unwrap())
            .unwrap();
    }
    (network, vars)
}

fn patterns() -> Vec<Pattern> {
    let mut stream = Stream::new(5, "physics test", 0);
    let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.4)).collect();
    vec![
        Pattern::from_fn(Raster::PAPER, |x, y| x + 2 * y < 60),
        Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x]),
        Pattern::from_fn(Raster::PAPER, |x, y| (x / 7 + y / 11) % 3 == 0),
    ]
}

/// The network with the same weights as it is loaded from a model file.
fn fixed(constants: &Constants, vars: &[(String, Var)]) -> Physics {
    fixed_on(Raster::PAPER, constants, vars)
}

fn fixed_on(raster: Raster, constants: &Constants, vars: &[(String, Var)]) -> Physics {
    let weights = vars.iter().map(|(name, var)| (name.clone(), var.as_tensor().clone()));
    let tensors = weights.chain(constants.tensors.clone()).collect();
    Physics::new(&StoredWeights::new(&tensors).builder(), raster).unwrap()
}

fn predict(network: &Physics, patterns: &[Pattern]) -> Vec<Field> {
    let raster = patterns[0].raster();
    let input = patterns_to_tensor(raster, &LOADS, patterns.iter()).unwrap();
    let displacement = network.forward(&input).unwrap();
    tensor_to_fields(crate::Corners::inner(raster), &displacement, network.unit_mm().unwrap())
        .unwrap()
        .unwrap()
}

#[test]
fn predictions_equal_the_output_in_training() {
    let constants = constants(5250.0).1;
    let (network, vars) = network(&constants);
    let input = patterns_to_tensor(Raster::PAPER, &LOADS, patterns().iter()).unwrap();
    let seen = network.forward(&input).unwrap();
    let predicted = fixed(&constants, &vars).forward(&input).unwrap();
    let flat = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let largest = flat(&seen).into_iter().fold(0.0, |most: f32, u| most.max(u.abs()));
    let differences = flat(&(seen - predicted).unwrap()).into_iter();
    assert!(differences.fold(0.0, |most: f32, d| most.max(d.abs())) < 1e-5 * largest);
}

#[test]
fn predictions_do_not_depend_on_the_batch() {
    let constants = constants(5250.0).1;
    let network = fixed(&constants, &network(&constants).1);
    let many: Vec<Pattern> = patterns().into_iter().cycle().take(13).collect();
    let together = predict(&network, &many);
    for (pattern, field) in many.iter().zip(&together) {
        assert_eq!(&predict(&network, std::slice::from_ref(pattern))[0], field);
    }
}

#[test]
fn an_untrained_network_is_the_linear_response() {
    let (response, constants) = constants(5250.0);
    let network = Physics::new(&RandomWeights::new(&constants.tensors, 3).builder(), Raster::PAPER).unwrap();
    let patterns = patterns();
    let expected = response.predict(&patterns, 0);
    for (found, expected) in predict(&network, &patterns).iter().zip(expected) {
        let expected = expected.unwrap();
        // The estimate solves its linear system to 3e-3 only.
        let size = expected.rms_difference(&Field::zero(Raster::PAPER));
        let error = expected.rms_difference(found);
        assert!(error < 3e-3 * size, "{error} of {size}");
    }
}

#[test]
fn a_rotated_or_mirrored_pattern_has_the_rotated_or_mirrored_displacement() {
    let constants = constants(5250.0).1;
    let network = fixed(&constants, &network(&constants).1);
    for pattern in patterns() {
        let images: Vec<Pattern> = Symmetry::ALL.iter().map(|&g| pattern.transformed(g)).collect();
        let found = predict(&network, &images);
        let untrained = found[0].max_magnitude();
        for (g, field) in Symmetry::ALL.into_iter().zip(&found) {
            let error = field.max_difference(&found[0].transformed(g));
            assert!(error < 2e-5 * untrained, "{g:?}: {error} of {untrained}");
        }
    }
}

#[test]
fn the_unit_of_strain_is_the_root_mean_square_of_random_cells() {
    let (response, constants) = constants(5250.0);
    let mut stream = Stream::new(6, "physics test", 1);
    let random = |_| {
        let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
        Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x])
    };
    let patterns: Vec<Pattern> = (0..12).map(random).collect();
    let mut squares = Vec::new();
    for field in response.predict(&patterns, 0).into_iter().flatten() {
        for (x, y) in (0..2500).map(|i| (i % 50, i / 50)) {
            let corner = |i: usize, j: usize, k: usize| field.at_corner(x + i, y + j)[k];
            // Cells are 1 mm wide: derivatives at the middle.
            for k in 0..2 {
                squares.push((0.5 * (corner(1, 0, k) + corner(1, 1, k) - corner(0, 0, k) - corner(0, 1, k))).powi(2));
                squares.push((0.5 * (corner(0, 1, k) + corner(1, 1, k) - corner(0, 0, k) - corner(1, 0, k))).powi(2));
            }
        }
    }
    let found = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let unit = f64::from(constants.tensors["response.strain"].to_vec1::<f32>().unwrap()[0]);
    assert!((found / unit - 1.0).abs() < 0.02, "{found} {unit}");
}

#[test]
fn a_network_has_few_weights_and_a_large_constant_matrix() {
    let constants = constants(5250.0).1;
    let learned = network(&constants).1;
    assert_eq!(learned.iter().map(|(_, var)| var.elem_count()).sum::<usize>(), 364);
    // Four parities, 25² cells of a quadrant, two components of the displacement of 25² corners.
    let blocks = constants.tensors.iter().filter(|(name, _)| *name != "response.strain");
    assert_eq!(
        blocks.map(|(_, block)| block.elem_count()).sum::<usize>(),
        4 * 625 * 1250
    );
}

#[test]
fn corrections_scale_with_the_square_of_the_load() {
    // With the same, dimensionless weights a quarter of the load gives a quarter of the linear response and a
    // sixteenth of the correction. The next order is a quarter smaller again.
    let correction = |volts: f64| {
        let constants = constants(volts).1;
        let network = network(&constants).0;
        let linear = Physics::new(&RandomWeights::new(&constants.tensors, 3).builder(), Raster::PAPER).unwrap();
        let [found, linear] = [&network, &linear].map(|network| predict(network, &patterns()[..1]).remove(0));
        (
            found.rms_difference(&linear),
            linear.rms_difference(&Field::zero(Raster::PAPER)),
        )
    };
    let [(weak, weak_linear), (strong, strong_linear)] = [200.0, 400.0].map(correction);
    assert!(
        (strong_linear / weak_linear - 4.0).abs() < 0.01,
        "{strong_linear} {weak_linear}"
    );
    assert!((strong / weak - 16.0).abs() < 0.5, "{strong} {weak}");
}

#[test]
fn invalid_constants_are_refused() {
    let (_, constants) = constants(5250.0);
    for strain in [[0.0f32, 50.0], [0.04, -1.0], [f32::NAN, 50.0]] {
        let mut tensors = constants.tensors.clone();
        tensors.insert("response.strain".into(), Tensor::new(&strain, &Device::Cpu).unwrap());
        assert!(Physics::new(&RandomWeights::new(&tensors, 3).builder(), Raster::PAPER).is_err());
    }
    let mut tensors = constants.tensors;
    tensors.remove("response.odd");
    let error = Physics::new(&RandomWeights::new(&tensors, 3).builder(), Raster::PAPER)
        .err()
        .unwrap();
    assert!(error.to_string().contains("response.odd is missing"), "{error}");
}

/// Devices: rectangles with even and odd sides, frames and bodies with and without symmetries.
const DEVICES: [&str; 8] = [
    "size: [50 mm, 30 mm], prestretch: [3, 3.2], cells: [20, 12]",
    "size: [20 mm, 12 mm], prestretch: 3, cells: [10, 6]",
    "side: 20 mm, prestretch: [3, 2.8], cells: [9, 7]",
    "side: 20 mm, prestretch: 3, cells: 14, frame: { opening: { disc: { centre: [10 mm, 10 mm], radius: 9 mm } } }",
    "side: 20 mm, prestretch: 3, cells: 11, frame: { held: [{ rectangle: [[2 mm, 4 mm], [6 mm, 8 mm]] }] }",
    "side: 20 mm, prestretch: 3, cells: 10, bodies: [{ rectangle: [[8 mm, 8 mm], [12 mm, 12 mm]] }]",
    "size: [20 mm, 24 mm], prestretch: [3, 3.1], cells: [10, 12], bodies: [{ polygon: [[6 mm, 6 mm], [14 mm, 6 mm], \
     [8 mm, 14 mm]], spring: 3 N/m }]",
    "side: 20 mm, prestretch: 3, cells: 10, bodies: [{ rectangle: [[8 mm, 8 mm], [12 mm, 12 mm]], \
     load: [1 mN, 0.3 mN] }]",
];

fn device(geometry: &str) -> (Scene, LinearResponse, Constants) {
    let text = format!(
        "geometry: {{ thickness: 1 mm, {geometry} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ voltages: [4 kV, 2 kV] }}\neffects: {{}}\n"
    );
    let scene = Scene::from_text(&text).unwrap();
    assert_eq!(scene.group_loads(), LOADS);
    let response = LinearResponse::new(&scene, Mesh::bilinear(1)).unwrap();
    let constants = Constants::new(&response, &scene).unwrap();
    (scene, response, constants)
}

/// Random patterns of two groups on the membrane of a device.
fn patterns_of(scene: &Scene) -> Vec<Pattern> {
    let (raster, parts) = (scene.membrane().raster, scene.parts());
    let mut stream = Stream::new(5, "device patterns", 0);
    (0..3)
        .map(|_| {
            let groups: Vec<u8> = (0..raster.cells())
                .map(|_| u8::from(stream.chance(0.4)) * (1 + stream.index(2) as u8))
                .collect();
            let is_free = |x, y| parts.as_ref().is_none_or(|parts| parts.at(x, y) == Part::Membrane);
            let group = |x, y| groups[y * raster.columns() + x] * u8::from(is_free(x, y));
            Pattern::from_groups(raster, group)
        })
        .collect()
}

#[test]
fn an_untrained_network_is_the_linear_response_of_any_device() {
    for geometry in DEVICES {
        let (scene, response, constants) = device(geometry);
        let raster = scene.membrane().raster;
        let network = Physics::new(&RandomWeights::new(&constants.tensors, 3).builder(), raster).unwrap();
        let patterns = patterns_of(&scene);
        let expected = response.predict(&patterns, 0);
        for (found, expected) in predict(&network, &patterns).iter().zip(expected) {
            let expected = expected.unwrap();
            let size = expected.rms_difference(&Field::zero(raster));
            let error = expected.rms_difference(found);
            assert!(error < 4e-3 * size, "{geometry}: {error} of {size}");
        }
    }
}

#[test]
fn a_correction_has_the_symmetries_of_any_device_and_holds_its_frame() {
    for geometry in DEVICES {
        let (scene, _, constants) = device(geometry);
        let raster = scene.membrane().raster;
        let (network, vars) = network_on(raster, &constants);
        let fixed = fixed_on(raster, &constants, &vars);
        let linear = Physics::new(&RandomWeights::new(&constants.tensors, 3).builder(), raster).unwrap();
        for pattern in patterns_of(&scene) {
            let images: Vec<Pattern> = scene.symmetries().iter().map(|g| pattern.transformed(g)).collect();
            let found = predict(&fixed, &images);
            let size = found[0].max_magnitude();
            let corrected = found[0].max_difference(&predict(&linear, std::slice::from_ref(&pattern))[0]);
            assert!(corrected > 1e-3 * size, "{geometry}: {corrected} of {size}");
            for (g, field) in scene.symmetries().iter().zip(&found) {
                let error = field.max_difference(&found[0].transformed(g));
                assert!(error < 5e-5 * size, "{geometry} {g:?}: {error} of {size}");
            }
            let trained = &predict(&network, std::slice::from_ref(&pattern))[0];
            let error = trained.max_difference(&found[0]);
            assert!(error < 5e-5 * size, "{geometry}: {error} of {size}");
            assert_supported(&scene, &found[0]);
        }
    }
}

/// Asserts that the frame does not move and bodies move rigidly.
fn assert_supported(scene: &Scene, field: &Field) {
    let Some(parts) = scene.parts() else { return };
    let ([columns, rows], [width, height]) = (scene.membrane().raster.corner_sides(), scene.membrane().cell_mm());
    let size = field.max_magnitude();
    let mut of_body: Vec<([f64; 2], [f64; 2])> = Vec::new();
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        let around = parts.around(x, y);
        let u = field.at_corner(x, y);
        if around.contains(&Part::Frame) {
            assert!(u[0].hypot(u[1]) < 1e-4 * size, "{x} {y}: {u:?} of {size}");
        } else if around.contains(&Part::Body(0)) {
            of_body.push(([x as f64 * width, y as f64 * height], u));
        }
    }
    // To first order the distances between corners of a body do not change.
    for (at, moved) in &of_body {
        for (other, also) in &of_body {
            let along = [other[0] - at[0], other[1] - at[1]];
            let stretch = along[0] * (also[0] - moved[0]) + along[1] * (also[1] - moved[1]);
            let length = along[0].hypot(along[1]).max(width);
            assert!(
                stretch.abs() < 2e-4 * size * length,
                "{at:?} {other:?}: {stretch} of {size}"
            );
        }
    }
}

#[test]
fn the_frozen_output_has_the_same_bits_for_any_batch() {
    let constants = constants(5250.0).1;
    let network = network(&constants).0;
    let cells = |index: u32| -> Vec<f32> {
        let is_active = |at: u32| (at * at + 7 * index + at * index) % 11 < 5;
        let cell = |at: u32| if is_active(at) { 0.5 } else { -0.5 };
        (0..2500).map(cell).collect()
    };
    let tensor = |of: std::ops::Range<u32>| {
        let count = of.len();
        let values: Vec<f32> = of.flat_map(cells).collect();
        Tensor::from_vec(values, (count, 50, 50, 1), &Device::Cpu).unwrap()
    };
    let frozen = |of: std::ops::Range<u32>| network.frozen(&tensor(of)).unwrap().unwrap();
    let all = frozen(0..64);
    for part in [0..1, 0..2, 20..22, 61..64, 10..40] {
        let each = all.len() / 64;
        let of_all = &all[part.start as usize * each..part.end as usize * each];
        assert_eq!(frozen(part.clone()), of_all, "{part:?}");
        let [alone, with_frozen] = [None, Some(of_all)].map(|known| {
            let output = network.forward_for_training(&tensor(part.clone()), known).unwrap();
            output.displacement.flatten_all().unwrap().to_vec1::<f32>().unwrap()
        });
        assert_eq!(alone, with_frozen);
    }
}
