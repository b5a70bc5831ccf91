use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::{CustomFactor, Error, Key};

/// One of the things a measurement may mean.
#[derive(Debug, Clone, PartialEq)]
pub struct MixtureComponent<G, const N: usize> {
    /// Prior probability of this meaning; only ratios matter.
    pub weight: f64,
    /// Measured relative pose, or pose.
    pub measured: G,
    /// Information of the residual, order translation then rotation.
    pub information: SMatrix<f64, N, N>,
}

/// A measurement with several possible meanings, of which the likeliest at the present poses counts.
///
/// With `e_k` the residual of component `k` the cost is
///
/// ```text
/// min_k  ½ e_kᵀ Ω_k e_k - ln(w_k √|Ω_k|)  +  const,
/// ```
///
/// the constant such that the likeliest component costs nothing at its mean. The residual that is reported has
/// `N + 1` entries: the whitened `e_k` of the chosen component, and the root of twice what choosing it costs.
///
/// A closure that may be false is a mixture of itself and of a wide, improbable component
/// ([`MaxMixture::or_outlier`]). Several meanings, such as two doors that look alike, are several components.
/// Add it by [`crate::PoseGraph::add_custom`].
///
/// **Source**: Olson, Agarwal, *Inference on networks of mixtures for robust robot mapping*, 2012, equation 4.
#[derive(Debug, Clone)]
pub struct MaxMixture<G, const N: usize> {
    keys: Vec<Key>,
    components: Vec<Component<G, N>>,
}

#[derive(Debug, Clone)]
struct Component<G, const N: usize> {
    measured: G,
    /// `Lᵀ` with `L Lᵀ` the information.
    root: SMatrix<f64, N, N>,
    /// Cost of choosing this component.
    price: f64,
}

impl<const N: usize, G: LieGroup<N>> MaxMixture<G, N> {
    /// A relative pose, of `to` seen from `from`, with several possible values.
    ///
    /// # Errors
    /// [`Error::SelfEdge`]; [`Error::CustomFactor`] without components; [`Error::Parameter`] for a weight that is
    /// not positive; [`Error::NotFinite`], [`Error::Information`].
    pub fn between(from: Key, to: Key, components: &[MixtureComponent<G, N>]) -> Result<Self, Error> {
        if from == to {
            return Err(Error::SelfEdge { key: from });
        }
        Self::new(vec![from, to], components)
    }

    /// A pose with several possible values.
    ///
    /// # Errors
    /// As [`MaxMixture::between`].
    pub fn prior(key: Key, components: &[MixtureComponent<G, N>]) -> Result<Self, Error> {
        Self::new(vec![key], components)
    }

    /// A relative pose that is false with probability `outlier`, and then says next to nothing: its deviations
    /// are `stretch` times as large.
    ///
    /// # Errors
    /// As [`MaxMixture::between`], and [`Error::Parameter`] when `outlier` is not between 0 and 1 or `stretch`
    /// not above 1.
    pub fn or_outlier(
        from: Key,
        to: Key,
        measured: G,
        information: SMatrix<f64, N, N>,
        (outlier, stretch): (f64, f64),
    ) -> Result<Self, Error> {
        if !(outlier > 0.0 && outlier < 1.0) {
            return Err(Error::Parameter { name: "outlier", value: outlier });
        }
        if !(stretch.is_finite() && stretch > 1.0) {
            return Err(Error::Parameter { name: "stretch", value: stretch });
        }
        let wide = information / (stretch * stretch);
        Self::between(
            from,
            to,
            &[
                MixtureComponent { weight: 1.0 - outlier, measured, information },
                MixtureComponent { weight: outlier, measured, information: wide },
            ],
        )
    }

    fn new(keys: Vec<Key>, components: &[MixtureComponent<G, N>]) -> Result<Self, Error> {
        let key = keys.first().copied().unwrap_or_default();
        let mut built = Vec::with_capacity(components.len());
        for component in components {
            if !(component.weight.is_finite() && component.weight > 0.0) {
                return Err(Error::Parameter { name: "weight", value: component.weight });
            }
            if !component.measured.log().iter().chain(&component.information).all(|x| x.is_finite()) {
                return Err(Error::NotFinite { what: "mixture component", key });
            }
            let l = component.information.cholesky().ok_or(Error::Information { key })?.l();
            let half_log_determinant: f64 = l.diagonal().iter().map(|d| d.ln()).sum();
            let price = -component.weight.ln() - half_log_determinant;
            built.push(Component { measured: component.measured, root: l.transpose(), price });
        }
        let least = built.iter().map(|c| c.price).fold(f64::INFINITY, f64::min);
        if !least.is_finite() {
            return Err(Error::CustomFactor { reason: "a mixture without components".into() });
        }
        built.iter_mut().for_each(|c| c.price -= least);
        Ok(Self { keys, components: built })
    }

    /// Index of the component that counts at `poses`, in the order of the keys; the first of equals.
    pub fn likeliest(&self, poses: &[G]) -> usize {
        self.choose(poses).0
    }

    fn choose(&self, poses: &[G]) -> (usize, SVector<f64, N>) {
        let mut best = (0, SVector::zeros());
        let mut least = f64::INFINITY;
        for (index, component) in self.components.iter().enumerate() {
            let whitened = component.root * residual(&component.measured, poses);
            let cost = 0.5 * whitened.norm_squared() + component.price;
            if cost < least {
                least = cost;
                best = (index, whitened);
            }
        }
        best
    }
}

fn residual<const N: usize, G: LieGroup<N>>(measured: &G, poses: &[G]) -> SVector<f64, N> {
    match poses {
        [a, b] => G::between_error(measured, a, b),
        [x] => measured.between(x).log(),
        _ => SVector::zeros(),
    }
}

impl<const N: usize, G: LieGroup<N>> CustomFactor<G, N> for MaxMixture<G, N> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        N + 1
    }

    fn residual(&self, poses: &[G], residual: &mut [f64]) {
        let (index, whitened) = self.choose(poses);
        for (r, w) in residual.iter_mut().zip(&whitened) {
            *r = *w;
        }
        if let Some(last) = residual.last_mut() {
            *last = (2.0 * self.components[index].price).sqrt();
        }
    }

    fn jacobian(&self, poses: &[G], which: usize, jacobian: &mut [f64]) {
        let component = &self.components[self.choose(poses).0];
        let derivative = match poses {
            [a, b] => {
                let e = G::between_error_with_jacobians(&component.measured, a, b);
                if which == 0 { e.first } else { e.second }
            }
            [x] => G::right_jacobian_inverse(&component.measured.between(x).log()),
            _ => SMatrix::zeros(),
        };
        // the price does not depend on the poses, so the last row stays zero
        let whitened = component.root * derivative;
        for (row, values) in jacobian.chunks_exact_mut(N).take(N).enumerate() {
            for (column, value) in values.iter_mut().enumerate() {
                *value = whitened[(row, column)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kernel, PoseGraph2, SolveParams, solve};
    use nalgebra::{Isometry2, Isometry3, Matrix3, Matrix6, Vector2, Vector6};
    use std::sync::Arc;

    fn at(x: f64, y: f64, angle: f64) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(x, y), angle)
    }

    fn doors() -> MaxMixture<Isometry2<f64>, 3> {
        let information = Matrix3::from_diagonal_element(100.0);
        let component = |weight, x| MixtureComponent { weight, measured: at(x, 0.0, 0.0), information };
        MaxMixture::between(Key::new(0, 0), Key::new(0, 1), &[component(0.6, 1.0), component(0.4, 3.0)])
            .unwrap()
    }

    #[test]
    fn the_cost_is_the_least_negative_log_likelihood() {
        let mixture = doors();
        for x in [0.0, 1.0, 1.9, 2.1, 3.0, 4.0] {
            let poses = [at(0.0, 0.0, 0.0), at(x, 0.0, 0.0)];
            let mut r = [0.0; 4];
            mixture.residual(&poses, &mut r);
            let cost = 0.5 * r.iter().map(|r| r * r).sum::<f64>();
            let first = 50.0 * (x - 1.0) * (x - 1.0) - f64::ln(0.6);
            let second = 50.0 * (x - 3.0) * (x - 3.0) - f64::ln(0.4);
            let expected = first.min(second) + f64::ln(0.6);
            assert!((cost - expected).abs() < 1e-9, "{x}: {cost} instead of {expected}");
            assert_eq!(mixture.likeliest(&poses), usize::from(second < first));
        }
    }

    #[test]
    fn jacobians_agree_with_central_differences() {
        let pose = |k: f64| Isometry3::exp(&Vector6::new(k, -0.4 * k, 0.3, 0.2 * k, 0.5, -0.3));
        let information = Matrix6::from_fn(|r, c| if r == c { 4.0 + r as f64 } else { 0.3 });
        let keys = [Key::new(0, 0), Key::new(0, 1)];
        let component = |weight, k| MixtureComponent { weight, measured: pose(k), information };
        let both = [component(0.5, 0.7), component(0.5, 2.0)];
        for mixture in [
            MaxMixture::between(keys[0], keys[1], &both).unwrap(),
            MaxMixture::prior(keys[0], &both).unwrap(),
        ] {
            let poses = [pose(0.2), pose(1.1)];
            let poses = &poses[..mixture.keys().len()];
            for which in 0..poses.len() {
                let mut jacobian = [0.0; 42];
                mixture.jacobian(poses, which, &mut jacobian);
                for c in 0..6 {
                    let h = 1e-6;
                    let [plus, minus] = [h, -h].map(|h| {
                        let mut xi = Vector6::zeros();
                        xi[c] = h;
                        let mut moved = poses.to_vec();
                        moved[which] = moved[which].plus(&xi);
                        let mut r = [0.0; 7];
                        mixture.residual(&moved, &mut r);
                        r
                    });
                    for r in 0..7 {
                        let slope = (plus[r] - minus[r]) / (2.0 * h);
                        assert!((slope - jacobian[r * 6 + c]).abs() < 1e-7, "pose {which}, entry {r} {c}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_closure_that_may_be_false_gives_way_to_odometry() {
        let information = Matrix3::from_diagonal_element(100.0);
        let mut graph = PoseGraph2::new();
        for i in 0..4 {
            graph.add_pose(Key::new(0, i), at(i as f64, 0.0, 0.0)).unwrap();
            if i > 0 {
                let (a, b) = (Key::new(0, i - 1), Key::new(0, i));
                graph.add_between(a, b, at(1.0, 0.0, 0.0), information, Kernel::None).unwrap();
            }
        }
        let mut closure = |x| {
            let (a, b) = (Key::new(0, 0), Key::new(0, 3));
            let mixture = MaxMixture::or_outlier(a, b, at(x, 0.0, 0.0), information, (0.1, 1e3)).unwrap();
            let id = graph.add_custom(Arc::new(mixture), Kernel::None).unwrap();
            let found = *solve(&graph, &SolveParams::default()).unwrap().pose(b).unwrap();
            graph.remove_factor(id).unwrap();
            found.translation.x
        };
        assert!((closure(-5.0) - 3.0).abs() < 1e-3, "a false closure pulls");
        assert!((closure(3.2) - 3.15).abs() < 1e-3, "a right closure does not pull");
    }

    #[test]
    fn bad_components_are_named() {
        let component =
            |weight, information| MixtureComponent { weight, measured: at(0.0, 0.0, 0.0), information };
        let (a, b) = (Key::new(0, 0), Key::new(0, 1));
        let one = Matrix3::identity();
        assert!(matches!(
            MaxMixture::<_, 3>::between(a, a, &[component(1.0, one)]),
            Err(Error::SelfEdge { .. })
        ));
        let new = |list: &[_]| MaxMixture::<_, 3>::between(a, b, list).err();
        assert!(matches!(new(&[]), Some(Error::CustomFactor { .. })));
        assert!(matches!(new(&[component(-1.0, one)]), Some(Error::Parameter { .. })));
        assert!(matches!(new(&[component(1.0, -one)]), Some(Error::Information { .. })));
        assert!(matches!(new(&[component(1.0, one * f64::NAN)]), Some(Error::NotFinite { .. })));
    }
}
