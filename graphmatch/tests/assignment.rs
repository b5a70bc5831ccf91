//! Assignments against brute force, against their duals, and against published optima.

mod support;

use draco_graphmatch::{Assignment, Costs, Error, SparseCosts, assign, assign_or_leave, assign_sparse};
use proptest::prelude::*;

/// Least total cost over all ways to serve the smaller side, by trying them all; `None` if there is none.
fn brute_force(rows: usize, columns: usize, costs: &[f64]) -> Option<f64> {
    fn rest(row: usize, used: &mut [bool], cost: &dyn Fn(usize, usize) -> f64, rows: usize) -> f64 {
        if row == rows {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for j in 0..used.len() {
            if !used[j] && cost(row, j) < f64::INFINITY {
                used[j] = true;
                best = best.min(cost(row, j) + rest(row + 1, used, cost, rows));
                used[j] = false;
            }
        }
        best
    }
    let best = if rows <= columns {
        rest(0, &mut vec![false; columns], &|i, j| costs[i * columns + j], rows)
    } else {
        rest(0, &mut vec![false; rows], &|j, i| costs[i * columns + j], columns)
    };
    (best < f64::INFINITY).then_some(best)
}

/// Feasible duals whose sum is the cost prove the assignment optimal.
fn check_certificate(rows: usize, columns: usize, costs: &[f64], found: &Assignment) {
    let scale = 1.0 + costs.iter().filter(|c| c.is_finite()).fold(0.0_f64, |m, c| m.max(c.abs()));
    let tolerance = 1e-11 * scale;
    let mut total = 0.0;
    for i in 0..rows {
        for j in 0..columns {
            let slack = costs[i * columns + j] - found.row_duals[i] - found.column_duals[j];
            assert!(slack >= -tolerance, "slack {slack} at ({i}, {j})");
            if found.column_of_row[i] == Some(j) {
                assert!(slack.abs() <= tolerance, "assigned pair ({i}, {j}) has slack {slack}");
                assert_eq!(found.row_of_column[j], Some(i));
                total += costs[i * columns + j];
            }
        }
    }
    let assigned = found.column_of_row.iter().flatten().count();
    assert_eq!(assigned, rows.min(columns));
    assert_eq!(found.row_of_column.iter().flatten().count(), assigned);
    let idle_rows = found.row_duals.iter().zip(&found.column_of_row).filter(|(_, j)| j.is_none());
    let idle_columns = found.column_duals.iter().zip(&found.row_of_column).filter(|(_, i)| i.is_none());
    for (dual, _) in idle_rows {
        assert_eq!(*dual, 0.0, "an idle row has a dual");
    }
    for (dual, _) in idle_columns {
        assert_eq!(*dual, 0.0, "an idle column has a dual");
    }
    if rows < columns {
        assert!(found.column_duals.iter().all(|v| *v <= tolerance));
    }
    if rows > columns {
        assert!(found.row_duals.iter().all(|u| *u <= tolerance));
    }
    assert!((found.cost - total).abs() <= tolerance * rows as f64);
}

/// Entries that tie, vanish, are negative, huge, tiny or forbidden.
fn entries() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        3 => (-3..4_i32).prop_map(f64::from),
        1 => Just(0.0),
        1 => Just(f64::INFINITY),
        1 => prop_oneof![Just(1e9), Just(-1e9), Just(1e-9)],
    ]
}

fn matrices(most: usize) -> impl Strategy<Value = (usize, usize, Vec<f64>)> {
    (0..=most, 0..=most).prop_flat_map(|(rows, columns)| {
        (Just(rows), Just(columns), prop::collection::vec(entries(), rows * columns))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    #[test]
    fn small_assignments_are_optimal((rows, columns, costs) in matrices(6)) {
        let found = assign(Costs::new(rows, columns, &costs).unwrap());
        match brute_force(rows, columns, &costs) {
            Some(best) => {
                let found = found.unwrap();
                // Sums with entries of 10⁹ that cancel are good to 10⁻⁶ in either solver.
                let largest = costs.iter().filter(|c| c.is_finite()).fold(0.0_f64, |m, c| m.max(c.abs()));
                let tolerance = 1e-9 * (1.0 + best.abs()) + 1e-15 * largest;
                prop_assert!((found.cost - best).abs() <= tolerance);
                check_certificate(rows, columns, &costs, &found);
            }
            None => prop_assert!(matches!(found, Err(Error::Infeasible { .. })), "found {:?}", found),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Large enough for the core of cheap arcs; the certificate needs no other solver.
    #[test]
    fn large_assignments_carry_their_certificate(
        (rows, columns) in (40..120_usize, 40..120_usize),
        kind in 0..4_usize,
        seed in any::<u64>(),
    ) {
        let costs = support::random_costs(rows, columns, kind, seed);
        let found = assign(Costs::new(rows, columns, &costs).unwrap()).unwrap();
        check_certificate(rows, columns, &costs, &found);
    }

    #[test]
    fn sparse_and_dense_agree((rows, columns, costs) in matrices(7)) {
        prop_assume!(rows <= columns);
        let entries: Vec<Vec<(usize, f64)>> = (0..rows)
            .map(|i| (0..columns).map(|j| (j, costs[i * columns + j])).filter(|e| e.1.is_finite()).collect())
            .collect();
        let found = assign_sparse(&SparseCosts::new(columns, &entries).unwrap());
        match brute_force(rows, columns, &costs) {
            Some(_) => check_certificate(rows, columns, &costs, &found.unwrap()),
            None => prop_assert!(matches!(found, Err(Error::Infeasible { .. })), "found {:?}", found),
        }
    }

    /// Leaving is the same as one private column a row at that price.
    #[test]
    fn leaving_rows_equals_private_columns((rows, columns, costs) in matrices(4), unmatched in -5.0..8.0) {
        prop_assume!(rows <= columns);
        let found = assign_or_leave(Costs::new(rows, columns, &costs).unwrap(), unmatched).unwrap();
        let wide = columns + rows;
        let mut private = vec![f64::INFINITY; rows * wide];
        for i in 0..rows {
            private[i * wide..i * wide + columns].copy_from_slice(&costs[i * columns..(i + 1) * columns]);
            private[i * wide + columns + i] = unmatched;
        }
        let best = brute_force(rows, wide, &private).unwrap();
        let of = |(i, j): (usize, &Option<usize>)| j.map_or(unmatched, |j| costs[i * columns + j]);
        let total: f64 = found.column_of_row.iter().enumerate().map(of).sum();
        let largest = costs.iter().filter(|c| c.is_finite()).fold(0.0_f64, |m, c| m.max(c.abs()));
        prop_assert!((total - best).abs() <= 1e-9 * (1.0 + best.abs()) + 1e-15 * largest);
    }
}

#[test]
fn or_library_optima_are_exact() {
    let Some(folder) = support::data("graphmatch/orlib_assign") else { return };
    for (name, optimum) in
        [("assign100", 305.0), ("assign200", 475.0), ("assign300", 626.0), ("assign400", 804.0)]
    {
        let text = std::fs::read_to_string(folder.join(format!("{name}.txt"))).unwrap();
        let mut numbers = text.split_whitespace().map(|w| w.parse::<f64>().unwrap());
        let n = numbers.next().unwrap() as usize;
        let costs: Vec<f64> = numbers.collect();
        let found = assign(Costs::new(n, n, &costs).unwrap()).unwrap();
        assert_eq!(found.cost, optimum, "{name}");
        check_certificate(n, n, &costs, &found);
    }
}

#[test]
fn wrong_costs_are_named() {
    let nan = [1.0, 2.0, f64::NAN, 4.0];
    assert!(matches!(Costs::new(2, 2, &nan), Err(Error::BadCost { row: 1, column: 0, .. })));
    let low = [1.0, f64::NEG_INFINITY];
    assert!(matches!(Costs::new(1, 2, &low), Err(Error::BadCost { row: 0, column: 1, .. })));
    assert!(matches!(Costs::new(2, 2, &low), Err(Error::WrongLength { expected: 4, found: 2, .. })));
    let blocked = [f64::INFINITY, f64::INFINITY, 1.0, 1.0];
    assert_eq!(assign(Costs::new(2, 2, &blocked).unwrap()), Err(Error::Infeasible { row: 0 }));
}
