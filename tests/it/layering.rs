//! Nobody imports what the layer diagram of `src/lib.rs` does not allow.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The diagram in the crate's documentation is the rule: it is parsed, not repeated here.
fn allowed() -> BTreeMap<String, BTreeSet<String>> {
    let text = std::fs::read_to_string(source_root().join("lib.rs")).unwrap();
    let mut rooms = BTreeMap::new();
    for line in text.lines().filter_map(|line| line.strip_prefix("//! ")) {
        let Some((room, targets)) = line.split_once('→') else {
            continue;
        };
        if room.trim().chars().all(char::is_alphabetic) && line.starts_with(|c: char| c.is_lowercase()) {
            let targets = targets
                .split(',')
                .map(|t| t.trim().to_owned())
                .filter(|t| !t.is_empty());
            rooms.insert(room.trim().to_owned(), targets.collect::<BTreeSet<_>>());
        }
    }
    let domain: BTreeSet<String> = [
        "accuracy",
        "scene",
        "pattern",
        "field",
        "sample",
        "fem",
        "dataset",
        "surrogate",
        "design",
    ]
    .map(String::from)
    .into();
    let mut wide = rooms
        .values_mut()
        .filter_map(|targets| targets.remove("every domain room").then_some(targets));
    assert!(
        wide.by_ref().map(|targets| targets.extend(domain.clone())).count() >= 2,
        "stage and cli"
    );
    for (room, targets) in &mut rooms {
        targets.insert("base".to_owned());
        targets.insert(room.clone());
    }
    rooms
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

/// Rooms that a source names as `crate::room`, also inside `use crate::{a::X, b::Y}`.
fn imports(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (at, _) in text.match_indices("crate::") {
        let rest = &text[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 0;
            let mut word = String::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => word.clear(),
                    ':' if depth == 0 && !word.trim().is_empty() => {
                        found.insert(word.trim().to_owned());
                    }
                    c if depth == 0 => word.push(c),
                    _ => {}
                }
            }
        } else {
            found.insert(rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
        }
    }
    found
}

#[test]
fn every_import_follows_the_diagram() {
    let allowed = allowed();
    let mut files = Vec::new();
    sources(&source_root(), &mut files);
    let mut arrows = 0;
    let mut broken = Vec::new();
    for file in files {
        let relative = file.strip_prefix(source_root()).unwrap();
        let Some(room) = relative.parent().and_then(|p| p.iter().next()).and_then(|r| r.to_str()) else {
            continue;
        };
        let Some(targets) = allowed.get(room) else {
            broken.push(format!("src/{room}/ is not in the diagram"));
            continue;
        };
        for import in imports(&std::fs::read_to_string(&file).unwrap()) {
            arrows += 1;
            if allowed.contains_key(&import) && !targets.contains(&import) {
                broken.push(format!("{}: {room} → {import}", relative.display()));
            }
        }
    }
    assert!(arrows > 20, "the sources were not found: {arrows} imports");
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
        .filter(|f| !["pattern/h5.rs", "dataset/import/tests.rs"].contains(&f.as_str()))
        .collect();
    assert!(
        outside.is_empty(),
        "hdf5 is used outside its room, the store and tests of the formats of patterns and imported data: {outside:?}"
    );
}

#[test]
fn the_parser_of_imports_sees_groups_and_paths() {
    let found = imports("use crate::{base::Digest, fem::{a, b}, store};\nlet x = crate::scene::Scene::load();");
    assert!(
        ["base", "fem", "scene"].iter().all(|room| found.contains(*room)),
        "{found:?}"
    );
}
