use draco_consistency::simulate::{Harbor, Label, SimulatedTeam, harbor};
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{Cell, Figure, Outcome, Settings, Table};
use crate::consistency::{Evidence, Method, select};
use crate::error::Error;

/// Errors of the map alignment that are tried, metres.
const PRIOR_SIGMAS: [f64; 5] = [0.05, 0.3, 0.5, 1.0, 2.0];

/// Counts over one team.
#[derive(Debug, Default, Clone, Copy)]
struct Counts {
    good: usize,
    good_kept: usize,
    biased: usize,
    biased_kept: usize,
    kept: usize,
    kept_right: usize,
}

/// Correlated groups of wrong closures among good ones, from the generator of `draco-consistency`: a third of the groups
/// is biased. Which of both does each test accept, by the error of the map alignment it is given?
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(100);
    let seeds = range.end - range.start;
    let mut table =
        Table::new(["consistency", "alignment error m", "biased accepted %", "good kept %", "precision %"]);
    let mut figure = Figure {
        title: format!("Biased closures accepted, {seeds} teams"),
        x: "error of the map alignment, m".into(),
        y: "biased accepted, %".into(),
        ..Figure::default()
    };
    for (method, name) in Method::ALL {
        let mut points = Vec::new();
        for sigma in PRIOR_SIGMAS {
            let teams: Vec<Counts> = range
                .clone()
                .into_par_iter()
                .map(|seed| judge(method, sigma, seed))
                .collect::<Result<_, _>>()?;
            let share = |part: fn(&Counts) -> usize, whole: fn(&Counts) -> usize| {
                let (part, whole): (usize, usize) =
                    (teams.iter().map(part).sum(), teams.iter().map(whole).sum());
                part as f64 / whole as f64
            };
            let biased = share(|c| c.biased_kept, |c| c.biased);
            points.push([sigma, 100.0 * biased]);
            table.push([
                name.into(),
                Cell::number(sigma, 2),
                Cell::percent(biased),
                Cell::percent(share(|c| c.good_kept, |c| c.good)),
                Cell::percent(share(|c| c.kept_right, |c| c.kept)),
            ]);
        }
        figure.line(name, points);
        (settings.progress)(name);
    }
    let notes = vec![
        "three robots, eleven groups of 3 to 12 closures, 30 % of them biased, 5 % gross outliers".into(),
    ];
    Ok(Outcome { table, runs: None, figure, notes })
}

fn judge(method: Method, prior_sigma: f64, seed: u64) -> Result<Counts, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let team: SimulatedTeam<Isometry2<f64>, 3> =
        harbor(&Harbor { prior_sigma, ..Harbor::default() }, &mut rng)?;
    let labels = team.labels;
    let evidence = Evidence {
        reference: 0,
        trajectories: team.trajectories,
        closures: team.closures,
        map_transforms: team.priors,
    };
    let accepted = select(method, &evidence)?.selection.accepted;
    let mut counts = Counts::default();
    for (index, label) in labels.iter().enumerate() {
        let kept = usize::from(accepted.contains(&index));
        let (good, biased) = (usize::from(*label == Label::Good), usize::from(*label == Label::Biased));
        counts.good += good;
        counts.biased += biased;
        counts.good_kept += good * kept;
        counts.biased_kept += biased * kept;
        // slightly biased closures are neither
        let judged = usize::from(*label != Label::Slight);
        counts.kept += judged * kept;
        counts.kept_right += good * kept;
    }
    Ok(counts)
}
