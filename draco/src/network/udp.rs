use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::time::Duration;

use super::Network;
use crate::error::Error;

/// Longest datagram.
const MOST_BYTES: usize = 65_507;

/// Datagrams that wait to be taken; more are dropped, as a socket does.
const QUEUE: usize = 8192;

/// How often the thread that listens looks whether it shall end.
const PULSE: Duration = Duration::from_millis(100);

/// Datagrams to a list of addresses.
#[derive(Debug)]
pub struct Udp {
    socket: UdpSocket,
    peers: Vec<SocketAddr>,
    heard: Receiver<Vec<u8>>,
    ends: Arc<AtomicBool>,
}

impl Udp {
    /// Listens on `listen` and sends to `peers`.
    ///
    /// # Errors
    /// [`Error::Network`] for an address that is not ours to listen on.
    pub fn new(listen: SocketAddr, peers: Vec<SocketAddr>) -> Result<Self, Error> {
        let refuse =
            |e: std::io::Error| Error::Network { endpoint: format!("udp {listen}"), reason: e.to_string() };
        let socket = UdpSocket::bind(listen).map_err(refuse)?;
        let ear = socket.try_clone().map_err(refuse)?;
        ear.set_read_timeout(Some(PULSE)).map_err(refuse)?;
        // a thread of its own empties the socket while the robot thinks
        let (sender, heard) = mpsc::sync_channel(QUEUE);
        let ends = Arc::new(AtomicBool::new(false));
        let end = Arc::clone(&ends);
        std::thread::Builder::new()
            .name("draco-udp".into())
            .spawn(move || listen_on(&ear, &sender, &end))
            .map_err(refuse)?;
        Ok(Udp { socket, peers, heard, ends })
    }

    /// The address it listens on.
    ///
    /// # Errors
    /// [`Error::Network`].
    pub fn address(&self) -> Result<SocketAddr, Error> {
        self.socket.local_addr().map_err(|e| Error::Network { endpoint: "udp".into(), reason: e.to_string() })
    }
}

fn listen_on(socket: &UdpSocket, sender: &SyncSender<Vec<u8>>, end: &AtomicBool) {
    let mut buffer = vec![0; MOST_BYTES];
    while !end.load(Ordering::Relaxed) {
        // a timeout, or word that somebody we sent to is not there: neither is news
        let Ok((length, _)) = socket.recv_from(&mut buffer) else { continue };
        let _ = sender.try_send(buffer[..length].to_vec());
    }
}

impl Drop for Udp {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
    }
}

impl Network for Udp {
    fn send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        for peer in &self.peers {
            match self.socket.send_to(bytes, peer) {
                // datagrams may be lost: the network is full, or nobody listens there
                Ok(_) => {}
                Err(e) if matches!(e.kind(), ErrorKind::ConnectionRefused | ErrorKind::WouldBlock) => {}
                Err(e) => {
                    return Err(Error::Network { endpoint: format!("udp {peer}"), reason: e.to_string() });
                }
            }
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration) -> Option<Vec<u8>> {
        self.heard.recv_timeout(patience).ok()
    }
}
