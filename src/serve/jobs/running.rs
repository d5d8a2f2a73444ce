//! Runs of this machine that are at work in a store, and what they have come to: told by the logs that they write, whoever began them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use deaflow_base::read_own;
use deaflow_store::{Store, log_name};

/// Logs that are looked at, the latest first: a run that goes on longer than so many others is not seen.
const MOST: usize = 200;

/// Bytes of a log that is read.
const LONGEST: u64 = 4 << 20;

/// The runs that are at work: their process, when they began, their pipeline, and the stages that they have begun and not ended.
#[must_use]
pub fn at_work(store: &Store) -> Vec<Value> {
    let folder = store.root().join(log_name("", 0));
    let Some(folder) = folder.parent().and_then(|folder| folder.canonicalize().ok()) else {
        return Vec::new();
    };
    let Ok(entries) = fs::read_dir(&folder) else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    let writing = names.iter().take(MOST).filter_map(|name| {
        let process = process_of(name)?;
        let path = folder.join(name);
        is_open(process, &path).then_some((process, path))
    });
    writing.filter_map(|(process, path)| document(process, &path)).collect()
}

/// The process that a log is named after: `2026-01-01T00-00-01.000Z-1234.log`.
fn process_of(name: &str) -> Option<u32> {
    name.strip_suffix(".log")?.rsplit_once('-')?.1.parse().ok()
}

/// Whether a process has a file open. Numbers of processes are given again; that one of that number writes this very file is no chance.
fn is_open(process: u32, path: &Path) -> bool {
    let Ok(files) = fs::read_dir(format!("/proc/{process}/fd")) else {
        return false;
    };
    let target = |entry: fs::DirEntry| fs::read_link(entry.path()).ok();
    files.flatten().filter_map(target).any(|target: PathBuf| target == path)
}

fn document(process: u32, path: &Path) -> Option<Value> {
    let text = read_own(path, LONGEST).ok()?;
    let text = String::from_utf8_lossy(&text);
    let told = told(&text)?;
    Some(
        json!({ "pid": process, "began": told.began, "pipeline": told.pipeline, "stages": told.stages, "set": values(process) }),
    )
}

/// The values that a run was given with `--set`, by their paths, as its command line says them; none where that cannot be read.
fn values(process: u32) -> Option<BTreeMap<String, String>> {
    let line = read_own(Path::new(&format!("/proc/{process}/cmdline")), LONGEST).ok()?;
    let words: Vec<String> = line
        .split(|byte| *byte == 0)
        .map(|word| String::from_utf8_lossy(word).into_owned())
        .collect();
    Some(set_by(&words))
}

/// The values among the words of a command: `--set PATH=VALUE` or `--set=PATH=VALUE`.
fn set_by(words: &[String]) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for (at, word) in words.iter().enumerate() {
        let value = match word.strip_prefix("--set") {
            Some("") => words.get(at + 1).map(String::as_str),
            Some(rest) => rest.strip_prefix('='),
            None => None,
        };
        if let Some((path, value)) = value.and_then(|value| value.split_once('=')) {
            found.insert(path.trim().to_owned(), value.trim().to_owned());
        }
    }
    found
}

/// What a log says of a run that goes on.
struct Told<'a> {
    began: &'a str,
    pipeline: &'a str,
    stages: Vec<Value>,
}

/// Lines are `TIME NAME: WHAT`; the first is that of the pipeline, and a stage is under way while it has steps `to do`.
fn told(text: &str) -> Option<Told<'_>> {
    let mut lines = text.lines().filter_map(|line| {
        let (time, rest) = line.split_once(' ')?;
        let (name, what) = rest.split_once(": ")?;
        Some((time, name, what))
    });
    let (began, pipeline, _) = lines.next()?;
    let mut open: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for (time, name, what) in lines {
        match what.contains(" to do (") {
            true => open.insert(name, (time, what)),
            false => open.remove(name),
        };
    }
    let stage = |(name, (since, what)): (&str, (&str, &str))| json!({ "name": name, "since": since, "told": what });
    Some(Told {
        began,
        pipeline,
        stages: open.into_iter().map(stage).collect(),
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    const LOG: &str = "2026-01-01T00:00:01.000Z small: 3 stages, 2 to build: about 1 s\n\
                       2026-01-01T00:00:01.000Z one: reused db381a76e35f\n\
                       2026-01-01T00:00:02.000Z two: 4 patterns to do (no record), about 1 s\n\
                       2026-01-01T00:00:03.000Z two: built bb959c34c1d9 in 1 s\n\
                       2026-01-01T00:00:04.000Z three: 9 epochs to do (input changed: two)\n";

    #[test]
    fn the_stage_that_is_under_way_is_told() {
        let told = told(LOG).unwrap();
        assert_eq!((told.pipeline, told.began), ("small", "2026-01-01T00:00:01.000Z"));
        assert_eq!(
            told.stages,
            [
                json!({ "name": "three", "since": "2026-01-01T00:00:04.000Z", "told": "9 epochs to do (input changed: two)" })
            ]
        );
        assert!(super::told("").is_none() && super::told("nothing of ours\n").is_none());
    }

    #[test]
    fn the_values_of_a_run_are_those_of_its_command() {
        let words = [
            "deaflow",
            "run",
            "a.yaml",
            "--set",
            "scene.drive.voltage=4 kV",
            "--set=b=c=d",
            "--settle=x=y",
        ];
        let found = set_by(&words.map(str::to_owned));
        let expected = [("b", "c=d"), ("scene.drive.voltage", "4 kV")];
        assert_eq!(
            found,
            expected.map(|(path, value)| (path.to_owned(), value.to_owned())).into()
        );
        assert_eq!(values(std::process::id()), Some(BTreeMap::new()));
    }

    #[test]
    fn a_run_is_at_work_while_it_writes_its_log() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert!(at_work(&store).is_empty());
        let name = log_name("2026-01-01T00:00:01.000Z", std::process::id());
        let mut log = store.create_log(&name).unwrap();
        log.write_all(LOG.as_bytes()).unwrap();
        let ended = log_name("2026-01-01T00:00:02.000Z", 1);
        store.create_log(&ended).unwrap().write_all(LOG.as_bytes()).unwrap();
        let found = at_work(&store);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (&found[0]["pid"], &found[0]["stages"][0]["name"]),
            (&json!(std::process::id()), &json!("three"))
        );
        drop(log);
        assert!(at_work(&store).is_empty());
    }
}
