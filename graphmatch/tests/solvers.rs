//! Affinity and solvers against dense matrices, and quadratic assignment against published optima.

mod support;

use draco_graphmatch::{
    Affinity, AffinityParams, Attributes, FaqParams, GraduatedParams, Kernel, Object, Pair, Qap, RrwmParams,
    TabuParams, assign_scores, faq, gcgc, graduated_assignment, greedy_pairs, ipfp, principal_eigenvector,
    robust_tabu, rrwm, smac,
};
use nalgebra::{DMatrix, Isometry2, Vector2};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use support::{objects, scatter, seen_from};

/// The affinity by its formula, entry by entry.
fn dense(map1: &[Object], map2: &[Object], mu: f64, attributes: bool) -> DMatrix<f64> {
    let m = map2.len();
    let weight = |i: usize, a: usize| {
        let d = (map1[i].length - map2[a].length).abs().max((map1[i].breadth - map2[a].breadth).abs());
        if attributes && d > 0.7 { 0.0 } else { 1.0 }
    };
    DMatrix::from_fn(map1.len() * m, map1.len() * m, |p, q| {
        let ((i, a), (j, b)) = ((p / m, p % m), (q / m, q % m));
        if i == j || a == b {
            return 0.0;
        }
        let d1 = (map1[i].centroid - map1[j].centroid).norm();
        let d2 = (map2[a].centroid - map2[b].centroid).norm();
        (-mu * (d1 - d2).abs()).exp() * weight(i, a) * weight(j, b)
    })
}

/// Largest eigenvalue by cyclic Jacobi rotations. (nalgebra's `symmetric_eigen` is no oracle here: on matrices with
/// blocks of very different size it may return values that are none.)
fn largest_eigenvalue(mut a: DMatrix<f64>) -> f64 {
    let n = a.nrows();
    for _ in 0..60 {
        for p in 0..n {
            for q in p + 1..n {
                if a[(p, q)] == 0.0 {
                    continue;
                }
                let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let (c, s) = (t.hypot(1.0).recip(), t / t.hypot(1.0));
                for k in 0..n {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    (a[(k, p)], a[(k, q)]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    a.diagonal().max()
}

fn check_product_and_eigenvector(n: usize, m: usize, seed: u64, gated: bool) {
    let (map1, map2) = (objects(&scatter(n, seed), seed), objects(&scatter(m, seed ^ 1), seed));
    let attributes = if gated { Attributes::Gate { sigma: 0.2, gate: 3.5 } } else { Attributes::Ignore };
    let params = AffinityParams { kernel: Kernel::Laplacian { mu: 2.0 }, attributes, ..Default::default() };
    let affinity = Affinity::new(&map1, &map2, &params).unwrap();
    let matrix = dense(&map1, &map2, 2.0, gated);
    let x: Vec<f64> = (0..n * m).map(|k| 1.0 + (k as f64).sin()).collect();
    let mut y = vec![0.0; n * m];
    affinity.multiply(&x, &mut y).unwrap();
    let expected = &matrix * DMatrix::from_column_slice(n * m, 1, &x);
    for (k, (y, e)) in y.iter().zip(expected.iter()).enumerate() {
        assert!((y - e).abs() <= 1e-9, "row {k}: {y} and {e}");
    }
    let found = principal_eigenvector(&affinity, None);
    let largest = largest_eigenvalue(matrix.clone()).max(0.0);
    assert!((found.value - largest).abs() <= 1e-9 * (1.0 + largest), "{} and {largest}", found.value);
    affinity.multiply(&found.vector, &mut y).unwrap();
    for (y, x) in y.iter().zip(&found.vector) {
        assert!(*x >= 0.0 && (y - found.value * x).abs() <= 1e-6 * largest.max(1e-6));
    }
}

#[test]
fn eigenvalue_of_blocks_of_different_size_is_the_largest() {
    check_product_and_eigenvector(6, 6, 1_569_200_093_187_255_521, true);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn products_and_eigenvector_are_those_of_the_dense_matrix(
        n in 2..8_usize, m in 2..8_usize, seed in any::<u64>(), gated in any::<bool>(),
    ) {
        check_product_and_eigenvector(n, m, seed, gated);
    }

    #[test]
    fn every_solver_matches_noise_free_copies(n in 5..14_usize, seed in any::<u64>()) {
        let map1 = objects(&scatter(n, seed), seed);
        let map2 = seen_from(&map1, &Isometry2::new(Vector2::new(4.0, 5.0), -1.0), 0.0, 0);
        let affinity = Affinity::new(&map1, &map2, &AffinityParams::default()).unwrap();
        let whole: Vec<Pair> = (0..n).map(|k| Pair { first: k, second: k }).collect();
        let eigen = principal_eigenvector(&affinity, None).vector;
        let soft = |scores: &[f64]| assign_scores(&affinity, scores).unwrap();
        let answers = [
            ("eigenvector", soft(&eigen)),
            ("greedy", greedy_pairs(&affinity, &eigen).unwrap()),
            ("rrwm", soft(&rrwm(&affinity, &RrwmParams::default()).unwrap())),
            ("ipfp", ipfp(&affinity, &eigen, 50).unwrap()),
            ("graduated", soft(&graduated_assignment(&affinity, &GraduatedParams::default()).unwrap())),
            ("gcgc", gcgc(&affinity, &eigen, 20).unwrap()),
            ("smac", soft(&smac(&affinity).vector)),
        ];
        for (name, pairs) in answers {
            prop_assert_eq!(&pairs, &whole, "{}", name);
        }
    }
}

#[test]
fn warm_start_saves_products() {
    let map1 = objects(&scatter(20, 3), 3);
    let map2 = seen_from(&map1, &Isometry2::identity(), 0.2, 4);
    let affinity = Affinity::new(&map1, &map2, &AffinityParams::default()).unwrap();
    let cold = principal_eigenvector(&affinity, None);
    let warm = principal_eigenvector(&affinity, Some(&cold.vector));
    assert!(warm.iterations < cold.iterations, "{} and {}", warm.iterations, cold.iterations);
}

#[test]
fn tabu_cost_counts_every_swap_of_small_problems() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    use rand::RngExt;
    for n in 2..7 {
        let mut matrix = || DMatrix::from_fn(n, n, |_, _| f64::from(rng.random_range(-5..9_i32)));
        let problem = Qap::new(matrix(), matrix()).unwrap();
        let found = robust_tabu(
            &problem,
            &TabuParams { iterations: 3000, restarts: 3 },
            &mut ChaCha8Rng::seed_from_u64(1),
        );
        let best =
            permutations(n).into_iter().map(|p| problem.cost(&p).unwrap()).fold(f64::INFINITY, f64::min);
        assert_eq!(found.cost, best, "n = {n}");
    }
}

fn permutations(n: usize) -> Vec<Vec<usize>> {
    if n == 0 {
        return vec![Vec::new()];
    }
    permutations(n - 1)
        .into_iter()
        .flat_map(|p| {
            (0..n).map(move |k| {
                let mut q = p.clone();
                q.insert(k, n - 1);
                q
            })
        })
        .collect()
}

#[test]
fn qaplib_optima_are_reached() {
    let Some(folder) = support::data("graphmatch/qaplib") else { return };
    let names = [
        "chr12a", "had12", "nug12", "rou12", "scr12", "tai12a", "esc16a", "els19", "nug20", "lipa20a",
        "tai20a", "bur26a",
    ];
    for name in names {
        let (problem, optimum) = instance(&folder, name);
        let found = robust_tabu(&problem, &TabuParams::default(), &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(found.cost, optimum, "{name}");
        assert_eq!(problem.cost(&found.image), Some(optimum));
        let relaxed = faq(&problem, &FaqParams::default()).unwrap();
        assert_eq!(problem.cost(&relaxed.image), Some(relaxed.cost));
        assert!(relaxed.cost >= optimum);
    }
    let (problem, optimum) = instance(&folder, "sko42");
    let found = robust_tabu(&problem, &TabuParams::default(), &mut ChaCha8Rng::seed_from_u64(1));
    assert!(found.cost <= 1.003 * optimum, "sko42: {} against {optimum}", found.cost);
}

fn instance(folder: &std::path::Path, name: &str) -> (Qap, f64) {
    let problem =
        Qap::from_qaplib(&std::fs::read_to_string(folder.join(format!("{name}.dat"))).unwrap()).unwrap();
    let answer = std::fs::read_to_string(folder.join(format!("{name}.sol.txt"))).unwrap();
    let optimum = answer.split_whitespace().nth(1).unwrap().trim_end_matches(',').parse().unwrap();
    (problem, optimum)
}

proptest! {
    #[test]
    fn mangled_qaplib_text_is_an_error_or_a_problem(text in "[0-9 .eE+na\n-]{0,60}") {
        if let Ok(problem) = Qap::from_qaplib(&text) {
            prop_assert_eq!(problem.a().nrows(), problem.size());
        }
    }
}
