use std::collections::BTreeSet;

use draco_lie::LieGroup;

use crate::{Error, Factor, FactorId, Measurement, PoseGraph, Solution};

/// The factors that share a loop with a closure, and their poses: the biconnected component of the closure.
///
/// What fixed poses and priors hold is joined to one more node, the world, which closes loops like any other.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Ascending.
    factors: Vec<FactorId>,
    /// Slots, ascending, without the world.
    slots: Vec<u32>,
    world: bool,
}

/// A block as a graph of its own, with its factors' names there and in the whole.
pub(super) struct Part<G, const N: usize> {
    pub(super) graph: PoseGraph<G, N>,
    pub(super) factors: Vec<(FactorId, FactorId)>,
}

/// Neighbours of each node as (node, factor); fixed poses reach the world by no factor.
type Adjacency = Vec<Vec<(u32, Option<FactorId>)>>;

impl Block {
    /// The block of `closure`; `None` when it closes no loop.
    pub(super) fn around<const N: usize, G: LieGroup<N>>(
        graph: &PoseGraph<G, N>,
        closure: FactorId,
    ) -> Result<Option<Self>, Error> {
        let factor = graph.factor(closure).ok_or(Error::UnknownFactor { factor: closure })?;
        let adjacency = adjacency(graph, Some(closure));
        let ends = nodes(graph, factor);
        let (Some(from), Some(to)) = (ends.first(), ends.get(1)) else { return Ok(None) };
        let mut search = Search::new(&adjacency);
        search.run(*from);
        if search.order[*to as usize] == UNSEEN {
            return Ok(None);
        }
        let mut inside = search.blocks_between(*from, *to);
        inside.sort_unstable();
        inside.dedup();
        let world = adjacency.len() as u32 - 1;
        let is_inside = |node: &u32| inside.binary_search(node).is_ok();
        let mut factors = BTreeSet::from([closure]);
        for node in &inside {
            for (other, id) in &adjacency[*node as usize] {
                if let Some(id) = id.filter(|_| is_inside(other)) {
                    factors.insert(id);
                }
            }
        }
        let slots: Vec<u32> = inside.iter().copied().filter(|node| *node != world).collect();
        Ok(Some(Self { factors: factors.into_iter().collect(), slots, world: is_inside(&world) }))
    }

    /// The block as a graph of its own; without the world in it, its first pose stays.
    pub(super) fn extract<const N: usize, G: LieGroup<N>>(
        &self,
        graph: &PoseGraph<G, N>,
    ) -> Result<Part<G, N>, Error> {
        let mut part = PoseGraph::new();
        for slot in &self.slots {
            let at = *slot as usize;
            part.add_pose(graph.keys[at], graph.poses[at])?;
            part.set_fixed(graph.keys[at], graph.fixed[at])?;
        }
        if !self.world
            && let Some(first) = self.slots.first()
        {
            part.set_fixed(graph.keys[*first as usize], true)?;
        }
        let mut factors = Vec::with_capacity(self.factors.len());
        for id in &self.factors {
            if let Some(factor) = graph.factor(*id) {
                factors.push((part.push(factor.clone()), *id));
            }
        }
        Ok(Part { graph: part, factors })
    }

    /// Moves the poses of the block to a solution, and what hangs on them along.
    pub(super) fn settle<const N: usize, G: LieGroup<N>>(
        &self,
        graph: &mut PoseGraph<G, N>,
        solution: &Solution<G>,
    ) {
        let adjacency = adjacency(graph, None);
        let world = adjacency.len() as u32 - 1;
        let mut moved = vec![false; adjacency.len()];
        moved[world as usize] = true;
        self.slots.iter().for_each(|slot| moved[*slot as usize] = true);
        for slot in &self.slots {
            let at = *slot as usize;
            let old = graph.poses[at];
            let Some(new) = solution.pose(graph.keys[at]) else { continue };
            graph.poses[at] = *new;
            let correction = new.compose(&old.inverse());
            let mut stack = vec![*slot];
            while let Some(node) = stack.pop() {
                for (other, _) in &adjacency[node as usize] {
                    let other_at = *other as usize;
                    if !moved[other_at] {
                        moved[other_at] = true;
                        if !graph.fixed[other_at] {
                            graph.poses[other_at] = correction.compose(&graph.poses[other_at]).renormalize();
                        }
                        stack.push(*other);
                    }
                }
            }
        }
    }
}

/// Nodes a factor joins; a factor on one pose joins it to the world.
fn nodes<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, factor: &Factor<G, N>) -> Vec<u32> {
    let mut nodes: Vec<u32> =
        factor.keys().iter().filter_map(|key| graph.slot(*key).ok()).map(|slot| slot as u32).collect();
    if nodes.len() == 1 || matches!(factor.measurement, Measurement::Prior { .. }) {
        nodes.push(graph.keys.len() as u32);
    }
    nodes
}

fn adjacency<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    without: Option<FactorId>,
) -> Adjacency {
    let world = graph.keys.len() as u32;
    let mut adjacency: Adjacency = vec![Vec::new(); graph.keys.len() + 1];
    for (id, factor) in graph.factors().filter(|(id, _)| Some(*id) != without) {
        let nodes = nodes(graph, factor);
        for (i, a) in nodes.iter().enumerate() {
            for b in &nodes[i + 1..] {
                adjacency[*a as usize].push((*b, Some(id)));
                adjacency[*b as usize].push((*a, Some(id)));
            }
        }
    }
    for slot in (0..world).filter(|slot| graph.fixed[*slot as usize]) {
        adjacency[slot as usize].push((world, None));
        adjacency[world as usize].push((slot, None));
    }
    adjacency
}

const UNSEEN: u32 = u32::MAX;

/// Depth-first search that finds the biconnected components (Hopcroft, Tarjan, *Efficient algorithms for graph
/// manipulation*, 1973). A component is named by the lower node of its topmost tree edge.
struct Search<'a> {
    adjacency: &'a Adjacency,
    order: Vec<u32>,
    parent: Vec<u32>,
    /// Component of the tree edge above each node.
    component: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(adjacency: &'a Adjacency) -> Self {
        let n = adjacency.len();
        Self { adjacency, order: vec![UNSEEN; n], parent: vec![UNSEEN; n], component: vec![UNSEEN; n] }
    }

    fn run(&mut self, root: u32) {
        let n = self.adjacency.len();
        let mut low = vec![0; n];
        let mut next = vec![0usize; n];
        let (mut path, mut open, mut count) = (vec![root], Vec::new(), 1);
        self.order[root as usize] = 0;
        while let Some(node) = path.last().copied() {
            let at = node as usize;
            if let Some((other, _)) = self.adjacency[at].get(next[at]).copied() {
                next[at] += 1;
                if self.order[other as usize] == UNSEEN {
                    self.order[other as usize] = count;
                    low[other as usize] = count;
                    count += 1;
                    self.parent[other as usize] = node;
                    path.push(other);
                    open.push(other);
                } else if other != self.parent[at] {
                    low[at] = low[at].min(self.order[other as usize]);
                }
                continue;
            }
            path.pop();
            let above = self.parent[at];
            if above == UNSEEN {
                continue;
            }
            low[above as usize] = low[above as usize].min(low[at]);
            if low[at] >= self.order[above as usize] {
                // the nodes opened since this one form a component with the node above
                while let Some(member) = open.pop() {
                    self.component[member as usize] = node;
                    if member == node {
                        break;
                    }
                }
            }
        }
    }

    /// Nodes of all components on the way between two nodes.
    fn blocks_between(&self, from: u32, to: u32) -> Vec<u32> {
        // the search started at `from`, so the way is the tree path from `to` up
        let mut components = BTreeSet::new();
        let mut node = to;
        while node != from {
            components.insert(self.component[node as usize]);
            node = self.parent[node as usize];
        }
        let mut nodes = vec![from];
        for node in 0..self.component.len() as u32 {
            if components.contains(&self.component[node as usize]) {
                nodes.push(node);
                nodes.push(self.parent[node as usize]);
            }
        }
        nodes
    }
}
