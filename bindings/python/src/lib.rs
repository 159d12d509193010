//! The extension module `palpate._palpate`: bodies, contacts, rollouts, certificates and sessions for Python, with numpy's arrays.
//!
//! Thin: what it does is the crates' beneath. Everything that can take long gives the interpreter's lock away and hears Ctrl-C; every
//! error is one of `errors`; what threads may share is immutable, or behind a lock that says so instead of waiting.

mod arrays;
mod body;
mod certify;
mod contact;
mod errors;
#[cfg(feature = "build")]
mod from_spec;
mod interrupt;
mod make;
mod path;
mod progress;
mod rollout;
mod session;

use palpate::engine::Flags;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// What can be written as JSON, as Python's own values.
fn python_of<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(|e| errors::argument(e.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

#[pymodule]
fn _palpate(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    errors::register(module)?;
    module.add_class::<body::Body>()?;
    module.add_class::<contact::Contact>()?;
    module.add_class::<contact::Output>()?;
    module.add_class::<contact::Snapshot>()?;
    module.add_class::<progress::Progress>()?;
    module.add_class::<path::Path>()?;
    module.add_class::<session::Session>()?;
    module.add_class::<session::Outcome>()?;
    module.add_function(wrap_pyfunction!(contact::flag_names, module)?)?;
    module.add_function(wrap_pyfunction!(make::read_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(rollout::rollout_many, module)?)?;
    let flags = PyDict::new(py);
    for (name, flag) in Flags::NAMED {
        flags.set_item(name, flag.bits())?;
    }
    module.add("FLAGS", flags)?;
    module.add("TRACE_DTYPE", rollout::dtype(py)?)?;
    module.add("RECORD_DTYPE", session::dtype(py)?)?;
    module.add("VERSION", palpate::VERSION)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))
}
