//! No crate depends on what the layer diagram of `src/lib.rs` does not allow.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The diagram in the crate's documentation is the rule: it is parsed, not repeated here.
fn allowed() -> BTreeMap<String, BTreeSet<String>> {
    let text = std::fs::read_to_string(source_root().join("lib.rs")).unwrap();
    let mut crates = BTreeMap::new();
    for line in text.lines().filter_map(|line| line.strip_prefix("//! ")) {
        let Some((name, targets)) = line.split_once('→') else {
            continue;
        };
        if name.trim().chars().all(char::is_alphabetic) && line.starts_with(|c: char| c.is_lowercase()) {
            let targets = targets
                .split(',')
                .map(|t| t.trim().to_owned())
                .filter(|t| !t.is_empty());
            crates.insert(name.trim().to_owned(), targets.collect::<BTreeSet<_>>());
        }
    }
    let domain: BTreeSet<String> = [
        "accuracy",
        "scene",
        "pattern",
        "field",
        "sample",
        "element",
        "fem",
        "fit",
        "dataset",
        "surrogate",
        "design",
        "tolerance",
    ]
    .map(String::from)
    .into();
    let mut wide = crates.values_mut().filter_map(|targets| {
        let every = targets
            .iter()
            .find(|target| target.starts_with("every domain"))?
            .clone();
        targets.remove(&every).then_some(targets)
    });
    assert!(
        wide.by_ref().map(|targets| targets.extend(domain.clone())).count() >= 2,
        "stage and cli"
    );
    for targets in crates.values_mut() {
        targets.insert("base".to_owned());
    }
    crates
}

fn source_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The crates of the workspace that a manifest names, for the crate or for its tests; `deaflow` is that of all.
fn dependencies(name: &str) -> BTreeSet<String> {
    let manifest = std::fs::read_to_string(source_root().join(name).join("Cargo.toml")).unwrap();
    let names = manifest.lines().filter_map(|line| match line.strip_prefix("deaflow-") {
        None => line.starts_with("deaflow.").then_some("deaflow"),
        own => own,
    });
    names
        .map(|rest| rest.chars().take_while(|c| c.is_alphanumeric()).collect())
        .collect()
}

#[test]
fn every_crate_depends_only_on_what_the_diagram_allows() {
    let allowed = allowed();
    let folders = std::fs::read_dir(source_root()).unwrap().map(|entry| entry.unwrap());
    let crates: BTreeSet<String> = folders
        .filter(|entry| entry.file_type().unwrap().is_dir())
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect();
    assert_eq!(
        crates,
        allowed.keys().cloned().collect(),
        "src/ and the diagram of src/lib.rs"
    );
    let mut arrows = 0;
    let mut broken = Vec::new();
    for (name, targets) in &allowed {
        for dependency in dependencies(name) {
            arrows += 1;
            if !targets.contains(&dependency) {
                broken.push(format!("src/{name}/Cargo.toml: {name} → {dependency}"));
            }
        }
    }
    assert!(arrows > 60, "the manifests were not read: {arrows} dependencies");
    assert!(
        broken.is_empty(),
        "not in the layer diagram of src/lib.rs:\n{}",
        broken.join("\n")
    );
}

#[test]
fn bincode_and_hdf5_stay_where_they_belong() {
    let mut files = Vec::new();
    sources(&source_root(), &mut files);
    let users = |word: &str| -> Vec<String> {
        let uses = |f: &&PathBuf| {
            std::fs::read_to_string(f)
                .unwrap()
                .lines()
                .any(|l| !l.trim_start().starts_with("//") && l.contains(word))
        };
        files
            .iter()
            .filter(uses)
            .map(|f| f.strip_prefix(source_root()).unwrap().display().to_string())
            .collect()
    };
    assert_eq!(users("bincode::"), ["base/encoding.rs"]);
    let outside: Vec<String> = users("hdf5::")
        .into_iter()
        .filter(|f| !f.starts_with("store/") && !f.starts_with("hdf/"))
        .filter(|f| !["pattern/array.rs", "dataset/import/tests.rs"].contains(&f.as_str()))
        .collect();
    assert!(
        outside.is_empty(),
        "hdf5 is used outside of hdf, store and the tests of pattern and dataset formats: {outside:?}"
    );
}
