use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant, UNIX_EPOCH};

use super::{Envelope, Network, Stage};
use crate::error::Error;
use crate::keyframe::RobotId;
use crate::transport::{RefusalCounts, TeamKey};

/// How long a robot waits for the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// For all of them to be there at the beginning. Default 30 s.
    pub start: Duration,
    /// For the end of a step. Default 30 s; the longest step of the missions at hand takes some seconds.
    pub step: Duration,
    /// Before it asks for what it has not heard. Default 0.2 s.
    pub ask: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Patience {
            start: Duration::from_secs(30),
            step: Duration::from_secs(30),
            ask: Duration::from_millis(200),
        }
    }
}

/// Own steps kept to be repeated: nobody who is waited for can lack more.
const KEPT_STEPS: usize = 2;

/// Packets kept of one robot that is ahead of this one; what is over is asked for again by the transport.
const MOST_FRAMES: usize = 20_000;

/// What was heard in a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Heard {
    /// Packets, in order of sender, step and sending.
    pub frames: Vec<Vec<u8>>,
    /// How far each robot is that is waited for.
    pub stages: BTreeMap<RobotId, Stage>,
}

/// Own envelopes of the last steps, each step with its number.
pub(super) type Recent = Vec<(u64, Vec<Vec<u8>>)>;

/// Another robot of the team.
#[derive(Debug, Default)]
struct Peer {
    heard: bool,
    hears_us: bool,
    /// The newest session it has told.
    session: u64,
    /// It did not end a step in time and is not waited for.
    absent: bool,
    /// Its steps that are over, with their packets and how far it was.
    ends: BTreeMap<u64, (u32, Stage)>,
    frames: BTreeMap<(u64, u32), Vec<u8>>,
    delivered: BTreeSet<(u64, u32)>,
    /// Number of its steps of which all has been heard.
    complete: u64,
}

impl Peer {
    /// It has been started again and has done `steps` steps; what it did after them is void.
    fn begin_again(&mut self, session: u64, steps: u64) {
        self.session = session;
        if steps < self.complete {
            self.complete = steps;
            self.frames.clear();
            self.delivered.clear();
            self.ends.retain(|step, _| *step < steps);
        }
    }

    fn take_frame(&mut self, at: (u64, u32), bytes: Vec<u8>) {
        // of a complete step there can only be repetitions
        let is_new = at.0 >= self.complete && !self.delivered.contains(&at);
        if is_new && self.frames.len() < MOST_FRAMES {
            self.frames.insert(at, bytes);
        }
    }

    fn take_end(&mut self, step: u64, frames: u32, stage: Stage) {
        self.ends.insert(step, (frames, stage));
        // it repeats its last steps only
        while self.ends.len() > 8 * KEPT_STEPS {
            self.ends.pop_first();
        }
        if let Some(&oldest) = self.ends.keys().next() {
            self.delivered.retain(|(step, _)| *step >= oldest);
        }
    }

    /// Whether nothing of step `step` is missing, or it is so far on that it does not wait for us either.
    fn has_ended(&self, step: u64) -> bool {
        let Some((&newest, _)) = self.ends.last_key_value() else { return false };
        self.complete > step || newest >= step + KEPT_STEPS as u64 || self.all_of(step)
    }

    fn all_of(&self, step: u64) -> bool {
        let came = || {
            let range = (step, 0)..=(step, u32::MAX);
            self.frames.range(range.clone()).count() + self.delivered.range(range).count()
        };
        self.ends.get(&step).is_some_and(|(frames, _)| came() >= *frames as usize)
    }

    /// Everything sent up to step `step`, in order.
    fn collect(&mut self, step: u64) -> Vec<Vec<u8>> {
        let later = self.frames.split_off(&(step + 1, 0));
        let now = std::mem::replace(&mut self.frames, later);
        self.delivered.extend(now.keys());
        if self.all_of(step) {
            self.complete = self.complete.max(step + 1);
        }
        now.into_values().collect()
    }

    /// How far it was at the end of step `step`, or is now if that is longer ago.
    fn stage(&self, step: u64) -> Option<Stage> {
        let end = self.ends.get(&step).or_else(|| Some(self.ends.last_key_value()?.1));
        end.map(|(_, stage)| *stage)
    }
}

/// One robot's end of a network on which all go step by step.
#[derive(Debug)]
pub struct LockStep<N> {
    network: N,
    id: RobotId,
    key: TeamKey,
    patience: Patience,
    peers: BTreeMap<RobotId, Peer>,
    /// Tells this process from those of the same robot before it.
    session: u64,
    /// Steps done.
    steps: u64,
    recent: Recent,
    repeated_at: Option<Instant>,
    refusals: RefusalCounts,
}

impl<N: Network> LockStep<N> {
    /// Nobody has said anything yet.
    ///
    /// * `team` – the numbers of all robots; `id` may be among them.
    pub fn new(
        network: N,
        id: RobotId,
        team: impl IntoIterator<Item = RobotId>,
        key: TeamKey,
        patience: Patience,
    ) -> Self {
        let peers = team.into_iter().filter(|robot| *robot != id).map(|robot| (robot, Peer::default()));
        LockStep {
            network,
            id,
            key,
            patience,
            peers: peers.collect(),
            session: UNIX_EPOCH.elapsed().map_or(0, |since| since.as_nanos() as u64),
            steps: 0,
            recent: Recent::new(),
            repeated_at: None,
            refusals: RefusalCounts::default(),
        }
    }

    /// Waits until everybody is there and hears everybody. Who is not there in time is not waited for.
    ///
    /// * `steps` – own steps done before, with the envelopes of the last ones in `recent`.
    ///
    /// # Errors
    /// Those of the network.
    pub(super) fn start(&mut self, steps: u64, recent: Recent) -> Result<(), Error> {
        (self.steps, self.recent) = (steps, recent);
        for peer in self.peers.values_mut() {
            // what was heard before the state was saved is in the robot
            peer.complete = steps.saturating_sub(1);
        }
        let begun = Instant::now();
        let mut said: Option<Instant> = None;
        while !self.peers.values().all(|peer| peer.heard && peer.hears_us) {
            if begun.elapsed() > self.patience.start {
                self.give_up_on(|peer| !(peer.heard && peer.hears_us), "is not there");
                break;
            }
            if said.is_none_or(|at| at.elapsed() > self.patience.ask) {
                self.say_hello()?;
                said = Some(Instant::now());
            }
            self.listen(self.patience.ask / 4)?;
        }
        self.say_hello()?;
        self.repeat(|_| true)
    }

    /// Sends what the robot says in its step `step`, and that this is all.
    ///
    /// # Errors
    /// Those of the network; [`Error::Wire`] for a robot number that cannot be sent.
    pub fn send(&mut self, step: u64, frames: &[Vec<u8>], stage: Stage) -> Result<(), Error> {
        let envelopes = self.seal(step, frames, stage)?;
        self.publish(step, envelopes)
    }

    /// The envelopes of a step.
    pub(super) fn seal(&self, step: u64, frames: &[Vec<u8>], stage: Stage) -> Result<Vec<Vec<u8>>, Error> {
        let robot = self.id;
        let mut envelopes = Vec::new();
        for (number, bytes) in (0..).zip(frames) {
            let frame = Envelope::Frame { robot, step, number, bytes: bytes.clone() };
            envelopes.push(frame.encode(&self.key)?);
        }
        let end = Envelope::End { robot, step, frames: frames.len() as u32, stage };
        envelopes.push(end.encode(&self.key)?);
        Ok(envelopes)
    }

    pub(super) fn publish(&mut self, step: u64, envelopes: Vec<Vec<u8>>) -> Result<(), Error> {
        for envelope in &envelopes {
            self.network.send(envelope)?;
        }
        self.recent = with_step(&self.recent, step, envelopes);
        self.steps = step + 1;
        Ok(())
    }

    pub(super) fn recent(&self) -> &Recent {
        &self.recent
    }

    /// Waits until everybody has ended step `step` and returns what was said up to then.
    ///
    /// # Errors
    /// Those of the network.
    pub fn gather(&mut self, step: u64) -> Result<Heard, Error> {
        let begun = Instant::now();
        let mut asked = begun;
        while self.peers.values().any(|peer| !peer.absent && !peer.has_ended(step)) {
            if begun.elapsed() > self.patience.step {
                self.give_up_on(|peer| !peer.has_ended(step), "has not ended its step in time");
                break;
            }
            if asked.elapsed() > self.patience.ask {
                self.say_hello()?;
                asked = Instant::now();
            }
            self.listen(self.patience.ask / 4)?;
        }
        while self.listen(Duration::ZERO)? {}
        let mut heard = Heard::default();
        for (&robot, peer) in &mut self.peers {
            if peer.absent && peer.has_ended(step) {
                tracing::warn!(robot, step, "is back in step");
                peer.absent = false;
            }
            heard.frames.extend(peer.collect(step));
            heard.stages.extend(peer.stage(step).filter(|_| !peer.absent).map(|stage| (robot, stage)));
        }
        Ok(heard)
    }

    /// Repeats the last steps for whoever asks, for `time`.
    ///
    /// # Errors
    /// Those of the network.
    pub fn linger(&mut self, time: Duration) -> Result<(), Error> {
        let begun = Instant::now();
        while begun.elapsed() < time {
            self.listen(time / 8)?;
        }
        Ok(())
    }

    /// Robots that are not waited for.
    pub fn absent(&self) -> impl Iterator<Item = RobotId> + '_ {
        self.peers.iter().filter(|(_, peer)| peer.absent).map(|(&robot, _)| robot)
    }

    /// Envelopes that were refused, by reason.
    pub fn refusals(&self) -> &RefusalCounts {
        &self.refusals
    }

    /// Takes in one envelope; returns whether there was one.
    fn listen(&mut self, patience: Duration) -> Result<bool, Error> {
        let Some(bytes) = self.network.receive(patience) else { return Ok(false) };
        let envelope = match Envelope::decode(&bytes, &self.key) {
            Ok(envelope) => envelope,
            Err(refusal) => {
                self.refusals.add(refusal);
                return Ok(true);
            }
        };
        // own ones come back on some networks, and strangers may use the same
        let Some(peer) = self.peers.get_mut(&envelope.robot()) else { return Ok(true) };
        peer.heard = true;
        match envelope {
            Envelope::Frame { step, number, bytes, .. } => {
                peer.hears_us = true;
                peer.take_frame((step, number), bytes);
            }
            Envelope::End { step, frames, stage, .. } => {
                peer.hears_us = true;
                peer.take_end(step, frames, stage);
            }
            Envelope::Hello { robot, session, steps, heard } => {
                if session > peer.session {
                    peer.begin_again(session, steps);
                }
                let has = heard.iter().find(|(of, _)| *of == self.id).map(|(_, steps)| *steps);
                peer.hears_us |= has.is_some();
                tracing::debug!(robot, ?has, "hello");
                if has.is_none() && !self.recent.is_empty() {
                    // it has begun again
                    self.say_hello()?;
                }
                self.repeat(|step| has.is_none_or(|has| step >= has))?;
            }
        }
        Ok(true)
    }

    fn say_hello(&mut self) -> Result<(), Error> {
        let heard = self.peers.iter().filter(|(_, peer)| peer.heard);
        let heard = heard.map(|(&robot, peer)| (robot, peer.complete)).collect();
        let hello = Envelope::Hello { robot: self.id, session: self.session, steps: self.steps, heard };
        self.network.send(&hello.encode(&self.key)?)
    }

    /// Says the last steps again that `wanted` chooses; not more often than somebody would ask.
    fn repeat(&mut self, wanted: impl Fn(u64) -> bool) -> Result<(), Error> {
        let steps: Vec<_> = self.recent.iter().filter(|(step, _)| wanted(*step)).collect();
        if steps.is_empty() || self.repeated_at.is_some_and(|at| at.elapsed() < self.patience.ask / 2) {
            return Ok(());
        }
        for envelope in steps.into_iter().flat_map(|(_, envelopes)| envelopes) {
            self.network.send(envelope)?;
        }
        self.repeated_at = Some(Instant::now());
        Ok(())
    }

    fn give_up_on(&mut self, late: impl Fn(&Peer) -> bool, what: &str) {
        for (&robot, peer) in self.peers.iter_mut().filter(|(_, peer)| !peer.absent && late(peer)) {
            tracing::warn!("robot {robot} {what}; robot {} goes on without waiting for it", self.id);
            peer.absent = true;
        }
    }
}

/// `recent` with the envelopes of one step more.
pub(super) fn with_step(recent: &Recent, step: u64, envelopes: Vec<Vec<u8>>) -> Recent {
    let kept = recent.len().saturating_sub(KEPT_STEPS - 1);
    let mut recent: Recent = recent[kept..].to_vec();
    recent.push((step, envelopes));
    recent
}
