//! What two threads hand each other without ever waiting: the newest box in a [`Mailbox`], the newest words on a [`Board`].
//!
//! The tests run this very file under loom, which tries the orders in which two threads' accesses can be seen. Each ordering is
//! the weakest that will do: with any of them weaker a test fails.

use crate::atomic::{AtomicPtr, AtomicU64, Ordering, fence};
use std::marker::PhantomData;
use std::ptr;

/// Room for one box: posting puts it there and takes out what was there, taking leaves the room empty.
///
/// What is in it goes from thread to thread, and has to bear that:
///
/// ```compile_fail,E0277
/// # use palpate_runtime::Mailbox;
/// # use std::rc::Rc;
/// let mailbox = Mailbox::<Rc<u32>>::default();
/// std::thread::scope(|scope| scope.spawn(|| drop(mailbox.take())).join());
/// ```
///
/// ```
/// # use palpate_runtime::Mailbox;
/// # use std::sync::Arc;
/// let mailbox = Mailbox::<Arc<u32>>::default();
/// std::thread::scope(|scope| scope.spawn(|| drop(mailbox.take())).join()).unwrap();
/// ```
#[derive(Debug)]
pub struct Mailbox<T> {
    slot: AtomicPtr<T>,
    /// An atomic pointer goes between threads whatever it points to; the box that it is here does not.
    owns: PhantomData<*mut T>,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Mailbox { slot: AtomicPtr::new(ptr::null_mut()), owns: PhantomData }
    }
}

// A mailbox gives boxes from one thread to another and never a reference into them.
#[allow(unsafe_code, reason = "the mailbox owns what its pointer points to")]
// SAFETY: the pointer is only ever swapped as a whole, so that each box has one owner at a time; moving it between threads
// needs `T: Send`, and nothing is shared.
unsafe impl<T: Send> Sync for Mailbox<T> {}

#[allow(unsafe_code, reason = "the mailbox owns what its pointer points to")]
// SAFETY: with the mailbox goes the box in it, if there is one, which needs `T: Send`.
unsafe impl<T: Send> Send for Mailbox<T> {}

impl<T> Mailbox<T> {
    /// Puts a box in. What was there and nobody took comes back.
    ///
    /// # Real-time
    /// One atomic exchange.
    pub fn post(&self, value: Box<T>) -> Option<Box<T>> {
        // Gives what is in the new box to who takes it, and gets what is in the old one from who posted that.
        owned(self.slot.swap(Box::into_raw(value), Ordering::AcqRel))
    }

    /// Takes out what is there.
    ///
    /// # Real-time
    /// One atomic exchange.
    pub fn take(&self) -> Option<Box<T>> {
        owned(self.slot.swap(ptr::null_mut(), Ordering::Acquire))
    }

    /// Whether nothing is there. It stays so for the only thread that posts.
    ///
    /// # Real-time
    /// One atomic load.
    pub fn is_empty(&self) -> bool {
        self.slot.load(Ordering::Relaxed).is_null()
    }
}

fn owned<T>(pointer: *mut T) -> Option<Box<T>> {
    #[allow(unsafe_code, reason = "a box is made again of the pointer it was")]
    // SAFETY: a pointer that is not null came from `Box::into_raw` in `post`, and the exchange that gave it took it out of the
    // slot, so that nobody else has it.
    unsafe {
        (!pointer.is_null()).then(|| Box::from_raw(pointer))
    }
}

impl<T> Drop for Mailbox<T> {
    fn drop(&mut self) {
        drop(self.take());
    }
}

/// `N` words that one thread writes and others read, all of one writing: a sequence lock (Lameter 2005; Boehm 2012).
#[derive(Debug)]
pub struct Board<const N: usize> {
    /// Odd while the words are being written.
    turn: AtomicU64,
    words: [AtomicU64; N],
}

impl<const N: usize> Default for Board<N> {
    fn default() -> Self {
        Board { turn: AtomicU64::new(0), words: std::array::from_fn(|_| AtomicU64::new(0)) }
    }
}

impl<const N: usize> Board<N> {
    /// Writes the words. Only one thread may.
    ///
    /// # Real-time
    /// `N` + 2 atomic stores: the writer never waits.
    pub fn write(&self, words: &[u64; N]) {
        let turn = self.turn.load(Ordering::Relaxed);
        self.turn.store(turn.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        for (place, word) in self.words.iter().zip(words) {
            place.store(*word, Ordering::Relaxed);
        }
        self.turn.store(turn.wrapping_add(2), Ordering::Release);
    }

    /// The words, and how often they were written; `None` if they were being written meanwhile: try again.
    pub fn read(&self) -> Option<([u64; N], u64)> {
        let before = self.turn.load(Ordering::Acquire);
        let words = std::array::from_fn(|i| self.words[i].load(Ordering::Relaxed));
        fence(Ordering::Acquire);
        let after = self.turn.load(Ordering::Relaxed);
        (before == after && before.is_multiple_of(2)).then_some((words, before / 2))
    }
}
