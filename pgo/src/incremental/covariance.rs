use std::collections::{BTreeMap, BTreeSet};

use draco_lie::LieGroup;
use nalgebra::{DMatrix, SMatrix};

use super::Incremental;
use super::tree::{NONE, Tree};
use crate::{Error, Key};

type Columns<const N: usize> = BTreeMap<u32, SMatrix<f64, N, N>>;

impl<const N: usize, G: LieGroup<N>> Incremental<G, N> {
    /// Covariance of one pose as of the last update: of its right perturbation, in its own body frame, order
    /// translation then rotation, metres and radians; zero for fixed poses.
    ///
    /// Only the cliques from the pose to the root are looked at.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], also for poses that no update has taken in yet; [`Error::OutOfDate`] when a pose was
    /// taken out since the last update.
    pub fn covariance(&self, key: Key) -> Result<SMatrix<f64, N, N>, Error> {
        let slot = self.settled(key)?;
        Ok(self.tree.inverse_blocks(slot, &[slot])[0])
    }

    /// Joint covariance of several poses as of the last update, `N × N` blocks in the order of `keys`.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], also for poses that no update has taken in yet; [`Error::OutOfDate`] when a pose was
    /// taken out since the last update.
    pub fn joint_covariance(&self, keys: &[Key]) -> Result<DMatrix<f64>, Error> {
        let slots = keys.iter().map(|key| self.settled(*key)).collect::<Result<Vec<u32>, Error>>()?;
        let mut joint = DMatrix::zeros(keys.len() * N, keys.len() * N);
        for (c, source) in slots.iter().enumerate() {
            for (r, block) in self.tree.inverse_blocks(*source, &slots).iter().enumerate() {
                joint.view_mut((r * N, c * N), (N, N)).copy_from(block);
            }
        }
        Ok(joint)
    }

    fn settled(&self, key: Key) -> Result<u32, Error> {
        let slot = self.graph.slot(key)?;
        if self.tree.is_apart() {
            return Err(Error::OutOfDate { key });
        }
        let known = self.tree.home.get(slot).is_some_and(|home| *home != NONE);
        if known || self.graph.fixed[slot] { Ok(slot as u32) } else { Err(Error::UnknownKey { key }) }
    }
}

impl<const N: usize> Tree<N> {
    /// Blocks of the inverse Hessian in the columns of `source`, at the rows of `targets`.
    fn inverse_blocks(&self, source: u32, targets: &[u32]) -> Vec<SMatrix<f64, N, N>> {
        let home = |slot: &u32| self.home.get(*slot as usize).copied().unwrap_or(NONE);
        if home(&source) == NONE {
            return vec![SMatrix::zeros(); targets.len()];
        }
        let forward = self.forward(source);
        let mut needed = BTreeSet::new();
        for target in targets {
            let mut clique = home(target);
            while clique != NONE && needed.insert(clique) {
                clique = self.cliques[clique as usize].parent;
            }
        }
        let mut solved = Columns::new();
        let mut path = Vec::new();
        for clique in &needed {
            // parents first
            let mut at = *clique;
            while at != NONE && !solved.contains_key(&self.cliques[at as usize].slots[0]) {
                path.push(at);
                at = self.cliques[at as usize].parent;
            }
            while let Some(at) = path.pop() {
                self.backward(at, &forward, &mut solved);
            }
        }
        targets.iter().map(|t| solved.get(t).copied().unwrap_or_else(SMatrix::zeros)).collect()
    }

    /// `L⁻¹` applied to the unit columns of `source`: not zero on the way to the root only.
    fn forward(&self, source: u32) -> Columns<N> {
        let mut columns = Columns::new();
        columns.insert(source, SMatrix::identity());
        let mut at = self.home[source as usize];
        while at != NONE {
            let clique = &self.cliques[at as usize];
            let height = clique.slots.len() * N + 1;
            let mut x: Vec<SMatrix<f64, N, N>> = clique
                .slots
                .iter()
                .map(|slot| columns.get(slot).copied().unwrap_or_else(SMatrix::zeros))
                .collect();
            for c in 0..clique.eliminated * N {
                let column = &clique.values[c * height..(c + 1) * height];
                let value = x[c / N].row(c % N) / column[c];
                x[c / N].set_row(c % N, &value);
                for (r, l) in column.iter().enumerate().take(height - 1).skip(c + 1) {
                    let mut row = x[r / N].row_mut(r % N);
                    row -= value * *l;
                }
            }
            columns.extend(clique.slots.iter().copied().zip(x));
            at = clique.parent;
        }
        columns
    }

    /// Solves for the variables a clique eliminates, from those of its ancestors.
    fn backward(&self, at: u32, forward: &Columns<N>, solved: &mut Columns<N>) {
        let clique = &self.cliques[at as usize];
        let height = clique.slots.len() * N + 1;
        let (own, others) = clique.slots.split_at(clique.eliminated);
        let zero = SMatrix::zeros();
        let mut x: Vec<SMatrix<f64, N, N>> =
            own.iter().map(|slot| forward.get(slot).copied().unwrap_or(zero)).collect();
        x.extend(others.iter().map(|slot| solved.get(slot).copied().unwrap_or(zero)));
        for c in (0..clique.eliminated * N).rev() {
            let column = &clique.values[c * height..(c + 1) * height];
            let mut value = x[c / N].row(c % N).into_owned();
            for (r, l) in column.iter().enumerate().take(height - 1).skip(c + 1) {
                value -= x[r / N].row(r % N) * *l;
            }
            x[c / N].set_row(c % N, &(value / column[c]));
        }
        solved.extend(own.iter().copied().zip(x));
    }
}
