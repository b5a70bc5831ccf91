use nalgebra::{SMatrix, SVector};

use crate::Error;
use crate::cloud::Cloud;
use crate::error::check;
use crate::icp::{Covariance, IcpParams, Registration, Target};
use crate::motion::RigidMotion;

/// One of the answers of [`Target::align_from`].
#[derive(Debug, Clone, PartialEq)]
pub struct StartMode<G, const N: usize> {
    /// The answer.
    pub registration: Registration<G, N>,
    /// Mean of `1 - min(d, τ)²/τ²` over all source points, `τ` the overlap radius: 1 when each lies on a target
    /// point, 0 when none is near one.
    pub support: f64,
    /// Index of the first start that led here.
    pub start: usize,
}

/// What [`Target::align_from`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct MultiStart<G, const N: usize> {
    /// Separate answers, the best supported first; never empty.
    pub modes: Vec<StartMode<G, N>>,
}

impl<G, const N: usize> MultiStart<G, N> {
    /// The best supported answer.
    pub fn best(&self) -> &StartMode<G, N> {
        &self.modes[0]
    }

    /// Support of the second answer over that of the first, in [0, 1]; near 1 the scans fit in two ways. `None` when
    /// all starts led to one answer.
    pub fn ambiguity(&self) -> Option<f64> {
        let (first, second) = (self.modes[0].support, self.modes.get(1)?.support);
        Some(if first > 0.0 { second / first } else { 1.0 })
    }
}

/// Poses on a lattice about `centre`: `steps[k]` of them along axis `k` of the tangent (translation, then rotation),
/// evenly from `-half_widths[k]` to `half_widths[k]`, the centre alone for one step. The centre comes first if the
/// lattice holds it.
///
/// # Errors
/// [`Error::Parameter`] for a width that is negative or not finite, no step, or more than 100 000 poses.
pub fn starts_around<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    centre: &G,
    half_widths: &SVector<f64, N>,
    steps: &[usize; N],
) -> Result<Vec<G>, Error> {
    for (width, count) in half_widths.iter().zip(steps) {
        check("half_widths", *width, *width >= 0.0 && width.is_finite(), "0 or more")?;
        check("steps", *count as f64, *count > 0, "1 or more")?;
    }
    let total = steps.iter().fold(1usize, |n, count| n.saturating_mul(*count));
    check("steps", total as f64, total <= 100_000, "at most 100 000 poses in all")?;
    let mut starts: Vec<(bool, G)> = (0..total)
        .map(|mut index| {
            let xi = SVector::<f64, N>::from_fn(|axis, _| {
                let (at, count) = (index % steps[axis], steps[axis]);
                index /= count;
                if count == 1 {
                    0.0
                } else {
                    half_widths[axis] * (2.0 * at as f64 / (count - 1) as f64 - 1.0)
                }
            });
            (xi != SVector::<f64, N>::zeros(), centre.compose(&G::exp(&xi)))
        })
        .collect();
    starts.sort_by_key(|(off_centre, _)| *off_centre);
    Ok(starts.into_iter().map(|(_, start)| start).collect())
}

impl<const D: usize> Target<D> {
    /// Aligns `source` from each of `starts` and returns the separate answers, best supported first, ties to the
    /// earlier start.
    ///
    /// Two answers are the same when their root mean square displacement of the source's points is below the
    /// overlap radius. See [`starts_around`] for a lattice of starts, and [`crate::global`] for a search that
    /// certifies what it found.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] without a start, and those of [`Target::align`].
    pub fn align_from<const N: usize, G: RigidMotion<D, N>>(
        &self,
        source: &Cloud<D>,
        starts: &[G],
        params: &IcpParams,
    ) -> Result<MultiStart<G, N>, Error> {
        if starts.is_empty() {
            return Err(Error::TooFewPoints { what: "the list of starts", found: 0, needed: 1 });
        }
        let quick = IcpParams { covariance: Covariance::Residual, ..params.clone() };
        let spread = Spread::of(source.points());
        let mut found: Vec<(f64, usize, G)> = Vec::with_capacity(starts.len());
        for (index, start) in starts.iter().enumerate() {
            let pose = self.align(source, start, &quick)?.target_from_source;
            found.push((self.support(source, &pose, params.overlap_radius), index, pose));
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut modes: Vec<(f64, usize, G)> = Vec::new();
        for candidate in found {
            let same = |mode: &(f64, usize, G)| spread.apart(&mode.2, &candidate.2) < params.overlap_radius;
            if !modes.iter().any(same) {
                modes.push(candidate);
            }
        }
        let finish = |(support, start, pose): (f64, usize, G)| {
            self.align(source, &pose, params).map(|registration| StartMode { registration, support, start })
        };
        Ok(MultiStart { modes: modes.into_iter().map(finish).collect::<Result<_, _>>()? })
    }

    /// Aligns `source` through a chain of stages, each started where the one before ended; the answer is that of the
    /// last, its iterations those of all.
    ///
    /// [`IcpParams::coarse_to_fine`] makes the usual chain of shrinking reach.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] without a stage, and those of [`Target::align`].
    pub fn align_in_stages<const N: usize, G: RigidMotion<D, N>>(
        &self,
        source: &Cloud<D>,
        initial: &G,
        stages: &[IcpParams],
    ) -> Result<Registration<G, N>, Error> {
        let Some((last, before)) = stages.split_last() else {
            return Err(Error::TooFewPoints { what: "the list of stages", found: 0, needed: 1 });
        };
        let (mut pose, mut iterations) = (*initial, 0);
        for stage in before {
            let quick = IcpParams { covariance: Covariance::Residual, ..stage.clone() };
            let found = self.align(source, &pose, &quick)?;
            (pose, iterations) = (found.target_from_source, iterations + found.iterations);
        }
        let mut found = self.align(source, &pose, last)?;
        found.iterations += iterations;
        Ok(found)
    }

    /// Mean of `1 - min(d, radius)²/radius²` over the source's points at a pose.
    pub(crate) fn support<const N: usize, G: RigidMotion<D, N>>(
        &self,
        source: &Cloud<D>,
        pose: &G,
        radius: f64,
    ) -> f64 {
        let (r, t) = (pose.rotation_matrix(), pose.translation_vector() - self.origin);
        let near = |p: &SVector<f64, D>| {
            let neighbor = self.tree.nearest_within(&(r * p + t), radius);
            neighbor.map_or(0.0, |n| 1.0 - n.distance_sq / (radius * radius))
        };
        source.points().iter().map(near).sum::<f64>() / source.len().max(1) as f64
    }
}

/// Mean and scatter of points: enough to tell how far two poses put them apart.
struct Spread<const D: usize> {
    mean: SVector<f64, D>,
    scatter: SMatrix<f64, D, D>,
}

impl<const D: usize> Spread<D> {
    fn of(points: &[SVector<f64, D>]) -> Self {
        let count = points.len().max(1) as f64;
        let mean = points.iter().sum::<SVector<f64, D>>() / count;
        let scatter = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<SMatrix<f64, D, D>>();
        Self { mean, scatter: scatter / count }
    }

    /// Root mean square distance between the places two poses give the points.
    fn apart<const N: usize, G: RigidMotion<D, N>>(&self, a: &G, b: &G) -> f64 {
        let turn = a.rotation_matrix() - b.rotation_matrix();
        let shift = turn * self.mean + a.translation_vector() - b.translation_vector();
        ((turn * self.scatter * turn.transpose()).trace() + shift.norm_squared()).max(0.0).sqrt()
    }
}
