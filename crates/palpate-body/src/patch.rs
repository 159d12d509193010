//! A patch: the elements around a place with all that a step reads of them, copied out of a body.
//!
//! It has a [`ContactModel`] of its own, small enough to be locked into memory, on which [`step`] gives what it gives on the whole,
//! bit for bit as long as the tool stays where the patch knows the surface ([`Patch::knows`]). Where the body goes on but
//! the patch ends there is a *patch boundary* in place of a neighbour ([`ContactModel::is_patch_boundary`]).
//!
//! [`step`]: https://docs.rs/palpate-engine

use crate::body::Body;
use crate::index_map::IndexMap;
use crate::model::ContactModel;
use crate::search::Search;
use crate::surface::{Element, FENCE, NO_TWIN};
use glam::DVec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The elements nearest to a place, copied. Made once and taken anew again and again, it keeps its memory.
#[derive(Debug)]
pub struct Patch {
    model: ContactModel,
    /// Numbers in the whole body, ascending; an element's rank is its number in the patch.
    elements: IndexMap,
    /// Numbers in what it was copied from, likewise: what is compared by its number compares alike.
    nodes: IndexMap,
    test_points: IndexMap,
    centre: DVec3,
    radius_m: f64,
    groups: Vec<u32>,
    queue: Queue,
}

/// Groups of the tree still to be looked into, the nearest first: squared distance (its bits order as it does), level,
/// number.
pub(crate) type Queue = BinaryHeap<Reverse<(u64, u32, u32)>>;

impl Patch {
    /// Of `body`, around `centre`.
    pub fn new(body: &Body, centre: [f64; 3], count: usize) -> Self {
        let mut patch = Patch::empty(body.model_header());
        patch.take(body, centre, count);
        patch
    }

    /// To be filled from a body of this outline.
    pub(crate) fn empty(model_header: ContactModel) -> Self {
        Patch {
            model: model_header,
            elements: IndexMap::default(),
            nodes: IndexMap::default(),
            test_points: IndexMap::default(),
            centre: DVec3::ZERO,
            radius_m: 0.0,
            groups: Vec::new(),
            queue: Queue::new(),
        }
    }

    /// Takes the `count` elements nearest to `centre` (m), up to seven more; all there are if there are fewer. The same
    /// body, centre and count give the same patch. About 0.3 µs an element.
    ///
    /// `body` must be the one the patch was made of.
    pub fn take(&mut self, body: &Body, centre: [f64; 3], count: usize) {
        self.choose(&body.search, centre, count);
        let elements = std::mem::take(&mut self.elements);
        self.copy(body, &elements);
        self.elements = elements;
    }

    /// Chooses the elements to take by the whole body's tree, and copies of that what concerns them. Returns them.
    pub(crate) fn choose(&mut self, search: &Search, centre: [f64; 3], count: usize) -> &[u32] {
        self.centre = DVec3::from_array(centre);
        let Patch { elements, groups, queue, .. } = self;
        self.radius_m = search.nearest_groups(self.centre, count, groups, queue);
        elements.fill(groups.iter().flat_map(|&g| search.group(g)));
        self.model.search.copy(search, groups, |e| elements.renumber(e));
        self.elements.list()
    }

    /// Copies the chosen elements, which are these of `body`, and what they need.
    pub(crate) fn copy(&mut self, body: &ContactModel, elements: &IndexMap) {
        let Patch { nodes, test_points, .. } = self;
        let chosen = || elements.list().iter().map(|&e| body.elements[e as usize]);
        nodes.fill(chosen().flat_map(|e| e.nodes));
        let blended = nodes.list().iter().flat_map(|&n| body.nodes[n as usize].test_points);
        let gradients = body.gradients();
        let neighbours =
            gradients.into_iter().flat_map(|g| nodes.list().iter().flat_map(|&n| g.term_points(n)));
        test_points.fill(blended.chain(neighbours));

        let to = &mut self.model;
        to.nodes.clear();
        to.nodes.extend(nodes.list().iter().map(|&n| {
            let mut node = body.nodes[n as usize];
            node.test_points = node.test_points.map(|t| test_points.renumber(t));
            node
        }));
        to.elements.clear();
        to.elements.extend(chosen().map(|element| Element {
            nodes: element.nodes.map(|n| nodes.renumber(n)),
            twins: element.twins.map(|twin| match twin {
                NO_TWIN => NO_TWIN,
                twin => elements.renumber_twin(twin, FENCE),
            }),
        }));
        let (nodes_of, positions) = (&to.elements, &to.nodes);
        to.search.refine(|e| nodes_of[e as usize].nodes.map(|n| positions[n as usize].position));
        to.lateral_tensors.clear();
        if !body.is_isotropic() {
            to.lateral_tensors.extend(nodes.list().iter().map(|&n| body.lateral_tensors[n as usize]));
        }
        to.responses.copy(&body.responses, test_points.list());
        to.potentials.copy(&body.potentials, test_points.list());
        if let Some(from) = gradients {
            let mut copy = to.gradients.take().unwrap_or_default();
            copy.copy(from, nodes.list(), &body.responses, |t| test_points.renumber(t));
            to.gradients = copy.into();
        }
    }

    /// The patch as the engine takes it; elements and nodes have numbers of their own.
    ///
    /// # Real-time
    /// O(1).
    #[inline]
    pub fn model(&self) -> &ContactModel {
        &self.model
    }

    /// Whether a tool of `radius_m` at `p` (m) can touch nothing of the whole body but what the patch holds.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn knows(&self, p: [f64; 3], radius_m: f64) -> bool {
        self.centre.distance(DVec3::from_array(p)) + radius_m < self.radius_m
    }

    /// Its middle, m.
    pub fn centre_m(&self) -> [f64; 3] {
        self.centre.to_array()
    }

    /// All of the body that is nearer to the middle than this is in the patch, m; infinite where all of it is.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// An element's number here.
    ///
    /// # Real-time
    /// Logarithmic, never panics.
    #[inline]
    pub fn local(&self, element: u32) -> Option<u32> {
        self.elements.index_of(element)
    }

    /// An element's number in the whole body; its own number for one that the patch doesn't hold.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn global(&self, element: u32) -> u32 {
        self.elements.list().get(element as usize).copied().unwrap_or(element)
    }

    /// Locks what a step reads into RAM.
    ///
    /// # Errors
    /// The operating system's limit on locked memory is too low.
    pub fn lock_memory(&self) -> std::io::Result<()> {
        self.model.lock_memory()?;
        self.elements.memory().try_for_each(crate::file::lock)
    }
}
