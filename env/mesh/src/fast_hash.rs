//! Maps and sets with a cheap hash: vertex numbers and grid cells are small keys, and meshes have millions of them.
//!
//! The library's hash withstands keys that are chosen to collide; this one need not, since a file that makes it slow harms only its owner
//! and is bounded by the limits on faces. Nothing may depend on the order of iteration.

use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasherDefault, Hasher};

/// A map with [`FastHasher`].
pub(crate) type FastMap<K, V> = HashMap<K, V, BuildHasherDefault<FastHasher>>;
/// A set with [`FastHasher`].
pub(crate) type FastSet<K> = HashSet<K, BuildHasherDefault<FastHasher>>;

/// Multiplies and rotates, word by word.
#[derive(Default)]
pub(crate) struct FastHasher(u64);

impl Hasher for FastHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.chunks(8).for_each(|chunk| {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        });
    }

    fn write_u32(&mut self, word: u32) {
        self.write_u64(u64::from(word));
    }

    fn write_u64(&mut self, word: u64) {
        // Odd, from the golden ratio; the rotation brings the mixed upper bits down.
        self.0 = (self.0 ^ word).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
    }

    fn write_usize(&mut self, word: usize) {
        self.write_u64(word as u64);
    }
}

/// An empty map with room for `count` entries.
pub(crate) fn map_for<K, V>(count: usize) -> FastMap<K, V> {
    FastMap::with_capacity_and_hasher(count, BuildHasherDefault::default())
}

/// An empty set with room for `count` entries.
pub(crate) fn set_for<K>(count: usize) -> FastSet<K> {
    FastSet::with_capacity_and_hasher(count, BuildHasherDefault::default())
}
