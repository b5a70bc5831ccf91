//! Objects of a map: density clusters with their rectangles, and persistent cells.
mod cells;
pub use cells::{CellParams, persistent_cells};
use nalgebra::Point2;
/// TEMP
#[derive(Debug, Clone, Default)]
pub struct ObjectParams;
/// TEMP
#[allow(missing_docs)]
pub struct Object {
    pub id: u32,
    pub centroid: Point2<f64>,
    pub length: f64,
    pub breadth: f64,
    pub corners: [Point2<f64>; 4],
}
/// TEMP
pub fn extract(
    _k: &[crate::keyframe::Keyframe],
    _p: &[nalgebra::Isometry2<f64>],
    _o: &ObjectParams,
) -> Result<Vec<Object>, crate::Error> {
    Ok(vec![])
}
