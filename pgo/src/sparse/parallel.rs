//! The factorisation on several threads.

use pulp::Arch;

use super::Symbolic;
use super::dense::factor_panel;
use super::factor::{panel_begin, subtract};
use super::symbolic::Run;

/// Scalar operations below which a subtree is left to one thread.
const GRAIN: f64 = 2e6;

/// The elimination tree of supernodes. Postordering makes every subtree a range, so disjoint subtrees own disjoint
/// slices of the factor.
///
/// A supernode collects what its descendants contribute in ascending order, as the serial factorisation hands it
/// out, so the bits are the same.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    children: Vec<Vec<u32>>,
    /// First supernode of each subtree.
    first: Vec<u32>,
    /// Runs that target each supernode, by ascending source.
    incoming: Vec<Vec<(u32, Run)>>,
    /// Work of each subtree.
    work: Vec<f64>,
    roots: Vec<u32>,
    tallest: usize,
}

impl Tree {
    pub(super) fn new(symbolic: &Symbolic, block: usize) -> Self {
        let n = symbolic.supernodes();
        let mut tree = Self {
            children: vec![Vec::new(); n],
            first: (0..n as u32).collect(),
            incoming: vec![Vec::new(); n],
            work: vec![0.0; n],
            roots: Vec::new(),
            tallest: 0,
        };
        for s in 0..n {
            let (height, width) = (symbolic.rows(s).len() * block, symbolic.width(s) * block);
            tree.tallest = tree.tallest.max(height);
            tree.work[s] += width as f64 * (height * height) as f64;
            for run in symbolic.runs(s) {
                tree.incoming[run.target as usize].push((s as u32, *run));
            }
            // the parent owns the first row below
            match symbolic.runs(s).first().map(|run| run.target as usize) {
                Some(parent) => {
                    tree.children[parent].push(s as u32);
                    tree.first[parent] = tree.first[parent].min(tree.first[s]);
                    tree.work[parent] += tree.work[s];
                }
                None => tree.roots.push(s as u32),
            }
        }
        tree
    }

    pub(super) fn is_worth_it(&self) -> bool {
        self.roots.iter().map(|root| self.work[*root as usize]).sum::<f64>() > 2.0 * GRAIN
    }

    /// Factors all panels.
    ///
    /// # Errors
    /// The first column, after ordering, whose pivot was not positive.
    pub(super) fn factor<const N: usize>(
        &self,
        symbolic: &Symbolic,
        values: &mut [f64],
        arch: Arch,
    ) -> Result<(), usize> {
        self.forest::<N>(symbolic, &self.roots, values, 0, arch)
    }

    /// Factors neighbouring subtrees, whose panels are `values`, beginning at `offset` of the whole.
    fn forest<const N: usize>(
        &self,
        symbolic: &Symbolic,
        roots: &[u32],
        values: &mut [f64],
        offset: usize,
        arch: Arch,
    ) -> Result<(), usize> {
        let (Some(first), Some(last)) = (roots.first(), roots.last()) else { return Ok(()) };
        let work: f64 = roots.iter().map(|root| self.work[*root as usize]).sum();
        if work <= GRAIN {
            let range = self.first[*first as usize] as usize..*last as usize + 1;
            return arch.dispatch(Serial::<N> { tree: self, symbolic, range, values, offset });
        }
        if let [root] = roots {
            let own = panel_begin::<N>(symbolic, *root as usize);
            self.forest::<N>(
                symbolic,
                &self.children[*root as usize],
                &mut values[..own - offset],
                offset,
                arch,
            )?;
            let range = *root as usize..*root as usize + 1;
            return arch.dispatch(Serial::<N> { tree: self, symbolic, range, values, offset });
        }
        // the split that balances best
        let (mut at, mut done) = (1, self.work[*first as usize]);
        while at + 1 < roots.len() && done + 0.5 * self.work[roots[at] as usize] < 0.5 * work {
            done += self.work[roots[at] as usize];
            at += 1;
        }
        let (left, right) = roots.split_at(at);
        let middle = panel_begin::<N>(symbolic, self.first[roots[at] as usize] as usize);
        let (lower, upper) = values.split_at_mut(middle - offset);
        let (a, b) = rayon::join(
            || self.forest::<N>(symbolic, left, lower, offset, arch),
            || self.forest::<N>(symbolic, right, upper, middle, arch),
        );
        a.and(b)
    }
}

/// Factors a range of supernodes one after the other; everything they depend on is in `values`.
struct Serial<'a, const N: usize> {
    tree: &'a Tree,
    symbolic: &'a Symbolic,
    range: std::ops::Range<usize>,
    values: &'a mut [f64],
    offset: usize,
}

impl<const N: usize> pulp::NullaryFnOnce for Serial<'_, N> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { tree, symbolic, range, values, offset } = self;
        let mut row_offsets = vec![0; tree.tallest];
        for s in range {
            let (sources, own) = values.split_at_mut(panel_begin::<N>(symbolic, s) - offset);
            for (source, run) in &tree.incoming[s] {
                let begin = panel_begin::<N>(symbolic, *source as usize) - offset;
                subtract::<N>(symbolic, *source as usize, *run, &sources[begin..], own, &mut row_offsets);
            }
            let (height, width) = (symbolic.rows(s).len() * N, symbolic.width(s) * N);
            factor_panel::<N>(own, height, width).map_err(|c| symbolic.start[s] as usize + c / N)?;
        }
        Ok(())
    }
}
