//! A body as patches are taken from it: in memory, or in its file.

use crate::body::{Body, SlipRule};
use crate::error::{BodyError, Result};
use crate::model::ContactModel;
use crate::patch::Patch;
use crate::potential::Potential;
use crate::response::Response;
use crate::tensor::Tensor;
use glam::DVec3;
use std::fmt::Debug;

/// What a session needs of a body: [`Patch`]es, and a few questions while it is prepared.
///
/// A [`Body`] has all in memory and never fails; a [`StoredBody`](crate::StoredBody) reads its file.
pub trait BodySource: Debug + Send + Sync {
    /// Knots, tool and slip rule, as a contact asks for them; whether there is a surface, too, is not promised.
    fn model_header(&self) -> &ContactModel;

    /// How many elements the surface has.
    fn element_count(&self) -> usize;

    /// An empty patch, to be filled by [`BodySource::take`].
    fn patch(&self) -> Patch {
        Patch::empty(self.model_header().model_header())
    }

    /// Whether contacts with this slip rule can step on its patches.
    ///
    /// # Errors
    /// Patches lack what the rule reads.
    fn serves(&self, rule: SlipRule) -> Result<()>;

    /// Fills a patch of this source as [`Patch::take`] does, with the same bits. Calls `beat` now and then, at least whenever
    /// something has been read, for who watches over it.
    ///
    /// # Errors
    /// The file can't be read, or is another by now. The patch must be thrown away then.
    fn take(&self, patch: &mut Patch, centre: [f64; 3], count: usize, beat: &dyn Fn()) -> Result<()>;

    /// Where the surface is.
    fn extent(&self) -> Extent;

    /// Where a point tool on the way `from` → `to` first touches, m.
    ///
    /// # Errors
    /// As [`BodySource::take`].
    fn first_touch(&self, from: DVec3, to: DVec3) -> Result<Option<DVec3>>;

    /// The surface point that is nearest to `p`, m, and the unit vector into the body there.
    ///
    /// # Errors
    /// As [`BodySource::take`]; there is no surface.
    fn nearest(&self, p: DVec3) -> Result<[DVec3; 2]>;

    /// Shows every test point's response; none with a coupled law.
    ///
    /// # Errors
    /// As [`BodySource::take`].
    fn each_response(&self, visit: &mut dyn FnMut(&Response)) -> Result<()>;

    /// Shows every test point's potential; none with a decoupled law.
    ///
    /// # Errors
    /// As [`BodySource::take`].
    fn each_potential(&self, visit: &mut dyn FnMut(&Potential)) -> Result<()>;

    /// Shows the lateral tensor of every node, and its inward normal; none where the lateral response is alike in all
    /// directions.
    ///
    /// # Errors
    /// As [`BodySource::take`].
    fn each_tensor(&self, visit: &mut dyn FnMut(&Tensor, DVec3)) -> Result<()>;

    /// Lets the system page out what patches are taken from, whatever was locked before.
    ///
    /// # Errors
    /// The operating system refuses.
    fn unlock_memory(&self) -> std::io::Result<()>;
}

/// Where a surface's nodes are, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Their mean.
    pub middle: DVec3,
    /// How far from there the farthest is.
    pub radius_m: f64,
    /// The one with the greatest z.
    pub highest: DVec3,
}

impl Extent {
    pub(crate) fn of(positions: impl Iterator<Item = DVec3> + Clone) -> Self {
        let middle = positions.clone().sum::<DVec3>() / positions.clone().count().max(1) as f64;
        let radius_m = positions.clone().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let highest = positions.max_by(|a, b| a.z.total_cmp(&b.z)).unwrap_or_default();
        Extent { middle, radius_m, highest }
    }
}

/// No surface is near.
pub(crate) fn no_surface() -> BodyError {
    BodyError::invalid("surface", "there is none", "make the body again")
}

impl BodySource for Body {
    fn model_header(&self) -> &ContactModel {
        self
    }

    fn element_count(&self) -> usize {
        self.elements.len()
    }

    fn serves(&self, rule: SlipRule) -> Result<()> {
        self.prepare(rule);
        Ok(())
    }

    fn take(&self, patch: &mut Patch, centre: [f64; 3], count: usize, beat: &dyn Fn()) -> Result<()> {
        beat();
        patch.take(self, centre, count);
        Ok(())
    }

    fn extent(&self) -> Extent {
        Extent::of(self.nodes.iter().map(|n| n.position))
    }

    fn first_touch(&self, from: DVec3, to: DVec3) -> Result<Option<DVec3>> {
        Ok(ContactModel::first_touch(self, from, to, 0.0).map(|touch| self.point(touch.at)))
    }

    fn nearest(&self, p: DVec3) -> Result<[DVec3; 2]> {
        let at = ContactModel::nearest(self, p, f64::INFINITY).ok_or_else(no_surface)?.at;
        Ok([self.point(at), self.inward(at)])
    }

    fn each_response(&self, visit: &mut dyn FnMut(&Response)) -> Result<()> {
        self.curves.iter().for_each(visit);
        Ok(())
    }

    fn each_potential(&self, visit: &mut dyn FnMut(&Potential)) -> Result<()> {
        self.potential_list().iter().for_each(visit);
        Ok(())
    }

    fn each_tensor(&self, visit: &mut dyn FnMut(&Tensor, DVec3)) -> Result<()> {
        self.lateral_tensors.iter().zip(&self.nodes).for_each(|(a, node)| visit(a, node.inward));
        Ok(())
    }

    fn unlock_memory(&self) -> std::io::Result<()> {
        ContactModel::unlock_memory(self)
    }
}
