//! Quantiles against the incomplete gamma function with 40 digits (`chi2_table.py`), also far out in the tails.
use draco_lie::chi2;

/// The distribution functions behind are good to a few 1e-14.
const TOLERANCE: f64 = 1e-13;

#[test]
fn quantiles_match_the_incomplete_gamma_function() {
    let mut worst = (0.0_f64, "");
    for line in include_str!("data/chi2.txt").lines() {
        let mut words = line.split_whitespace();
        let p: f64 = words.next().unwrap().parse().unwrap();
        let degrees: usize = words.next().unwrap().parse().unwrap();
        let wanted: f64 = words.next().unwrap().parse().unwrap();
        let error = (chi2::quantile(p, degrees).unwrap() / wanted - 1.0).abs();
        if error > worst.0 {
            worst = (error, line);
        }
        assert!(error <= TOLERANCE, "{line}: off by {error:e}");
        assert!(chi2::gate(wanted * (1.0 - 2.0 * TOLERANCE), p, degrees).unwrap());
        assert!(!chi2::gate(wanted * (1.0 + 2.0 * TOLERANCE), p, degrees).unwrap());
    }
    println!("largest relative error {:e} at {}", worst.0, worst.1);
}
