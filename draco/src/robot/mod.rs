//! One robot as a state machine without clock, thread, file or socket.
//!
//! Keyframes go in by [`Robot::add_keyframe`], packets of other robots by [`Robot::receive`]; [`Robot::step`] thinks
//! and returns the packets to send, [`Robot::tick`] only keeps the link going. The same calls in the same order give
//! the same bits.
//!
//! With every partner a robot goes through the same stages. It compares persistent cells of both maps until they fit
//! in one clear way; looks for keyframe pairs that should overlap under this hypothesis, asks for the scans it lacks
//! and registers them; believes the hypothesis when a good share of the registrations succeeds, and forgets it
//! otherwise; lets the consistency test choose among the closures; and estimates the team's poses. Pairs of robots
//! whose maps have not been aligned this way get no closures: closures under a wrong alignment can agree with each
//! other, and no consistency test could tell.

mod align;
mod exchange;
mod judge;
pub(crate) mod maps;
mod meet;
mod partner;
mod reports;
mod retract;
mod witnesses;

use std::collections::BTreeMap;

use nalgebra::Isometry2;
use serde::{Deserialize, Serialize};

use crate::alignment::AlignmentParams;
use crate::closure::ClosureParams;
use crate::consistency::Method;
use crate::error::Error;
use crate::evaluate::Decision;
use crate::keyframe::{Keyframe, RobotId};
use crate::link::Outgoing;
use crate::local_slam::{LocalSlam, LocalSlamParams};
use crate::message::{ClosureEntry, FactorEntry, Frame, KeyframeId, WireError};
use crate::objects::{CellParams, ObjectParams, ObjectTracks};
use crate::robot_graph::RobotGraph;
use crate::transport::{Refusal, RefusalCounts, Transport, TransportParams};
use crate::two_step::{Optimisation, TeamEstimate};
pub use reports::KnownVersions;

use exchange::Outbox;
use partner::Partner;

/// Settings of a robot; the defaults are the same for all missions, simulated and recorded.
#[derive(Debug, Clone, Default)]
pub struct RobotParams {
    /// The robot's own map.
    pub local: LocalSlamParams,
    /// The persistent cells it sends.
    pub cells: CellParams,
    /// The objects it sends.
    pub objects: ObjectParams,
    /// Map-to-map alignment.
    pub alignment: AlignmentParams,
    /// Closures between robots.
    pub closure: ClosureParams,
    /// Which closures to believe.
    pub method: Method,
    /// How the team's poses are estimated.
    pub optimisation: Optimisation,
    /// When things are sent.
    pub exchange: ExchangeParams,
    /// How they are sent.
    pub transport: TransportParams,
}

/// When things are sent.
#[derive(Debug, Clone, PartialEq)]
pub struct ExchangeParams {
    /// Keyframes between two cell maps sent; by half as many both maps have to have grown from one attempt to align them to
    /// the next. Default 5: alignment gains little from one keyframe more.
    pub map_interval: usize,
    /// Keyframes between two updates of the object map. Default 1: an update tells only what has changed, and with fewer of
    /// them partners match older maps (`experiment traffic`).
    pub object_interval: usize,
    /// Keyframes asked for in one step at most. Default 20, as in the published system.
    pub scans_per_request: usize,
    /// A factor is sent again when its measurement has moved by this share of its sigma. Default 0.25.
    pub resend_sigmas: f64,
    /// An object is sent again when it has moved by this, or its sides have changed by twice this, metres. Default
    /// 0.5, the spacing of points.
    pub object_resend_m: f64,
}

impl Default for ExchangeParams {
    fn default() -> Self {
        ExchangeParams {
            map_interval: 5,
            object_interval: 1,
            scans_per_request: 20,
            resend_sigmas: 0.25,
            object_resend_m: 0.5,
        }
    }
}

/// A closure this robot proposed, and what became of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Proposal {
    entry: ClosureEntry,
    /// When it was registered, seconds.
    time: f64,
    decision: Decision,
    reason: String,
}

/// One alignment attempt worth telling.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct AlignmentEvent {
    partner: RobotId,
    time: f64,
    verdict: String,
}

/// One robot of a team.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Robot {
    id: RobotId,
    #[serde(skip)]
    params: RobotParams,
    local: LocalSlam,
    partners: BTreeMap<RobotId, Partner>,
    proposals: BTreeMap<(KeyframeId, KeyframeId), Proposal>,
    /// Accepted closures of all robots, as they are in the team's graph.
    accepted: Vec<ClosureEntry>,
    /// Closures that were accepted until the team's estimate spoke against them; in the graph under a narrow kernel.
    doubtful: Vec<ClosureEntry>,
    team: TeamEstimate,
    events: Vec<AlignmentEvent>,
    outbox: Outbox,
    tracks: ObjectTracks,
    transport: Transport,
    /// Whether anything has changed that closures and the team's estimate depend on.
    has_news: bool,
}

impl Robot {
    /// A robot with an empty map that has never spoken.
    pub fn new(id: RobotId, params: RobotParams) -> Self {
        Self::in_epoch(id, 0, params)
    }

    /// A robot with an empty map.
    ///
    /// * `epoch` – how often a robot of this number has begun with an empty map before. Partners take in nothing of an
    ///   epoch older than the newest they have heard, and forget what they knew of it when a new one begins.
    pub fn in_epoch(id: RobotId, epoch: u32, params: RobotParams) -> Self {
        Robot {
            id,
            local: LocalSlam::new(params.local.clone()),
            params,
            partners: BTreeMap::new(),
            proposals: BTreeMap::new(),
            accepted: Vec::new(),
            doubtful: Vec::new(),
            team: TeamEstimate::alone(id, &[]),
            events: Vec::new(),
            outbox: Outbox::default(),
            tracks: ObjectTracks::default(),
            transport: Transport::new(id, epoch),
            has_news: true,
        }
    }

    /// The bytes of a state file: everything but the settings. Written before the packets of a step are handed to the
    /// link, the file lets a robot go on as if its process had never ended.
    ///
    /// # Errors
    /// [`Error::State`].
    pub fn save(&self) -> Result<Vec<u8>, Error> {
        crate::state::to_bytes(self)
    }

    /// The robot in the bytes of a state file, with the settings it had.
    ///
    /// # Errors
    /// [`Error::State`] for bytes that are no whole state file. Begin a new epoch then, see [`Robot::in_epoch`].
    pub fn restore(bytes: &[u8], params: RobotParams) -> Result<Self, Error> {
        let mut robot: Robot = crate::state::from_bytes(bytes)?;
        robot.set_params(params);
        Ok(robot)
    }

    pub(crate) fn set_params(&mut self, params: RobotParams) {
        self.local.set_params(params.local.clone());
        self.params = params;
    }

    /// The robot's number.
    pub fn id(&self) -> RobotId {
        self.id
    }

    /// Takes in the next keyframe.
    ///
    /// # Errors
    /// A keyframe out of order or not finite; failures of matching and optimisation.
    pub fn add_keyframe(&mut self, keyframe: &Keyframe) -> Result<(), Error> {
        self.local.add(keyframe.clone())?;
        self.has_news = true;
        Ok(())
    }

    /// Takes in a packet from the link. What cannot be is counted and dropped; it changes nothing else.
    pub fn receive(&mut self, bytes: &[u8]) {
        let Some(received) = self.transport.receive(bytes, &self.params.transport) else { return };
        let sender = received.sender;
        if received.restarted {
            self.forget(sender);
        }
        for message in received.messages {
            let result = Frame::decode(&message).and_then(|frame| self.take_in(sender, frame));
            if let Err(error) = result {
                tracing::debug!(robot = self.id, sender, %error, "message refused");
                self.transport.refuse(match error {
                    WireError::Value { .. } => Refusal::Impossible,
                    WireError::Malformed { .. } | WireError::Trailing { .. } => Refusal::Malformed,
                });
            }
        }
    }

    /// A partner has begun anew: keyframe numbers of its former life mean nothing any more.
    fn forget(&mut self, id: RobotId) {
        self.partners.remove(&id);
        for partner in self.partners.values_mut() {
            partner.closures.retain(|(source, target), _| source.robot != id && target.robot != id);
            partner.places.remove(&id);
        }
        self.proposals.retain(|(source, _), _| source.robot != id);
        self.outbox.wanted.remove(&id);
        self.has_news = true;
    }

    /// What was refused so far, by reason.
    pub fn refusals(&self) -> &RefusalCounts {
        self.transport.refusals()
    }

    /// What was refused so far and does not occur in a sound team, however poor its link.
    pub fn refused_frames(&self) -> u64 {
        self.refusals().alarming()
    }

    /// Thinks, and returns the packets to send.
    ///
    /// * `now` – seconds from the start of the mission.
    ///
    /// # Errors
    /// Failures of registration, consistency test or optimisation on the robot's own data. What fails on the data of
    /// a partner is counted as [`Refusal::Unusable`] and does without that partner.
    pub fn step(&mut self, now: f64) -> Result<Vec<Outgoing>, Error> {
        self.rebuild_partners();
        self.meet_partners(now);
        if std::mem::take(&mut self.has_news) {
            self.choose_closures(now)?;
        }
        self.tell_news()?;
        self.tick(now)
    }

    /// Keeps the link going without thinking: returns packets that others lack, and requests for what this robot lacks.
    ///
    /// # Errors
    /// [`Error::Wire`] for a robot number that cannot be sent.
    pub fn tick(&mut self, now: f64) -> Result<Vec<Outgoing>, Error> {
        self.transport.tick(now, &self.params.transport)
    }

    /// Whether every robot that is heard has everything this robot said, and this robot everything that they did.
    pub fn is_settled(&self, now: f64) -> bool {
        self.transport.is_settled(now, &self.params.transport)
    }

    /// Poses of the robot's own map, which no other robot has influenced; the first keyframe is the origin.
    pub fn local_poses(&self) -> &[Isometry2<f64>] {
        self.local.poses()
    }

    /// The poses of all robots this one has met, in its own map frame.
    pub fn team(&self) -> &TeamEstimate {
        &self.team
    }

    /// The robot's own factors as they are sent and used in the team's graph.
    fn own_factors(&self) -> Result<Vec<FactorEntry>, Error> {
        let entry = |f: crate::local_slam::LocalFactor| FactorEntry {
            from: f.from,
            to: f.to,
            measured: f.measured,
            covariance: f.covariance,
        };
        Ok(self.local.factors()?.into_iter().map(entry).collect())
    }

    /// The robot's own graph as its partners know theirs.
    fn own_graph(&self) -> Result<RobotGraph, Error> {
        Ok(RobotGraph::from_map(self.own_factors()?, self.local.poses().to_vec()))
    }
}
