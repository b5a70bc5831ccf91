/// Marks "none" in lists of indices.
const NONE: u32 = u32::MAX;

/// One front of an elimination: the variables eliminated together and those that remain behind them.
#[derive(Debug, Clone)]
pub(crate) struct Front {
    /// Eliminated variables first, then the separator, as a span of [`Elimination::variables`].
    begin: usize,
    end: usize,
    pub(crate) eliminated: usize,
    parts: (usize, usize),
}

/// Orders a set of variables by minimum degree and finds the fronts of their elimination on the way.
///
/// The graph is given by elements: sets of variables that are coupled with each other, be it by a factor or by
/// what an earlier elimination left behind. Eliminating a variable merges the elements it is in into one, so the
/// elements that a variable has swallowed are exactly what its front must sum up; no elimination tree and no
/// symbolic factorisation are needed beside. Degrees are the upper bounds of Amestoy, Davis, Duff, *An
/// approximate minimum degree ordering algorithm*, 1996; a variable whose elimination adds nothing to the
/// pattern joins the front at hand.
#[derive(Debug, Clone, Default)]
pub(crate) struct Elimination {
    pub(crate) fronts: Vec<Front>,
    variables: Vec<u32>,
    parts: Vec<u32>,
    /// Members of element `e` are `members[span[e].0..span[e].1]`; elements that fronts leave behind follow the
    /// given ones and lie in `variables`.
    members: Vec<u32>,
    span: Vec<(usize, usize)>,
    given: usize,
    absorbed: Vec<bool>,
    /// Elements of variable `v` are `elements[first[v]..first[v] + count[v]]`.
    elements: Vec<u32>,
    first: Vec<usize>,
    count: Vec<u32>,
    /// Elements' sizes outside the front at hand, valid where `stamp` is the present one.
    outside: Vec<u32>,
    stamp: Vec<u32>,
    seen: Vec<u32>,
    queue: Buckets,
}

impl Elimination {
    /// Forgets the last problem.
    pub(crate) fn clear(&mut self) {
        self.members.clear();
        self.span.clear();
    }

    /// Adds an element; elements are numbered in the order they are added.
    pub(crate) fn push(&mut self, members: impl Iterator<Item = u32>) {
        let begin = self.members.len();
        self.members.extend(members);
        self.span.push((begin, self.members.len()));
    }

    /// Eliminates all variables `0..late.len()`; those marked `late` come after all others.
    pub(crate) fn run(&mut self, late: &[bool]) {
        let n = late.len();
        self.start(n);
        for v in 0..n {
            let degree = self.elements_of(v).iter().map(|e| self.size(*e) - 1).sum();
            self.queue.insert(v as u32, self.key(v, degree, late));
        }
        while let Some(pivot) = self.queue.pop() {
            self.eliminate(pivot, late);
        }
    }

    /// Variables of a front, eliminated ones first.
    pub(crate) fn variables(&self, front: usize) -> &[u32] {
        let Front { begin, end, .. } = self.fronts[front];
        &self.variables[begin..end]
    }

    /// Elements that a front sums up: those below [`Elimination::given`] were pushed, `given + f` is what front
    /// `f` leaves behind.
    pub(crate) fn parts(&self, front: usize) -> &[u32] {
        let (begin, end) = self.fronts[front].parts;
        &self.parts[begin..end]
    }

    /// Number of elements that were pushed.
    pub(crate) fn given(&self) -> usize {
        self.given
    }

    fn start(&mut self, n: usize) {
        self.given = self.span.len();
        self.fronts.clear();
        self.variables.clear();
        self.parts.clear();
        refill(&mut self.absorbed, self.given, false);
        refill(&mut self.outside, self.given, 0);
        refill(&mut self.stamp, self.given, NONE);
        refill(&mut self.seen, n, NONE);
        refill(&mut self.count, n, 0);
        for v in &self.members {
            self.count[*v as usize] += 1;
        }
        self.first.clear();
        let mut total = 0;
        for count in &mut self.count {
            self.first.push(total);
            total += *count as usize;
            *count = 0;
        }
        refill(&mut self.elements, total, 0);
        for (e, (begin, end)) in self.span.iter().enumerate() {
            for v in &self.members[*begin..*end] {
                let v = *v as usize;
                self.elements[self.first[v] + self.count[v] as usize] = e as u32;
                self.count[v] += 1;
            }
        }
        self.queue.clear(n);
    }

    fn elements_of(&self, v: usize) -> &[u32] {
        &self.elements[self.first[v]..self.first[v] + self.count[v] as usize]
    }

    fn size(&self, e: u32) -> u32 {
        let (begin, end) = self.span[e as usize];
        (end - begin) as u32
    }

    fn key(&self, v: usize, degree: u32, late: &[bool]) -> u32 {
        let n = late.len() as u32;
        degree.min(n - 1) + if late[v] { n } else { 0 }
    }

    fn eliminate(&mut self, pivot: u32, late: &[bool]) {
        let id = self.span.len() as u32;
        let (begin, parts) = (self.variables.len(), self.parts.len());
        self.variables.push(pivot);
        self.seen[pivot as usize] = id;
        self.merge(pivot, id);
        self.measure(begin + 1, id);
        // variables that only see the front go with it
        let mut eliminated = 1;
        for at in begin + 1..self.variables.len() {
            let v = self.variables[at] as usize;
            let alone = self.elements_of(v).iter().all(|e| self.outside[*e as usize] == 0);
            if alone && late[v] == late[pivot as usize] {
                self.swallow(v);
                self.queue.remove(v as u32);
                self.variables.swap(at, begin + eliminated);
                eliminated += 1;
            }
        }
        let end = self.variables.len();
        self.fronts.push(Front { begin, end, eliminated, parts: (parts, self.parts.len()) });
        self.span.push((begin + eliminated, end));
        self.absorbed.push(false);
        self.outside.push(0);
        self.stamp.push(NONE);
        let own = (end - begin - eliminated) as u32;
        for at in begin + eliminated..end {
            let v = self.variables[at] as usize;
            let mut degree = own - 1;
            let mut kept = 0;
            for k in self.first[v]..self.first[v] + self.count[v] as usize {
                let e = self.elements[k];
                if !self.absorbed[e as usize] {
                    degree += self.outside[e as usize];
                    self.elements[self.first[v] + kept] = e;
                    kept += 1;
                }
            }
            self.elements[self.first[v] + kept] = id;
            self.count[v] = kept as u32 + 1;
            self.queue.remove(v as u32);
            self.queue.insert(v as u32, self.key(v, degree, late));
        }
    }

    /// Takes the elements of a variable into the front at hand.
    fn swallow(&mut self, v: usize) {
        for k in self.first[v]..self.first[v] + self.count[v] as usize {
            let e = self.elements[k];
            if !self.absorbed[e as usize] {
                self.absorbed[e as usize] = true;
                self.parts.push(e);
            }
        }
    }

    /// Lists the variables that share an element with the pivot.
    fn merge(&mut self, pivot: u32, id: u32) {
        let first = self.parts.len();
        self.swallow(pivot as usize);
        for at in first..self.parts.len() {
            let e = self.parts[at] as usize;
            let (from, until) = self.span[e];
            for k in from..until {
                let v = if e < self.given { self.members[k] } else { self.variables[k] };
                if self.seen[v as usize] != id {
                    self.seen[v as usize] = id;
                    self.variables.push(v);
                }
            }
        }
    }

    /// Counts, for each element that meets the front, its members outside; drops elements already swallowed.
    fn measure(&mut self, from: usize, id: u32) {
        for at in from..self.variables.len() {
            let v = self.variables[at] as usize;
            let mut kept = 0;
            for k in self.first[v]..self.first[v] + self.count[v] as usize {
                let e = self.elements[k];
                if self.absorbed[e as usize] {
                    continue;
                }
                if self.stamp[e as usize] != id {
                    self.stamp[e as usize] = id;
                    self.outside[e as usize] = self.size(e);
                }
                self.outside[e as usize] -= 1;
                self.elements[self.first[v] + kept] = e;
                kept += 1;
            }
            self.count[v] = kept as u32;
        }
    }
}

fn refill<T: Copy>(list: &mut Vec<T>, length: usize, value: T) {
    list.clear();
    list.resize(length, value);
}

/// Variables by key, smallest first; within a key the last one in comes out first.
#[derive(Debug, Clone, Default)]
struct Buckets {
    head: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    key: Vec<u32>,
    least: usize,
}

impl Buckets {
    fn clear(&mut self, n: usize) {
        refill(&mut self.head, 2 * n, NONE);
        refill(&mut self.next, n, NONE);
        refill(&mut self.previous, n, NONE);
        refill(&mut self.key, n, NONE);
        self.least = 0;
    }

    fn insert(&mut self, v: u32, key: u32) {
        let head = self.head[key as usize];
        self.key[v as usize] = key;
        self.next[v as usize] = head;
        self.previous[v as usize] = NONE;
        if head != NONE {
            self.previous[head as usize] = v;
        }
        self.head[key as usize] = v;
        self.least = self.least.min(key as usize);
    }

    fn remove(&mut self, v: u32) {
        let (previous, next) = (self.previous[v as usize], self.next[v as usize]);
        if previous == NONE {
            self.head[self.key[v as usize] as usize] = next;
        } else {
            self.next[previous as usize] = next;
        }
        if next != NONE {
            self.previous[next as usize] = previous;
        }
    }

    fn pop(&mut self) -> Option<u32> {
        while self.head.get(self.least).copied()? == NONE {
            self.least += 1;
        }
        let v = self.head[self.least];
        self.remove(v);
        Some(v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn run(elements: &[&[u32]], late: &[bool]) -> Elimination {
        let mut elimination = Elimination::default();
        elimination.clear();
        for element in elements {
            elimination.push(element.iter().copied());
        }
        elimination.run(late);
        elimination
    }

    /// Checks every front against elimination on a graph kept as sets.
    fn check(elements: &[&[u32]], late: &[bool]) {
        let n = late.len();
        let mut graph = vec![BTreeSet::new(); n];
        for element in elements {
            for a in *element {
                graph[*a as usize].extend(element.iter().copied().filter(|b| b != a));
            }
        }
        let found = run(elements, late);
        let mut done = Vec::new();
        let mut swallowed = vec![0; found.given() + found.fronts.len()];
        for (f, front) in found.fronts.iter().enumerate() {
            let variables = found.variables(f);
            for (k, v) in variables[..front.eliminated].iter().enumerate() {
                let neighbours = std::mem::take(&mut graph[*v as usize]);
                let expected: BTreeSet<u32> = variables[k + 1..].iter().copied().collect();
                assert_eq!(neighbours, expected, "front {f}, variable {v}");
                for a in &neighbours {
                    graph[*a as usize].extend(neighbours.iter().copied().filter(|b| b != a));
                    graph[*a as usize].remove(v);
                }
                done.push(*v);
            }
            found.parts(f).iter().for_each(|e| swallowed[*e as usize] += 1);
        }
        done.sort_unstable();
        assert_eq!(done, (0..n as u32).collect::<Vec<u32>>());
        for (e, times) in swallowed.iter().enumerate() {
            let root = e >= found.given() && {
                let f = e - found.given();
                found.variables(f).len() == found.fronts[f].eliminated
            };
            assert_eq!(*times, usize::from(!root), "element {e}");
        }
    }

    #[test]
    fn fronts_are_those_of_elimination_on_sets() {
        check(&[&[0]], &[false]);
        check(&[&[0, 1], &[1, 2], &[2, 3], &[3, 0]], &[false; 4]);
        check(&[&[0, 1], &[1, 2], &[2, 3], &[3, 4], &[0, 4], &[1, 3]], &[false, false, true, false, true]);
        check(&[&[0, 1, 2], &[2, 3], &[3, 4, 5], &[5, 6], &[6, 0], &[4]], &[false; 7]);
        check(&[&[0, 1], &[2, 3], &[2]], &[false; 4]);
    }

    #[test]
    fn late_variables_come_last() {
        let late = [true, false, false, false, false];
        let found = run(&[&[0, 1], &[1, 2], &[2, 3], &[3, 4]], &late);
        let order: Vec<u32> = (0..found.fronts.len())
            .flat_map(|f| found.variables(f)[..found.fronts[f].eliminated].to_vec())
            .collect();
        assert_eq!(order.last(), Some(&0));
    }
}
