use nalgebra::SVector;

use super::elimination::Elimination;
use super::front::{self, Source};
use super::model::Model;

/// Marks "no clique" and "not affected".
pub(crate) const NONE: u32 = u32::MAX;

/// Variables eliminated together, and those they leave behind to their parent.
///
/// `values` is the front after elimination: column-major, one row more than variables for the right-hand side;
/// the factor in the first columns, the Schur complement that the parent summed up in the others.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clique {
    /// Slots, eliminated ones first.
    pub(crate) slots: Vec<u32>,
    pub(crate) eliminated: usize,
    pub(crate) values: Vec<f64>,
    pub(crate) parent: u32,
    children: Vec<u32>,
    /// Made by the last update.
    fresh: bool,
}

/// What a front sums up.
#[derive(Debug, Clone, Copy)]
enum Part {
    Factor(u32),
    Orphan(u32),
}

/// A Bayes tree: the Cholesky factor of a growing problem, by cliques, each with the Schur complement it handed
/// on. When factors change, the cliques from their variables up to the root are taken apart and eliminated anew;
/// what hangs below enters by its Schur complement and stays as it is.
///
/// **Source**: Kaess, Johannsson, Roberts, Ila, Leonard, Dellaert, *iSAM2*, 2012, algorithms 3 to 6. We differ
/// in working with Hessian blocks instead of Jacobians, and in finding order and cliques in one elimination whose
/// elements are factors and orphans alike.
#[derive(Debug, Clone)]
pub(crate) struct Tree<const N: usize> {
    pub(crate) cliques: Vec<Clique>,
    unused: Vec<u32>,
    /// Clique that eliminates each slot.
    pub(crate) home: Vec<u32>,
    /// Step of each slot from its linearisation point.
    pub(crate) delta: Vec<SVector<f64, N>>,
    /// Cliques whose parents were taken apart and not replaced yet.
    orphans: Vec<u32>,
    arch: pulp::Arch,
    fresh: Vec<u32>,
    scratch: Scratch,
}

#[derive(Debug, Clone, Default)]
struct Scratch {
    elimination: Elimination,
    /// Cliques to take apart.
    marked: Vec<u32>,
    is_marked: Vec<bool>,
    /// Slots to eliminate anew, and the place of each slot among them.
    affected: Vec<u32>,
    local: Vec<u32>,
    late: Vec<bool>,
    parts: Vec<Part>,
    seen: Vec<bool>,
    /// Row of each affected slot in the front at hand.
    row: Vec<u32>,
    rows: Vec<u32>,
    fronts: Vec<Vec<f64>>,
    pool: Vec<Vec<f64>>,
    x: Vec<f64>,
    changed: Vec<bool>,
    stack: Vec<u32>,
}

/// What an update of a tree reads of the smoother.
pub(crate) struct Factors<'a> {
    /// By factor.
    pub(crate) models: &'a [Model],
    /// Factors on each slot.
    pub(crate) touching: &'a [Vec<u32>],
}

impl<const N: usize> Tree<N> {
    pub(crate) fn new() -> Self {
        Self {
            cliques: Vec::new(),
            unused: Vec::new(),
            home: Vec::new(),
            delta: Vec::new(),
            orphans: Vec::new(),
            arch: pulp::Arch::new(),
            fresh: Vec::new(),
            scratch: Scratch::default(),
        }
    }

    /// Makes room for more slots.
    pub(crate) fn grow(&mut self, slots: usize) {
        self.home.resize(slots, NONE);
        self.delta.resize(slots, SVector::zeros());
        self.scratch.local.resize(slots, NONE);
        self.scratch.changed.resize(slots, false);
    }

    /// Eliminates anew what depends on the factors of `involved` slots; returns how many slots that were.
    ///
    /// * `late` – slots to eliminate last.
    ///
    /// # Errors
    /// The slot at which a pivot was not positive. The tree is then as it was before.
    pub(crate) fn update(
        &mut self,
        involved: &[u32],
        late: &[u32],
        factors: &Factors<'_>,
    ) -> Result<usize, u32> {
        self.mark(involved);
        self.list_parts(factors);
        let Scratch { elimination, late: flags, affected, local, .. } = &mut self.scratch;
        flags.clear();
        flags.resize(affected.len(), false);
        for slot in late.iter().filter(|slot| local[**slot as usize] != NONE) {
            flags[local[*slot as usize] as usize] = true;
        }
        elimination.run(flags);
        let (arch, count) = (self.arch, self.scratch.affected.len());
        let outcome = arch.dispatch(Eliminate { tree: self, factors });
        if outcome.is_ok() {
            self.replace();
        }
        let Scratch { marked, is_marked, affected, local, fronts, pool, .. } = &mut self.scratch;
        marked.iter().for_each(|clique| is_marked[*clique as usize] = false);
        affected.iter().for_each(|slot| local[*slot as usize] = NONE);
        pool.append(fronts);
        outcome.map(|()| count)
    }

    /// Takes apart what depends on the factors of `involved` slots and puts nothing in its place; returns the slots
    /// that the next update has to eliminate, the involved ones among them.
    pub(crate) fn detach(&mut self, involved: &[u32]) -> Vec<u32> {
        self.mark(involved);
        let Self { cliques, unused, home, orphans, scratch, .. } = self;
        let Scratch { marked, is_marked, affected, local, pool, .. } = scratch;
        orphans.retain(|orphan| !is_marked[*orphan as usize]);
        for id in marked.iter() {
            for child in std::mem::take(&mut cliques[*id as usize].children) {
                if !is_marked[child as usize] {
                    cliques[child as usize].parent = NONE;
                    orphans.push(child);
                }
            }
        }
        for id in marked.iter() {
            let clique = &mut cliques[*id as usize];
            pool.push(std::mem::take(&mut clique.values));
            clique.slots.clear();
            clique.eliminated = 0;
            is_marked[*id as usize] = false;
            unused.push(*id);
        }
        for slot in affected.iter() {
            (home[*slot as usize], local[*slot as usize]) = (NONE, NONE);
        }
        std::mem::take(affected)
    }

    /// Takes out a slot that no clique holds; the slots after it move up.
    pub(crate) fn remove_slot(&mut self, slot: u32) {
        let at = slot as usize;
        self.home.remove(at);
        self.delta.remove(at);
        self.scratch.local.remove(at);
        self.scratch.changed.remove(at);
        let slots = self.cliques.iter_mut().flat_map(|clique| &mut clique.slots);
        slots.filter(|other| **other > slot).for_each(|other| *other -= 1);
    }

    /// Whether something was taken apart and not put together again.
    pub(crate) fn is_apart(&self) -> bool {
        !self.orphans.is_empty()
    }

    /// Finds the cliques from the involved slots up to the roots, and the slots they eliminate.
    fn mark(&mut self, involved: &[u32]) {
        let Scratch { marked, is_marked, affected, local, .. } = &mut self.scratch;
        marked.clear();
        affected.clear();
        is_marked.resize(self.cliques.len(), false);
        let mut take = |slot: u32| {
            if local[slot as usize] == NONE {
                local[slot as usize] = affected.len() as u32;
                affected.push(slot);
            }
        };
        for slot in involved {
            let mut clique = self.home[*slot as usize];
            if clique == NONE {
                take(*slot);
            }
            while clique != NONE && !is_marked[clique as usize] {
                is_marked[clique as usize] = true;
                marked.push(clique);
                let clique_at = &self.cliques[clique as usize];
                clique_at.slots[..clique_at.eliminated].iter().copied().for_each(&mut take);
                clique = clique_at.parent;
            }
        }
    }

    /// Gives the elimination its elements: factors between affected slots, and the orphans.
    fn list_parts(&mut self, factors: &Factors<'_>) {
        let Self { cliques, orphans, scratch, .. } = self;
        let Scratch { elimination, marked, is_marked, affected, local, parts, seen, .. } = scratch;
        elimination.clear();
        parts.clear();
        seen.resize(factors.models.len(), false);
        for slot in affected.iter() {
            for factor in &factors.touching[*slot as usize] {
                let slots = &factors.models[*factor as usize].slots;
                // a factor with a slot below is part of an orphan's Schur complement
                if !seen[*factor as usize] && slots.iter().all(|s| local[*s as usize] != NONE) {
                    seen[*factor as usize] = true;
                    elimination.push(slots.iter().map(|s| local[*s as usize]));
                    parts.push(Part::Factor(*factor));
                }
            }
        }
        let children = marked.iter().flat_map(|clique| &cliques[*clique as usize].children);
        for child in children.chain(orphans.iter()).filter(|child| !is_marked[**child as usize]) {
            let orphan = &cliques[*child as usize];
            elimination.push(orphan.slots[orphan.eliminated..].iter().map(|s| local[*s as usize]));
            parts.push(Part::Orphan(*child));
        }
        for part in parts.iter() {
            if let Part::Factor(factor) = part {
                seen[*factor as usize] = false;
            }
        }
    }

    #[inline(always)]
    fn eliminate(&mut self, factors: &Factors<'_>) -> Result<(), u32> {
        let Self { cliques, scratch, .. } = self;
        let Scratch { elimination, affected, local, parts, row, rows, fronts, pool, .. } = scratch;
        row.resize(affected.len(), 0);
        fronts.clear();
        let given = elimination.given();
        for f in 0..elimination.fronts.len() {
            let variables = elimination.variables(f);
            for (at, v) in variables.iter().enumerate() {
                row[*v as usize] = at as u32;
            }
            let mut values = pool.pop().unwrap_or_default();
            front::clear::<N>(&mut values, variables.len());
            for part in elimination.parts(f) {
                rows.clear();
                let source = match parts.get(*part as usize) {
                    Some(Part::Factor(id)) => {
                        let model = &factors.models[*id as usize];
                        rows.extend(model.slots.iter().map(|s| row[local[*s as usize] as usize]));
                        Source { values: &model.values, eliminated: 0 }
                    }
                    Some(Part::Orphan(id)) => {
                        let clique = &cliques[*id as usize];
                        let left = &clique.slots[clique.eliminated..];
                        rows.extend(left.iter().map(|s| row[local[*s as usize] as usize]));
                        Source { values: &clique.values, eliminated: clique.eliminated }
                    }
                    None => {
                        let child = *part as usize - given;
                        let eliminated = elimination.fronts[child].eliminated;
                        let left = &elimination.variables(child)[eliminated..];
                        rows.extend(left.iter().map(|v| row[*v as usize]));
                        Source { values: &fronts[child], eliminated }
                    }
                };
                front::add::<N>(&mut values, variables.len(), source, rows);
            }
            let outcome =
                front::eliminate::<N>(&mut values, variables.len(), elimination.fronts[f].eliminated);
            fronts.push(values);
            outcome.map_err(|column| affected[variables[column / N] as usize])?;
        }
        Ok(())
    }

    /// Puts the new fronts in the place of the marked cliques.
    fn replace(&mut self) {
        let Self { cliques, unused, home, orphans, fresh, scratch, .. } = self;
        let Scratch { elimination, marked, affected, parts, fronts, pool, .. } = scratch;
        orphans.clear();
        for id in marked.iter() {
            let clique = &mut cliques[*id as usize];
            pool.push(std::mem::take(&mut clique.values));
            clique.children.clear();
            clique.slots.clear();
            unused.push(*id);
        }
        fresh.clear();
        for (f, values) in fronts.drain(..).enumerate() {
            let id = unused.pop().unwrap_or_else(|| {
                cliques.push(Clique::default());
                cliques.len() as u32 - 1
            });
            fresh.push(id);
            let mut children = std::mem::take(&mut cliques[id as usize].children);
            for part in elimination.parts(f) {
                let child = match parts.get(*part as usize) {
                    Some(Part::Factor(_)) => continue,
                    Some(Part::Orphan(child)) => *child,
                    None => fresh[*part as usize - elimination.given()],
                };
                cliques[child as usize].parent = id;
                children.push(child);
            }
            let clique = &mut cliques[id as usize];
            clique.slots.extend(elimination.variables(f).iter().map(|v| affected[*v as usize]));
            clique.eliminated = elimination.fronts[f].eliminated;
            (clique.values, clique.children, clique.parent, clique.fresh) = (values, children, NONE, true);
            for slot in &clique.slots[..clique.eliminated] {
                home[*slot as usize] = id;
            }
        }
    }

    /// Computes the steps of the new cliques, and below them as far as steps change by more than `threshold`;
    /// `changed` receives the slots whose steps did.
    pub(crate) fn back_substitute(&mut self, threshold: f64, changed: &mut Vec<u32>) {
        let arch = self.arch;
        arch.dispatch(BackSubstitute { tree: self, threshold, changed });
    }

    #[inline(always)]
    fn spread(&mut self, threshold: f64, changed: &mut Vec<u32>) {
        changed.clear();
        self.scratch.stack.clear();
        for at in (0..self.fresh.len()).rev() {
            let id = self.fresh[at];
            self.solve_clique(id, threshold, changed);
            let Self { cliques, scratch, .. } = self;
            let below = cliques[id as usize].children.iter().filter(|c| !cliques[**c as usize].fresh);
            scratch.stack.extend(below);
        }
        for id in &self.fresh {
            self.cliques[*id as usize].fresh = false;
        }
        while let Some(id) = self.scratch.stack.pop() {
            let clique = &self.cliques[id as usize];
            if clique.slots[clique.eliminated..].iter().any(|s| self.scratch.changed[*s as usize]) {
                self.solve_clique(id, threshold, changed);
                self.scratch.stack.extend(&self.cliques[id as usize].children);
            }
        }
        changed.iter().for_each(|slot| self.scratch.changed[*slot as usize] = false);
    }

    #[inline(always)]
    fn solve_clique(&mut self, id: u32, threshold: f64, changed: &mut Vec<u32>) {
        let Self { cliques, delta, scratch, .. } = self;
        let Clique { slots, eliminated, values, .. } = &cliques[id as usize];
        scratch.x.clear();
        for slot in slots {
            scratch.x.extend_from_slice(delta[*slot as usize].as_slice());
        }
        front::back_substitute::<N>(values, slots.len(), *eliminated, &mut scratch.x);
        for (slot, x) in slots[..*eliminated].iter().zip(scratch.x.chunks_exact(N)) {
            let old = &mut delta[*slot as usize];
            let new = SVector::<f64, N>::from_column_slice(x);
            // below the threshold the old step stays, so that small changes cannot add up unnoticed below
            if (new - *old).amax() > threshold {
                *old = new;
                scratch.changed[*slot as usize] = true;
                changed.push(*slot);
            }
        }
    }
}

struct Eliminate<'a, 'b, const N: usize> {
    tree: &'a mut Tree<N>,
    factors: &'a Factors<'b>,
}

impl<const N: usize> pulp::NullaryFnOnce for Eliminate<'_, '_, N> {
    type Output = Result<(), u32>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.tree.eliminate(self.factors)
    }
}

struct BackSubstitute<'a, const N: usize> {
    tree: &'a mut Tree<N>,
    threshold: f64,
    changed: &'a mut Vec<u32>,
}

impl<const N: usize> pulp::NullaryFnOnce for BackSubstitute<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.tree.spread(self.threshold, self.changed);
    }
}
