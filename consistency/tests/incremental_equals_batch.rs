//! Every step of the incremental search against a search from scratch.

mod common;

use common::{random_graph, rng};
use draco_consistency::Error;
use draco_consistency::clique::{self, Budget, Incremental, IncrementalWeight};
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
fn every_weighted_step_equals_the_batch() {
    for seed in 0..60 {
        let mut rng = rng(seed);
        let n = rng.random_range(1..40);
        let density = rng.random_range(0.1..1.0);
        let graph = random_graph(n, density, &mut rng);
        let mut cliques = IncrementalWeight::new(Budget::UNLIMITED);
        let batch = |graph: &Graph| clique::maximum_weight(graph, &Budget::UNLIMITED).value;
        for v in 0..n {
            let neighbors: Vec<usize> = graph.neighbors(v).filter(|&u| u < v).collect();
            let weight = f64::from(rng.random_range(0..20)) * 0.5;
            let found = cliques.insert(&neighbors, weight).unwrap().clone();
            assert_eq!((found.value, found.optimal), (batch(cliques.graph()), true), "seed {seed}");
            assert_eq!(cliques.graph().total_weight(&found.vertices), found.value);
        }
        let mut alive: Vec<usize> = (0..n).collect();
        for _ in 0..3 * n {
            if alive.is_empty() {
                break;
            }
            let (a, b) = (alive[rng.random_range(0..alive.len())], alive[rng.random_range(0..alive.len())]);
            let found = match rng.random_range(0..6) {
                0 if a != b => cliques.add_edge(a, b).unwrap(),
                1 if a != b => cliques.remove_edge(a, b).unwrap(),
                2 => {
                    alive.retain(|&v| v != a);
                    cliques.remove(a).unwrap()
                }
                _ => cliques.set_weight(a, f64::from(rng.random_range(0..20)) * 0.5).unwrap(),
            }
            .clone();
            let left = cliques.graph().induced(&alive).unwrap();
            assert_eq!((found.value, found.optimal), (batch(&left), true), "seed {seed}");
            assert_eq!((found.upper_bound, cliques.best()), (found.value, &found));
            assert!(found.vertices.iter().all(|v| alive.contains(v)));
        }
    }
}

#[test]
fn without_budget_each_step_keeps_a_sound_bound() {
    for seed in 0..20 {
        let mut rng = rng(seed);
        let graph = random_graph(30, 0.7, &mut rng);
        let mut counted = Incremental::new(Budget::nodes(0));
        let mut weighed = IncrementalWeight::new(Budget::nodes(0));
        for v in 0..30 {
            let neighbors: Vec<usize> = graph.neighbors(v).filter(|&u| u < v).collect();
            counted.insert(&neighbors).unwrap();
            weighed.insert(&neighbors, 1.0 + (v % 3) as f64).unwrap();
            let largest = clique::maximum(counted.graph(), &Budget::UNLIMITED).value;
            let heaviest = clique::maximum_weight(weighed.graph(), &Budget::UNLIMITED).value;
            assert!((counted.best().value..=counted.best().upper_bound).contains(&largest));
            assert!(weighed.best().value <= heaviest && heaviest <= weighed.best().upper_bound);
            assert!(!counted.best().optimal || counted.best().value == largest);
            assert!(!weighed.best().optimal || weighed.best().value == heaviest);
        }
    }
}

#[test]
fn bad_steps_change_nothing() {
    let mut weighed = IncrementalWeight::new(Budget::UNLIMITED);
    assert!(matches!(weighed.insert(&[], f64::NAN), Err(Error::BadWeight { vertex: 0, .. })));
    assert!(matches!(weighed.insert(&[], -1.0), Err(Error::BadWeight { .. })));
    weighed.insert(&[], 2.0).unwrap();
    assert!(matches!(weighed.set_weight(0, f64::INFINITY), Err(Error::BadWeight { .. })));
    assert!(matches!(weighed.set_weight(1, 1.0), Err(Error::UnknownVertex { vertex: 1, .. })));
    assert_eq!((weighed.graph().len(), weighed.best().value), (1, 2.0));

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
