use std::collections::BTreeMap;

use nalgebra::SVector;

use super::beam::{Beam, Hypothesis, State};
use super::clusters::Cluster;
use super::params::{GcmParams, from_log_odds, log_odds};
use super::votes::{Kind, Votes};
use crate::Pose;

/// What the beams found of each cluster, of all or of one block's.
#[derive(Debug, Clone)]
pub(crate) struct Findings {
    /// Posterior of the state `good`.
    pub(crate) sound: Vec<f64>,
    /// Of a slip, a yaw slip, a gross error.
    pub(crate) faults: Vec<[f64; 3]>,
    /// Estimated shift and the clusters that share it, under the best hypothesis.
    pub(crate) slips: BTreeMap<usize, (Vec<f64>, Vec<usize>)>,
    pub(crate) dropped: f64,
    pub(crate) drift_scale: f64,
}

impl Findings {
    pub(crate) fn new(clusters: usize) -> Self {
        Self {
            sound: vec![0.0; clusters],
            faults: vec![[0.0; 3]; clusters],
            slips: BTreeMap::new(),
            dropped: f64::NEG_INFINITY,
            drift_scale: 1.0,
        }
    }

    /// Adds what was found of the clusters `chosen` of one block.
    pub(crate) fn absorb(&mut self, chosen: &[usize], block: &Self) {
        for (local, &cluster) in chosen.iter().enumerate() {
            self.sound[cluster] = block.sound[local];
            self.faults[cluster] = block.faults[local];
            if let Some((offset, members)) = block.slips.get(&local) {
                let members = members.iter().map(|&m| chosen[m]).collect();
                self.slips.insert(cluster, (offset.clone(), members));
            }
        }
        self.dropped = self.dropped.max(block.dropped);
        self.drift_scale = self.drift_scale.max(block.drift_scale);
    }

    /// Raises the evidence on each cluster, its posterior odds over its prior odds, to the power `evidence_exponent`, and
    /// takes `doubt` from its log odds.
    pub(crate) fn weigh_evidence(&mut self, clusters: &[Cluster], params: &GcmParams) {
        for (sound, cluster) in self.sound.iter_mut().zip(clusters) {
            let prior = log_odds(params.sound_share(cluster.members.len() == 1));
            let evidence = params.evidence_exponent * (log_odds(*sound) - prior);
            *sound = from_log_odds(prior + evidence - params.doubt);
        }
    }

    /// Adds the posterior over the clusters `chosen`, `of` being the probability of the drift scale that it was found
    /// with.
    pub(crate) fn add<const N: usize>(
        &mut self,
        votes: &Votes<N>,
        chosen: &[usize],
        beam: &Beam<N>,
        of: f64,
    ) {
        let Some(best) = beam.best() else { return };
        let weights: Vec<f64> = beam.hypotheses.iter().map(|h| (h.weight - best.weight).exp()).collect();
        let total: f64 = weights.iter().sum();
        for (t, vote) in votes.list.iter().enumerate() {
            let Kind::Cluster { cluster, .. } = vote.kind else { continue };
            let Ok(local) = chosen.binary_search(&cluster) else { continue };
            for (hypothesis, weight) in beam.hypotheses.iter().zip(&weights) {
                let share = of * weight / total;
                match hypothesis.states[t] {
                    State::Good => self.sound[local] += share,
                    State::Slip(_) => self.faults[local][0] += share,
                    State::YawSlip => self.faults[local][1] += share,
                    State::Gross | State::Elsewhere | State::BadPrior => self.faults[local][2] += share,
                }
            }
        }
    }

    /// Adds the slips of the best hypothesis, from its `K_H⁻¹ ρ`.
    pub(crate) fn add_slips<const N: usize, G: Pose<N>>(
        &mut self,
        votes: &Votes<N>,
        chosen: &[usize],
        best: &Hypothesis<N>,
        solution: &[SVector<f64, N>],
    ) {
        let mut slips: BTreeMap<State, (SVector<f64, N>, Vec<usize>)> = BTreeMap::new();
        for ((vote, state), x) in votes.list.iter().zip(&best.states).zip(solution) {
            if let (Kind::Cluster { cluster, .. }, State::Slip(_)) = (&vote.kind, state) {
                let slip = slips.entry(*state).or_insert((SVector::zeros(), Vec::new()));
                slip.0 += votes.slip.searched() * x;
                slip.1.extend(chosen.binary_search(cluster));
            }
        }
        for (shift, members) in slips.into_values() {
            let offset: Vec<f64> = shift.rows(0, G::TRANSLATION).iter().copied().collect();
            for &member in &members {
                self.slips.insert(member, (offset.clone(), members.clone()));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_is_raised_to_its_power_about_the_prior_share_and_doubted() {
        let doubt = 3.0f64.ln();
        let params =
            GcmParams { evidence_exponent: 2.0, sound: 0.7, sound_single: 0.6, doubt, ..Default::default() };
        let cluster =
            |size: usize| Cluster { robots: (0, 1), group: 0, members: (0..size).collect(), is_main: true };
        let clusters = [2, 2, 2, 2, 2, 1, 1].map(cluster);
        let mut findings = Findings::new(clusters.len());
        // of groups: nothing known, odds of 21 to 1 where 7 to 3 were thought, certain either way;
        // of lone ones: nothing, less
        findings.sound = vec![0.7, 21.0 / 22.0, 1.0, 1.0 + 1e-15, 0.0, 0.6, 0.5];
        findings.weigh_evidence(&clusters, &params);
        let share = |odds: f64| odds / 3.0 / (1.0 + odds / 3.0);
        let lone = 1.5 * (1.0f64 / 1.5).powi(2);
        let expected = [share(7.0 / 3.0), share(7.0 / 3.0 * 81.0), 1.0, 1.0, 0.0, share(1.5), share(lone)];
        for (p, expected) in findings.sound.iter().zip(expected) {
            assert!((p - expected).abs() < 1e-12, "{p} {expected}");
        }
    }
}
