//! The only crate that knows Python: arrays, paths and configs cross, nothing else.
