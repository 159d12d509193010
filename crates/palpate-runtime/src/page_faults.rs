//! How often a thread had to wait for the memory's manager.

/// Page faults of a thread since it began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PageFaults {
    /// Answered from memory: some microseconds.
    pub minor: u64,
    /// Answered from the disk: milliseconds.
    pub major: u64,
}

impl PageFaults {
    /// Of the calling thread; `None` where the system does not tell.
    ///
    /// # Real-time
    /// A system call of a fraction of a microsecond.
    pub fn of_this_thread() -> Option<PageFaults> {
        imp::of_this_thread()
    }

    /// Those since `before`.
    pub fn since(self, before: PageFaults) -> PageFaults {
        PageFaults {
            minor: self.minor.saturating_sub(before.minor),
            major: self.major.saturating_sub(before.major),
        }
    }
}

#[cfg(target_os = "linux")]
mod imp {
    use super::PageFaults;
    use std::mem::MaybeUninit;

    #[allow(unsafe_code, reason = "nothing safe asks for one thread's usage")]
    pub fn of_this_thread() -> Option<PageFaults> {
        let mut usage = MaybeUninit::<libc::rusage>::zeroed();
        // SAFETY: the pointer is to a whole `rusage`, which the call may write; it keeps it no longer.
        let result = unsafe { libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr()) };
        if result != 0 {
            return None;
        }
        // SAFETY: zeroed, which is valid for its numbers, and then written by the call.
        let usage = unsafe { usage.assume_init() };
        Some(PageFaults { minor: usage.ru_minflt as u64, major: usage.ru_majflt as u64 })
    }
}

#[cfg(not(target_os = "linux"))]
mod imp {
    use super::PageFaults;

    pub fn of_this_thread() -> Option<PageFaults> {
        None
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// Sixteen megabytes that nobody touched before are some pages at least, large or small ones.
    #[test]
    fn touching_new_memory_is_counted() {
        let before = PageFaults::of_this_thread().unwrap();
        let pages = vec![1u8; 16 << 20];
        let since = PageFaults::of_this_thread().unwrap().since(before);
        assert!(pages[12345] == 1 && since.minor >= 8, "{since:?}");
    }
}
