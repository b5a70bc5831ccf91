use std::collections::{BTreeMap, BTreeSet};

use draco_lie::LieGroup;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::graph::{find, union};
use crate::pattern::HELD;
use crate::problem::Problem;
use crate::{Error, Factor, FactorId, Gauge, Key, PoseGraph};

/// The quadratic model of a cost by a few poses, with what lies between them at its best.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The poses.
    pub keys: Vec<Key>,
    /// Hessian by the right perturbations of the poses, order translation then rotation within each.
    pub information: DMatrix<f64>,
    /// Gradient.
    pub gradient: DVector<f64>,
}

/// Models that together are what `factors` of `graph`, at its present poses, say about the poses `shared`.
///
/// What lies between the shared poses falls into parts that only shared poses join. Each part is a model of the
/// shared poses around it, so a robot on a long way without loops of its own tells of a chain, not of a dense matrix.
pub(crate) fn condense<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    shared: &BTreeSet<Key>,
    factors: impl Iterator<Item = FactorId>,
) -> Result<Vec<Model>, Error> {
    let mut models = Vec::new();
    for part in parts(graph, shared, factors)? {
        let subgraph = extract(graph, &part)?;
        let around: Vec<Key> =
            subgraph.poses().map(|(key, _)| key).filter(|key| shared.contains(key)).collect();
        if !around.is_empty() {
            models.push(eliminate(&subgraph, around)?);
        }
    }
    Ok(models)
}

/// The factors, grouped by the part of what lies between the shared poses that they touch; one that touches none is
/// a group of its own.
fn parts<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    shared: &BTreeSet<Key>,
    factors: impl Iterator<Item = FactorId>,
) -> Result<Vec<Vec<FactorId>>, Error> {
    let mut parent: Vec<u32> = (0..graph.pose_count() as u32).collect();
    let mut placed = Vec::new();
    let mut groups = Vec::new();
    for id in factors {
        let Some(factor) = graph.factor(id) else { continue };
        let mut first = None;
        for key in factor.keys() {
            if shared.contains(&key) || graph.is_fixed(key) {
                continue;
            }
            let slot = graph.slot(key)? as u32;
            union(&mut parent, *first.get_or_insert(slot), slot);
        }
        match first {
            Some(slot) => placed.push((slot, id)),
            None => groups.push(vec![id]),
        }
    }
    let mut by_root: BTreeMap<u32, Vec<FactorId>> = BTreeMap::new();
    for (slot, id) in placed {
        by_root.entry(find(&mut parent, slot)).or_default().push(id);
    }
    groups.extend(by_root.into_values());
    Ok(groups)
}

/// Some factors of a graph with their poses, as a graph.
pub(crate) fn extract<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    factors: &[FactorId],
) -> Result<PoseGraph<G, N>, Error> {
    let factors: Vec<&Factor<G, N>> = factors.iter().filter_map(|id| graph.factor(*id)).collect();
    let keys: BTreeSet<Key> = factors.iter().flat_map(|factor| factor.keys()).collect();
    let mut part = PoseGraph::new();
    for key in keys {
        part.add_pose(key, *graph.pose(key).ok_or(Error::UnknownKey { key })?)?;
        part.set_fixed(key, graph.is_fixed(key))?;
    }
    for factor in factors {
        part.push(factor.clone());
    }
    Ok(part)
}

/// A block between an eliminated column and a pose that stays.
type Mixed<const N: usize> = (usize, SMatrix<f64, N, N>);

/// Hessian and gradient of the cost of `graph` by the poses `keys`, with all others eliminated.
pub(crate) fn eliminate<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    keys: Vec<Key>,
) -> Result<Model, Error> {
    let mut all = Problem::new(graph, &[])?;
    all.linearise(&graph.poses);
    let mut held = graph.clone();
    for key in &keys {
        held.set_fixed(*key, true)?;
    }
    let gauge = held.gauge_keys(Gauge::HoldFirst)?;
    let mut inner = Problem::new(&held, &gauge)?;
    inner.linearise(&graph.poses);
    let mut place = vec![HELD; graph.pose_count()];
    for (index, key) in keys.iter().enumerate() {
        place[graph.slot(*key)?] = index as u32;
    }
    let side = keys.len() * N;
    let mut model = Model { information: DMatrix::zeros(side, side), gradient: DVector::zeros(side), keys };
    for (column, slot) in all.pattern.slots.iter().enumerate() {
        let at = place[*slot as usize];
        if at != HELD {
            let at = at as usize * N;
            model.information.view_mut((at, at), (N, N)).copy_from(&all.hessian.diagonal[column]);
            model.gradient.rows_mut(at, N).copy_from(&all.gradient[column]);
        }
    }
    let mut mixed: Vec<Vec<Mixed<N>>> = vec![Vec::new(); model.keys.len()];
    for (block, (row, column)) in all.hessian.off_diagonal.iter().zip(&all.pattern.pairs) {
        let slots = [*row, *column].map(|c| all.pattern.slots[c as usize] as usize);
        let columns = slots.map(|s| inner.pattern.columns[s]);
        match slots.map(|s| place[s]) {
            [HELD, HELD] => {}
            [HELD, at] if columns[0] != HELD => mixed[at as usize].push((columns[0] as usize, *block)),
            [at, HELD] if columns[1] != HELD => {
                mixed[at as usize].push((columns[1] as usize, block.transpose()));
            }
            [a, b] if a != HELD && b != HELD => {
                let (a, b) = (a as usize * N, b as usize * N);
                model.information.view_mut((a, b), (N, N)).copy_from(block);
                model.information.view_mut((b, a), (N, N)).copy_from(&block.transpose());
            }
            _ => {}
        }
    }
    if inner.free() > 0 {
        subtract(graph, &inner, &mixed, &mut model)?;
    }
    Ok(model)
}

/// Subtracts from the model what the poses of `inner` contribute once they are at their best.
fn subtract<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    inner: &Problem<G, N>,
    mixed: &[Vec<Mixed<N>>],
    model: &mut Model,
) -> Result<(), Error> {
    let mut cholesky = inner.cholesky(&graph.elimination);
    cholesky
        .factor(&inner.hessian, None)
        .map_err(|c| Error::Indefinite { key: graph.keys[inner.pattern.slots[c] as usize] })?;
    let zero = SVector::<f64, N>::zeros();
    let touching = |x: &[SVector<f64, N>], other: usize| -> SVector<f64, N> {
        mixed[other].iter().fold(zero, |sum, (at, block)| sum + block.tr_mul(&x[*at]))
    };
    let mut x = inner.gradient.clone();
    cholesky.solve(&mut x);
    for other in 0..mixed.len() {
        let mut rows = model.gradient.rows_mut(other * N, N);
        rows -= touching(&x, other);
    }
    for (shared, blocks) in mixed.iter().enumerate() {
        for c in 0..N {
            x.fill(zero);
            for (at, block) in blocks {
                x[*at] += block.column(c);
            }
            cholesky.solve(&mut x);
            for other in 0..mixed.len() {
                let mut column = model.information.view_mut((other * N, shared * N + c), (N, 1));
                column -= touching(&x, other);
            }
        }
    }
    let symmetric = (&model.information + model.information.transpose()) * 0.5;
    model.information.copy_from(&symmetric);
    Ok(())
}
