//! The feature `rayon` changes how long a search takes and nothing else.
#![cfg(feature = "rayon")]

mod common;

use common::{random_graph, rng};
use draco_consistency::clique::{self, Budget};

#[test]
fn vertex_set_is_the_same_on_one_two_and_four_threads() {
    for seed in 0..12 {
        let density = [0.3, 0.5, 0.7, 0.85][seed as usize % 4];
        let graph = random_graph(140, density, &mut rng(seed));
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| clique::maximum(&graph, &Budget::UNLIMITED))
        };
        let one = on(1);
        assert!(one.optimal);
        for threads in [2, 4, 4] {
            let found = on(threads);
            assert!(found.optimal);
            assert_eq!(found.vertices, one.vertices, "seed {seed}, {threads} threads");
        }
    }
}
