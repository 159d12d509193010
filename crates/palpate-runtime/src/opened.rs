//! A device that is open, for as long as somebody holds it.

use palpate_device::{Device, OpenError};
use std::ops::{Deref, DerefMut};

/// An open device. Dropped, it renders no force and is closed, however that comes about.
pub struct Opened(Option<Box<dyn Device>>);

impl Opened {
    /// Opens it. What it can do, and where it is, is known from now on.
    ///
    /// # Errors
    /// It can't be opened.
    pub fn new(mut device: Box<dyn Device>) -> Result<Self, OpenError> {
        device.open()?;
        Ok(Opened(Some(device)))
    }

    /// To somebody who closes it himself.
    pub(crate) fn into_inner(mut self) -> Box<dyn Device> {
        self.0.take().unwrap_or_else(|| unreachable!("a device is given away once"))
    }
}

impl Deref for Opened {
    type Target = dyn Device;

    fn deref(&self) -> &(dyn Device + 'static) {
        self.0.as_deref().unwrap_or_else(|| unreachable!("who holds it has not given it away"))
    }
}

impl DerefMut for Opened {
    fn deref_mut(&mut self) -> &mut (dyn Device + 'static) {
        self.0.as_deref_mut().unwrap_or_else(|| unreachable!("who holds it has not given it away"))
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        self.0.iter_mut().for_each(|device| device.close());
    }
}

impl std::fmt::Debug for Opened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Opened").field(&self.capabilities().name).finish()
    }
}
