//! Three robots, repeating structure: which closures survive PCM, and which the group posterior? Prints each group with
//! its probability, its verdict and the reason.

use draco_consistency::simulate::{Harbor, Label, harbor};
use draco_consistency::{GcmParams, PcmParams, gcm, pcm};
use nalgebra::Isometry2;
use rand::SeedableRng;

fn main() -> Result<(), draco_consistency::Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
    let team = harbor::<3, Isometry2<f64>>(&Harbor::default(), &mut rng)?;
    let pairwise = pcm(&team.trajectories, &team.closures, &PcmParams::default())?;
    let group = gcm(&team.trajectories, &team.closures, &team.priors, &GcmParams::default())?;

    println!("group of closures             truth    P(sound)  verdict    reason");
    for cluster in &group.clusters {
        let first = cluster.members[0];
        let reasons = group.selection.rejected.iter().chain(&group.selection.undecided);
        let reason = reasons.filter(|r| r.closure == first).map(|r| r.reason.to_string()).next();
        println!(
            "robots {}-{}, {:>2} closures         {:<8} {:>6.2}    {:<10} {}",
            cluster.robots.0,
            cluster.robots.1,
            cluster.members.len(),
            format!("{:?}", team.labels[first]),
            cluster.probability,
            format!("{:?}", cluster.verdict),
            reason.unwrap_or_default(),
        );
    }
    for (name, selection) in [("PCM", &pairwise), ("gcm", &group.selection)] {
        let kept = |label: Label| selection.accepted.iter().filter(|&&m| team.labels[m] == label).count();
        let all = |label: Label| team.labels.iter().filter(|l| **l == label).count();
        println!(
            "{name}: {} of {} good and {} of {} biased closures accepted",
            kept(Label::Good),
            all(Label::Good),
            kept(Label::Biased),
            all(Label::Biased)
        );
    }
    Ok(())
}
