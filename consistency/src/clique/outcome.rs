/// A clique and what is known about it. `B` is `usize` where cliques are counted and `f64` where they are weighed.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome<B = usize> {
    /// The clique, ascending. Verified: every two of its vertices are joined.
    pub vertices: Vec<usize>,
    /// Its size or weight.
    pub value: B,
    /// No clique is larger or heavier than this; equals `value` if `optimal`.
    pub upper_bound: B,
    /// Whether the search was finished, so that no better clique exists.
    pub optimal: bool,
    /// Branch-and-bound nodes visited.
    pub nodes: u64,
}
