//! Names the build: the BLAKE3 of the sources, of the lock file and of the features that are on. It stands in the
//! provenance of every artifact, and a checkpoint is gone on with by the same build only.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(io::Error::other)?);
    let mut files = Vec::new();
    collect(&root.join("src"), &mut files)?;
    let lock = root.join("Cargo.lock");
    if lock.is_file() {
        files.push(lock);
    }
    // By their names with one separator, so that the order is that of no file system.
    let name = |path: &Path| {
        let parts = path.strip_prefix(&root).unwrap_or(path).iter();
        let parts: Vec<_> = parts.map(|part| part.to_string_lossy()).collect();
        parts.join("/")
    };
    let mut files: Vec<(String, PathBuf)> = files.into_iter().map(|path| (name(&path), path)).collect();
    files.sort();
    let mut hasher = blake3::Hasher::new();
    let mut add = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    for (name, path) in &files {
        add(name.as_bytes());
        add(&fs::read(path)?);
    }
    let features = env::vars().filter_map(|(name, _)| name.strip_prefix("CARGO_FEATURE_").map(str::to_owned));
    let mut features: Vec<String> = features.collect();
    features.sort();
    add(features.join(",").as_bytes());
    let build = hasher.finalize().to_hex();
    println!("cargo::rustc-env=DEAFLOW_BUILD={build}");
    for path in ["build.rs", "src", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={path}");
    }
    Ok(())
}

/// All files in a folder and those inside it. Hidden ones are left by editors and file systems.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        match entry.file_type()?.is_dir() {
            true => collect(&entry.path(), files)?,
            false => files.push(entry.path()),
        }
    }
    Ok(())
}
