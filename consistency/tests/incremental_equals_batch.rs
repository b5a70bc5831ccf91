//! Every step of the incremental search against a search from scratch.

mod common;

use common::{random_graph, rng};
use draco_consistency::Error;
use draco_consistency::clique::{self, Budget, Incremental};
use draco_consistency::graph::{Adjacency, Graph};
use rand::RngExt;

#[test]
fn every_step_equals_the_batch() {
    for seed in 0..60 {
        let mut rng = rng(seed);
        let n = rng.random_range(1..40);
        let density = rng.random_range(0.1..1.0);
        let graph = random_graph(n, density, &mut rng);
        let mut cliques = Incremental::new(Budget::UNLIMITED);
        let batch = |graph: &Graph| clique::maximum(graph, &Budget::UNLIMITED).value;
        for v in 0..n {
            let neighbors: Vec<usize> = graph.neighbors(v).filter(|&u| u < v).collect();
            let found = cliques.insert(&neighbors).unwrap().clone();
            assert_eq!((found.value, found.optimal), (batch(cliques.graph()), true), "seed {seed}");
            assert!(cliques.graph().is_clique(&found.vertices));
        }
        let mut alive: Vec<usize> = (0..n).collect();
        while alive.len() > 1 {
            let (a, b) = (alive[rng.random_range(0..alive.len())], alive[rng.random_range(0..alive.len())]);
            let found = match rng.random_range(0..3) {
                0 if a != b => cliques.add_edge(a, b).unwrap(),
                1 if a != b => cliques.remove_edge(a, b).unwrap(),
                _ => {
                    alive.retain(|&v| v != a);
                    cliques.remove(a).unwrap()
                }
            }
            .clone();
            let left = cliques.graph().induced(&alive).unwrap();
            assert_eq!((found.value, found.optimal), (batch(&left), true), "seed {seed}");
            assert!(found.vertices.iter().all(|v| alive.contains(v)));
        }
    }
}

#[test]
fn bad_steps_change_nothing() {
    let mut cliques = Incremental::new(Budget::UNLIMITED);
    assert!(matches!(cliques.insert(&[0]), Err(Error::UnknownVertex { vertex: 0, .. })));
    assert_eq!(cliques.graph().len(), 0);
    cliques.insert(&[]).unwrap();
    cliques.insert(&[0, 0]).unwrap();
    assert!(cliques.add_edge(1, 1).is_err());
    cliques.remove(0).unwrap();
    assert!(cliques.remove(0).is_err() && cliques.insert(&[0]).is_err());
    assert_eq!(cliques.best().vertices, [1]);
}
