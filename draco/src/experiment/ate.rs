use super::missions::{Flown, fly, mean, plans, team_ate};
use super::{Cell, Figure, Outcome, Settings, Table, published};
use crate::consistency::Method;
use crate::error::Error;
use crate::simulate::Scenario;
use crate::two_step::Optimisation;

/// Whose front end, test and optimisation a mission is flown with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Variant {
    pub(super) front_end: FrontEnd,
    pub(super) method: Method,
    pub(super) way: Optimisation,
    /// Whether closures get the kernel of those that `gcm` believes, whatever the test.
    pub(super) wide_kernel: bool,
}

/// What finds closures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrontEnd {
    /// This crate's defaults.
    Ours,
    /// As far as [`published::settings`] goes.
    Published,
}

impl FrontEnd {
    fn name(self) -> &'static str {
        match self {
            FrontEnd::Ours => "ours",
            FrontEnd::Published => "published",
        }
    }
}

impl Variant {
    /// A test under the default front end and optimisation.
    pub(super) fn ours(method: Method) -> Self {
        Variant { front_end: FrontEnd::Ours, method, way: Optimisation::TwoStep, wide_kernel: false }
    }

    /// Its name in a figure.
    fn label(self) -> String {
        match (self.front_end, self.way) {
            (FrontEnd::Published, _) => format!("published, {}", self.method),
            (FrontEnd::Ours, Optimisation::TwoStep) if self.wide_kernel => format!("{}, wide", self.method),
            (FrontEnd::Ours, Optimisation::TwoStep) => self.method.to_string(),
            (FrontEnd::Ours, way) => way.to_string(),
        }
    }

    /// Its way of estimating in a table.
    fn estimated(self) -> String {
        let kernel = if self.wide_kernel { ", wide kernel" } else { "" };
        format!("{}{kernel}", self.way)
    }
}

/// Mean error of each robot, both scenarios, every consistency test under the default optimisation, and the default
/// test under every optimisation. PCM also with the kernel that closures get from `gcm`, which tells what of the
/// difference is the choice of closures.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let tests = Method::ALL.into_iter().map(|(method, _)| Variant::ours(method));
    let ways = [Optimisation::AsCoded, Optimisation::Full];
    let ways = ways.map(|way| Variant { way, ..Variant::ours(Method::Gcm) });
    let wide = Variant { wide_kernel: true, ..Variant::ours(Method::Pcm) };
    let variants: Vec<Variant> = tests.chain(ways).chain([wide]).collect();
    let (mut outcome, flown) = compare(&variants, settings)?;
    outcome.notes.extend(Scenario::ALL.iter().filter_map(|&scenario| worse_than_pooled(&flown, scenario)));
    Ok(outcome)
}

/// Flies both scenarios with all variants.
///
/// Each robot's error is told twice: after an alignment of its own, which shows how bent its map is, and in the team's
/// frame after the one alignment of the whole team, which shows whether it lies at its place as well. A wrong group of
/// closures that moves a whole map to a wrong place is seen in the second alone.
pub(super) fn compare(
    variants: &[Variant],
    settings: &Settings<'_>,
) -> Result<(Outcome, Vec<Flown<Variant>>), Error> {
    let range = settings.seeds_or(20);
    let seeds = range.end - range.start;
    let flown = fly(&plans(&Scenario::ALL, variants, range), settings, |plan, params| {
        if plan.variant.front_end == FrontEnd::Published {
            params.robot = published::settings(plan.scenario);
        }
        params.robot.method = plan.variant.method;
        params.robot.optimisation = plan.variant.way;
        if plan.variant.wide_kernel {
            params.robot.closure.cauchy = params.robot.closure.cauchy_believed;
        }
    })?;
    let mut table = Table::new([
        "scenario",
        "front end",
        "consistency",
        "optimisation",
        "robot 1 m",
        "robot 2 m",
        "robot 3 m",
        "mean m",
        "1 in team m",
        "2 in team m",
        "3 in team m",
        "team m",
        "all merged",
        "precision %",
        "strict %",
        "recall %",
        "NEES",
        "seconds",
    ]);
    let mut runs = Table::new([
        "scenario",
        "front end",
        "consistency",
        "optimisation",
        "seed",
        "robot 1 m",
        "robot 2 m",
        "robot 3 m",
        "1 in team m",
        "2 in team m",
        "3 in team m",
        "team m",
        "merged",
        "precision %",
        "strict %",
        "NEES",
        "seconds",
    ]);
    let mut figure = Figure {
        title: format!("Position error, mean of {seeds} seeds"),
        y: "ATE, m".into(),
        categories: variants.iter().map(|v| v.label()).collect(),
        ..Figure::default()
    };
    for scenario in Scenario::ALL {
        let mut robots_dots = vec![Vec::new(); 3];
        for (index, &variant) in variants.iter().enumerate() {
            let all: Vec<&Flown<_>> =
                flown.iter().filter(|f| f.plan.scenario == scenario && f.plan.variant == variant).collect();
            let of_robot: Vec<Option<f64>> =
                (0..3).map(|at| mean(all.iter().map(|f| own_ate(f, at)))).collect();
            for (dots, ate) in robots_dots.iter_mut().zip(&of_robot) {
                dots.extend(ate.map(|ate| [index as f64, ate]));
            }
            let teams: Vec<_> = all.iter().map(|f| f.report.summary().team).collect();
            let head: [Cell; 4] = [
                scenario.name().into(),
                variant.front_end.name().into(),
                variant.method.to_string().into(),
                variant.estimated().into(),
            ];
            let merged = all.iter().filter(|f| f.report.merged().count() == f.report.robots.len()).count();
            let mut row: Vec<Cell> = head.to_vec();
            row.extend(of_robot.iter().map(|ate| Cell::number(*ate, 3)));
            row.push(Cell::number(mean(of_robot.iter().copied()), 3));
            row.extend((0..3).map(|at| Cell::number(mean(all.iter().map(|f| ate_in_team(f, at))), 3)));
            row.extend([
                Cell::number(mean(all.iter().map(|f| team_ate(&f.report))), 3),
                merged.into(),
                Cell::percent(mean(teams.iter().map(|t| t.precision))),
                Cell::percent(mean(teams.iter().map(|t| t.precision_strict))),
                Cell::percent(mean(teams.iter().map(|t| t.recall))),
                Cell::number(mean(teams.iter().map(|t| t.closure_nees)), 2),
                Cell::number(mean(all.iter().map(|f| Some(f.seconds))), 1),
            ]);
            table.push(row);
            for (f, team) in all.iter().zip(&teams) {
                let mut row: Vec<Cell> = head.to_vec();
                row.push(f.plan.seed.into());
                row.extend((0..3).map(|at| Cell::number(own_ate(f, at), 3)));
                row.extend((0..3).map(|at| Cell::number(ate_in_team(f, at), 3)));
                row.extend([
                    Cell::number(team_ate(&f.report), 3),
                    f.report.merged().count().into(),
                    Cell::percent(team.precision),
                    Cell::percent(team.precision_strict),
                    Cell::number(team.closure_nees, 2),
                    Cell::number(f.seconds, 1),
                ]);
                runs.push(row);
            }
        }
        for (at, dots) in robots_dots.into_iter().enumerate() {
            figure.dots(format!("{} {}", scenario.name(), at + 1), dots);
        }
    }
    Ok((Outcome { table, runs: Some(runs), figure, notes: Vec::new() }, flown))
}

/// Error of the robot at a place in the list by its own alignment, metres.
pub(super) fn own_ate<V>(flown: &Flown<V>, at: usize) -> Option<f64> {
    flown.report.robots.get(at)?.error().map(|error| error.rmse_m)
}

/// The same under the team's one alignment; `None` for a robot that is not merged.
pub(super) fn ate_in_team<V>(flown: &Flown<V>, at: usize) -> Option<f64> {
    let report = &flown.report;
    report.robots.get(at).and_then(|robot| report.error_in_team(robot)).map(|error| error.rmse_m)
}

/// Seeds on which `gcm` is worse than the pooled rule by more than 5 %.
fn worse_than_pooled(flown: &[Flown<Variant>], scenario: Scenario) -> Option<String> {
    let of = |method: Method| {
        let variant = Variant::ours(method);
        flown.iter().filter(move |f| f.plan.scenario == scenario && f.plan.variant == variant)
    };
    let ate = |f: &Flown<_>| mean(f.report.robots.iter().map(|r| r.error().map(|e| e.rmse_m)));
    let worse: Vec<String> = of(Method::Gcm)
        .zip(of(Method::GcmPooled))
        .filter_map(|(ours, pooled)| {
            let (a, b) = (ate(ours)?, ate(pooled)?);
            (a > 1.05 * b).then(|| format!("{} ({a:.2} m against {b:.2} m)", ours.plan.seed))
        })
        .collect();
    (!worse.is_empty()).then(|| {
        format!("{}: gcm is over 5 % worse than gcm-pooled on seeds {}", scenario.name(), worse.join(", "))
    })
}
