//! Tests that cross crates: pipeline, properties, determinism, physics truths.
