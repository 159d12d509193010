//! What the stages did in a period, and how often.

/// A set of things that happened in one period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageFlags(u32);

impl StageFlags {
    /// The engine was given a pose.
    pub const STEPPED: Self = Self(1);
    /// The device's `read` failed.
    pub const UNREAD: Self = Self(1 << 1);
    /// The pose was rejected: NaN or infinite, or too far from the last.
    pub const REFUSED: Self = Self(1 << 2);
    /// The clutch was held.
    pub const CLUTCHED: Self = Self(1 << 3);
    /// A force or torque was NaN or infinite, and zero in its place.
    pub const CONTAINED: Self = Self(1 << 4);
    /// The passivity controller rendered a damping.
    pub const PASSIVITY: Self = Self(1 << 5);
    /// The soft start had not ended.
    pub const STARTING: Self = Self(1 << 6);
    /// Force or torque were cut to the limit.
    pub const SATURATED: Self = Self(1 << 7);
    /// Force or torque were held back by the slew limit.
    pub const SLEWED: Self = Self(1 << 8);
    /// Of recordings from before 0.1.0: the last command was sent again, because its `write` had failed.
    pub const REPEATED: Self = Self(1 << 9);
    /// The device's `write` failed.
    pub const UNWRITTEN: Self = Self(1 << 10);
    /// The loop was stopped: no force but on the way to zero.
    pub const STOPPED: Self = Self(1 << 11);
    /// The pose lay where the ground is not known: the engine waited for a patch.
    pub const WAITED: Self = Self(1 << 12);
    /// The device renders nothing: its forces are off, nobody holds its grip, or it is not ready.
    pub const IDLE: Self = Self(1 << 13);
    /// The device has had no command for too long: what it renders now is not known.
    pub const LATE: Self = Self(1 << 14);
    /// The device's pose has been the same one for too long, by its own counter.
    pub const STALE: Self = Self(1 << 15);

    /// A torque was wanted of a device that drives no rotation: it was left out.
    pub const TORQUE_DROPPED: Self = Self(1 << 16);
    /// A setting was changed, or is to be once there is no force.
    pub const CHANGING: Self = Self(1 << 17);

    /// All of them, in the order of their bits, with their names.
    pub const NAMED: [(&'static str, Self); 18] = [
        ("stepped", Self::STEPPED),
        ("unread", Self::UNREAD),
        ("refused", Self::REFUSED),
        ("clutched", Self::CLUTCHED),
        ("contained", Self::CONTAINED),
        ("passivity", Self::PASSIVITY),
        ("starting", Self::STARTING),
        ("saturated", Self::SATURATED),
        ("slewed", Self::SLEWED),
        ("repeated", Self::REPEATED),
        ("unwritten", Self::UNWRITTEN),
        ("stopped", Self::STOPPED),
        ("waited", Self::WAITED),
        ("idle", Self::IDLE),
        ("late", Self::LATE),
        ("stale", Self::STALE),
        ("torque_dropped", Self::TORQUE_DROPPED),
        ("changing", Self::CHANGING),
    ];

    /// Adds `flag` if `happened`.
    pub(crate) fn set(&mut self, flag: Self, happened: bool) {
        self.0 |= if happened { flag.0 } else { 0 };
    }

    /// Takes `flag` back.
    pub(crate) fn unset(&mut self, flag: Self) {
        self.0 &= !flag.0;
    }

    /// Whether any of `flags` happened.
    pub fn has(self, flags: Self) -> bool {
        self.0 & flags.0 != 0
    }

    /// As bits.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// From bits; unknown ones are dropped.
    pub fn from_bits(bits: u32) -> Self {
        Self(bits & ((1 << Self::NAMED.len()) - 1))
    }

    /// The names of what happened.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMED.into_iter().filter(move |(_, flag)| self.has(*flag)).map(|(name, _)| name)
    }
}

/// In how many periods each flag was set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageCounts([u64; StageFlags::NAMED.len()]);

impl StageCounts {
    /// Counts one period.
    pub fn add(&mut self, flags: StageFlags) {
        for (count, (_, flag)) in self.0.iter_mut().zip(StageFlags::NAMED) {
            *count += u64::from(flags.has(flag));
        }
    }

    /// The periods in which `flag`, a single one, was set.
    pub fn of(&self, flag: StageFlags) -> u64 {
        self.0.get(flag.0.trailing_zeros() as usize).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_names_and_counts_agree() {
        let mut counts = StageCounts::default();
        for (i, (name, flag)) in StageFlags::NAMED.into_iter().enumerate() {
            assert_eq!(flag.bits(), 1 << i);
            assert_eq!(flag.names().collect::<Vec<_>>(), [name]);
            counts.add(flag);
            counts.add(StageFlags::STEPPED);
        }
        assert_eq!(counts.of(StageFlags::STEPPED), StageFlags::NAMED.len() as u64 + 1);
        assert_eq!(counts.of(StageFlags::STOPPED), 1);
        assert_eq!(StageFlags::from_bits(u32::MAX).names().count(), StageFlags::NAMED.len());
    }
}
