//! A deformation that is prescribed node by node: a body wrapped, sheared, or driven by a known solution.

use crate::equilibrium::{Failure, RESIDUAL_TOLERANCE};
use crate::load::Load;
use crate::model::{Fixed, Model};
use crate::path::Stop;
use glam::DVec3;
use std::sync::atomic::AtomicBool;

/// A deformed body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Deformed {
    /// Of each of the mesh's nodes, m.
    pub displacement_m: Vec<DVec3>,
    /// What each node must be held with, N; nothing to speak of where it is free. Zero at nodes of elements that
    /// supports hold altogether.
    pub force_n: Vec<DVec3>,
    /// Stored energy, J.
    pub energy_j: f64,
}

impl Model {
    /// Displaces nodes, each its own way (m) along the axes that it is held in, in a number of equal load steps.
    /// `None` if `cancelled` was set meanwhile.
    ///
    /// # Errors
    /// A load step finds no equilibrium; [`Stop::at_m`] is then the largest displacement it asked for.
    pub fn displace(
        &self,
        nodes: &[(Fixed, DVec3)],
        steps: u32,
        cancelled: &AtomicBool,
    ) -> Option<Result<Deformed, Stop>> {
        let (mut solver, unknowns) = self.holding(nodes.iter().map(|(fixed, _)| *fixed));
        let mut moved = vec![0.0; solver.held.len()];
        for (fixed, displacement) in nodes {
            for axis in (0..3).filter(|&axis| fixed.axes[axis]) {
                let unknown = self.unknown(fixed.node, axis);
                // What a support holds stays held.
                if !self.held[unknown] {
                    moved[unknown] = displacement[axis] / f64::from(steps.max(1));
                }
            }
        }
        let load = Load::Held(unknowns);
        for step in 1..=steps.max(1) {
            solver.predict_displacement(&load, &moved);
            match solver.equilibrate(&load, RESIDUAL_TOLERANCE, cancelled) {
                Ok(_) => {}
                Err(Failure::Cancelled) => return None,
                Err(failure) => {
                    let largest = nodes.iter().map(|(_, d)| d.length()).fold(0.0, f64::max);
                    let at_m = largest * f64::from(step) / f64::from(steps.max(1));
                    return Some(Err(Stop { at_m, why: failure.words().into() }));
                }
            }
        }
        let by_node = |values: &[f64]| {
            let of = |&rank: &u32| DVec3::from_slice(&values[3 * rank as usize..]);
            self.rank.iter().map(of).collect()
        };
        Some(Ok(Deformed {
            displacement_m: by_node(&solver.u),
            force_n: by_node(&solver.gradient),
            energy_j: self.energy(&solver.u),
        }))
    }
}
