//! Errors of the command line as exceptions of Python.

use deaflow::cli::CliError;
use pyo3::prelude::*;
use pyo3::{create_exception, exceptions::PyException};

create_exception!(
    deaflow,
    Error,
    PyException,
    "An error of deaflow, with the text that the command prints.

Attributes
----------
code : int
    The exit code of the command for such an error; 2 if the input is invalid.
message : str
    What is wrong, on one line.
help : str or None
    What is allowed, or what to do.
file, line, column : str, int and int, or None
    Where it is, if that is known."
);

/// Turns an error into an exception.
pub fn raised(py: Python<'_>, error: &CliError) -> PyErr {
    let raised = Error::new_err(error.to_text());
    let about = error.to_json();
    let value = raised.value(py);
    let filled = (|| {
        value.setattr("code", about["exit_code"].as_u64())?;
        for name in ["message", "help", "file"] {
            value.setattr(name, about[name].as_str())?;
        }
        for name in ["line", "column"] {
            value.setattr(name, about[name].as_u64())?;
        }
        Ok(())
    })();
    match filled {
        Ok(()) => raised,
        Err(refused) => refused,
    }
}
