//! Do four robots find their common map over a link that loses and reorders messages? Two schemes against the
//! optimum a single machine finds.

use draco_lie::LieGroup;
use draco_pgo::distributed::{Agent, CondensingAgent};
use draco_pgo::{Error, Kernel, Key, PoseGraph2, SolveParams, solve};
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const ROBOTS: u32 = 4;
const POSES: u64 = 60;

fn main() -> Result<(), Error> {
    let graph = team()?;
    let best = solve(&graph, &SolveParams::default())?.final_cost;
    println!("{} poses, {} measurements, optimum {best:.4}", graph.pose_count(), graph.factor_count());
    println!("scheme       lost  rounds  cost / optimum - 1  sent [kB]");
    for lost in [0.0, 0.3] {
        for rounds in [5, 20] {
            let mut agents =
                (0..ROBOTS).map(|r| CondensingAgent::new(&graph, r)).collect::<Result<Vec<_>, _>>()?;
            let mut bytes = 0;
            exchange(
                &mut agents,
                rounds,
                lost,
                |agent| agent.step().inspect(|m| bytes += m.bytes()),
                |a, m| a.receive(m),
            )?;
            let poses = agents.iter().flat_map(|a| a.poses().map(|(key, pose)| (key, *pose))).collect();
            report("condensed", lost, rounds, &graph, poses, best, bytes)?;
        }
        for rounds in [20, 2000] {
            let mut agents = (0..ROBOTS).map(|r| Agent::new(&graph, r)).collect::<Result<Vec<_>, _>>()?;
            let mut bytes = 0;
            exchange(
                &mut agents,
                rounds,
                lost,
                |agent| agent.step().inspect(|m| bytes += m.bytes::<3>()),
                |a, m| a.receive(m),
            )?;
            let poses = agents.iter().flat_map(|a| a.poses().map(|(key, pose)| (key, *pose))).collect();
            report("coordinate", lost, rounds, &graph, poses, best, bytes)?;
        }
    }
    Ok(())
}

/// Every round each robot steps and broadcasts; a receiver misses a share of the messages and hears as many a round
/// late.
fn exchange<A, M: Clone>(
    agents: &mut [A],
    rounds: usize,
    lost: f64,
    mut step: impl FnMut(&mut A) -> Result<M, Error>,
    receive: impl Fn(&mut A, &M),
) -> Result<(), Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut late: Vec<(usize, M)> = Vec::new();
    for _ in 0..rounds {
        let delayed = std::mem::take(&mut late);
        for sender in 0..agents.len() {
            let message = step(&mut agents[sender])?;
            for receiver in (0..agents.len()).filter(|r| *r != sender) {
                match rng.random_range(0.0..1.0) {
                    x if x < lost => {}
                    x if x < 2.0 * lost => late.push((receiver, message.clone())),
                    _ => receive(&mut agents[receiver], &message),
                }
            }
        }
        delayed.iter().for_each(|(receiver, message)| receive(&mut agents[*receiver], message));
    }
    Ok(())
}

fn report(
    scheme: &str,
    lost: f64,
    rounds: usize,
    graph: &PoseGraph2,
    poses: Vec<(Key, Isometry2<f64>)>,
    best: f64,
    bytes: usize,
) -> Result<(), Error> {
    let mut result = graph.clone();
    for (key, pose) in poses {
        result.set_pose(key, pose)?;
    }
    let above = result.cost() / best - 1.0;
    let share = 100.0 * lost;
    println!("{scheme:11}  {share:2.0} %  {rounds:6}  {above:18.1e}  {:9.1}", bytes as f64 / 1e3);
    Ok(())
}

/// Four robots on circles around the corners of a square that cross each other's paths.
fn team() -> Result<PoseGraph2, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let sigma = Vector3::new(0.05, 0.05, 0.01);
    let information = Matrix3::from_diagonal(&sigma.map(|s| 1.0 / (s * s)));
    let truth = |key: Key| {
        let angle = std::f64::consts::TAU * key.index as f64 / 40.0;
        let centre = Vector2::new(f64::from(key.robot % 2), f64::from(key.robot / 2)) * 6.0;
        Isometry2::new(centre + Vector2::new(angle.cos(), angle.sin()) * 5.0, angle)
    };
    let mut noise = || sigma.map(|s| s * rng.sample::<f64, _>(rand_distr::StandardNormal));
    let mut graph = PoseGraph2::new();
    let keys: Vec<Key> = (0..ROBOTS).flat_map(|r| (0..POSES).map(move |i| Key::new(r, i))).collect();
    for (k, key) in keys.iter().enumerate() {
        if key.index == 0 {
            graph.add_pose(*key, truth(*key).plus(&noise()))?;
        } else {
            let z = truth(keys[k - 1]).between(&truth(*key)).plus(&noise());
            let from = graph.pose(keys[k - 1]).map_or(z, |last| last.compose(&z));
            graph.add_pose(*key, from)?;
            graph.add_between(keys[k - 1], *key, z, information, Kernel::None)?;
        }
        let near = |other: &&Key| (truth(**other).inv_mul(&truth(*key))).translation.vector.norm() < 0.6;
        let apart = |other: &&Key| other.robot != key.robot || key.index.abs_diff(other.index) > 20;
        for other in keys[..k].iter().filter(near).filter(apart) {
            let z = truth(*other).between(&truth(*key)).plus(&noise());
            graph.add_between(*other, *key, z, information, Kernel::None)?;
        }
    }
    graph.set_fixed(keys[0], true)?;
    Ok(graph)
}
