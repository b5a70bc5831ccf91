/// Union-find whose root is always the smallest member, so that results do not depend on the order of unions.
#[derive(Debug, Clone, Default)]
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    pub(crate) fn push(&mut self) {
        self.parent.push(self.parent.len() as u32);
    }

    pub(crate) fn find(&mut self, mut a: usize) -> usize {
        while self.parent[a] as usize != a {
            self.parent[a] = self.parent[self.parent[a] as usize];
            a = self.parent[a] as usize;
        }
        a
    }

    /// [`DisjointSets::find`] without path compression, for readers.
    pub(crate) fn root(&self, mut a: usize) -> usize {
        while self.parent[a] as usize != a {
            a = self.parent[a] as usize;
        }
        a
    }

    pub(crate) fn union(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }
}
