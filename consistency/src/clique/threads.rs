use super::budget::Meter;

/// Runs every part, on the threads of the current pool if there are any; results in the order of the parts.
///
/// * `scratch` – makes what a thread keeps from part to part.
#[cfg(feature = "rayon")]
pub(super) fn run_all<S, T: Send>(
    parts: usize,
    meter: &mut Meter,
    scratch: impl Fn() -> S + Send + Sync,
    run: impl Fn(usize, &mut S, &mut Meter) -> T + Send + Sync,
) -> Vec<T> {
    use rayon::prelude::*;
    // A limit of nodes must stop at the same node each time, so such a search stays on one thread.
    if meter.limits_nodes() || rayon::current_num_threads() == 1 {
        return run_in_turn(parts, meter, scratch, run);
    }
    let shared = &*meter;
    let done: Vec<(T, Meter)> = (0..parts)
        .into_par_iter()
        .with_max_len(1)
        .map_init(&scratch, |scratch, index| {
            let mut meter = shared.fork();
            (run(index, scratch, &mut meter), meter)
        })
        .collect();
    let join = |(result, one): (T, Meter)| {
        meter.join(&one);
        result
    };
    done.into_iter().map(join).collect()
}

/// Runs every part; results in the order of the parts.
///
/// * `scratch` – makes what is kept from part to part.
#[cfg(not(feature = "rayon"))]
pub(super) fn run_all<S, T>(
    parts: usize,
    meter: &mut Meter,
    scratch: impl Fn() -> S,
    run: impl Fn(usize, &mut S, &mut Meter) -> T,
) -> Vec<T> {
    run_in_turn(parts, meter, scratch, run)
}

fn run_in_turn<S, T>(
    parts: usize,
    meter: &mut Meter,
    scratch: impl Fn() -> S,
    run: impl Fn(usize, &mut S, &mut Meter) -> T,
) -> Vec<T> {
    let mut scratch = scratch();
    (0..parts).map(|index| run(index, &mut scratch, meter)).collect()
}
