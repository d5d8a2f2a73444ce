//! A kind whose output changes must raise its recipe number, or old artifacts would pass for new ones.
//!
//! The fingerprint of a tiny artifact of every kind is pinned beside the recipe it was made with. Whole numbers and
//! texts are pinned exactly; real numbers by their mean and root mean square within 1e-6 (1e-3 after training), because
//! their last bits may differ between kinds of CPU. When an output changes on purpose: raise the recipe, run with
//! `DEAFLOW_GOLDEN=write`, and commit `golden.json`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use hdf5::types::{FixedUnicode, TypeDescriptor};
use serde_json::{Value, json};

use super::common::{Workspace, csv, files};

const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/golden.json");

/// Not symmetric, so that no two exchanges gain the same but for the last bit.
const CLIMBED: &str = "stages.climbed={ kind: design, method: adjoint, units: 20, starts: 1, seed: 1, \
    objective: { point: [30 mm, 22 mm], direction: 20 deg } }";

/// Stages that judge the model, and the families that they draw.
const JUDGED: [&str; 8] = [
    "stages.stripes={ kind: sample, family: stripes, count: 6, seed: 11 }",
    "stages.blobs={ kind: sample, family: blobs, count: 6, seed: 12 }",
    "stages.curves={ kind: sample, family: curves, count: 6, seed: 13 }",
    "stages.fresh={ kind: solve, needs: [stripes, blobs, curves], elements_per_cell: 1 }",
    "stages.more={ kind: sample, family: small-grid, count: 400, seed: 14 }",
    "stages.unseen={ kind: solve, needs: [more], elements_per_cell: 1 }",
    "stages.intervals={ kind: calibrate, needs: [surrogate, unseen], seed: 1 }",
    "stages.evaluated={ kind: evaluate, needs: [surrogate, fresh], estimates: [linear] }",
];

/// Stages that read files of a person.
const OWN: [&str; 7] = [
    "stages.own={ kind: patterns, files: [own.csv] }",
    "stages.beside={ kind: verify, needs: [climbed, own], elements_per_cell: 1 }",
    "stages.made={ kind: yield, needs: [climbed], samples: 8, wanted: 1 mm, seed: 1, \
     tolerances: { thickness: 3 %, mask: 0.3 mm } }",
    "stages.labels={ kind: import, files: [labels.csv] }",
    "stages.pulled={ kind: measure, files: [{ file: pulled.csv, test: uniaxial, sigma: 3 % }] }",
    "stages.fitted={ kind: fit, needs: [pulled], laws: [neo-hookean] }",
    "stages.compared={ kind: compare, needs: [pulled, fitted] }",
];

/// A pattern with a field, as an import stage reads it.
fn labels() -> String {
    let line = |x: u32, y: u32| {
        let [sx, sy] = [x, y].map(|place| f64::from(place * (50 - place)) / 625.0);
        let electrode = if x < 50 && y < 50 {
            u32::from(x < 25).to_string()
        } else {
            String::new()
        };
        format!("0,{x},{y},{},{},{electrode}\n", 0.5 * sx * sy, -0.25 * sx * sy)
    };
    let lines: String = (0..51).flat_map(|y| (0..51).map(move |x| line(x, y))).collect();
    format!("sample,x_mm,y_mm,ux_mm,uy_mm,electrode\n{lines}")
}

/// Every dataset of an artifact: exact for whole numbers and texts, (mean, rms) for reals.
fn fingerprint(path: &Path) -> BTreeMap<String, Value> {
    let file = hdf5::File::open(path).unwrap();
    let mut found = BTreeMap::new();
    let mut groups = vec![(String::new(), file.as_group().unwrap())];
    while let Some((prefix, group)) = groups.pop() {
        for dataset in group.datasets().unwrap() {
            // Scales name axes and hold nothing.
            if dataset.attr("CLASS").is_ok() {
                continue;
            }
            let name = dataset.name().trim_start_matches('/').to_owned();
            found.insert(name, describe(&dataset));
        }
        for child in group
            .groups()
            .unwrap()
            .into_iter()
            .filter(|g| g.name() != "/provenance")
        {
            groups.push((format!("{prefix}{}", child.name()), child));
        }
    }
    // The model's bytes are pinned through its metrics and predictions.
    found.remove("weights");
    found
}

fn describe(dataset: &hdf5::Dataset) -> Value {
    let shape = dataset.shape();
    match dataset.dtype().unwrap().to_descriptor().unwrap() {
        TypeDescriptor::Float(_) => {
            let values = dataset.read_raw::<f64>().unwrap();
            let n = values.len().max(1) as f64;
            let mean = values.iter().sum::<f64>() / n;
            let rms = (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
            json!({ "shape": shape, "mean": mean, "rms": rms })
        }
        // Digests of chunks and of models follow the last bits of their reals.
        _ if ["/parts", "/predictor_digests"].contains(&dataset.name().as_str()) => json!({ "shape": shape }),
        TypeDescriptor::FixedUnicode(_) => {
            let texts = dataset.read_raw::<FixedUnicode<64>>().unwrap();
            let all: Vec<&str> = texts.iter().map(|t| t.as_str()).collect();
            json!({ "shape": shape, "digest": blake3::hash(all.join("\n").as_bytes()).to_string()[..16] })
        }
        _ => {
            let values = dataset.read_raw::<u64>().unwrap();
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            json!({ "shape": shape, "digest": blake3::hash(&bytes).to_string()[..16] })
        }
    }
}

fn agree(golden: &Value, found: &Value, tolerance: f64) -> bool {
    let number = |v: &Value, key: &str| v[key].as_f64();
    match (number(golden, "rms"), number(found, "rms")) {
        (Some(a), Some(b)) => {
            let scale = tolerance * a.abs().max(1e-3);
            let means = number(golden, "mean").zip(number(found, "mean"));
            (a - b).abs() <= scale
                && means.is_some_and(|(x, y)| (x - y).abs() <= scale)
                && golden["shape"] == found["shape"]
        }
        _ => golden == found,
    }
}

#[test]
fn an_output_changes_only_with_its_recipe() {
    let workspace = Workspace::tiny();
    let audited = "stages.audited={ kind: audit, needs: [balanced], samples: 3 }";
    let mut arguments = vec!["run", "tiny.yaml", "--set", audited];
    JUDGED.iter().for_each(|stage| arguments.extend(["--set", stage]));
    arguments.extend(["--set", CLIMBED]);
    workspace.write("own.csv", &csv(|x, y| x < 20 && y > 3));
    workspace.write("labels.csv", &labels());
    workspace.write(
        "pulled.csv",
        "stretch,nominal_stress_kPa\n1.2,22.5\n1.5,47.8\n2,79.0\n2.5,105.9\n3,129.1\n",
    );
    OWN.iter().for_each(|stage| arguments.extend(["--set", stage]));
    let digests = workspace.stages(&arguments).digests();
    let artifacts = files(&workspace.path("store/objects"));
    let logged = workspace.run(&["log", "--json"]).json()["runs"][0]["results"].clone();
    let mut found = serde_json::Map::new();
    for stage in [
        "small",
        "large",
        "bezier",
        "solved",
        "balanced",
        "surrogate",
        "design",
        "verified",
        "reference",
        "accuracy",
        "audited",
        "stripes",
        "blobs",
        "curves",
        "intervals",
        "evaluated",
        "climbed",
        "own",
        "beside",
        "made",
        "labels",
        "pulled",
        "fitted",
        "compared",
    ] {
        let path = artifacts
            .iter()
            .find(|f| f.to_string_lossy().contains(&digests[stage]))
            .unwrap();
        let shown = workspace.run(&["show", stage, "--json"]).json();
        let recipe = shown["provenance"]["recipe"].clone();
        assert!(!recipe.is_null(), "{shown}");
        // Tables are refused by these words before anything is built.
        let known = deaflow::stage::result_words(shown["provenance"]["kind"].as_str().unwrap());
        let own = logged
            .as_object()
            .unwrap()
            .keys()
            .filter_map(|name| name.strip_prefix(stage)?.strip_prefix('.'));
        let own: BTreeSet<&str> = own.filter_map(|name| name.split('.').next()).collect();
        assert!(
            !own.is_empty() && own.iter().all(|word| known.contains(word)),
            "{stage}: {own:?} and {known:?}"
        );
        found.insert(
            stage.to_owned(),
            json!({ "recipe": recipe, "datasets": fingerprint(path) }),
        );
    }
    if std::env::var_os("DEAFLOW_GOLDEN").is_some_and(|v| v == "write") {
        std::fs::write(GOLDEN, serde_json::to_string_pretty(&found).unwrap() + "\n").unwrap();
    }
    let golden: Value = serde_json::from_str(&std::fs::read_to_string(GOLDEN).unwrap()).unwrap();
    for (stage, now) in &found {
        let pinned = &golden[stage];
        let learned = ["surrogate", "design", "verified", "intervals", "evaluated"].contains(&stage.as_str());
        let tolerance = if learned { 1e-3 } else { 1e-6 };
        let same_recipe = pinned["recipe"] == now["recipe"];
        assert!(
            same_recipe,
            "{stage}: recipe {} is not the pinned {}: pin the new output",
            now["recipe"], pinned["recipe"]
        );
        let (was, is) = (
            pinned["datasets"].as_object().unwrap(),
            now["datasets"].as_object().unwrap(),
        );
        assert_eq!(
            was.keys().collect::<Vec<_>>(),
            is.keys().collect::<Vec<_>>(),
            "{stage}: datasets"
        );
        for (name, value) in was {
            let same = agree(value, &is[name], tolerance);
            assert!(
                same,
                "{stage}: `{name}` changed without a new recipe: {value} became {}",
                is[name]
            );
        }
    }
}
