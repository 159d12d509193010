//! Arrays that go to Python.

use numpy::ndarray::{ArrayView2, ShapeBuilder};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A copy of rows, (n, N).
pub fn matrix<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f64; N]],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}

/// A look, without a copy, at three numbers of every `stride`, from number `from` on, of a slice that belongs to `owner`: (n, 3), which
/// nobody can write to.
///
/// # Safety
/// `owner` keeps what the slice lies in alive, unmoved and unchanged as long as it lives.
#[allow(unsafe_code, reason = "numpy knows nothing of the slice's lifetime: the owner vouches for it")]
pub unsafe fn look<'py, T: Element>(
    slice: &[T],
    from: usize,
    stride: usize,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let py = owner.py();
    let shape = (slice.len() / stride, 3).strides((stride, 1));
    // Checked against the slice's end.
    let Ok(view) = ArrayView2::from_shape(shape, slice.get(from..).unwrap_or_default()) else {
        return Ok(PyArray2::zeros(py, [0, 3], false));
    };
    // SAFETY: the caller's promise; numpy is told below never to write.
    let array = unsafe { PyArray2::borrow_from_array(&view, owner) };
    let flags = PyDict::new(py);
    flags.set_item("write", false)?;
    array.call_method("setflags", (), Some(&flags))?;
    Ok(array)
}
