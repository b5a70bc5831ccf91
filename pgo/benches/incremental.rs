//! Following a growing graph: one update per pose of a published set, in the order of their ids.
//!
//! What GTSAM's ISAM2 takes for the same (relinearize skip 1, threshold 0.1), CPU time of one loaded core: 1725 ms
//! for intel by Cholesky; 12.8 s for manhattan by QR, where its Cholesky gives up on an ill-conditioned factor.

use std::path::PathBuf;

use criterion::{Criterion, criterion_group, criterion_main};
use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{FactorId, Incremental, IncrementalParams, Key, Measurement, PoseGraph};

fn replay<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>) -> Result<f64, draco_pgo::Error> {
    let mut arriving: Vec<(Key, FactorId)> = graph
        .factors()
        .filter_map(|(id, factor)| factor.keys().into_iter().max().map(|key| (key, id)))
        .collect();
    arriving.sort_unstable();
    let mut arriving = arriving.into_iter().peekable();
    let mut smoother = Incremental::new(IncrementalParams::default())?;
    for (at, (key, first)) in graph.poses().enumerate() {
        let mut factors = Vec::new();
        while let Some((_, id)) = arriving.next_if(|(k, _)| *k == key) {
            factors.extend(graph.factor(id));
        }
        if at == 0 {
            smoother.add_fixed_pose(key, *first)?;
            continue;
        }
        let guess = factors.iter().find_map(|factor| match &factor.measurement {
            Measurement::Between { from, to, measured } if *to == key => {
                smoother.graph().pose(*from).map(|pose| pose.compose(measured))
            }
            _ => None,
        });
        smoother.add_pose(key, guess.unwrap_or(*first))?;
        for factor in factors {
            if let Measurement::Between { from, to, measured } = &factor.measurement {
                smoother.add_between(*from, *to, *measured, factor.information, factor.kernel)?;
            }
        }
        smoother.update()?;
    }
    Ok(smoother.graph().cost())
}

fn sets(c: &mut Criterion) {
    let root = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    for name in ["intel", "manhattan"] {
        match g2o::read(root.join(format!("pgo/{name}.g2o"))) {
            Ok(AnyGraph::Two(graph)) => {
                c.bench_function(&format!("incremental/{name}"), |b| b.iter(|| replay(&graph)));
            }
            Ok(AnyGraph::Three(_)) => println!("skipped {name}: not in the plane"),
            Err(reason) => println!("skipped {name}: {reason}"),
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = sets
}
criterion_main!(benches);
