use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::RobotId;

/// What goes wrong on the channel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    /// Seed of the dice.
    pub seed: u64,
    /// Chance that a packet does not reach one of its receivers. 0 to 1.
    pub loss: f64,
    /// Chance that a packet that arrives arrives a second time, up to ten seconds later. 0 to 1.
    pub duplication: f64,
    /// Chance that a packet changes places with up to eight others that a robot hears before it acts. 0 to 1.
    pub reordering: f64,
    /// Times in which robots are cut off.
    pub outages: Vec<Outage>,
}

/// A time in which nothing that is sent is heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outage {
    /// The robot that is cut off; all of them if `None`.
    pub robot: Option<RobotId>,
    /// When it begins, seconds from the start of the mission.
    pub from_s: f64,
    /// When it is over.
    pub to_s: f64,
}

impl Outage {
    pub(super) fn silences(&self, robot: RobotId, time: f64) -> bool {
        self.robot.is_none_or(|cut_off| cut_off == robot) && (self.from_s..self.to_s).contains(&time)
    }
}

impl Faults {
    pub(super) fn check(&self) -> Result<(), Error> {
        let shares =
            [("loss", self.loss), ("duplication", self.duplication), ("reordering", self.reordering)];
        match shares.into_iter().find(|(_, share)| !(0.0..=1.0).contains(share)) {
            Some((name, value)) => Err(Error::Parameter { name, value, reason: "has to be from 0 to 1" }),
            None => Ok(()),
        }
    }
}

/// What happens to one packet on its way to one receiver.
pub(super) struct Fate {
    pub(super) lost: bool,
    /// Seconds after the first copy when the second arrives.
    pub(super) again_after: Option<f64>,
    /// Places by which it is moved in the order of delivery.
    pub(super) displaced: f64,
}

/// Saved as its seed and how often it was thrown.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(from = "(u64, u64)", into = "(u64, u64)")]
pub(super) struct Dice {
    seed: u64,
    throws: u64,
    rng: ChaCha8Rng,
}

/// Numbers drawn a throw, and words of the generator a number takes.
const NUMBERS: usize = 5;
const WORDS: u128 = 2;

impl From<(u64, u64)> for Dice {
    fn from((seed, throws): (u64, u64)) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_word_pos(u128::from(throws) * NUMBERS as u128 * WORDS);
        Dice { seed, throws, rng }
    }
}

impl From<Dice> for (u64, u64) {
    fn from(dice: Dice) -> Self {
        (dice.seed, dice.throws)
    }
}

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Dice::from((seed, 0))
    }

    /// Always the same number of throws, so that a change of one share leaves the other faults where they are.
    pub(super) fn throw(&mut self, faults: &Faults) -> Fate {
        self.throws += 1;
        let [lost, again, after, moved, places]: [f64; NUMBERS] = std::array::from_fn(|_| self.rng.random());
        Fate {
            lost: lost < faults.loss,
            again_after: (again < faults.duplication).then_some(10.0 * after),
            displaced: if moved < faults.reordering { 16.0 * places - 8.0 } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_dice_fall_as_the_others_would_have() {
        let faults = Faults { loss: 0.4, duplication: 0.3, reordering: 0.5, ..Faults::default() };
        let mut dice = Dice::new(7);
        for _ in 0..13 {
            dice.throw(&faults);
        }
        let mut saved = Dice::from(<(u64, u64)>::from(dice.clone()));
        for _ in 0..50 {
            let (a, b) = (dice.throw(&faults), saved.throw(&faults));
            assert_eq!((a.lost, a.again_after, a.displaced), (b.lost, b.again_after, b.displaced));
        }
    }
}
