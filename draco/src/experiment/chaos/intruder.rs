use rand::{Rng, RngExt};

use crate::dataset::{read_keyframe_tables, write_keyframe_tables};
use crate::keyframe::MissionData;
use crate::message::BROADCAST;
use crate::transport::{Packet, PacketKind, TeamKey};

/// Packets of somebody who hears everything and lacks the key: damaged and cut ones, forged ones, noise, and old ones
/// played back.
pub(super) fn hostile(heard: &[Vec<u8>], rng: &mut impl Rng) -> Vec<Vec<u8>> {
    let mut packets = Vec::new();
    for _ in 0..rng.random_range(0..12) {
        let mut bytes = match heard.len() {
            0 => Vec::new(),
            count => heard[rng.random_range(0..count)].clone(),
        };
        match rng.random_range(0..5) {
            0 => mutate(&mut bytes, rng),
            1 => bytes.truncate(rng.random_range(0..=bytes.len())),
            2 => bytes = (0..rng.random_range(0..300)).map(|_| rng.random()).collect(),
            3 => bytes = forged(rng),
            _ => {}
        }
        packets.push(bytes);
    }
    packets
}

/// Flips bits until the bytes differ.
pub(super) fn mutate(bytes: &mut [u8], rng: &mut impl Rng) {
    if bytes.is_empty() {
        return;
    }
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..bytes.len());
        bytes[at] ^= rng.random_range(1..=255_u8);
    }
}

fn forged(rng: &mut impl Rng) -> Vec<u8> {
    let kinds = [PacketKind::Part, PacketKind::LastPart, PacketKind::Status];
    let packet = Packet {
        sender: rng.random_range(0..BROADCAST.min(6)),
        epoch: rng.random_range(0..3),
        number: rng.random_range(0..400),
        kind: kinds[rng.random_range(0..3)],
        payload: (0..rng.random_range(0..60)).map(|_| rng.random()).collect(),
    };
    packet.encode(&TeamKey::from_phrase("a guess")).unwrap_or_default()
}

/// Reads tables of `data` with flipped bytes; any answer is right but a panic. Returns how many were read.
pub(super) fn read_mutated_data(data: &MissionData, rng: &mut impl Rng) -> std::io::Result<u64> {
    let (mut keyframes, mut points) = (Vec::new(), Vec::new());
    write_keyframe_tables(data, &mut keyframes, &mut points)?;
    for _ in 0..5 {
        let (mut keyframes, mut points) = (keyframes.clone(), points.clone());
        mutate(if rng.random_bool(0.5) { &mut keyframes } else { &mut points }, rng);
        // whether it is taken or refused is for other tests to say
        let _ = read_keyframe_tables(keyframes.as_slice(), points.as_slice());
    }
    Ok(5)
}
