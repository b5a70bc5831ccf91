/// What a caller can get wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An edge or a set names a vertex that the graph does not have.
    #[error("vertex {vertex} does not exist: the graph has {vertices} vertices")]
    UnknownVertex {
        /// The vertex named.
        vertex: usize,
        /// Number of vertices of the graph.
        vertices: usize,
    },
    /// An edge joins a vertex to itself.
    #[error("vertex {vertex} has an edge to itself")]
    SelfLoop {
        /// The vertex.
        vertex: usize,
    },
    /// A vertex weight is negative, infinite or not a number.
    #[error("vertex {vertex} has weight {weight}; weights are finite and not negative")]
    BadWeight {
        /// The vertex.
        vertex: usize,
        /// Its weight.
        weight: f64,
    },
    /// A dense graph of this size would not fit into memory; [`SparseGraph`](crate::graph::SparseGraph) does.
    #[error("{vertices} vertices are too many for bit rows (limit {limit}); use a sparse graph")]
    TooManyVertices {
        /// Number of vertices asked for.
        vertices: usize,
        /// Largest number possible.
        limit: usize,
    },
    /// One list has another length than the set it describes.
    #[error("{given} values given for {expected} elements")]
    LengthMismatch {
        /// Length of the list.
        given: usize,
        /// Length expected.
        expected: usize,
    },
    /// A line of a graph file cannot be read.
    #[error("line {line}: {reason}")]
    Parse {
        /// Line number, from one.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// A file could not be opened or read.
    #[error("cannot read {path}: {reason}")]
    Io {
        /// The file.
        path: String,
        /// What the operating system says.
        reason: String,
    },
}
