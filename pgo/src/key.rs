use std::fmt;

/// The name of a pose: which robot, and which of its poses.
///
/// Ordered by robot, then index. In g2o files a key is one 64-bit id, the robot in the upper 8 bits and the
/// index in the lower 56 (the layout of GTSAM symbols, where `robot` is the ASCII code of the letter), so plain
/// ids below 2⁵⁶ are poses of robot 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Key {
    /// Robot the pose belongs to; 0 where there is only one.
    pub robot: u32,
    /// Index of the pose within its robot.
    pub index: u64,
}

const INDEX_BITS: u32 = 56;
const INDEX_MASK: u64 = (1 << INDEX_BITS) - 1;

impl Key {
    /// The key of pose `index` of `robot`.
    pub const fn new(robot: u32, index: u64) -> Self {
        Self { robot, index }
    }

    /// The key of a 64-bit id: robot in the upper 8 bits, index below.
    pub const fn from_id(id: u64) -> Self {
        Self { robot: (id >> INDEX_BITS) as u32, index: id & INDEX_MASK }
    }

    /// The 64-bit id of this key, or `None` when the robot needs more than 8 bits or the index more than 56.
    pub const fn to_id(self) -> Option<u64> {
        if self.robot < 256 && self.index <= INDEX_MASK {
            Some(((self.robot as u64) << INDEX_BITS) | self.index)
        } else {
            None
        }
    }
}

impl fmt::Display for Key {
    /// `12` for robot 0, `a12` for a robot named by an ASCII letter, `r300:12` otherwise.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.robot, u8::try_from(self.robot)) {
            (0, _) => write!(f, "{}", self.index),
            (_, Ok(letter)) if letter.is_ascii_alphabetic() => {
                write!(f, "{}{}", char::from(letter), self.index)
            }
            (robot, _) => write!(f, "r{robot}:{}", self.index),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_round_trip_with_the_robot_in_the_top_byte() {
        let id = (97u64 << 56) | 5;
        assert_eq!(Key::from_id(id), Key::new(97, 5));
        assert_eq!(Key::new(97, 5).to_id(), Some(id));
        assert_eq!(Key::from_id(u64::MAX).to_id(), Some(u64::MAX));
        assert_eq!(Key::new(256, 0).to_id(), None);
        assert_eq!(Key::new(97, 5).to_string(), "a5");
    }
}
