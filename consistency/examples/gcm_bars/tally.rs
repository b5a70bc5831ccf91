//! Counts of rules against the truth, and the bars judged by them.

use std::time::Duration;

use draco_consistency::simulate::{Label, SimulatedTeam};
use draco_consistency::{Gcm, Selection};
use nalgebra::Isometry2;

use crate::cells::Bar;

pub(crate) type Team = SimulatedTeam<Isometry2<f64>, 3>;

/// Kept and all.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Share {
    pub(crate) kept: usize,
    pub(crate) all: usize,
}

impl Share {
    fn add(&mut self, kept: bool) {
        self.kept += usize::from(kept);
        self.all += 1;
    }

    /// Zero of none.
    pub(crate) fn value(&self) -> f64 {
        if self.all == 0 { 0.0 } else { self.kept as f64 / self.all as f64 }
    }
}

/// Closures of one rule in one cell.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Tally {
    pub(crate) good: Share,
    pub(crate) biased: Share,
    pub(crate) gross: Share,
    pub(crate) good_open: Share,
    pub(crate) biased_open: Share,
}

impl Tally {
    pub(crate) fn add(&mut self, team: &Team, selection: &Selection) {
        for (m, label) in team.labels.iter().enumerate() {
            let kept = selection.accepts(m);
            let is_open = selection.undecided.binary_search_by_key(&m, |r| r.closure).is_ok();
            match label {
                Label::Good => {
                    self.good.add(kept);
                    self.good_open.add(is_open);
                }
                Label::Biased => {
                    self.biased.add(kept);
                    self.biased_open.add(is_open);
                }
                Label::Gross | Label::Aliased => self.gross.add(kept),
                Label::Slight => {}
            }
        }
    }

    pub(crate) fn precision(&self) -> f64 {
        let all = self.good.kept + self.biased.kept + self.gross.kept;
        Share { kept: self.good.kept, all }.value()
    }

    fn open(&self) -> f64 {
        let (good, biased) = (self.good_open, self.biased_open);
        Share { kept: good.kept + biased.kept, all: good.all + biased.all }.value()
    }

    /// Biased accepted / good kept / precision.
    pub(crate) fn text(&self) -> String {
        let biased = if self.biased.all == 0 { "-".into() } else { format!("{:.3}", self.biased.value()) };
        let good = if self.good.all == 0 { "-".into() } else { format!("{:.3}", self.good.value()) };
        let precision = self.precision();
        if precision == 0.0 {
            format!("{biased}/{good}/-")
        } else {
            format!("{biased}/{good}/{precision:.3}")
        }
    }
}

/// Groups of one bin of P.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Bin {
    pub(crate) sum: f64,
    pub(crate) sound: Share,
}

const BIN_EDGES: [f64; 6] = [0.0, 0.25, 0.5, 0.7, 0.85, 0.95];
const FEWEST_GROUPS: usize = 50;

/// All rules in one cell.
#[derive(Debug, Default, Clone)]
pub(crate) struct Results {
    pub(crate) pcm: Tally,
    pub(crate) pooled: Tally,
    pub(crate) group: Tally,
    pub(crate) one_vote: Tally,
    pub(crate) ours: Tally,
    pub(crate) leading: Tally,
    pub(crate) bins: [Bin; 6],
    /// Of our rule.
    pub(crate) time: Duration,
}

impl Results {
    /// Groups of at least two closures that are clearly right or wrong.
    pub(crate) fn calibrate(&mut self, team: &Team, found: &Gcm<3>) {
        for cluster in found.clusters.iter().filter(|c| c.members.len() > 1) {
            let label = team.labels[cluster.members[0]];
            if label == Label::Slight {
                continue;
            }
            let at = BIN_EDGES.iter().rposition(|edge| cluster.probability >= *edge).unwrap_or(0);
            self.bins[at].sum += cluster.probability;
            self.bins[at].sound.add(label == Label::Good);
        }
    }

    /// Mean P / share of sound groups (groups), bin by bin.
    pub(crate) fn calibration(&self) -> String {
        let bins = self.bins.iter().filter(|bin| bin.sound.all > 0);
        let texts = bins.map(|bin| {
            format!("{:.2}/{:.2} ({})", bin.sum / bin.sound.all as f64, bin.sound.value(), bin.sound.all)
        });
        texts.collect::<Vec<_>>().join("  ")
    }

    /// The bar in words and whether it is met.
    pub(crate) fn judge(&self, bar: Bar) -> (String, bool) {
        let most = |name: &str, is: f64, bar: f64| (format!("{name} {is:.3} <= {bar:.3}"), is <= bar + 1e-9);
        let least = |name: &str, is: f64, bar: f64| (format!("{name} {is:.3} >= {bar:.3}"), is >= bar - 1e-9);
        match bar {
            Bar::Biased(bar) => most("biased", self.ours.biased.value(), bar),
            Bar::Good(bar) => least("good", self.ours.good.value(), bar),
            Bar::Precision(bar) => least("precision", self.ours.precision(), bar),
            Bar::LeadingBiased(bar) => most("leading biased", self.leading.biased.value(), bar),
            Bar::LeadingGood(bar) => least("leading good", self.leading.good.value(), bar),
            Bar::Undecided(bar) => least("undecided", self.ours.open(), bar),
            Bar::Calibrated(slack) => {
                let counted = self.bins.iter().filter(|bin| bin.sound.all >= FEWEST_GROUPS);
                let short = counted.map(|bin| bin.sum / bin.sound.all as f64 - bin.sound.value());
                most("P above the share of sound groups by", short.fold(0.0, f64::max), slack)
            }
            Bar::AgainstPcm(ratio, better) => {
                let (ours, pcm) = (&self.ours, &self.pcm);
                let (of_biased, of_good) = (
                    most("biased", ours.biased.value(), ratio * pcm.biased.value()),
                    least("good", ours.good.value(), pcm.good.value() + better),
                );
                (format!("against pcm {}, {}", of_biased.0, of_good.0), of_biased.1 && of_good.1)
            }
            Bar::AgainstPooled(better, worse) => {
                let (ours, pooled) = (&self.ours, &self.pooled);
                let (of_biased, of_good) = (
                    most("biased", ours.biased.value(), pooled.biased.value() + worse),
                    least("good", ours.good.value(), pooled.good.value() + better),
                );
                (format!("against pooled {}, {}", of_biased.0, of_good.0), of_biased.1 && of_good.1)
            }
        }
    }
}
