//! Handles: numbers that name what is open, so that what was closed, is of another kind, or is in use by another thread is a
//! status and no crash.
//!
//! Each kind has one table for the whole process. It is the only thing that is shared, and no result depends on it. A slot holds a
//! value and a word of state; a handle says which slot, and of which generation:
//!
//! ```text
//! handle  generation (32) | slot (28) | kind (4)
//! state   generation (32) | users (32)             users: so many readers, or ALONE
//! ```
//!
//! An odd generation is of something open, an even one of an empty slot. Closing raises it, so that old handles no longer fit.
//! Slots are never freed, and one whose generations are spent is not used again.
//!
//! # Real-time
//! Entering and leaving are one atomic exchange each, without a wait: somebody else in there is [`PALPATE_STATUS_BUSY`]. Opening and
//! closing take a lock and may allocate.

use crate::status::{PALPATE_STATUS_BUSY, PALPATE_STATUS_CLOSED, palpate_status};
use std::cell::UnsafeCell;
use std::ops::{Deref, DerefMut};
use std::ptr;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// A body: read-only, for any number of threads at a time. Contacts and sessions on it keep what they need when it is closed.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct palpate_body {
    /// 0 is never open.
    pub id: u64,
}

/// A contact: all that evolves while one tool touches one body. One thread at a time.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct palpate_contact {
    /// 0 is never open.
    pub id: u64,
}

/// A session: a device on a body. Any number of threads may read and steer it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct palpate_session {
    /// 0 is never open.
    pub id: u64,
}

/// Slots of the first block; each block has twice as many as the one before.
const FIRST: u64 = 64;
/// Blocks; all slots together fit into 28 bits.
const BLOCKS: usize = 22;
/// Users of a slot that one thread has to itself.
const ALONE: u64 = u32::MAX as u64;

struct Slot<T> {
    state: AtomicU64,
    value: UnsafeCell<Option<T>>,
}

/// All open things of one kind.
pub(crate) struct Table<T> {
    kind: u64,
    blocks: [AtomicPtr<Slot<T>>; BLOCKS],
    vacant: Mutex<Vacant>,
}

/// Slots without a value.
struct Vacant {
    /// That were used before.
    free: Vec<u64>,
    /// The first that never was.
    next: u64,
}

// SAFETY: a value is reached through its slot's state alone: shared by readers, which `T: Sync` allows, or by one thread, which
// `T: Send` allows.
unsafe impl<T: Send + Sync> Sync for Slot<T> {}
// SAFETY: a table only leads to its slots.
unsafe impl<T: Send + Sync> Sync for Table<T> {}

fn generation(state: u64) -> u64 {
    state >> 32
}

fn users(state: u64) -> u64 {
    state & ALONE
}

/// Block and place in it.
fn place(slot: u64) -> (usize, usize) {
    let n = slot / FIRST + 1;
    let block = n.ilog2();
    (block as usize, (slot - FIRST * ((1 << block) - 1)) as usize)
}

impl<T> Table<T> {
    /// An empty one; `kind` is from 1 to 15.
    pub const fn new(kind: u64) -> Self {
        let blocks = [const { AtomicPtr::new(ptr::null_mut()) }; BLOCKS];
        Table { kind, blocks, vacant: Mutex::new(Vacant { free: Vec::new(), next: 0 }) }
    }

    fn slot(&self, slot: u64) -> Option<&Slot<T>> {
        let (block, at) = place(slot);
        let first = self.blocks.get(block)?.load(Ordering::Acquire);
        // SAFETY: a block, once there, has `FIRST << block` slots, and is never freed.
        (!first.is_null()).then(|| unsafe { &*first.add(at) })
    }

    /// The slot and generation that a handle names.
    #[inline]
    fn named(&self, id: u64) -> Result<(&Slot<T>, u64), palpate_status> {
        let generation = generation(id);
        if id & 15 != self.kind || generation & 1 == 0 {
            return Err(PALPATE_STATUS_CLOSED);
        }
        let slot = self.slot(id >> 4 & 0xFFF_FFFF).ok_or(PALPATE_STATUS_CLOSED)?;
        Ok((slot, generation))
    }

    /// Takes a value in.
    pub fn open(&self, value: T) -> u64 {
        let mut vacant = self.vacant.lock().unwrap_or_else(PoisonError::into_inner);
        let number = vacant.free.pop().unwrap_or_else(|| {
            vacant.next += 1;
            vacant.next - 1
        });
        let (block, _) = place(number);
        assert!(block < BLOCKS, "more handles are open than there are numbers for");
        let first = &self.blocks[block];
        if first.load(Ordering::Relaxed).is_null() {
            let new = || Slot { state: AtomicU64::new(0), value: UnsafeCell::new(None) };
            let slots: Box<[Slot<T>]> = (0..FIRST << block).map(|_| new()).collect();
            first.store(Box::into_raw(slots).cast(), Ordering::Release);
        }
        let slot = self.slot(number).unwrap_or_else(|| unreachable!("its block was made above"));
        let generation = generation(slot.state.load(Ordering::Relaxed)) + 1;
        // SAFETY: the slot is vacant, no handle of an odd generation fits it, and the lock keeps others from opening it.
        unsafe { *slot.value.get() = Some(value) };
        slot.state.store(generation << 32, Ordering::Release);
        generation << 32 | number << 4 | self.kind
    }

    /// Enters as one of any number of readers.
    pub fn read(&self, id: u64) -> Result<Reading<'_, T>, palpate_status> {
        let (slot, named) = self.named(id)?;
        let mut state = slot.state.load(Ordering::Relaxed);
        loop {
            if generation(state) != named {
                return Err(PALPATE_STATUS_CLOSED);
            }
            if users(state) >= ALONE - 1 {
                return Err(PALPATE_STATUS_BUSY);
            }
            match slot.state.compare_exchange_weak(state, state + 1, Ordering::Acquire, Ordering::Relaxed) {
                Ok(_) => return Ok(Reading(slot)),
                Err(now) => state = now,
            }
        }
    }

    /// Enters alone.
    #[inline]
    pub fn alone(&self, id: u64) -> Result<Alone<'_, T>, palpate_status> {
        let (slot, named) = self.named(id)?;
        let idle = named << 32;
        match slot.state.compare_exchange(idle, idle | ALONE, Ordering::Acquire, Ordering::Relaxed) {
            Ok(_) => Ok(Alone { slot, idle }),
            Err(now) if generation(now) == named => Err(PALPATE_STATUS_BUSY),
            Err(_) => Err(PALPATE_STATUS_CLOSED),
        }
    }

    /// Closes a handle and gives what it named.
    pub fn close(&self, id: u64) -> Result<T, palpate_status> {
        let alone = self.alone(id)?;
        let (slot, idle) = (alone.slot, alone.idle);
        std::mem::forget(alone);
        // SAFETY: the slot is this thread's alone, since the exchange above and until the store below.
        let value = unsafe { (*slot.value.get()).take() };
        let next = generation(idle) + 1;
        slot.state.store(next << 32, Ordering::Release);
        // The last odd generation is used once: then the slot stays empty.
        if next < u64::from(u32::MAX) {
            let mut vacant = self.vacant.lock().unwrap_or_else(PoisonError::into_inner);
            vacant.free.push(id >> 4 & 0xFFF_FFFF);
        }
        value.ok_or(PALPATE_STATUS_CLOSED)
    }
}

/// Somebody who reads.
pub(crate) struct Reading<'t, T>(&'t Slot<T>);

impl<T> Deref for Reading<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: counted as a reader, so that nobody changes it; what is open has a value.
        unsafe { (*self.0.value.get()).as_ref().unwrap_unchecked() }
    }
}

impl<T> Drop for Reading<'_, T> {
    fn drop(&mut self) {
        self.0.state.fetch_sub(1, Ordering::Release);
    }
}

/// Somebody who is alone with it.
pub(crate) struct Alone<'t, T> {
    slot: &'t Slot<T>,
    idle: u64,
}

impl<T> Deref for Alone<'_, T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: alone with it; what is open has a value.
        unsafe { (*self.slot.value.get()).as_ref().unwrap_unchecked() }
    }
}

impl<T> DerefMut for Alone<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above.
        unsafe { (*self.slot.value.get()).as_mut().unwrap_unchecked() }
    }
}

impl<T> Drop for Alone<'_, T> {
    #[inline]
    fn drop(&mut self) {
        self.slot.state.store(self.idle, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    static NUMBERS: Table<u64> = Table::new(3);
    static OTHERS: Table<u64> = Table::new(4);

    #[test]
    fn what_is_closed_stays_closed() {
        let mut old = Vec::new();
        for k in 0..1000 {
            let id = OTHERS.open(k);
            assert_eq!(OTHERS.read(id).map(|n| *n), Ok(k));
            assert_eq!(OTHERS.close(id), Ok(k));
            old.push(id);
        }
        old.dedup();
        assert_eq!(old.len(), 1000);
        let open = OTHERS.open(7);
        // Kind, slot and generation in one word: any other value is of nothing that is open.
        for id in
            old.into_iter().chain([0, open ^ 1, open + (1 << 32), open + (2 << 32), open ^ 1 << 30, u64::MAX])
        {
            assert_eq!(OTHERS.read(id).map(|n| *n), Err(PALPATE_STATUS_CLOSED), "{id:x}");
            assert_eq!(OTHERS.alone(id).map(|n| *n), Err(PALPATE_STATUS_CLOSED), "{id:x}");
        }
        assert_eq!(OTHERS.close(open), Ok(7));
    }

    #[test]
    fn many_are_open_at_a_time() {
        let ids: Vec<u64> = (0..5000).map(|k| NUMBERS.open(k)).collect();
        for (k, &id) in ids.iter().enumerate() {
            assert_eq!(NUMBERS.read(id).map(|n| *n), Ok(k as u64));
        }
        for (k, &id) in ids.iter().enumerate() {
            assert_eq!(NUMBERS.close(id), Ok(k as u64));
        }
    }

    #[test]
    fn readers_share_and_writers_do_not() {
        static ONE: Table<u64> = Table::new(5);
        let id = ONE.open(0);
        {
            let (_a, _b) = (ONE.read(id).unwrap(), ONE.read(id).unwrap());
            assert_eq!(ONE.alone(id).err(), Some(PALPATE_STATUS_BUSY));
            assert_eq!(ONE.close(id).err(), Some(PALPATE_STATUS_BUSY));
        }
        {
            let _alone = ONE.alone(id).unwrap();
            assert_eq!(ONE.read(id).err(), Some(PALPATE_STATUS_BUSY));
            assert_eq!(ONE.alone(id).err(), Some(PALPATE_STATUS_BUSY));
        }
        // Two threads count in turns, and see each other's counts.
        let (refused, stop) = (AtomicU64::new(0), AtomicBool::new(false));
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    for _ in 0..10_000 {
                        loop {
                            match ONE.alone(id) {
                                Ok(mut n) => break *n += 1,
                                Err(status) => assert_eq!(status, PALPATE_STATUS_BUSY),
                            }
                            refused.fetch_add(1, Ordering::Relaxed);
                        }
                    }
                    stop.store(true, Ordering::Relaxed);
                });
            }
        });
        assert_eq!(ONE.close(id), Ok(20_000));
    }
}
