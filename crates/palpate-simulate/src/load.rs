//! What acts on the body: a patch that is moved, or a rigid tool that pushes.

use crate::contact::ToolContact;
use crate::model::Model;
use crate::stiffness::Stiffness;
use glam::DVec3;

/// What acts on the body.
pub(crate) enum Load<'t> {
    /// Some unknowns are held where they are put.
    Held(Vec<usize>),
    /// A rigid tool.
    Tool(Box<ToolContact<'t>>),
}

impl Load<'_> {
    pub fn energy(&self, model: &Model, u: &[f64]) -> f64 {
        match self {
            Load::Held(_) => 0.0,
            Load::Tool(contact) => contact.energy(model, u),
        }
    }

    /// Adds gradient and stiffness, and returns the energy.
    pub fn assemble(&self, model: &Model, u: &[f64], gradient: &mut [f64], stiffness: &mut Stiffness) -> f64 {
        match self {
            Load::Held(_) => 0.0,
            Load::Tool(contact) => contact.assemble(model, u, gradient, stiffness),
        }
    }

    /// Force on the body, N.
    pub fn force(&self, model: &Model, u: &[f64], gradient: &[f64]) -> DVec3 {
        match self {
            Load::Held(unknowns) => {
                let mut force = [0.0; 3];
                for &unknown in unknowns {
                    force[unknown % 3] += gradient[unknown];
                }
                DVec3::from_array(force)
            }
            Load::Tool(contact) => contact.resultant(model, u).force_n,
        }
    }

    /// Size of that force, N; not less than a tenth of the held unknowns' forces in the 2-norm, which may balance.
    pub fn reaction(&self, model: &Model, u: &[f64], gradient: &[f64]) -> f64 {
        let single = match self {
            Load::Held(unknowns) => unknowns.iter().map(|&n| gradient[n] * gradient[n]).sum::<f64>().sqrt(),
            Load::Tool(_) => 0.0,
        };
        self.force(model, u, gradient).length().max(0.1 * single)
    }
}
