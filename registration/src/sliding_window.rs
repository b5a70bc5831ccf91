use std::collections::VecDeque;

use nalgebra::SVector;

use crate::downsample::medoid_downsample;
use crate::error::check;
use crate::{Error, RigidMotion};

/// The last keyframes of one vehicle, merged into one set of points: a target for scans that alone show too little.
///
/// Single sonar scans are streaks that cover each other badly; walls show when 8 to 30 of them are put together.
///
/// ```
/// use draco_registration::SlidingWindow;
/// use nalgebra::{Isometry2, Vector2};
/// let mut window = SlidingWindow::<Isometry2<f64>, 2>::new(2)?;
/// for k in 0..3 {
///     let world_from_frame = Isometry2::translation(f64::from(k), 0.0);
///     window.push(world_from_frame, vec![Vector2::new(5.0, 0.0)])?;
/// }
/// // the oldest has left; the others, seen from the last
/// let last = Isometry2::translation(2.0, 0.0);
/// assert_eq!(window.merged(&last, 0.35)?, [Vector2::new(4.0, 0.0), Vector2::new(5.0, 0.0)]);
/// # Ok::<(), draco_registration::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SlidingWindow<G, const D: usize> {
    capacity: usize,
    frames: VecDeque<(G, Vec<SVector<f64, D>>)>,
}

impl<G, const D: usize> SlidingWindow<G, D> {
    /// An empty window that holds at most `capacity` keyframes.
    ///
    /// # Errors
    /// [`Error::Parameter`] when `capacity` is 0.
    pub fn new(capacity: usize) -> Result<Self, Error> {
        check("capacity", capacity as f64, capacity > 0, "1 or more")?;
        Ok(Self { capacity, frames: VecDeque::with_capacity(capacity + 1) })
    }

    /// Number of keyframes held.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether no keyframe is held.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Adds a keyframe, its points (metres) in its own frame; the oldest leaves a full window.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`], [`Error::NonFinite`] for a pose with NaN.
    pub fn push<const N: usize>(
        &mut self,
        world_from_frame: G,
        points: Vec<SVector<f64, D>>,
    ) -> Result<(), Error>
    where
        G: RigidMotion<D, N>,
    {
        check_pose(&world_from_frame)?;
        if let Some(index) = points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(Error::NonFinitePoint { index });
        }
        self.frames.push_back((world_from_frame, points));
        if self.frames.len() > self.capacity {
            self.frames.pop_front();
        }
        Ok(())
    }

    /// Gives all keyframes new poses, oldest first, as after an optimisation of the trajectory.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] when there is not one pose a keyframe, [`Error::NonFinite`]; the window is then
    /// unchanged.
    pub fn set_poses<const N: usize>(&mut self, world_from_frames: &[G]) -> Result<(), Error>
    where
        G: RigidMotion<D, N>,
    {
        if world_from_frames.len() != self.frames.len() {
            return Err(Error::LengthMismatch {
                what: "poses of a sliding window",
                found: world_from_frames.len(),
                expected: self.frames.len(),
            });
        }
        world_from_frames.iter().try_for_each(check_pose)?;
        for (frame, pose) in self.frames.iter_mut().zip(world_from_frames) {
            frame.0 = *pose;
        }
        Ok(())
    }

    /// The points of all keyframes in the frame at `world_from_reference`, thinned to the medoid of each cell of
    /// `cell` metres, so that what was seen often does not count often.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a cell that is not positive, [`Error::NonFinite`].
    pub fn merged<const N: usize>(
        &self,
        world_from_reference: &G,
        cell: f64,
    ) -> Result<Vec<SVector<f64, D>>, Error>
    where
        G: RigidMotion<D, N>,
    {
        check_pose(world_from_reference)?;
        let mut points = Vec::with_capacity(self.frames.iter().map(|(_, points)| points.len()).sum());
        for (pose, own) in &self.frames {
            let reference_from_frame = world_from_reference.between(pose);
            points.extend(own.iter().map(|p| reference_from_frame.transform(p)));
        }
        medoid_downsample(&points, cell)
    }
}

fn check_pose<const D: usize, const N: usize, G: RigidMotion<D, N>>(pose: &G) -> Result<(), Error> {
    if pose.to_row_major().iter().all(|v| v.is_finite()) {
        Ok(())
    } else {
        Err(Error::NonFinite { what: "the pose of a keyframe" })
    }
}
