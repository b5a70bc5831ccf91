//! One robot as a state machine without clock, thread, file or socket.
//!
//! Keyframes go in by [`Robot::add_keyframe`], frames of other robots by [`Robot::receive`]; [`Robot::step`] thinks
//! and returns the frames to send. The same calls in the same order give the same bits.
//!
//! With every partner a robot goes through the same stages. It compares persistent cells of both maps until they fit
//! in one clear way; looks for keyframe pairs that should overlap under this hypothesis, asks for the scans it lacks
//! and registers them; believes the hypothesis when a good share of the registrations succeeds, and forgets it
//! otherwise; lets the consistency test choose among the closures; and estimates the team's poses. Pairs of robots
//! whose maps have not been aligned this way get no closures: closures under a wrong alignment can agree with each
//! other, and no consistency test could tell.

mod exchange;
mod meet;
mod partner;
mod reports;

use std::collections::BTreeMap;

use nalgebra::Isometry2;

use crate::alignment::AlignmentParams;
use crate::closure::ClosureParams;
use crate::consistency::Method;
use crate::error::Error;
use crate::evaluate::Decision;
use crate::keyframe::{Keyframe, RobotId};
use crate::link::Outgoing;
use crate::local_slam::{LocalSlam, LocalSlamParams};
use crate::message::{ClosureEntry, FactorEntry, Frame, KeyframeId, WireError};
use crate::objects::{CellParams, ObjectParams};
use crate::two_step::{Optimisation, TeamEstimate};
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
}

/// When things are sent.
#[derive(Debug, Clone, PartialEq)]
pub struct ExchangeParams {
    /// Keyframes between two maps sent. Default 5: alignment gains little from one keyframe more.
    pub map_interval: usize,
    /// Keyframes asked for in one step at most. Default 20, as in the published system.
    pub scans_per_request: usize,
    /// A factor is sent again when its measurement has moved by this share of its sigma. Default 0.25.
    pub resend_sigmas: f64,
}

impl Default for ExchangeParams {
    fn default() -> Self {
        ExchangeParams { map_interval: 5, scans_per_request: 20, resend_sigmas: 0.25 }
    }
}

/// A closure this robot proposed, and what became of it.
#[derive(Debug, Clone)]
struct Proposal {
    entry: ClosureEntry,
    /// When it was registered, seconds.
    time: f64,
    decision: Decision,
    reason: String,
}

/// One alignment attempt worth telling.
#[derive(Debug, Clone)]
struct AlignmentEvent {
    partner: RobotId,
    time: f64,
    verdict: String,
}

/// One robot of a team.
#[derive(Debug)]
pub struct Robot {
    id: RobotId,
    params: RobotParams,
    local: LocalSlam,
    partners: BTreeMap<RobotId, Partner>,
    proposals: BTreeMap<(KeyframeId, KeyframeId), Proposal>,
    /// Accepted closures of all robots, as they are in the team's graph.
    accepted: Vec<ClosureEntry>,
    team: TeamEstimate,
    events: Vec<AlignmentEvent>,
    outbox: Outbox,
    /// Frames that could not be decoded or contradict themselves.
    refused: u64,
}

impl Robot {
    /// A robot with an empty map.
    pub fn new(id: RobotId, params: RobotParams) -> Self {
        Robot {
            id,
            local: LocalSlam::new(params.local.clone()),
            params,
            partners: BTreeMap::new(),
            proposals: BTreeMap::new(),
            accepted: Vec::new(),
            team: TeamEstimate::alone(id, &[]),
            events: Vec::new(),
            outbox: Outbox::default(),
            refused: 0,
        }
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
        Ok(())
    }

    /// Takes in a frame from the link. A frame that does not decode, or says what cannot be, is counted and dropped.
    pub fn receive(&mut self, bytes: &[u8]) {
        let result = Frame::decode(bytes).and_then(|frame| self.take_in(frame));
        if let Err(error) = result {
            self.refused += 1;
            tracing::warn!(robot = self.id, %error, "frame refused");
        }
    }

    /// Frames that were refused so far.
    pub fn refused_frames(&self) -> u64 {
        self.refused
    }

    /// Thinks, and returns what to send.
    ///
    /// * `now` – seconds from the start of the mission.
    ///
    /// # Errors
    /// Failures of registration, consistency test or optimisation.
    pub fn step(&mut self, now: f64) -> Result<Vec<Outgoing>, Error> {
        self.meet_partners(now)?;
        self.choose_closures()?;
        self.frames_to_send()
    }

    /// Poses of the robot's own map, which no other robot has influenced; the first keyframe is the origin.
    pub fn local_poses(&self) -> &[Isometry2<f64>] {
        self.local.poses()
    }

    /// The poses of all robots this one has met, in its own map frame.
    pub fn team(&self) -> &TeamEstimate {
        &self.team
    }

    fn partner(&mut self, id: RobotId) -> Result<&mut Partner, WireError> {
        if id == self.id {
            return Err(WireError::Value { what: "a frame from another robot with this robot's number" });
        }
        Ok(self.partners.entry(id).or_default())
    }

    /// The robot's own factors as they are sent and used in the team's graph.
    fn own_factors(&self) -> Vec<FactorEntry> {
        let entry = |f: crate::local_slam::LocalFactor| FactorEntry {
            from: f.from,
            to: f.to,
            measured: f.measured,
            covariance: f.covariance,
        };
        self.local.factors().into_iter().map(entry).collect()
    }
}
