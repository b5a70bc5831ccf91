use std::fmt;
use std::str::FromStr;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Delivery, Direct, Modem, ModemParams, Outgoing, Transmission};
use crate::error::Error;
use crate::keyframe::RobotId;

/// How the robots of a mission in one process are connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ChannelKind {
    /// By the modelled acoustic modem.
    #[default]
    Modem,
    /// Without one: a step hears everything that the last one sent. Every robot goes by its own clock, so that the same
    /// mission with a process for each robot ends with the same bits.
    Direct,
}

impl ChannelKind {
    /// All kinds with their names on the command line.
    pub const ALL: [(ChannelKind, &'static str); 2] =
        [(ChannelKind::Modem, "modem"), (ChannelKind::Direct, "direct")];
}

impl fmt::Display for ChannelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(ChannelKind::ALL.iter().find(|(kind, _)| kind == self).map_or("", |(_, name)| name))
    }
}

impl FromStr for ChannelKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = ChannelKind::ALL.map(|(_, name)| name).join(", ");
        let found = ChannelKind::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(kind, _)| *kind).ok_or_else(|| format!("no such link; there are {names}"))
    }
}

/// What connects the robots of a mission in one process.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum Channel {
    Modem(Box<Modem>),
    Direct(Direct),
}

impl Channel {
    pub(crate) fn new(
        kind: ChannelKind,
        params: &ModemParams,
        robots: impl IntoIterator<Item = RobotId>,
        longest_packet: usize,
    ) -> Result<Self, Error> {
        Ok(match kind {
            ChannelKind::Modem => Channel::Modem(Box::new(Modem::new(params, robots, longest_packet)?)),
            ChannelKind::Direct => Channel::Direct(Direct::new(robots)),
        })
    }

    pub(crate) fn set_params(&mut self, params: &ModemParams) {
        if let Channel::Modem(modem) = self {
            modem.set_params(params.clone());
        }
    }

    /// Rounds in which robots keep the link going within `seconds`.
    pub(crate) fn rounds(&self, seconds: f64) -> usize {
        match self {
            Channel::Modem(modem) => (seconds / modem.cycle_s()).ceil() as usize,
            Channel::Direct(_) => 1,
        }
    }

    pub(crate) fn place(&mut self, robot: RobotId, place: Option<Point2<f64>>) {
        if let Channel::Modem(modem) = self {
            modem.place(robot, place);
        }
    }

    pub(crate) fn send(&mut self, now: f64, sender: RobotId, packet: Outgoing) -> Result<(), Error> {
        match self {
            Channel::Modem(modem) => modem.send(now, sender, packet),
            Channel::Direct(direct) => direct.send(now, sender, packet),
        }
    }

    pub(crate) fn receive(&mut self, now: f64) -> Vec<Delivery> {
        match self {
            Channel::Modem(modem) => modem.receive(now),
            Channel::Direct(direct) => direct.receive(now),
        }
    }

    pub(crate) fn is_idle(&self) -> bool {
        match self {
            Channel::Modem(modem) => modem.is_idle(),
            Channel::Direct(direct) => direct.is_idle(),
        }
    }

    pub(crate) fn log(&self) -> &[Transmission] {
        match self {
            Channel::Modem(modem) => modem.log(),
            Channel::Direct(direct) => direct.log(),
        }
    }

    /// Bits that still wait to be sent.
    pub(crate) fn waiting_bits(&self) -> u64 {
        match self {
            Channel::Modem(modem) => modem.waiting_bits(),
            Channel::Direct(_) => 0,
        }
    }

    /// Bits a second, where there is a limit.
    pub(crate) fn rate_bps(&self, params: &ModemParams) -> Option<f64> {
        matches!(self, Channel::Modem(_)).then_some(params.rate_bps)
    }
}
