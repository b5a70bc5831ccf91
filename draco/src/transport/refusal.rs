use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Why a robot would not take in what it heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Refusal {
    /// Too short to be a packet.
    Length,
    /// A version of the wire format that this program does not speak.
    Version,
    /// The tag is wrong: another key, or damage on the way.
    Tag,
    /// Heard before. Every link that repeats packets has these; they are no sign of anything wrong.
    Duplicate,
    /// A packet of the robot's own, repeated by another; harmless too.
    Own,
    /// A number that is older than what has been taken in and cannot be a repetition: a replay.
    Old,
    /// So far ahead of what has arrived that it is not kept; it will be asked for again.
    Ahead,
    /// The tag is right, but the contents do not parse.
    Malformed,
    /// The contents parse, but say what cannot be.
    Impossible,
    /// Possible by itself, but nothing can be computed with it.
    Unusable,
}

impl Refusal {
    /// The word for it in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Refusal::Length => "length",
            Refusal::Version => "version",
            Refusal::Tag => "tag",
            Refusal::Duplicate => "duplicate",
            Refusal::Own => "own",
            Refusal::Old => "old",
            Refusal::Ahead => "ahead",
            Refusal::Malformed => "malformed",
            Refusal::Impossible => "impossible",
            Refusal::Unusable => "unusable",
        }
    }

    /// Whether a sound team over a poor link produces it.
    pub fn is_harmless(self) -> bool {
        matches!(self, Refusal::Duplicate | Refusal::Own | Refusal::Ahead)
    }
}

/// How often each [`Refusal`] occurred.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RefusalCounts(BTreeMap<Refusal, u64>);

impl RefusalCounts {
    pub(crate) fn add(&mut self, refusal: Refusal) {
        *self.0.entry(refusal).or_default() += 1;
    }

    /// The reasons that occurred, with their counts.
    pub fn iter(&self) -> impl Iterator<Item = (Refusal, u64)> + '_ {
        self.0.iter().map(|(&refusal, &count)| (refusal, count))
    }

    /// How often `refusal` occurred.
    pub fn of(&self, refusal: Refusal) -> u64 {
        self.0.get(&refusal).copied().unwrap_or(0)
    }

    /// Refusals that are not harmless.
    pub fn alarming(&self) -> u64 {
        self.iter().filter(|(refusal, _)| !refusal.is_harmless()).map(|(_, count)| count).sum()
    }
}
