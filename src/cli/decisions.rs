//! Remembers which effects `effects: auto` has switched on for a scene, in the user's cache: deciding takes seconds, a
//! simulation of one pattern milliseconds.
//!
//! A decision depends on the scene and this program alone. A file that is missing, cannot be read or is damaged only
//! costs the time of deciding again.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use deaflow_base::{CpuLevel, Digest, build, is_interrupted, read_own, write_output};
use deaflow_fem::SetupError;
use deaflow_fem::screening::{remember, resolve};
use deaflow_scene::{Effects, Scene};

/// Number of decisions that are kept.
const KEPT: usize = 200;

/// Maximum length of a decision, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// Decides the effects of a scene with `effects: auto` or finds the earlier decision, for all simulations of this
/// process.
///
/// # Errors
/// When the effects of the scene cannot be simulated.
pub fn decide(scene: &Scene) -> Result<(), SetupError> {
    decide_in(folder().as_deref(), scene)
}

fn decide_in(folder: Option<&Path>, scene: &Scene) -> Result<(), SetupError> {
    if !scene.auto {
        return Ok(());
    }
    let scene = match scene.states.is_empty() {
        true => scene.clone(),
        false => scene.at_largest_voltages(),
    };
    let of = format!("effects of {} {:?}\n{}", build(), CpuLevel::detect(), scene.to_text());
    let file = folder.map(|folder| folder.join(Digest::of(of.as_bytes()).to_string()));
    if let Some(known) = file.as_deref().and_then(read) {
        remember(&scene, &known);
        return Ok(());
    }
    let decided = resolve(&scene)?;
    // An interrupted decision is none.
    if let Some(file) = file.filter(|_| !is_interrupted()) {
        write(&file, &decided.effects);
    }
    Ok(())
}

/// The folder `deaflow/effects` of the user's cache: in `$XDG_CACHE_HOME`, or in `~/.cache`.
fn folder() -> Option<PathBuf> {
    let set = |name: &str| {
        std::env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let cache = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")))?;
    Some(cache.join("deaflow/effects"))
}

/// The checksum of a decision, which belongs to its file.
fn checksum(file: &Path, text: &str) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    Digest::of(format!("{name}\n{text}").as_bytes()).to_string()
}

fn read(file: &Path) -> Option<Effects> {
    let bytes = read_own(file, MAX_BYTES).ok()?;
    let (sum, text) = std::str::from_utf8(&bytes).ok()?.split_once('\n')?;
    (sum == checksum(file, text)).then_some(())?;
    Effects::from_text(text).ok()
}

/// Writes a decision, and removes the oldest ones. Nothing is lost if that fails.
fn write(file: &Path, effects: &Effects) {
    let text = effects.to_text();
    let Some(folder) = file.parent().filter(|folder| fs::create_dir_all(folder).is_ok()) else {
        return;
    };
    let _ = write_output(file, format!("{}\n{text}", checksum(file, &text)).as_bytes());
    let files = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut decisions: Vec<(SystemTime, PathBuf)> = files
        .map(|entry| entry.path())
        .filter(|path| is_decision(path))
        .filter_map(|path| Some((fs::metadata(&path).ok()?.modified().ok()?, path)))
        .collect();
    decisions.sort_unstable_by(|a, b| b.cmp(a));
    for (_, old) in decisions.iter().skip(KEPT) {
        let _ = fs::remove_file(old);
    }
}

/// Whether a file has the name of a decision.
fn is_decision(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decision_is_found_again_unless_its_file_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        // At 1 V nothing is significant.
        let mut scene = Scene::vhb4910().at_voltage(1.0);
        scene.auto = true;
        decide_in(Some(folder.path()), &scene).unwrap();
        let files: Vec<PathBuf> = fs::read_dir(folder.path())
            .unwrap()
            .map(|file| file.unwrap().path())
            .collect();
        let [file] = &files[..] else {
            panic!("{files:?}");
        };
        assert_eq!(read(file), Some(resolve(&scene).unwrap().effects));
        let whole = fs::read(file).unwrap();
        let other = folder.path().join("0".repeat(64));
        fs::write(&other, &whole).unwrap();
        assert_eq!(read(&other), None, "of another scene");
        fs::write(file, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(read(file), None);
        // Without a folder that can be written, the decision is made all the same.
        scene = scene.at_voltage(2.0);
        scene.auto = true;
        decide_in(Some(&file.join("no folder")), &scene).unwrap();
        decide_in(None, &scene).unwrap();
    }

    #[test]
    fn the_oldest_decisions_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("mine.txt"), "kept").unwrap();
        for number in 0..KEPT + 3 {
            let file = folder.path().join(format!("{number:064x}"));
            write(&file, &Effects::default());
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), KEPT + 1);
    }
}
