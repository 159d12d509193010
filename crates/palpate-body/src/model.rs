//! What a step reads of a body: geometry, frames, responses, and the tree that finds a touch.
//!
//! A [`Body`](crate::Body) holds one of the whole surface, a [`Patch`](crate::Patch) one of the elements around a place;
//! a step sees no difference but the patch's boundary.

use crate::body::{MAX_FAN, NO_NODE, Node, SlipRule, Tool, mixed_inward};
use crate::curve::Curve;
use crate::gradient::Gradients;
use crate::potential::Potentials;
use crate::response::Responses;
use crate::search::{Search, point};
use crate::surface::{Element, FENCE};
use crate::tensor::{IDENTITY, Tensor};
use glam::DVec3;
use std::sync::OnceLock;

/// What a step reads of a body, or of a part of it. See the [module](self).
#[derive(Debug, Clone)]
pub struct ContactModel {
    pub(crate) nodes: Vec<Node>,
    pub(crate) elements: Vec<Element>,
    pub(crate) search: Search,
    pub(crate) responses: Responses,
    /// Of the coupled law; none where it is the decoupled one.
    pub(crate) potentials: Potentials,
    pub(crate) creased: bool,
    /// (nodes), or empty where all are the identity.
    pub(crate) lateral_tensors: Vec<Tensor>,
    pub(crate) tool: Tool,
    pub(crate) slip: SlipRule,
    /// Whether slip is kept from giving out energy.
    pub(crate) tank: bool,
    /// Whether contacts are two contact points side by side.
    pub(crate) partial_slip: bool,
    pub(crate) identity: u64,
    /// What follows from the rest, once it is prepared.
    pub(crate) gradients: OnceLock<Gradients>,
}

/// By what they were made of, whether they are prepared or not.
impl PartialEq for ContactModel {
    fn eq(&self, other: &Self) -> bool {
        self.nodes == other.nodes
            && self.elements == other.elements
            && self.search == other.search
            && self.responses == other.responses
            && self.potentials == other.potentials
            && self.creased == other.creased
            && self.lateral_tensors == other.lateral_tensors
            && self.tool == other.tool
            && self.slip == other.slip
            && self.tank == other.tank
            && self.partial_slip == other.partial_slip
    }
}

impl ContactModel {
    /// Knots, tool and slip rule alone, with nothing to touch: what a [`Patch`](crate::Patch) fills.
    pub(crate) fn model_header(&self) -> Self {
        let law = (self.responses.without_points(), self.potentials.without_points());
        Self::without_surface(
            law,
            self.creased,
            self.tool,
            (self.slip, self.tank, self.partial_slip),
            self.identity,
        )
    }

    /// With the knots of a law, and nothing to touch.
    pub(crate) fn without_surface(
        (responses, potentials): (Responses, Potentials),
        creased: bool,
        tool: Tool,
        (slip, tank, partial_slip): (SlipRule, bool, bool),
        identity: u64,
    ) -> Self {
        ContactModel {
            nodes: Vec::new(),
            elements: Vec::new(),
            search: Search::default(),
            responses,
            potentials,
            creased,
            lateral_tensors: Vec::new(),
            tool,
            slip,
            tank,
            partial_slip,
            identity,
            gradients: OnceLock::new(),
        }
    }

    /// What tells this body from another. A body, its patches, and the same in its file, whatever slip rule they name, have
    /// the same; two bodies that differ in their size, their tool, or in one of the places or test points that are sampled
    /// (16 of each) do not.
    ///
    /// # Real-time
    /// O(1).
    #[inline]
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// The nodal gradients along the surface, which the slip rule `consistent` reads; `None` where they were not prepared
    /// them ([`Body::prepare`](crate::Body::prepare)).
    ///
    /// # Real-time
    /// O(1), no allocation, never panics or waits.
    #[inline]
    pub fn gradients(&self) -> Option<&Gradients> {
        self.gradients.get()
    }

    /// Nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Elements.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// Test points' potentials: none where the law is the decoupled one.
    #[inline]
    pub fn potentials(&self) -> &Potentials {
        &self.potentials
    }

    /// Whether the law is a coupled potential.
    #[inline]
    pub fn is_coupled(&self) -> bool {
        self.potentials.range_m() > 0.0
    }

    /// Mixed responses; the knots alone with a coupled law.
    pub fn responses(&self) -> &Responses {
        &self.responses
    }

    /// The lateral tensor of each node; `None` where the lateral response is alike in all directions.
    pub fn lateral_tensors(&self) -> Option<&[Tensor]> {
        (!self.is_isotropic()).then_some(&self.lateral_tensors)
    }

    /// Whether the lateral response is alike in all directions, at every node.
    #[inline]
    pub fn is_isotropic(&self) -> bool {
        self.lateral_tensors.is_empty()
    }

    /// Whether creases doubled any node.
    #[inline]
    pub fn has_creases(&self) -> bool {
        self.creased
    }

    /// The tool the responses hold for.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// Whether the body asks for the tank, with which slip gives out no more energy than it has dissipated before, whatever
    /// the rule (LAW 3).
    #[inline]
    pub fn has_tank(&self) -> bool {
        self.tank
    }

    /// Whether the body asks for partial slip: two contact points side by side, one with more, one with less friction (MODEL 4).
    #[inline]
    pub fn has_partial_slip(&self) -> bool {
        self.partial_slip
    }

    /// The slip rule the body asks for.
    pub fn slip(&self) -> SlipRule {
        self.slip
    }

    /// The nodes of an element.
    ///
    /// # Real-time
    /// O(1), never panics: an element that does not exist gives node 0 thrice.
    #[inline]
    pub fn element_nodes(&self, element: u32) -> [&Node; 3] {
        let nodes = self.elements.get(element as usize).map_or([0; 3], |e| e.nodes);
        nodes.map(|n| self.nodes.get(n as usize).unwrap_or(&NO_NODE))
    }

    /// The nodes' numbers.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`].
    #[inline]
    pub fn element_node_numbers(&self, element: u32) -> [u32; 3] {
        self.elements.get(element as usize).map_or([0; 3], |e| e.nodes)
    }

    /// One node of an element.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`].
    #[inline]
    pub fn element_node(&self, element: u32, corner: usize) -> &Node {
        let node = self.elements.get(element as usize).and_then(|e| e.nodes.get(corner)).copied();
        self.nodes.get(node.unwrap_or(0) as usize).unwrap_or(&NO_NODE)
    }

    /// The lateral tensors of an element's nodes.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`]; the identity where there are none.
    #[inline]
    pub fn element_tensors(&self, element: u32) -> [&Tensor; 3] {
        let nodes = self.elements.get(element as usize).map_or([0; 3], |e| e.nodes);
        nodes.map(|n| self.lateral_tensors.get(n as usize).unwrap_or(&IDENTITY))
    }

    /// The corner positions of an element, m.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`].
    #[inline]
    pub fn corners(&self, element: u32) -> [DVec3; 3] {
        self.element_nodes(element).map(|n| n.position)
    }

    /// The unit normal of an element's outer side.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`].
    #[inline]
    pub fn outward(&self, element: u32) -> DVec3 {
        let [a, b, c] = self.corners(element);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// A point of the surface, m.
    #[inline]
    pub fn point(&self, at: crate::SurfacePoint) -> DVec3 {
        point(self.corners(at.element), at.n)
    }

    /// The blend of the nodes' inward normals at a point of the surface, of unit length.
    ///
    /// # Real-time
    /// As [`ContactModel::element_nodes`].
    #[inline]
    pub fn inward(&self, at: crate::SurfacePoint) -> DVec3 {
        mixed_inward(self.element_nodes(at.element).map(|n| n.inward), at.n)
    }

    /// The neighbour across edge `edge` of `element`, and which edge of it that is.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn across(&self, element: u32, edge: usize) -> Option<(u32, usize)> {
        let twin = *self.elements.get(element as usize)?.twins.get(edge)?;
        (twin < FENCE).then_some((twin / 3, twin as usize % 3))
    }

    /// Whether the body goes on across an edge without a neighbour: the edge of a [`Patch`](crate::Patch).
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn is_patch_boundary(&self, element: u32, edge: usize) -> bool {
        self.elements.get(element as usize).and_then(|e| e.twins.get(edge)) == Some(&FENCE)
    }

    /// Visits the elements around a corner with the number of that corner in each, this one first; false if a border
    /// runs through it. At most [`MAX_FAN`] are visited.
    ///
    /// # Real-time
    /// Bounded, no allocation, never panics.
    #[inline]
    pub fn around(&self, element: u32, corner: usize, mut visit: impl FnMut(u32, usize)) -> bool {
        let (mut e, mut c) = (element, corner);
        for _ in 0..MAX_FAN {
            visit(e, c);
            match self.across(e, (c + 2) % 3) {
                Some((next, _)) if next == element => return true,
                Some((next, edge)) => (e, c) = (next, edge),
                None => break,
            }
        }
        // A border: the rest lies the other way round.
        (e, c) = (element, corner);
        for _ in 0..MAX_FAN {
            match self.across(e, c) {
                Some((next, edge)) if next != element => (e, c) = (next, (edge + 1) % 3),
                _ => break,
            }
            visit(e, c);
        }
        false
    }

    /// Locks the memory that a step reads into RAM, so that no step waits for a page.
    ///
    /// # Errors
    /// The operating system's limit on locked memory is too low.
    pub fn lock_memory(&self) -> std::io::Result<()> {
        self.memory().try_for_each(crate::file::lock)
    }

    /// Lets the system page out what a step reads, whatever was locked before: a body may be larger than memory, and a step
    /// goes on a [`Patch`](crate::Patch) then.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn unlock_memory(&self) -> std::io::Result<()> {
        self.memory().try_for_each(crate::file::unlock)
    }

    /// What a step reads, and a patch is taken from.
    fn memory(&self) -> impl Iterator<Item = &[u8]> {
        let parts = [
            bytemuck::cast_slice(&self.nodes),
            bytemuck::cast_slice(&self.elements),
            bytemuck::cast_slice(&self.lateral_tensors),
        ];
        let gradients = self.gradients().into_iter().flat_map(Gradients::memory);
        parts
            .into_iter()
            .chain(self.responses.memory())
            .chain(self.potentials.memory())
            .chain(self.search.memory())
            .chain(gradients)
    }
}

/// [`ContactModel::identity`]: FNV-1a of sizes, tool, and samples; `curves` and `curvatures` are those of the test points that are
/// [`sampled`].
pub(crate) fn identity<'a>(
    positions: &[DVec3],
    inward: &[DVec3],
    sizes: [usize; 2],
    tool: &Tool,
    curves: impl Iterator<Item = &'a Curve>,
    curvatures: impl Iterator<Item = [f64; 3]>,
) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut eat = |word: u64| {
        for byte in word.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    sizes.iter().chain([&positions.len()]).for_each(|&size| eat(size as u64));
    eat(tool.radius_m().to_bits());
    for n in sampled(positions.len()) {
        let (p, u) = (positions[n as usize], inward[n as usize]);
        [p.x, p.y, p.z, u.x, u.y, u.z].iter().for_each(|x| eat(x.to_bits()));
    }
    curves.for_each(|curve| eat(curve.value(1e-3).to_bits()));
    // A body that counts none is what it was before there were any.
    curvatures.flatten().filter(|k| *k != 0.0).for_each(|k| eat(k.to_bits()));
    hash
}

/// Some of so many things.
pub(crate) fn sampled(count: usize) -> Vec<u32> {
    (0..count as u32).step_by(count.div_ceil(16).max(1)).collect()
}
