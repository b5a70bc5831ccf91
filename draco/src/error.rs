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
    /// Registration failed.
    #[error("registration: {0}")]
    Registration(#[from] draco_registration::Error),
    /// Pose-graph optimisation failed.
    #[error("pose graph: {0}")]
    PoseGraph(#[from] draco_pgo::Error),
    /// A consistency test failed.
    #[error("consistency: {0}")]
    Consistency(#[from] draco_consistency::Error),
}

impl Error {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }
}

fn column_prefix(column: &Option<String>) -> String {
    column.as_ref().map(|name| format!("column `{name}`: ")).unwrap_or_default()
}
