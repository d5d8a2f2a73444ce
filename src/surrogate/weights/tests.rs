use candle_core::DType;
use proptest::prelude::*;

use super::*;
use crate::Corners;
use crate::EpochReport;
use crate::metrics::Metrics;
use deaflow_pattern::Raster;

fn tensors() -> BTreeMap<String, Tensor> {
    let tensor = |values: &[f32]| Tensor::new(values, &Device::Cpu).unwrap();
    BTreeMap::from([
        ("b".to_owned(), tensor(&[1.0, -2.0])),
        ("a.weights".to_owned(), tensor(&[0.5, 0.25, 3.0])),
    ])
}

fn constants() -> BTreeMap<String, Tensor> {
    BTreeMap::from([("c".to_owned(), Tensor::new(&[7.0_f32], &Device::Cpu).unwrap())])
}

fn record() -> TrainingRecord {
    let families = BTreeMap::from([("bezier".to_owned(), 3), ("small-grid".to_owned(), 4)]);
    TrainingRecord {
        examples: BTreeMap::from([("train".to_owned(), families)]),
        epochs: 4,
        best_epoch: 3,
        validation_rmse_mm: Some(0.0625),
        seed: 5,
        inputs: vec!["ab".repeat(32)],
    }
}

pub(super) fn model() -> Vec<u8> {
    annotated(
        &to_bytes(
            &Header::new("qin2024", Corners::inner(Raster::PAPER), &[1.0], 0.375),
            &tensors(),
            &constants(),
        )
        .unwrap(),
        "{ drive: { voltage: 5.25 kV } }",
        record(),
    )
    .unwrap()
}

/// A safetensors file without tensors and with this text in its metadata.
fn with_text(text: &str) -> Vec<u8> {
    let metadata = HashMap::from([(KEY.to_owned(), text.to_owned())]);
    let none: BTreeMap<String, Tensor> = BTreeMap::new();
    safetensors::serialize(&none, Some(metadata)).unwrap()
}

fn with_header(length: u64, rest: &[u8]) -> Vec<u8> {
    [&length.to_le_bytes()[..], rest].concat()
}

#[test]
fn a_model_has_a_header_and_equal_models_are_equal_bytes() {
    let bytes = model();
    assert_eq!(bytes, model());
    let (header, read) = from_bytes(&bytes).unwrap();
    assert_eq!((header.network.as_str(), header.scale_mm), ("qin2024", 0.375));
    assert_eq!(header.scene.as_deref(), Some("{ drive: { voltage: 5.25 kV } }"));
    assert_eq!(header.training, Some(record()));
    assert!(header.tensors.trained.iter().eq(["a.weights", "b"]) && header.tensors.constant.iter().eq(["c"]));
    assert_eq!(read["b"].to_vec1::<f32>().unwrap(), [1.0, -2.0]);
    let shown: Value = serde_json::to_value(&header).unwrap();
    assert_eq!(shown["input"]["shape"], serde_json::json!(["n", 50, 50]));
    assert_eq!(shown["output"]["shape"], serde_json::json!(["n", 51, 51, 2]));
    assert_eq!(shown["output"]["unit"], "mm");
}

#[test]
fn every_flipped_bit_is_detected() {
    let bytes = model();
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << bit;
            assert!(from_bytes(&flipped).is_err(), "byte {at}, bit {bit}");
        }
    }
    for length in 0..bytes.len() {
        assert!(from_bytes(&bytes[..length]).is_err(), "cut to {length}");
    }
}

#[test]
fn exchanged_tensors_are_detected() {
    // `b` and a second tensor of its shape exchange names: the table changes, the bytes after it do not.
    let mut two = tensors();
    two.insert("d".to_owned(), Tensor::new(&[4.0_f32, 5.0], &Device::Cpu).unwrap());
    let bytes = to_bytes(
        &Header::new("qin2024", Corners::inner(Raster::PAPER), &[1.0], 0.375),
        &two,
        &constants(),
    )
    .unwrap();
    assert!(from_bytes(&bytes).is_ok());
    let length = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let table = std::str::from_utf8(&bytes[8..length]).unwrap();
    let exchanged = table
        .replace("\"b\":{", "\"x\":{")
        .replace("\"d\":{", "\"b\":{")
        .replace("\"x\":{", "\"d\":{");
    assert!(exchanged != table && exchanged.len() == table.len());
    let forged = [&bytes[..8], exchanged.as_bytes(), &bytes[length..]].concat();
    assert!(SafeTensors::deserialize(&forged).is_ok(), "a sound file of safetensors");
    let error = from_bytes(&forged).unwrap_err().to_string();
    assert!(error.contains("digest does not match"), "{error}");
}

#[test]
fn hostile_headers_are_refused_before_they_cost_anything() {
    let tensor =
        |shape: &str, end: u64| format!("{{\"a\":{{\"dtype\":\"F32\",\"shape\":{shape},\"data_offsets\":[0,{end}]}}}}");
    let deep = format!("{{\"__metadata__\":{{\"{KEY}\":\"{}\"}}}}", "[".repeat(100_000));
    let headers = [
        (u64::MAX, "{}".to_owned()),
        (u64::MAX - 7, "{}".to_owned()),
        (1 << 40, "{}".to_owned()),
        (99_000_000, "{}".to_owned()),
        (0, String::new()),
        (2, "{}".to_owned()),
        (deep.len() as u64, deep.clone()),
        (0, tensor("[18446744073709551615,18446744073709551615]", 4)),
        (0, tensor("[1099511627776]", 4_398_046_511_104)),
        (0, tensor("[1]", u64::MAX)),
    ];
    for (length, text) in headers {
        let length = if length == 0 { text.len() as u64 } else { length };
        assert!(from_bytes(&with_header(length, text.as_bytes())).is_err(), "{length}");
    }
}

#[test]
fn unknown_versions_and_headers_are_refused_with_the_reason() {
    let refused = |text: &str| from_bytes(&with_text(text)).unwrap_err().to_string();
    assert!(refused("{\"format_version\":1}").contains("version 1, but this deaflow reads version 2"));
    assert!(refused("{\"network\":\"qin2024\",\"scale_mm\":1.0}").contains("older deaflow"));
    assert!(refused("{\"format_version\":2}").contains("digest"));
    assert!(refused("[1").contains("damaged"));
    // A complete header with an unknown key.
    let (header, _) = from_bytes(&model()).unwrap();
    let text = serde_json::to_string(&header).unwrap();
    let body = text[1..].replacen("\"network\"", "\"rotated\":true,\"network\"", 1);
    let with_digest = |body: &str| format!("{}{body}", opening(&digest(body, Vec::new())));
    assert!(refused(&with_digest(&body)).contains("unknown field `rotated`"));
    let upside_down = text[1..].replacen("origin lower left", "origin upper left", 1);
    assert!(refused(&with_digest(&upside_down)).contains("unknown form of patterns"));
    assert!(refused(&with_digest(&text[1..])).contains("a.weights is missing"));
}

#[test]
fn tensors_have_one_role_each_and_are_named() {
    let both = to_bytes(
        &Header::new("qin2024", Corners::inner(Raster::PAPER), &[1.0], 1.0),
        &tensors(),
        &tensors(),
    );
    assert!(both.unwrap_err().to_string().contains("both trained and constant"));
    let (header, _) = from_bytes(&model()).unwrap();
    let mut more: BTreeMap<_, _> = tensors().into_iter().chain(constants()).collect();
    more.insert("e".to_owned(), Tensor::zeros(1, DType::F32, &Device::Cpu).unwrap());
    assert!(
        check_names(&header, &more)
            .unwrap_err()
            .to_string()
            .contains("tensor e is not in its header")
    );
}

#[test]
fn the_record_counts_examples_by_family() {
    let metrics = |family: &str, split, samples| Metrics {
        family: family.to_owned(),
        split,
        samples,
        rmse_mm: 0.0,
        r2: 1.0,
        max_error_mm: 0.0,
    };
    let report = |epoch, rmse| EpochReport {
        epoch,
        train_loss: 0.0,
        validation_loss: 0.0,
        validation_rmse_mm: rmse,
        selection_rmse_mm: rmse,
        learning_rate: 1e-3,
    };
    let mut trained = Trained {
        weights: Vec::new(),
        curves: vec![report(1, 0.5), report(2, 0.25), report(3, 0.75)],
        metrics: vec![metrics("all", Split::Train, 5), metrics("bezier", Split::Train, 5)],
        best_epoch: 2,
        ending: crate::Ending::Complete,
    };
    let record = TrainingRecord::of(&trained, 7, Vec::new());
    assert_eq!((record.epochs, record.best_epoch, record.seed), (3, 2, 7));
    assert_eq!(record.validation_rmse_mm, None, "there are no validation examples");
    assert_eq!(record.examples["train"], BTreeMap::from([("bezier".to_owned(), 5)]));
    trained.metrics.push(metrics("bezier", Split::Validation, 1));
    assert_eq!(
        TrainingRecord::of(&trained, 7, Vec::new()).validation_rmse_mm,
        Some(0.25)
    );
}

proptest! {
    #[test]
    fn bytes_of_any_kind_never_panic(noise in proptest::collection::vec(any::<u8>(), 0..200), length in any::<u64>()) {
        prop_assert!(from_bytes(&noise).is_err());
        prop_assert!(from_bytes(&with_header(length, &noise)).is_err());
        prop_assert!(from_bytes(&with_header(noise.len() as u64, &noise)).is_err());
    }

    #[test]
    fn several_changes_are_detected(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20)
    ) {
        let (bytes, mut changed) = (model(), model());
        for (at, value) in changes {
            let at = at.index(changed.len());
            changed[at] = value;
        }
        // White space of the JSON may differ.
        let same = |(header, tensors): (Header, BTreeMap<String, Tensor>)| {
            let (was, all) = from_bytes(&bytes).unwrap();
            header == was && all.len() == tensors.len()
        };
        prop_assert!(changed == bytes || from_bytes(&changed).map_or(true, same));
    }
}
