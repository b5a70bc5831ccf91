/// Points a leaf holds at most; measured best of 4, 8, 12, 16 on scans of 1 000 and clouds of 30 000 points.
pub(super) const LEAF: usize = 8;

/// The coordinates of a leaf's points once more, axis by axis, so that they are scanned side by side; what is left
/// over is NaN, which is near nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf<const D: usize> {
    pub(super) coordinates: [[f64; LEAF]; D],
    /// Tree position of the first point.
    pub(super) begin: u32,
}
