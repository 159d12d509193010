//! Rigid tools, by their signed distance.
