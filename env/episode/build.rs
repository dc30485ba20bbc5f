//! The hash of the sources on which a simulation without a hand depends, for the cache of arrangements: another build may simulate differently.

use std::fs;
use std::path::{Path, PathBuf};

/// Crates whose code moves objects, and the versions of all others.
const SOURCES: [&str; 6] = ["../mesh/src", "../hand/src", "../solver/src", "../sim/src", "src", "../../Cargo.lock"];

fn main() -> std::io::Result<()> {
    let mut hasher = blake3::Hasher::new();
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
        let mut files = Vec::new();
        collect(Path::new(source), &mut files)?;
        files.sort();
        for file in files {
            let bytes = fs::read(&file)?;
            hasher.update(file.to_string_lossy().as_bytes()).update(&(bytes.len() as u64).to_le_bytes()).update(&bytes);
        }
    }
    for setting in ["TARGET", "OPT_LEVEL", "CARGO_CFG_TARGET_FEATURE"] {
        hasher.update(format!("{setting}={:?}", std::env::var(setting)).as_bytes());
    }
    println!("cargo::rustc-env=GRASPBOX_SIMULATION={}", hasher.finalize().to_hex());
    Ok(())
}

/// Appends `path`, or all files below it.
fn collect(path: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !path.is_dir() {
        files.push(path.to_path_buf());
        return Ok(());
    }
    fs::read_dir(path)?.try_for_each(|entry| collect(&entry?.path(), files))
}
