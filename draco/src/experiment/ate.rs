use super::missions::{Flown, fly, mean, plans, team_ate};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::consistency::Method;
use crate::error::Error;
use crate::simulate::Scenario;
use crate::two_step::Optimisation;

/// What is compared: all tests under the default optimisation, and the default test under all optimisations.
fn variants() -> Vec<(Method, Optimisation)> {
    let tests = Method::ALL.into_iter().map(|(method, _)| (method, Optimisation::TwoStep));
    tests.chain([Optimisation::AsCoded, Optimisation::Full].map(|way| (Method::Gcm, way))).collect()
}

/// Mean error of each robot, both scenarios, every consistency test and every optimisation.
///
/// Each robot's error is told twice: after an alignment of its own, which shows how bent its map is, and in the team's
/// frame after the one alignment of the whole team, which shows whether it lies at its place as well. A wrong group of
/// closures that moves a whole map to a wrong place is seen in the second alone.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(20);
    let seeds = range.end - range.start;
    let variants = variants();
    let flown = fly(&plans(&Scenario::ALL, &variants, range), settings, |(method, way), params| {
        params.robot.method = *method;
        params.robot.optimisation = *way;
    })?;
    let mut table = Table::new([
        "scenario",
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
        categories: variants.iter().map(|v| name_of(*v)).collect(),
        ..Figure::default()
    };
    let mut notes = Vec::new();
    for scenario in Scenario::ALL {
        let mut robots_dots = vec![Vec::new(); 3];
        for (index, &variant) in variants.iter().enumerate() {
            let all: Vec<&Flown<_>> =
                flown.iter().filter(|f| f.plan.scenario == scenario && f.plan.variant == variant).collect();
            let robot = |f: &Flown<_>, at: usize| f.report.robots.get(at)?.error().map(|e| e.rmse_m);
            let of_robot: Vec<Option<f64>> =
                (0..3).map(|at| mean(all.iter().map(|f| robot(f, at)))).collect();
            let in_team = |f: &Flown<_>, at: usize| {
                f.report.robots.get(at).and_then(|r| f.report.error_in_team(r)).map(|e| e.rmse_m)
            };
            for (dots, ate) in robots_dots.iter_mut().zip(&of_robot) {
                dots.extend(ate.map(|ate| [index as f64, ate]));
            }
            let teams: Vec<_> = all.iter().map(|f| f.report.summary().team).collect();
            let head = [scenario.name().into(), variant.0.to_string().into(), variant.1.to_string().into()];
            let merged = all.iter().filter(|f| f.report.merged().count() == f.report.robots.len()).count();
            let mut row: Vec<Cell> = head.to_vec();
            row.extend(of_robot.iter().map(|ate| Cell::number(*ate, 3)));
            row.push(Cell::number(mean(of_robot.iter().copied()), 3));
            row.extend((0..3).map(|at| Cell::number(mean(all.iter().map(|f| in_team(f, at))), 3)));
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
                row.extend((0..3).map(|at| Cell::number(robot(f, at), 3)));
                row.extend((0..3).map(|at| Cell::number(in_team(f, at), 3)));
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
        notes.extend(worse_than_pooled(&flown, scenario));
    }
    Ok(Outcome { table, runs: Some(runs), figure, notes })
}

fn name_of((method, way): (Method, Optimisation)) -> String {
    if way == Optimisation::TwoStep { method.to_string() } else { way.to_string() }
}

/// Seeds on which `gcm` is worse than the pooled rule by more than 5 %.
fn worse_than_pooled(flown: &[Flown<(Method, Optimisation)>], scenario: Scenario) -> Option<String> {
    let of = |method: Method| {
        let variant = (method, Optimisation::TwoStep);
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
