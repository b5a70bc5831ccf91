//! What a run leaves behind: table, summary, HTML page, trajectories, graph.
//!
//! A mission fills a [`RunReport`] with raw facts; everything shown is derived from it here, so that the table, the
//! summary and the page cannot disagree. Start with [`RunReport::table`] and [`write_run`].

mod chart;
mod html;
mod map;
mod objects;
mod output;
mod run;
mod summary;
pub(crate) mod svg;
mod table;

pub use output::{check_output_folder, write_run};
pub use run::{ClosureReport, KeyframeRef, Matched, ObjectReport, RobotReport, RunReport, Traffic};
pub use summary::{RobotSummary, Summary, TeamSummary};
