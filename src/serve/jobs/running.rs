//! Runs of this machine that write into a store, read from their log files: whatever started them, the page or a
//! terminal.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use deaflow_base::read_own;
use deaflow_store::{Store, log_name};

/// Log files that are read, the latest first. A run that is older than this many others is not seen.
const MAX_LOGS: usize = 200;

/// Bytes of a log file that are read.
const MAX_LOG_BYTES: u64 = 4 << 20;

/// Returns the running pipelines: process, start time, pipeline, and the stages that are being built.
#[must_use]
pub fn running_jobs(store: &Store) -> Vec<Value> {
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
    let writing = names.iter().take(MAX_LOGS).filter_map(|name| {
        let process = process_of(name)?;
        let path = folder.join(name);
        is_open(process, &path).then_some((process, path))
    });
    writing.filter_map(|(process, path)| document(process, &path)).collect()
}

/// Returns the process id in the name of a log file: `2026-01-01T00-00-01.000Z-1234.log`.
fn process_of(name: &str) -> Option<u32> {
    name.strip_suffix(".log")?.rsplit_once('-')?.1.parse().ok()
}

/// Whether a process has a file open. Process ids are reused, so the id alone is not enough.
fn is_open(process: u32, path: &Path) -> bool {
    let Ok(files) = fs::read_dir(format!("/proc/{process}/fd")) else {
        return false;
    };
    let target = |entry: fs::DirEntry| fs::read_link(entry.path()).ok();
    files.flatten().filter_map(target).any(|target: PathBuf| target == path)
}

fn document(process: u32, path: &Path) -> Option<Value> {
    let text = read_own(path, MAX_LOG_BYTES).ok()?;
    let text = String::from_utf8_lossy(&text);
    let mut job = parse_log(&text)?;
    job["pid"] = json!(process);
    job["set"] = json!(overrides(process));
    Some(job)
}

/// Reads the `--set` values of a run, by path, from its command line; `None` if that cannot be read.
fn overrides(process: u32) -> Option<BTreeMap<String, String>> {
    let line = read_own(Path::new(&format!("/proc/{process}/cmdline")), MAX_LOG_BYTES).ok()?;
    let words: Vec<String> = line
        .split(|byte| *byte == 0)
        .map(|word| String::from_utf8_lossy(word).into_owned())
        .collect();
    Some(parse_overrides(&words))
}

/// Finds the values in the arguments of a command: `--set PATH=VALUE` or `--set=PATH=VALUE`.
fn parse_overrides(words: &[String]) -> BTreeMap<String, String> {
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

/// Parses a log file. Lines are `TIME NAME: TEXT`; the first one names the pipeline. A stage runs from its line
/// with steps `to do` to its next line.
fn parse_log(text: &str) -> Option<Value> {
    let mut lines = text.lines().filter_map(|line| {
        let (time, rest) = line.split_once(' ')?;
        let (name, text) = rest.split_once(": ")?;
        Some((time, name, text))
    });
    let (began, pipeline, _) = lines.next()?;
    let mut open: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for (time, name, text) in lines {
        match text.contains(" to do (") {
            true => open.insert(name, (time, text)),
            false => open.remove(name),
        };
    }
    let stage = |(name, (since, text)): (&str, (&str, &str))| json!({ "name": name, "since": since, "told": text });
    let stages: Vec<Value> = open.into_iter().map(stage).collect();
    Some(json!({ "began": began, "pipeline": pipeline, "stages": stages }))
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
    fn the_running_stage_is_read_from_the_log() {
        let job = parse_log(LOG).unwrap();
        assert_eq!(
            (&job["pipeline"], &job["began"]),
            (&json!("small"), &json!("2026-01-01T00:00:01.000Z"))
        );
        assert_eq!(
            job["stages"],
            json!([{
                "name": "three",
                "since": "2026-01-01T00:00:04.000Z",
                "told": "9 epochs to do (input changed: two)",
            }])
        );
        assert!(parse_log("").is_none() && parse_log("nothing of ours\n").is_none());
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
        let found = parse_overrides(&words.map(str::to_owned));
        let expected = [("b", "c=d"), ("scene.drive.voltage", "4 kV")];
        assert_eq!(
            found,
            expected.map(|(path, value)| (path.to_owned(), value.to_owned())).into()
        );
        assert_eq!(overrides(std::process::id()), Some(BTreeMap::new()));
    }

    #[test]
    fn a_run_is_listed_while_it_writes_its_log() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert!(running_jobs(&store).is_empty());
        let name = log_name("2026-01-01T00:00:01.000Z", std::process::id());
        let mut log = store.create_log(&name).unwrap();
        log.write_all(LOG.as_bytes()).unwrap();
        let ended = log_name("2026-01-01T00:00:02.000Z", 1);
        store.create_log(&ended).unwrap().write_all(LOG.as_bytes()).unwrap();
        let found = running_jobs(&store);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (&found[0]["pid"], &found[0]["stages"][0]["name"]),
            (&json!(std::process::id()), &json!("three"))
        );
        drop(log);
        assert!(running_jobs(&store).is_empty());
    }
}
