//! What can go wrong: at leisure while opening, as plain data in the loop.

/// Why a device could not be opened: what is wrong, and how to correct it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {problem}; {hint}")]
pub struct OpenError {
    /// The device, as its capabilities name it or as it was asked for.
    pub device: String,
    /// What is wrong: a library that is missing, no device on the bus, a service that refuses.
    pub problem: String,
    /// What the user can do: install, plug in, give rights.
    pub hint: String,
}

/// Why a `read` or `write` failed. Plain data: a loop can keep, count and send it without allocating.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// `read` or `write` before `open` or after `close`.
    #[error("the device is not open")]
    NotOpen,
    /// The device, its library's connection or its service is gone.
    #[error("the device is gone")]
    Disconnected,
    /// A replay is over: there are no more poses, and nothing is wrong.
    #[error("the recording has ended")]
    Ended,
    /// The device did not answer within the bound that its driver gives it.
    #[error("the device did not answer in time")]
    TimedOut,
    /// What came can't be understood.
    #[error("the device sent what can't be understood")]
    Garbled,
    /// The vendor's own error number; [`crate::Device::explain`] has its text.
    #[error("the device's error {0}")]
    Code(i64),
}
