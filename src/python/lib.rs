//! The Python module `deaflow._deaflow`: what the package in `src/python/package` cannot do in Python. Each function
//! reads its arguments and calls what the command line calls.

mod arrays;
mod error;
mod gradient;
mod model;
mod scene;
mod work;

use std::ffi::OsString;

use pyo3::prelude::*;

/// Returns the words that start the command line: `python -m deaflow`.
fn own_command(py: Python<'_>) -> PyResult<Vec<OsString>> {
    py.import("deaflow.process")?.call_method0("own_command")?.extract()
}

/// The compiled part of deaflow.
#[pymodule]
mod _deaflow {
    use std::ffi::OsString;

    use pyo3::prelude::*;

    #[pymodule_export]
    use super::scene::Scene;

    #[pymodule_export]
    use super::arrays::Found;

    #[pymodule_export]
    use super::model::Model;

    #[pymodule_export]
    use super::error::Error;

    /// Prepares the module when it is imported.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        deaflow::cli::prepare(super::own_command(module.py())?, deaflow::BUILD);
        module.add("__version__", deaflow::base::VERSION)
    }

    /// Runs a command line and returns its exit code. It handles signals and starts threads, so it is for a process of
    /// its own.
    #[pyfunction]
    fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
        py.detach(|| deaflow::cli::main(arguments, deaflow::BUILD).code())
    }
}
