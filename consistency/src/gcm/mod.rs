//! Group consistency: closures of one place and time are wrong together, so they vote together.
//!
//! Start with [`gcm`](crate::gcm()); online, use [`GcmOnline`]. [`gcm_pooled`], [`gcm_group`] and [`one_vote`] are
//! rules to compare with.
//!
//! # The model
//!
//! Robots `r` have map frames; `F_r` places the map of `r` in the reference's, to first order
//! `F_true = exp(δ_r) F_r`. Closure `m`, pose `k` of robot `r` seen from pose `i` of robot `q`, implies one map
//! transform and one residual in the common frame (origin at the centre of the overlap):
//!
//! ```text
//! T_m = X_rk Z_m⁻¹ X_qi⁻¹        ρ_m = log(F_r T_m F_q⁻¹)
//! ρ_m = δ_q - δ_r + z_q(i) - z_r(k) - A_m (η_m + β_g)        A_m = Ad(F_r X_rk)
//! ```
//!
//! There the adjoint between any two nodes is the identity, so closures are differences of node values: `z` is the
//! drift of a robot (`Cov(z(k), z(l)) = V(min(k, l))` for an odometry chain, joint marginals for an optimised map),
//! `η` the registration noise, `β_g` the bias common to the group. A group is in one of the states
//!
//! * **good** (π): `β ~ N(0, S_b)`, a narrow spike;
//! * **slip** ((1-π)(1-p_O) p_T): a shift `τ ~ ¼ N(0, S_T/4) + ½ N(0, S_T) + ¼ N(0, 4 S_T)` in the common frame: its
//!   scale is known to within an octave. One normal says next to nothing of steps of 1 to 2 m, which are the ones that
//!   drift hides. Slips are *shared*: a further slipped group of a robot pair repeats the pair's earlier slip `t` with
//!   probability `(n_t - 1 + α) / Σ n` (a Pitman-Yor process, so the order does not matter and slips that repeat make
//!   repetition likelier); equal slips are no proof of truth. Registrations that start from a told place of the maps
//!   share its error and so tend to the same wrong place; between robots without a prior of their own `α` is
//!   `alpha_unplaced`, which is less. A slip new to the pair is a given one of another pair with `χ` times the weight
//!   of one never seen. A slip is no shorter than `least_slip`; what the normals give to shorter ones is taken back;
//! * **yaw slip** ((1-π)(1-p_O)(1-p_T)): `β ~ N(0, S_Y)` about its place, turned by at least `least_yaw`: without this
//!   half of the yaw slips would be as good as sound, and every sound group half a yaw slip;
//! * **gross** ((1-π) p_O (1-p_E)): `β ~ N(0, S_O)`;
//! * **elsewhere** ((1-π) p_O p_E): `β ~ N(0, S_E)`, a wrong place, so wide that it does not pull at the map transform.
//!
//! Every slip has the bias `N(0, S_b)` on top: harmless bias is common to all groups, and without it precise closures
//! would fit equal slips better than the truth.
//!
//! The share π is learnt from the run: `(w π + sound so far) / (w + votes so far)`, `w = sound_strength`.
//!
//! Map covariances are often optimistic. The drift's σ between groups is therefore not taken at its word: scales 1, 2,
//! 4, 8 are tried, each doubling `drift_doubt` nats less likely, and the posterior is the mean over them by evidence
//! (`drift_scale` tells the best).
//!
//! A prior on a map transform is one more vote, good with `π_P`, else with a wide tail; `δ ~ N(0, base)` without any.
//! Neighbouring groups cut from one run share their state with `κ = exp(-(D/ℓ)²)`.
//!
//! Closures of one group that agree (exact clique of pair tests, in which a common bias cancels) collapse to their
//! mean, one vote. For two votes `g`, `h`
//!
//! ```text
//! K_gh = Σ over shared robots  s_g s_h (mean V_r(min(k, l)) + base)  +  [g = h] mean(A S Aᵀ)/n_g
//! K_H  = K + the state's own S_b, S_b + S, S_Y, S_O or S_E  +  S between votes that share a slip
//! score(H) = Σ log prior(state) + log N(ρ; 0, K_H)
//! weight(H) = score(H) + Σ over its slips of log(evidence of the mixture, |τ| > least_slip / evidence of N(0, S))
//!                      + Σ over its yaw slips of log(P(|θ| > least_yaw | ρ) / P(|θ| > least_yaw))
//! P_g = Σ over hypotheses with g good of softmax(weight)
//! ```
//!
//! In `K_H` and in the search a slip has the one covariance `S`, the mixture's; the mixture itself comes in at the end,
//! each slip by itself.
//!
//! # Calibration
//!
//! The model is cautious where it need not be: slips that repeat and priors that are wrong are thought of everywhere,
//! and on teams that have neither the surest groups are better than told and the least sure ones worse. The evidence on
//! a group therefore counts with a power γ (`evidence_exponent`), which leaves alone a group of which nothing is known,
//! and then all are doubted a little:
//!
//! ```text
//! P / (1 - P) = π / (1 - π) · (P_g (1 - π) / ((1 - P_g) π))^γ · exp(-d)        γ = 1.15, d = 0.30
//! ```
//!
//! γ is a logistic regression (J. Platt, "Probabilistic outputs for support vector machines", 1999, here through the
//! fixed point π) on 1600 generated teams a row of `gcm_bars` with 30 % biased groups: the likelihood is greatest at
//! 1.1 over all groups and at 1.2 over those that are not clear. The doubt `d` (`doubt`) is caution: where robots meet in
//! two places only, slips that drift hides decide, and more of them are short than a scale known to an octave tells;
//! groups of .61 and .78 were sound in .56 and .73 of 2000 such teams. Lowered by `d` no group is promised more than it
//! keeps, and where many groups judge each other it keeps up to .15 more than promised.
//!
//! A beam over the states; with an unlimited beam it is exact. The hypotheses share one Cholesky factor, of the `K_H` of a
//! consensus, and each has the joint normal of the few biases by which it differs.
//! Accept from `P ≥ 0.76`, reject up to `0.20`, otherwise **undecided**. Less sure groups, down to `P = 0.69`, are
//! accepted too, the surest first, as long as the expected share of wrong ones among the accepted set `A` of the team
//! stays small:
//!
//! ```text
//! 1/|A| Σ over g in A of (1 - P_g)  ≤  wrong_share = 0.06
//! ```
//!
//! This is the Bayesian false discovery rate (M. A. Newton, A. Noueiry, D. Sarkar, P. Ahlquist, "Detecting differential
//! gene expression with a semiparametric hierarchical mixture method", 2004, section 2; P. Müller, G. Parmigiani, C.
//! Robert, J. Rousseau, "Optimal sample size for multiple testing", 2004). We differ in two places: a group that is
//! sure by itself is accepted whatever the rate, and one about which nothing is known never is. Where all
//! agree, nothing is then lost to a fixed limit; where groups contradict each other, the set is doubtful as a whole and
//! the doubtful ones stay out.
//!
//! An accepted closure goes to the pose graph with `c S + n S_b`, `n` being the number of closures that share its place
//! (each counts `exp(-(gap/ℓ)²)`), so that those of one place weigh like one vote, `c S / n + S_b`.
//!
//! # Limits
//!
//! * One neighbour, one group, no prior: bias and truth have the same likelihood, `P` is `π` less the doubt; undecided is
//!   the only honest answer.
//! * A majority of equal slips without prior or cycle looks like the truth. Raise `alpha` and `alpha_unplaced` in
//!   lattices known to alias.
//! * The reference's own scene slipped equally against every neighbour is consistent with every cycle.
//! * Slips that follow the prior's error agree with it: register from several starts, or lower `prior_sound`.
//! * A slip smaller than the drift between groups is invisible: close own loops first.
mod beam;
mod biases;
mod block;
mod block_product;
mod clusters;
mod consensus;
mod discount;
#[cfg(test)]
mod exact_tests;
mod findings;
mod frames;
mod group_cost;
mod grouping;
mod one_vote;
mod online;
#[cfg(test)]
mod oracle_tests;
mod params;
mod pooled;
mod posterior;
mod problem;
#[cfg(test)]
mod residual_tests;
mod slips;
mod state_prior;
mod verdict;
mod votes;

pub use discount::{discounted_clique, group_discount};
pub(crate) use frames::{Frames, implied};
pub use group_cost::{Aggregate, GroupParams, Objective, gcm_group};
pub use one_vote::one_vote;
pub use online::{Event, GcmOnline};
pub use params::{GapUnit, GcmParams, Sigma};
pub use pooled::{PooledParams, gcm_pooled};
pub use posterior::{Gcm, GroupPosterior, gcm};
pub use verdict::Verdict;
