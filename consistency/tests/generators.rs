//! What the generators promise: labels tell the truth, outliers agree with each other where they should.

use draco_consistency::simulate::{Label, Planted, RangeLabel, Ranging, SimulatedTeam, planted, ranges};
use draco_consistency::{Error, PairTest, PcmParams, RangeParams, pcm, range_consistency};
use nalgebra::{Isometry2, Isometry3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

type Team = SimulatedTeam<Isometry2<f64>, 3>;

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Share of the `wanted` pairs of a team that agree, over ten teams: errors of one team's odometry are shared.
fn agreeing(wanted: impl Fn(&Team, usize, usize) -> bool) -> f64 {
    let (mut agree, mut all) = (0, 0);
    for seed in 0..10 {
        let team: Team = planted(&Planted::default(), &mut rng(seed)).unwrap();
        let test = PairTest::new(&team.trajectories, &team.closures, 0.99).unwrap();
        for m in 0..test.len() {
            for n in (m + 1..test.len()).filter(|&n| wanted(&team, m, n)) {
                agree += usize::from(test.agree(m, n));
                all += 1;
            }
        }
    }
    agree as f64 / all as f64
}

#[test]
fn planted_closures_agree_as_their_labels_say() {
    let both = |team: &Team, m: usize, n: usize, label| team.labels[m] == label && team.labels[n] == label;
    let good = agreeing(|team, m, n| both(team, m, n, Label::Good));
    let runs = agreeing(|team, m, n| both(team, m, n, Label::Aliased) && team.groups[m] == team.groups[n]);
    let mixed = agreeing(|team, m, n| team.labels[m] == Label::Good && team.labels[n] == Label::Aliased);
    assert!(good > 0.95 && runs > 0.9 && mixed < 0.05, "{good} {runs} {mixed}");
}

#[test]
fn pcm_finds_the_planted_closures_in_the_plane_and_in_space() {
    let flat = planted::<3, Isometry2<f64>>(&Planted::default(), &mut rng(2)).unwrap();
    let found = pcm(&flat.trajectories, &flat.closures, &PcmParams::default()).unwrap();
    assert!(found.accepted.iter().all(|&m| flat.labels[m] == Label::Good));
    assert!(found.accepted.len() >= 48, "{}", found.accepted.len());
    let solid = planted::<6, Isometry3<f64>>(&Planted::default(), &mut rng(2)).unwrap();
    let found = pcm(&solid.trajectories, &solid.closures, &PcmParams::default()).unwrap();
    assert!(found.accepted.iter().all(|&m| solid.labels[m] == Label::Good));
    assert!(found.accepted.len() >= 48, "{}", found.accepted.len());
}

#[test]
fn echoes_lose_against_as_many_more_true_ranges() {
    let setting = Ranging { poses: 40, random_share: 0.1, echo_share: 0.3, ..Ranging::default() };
    for seed in 0..2 {
        let problem = ranges(&setting, &mut rng(seed)).unwrap();
        let params = RangeParams { probability: 0.9999, ..RangeParams::default() };
        let found = range_consistency(&problem.trajectory, &problem.ranges, &params).unwrap();
        let of = |label| found.selection.accepted.iter().filter(|&&m| problem.labels[m] == label).count();
        let all = problem.labels.iter().filter(|l| **l == RangeLabel::Good).count();
        assert!(of(RangeLabel::Good) * 10 >= all * 9, "seed {seed}");
        assert!(of(RangeLabel::Echo) <= 1 && of(RangeLabel::Random) <= 1, "seed {seed}");
    }
}

#[test]
fn what_cannot_be_generated_is_an_error() {
    let is_refused = |setting: Ranging| matches!(ranges(&setting, &mut rng(0)), Err(Error::Generator { .. }));
    assert!(is_refused(Ranging { poses: 0, ..Ranging::default() }));
    assert!(is_refused(Ranging { echo_share: 0.7, ..Ranging::default() }));
    assert!(is_refused(Ranging { sigma: f64::NAN, ..Ranging::default() }));
    let long = Planted { run_length: 40, ..Planted::default() };
    let refused = planted::<3, Isometry2<f64>>(&long, &mut rng(0)).err();
    assert!(matches!(refused, Some(Error::Generator { .. })));
}
