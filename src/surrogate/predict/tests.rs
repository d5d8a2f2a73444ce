use std::collections::BTreeMap;

use super::*;
use crate::Corners;
use crate::header::Header;
use crate::testing::examples;
use crate::weights::to_bytes;
use crate::{TrainOptions, train};
use deaflow_dataset::Split;
use deaflow_field::CORNERS;
use deaflow_pattern::Raster;

fn model() -> Vec<u8> {
    let options = TrainOptions {
        epochs: 1,
        ..TrainOptions::default()
    };
    train(&examples(4, Split::Train), None, &options, &()).unwrap().weights
}

fn patterns(count: u64) -> Vec<Pattern> {
    examples(count, Split::Test).into_iter().map(|e| e.pattern).collect()
}

#[test]
fn predictions_do_not_depend_on_the_batch_or_on_threads() {
    let surrogate = Surrogate::load(&model()).unwrap();
    let patterns = patterns(40);
    let together = surrogate.predict(&patterns).unwrap();
    assert_eq!(together.len(), 40);
    for (pattern, field) in patterns.iter().zip(&together) {
        assert_eq!(&surrogate.predict(std::slice::from_ref(pattern)).unwrap()[0], field);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(
        pool.install(|| surrogate.predict(&patterns[3..]).unwrap()),
        together[3..]
    );
    assert!(surrogate.predict(&[]).unwrap().is_empty());
}

#[test]
fn the_frame_does_not_move() {
    let field = &Surrogate::load(&model()).unwrap().predict(&patterns(1)).unwrap()[0];
    for i in 0..CORNERS {
        for (x, y) in [(i, 0), (i, CORNERS - 1), (0, i), (CORNERS - 1, i)] {
            assert_eq!(field.at_corner(x, y), [0.0, 0.0]);
        }
    }
    assert!(field.max_magnitude() > 0.0);
}

#[test]
fn damaged_bytes_are_refused() {
    let bytes = model();
    for length in [0, 7, 8, 200, bytes.len() / 2, bytes.len() - 1] {
        assert!(
            matches!(Surrogate::load(&bytes[..length]), Err(LoadError::Damaged(_))),
            "{length}"
        );
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(Surrogate::load(&longer).is_err());
    // The last four bytes are a weight.
    let mut broken = bytes;
    let end = broken.len();
    broken[end - 4] ^= 1;
    let error = Surrogate::load(&broken).err().expect("refused").to_string();
    assert!(error.contains("digest"), "{error}");
}

#[test]
fn networks_of_another_shape_are_refused() {
    let (header, tensors) = from_bytes(&model()).unwrap();
    let refused = |header: &Header, tensors: &BTreeMap<String, Tensor>| {
        let error = Surrogate::load(&to_bytes(header, tensors, &BTreeMap::new()).unwrap())
            .err()
            .expect("refused");
        error.to_string()
    };
    let other = Header::new("resnet", Corners::inner(Raster::PAPER), &[1.0], 1.0);
    assert!(refused(&other, &tensors).contains("'resnet'"));
    let scale = Header::new("qin2024", Corners::inner(Raster::PAPER), &[1.0], 0.0);
    assert!(refused(&scale, &tensors).contains("scale"));

    let name = tensors.keys().next().unwrap().clone();
    let mut missing = tensors.clone();
    let tensor = missing.remove(&name).unwrap();
    assert!(refused(&header, &missing).contains(&format!("{name} is missing")));
    let mut extra = tensors.clone();
    extra.insert("surplus".into(), tensor.clone());
    assert!(refused(&header, &extra).contains("has no tensor surplus"));
    let mut infinite = tensors.clone();
    infinite.insert(name.clone(), (&tensor * f64::INFINITY).unwrap());
    assert!(refused(&header, &infinite).contains("NaN or infinity"));
    let mut reshaped = tensors.clone();
    reshaped.insert(name.clone(), tensor.flatten_all().unwrap().unsqueeze(0).unwrap());
    assert!(refused(&header, &reshaped).contains("shape"));
    let mut doubled = tensors;
    doubled.insert(name, tensor.to_dtype(DType::F64).unwrap());
    assert!(refused(&header, &doubled).contains("F64"));
}

#[test]
fn a_file_of_another_program_is_refused() {
    let tensor = Tensor::zeros((2, 2), DType::F32, &candle_core::Device::Cpu).unwrap();
    let bytes = safetensors::serialize([("a", &tensor)], None).unwrap();
    assert!(matches!(Surrogate::load(&bytes), Err(LoadError::Unsuitable(_))));
}
