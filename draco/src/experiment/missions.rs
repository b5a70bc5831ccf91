//! Many simulated missions at once.

use rayon::prelude::*;

use super::Settings;
use crate::error::Error;
use crate::mission::{self, MissionParams};
use crate::report::RunReport;
use crate::simulate::{Scenario, SimulationParams, simulate};

/// One mission to fly.
#[derive(Debug, Clone)]
pub(super) struct Plan<V> {
    pub(super) scenario: Scenario,
    pub(super) seed: u64,
    /// What distinguishes it beyond that.
    pub(super) variant: V,
}

/// A mission that was flown, with the seconds of computing it took.
pub(super) struct Flown<V> {
    pub(super) plan: Plan<V>,
    pub(super) report: RunReport,
    pub(super) seconds: f64,
}

/// Every scenario with every variant and every seed, in this order.
pub(super) fn plans<V: Clone>(
    scenarios: &[Scenario],
    variants: &[V],
    seeds: std::ops::Range<u64>,
) -> Vec<Plan<V>> {
    let mut plans = Vec::new();
    for &scenario in scenarios {
        for variant in variants {
            plans.extend(seeds.clone().map(|seed| Plan { scenario, seed, variant: variant.clone() }));
        }
    }
    plans
}

/// Flies all plans; the results are in the order of the plans.
///
/// * `set` – turns a plan into the mission's settings.
pub(super) fn fly<V: Clone + Send + Sync>(
    plans: &[Plan<V>],
    settings: &Settings<'_>,
    set: impl Fn(&Plan<V>, &mut MissionParams) + Sync,
) -> Result<Vec<Flown<V>>, Error> {
    let done = std::sync::atomic::AtomicUsize::new(0);
    plans
        .par_iter()
        .map(|plan| {
            let (scenario, seed) = (plan.scenario, plan.seed);
            let data = simulate(&SimulationParams { scenario, seed, ..SimulationParams::default() })?;
            let mut params = MissionParams { seed, ..MissionParams::default() };
            set(plan, &mut params);
            let report = mission::run(&data, &params, |_| {})?;
            let seconds = report.timing.get("mission_s").copied().unwrap_or(f64::NAN);
            let count = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            let name = scenario.name();
            (settings.progress)(&format!(
                "{count} of {} missions: {name}, seed {seed}, {seconds:.0} s",
                plans.len()
            ));
            Ok(Flown { plan: plan.clone(), report, seconds })
        })
        .collect()
}

/// Mean of the values there are.
pub(super) fn mean(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = values.into_iter().flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

/// Position error of the team, metres, if at least two robots are merged.
pub(super) fn team_ate(report: &RunReport) -> Option<f64> {
    report.team_error().map(|error| error.rmse_m)
}
