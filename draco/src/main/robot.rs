//! `draco robot`: one robot of a team in a process of its own.

use std::fs;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use draco::keyframe::{MissionData, RobotId};
use draco::network::{self, FlightParams, Network, Patience, Udp};
use draco::transport::TeamKey;

use crate::progress::Teller;
use crate::{Mission, tell};

#[derive(Args)]
pub(crate) struct FlyRobot {
    /// The robot's number in the data.
    #[arg(long, value_name = "N")]
    id: RobotId,

    #[command(flatten)]
    mission: Mission,

    /// Numbers of all robots of the team; those of the data unless given.
    #[arg(long, value_name = "N,N,..", value_delimiter = ',')]
    team: Vec<RobotId>,

    /// What carries the packets.
    #[arg(long, value_name = "KIND", default_value = "udp")]
    link: Carrier,

    /// Endpoint to listen on: `127.0.0.1:7401`, with zenoh `tcp/127.0.0.1:7401`.
    #[arg(long, value_name = "ENDPOINT", required = true)]
    listen: Vec<String>,

    /// Endpoint of another robot. With udp all others are needed, with zenoh one of the two robots of a pair has to
    /// connect to the other.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,

    /// File whose text is the team's secret. Without one the packets are protected against damage, not against forgery.
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,

    /// Seconds to wait for the others at the beginning.
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = seconds)]
    wait: f64,

    /// Seconds to wait for the others in a step before going on without them.
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = seconds)]
    patience: f64,

    /// File that holds the robot's state after every step. If it exists, the robot goes on from there; it is removed when
    /// the mission ends.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Carrier {
    /// Datagrams to the addresses given.
    Udp,
    /// Zenoh, peer to peer without a router; needs a program built with the feature `zenoh`.
    Zenoh,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if (0.0..=1e6).contains(&value) { Ok(value) } else { Err("has to be from 0 to 1000000".into()) }
}

pub(crate) fn fly(arguments: &FlyRobot) -> anyhow::Result<()> {
    arguments.mission.check_output()?;
    let data = arguments.mission.load()?;
    let params = arguments.params(&data)?;
    match arguments.link {
        Carrier::Udp => {
            let [listen] = arguments.listen.as_slice() else { bail!("udp listens on one endpoint") };
            let peers = arguments.connect.iter().map(|text| address(text)).collect::<Result<_, _>>()?;
            over(arguments, &data, &params, Udp::new(address(listen)?, peers)?)
        }
        #[cfg(feature = "zenoh")]
        Carrier::Zenoh => {
            let network = network::Zenoh::open(arguments.id, &arguments.listen, &arguments.connect)?;
            over(arguments, &data, &params, network)
        }
        #[cfg(not(feature = "zenoh"))]
        Carrier::Zenoh => bail!("this program was built without the feature `zenoh`"),
    }
}

fn over(
    arguments: &FlyRobot,
    data: &MissionData,
    params: &FlightParams,
    network: impl Network,
) -> anyhow::Result<()> {
    let own = data.recordings.iter().find(|recording| recording.robot == arguments.id);
    let mut teller = Teller::new(own.map_or(0, |recording| recording.keyframes.len() as u64));
    let result = network::fly(data, arguments.id, network, params, |step| teller.tell(step));
    teller.end();
    let report = result.with_context(|| format!("robot {} of mission {}", arguments.id, data.name))?;
    tell(&report, arguments.mission.out.as_deref())
}

impl FlyRobot {
    fn params(&self, data: &MissionData) -> anyhow::Result<FlightParams> {
        let mut robot = self.mission.robot_params();
        if let Some(path) = &self.key_file {
            let phrase = fs::read_to_string(path).with_context(|| path.display().to_string())?;
            robot.transport.key = TeamKey::from_phrase(phrase.trim());
        }
        let everybody = || data.recordings.iter().map(|recording| recording.robot).collect();
        Ok(FlightParams {
            seed: self.mission.seed,
            robot,
            team: if self.team.is_empty() { everybody() } else { self.team.clone() },
            patience: Patience {
                start: Duration::from_secs_f64(self.wait),
                step: Duration::from_secs_f64(self.patience),
                ..Patience::default()
            },
            state: self.state.clone(),
            ..FlightParams::default()
        })
    }
}

fn address(text: &str) -> anyhow::Result<SocketAddr> {
    let found = text.to_socket_addrs().with_context(|| format!("endpoint `{text}`"))?.next();
    found.with_context(|| format!("endpoint `{text}` has no address"))
}
