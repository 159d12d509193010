//! The contact finder: keeps the patch under the tool in reach of the haptic thread (paper, section 5: "the other finding
//! the active element").
//!
//! A [`PatchHolder`] belongs to the haptic thread: it holds the patch that is stepped on, takes a new one where one lies ready,
//! and says where the tool is. A [`Finder`] belongs to the other thread: it looks where the tool is and where it is going,
//! and lays out the next patch. Both share a [`Link`], on which neither ever waits for the other.
//!
//! Boxes go round: the finder's hands → `fresh` → the patch holder → `used` → the finder's hands. The patch holder takes a new one only
//! while `used` is empty, so that it never has to give back two, and never frees memory.

use crate::atomic::{AtomicU64, Ordering};
use crate::{Board, Mailbox};
use glam::DVec3;
use palpate_body::{BodySource, Patch};
use palpate_engine::Contact;
use std::sync::Arc;

/// How many elements a patch has: some 2.5 mm around a contact point on a body of the size of a fist with five million.
pub const PATCH_ELEMENTS: usize = 8192;

/// A patch is renewed when the tool is this share of its reach from its middle: of its radius, less what is around the place that it must
/// hold: the tool if that is free, else the contact points where there are two.
const WORN: f64 = 0.25;
/// How far ahead of the tool the next patch is put, s: what making the last one took, and no less nor more than this.
const AHEAD: [f64; 2] = [5e-3, 50e-3];
/// But no farther from what must be in it than this share of its reach.
const FARTHEST: f64 = 0.75;
/// Where that is not far enough, or the contact point waits, patches have this part of the elements: they take so much less to
/// make, and reach half as far.
const HASTE: usize = 4;
/// But no fewer than this, if as many were asked for: a patch of few elements knows little more than these.
const LEAST: usize = 512;
/// And only where they reach so many times as far as half of the distance between two contact points, both of which they must hold:
/// how far they will reach is an estimate.
const ROOM: f64 = 1.5;

/// A patch and which one it is.
#[derive(Debug)]
pub struct PatchMessage {
    pub(crate) patch: Patch,
    /// Counted from 1.
    pub(crate) serial: u64,
    pub(crate) asked: usize,
}

/// What the haptic thread tells the finder.
#[derive(Debug, Clone, Copy)]
struct ToolSample {
    time_s: f64,
    /// What the next patch must hold, m: the middle of the contact points, or a free tool,
    place: DVec3,
    /// and what is so far around it, m: the contact points, or the tool itself.
    around_m: f64,
    /// Where the contact point would be if nothing held it, m: beside the tool.
    aim: DVec3,
    /// The last patch that came, whether it was taken or not.
    serial: u64,
    is_free: bool,
    /// Whether the loop waits for a patch.
    waits: bool,
}

impl ToolSample {
    fn words(&self) -> [u64; 10] {
        let ([a, b, c], [d, e, f]) = (self.place.to_array(), self.aim.to_array());
        let numbers = [self.time_s, a, b, c, d, e, f, self.around_m];
        let [time, a, b, c, d, e, f, around] = numbers.map(f64::to_bits);
        let flags = u64::from(self.is_free) << 1 | u64::from(self.waits);
        [time, a, b, c, d, e, f, around, self.serial, flags]
    }

    fn of([time, a, b, c, d, e, f, around, serial, flags]: [u64; 10]) -> Self {
        let point = |words: [u64; 3]| DVec3::from_array(words.map(f64::from_bits));
        ToolSample {
            time_s: f64::from_bits(time),
            place: point([a, b, c]),
            around_m: f64::from_bits(around),
            aim: point([d, e, f]),
            serial,
            is_free: flags & 2 != 0,
            waits: flags & 1 != 0,
        }
    }
}

/// What the two share.
#[derive(Debug, Default)]
pub struct Link {
    look: Board<10>,
    fresh: Mailbox<PatchMessage>,
    used: Mailbox<PatchMessage>,
    beats: AtomicU64,
}

impl Link {
    /// How often the finder has looked.
    pub fn beats(&self) -> u64 {
        self.beats.load(Ordering::Relaxed)
    }
}

/// The haptic thread's end.
#[derive(Debug)]
pub struct PatchHolder {
    link: Arc<Link>,
    message: Box<PatchMessage>,
    /// The last one that came.
    serial: u64,
    /// Patches that came without the contact point's element.
    refused: u64,
}

/// The finder's end.
#[derive(Debug)]
pub struct Finder {
    link: Arc<Link>,
    body: Arc<dyn BodySource>,
    elements: usize,
    #[expect(clippy::vec_box, reason = "the mailboxes hand over boxes, and these go round")]
    hands: Vec<Box<PatchMessage>>,
    serial: u64,
    newest: Newest,
    seen: Option<(f64, DVec3)>,
    velocity: DVec3,
    /// What making the last patch took for each element, by the loop's time, s.
    took: f64,
}

/// What is known of the newest patch.
#[derive(Debug, Clone, Copy)]
struct Newest {
    centre: DVec3,
    radius_m: f64,
    /// Elements it was asked for.
    asked: usize,
}

impl Newest {
    fn of(message: &PatchMessage) -> Self {
        Newest {
            centre: message.patch.centre_m().into(),
            radius_m: message.patch.radius_m(),
            asked: message.asked,
        }
    }

    /// How far one of so many elements would reach, m: an area grows as they do.
    fn radius_of_m(&self, elements: usize) -> f64 {
        self.radius_m * (elements as f64 / self.asked.max(1) as f64).sqrt()
    }
}

/// Both ends, with a first patch around `place_m` of `elements` elements.
///
/// # Errors
/// The body's file can't be read.
pub fn patch_holder(
    body: Arc<dyn BodySource>,
    place_m: [f64; 3],
    elements: usize,
) -> palpate_body::Result<(PatchHolder, Finder)> {
    let link = Arc::new(Link::default());
    let message = |serial| Box::new(PatchMessage { patch: body.patch(), serial, asked: elements });
    let mut first = message(1);
    body.take(&mut first.patch, place_m, elements, &|| ())?;
    // Where it may not be locked it is used as it is; the thread that asks for real time says so once.
    let _ = first.patch.lock_memory();
    let newest = Newest::of(&first);
    // One under way in each direction, one in the making.
    let count = if newest.radius_m.is_finite() { 3 } else { 0 };
    let hands = (0..count).map(|_| message(0)).collect();
    let patch_holder = PatchHolder { link: link.clone(), message: first, serial: 1, refused: 0 };
    Ok((
        patch_holder,
        Finder {
            link,
            body,
            elements,
            hands,
            serial: 1,
            newest,
            seen: None,
            velocity: DVec3::ZERO,
            took: 0.0,
        },
    ))
}

impl PatchHolder {
    /// The patch that is stepped on.
    pub fn patch(&self) -> &Patch {
        &self.message.patch
    }

    /// Which one it is, counted from 1, and how many elements were asked for.
    pub fn asked(&self) -> (u64, usize) {
        (self.message.serial, self.message.asked)
    }

    /// How many patches were refused because they lacked the contact point's element.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// What the two ends share.
    pub fn link(&self) -> &Arc<Link> {
        &self.link
    }

    /// Goes over to the newest patch, if one has come and holds the element that `contact` touches.
    ///
    /// # Real-time
    /// Logarithmic in the patch's size; never waits or allocates.
    pub fn renew(&mut self, contact: &mut Contact) {
        if !self.link.used.is_empty() {
            return;
        }
        let Some(mut next) = self.link.fresh.take() else { return };
        self.serial = next.serial;
        let old = &self.message.patch;
        if contact.renumber(|e| next.patch.local(old.global(e))) {
            std::mem::swap(&mut self.message, &mut next);
        } else {
            self.refused += 1;
        }
        // The room was empty, and only this thread fills it.
        if let Some(never) = self.link.used.post(next) {
            std::mem::forget(never);
        }
    }

    /// Says at `time_s` where the contact is, or a free tool at `tip_m`, and where it is drawn to; and whether the loop waits
    /// for a patch.
    ///
    /// # Real-time
    /// A few atomic stores.
    pub fn report(&self, time_s: f64, tip_m: [f64; 3], contact: &Contact, waits: bool) {
        let (body, tip) = (self.message.patch.model(), DVec3::from_array(tip_m));
        let touching = contact.touching();
        let (place, around_m, aim) = touching.map_or((tip, body.tool().radius_m(), tip), |at| {
            let (first, inward) = (body.point(at), body.inward(at));
            let last = contact.contact_points().last().map_or(first, |at| body.point(at));
            let aim = tip - inward * (tip - first).dot(inward);
            (first.midpoint(last), 0.5 * first.distance(last), aim)
        });
        let is_free = touching.is_none();
        let sample = ToolSample { time_s, place, around_m, aim, serial: self.serial, is_free, waits };
        self.link.look.write(&sample.words());
    }
}

impl Finder {
    /// One look: lays out a new patch if the newest one is worn. False if there was nothing to do.
    ///
    /// # Errors
    /// The body's file can't be read, or was changed: no patch will come any more.
    pub fn look(&mut self) -> palpate_body::Result<bool> {
        self.link.beats.fetch_add(1, Ordering::Relaxed);
        self.hands.extend(self.link.used.take());
        let Some((words, times)) = self.link.look.read() else { return Ok(false) };
        let sample = ToolSample::of(words);
        let ToolSample { time_s, place, around_m, aim, is_free, .. } = sample;
        if times == 0 || !(place.is_finite() && aim.is_finite()) {
            return Ok(false);
        }
        self.follow(time_s, aim);
        let newest = self.newest;
        if newest.radius_m == f64::INFINITY {
            return Ok(false);
        }
        // A free tool must be within the patch as it is large, and two contact points both.
        let reach = |elements| (newest.radius_of_m(elements) - around_m).max(0.0);
        let ahead = |elements: usize| {
            let took = (self.took * elements as f64).clamp(AHEAD[0], AHEAD[1]);
            let ahead = aim + self.velocity * took - place;
            if ahead.is_finite() { ahead } else { DVec3::ZERO }
        };
        let mut elements = self.elements;
        let few = elements.min((elements / HASTE).max(LEAST));
        let hasty = sample.waits || ahead(elements).length() > FARTHEST * reach(elements);
        if !is_free && hasty && newest.radius_of_m(few) > ROOM * around_m {
            elements = few;
        }
        let mut target = place + ahead(elements).clamp_length_max(FARTHEST * reach(elements));
        let worn = target.distance(newest.centre) > WORN * reach(newest.asked);
        if !worn {
            if !(sample.waits && sample.serial == self.serial) {
                return Ok(false);
            }
            // The newest patch has come and does not do, though it is where it should be.
            (target, elements) = (place, self.elements);
        }
        if target == newest.centre && elements == newest.asked {
            return Ok(false);
        }
        let Some(mut message) = self.hands.pop() else { return Ok(false) };
        // A slow disk is no dead finder.
        let beat = || {
            self.link.beats.fetch_add(1, Ordering::Relaxed);
        };
        self.body.take(&mut message.patch, target.to_array(), elements, &beat)?;
        let _ = message.patch.lock_memory();
        self.serial += 1;
        (message.serial, message.asked) = (self.serial, elements);
        self.newest = Newest::of(&message);
        self.hands.extend(self.link.fresh.post(message));
        if let Some((words, _)) = self.link.look.read() {
            self.took = (ToolSample::of(words).time_s - time_s).max(0.0) / elements as f64;
        }
        Ok(true)
    }

    /// The velocity of what it is drawn to, smoothed over a few looks.
    fn follow(&mut self, time: f64, place: DVec3) {
        let Some((then, before)) = self.seen else {
            self.seen = Some((time, place));
            return;
        };
        let passed = time - then;
        // Over less than this a device's resolution is all there is to see.
        if passed >= 2e-3 {
            let now = (place - before) / passed;
            self.velocity = if now.is_finite() { self.velocity * 0.5 + now * 0.5 } else { DVec3::ZERO };
            self.seen = Some((time, place));
        }
    }
}
