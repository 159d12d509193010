//! What happened in a step.

/// A set of things that happened in one step; a trace, a recording and a program that embeds the engine name them alike.
///
/// Bits never change their meaning: new ones come after the last.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Flags(u32);

impl Flags {
    /// The tool touches the body after this step.
    pub const IN_CONTACT: Self = Self(1);
    /// The contact point moved over the surface.
    pub const SLIPPING: Self = Self(1 << 1);
    /// A contact began in this step.
    pub const ONSET: Self = Self(1 << 2);
    /// A contact ended in this step.
    pub const RELEASED: Self = Self(1 << 3);
    /// After a contact that ended, or came to nothing, the tool touches elsewhere: on the rest of its way, or at its nearest
    /// surface point. What is stored where it was already that deep appears at a fixed tool, as nothing else does that the
    /// tank does not hold back; the ledger has it as generated.
    pub const REANCHORED: Self = Self(1 << 4);
    /// The contact ended because the contact point reached the surface's border; of two contact points, because either did.
    pub const BORDER: Self = Self(1 << 5);
    /// The contact point is held by an edge or vertex that it can't leave: f_r may exceed the limit.
    pub const BLOCKED: Self = Self(1 << 6);
    /// The step's budget was spent before the contact point had come to rest: what the slip rule bounds was
    /// cut to the limit.
    pub const CAPPED: Self = Self(1 << 7);
    /// The tool state held a number that is not finite, a position beyond 10⁴ m, or an orientation that is no
    /// rotation: no force, and the contact is kept as it was.
    pub const INVALID_POSE: Self = Self(1 << 8);
    /// The force was not finite and was replaced by zero.
    pub const CONTAINED: Self = Self(1 << 9);
    /// The tool is inside the body (or nearer than its radius) without having come through the surface: the
    /// first pose lay there, or it came under an open sheet around its border. No force until it has left.
    pub const STARTED_INSIDE: Self = Self(1 << 10);
    /// The contact point waits at a patch's boundary ([`palpate_body::Patch`]) that its body goes on beyond,
    /// or has not caught up since: what the slip rule bounds was cut to the limit.
    pub const PATCH_BOUNDARY: Self = Self(1 << 11);
    /// The time step was negative or not finite, and counted as 0.
    pub const INVALID_TIME: Self = Self(1 << 12);
    /// The body is not the one that the contact was made for: no force, and the contact is kept as it was.
    pub const OTHER_BODY: Self = Self(1 << 13);

    /// Slip waited, wholly or in part, since it would have given out more energy than the tank held: f_r may exceed the
    /// limit.
    pub const HELD_BACK: Self = Self(1 << 14);
    /// f_z is below 0: the normal force pulls the tool in. Only a coupled law does that, far aside of where
    /// its stiffness falls with depth, and until the contact point has slipped back.
    pub const PULLING: Self = Self(1 << 15);

    /// All of them, in the order of their bits, with their names.
    pub const NAMED: [(&'static str, Self); 16] = [
        ("in_contact", Self::IN_CONTACT),
        ("slipping", Self::SLIPPING),
        ("onset", Self::ONSET),
        ("released", Self::RELEASED),
        ("reanchored", Self::REANCHORED),
        ("border", Self::BORDER),
        ("blocked", Self::BLOCKED),
        ("capped", Self::CAPPED),
        ("invalid_pose", Self::INVALID_POSE),
        ("contained", Self::CONTAINED),
        ("started_inside", Self::STARTED_INSIDE),
        ("fenced", Self::PATCH_BOUNDARY),
        ("invalid_time", Self::INVALID_TIME),
        ("other_body", Self::OTHER_BODY),
        ("held_back", Self::HELD_BACK),
        ("pulling", Self::PULLING),
    ];

    /// These two.
    pub(crate) const fn of_two(one: Self, other: Self) -> Self {
        Self(one.0 | other.0)
    }

    /// All but these two.
    pub(crate) const fn all_but(one: Self, other: Self) -> Self {
        Self(((1 << Self::NAMED.len()) - 1) & !one.0 & !other.0)
    }

    /// Adds `flags` if they `happened`.
    #[inline]
    pub(crate) fn set(&mut self, flags: Self, happened: bool) {
        self.0 |= if happened { flags.0 } else { 0 };
    }

    /// Takes `flags` back.
    #[inline]
    pub(crate) fn unset(&mut self, flags: Self) {
        self.0 &= !flags.0;
    }

    /// Whether any of `flags` happened.
    #[inline]
    pub fn has(self, flags: Self) -> bool {
        self.0 & flags.0 != 0
    }

    /// As bits.
    #[inline]
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

impl std::ops::BitOr for Flags {
    type Output = Self;

    #[inline]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl std::fmt::Debug for Flags {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.names()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_names_agree() {
        for (i, (name, flag)) in Flags::NAMED.into_iter().enumerate() {
            assert_eq!(flag.bits(), 1 << i);
            assert_eq!(flag.names().collect::<Vec<_>>(), [name]);
            assert_eq!(Flags::from_bits(1 << i), flag);
        }
        assert_eq!(Flags::from_bits(u32::MAX).names().count(), Flags::NAMED.len());
        let both = Flags::ONSET | Flags::IN_CONTACT;
        assert!(both.has(Flags::ONSET) && !both.has(Flags::RELEASED));
        assert_eq!(format!("{both:?}"), r#"{"in_contact", "onset"}"#);
    }
}
