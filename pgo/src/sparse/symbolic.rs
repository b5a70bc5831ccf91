use super::minimum_fill::minimum_fill;

const NONE: u32 = u32::MAX;

/// Where the Schur complement of one supernode goes: its rows `from..until` are columns of supernode `target`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    pub(crate) from: u32,
    pub(crate) until: u32,
    pub(crate) target: u32,
    /// Start of the list that maps rows `from..` of the source to rows of the target.
    pub(crate) map: usize,
}

/// The pattern of the Cholesky factor of a symmetric block matrix, by supernodes.
///
/// A supernode is a range of columns with one common list of rows, stored as one dense column-major panel.
#[derive(Debug, Clone, Default)]
pub(crate) struct Symbolic {
    /// `position[old] = new` column.
    pub(crate) position: Vec<u32>,
    /// `order[new] = old` column.
    pub(crate) order: Vec<u32>,
    /// Supernode `s` owns columns `start[s]..start[s + 1]`.
    pub(crate) start: Vec<u32>,
    /// Supernode of each column.
    pub(crate) owner: Vec<u32>,
    /// Supernode `s` has rows `rows[row_start[s]..row_start[s + 1]]`, its own columns first.
    pub(crate) row_start: Vec<usize>,
    pub(crate) rows: Vec<u32>,
    /// Panel of supernode `s` starts at `panel_start[s]`, counted in blocks.
    pub(crate) panel_start: Vec<usize>,
    pub(crate) runs: Vec<Run>,
    pub(crate) run_start: Vec<usize>,
    pub(crate) map: Vec<u32>,
}

impl Symbolic {
    /// Orders and analyses a symmetric pattern with `columns` block columns.
    ///
    /// * `pairs` – the off-diagonal blocks, each once, in any orientation.
    /// * `block` – scalars a block is wide; decides how much padding a wider supernode is worth and how wide it may be.
    pub(crate) fn new(columns: usize, pairs: &[(u32, u32)], block: usize) -> Self {
        Self::with_order(minimum_fill(columns, pairs), pairs, block)
    }

    /// The same with a given elimination order, which is refined by a postorder of the elimination tree.
    pub(crate) fn with_order(order: Vec<u32>, pairs: &[(u32, u32)], block: usize) -> Self {
        let columns = order.len();
        let position = inverse(&order);
        let upper = upper_pattern(columns, pairs, &position);
        let parent = elimination_tree(&upper);
        let post = postorder(&parent);
        let order: Vec<u32> = post.iter().map(|c| order[*c as usize]).collect();
        let position = inverse(&order);
        let rank = inverse(&post);
        let parent: Vec<u32> = post
            .iter()
            .map(|c| parent[*c as usize])
            .map(|p| if p == NONE { NONE } else { rank[p as usize] })
            .collect();
        let lower = lower_pattern(columns, pairs, &position);
        let columns = column_structures(&lower, &parent);
        let nodes = supernodes(&columns, &parent, block);
        Self { position, order, ..Self::default() }.with_supernodes(&nodes, &columns)
    }

    fn with_supernodes(mut self, nodes: &[Supernode], columns: &Structures) -> Self {
        let n = columns.span.len();
        self.owner = vec![0; n];
        self.start = Vec::with_capacity(nodes.len() + 1);
        self.row_start = vec![0];
        self.panel_start = vec![0];
        for (s, node) in nodes.iter().enumerate() {
            self.start.push(node.first);
            let begin = self.rows.len();
            for column in node.first..=node.last {
                self.owner[column as usize] = s as u32;
                self.rows.push(column);
            }
            // the structure of a column holds those of its children, so the last column's is the whole
            self.rows.extend_from_slice(columns.rows(node.last));
            let (width, height) = ((node.last - node.first + 1) as usize, self.rows.len() - begin);
            self.row_start.push(self.rows.len());
            self.panel_start.push(self.panel_start[s] + width * height);
        }
        self.start.push(n as u32);
        self.find_runs();
        self
    }

    fn find_runs(&mut self) {
        self.run_start = vec![0];
        for s in 0..self.supernodes() {
            let rows = &self.rows[self.row_start[s]..self.row_start[s + 1]];
            let mut from = self.width(s);
            while from < rows.len() {
                let target = self.owner[rows[from] as usize] as usize;
                let end = self.start[target + 1];
                let until = from + rows[from..].partition_point(|row| *row < end);
                let target_rows = &self.rows[self.row_start[target]..self.row_start[target + 1]];
                let map = self.map.len();
                let mut at = 0;
                for row in &rows[from..] {
                    while target_rows[at] < *row {
                        at += 1;
                    }
                    self.map.push(at as u32);
                }
                self.runs.push(Run { from: from as u32, until: until as u32, target: target as u32, map });
                from = until;
            }
            self.run_start.push(self.runs.len());
        }
        // kept for as long as the factor, or the graph
        self.rows.shrink_to_fit();
        self.runs.shrink_to_fit();
        self.map.shrink_to_fit();
    }

    pub(crate) fn columns(&self) -> usize {
        self.order.len()
    }

    pub(crate) fn supernodes(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    pub(crate) fn width(&self, s: usize) -> usize {
        (self.start[s + 1] - self.start[s]) as usize
    }

    pub(crate) fn rows(&self, s: usize) -> &[u32] {
        &self.rows[self.row_start[s]..self.row_start[s + 1]]
    }

    pub(crate) fn runs(&self, s: usize) -> &[Run] {
        &self.runs[self.run_start[s]..self.run_start[s + 1]]
    }

    /// Blocks in all panels.
    pub(crate) fn panel_blocks(&self) -> usize {
        self.panel_start.last().copied().unwrap_or(0)
    }

    /// Supernode, row within it and column within it of block `(row, column)`, `row ≥ column`, of the permuted
    /// matrix; the pattern must hold that block.
    pub(crate) fn locate(&self, row: u32, column: u32) -> (usize, usize, usize) {
        let s = self.owner[column as usize] as usize;
        let at = self.rows(s).partition_point(|r| *r < row);
        (s, at, (column - self.start[s]) as usize)
    }
}

fn inverse(order: &[u32]) -> Vec<u32> {
    let mut position = vec![0; order.len()];
    for (new, old) in order.iter().enumerate() {
        position[*old as usize] = new as u32;
    }
    position
}

/// Compressed columns of a strict triangle.
struct Pattern {
    start: Vec<u32>,
    rows: Vec<u32>,
}

impl Pattern {
    fn new(columns: usize, entries: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut start = vec![0u32; columns + 1];
        for (_, column) in entries.clone() {
            start[column as usize + 1] += 1;
        }
        for c in 0..columns {
            start[c + 1] += start[c];
        }
        let mut rows = vec![0; start[columns] as usize];
        let mut next = start.clone();
        for (row, column) in entries {
            rows[next[column as usize] as usize] = row;
            next[column as usize] += 1;
        }
        Self { start, rows }
    }

    fn column(&self, c: usize) -> &[u32] {
        &self.rows[self.start[c] as usize..self.start[c + 1] as usize]
    }

    fn columns(&self) -> usize {
        self.start.len() - 1
    }
}

fn upper_pattern(columns: usize, pairs: &[(u32, u32)], position: &[u32]) -> Pattern {
    let placed = pairs.iter().map(|(a, b)| (position[*a as usize], position[*b as usize]));
    Pattern::new(columns, placed.map(|(a, b)| (a.min(b), a.max(b))))
}

fn lower_pattern(columns: usize, pairs: &[(u32, u32)], position: &[u32]) -> Pattern {
    let placed = pairs.iter().map(|(a, b)| (position[*a as usize], position[*b as usize]));
    Pattern::new(columns, placed.map(|(a, b)| (a.max(b), a.min(b))))
}

/// Parent of each column in the elimination tree (Liu's algorithm with path compression).
fn elimination_tree(upper: &Pattern) -> Vec<u32> {
    let n = upper.columns();
    let (mut parent, mut ancestor) = (vec![NONE; n], vec![NONE; n]);
    for column in 0..n {
        for row in upper.column(column) {
            let mut at = *row;
            while at != NONE && at != column as u32 {
                let next = ancestor[at as usize];
                ancestor[at as usize] = column as u32;
                if next == NONE {
                    parent[at as usize] = column as u32;
                }
                at = next;
            }
        }
    }
    parent
}

/// `post[k]` is the `k`-th column of a depth-first postorder of the forest; children in ascending order.
fn postorder(parent: &[u32]) -> Vec<u32> {
    let n = parent.len();
    let (mut head, mut next) = (vec![NONE; n], vec![NONE; n]);
    let mut roots = NONE;
    for column in (0..n).rev() {
        let list = if parent[column] == NONE { &mut roots } else { &mut head[parent[column] as usize] };
        next[column] = *list;
        *list = column as u32;
    }
    let mut post = Vec::with_capacity(n);
    let mut stack = Vec::new();
    let mut root = roots;
    while root != NONE {
        stack.push(root);
        while let Some(top) = stack.last().copied() {
            let child = head[top as usize];
            if child == NONE {
                post.push(top);
                stack.pop();
            } else {
                head[top as usize] = next[child as usize];
                stack.push(child);
            }
        }
        root = next[root as usize];
    }
    post
}

/// Rows below the diagonal of each column of the factor, as spans of one shared list.
struct Structures {
    span: Vec<(usize, usize)>,
    list: Vec<u32>,
}

impl Structures {
    fn rows(&self, column: u32) -> &[u32] {
        let (begin, end) = self.span[column as usize];
        &self.list[begin..end]
    }

    fn count(&self, column: u32) -> usize {
        let (begin, end) = self.span[column as usize];
        end - begin
    }
}

/// The structure of a column is that of its own entries and of its children, less the children themselves.
/// A column that continues its only relevant child shares that child's list.
fn column_structures(lower: &Pattern, parent: &[u32]) -> Structures {
    let n = lower.columns();
    let (mut head, mut next) = (vec![NONE; n], vec![NONE; n]);
    let mut seen = vec![NONE; n];
    let mut structures = Structures { span: Vec::with_capacity(n), list: Vec::new() };
    for column in 0..n {
        let begin = structures.list.len();
        seen[column] = column as u32;
        for row in lower.column(column) {
            if seen[*row as usize] != column as u32 {
                seen[*row as usize] = column as u32;
                structures.list.push(*row);
            }
        }
        let mut largest: Option<(usize, usize)> = None;
        let mut child = head[column];
        while child != NONE {
            let (from, until) = structures.span[child as usize];
            if largest.is_none_or(|(a, b)| b - a < until - from) {
                largest = Some((from, until));
            }
            for at in from..until {
                let row = structures.list[at];
                if seen[row as usize] != column as u32 {
                    seen[row as usize] = column as u32;
                    structures.list.push(row);
                }
            }
            child = next[child as usize];
        }
        let count = structures.list.len() - begin;
        match largest {
            Some((from, until)) if until - from == count + 1 => {
                structures.list.truncate(begin);
                structures.span.push((from + 1, until));
            }
            _ => {
                structures.list[begin..].sort_unstable();
                structures.span.push((begin, begin + count));
            }
        }
        if parent[column] != NONE {
            next[column] = head[parent[column] as usize];
            head[parent[column] as usize] = column as u32;
        }
    }
    structures
}

struct Supernode {
    first: u32,
    last: u32,
    /// Explicit zeros, in blocks, that merging added.
    zeros: usize,
}

/// Fundamental supernodes, merged with their parent while that adds few zeros.
///
/// The thresholds are those of Chen, Davis, Hager, Rajamanickam, *Algorithm 887: CHOLMOD*, 2008, section 2.3,
/// on scalar widths, but for a lower one at small widths of large blocks, which are work enough for the kernels by
/// themselves, and whose zeros cost memory.
fn supernodes(columns: &Structures, parent: &[u32], block: usize) -> Vec<Supernode> {
    let n = columns.span.len() as u32;
    let mut nodes: Vec<Supernode> = Vec::new();
    let mut column = 0;
    while column < n {
        let first = column;
        while column + 1 < n
            && parent[column as usize] == column + 1
            && columns.count(column) == columns.count(column + 1) + 1
        {
            column += 1;
        }
        let mut node = Supernode { first, last: column, zeros: 0 };
        column += 1;
        while let Some(child) = nodes.last() {
            if parent[child.last as usize] != node.first {
                break;
            }
            let Some(zeros) = worth_merging(child, &node, columns, block) else { break };
            node.first = child.first;
            node.zeros = zeros;
            nodes.pop();
        }
        nodes.push(node);
    }
    nodes.iter().flat_map(|node| slices(node, (WIDEST / block).max(1) as u32)).collect()
}

/// Scalar columns of the widest supernode. A panel stores the whole square on its diagonal, so cutting a wide one
/// saves memory; cut panels are still wide enough for the kernels, and lie in the cache.
const WIDEST: usize = 48;

/// Cuts a supernode into slices of about equal width.
fn slices(node: &Supernode, widest: u32) -> impl Iterator<Item = Supernode> + use<> {
    let (first, width) = (node.first, node.last - node.first + 1);
    let count = width.div_ceil(widest);
    let (begin, zeros) = (move |k| first + k * width / count, node.zeros);
    (0..count).map(move |k| Supernode { first: begin(k), last: begin(k + 1) - 1, zeros })
}

/// Zeros of the merged supernode, if they are few enough.
fn worth_merging(child: &Supernode, node: &Supernode, columns: &Structures, block: usize) -> Option<usize> {
    let child_width = (child.last - child.first + 1) as usize;
    let width = (node.last - node.first + 1) as usize;
    let child_below = columns.count(child.last);
    let below = columns.count(node.last);
    let zeros = child.zeros + node.zeros + child_width * (width + below - child_below);
    let merged = child_width + width;
    let size = merged * (merged + 1) / 2 + merged * below;
    let fraction = zeros as f64 / size as f64;
    let limit = match merged * block {
        0..=4 => 1.0,
        5..=16 if block > 3 => 0.1,
        5..=16 => 0.5,
        17..=48 => 0.1,
        _ => 0.05,
    };
    (zeros == 0 || fraction < limit).then_some(zeros)
}
