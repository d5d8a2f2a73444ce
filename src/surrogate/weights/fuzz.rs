//! Models and checkpoints with random changes, with and without a matching digest, are read or refused without a panic.

use std::collections::HashMap;

use bolero::check;
use safetensors::SafeTensors;

use super::tests::model;
use super::{KEY, LoadError, digest, from_bytes, opening};
use crate::checkpoint::Checkpoint;
use crate::{EpochReport, Surrogate};

/// Random changes of an input, shared by all fuzz targets.
#[path = "../../../tests/it/fuzz/mutate.rs"]
mod mutate;
use mutate::Seeds;

const JSON: &[&str] = &[
    "{",
    "}",
    "[",
    "]",
    "\"",
    ":",
    ",",
    "null",
    "1e400",
    "-1",
    "18446744073709551616",
    "F64",
    "BOOL",
    "\\u0000",
    "U8",
    "shape",
    "data_offsets",
    "dtype",
    "__metadata__",
    "\"scale_mm\":",
    "\"trained\":",
];

fn check_message(error: &LoadError) {
    let message = error.to_string();
    assert!(!message.is_empty() && message.len() < 20_000, "{message:?}");
}

#[test]
fn models() {
    let seeds = Seeds::new("model", [model()], JSON);
    seeds.inputs[..seeds.valid]
        .iter()
        .for_each(|sound| drop(from_bytes(sound).unwrap()));
    check!().with_iterations(600).for_each(|entropy: &[u8]| {
        let bytes = seeds.mutated(entropy);
        let _ = from_bytes(&bytes).inspect_err(check_message);
        let _ = Surrogate::load(&bytes).inspect_err(check_message);
    });
}

/// A model with a changed header and a digest that matches it.
fn forged(bytes: &[u8], change: impl FnOnce(&str) -> String) -> Vec<u8> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).unwrap();
    let text = metadata
        .metadata()
        .as_ref()
        .and_then(|map| map.get(KEY))
        .unwrap()
        .clone();
    let tensors = SafeTensors::deserialize(bytes).unwrap();
    let body = change(&text[opening(&digest("", Vec::new())).len()..]);
    let text = format!("{}{body}", opening(&digest(&body, tensors.tensors())));
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    safetensors::serialize(tensors.tensors(), Some(metadata)).unwrap()
}

#[test]
fn forged_models() {
    let sound = model();
    let mut body = String::new();
    let same = forged(&sound, |own| {
        body = own.to_owned();
        own.to_owned()
    });
    assert_eq!(same, sound);
    let seeds = Seeds::new("model-header", [body.into_bytes()], JSON);
    check!().with_iterations(600).for_each(|entropy: &[u8]| {
        let bytes = forged(&sound, |_| {
            String::from_utf8_lossy(&seeds.mutated(entropy)).into_owned()
        });
        let _ = from_bytes(&bytes).inspect_err(check_message);
        let _ = Surrogate::load(&bytes).inspect_err(check_message);
    });
}

#[test]
fn checkpoints() {
    let report = EpochReport {
        epoch: 1,
        train_loss: 0.3,
        validation_loss: 0.5,
        validation_rmse_mm: 0.05,
        selection_rmse_mm: 0.05,
        learning_rate: 1e-3,
    };
    let mut sound = Checkpoint {
        history: Default::default(),
        weights: vec![vec![1.0, 2.0], vec![]],
        best: vec![vec![3.0]],
        means: vec![],
    };
    sound.history.curves.push(report);
    sound.history.best = Some((0.05, 1));
    let seeds = Seeds::new("checkpoint", [sound.to_bytes().unwrap()], &[]);
    check!().with_iterations(1000).for_each(|entropy: &[u8]| {
        if let Some(read) = Checkpoint::from_bytes(&seeds.mutated(entropy)) {
            let written = read.to_bytes().unwrap();
            let again = Checkpoint::from_bytes(&written).unwrap();
            assert_eq!(again.to_bytes().unwrap(), written);
        }
    });
}
