//! The only crate that knows Python: arrays, paths and configs cross, nothing else.
//!
//! | module | what it does |
//! |---|---|
//! | [`errors`] | one error type, and the Python exception of each error |
//! | [`gil`] | releases the GIL, keeps panics inside, listens for Ctrl-C, owns the thread pools |
//!
//! `python/graspbox/_core.pyi` is this module's contract.

pub mod errors;
pub mod gil;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::gil::{num_threads, spin};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
