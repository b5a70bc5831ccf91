use crate::{FactorId, Key};

/// What was wrong with an input of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A pose was added twice.
    #[error("pose {key} is already in the graph")]
    DuplicateKey {
        /// The key that was there already.
        key: Key,
    },
    /// A pose was named that the graph does not hold.
    #[error("pose {key} is not in the graph")]
    UnknownKey {
        /// The missing key.
        key: Key,
    },
    /// A factor was named that the graph does not hold.
    #[error("factor {} is not in the graph", factor.0)]
    UnknownFactor {
        /// The missing factor.
        factor: FactorId,
    },
    /// A relative pose from a pose to itself.
    #[error("the relative pose {key} -> {key} joins a pose to itself")]
    SelfEdge {
        /// The pose.
        key: Key,
    },
    /// A NaN or an infinity in a pose, a measurement or an information matrix.
    #[error("the {what} of {key} holds a number that is not finite")]
    NotFinite {
        /// What held it.
        what: &'static str,
        /// The pose, or the first pose of the factor.
        key: Key,
    },
    /// An information matrix that is not symmetric or not positive definite.
    #[error("the information matrix of the factor at {key} is not symmetric positive definite")]
    Information {
        /// The first pose of the factor.
        key: Key,
    },
    /// A kernel parameter that is not a positive finite number.
    #[error("the kernel of the factor at {key} has a parameter that is not positive and finite")]
    KernelParameter {
        /// The first pose of the factor.
        key: Key,
    },
    /// A user-defined factor that breaks its promises.
    #[error("user-defined factor: {reason}")]
    CustomFactor {
        /// What is wrong.
        reason: String,
    },
    /// There is nothing to solve.
    #[error("the graph holds no poses")]
    EmptyGraph,
    /// A part of the graph whose absolute position nothing determines.
    #[error("nothing anchors the component of pose {key} ({size} poses): add a prior or fix a pose")]
    NoGauge {
        /// The smallest key of the component.
        key: Key,
        /// Number of poses in it.
        size: usize,
    },
    /// A part of the graph that is not joined to the rest, where one component is required.
    #[error("pose {key} ({size} poses) hangs loose: no factor joins it to pose {root}")]
    Disconnected {
        /// The smallest key of the loose component.
        key: Key,
        /// Number of poses in it.
        size: usize,
        /// The smallest key of the graph's first component.
        root: Key,
    },
    /// The Hessian is not positive definite: some direction of this pose is not determined.
    #[error("the problem does not determine pose {key}: its Hessian is not positive definite")]
    Indefinite {
        /// Pose at whose elimination a pivot was not positive.
        key: Key,
    },
    /// A pose was taken out of a smoother, and what is asked is not known before its next update.
    #[error("the covariance of pose {key} is not known before the next update")]
    OutOfDate {
        /// The pose that was asked for.
        key: Key,
    },
    /// A parameter outside its range.
    #[error("parameter {name} = {value} is out of range")]
    Parameter {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A line of a file that cannot be read.
    #[error("line {line}: {reason}")]
    Parse {
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// A file that cannot be opened, read or written.
    #[error("{path}: {reason}")]
    File {
        /// The path as given.
        path: String,
        /// What the operating system said.
        reason: String,
    },
    /// A key that does not fit the file format.
    #[error("key {key} does not fit a 64-bit id (robot below 256, index below 2^56)")]
    KeyTooLarge {
        /// The key.
        key: Key,
    },
    /// What is wrong in a file.
    #[error("{path}: {error}")]
    InFile {
        /// The path as given.
        path: String,
        /// The error, most often [`Error::Parse`] with the line.
        error: Box<Error>,
    },
    /// Two files of a team that contradict each other.
    #[error("pose {key} has one value in {first} and another in {second}")]
    Contradiction {
        /// The pose.
        key: Key,
        /// The file that was read first.
        first: String,
        /// The other file.
        second: String,
    },
    /// Two trajectories to compare of different lengths.
    #[error(
        "the estimate has {estimate} poses and the reference {reference}: they are compared pose by pose"
    )]
    Lengths {
        /// Poses of the estimate.
        estimate: usize,
        /// Poses of the reference.
        reference: usize,
    },
    /// A trajectory that holds a NaN or an infinity.
    #[error("pose {index} of the {trajectory} holds a number that is not finite")]
    Trajectory {
        /// `estimate` or `reference`.
        trajectory: &'static str,
        /// Position of the pose in the trajectory.
        index: usize,
    },
    /// Positions too few, or all on a point or a line, so that no one alignment is best.
    #[error("the positions lie on a point or a line: no alignment is unique")]
    Alignment,
    /// A relative error over a distance the trajectory does not hold.
    #[error("no two poses are {delta} apart")]
    NoPairs {
        /// The distance, in the unit asked for.
        delta: f64,
    },
}
