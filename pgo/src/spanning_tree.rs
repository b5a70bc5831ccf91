use std::collections::{BTreeMap, VecDeque};

use draco_lie::LieGroup;

use crate::{Error, Key, Measurement, PoseGraph};

/// Moves the poses of `graph` to where composing measurements puts them: along the chain of consecutive indices
/// of a robot first (odometry is the safer guide), then breadth-first over what is left.
///
/// Fixed poses stay; a part of the graph without one starts from its smallest key, which stays where it is.
///
/// # Errors
/// [`Error::EmptyGraph`].
pub fn spanning_tree<const N: usize, G: LieGroup<N>>(graph: &mut PoseGraph<G, N>) -> Result<(), Error> {
    if graph.pose_count() == 0 {
        return Err(Error::EmptyGraph);
    }
    compose(graph, graph.fixed.clone())
}

/// The same with the poses to start from given.
pub(crate) fn compose<const N: usize, G: LieGroup<N>>(
    graph: &mut PoseGraph<G, N>,
    mut placed: Vec<bool>,
) -> Result<(), Error> {
    let mut tree = Tree::new(graph)?;
    let mut queue: VecDeque<u32> = (0..placed.len() as u32).filter(|s| placed[*s as usize]).collect();
    let slots: Vec<u32> = graph.slots.values().copied().collect();
    tree.spread(graph, &mut queue, &mut placed);
    for root in slots {
        if !placed[root as usize] {
            placed[root as usize] = true;
            queue.push_back(root);
            tree.spread(graph, &mut queue, &mut placed);
        }
    }
    Ok(())
}

struct Tree<G> {
    /// Edge to the next index of the same robot.
    steps: BTreeMap<u32, (u32, G)>,
    /// All edges of each slot, with the relative pose seen from it.
    touching: Vec<Vec<(u32, G)>>,
}

impl<G> Tree<G> {
    fn new<const N: usize>(graph: &PoseGraph<G, N>) -> Result<Self, Error>
    where
        G: LieGroup<N>,
    {
        let mut tree = Self { steps: BTreeMap::new(), touching: vec![Vec::new(); graph.pose_count()] };
        for (_, factor) in graph.factors() {
            let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
            let (a, b) = (graph.slot(*from)? as u32, graph.slot(*to)? as u32);
            if follows(*from, *to) {
                tree.steps.entry(a).or_insert((b, *measured));
            }
            tree.touching[a as usize].push((b, *measured));
            tree.touching[b as usize].push((a, measured.inverse()));
        }
        Ok(tree)
    }

    fn spread<const N: usize>(
        &mut self,
        graph: &mut PoseGraph<G, N>,
        queue: &mut VecDeque<u32>,
        placed: &mut [bool],
    ) where
        G: LieGroup<N>,
    {
        for start in queue.clone() {
            let mut at = start;
            while let Some((next, relative)) = self.steps.get(&at).filter(|(next, _)| !placed[*next as usize])
            {
                graph.poses[*next as usize] = graph.poses[at as usize].compose(relative).renormalize();
                placed[*next as usize] = true;
                queue.push_back(*next);
                at = *next;
            }
        }
        while let Some(at) = queue.pop_front() {
            for (next, relative) in &self.touching[at as usize] {
                if !placed[*next as usize] {
                    placed[*next as usize] = true;
                    graph.poses[*next as usize] = graph.poses[at as usize].compose(relative).renormalize();
                    queue.push_back(*next);
                }
            }
        }
    }
}

fn follows(from: Key, to: Key) -> bool {
    from.robot == to.robot && from.index.checked_add(1) == Some(to.index)
}
