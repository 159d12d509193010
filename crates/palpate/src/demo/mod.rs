//! The paper's experiment (section 5): a scripted touch of a cylinder, with and without either interpolation.

pub mod cylinder;
pub mod experiment;
pub mod path;
