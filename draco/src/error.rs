use std::path::{Path, PathBuf};

/// What was wrong with an input of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A table lacks a column that has to be there.
    #[error("{}:1: column `{column}` is missing", file.display())]
    MissingColumn {
        /// The table's file.
        file: PathBuf,
        /// The column's name.
        column: &'static str,
    },
    /// One cell, or one line, of a table is not what it has to be.
    #[error("{}:{line}: {}{reason}", file.display(), column_prefix(column))]
    Table {
        /// The table's file.
        file: PathBuf,
        /// Line of the file, counting from 1; the header is line 1.
        line: u64,
        /// The column, where the fault is in one cell.
        column: Option<String>,
        /// What is wrong, with the offending value.
        reason: String,
    },
    /// A folder that a result cannot replace.
    #[error("{}: {reason}", path.display())]
    OutputFolder {
        /// The folder.
        path: PathBuf,
        /// What is in the way.
        reason: String,
    },
    /// A mission without robots.
    #[error("the mission has no robots")]
    NoRobots,
    /// A robot without keyframes.
    #[error("robot {robot} has no keyframes")]
    EmptyRobot {
        /// The robot.
        robot: u32,
    },
    /// A robot that the link was not made for.
    #[error("robot {robot} is not on this link")]
    UnknownRobot {
        /// The robot.
        robot: u32,
    },
    /// A factor of a robot's graph whose covariance cannot be inverted.
    #[error("robot {robot}, factor {from} to {to}: the covariance cannot be inverted")]
    Covariance {
        /// The robot.
        robot: u32,
        /// Keyframe measured from.
        from: u32,
        /// Keyframe measured.
        to: u32,
    },
    /// A measurement of a robot's own map whose covariance cannot be inverted.
    #[error("own measurement {from} to {to}: the covariance cannot be inverted")]
    LocalCovariance {
        /// Keyframe measured from.
        from: u32,
        /// Keyframe measured.
        to: u32,
    },
    /// Seeds of the experiment `chaos` on which something did not hold that must.
    #[error("{} of {flown} seeds broke what must hold{}", failures.len(), lines(failures))]
    Chaos {
        /// How many seeds were flown.
        flown: usize,
        /// Those that failed, ascending in seed.
        failures: Vec<ChaosFailure>,
    },
    /// A state file that cannot be used.
    #[error("{reason}")]
    State {
        /// What is wrong with it.
        reason: String,
    },
    /// A network between processes that cannot be used.
    #[error("{endpoint}: {reason}")]
    Network {
        /// The endpoint, or what kind of network it is.
        endpoint: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A message that cannot be sent.
    #[error(transparent)]
    Wire(#[from] crate::message::WireError),
    /// Pose-graph optimisation failed.
    #[error(transparent)]
    PoseGraph(#[from] draco_pgo::Error),
    /// A consistency test failed.
    #[error(transparent)]
    Consistency(#[from] draco_consistency::Error),
    /// Registration failed.
    #[error(transparent)]
    Registration(#[from] draco_registration::Error),
    /// Object matching failed.
    #[error(transparent)]
    Matching(#[from] draco_graphmatch::Error),
    /// A parameter outside its range.
    #[error("{name} = {value}: {reason}")]
    Parameter {
        /// The parameter's name.
        name: &'static str,
        /// The offending value.
        value: f64,
        /// What it has to be.
        reason: &'static str,
    },
}

/// A seed of the experiment `chaos` that failed; told with the command that repeats it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("seed {seed}: {reason}; repeat with `draco experiment chaos --first-seed {seed} --seeds 1`")]
pub struct ChaosFailure {
    /// The seed.
    pub seed: u64,
    /// What did not hold.
    pub reason: String,
}

impl Error {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }
}

fn lines(failures: &[ChaosFailure]) -> String {
    failures.iter().map(|failure| format!("\n{failure}")).collect()
}

fn column_prefix(column: &Option<String>) -> String {
    column.as_ref().map(|name| format!("column `{name}`: ")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_failed_seed_is_told_with_its_command() {
        let failure = |seed, reason: &str| ChaosFailure { seed, reason: reason.into() };
        let error = Error::Chaos { flown: 50, failures: vec![failure(7, "apart"), failure(31, "panic: no")] };
        let expected = "2 of 50 seeds broke what must hold\n\
            seed 7: apart; repeat with `draco experiment chaos --first-seed 7 --seeds 1`\n\
            seed 31: panic: no; repeat with `draco experiment chaos --first-seed 31 --seeds 1`";
        assert_eq!(error.to_string(), expected);
    }
}
