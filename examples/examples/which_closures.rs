//! Which closures should three robots in a harbour believe? One simulated mission under several consistency tests.

use draco::consistency::Method;
use draco::mission::{self, MissionParams};
use draco::simulate::{SimulationParams, simulate};

fn main() -> anyhow::Result<()> {
    let data = simulate(&SimulationParams::default())?;
    println!("{:12} {:>9} {:>9} {:>10} {:>9}", "method", "proposed", "accepted", "precision", "team ATE");
    for method in [Method::None, Method::Pcm, Method::Gcm] {
        let mut params = MissionParams::default();
        params.robot.method = method;
        let summary = mission::run(&data, &params, |_| {})?.summary();
        let team = &summary.team;
        println!(
            "{method:12} {:>9} {:>9} {:>8.1} % {:>7.2} m",
            team.closures.proposed,
            team.closures.accepted,
            100.0 * team.precision.unwrap_or(f64::NAN),
            team.ate_m.unwrap_or(f64::NAN),
        );
    }
    Ok(())
}
