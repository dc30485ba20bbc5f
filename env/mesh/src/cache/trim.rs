//! A folder of cache entries that grows no larger than a bound.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

/// Suffixes of all kinds of entries.
const SUFFIXES: [&str; 4] = ["parts", "levels", "object", "scene"];
/// Writes of this process into a folder between two checks of its size.
const EVERY: u32 = 64;

/// Writes into each folder.
static WRITES: Mutex<BTreeMap<std::path::PathBuf, u32>> = Mutex::new(BTreeMap::new());

/// Counts a write into `folder`; removes its oldest entries from time to time, so that no more than `most` bytes remain.
pub(super) fn after_write(folder: &Path, most: u64) {
    let mut writes = WRITES.lock().unwrap_or_else(PoisonError::into_inner);
    let count = writes.entry(folder.to_path_buf()).or_default();
    let due = count.is_multiple_of(EVERY);
    *count = count.wrapping_add(1);
    drop(writes);
    if due {
        trim(folder, most);
    }
}

/// Removes the entries that were written first until those that stay have at most `most` bytes. Other processes may
/// remove or read entries meanwhile: a missing entry is made again.
pub(super) fn trim(folder: &Path, most: u64) {
    let Ok(files) = std::fs::read_dir(folder) else { return };
    let mut entries: Vec<_> = files
        .flatten()
        .map(|file| file.path())
        .filter(|path| path.extension().is_some_and(|found| SUFFIXES.iter().any(|suffix| found == *suffix)))
        .filter_map(|path| std::fs::symlink_metadata(&path).ok().map(|found| (path, found)))
        .filter(|(_, found)| found.is_file())
        .map(|(path, found)| (found.modified().unwrap_or(SystemTime::UNIX_EPOCH), path, found.len()))
        .collect();
    entries.sort();
    let mut total: u64 = entries.iter().map(|entry| entry.2).sum();
    let mut removed = 0;
    for (_, path, size) in entries {
        if total <= most {
            break;
        }
        removed += usize::from(std::fs::remove_file(path).is_ok());
        total -= size;
    }
    if removed > 0 {
        tracing::info!("removed the {removed} oldest entries of the cache {}: it is at its bound", folder.display());
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_oldest_entries_go_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        for (age, name) in [(3, "a.parts"), (1, "b.levels"), (2, "c.parts"), (9, "other.txt")] {
            let path = folder.path().join(name);
            std::fs::write(&path, [0; 100]).unwrap();
            let file = std::fs::File::options().write(true).open(&path).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(1000 * age)).unwrap();
        }
        trim(folder.path(), 200);
        let mut left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["b.levels", "c.parts", "other.txt"]);
        after_write(folder.path(), 100);
        assert!(!folder.path().join("c.parts").exists(), "the first write looks at the size");
    }
}
