/// Pairs two lists of times: each time of the shorter list with the nearest of the longer one, if that is at most
/// `max_difference` seconds away. Both lists ascend.
///
/// Returns positions `(in first, in second)`, ascending. Of two times equally near the earlier is taken; one time
/// of the longer list may serve twice. Of lists equally long the second counts as the shorter.
///
/// Costs a binary search a time.
pub fn associate(first: &[f64], second: &[f64], max_difference: f64) -> Vec<(usize, usize)> {
    if second.len() > first.len() {
        nearest(first, second, max_difference).collect()
    } else {
        nearest(second, first, max_difference).map(|(short, long)| (long, short)).collect()
    }
}

/// Positions of times and of the nearest of `others`.
fn nearest<'a>(
    times: &'a [f64],
    others: &'a [f64],
    max_difference: f64,
) -> impl Iterator<Item = (usize, usize)> + 'a {
    times.iter().enumerate().filter_map(move |(index, time)| {
        let after = others.partition_point(|other| other <= time);
        let distance = |at: usize| others.get(at).map_or(f64::INFINITY, |other| (other - time).abs());
        let before = after.checked_sub(1);
        let best = match before {
            Some(before) if distance(before) <= distance(after) => before,
            _ => after,
        };
        (distance(best) <= max_difference).then_some((index, best))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_find_their_nearest_within_the_limit() {
        let (sparse, dense) = ([0.0, 1.0, 2.0], [0.01, 0.4, 0.98, 1.02, 5.0]);
        assert_eq!(associate(&sparse, &dense, 0.05), [(0, 0), (1, 2)]);
        assert_eq!(associate(&dense, &sparse, 0.05), [(0, 0), (2, 1)]);
        assert_eq!(associate(&sparse, &dense, 10.0), [(0, 0), (1, 2), (2, 3)]);
        assert_eq!(associate(&[], &dense, 1.0), []);
        assert_eq!(associate(&[7.0], &[7.0, 7.0], 0.0), [(0, 1)]);
    }
}
