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
    /// A hyperedge has a wrong number of vertices, or a hypergraph was asked for edges of less than two.
    #[error("{given} vertices given for a hyperedge; the hypergraph joins {order}, at least 2")]
    EdgeOrder {
        /// Number of vertices that an edge of the hypergraph joins.
        order: usize,
        /// Number given.
        given: usize,
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
    /// An affinity lies outside (0, 1].
    #[error("pair {a}, {b} has affinity {affinity}; affinities lie above 0 and up to 1")]
    BadAffinity {
        /// One vertex.
        a: usize,
        /// The other.
        b: usize,
        /// The affinity.
        affinity: f64,
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
    /// A closure names a pose that no trajectory has, or one without covariance.
    #[error("closure {closure}: robot {robot} has no pose {index} with a covariance")]
    UnknownPose {
        /// Index of the closure.
        closure: usize,
        /// Robot it names.
        robot: u32,
        /// Pose it names.
        index: usize,
    },
    /// A closure's measured pose is not finite.
    #[error("closure {closure}: the measured pose is not finite")]
    ClosurePose {
        /// Index of the closure.
        closure: usize,
    },
    /// A closure joins a pose to itself.
    #[error("closure {closure} joins a pose to itself")]
    ClosureToItself {
        /// Index of the closure.
        closure: usize,
    },
    /// A closure's covariance is not finite, symmetric and positive definite.
    #[error("closure {closure}: the covariance is not positive definite")]
    ClosureCovariance {
        /// Index of the closure.
        closure: usize,
    },
    /// A closure is of another robot pair than the first one.
    #[error("closure {closure} is of another robot pair than closure 0")]
    MixedRobots {
        /// Index of the closure.
        closure: usize,
    },
    /// A prior between two maps is not finite, not positive definite, or joins a map to itself.
    #[error(
        "map transform {prior} is not a finite pose between two robots with a positive definite covariance"
    )]
    MapTransform {
        /// Index of the prior.
        prior: usize,
    },
    /// The covariance of a vote given the others is not positive definite: the drift covariances of its robots are not
    /// those of any distribution, or too large for the closures' precision.
    #[error(
        "robots {source_robot} and {target_robot}: no positive definite covariance at closure {closure:?} (none: a map transform)"
    )]
    VoteCovariance {
        /// Robot that holds the source.
        source_robot: u32,
        /// The other robot.
        target_robot: u32,
        /// Smallest closure of the vote; `None` for a prior between maps.
        closure: Option<usize>,
    },
    /// A trajectory does not have one step fewer than poses.
    #[error("{poses} poses do not go with {steps} odometry steps")]
    StepCount {
        /// Number of poses.
        poses: usize,
        /// Number of steps.
        steps: usize,
    },
    /// A pose of a trajectory is not finite.
    #[error("pose {index} of the trajectory is not finite")]
    TrajectoryPose {
        /// Index of the pose.
        index: usize,
    },
    /// The covariance of an odometry step is not finite and positive semidefinite.
    #[error("odometry step {step}: the covariance is not positive semidefinite")]
    StepCovariance {
        /// Index of the step.
        step: usize,
    },
    /// A joint covariance has the wrong size or names a pose twice or outside the trajectory.
    #[error("a joint covariance of size {size} does not fit {poses} distinct poses of the trajectory")]
    JointCovariance {
        /// Number of poses named.
        poses: usize,
        /// Rows of the covariance.
        size: usize,
    },
    /// A probability is outside (0, 1).
    #[error("probability {value} is not between 0 and 1")]
    Probability {
        /// The value.
        value: f64,
    },
    /// A parameter is outside its range.
    #[error("parameter `{name}` is outside its range")]
    Parameter {
        /// Its name.
        name: &'static str,
    },
    /// A range measurement is not finite and positive, or its sigma is not.
    #[error("range {range} is not a positive length with a positive sigma")]
    BadRange {
        /// Index of the measurement.
        range: usize,
    },
    /// A generator cannot make what was asked for.
    #[error("cannot generate: {reason}")]
    Generator {
        /// Why.
        reason: &'static str,
    },
}
