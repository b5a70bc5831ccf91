mod align;
mod anderson;
mod association;
mod covariance;
mod kernel;
mod normal_equations;
mod outcome;
mod params;
mod rejector;
mod space_order;
mod target;

pub use kernel::Kernel;
pub use outcome::{Registration, ResidualStatistics, Termination};
pub use params::{Acceleration, Covariance, IcpParams, Matcher, Optimizer, Residual, StopRule};
pub use rejector::Rejector;
pub(crate) use target::centre;
pub use target::{Overlap, Target};
