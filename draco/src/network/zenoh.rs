use std::fmt;
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

use zenoh::Wait;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session};

use super::Network;
use crate::error::Error;
use crate::keyframe::RobotId;

/// Envelopes that wait to be taken; a team in step has far fewer.
const QUEUE: usize = 65_536;

/// A zenoh session, peer to peer: no router, no scouting, only the endpoints given.
pub struct Zenoh {
    session: Session,
    publisher: Publisher<'static>,
    heard: Receiver<Vec<u8>>,
    _subscriber: Subscriber<()>,
}

impl fmt::Debug for Zenoh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Zenoh")
            .field("publisher", &self.publisher.key_expr().as_str())
            .finish_non_exhaustive()
    }
}

impl Zenoh {
    /// Opens a session.
    ///
    /// * `id` – this robot's number; it speaks on `draco/<id>` and hears `draco/*`.
    /// * `listen`, `connect` – endpoints as zenoh writes them, such as `tcp/127.0.0.1:7447`. Every pair of robots needs one
    ///   that one of them listens on and the other connects to. Who is not there yet is tried again.
    ///
    /// # Errors
    /// [`Error::Network`] for endpoints that cannot be used.
    pub fn open(id: RobotId, listen: &[String], connect: &[String]) -> Result<Self, Error> {
        let refuse = |e: zenoh::Error| Error::Network { endpoint: "zenoh".into(), reason: one_line(&e) };
        let session = zenoh::open(config(listen, connect)?).wait().map_err(refuse)?;
        let publisher = session
            .declare_publisher(format!("draco/{id}"))
            .congestion_control(CongestionControl::Block)
            .wait()
            .map_err(refuse)?;
        let (sender, heard) = mpsc::sync_channel(QUEUE);
        let subscriber = session
            .declare_subscriber("draco/*")
            // the robot may think for seconds; zenoh's threads must not wait for it
            .callback(move |sample| {
                let _ = sender.try_send(sample.payload().to_bytes().into_owned());
            })
            .wait()
            .map_err(refuse)?;
        Ok(Zenoh { session, publisher, heard, _subscriber: subscriber })
    }
}

fn config(listen: &[String], connect: &[String]) -> Result<Config, Error> {
    let list = |endpoints: &[String]| serde_json::json!(endpoints).to_string();
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("listen/endpoints", list(listen)),
        ("connect/endpoints", list(connect)),
        (
            "connect/retry",
            r#"{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }"#.into(),
        ),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
    ] {
        let refuse =
            |e: zenoh::Error| Error::Network { endpoint: format!("{key} {value}"), reason: one_line(&e) };
        config.insert_json5(key, &value).map_err(refuse)?;
    }
    Ok(config)
}

fn one_line(error: &zenoh::Error) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Drop for Zenoh {
    fn drop(&mut self) {
        if let Err(error) = self.session.close().wait() {
            tracing::debug!(%error, "closing the zenoh session");
        }
    }
}

impl Network for Zenoh {
    fn send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let refuse = |e: zenoh::Error| Error::Network { endpoint: "zenoh".into(), reason: one_line(&e) };
        self.publisher.put(bytes).wait().map_err(refuse)
    }

    fn receive(&mut self, patience: Duration) -> Option<Vec<u8>> {
        self.heard.recv_timeout(patience).ok()
    }
}
