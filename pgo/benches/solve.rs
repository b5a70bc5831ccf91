//! Time to solved from the file's start, ordering included, for the published sets.
//!
//! What peers take on the machine this was written on, CPU time of one core under load: g2o Gauss-Newton 18 ms
//! (intel) and 80 ms (manhattan); GTSAM Gauss-Newton 178 ms (parking-garage) and 516 ms (sphere2500).

use std::path::PathBuf;

use criterion::{Criterion, criterion_group, criterion_main};
use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{ChordalPose, PoseGraph, SolveParams, chordal, solve};

fn data(name: &str) -> Option<AnyGraph> {
    let root = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let graph = g2o::read(root.join(format!("pgo/{name}.g2o")));
    if let Err(reason) = &graph {
        println!("skipped {name}: {reason}");
    }
    graph.ok()
}

fn measure<const N: usize, G: LieGroup<N> + ChordalPose<N>>(
    c: &mut Criterion,
    name: &str,
    graph: &PoseGraph<G, N>,
) {
    let params = SolveParams::default();
    c.bench_function(&format!("solve/{name}/file"), |b| b.iter(|| solve(graph, &params)));
    c.bench_function(&format!("chordal/{name}"), |b| b.iter(|| chordal(&mut graph.clone())));
}

fn sets(c: &mut Criterion) {
    for name in ["intel", "manhattan", "parking-garage", "sphere2500"] {
        match data(name) {
            Some(AnyGraph::Two(graph)) => measure(c, name, &graph),
            Some(AnyGraph::Three(graph)) => measure(c, name, &graph),
            None => {}
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = sets
}
criterion_main!(benches);
