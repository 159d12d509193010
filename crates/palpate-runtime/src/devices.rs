//! What is attached: every vendor's devices that can be opened now, and why the others can't.

use crate::Opened;
use crate::device_choice::{DeviceChoice, Drivers};
use palpate_device::Capabilities;

/// How many devices of one kind are looked for.
const MOST: u8 = 8;

/// A device that could be opened. It has rendered no force.
#[derive(Debug, Clone, PartialEq)]
pub struct Attached {
    /// How it is chosen.
    pub choice: DeviceChoice,
    /// What it can do, and what each figure rests on.
    pub capabilities: Capabilities,
    /// What it could not be had for, a line each.
    pub notes: Vec<String>,
}

/// A kind of device of which none could be opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unreached {
    /// How it would be chosen.
    pub choice: DeviceChoice,
    /// Why, and what to do.
    pub reason: String,
}

/// Opens the vendors' devices there are (of Haply's and 3D Systems' the first, which has no name), one after the other, and closes each again before the next: no force is
/// commanded but zero.
pub fn attached(drivers: &Drivers) -> (Vec<Attached>, Vec<Unreached>) {
    let (mut found, mut unreached) = (Vec::new(), Vec::new());
    let kinds: [fn(u8) -> Option<DeviceChoice>; 3] = [
        |index| Some(DeviceChoice::Dhd(Some(index))),
        |index| (index == 0).then_some(DeviceChoice::OpenHaptics(None)),
        |index| (index == 0).then_some(DeviceChoice::Haply(None)),
    ];
    for kind in kinds {
        for choice in (0..MOST).map_while(kind) {
            let Some(device) = drivers.driver(&choice, None) else { break };
            match Opened::new(device) {
                Ok(device) => {
                    let (capabilities, notes) = (device.capabilities().clone(), device.notes().to_vec());
                    found.push(Attached { choice, capabilities, notes });
                }
                // That there is no second one is no news, and one that is busy may stand before a third.
                Err(_) if matches!(choice, DeviceChoice::Dhd(Some(index)) if index > 0) => {}
                Err(error) => {
                    unreached.push(Unreached { choice, reason: error.to_string() });
                    break;
                }
            }
        }
    }
    (found, unreached)
}
