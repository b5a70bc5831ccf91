//! Robots on a network that loses, repeats and mixes up hear each step whole and in order.

use std::sync::mpsc::{self, Receiver, Sender};
use std::time::Duration;

use draco::Error;
use draco::keyframe::RobotId;
use draco::network::{LockStep, Network, Patience, Stage};
use draco::transport::TeamKey;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A network in memory that loses, repeats and mixes up.
struct Poor {
    rng: ChaCha8Rng,
    others: Vec<Sender<Vec<u8>>>,
    ear: Receiver<Vec<u8>>,
    held: Vec<Vec<u8>>,
}

impl Network for Poor {
    fn send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        for other in &self.others {
            for _ in 0..[0, 1, 1, 2][self.rng.random_range(0..4)] {
                // whoever has gone hears nothing
                let _ = other.send(bytes.to_vec());
            }
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration) -> Option<Vec<u8>> {
        if let Ok(bytes) = self.ear.recv_timeout(patience) {
            self.held.push(bytes);
            self.held.extend(self.ear.try_iter());
        }
        let count = self.held.len();
        (count > 0).then(|| self.held.swap_remove(self.rng.random_range(0..count)))
    }
}

fn mesh(robots: u64) -> Vec<Poor> {
    let (senders, ears): (Vec<_>, Vec<_>) = (0..robots).map(|_| mpsc::channel()).unzip();
    let others = |of: usize| (0..senders.len()).filter(move |at| *at != of);
    let one = |(at, ear): (usize, Receiver<_>)| Poor {
        rng: ChaCha8Rng::seed_from_u64(at as u64),
        others: others(at).map(|other| senders[other].clone()).collect(),
        ear,
        held: Vec::new(),
    };
    ears.into_iter().enumerate().map(one).collect()
}

/// What robot `id` says in `step`.
fn said(id: RobotId, step: u64) -> Vec<Vec<u8>> {
    (0..(u64::from(id) * 7 + step * 5) % 9).map(|n| vec![id as u8, step as u8, n as u8]).collect()
}

/// Lets robot `id` of three do `steps` steps; returns what it heard in each and whom it no longer waits for.
/// What a robot heard, step by step, and whom it gave up on.
type Walk = (Vec<Vec<Vec<u8>>>, Vec<RobotId>);

fn walk(network: Poor, id: RobotId, steps: u64) -> Walk {
    let patience = Patience {
        start: Duration::from_secs(60),
        step: Duration::from_secs(if steps < 20 { 60 } else { 5 }),
        ask: Duration::from_millis(4),
    };
    let mut lock = LockStep::new(network, id, 0..3, TeamKey::default(), patience);
    let mut heard = Vec::new();
    for step in 0..steps {
        lock.send(step, &said(id, step), Stage::Recording).unwrap();
        heard.push(lock.gather(step).unwrap().frames);
    }
    lock.linger(Duration::from_millis(1500)).unwrap();
    (heard, lock.absent().collect())
}

fn team(steps: [u64; 3]) -> Vec<Walk> {
    let walks: Vec<_> = mesh(3)
        .into_iter()
        .zip(0..)
        .map(|(network, id)| std::thread::spawn(move || walk(network, id, steps[id as usize])))
        .collect();
    walks.into_iter().map(|walk| walk.join().unwrap()).collect()
}

#[test]
fn over_a_poor_network_everybody_hears_every_step_whole_and_in_order() {
    for (id, (heard, absent)) in (0..).zip(team([19; 3])) {
        assert!(absent.is_empty());
        for (step, frames) in (0..).zip(heard) {
            let expected: Vec<_> =
                (0..3).filter(|other| *other != id).flat_map(|other| said(other, step)).collect();
            assert_eq!(frames, expected, "robot {id} step {step}");
        }
    }
}

#[test]
fn nobody_waits_for_ever_for_a_robot_that_has_gone() {
    let walks = team([24, 6, 24]);
    for (id, other) in [(0, 2), (2, 0)] {
        let (heard, absent) = &walks[id as usize];
        assert_eq!(absent, &[1], "robot {id}");
        let expected: Vec<_> = said(other, 23);
        assert_eq!(heard[23], expected, "robot {id} still hears robot {other}");
    }
}
