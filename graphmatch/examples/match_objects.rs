//! Which objects of two maps are the same? Reads problem files and scores the answers against their truth.
//!
//! One JSON line a file, method and use of shapes (`attr`): shares over the file's problems, times as medians.

mod support;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Parser;
use draco_graphmatch::{
    Affinity, AffinityParams, AsCodedParams, Attributes, ConsensusParams, GraduatedParams, Match, Method,
    NoSimilarity, Object, Pair, RrwmParams, Similarity, Verdict, assign_scores, consensus, gcgc,
    graduated_assignment, ipfp, match_objects, principal_eigenvector, rrwm, smac,
};
use serde_json::json;
use support::Problem;

/// Matches pairs of object maps.
#[derive(Parser)]
struct Arguments {
    /// Problem files: JSON lists of {map1, map2, gt, T}.
    #[arg(required = true)]
    problems: Vec<PathBuf>,
    /// Methods, comma separated: consensus, as-coded; sm, smac, rrwm, ipfp, ga and gcgc give pairs by the affinity, from
    /// which consensus takes the transform.
    #[arg(long, value_delimiter = ',', default_value = "consensus")]
    methods: Vec<String>,
    /// 1 uses length and breadth, 0 does not.
    #[arg(long, default_value = "both", value_parser = ["0", "1", "both"])]
    attr: String,
    /// At most this many problems of a file; 0 takes all.
    #[arg(long, default_value_t = 0)]
    trials: usize,
    /// One line a problem instead of one a file.
    #[arg(long)]
    each: bool,
}

const METHODS: [&str; 8] = ["consensus", "as-coded", "sm", "smac", "rrwm", "ipfp", "ga", "gcgc"];

/// One answered problem.
struct Answer {
    raw: Vec<Pair>,
    raw_recall: f64,
    precision: f64,
    recall: f64,
    success: bool,
    verdict: Verdict,
    probability: f64,
    affinity_ms: f64,
    ms: f64,
    stored_share: f64,
    objects: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    for method in &arguments.methods {
        anyhow::ensure!(METHODS.contains(&method.as_str()), "unknown method {method}");
    }
    for file in &arguments.problems {
        let mut problems = Problem::read_all(file)?;
        if arguments.trials > 0 {
            problems.truncate(arguments.trials);
        }
        for method in &arguments.methods {
            for attr in [0, 1] {
                if arguments.attr == "both" || arguments.attr == attr.to_string() {
                    run(file, &problems, method, attr, arguments.each)?;
                }
            }
        }
    }
    Ok(())
}

fn run(file: &Path, problems: &[Problem], method: &str, attr: u8, each: bool) -> Result<()> {
    let cell = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let answers = problems.iter().map(|p| answer(p, method, attr)).collect::<Result<Vec<_>>>()?;
    if each {
        for (k, a) in answers.iter().enumerate() {
            println!(
                "{}",
                json!({"cell": cell, "problem": k, "method": method, "attr": attr, "precision": a.precision,
                    "recall": a.recall, "success": u8::from(a.success), "verdict": format!("{:?}", a.verdict),
                    "probability": a.probability, "t_aff_ms": a.affinity_ms, "t_solve_ms": a.ms,
                    "raw_pairs": a.raw.iter().map(|p| [p.first, p.second]).collect::<Vec<_>>()})
            );
        }
        return Ok(());
    }
    let mean = |f: fn(&Answer) -> f64| answers.iter().map(f).sum::<f64>() / answers.len().max(1) as f64;
    let count = |verdict: Verdict| answers.iter().filter(|a| a.verdict == verdict).count();
    let wrong_unique = answers.iter().filter(|a| a.verdict == Verdict::Unique && !a.success).count();
    let median = |f: fn(&Answer) -> f64| {
        let mut times: Vec<f64> = answers.iter().map(f).collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    };
    println!(
        "{}",
        json!({"cell": cell, "method": method, "attr": attr,
            "n": answers.iter().map(|a| a.objects).max(), "trials": answers.len(),
            "raw_recall": mean(|a| a.raw_recall), "precision": mean(|a| a.precision), "recall": mean(|a| a.recall),
            "success": mean(|a| f64::from(u8::from(a.success))),
            "t_aff_ms": median(|a| a.affinity_ms), "t_solve_ms": median(|a| a.ms),
            "nnz_frac": mean(|a| a.stored_share),
            "verdict": {"unique": count(Verdict::Unique), "ambiguous": count(Verdict::Ambiguous),
                "none": count(Verdict::None), "wrong_unique": wrong_unique}})
    );
    Ok(())
}

fn answer(problem: &Problem, method: &str, attr: u8) -> Result<Answer> {
    let (map1, map2) = (Problem::objects(&problem.map1), Problem::objects(&problem.map2));
    let params = ConsensusParams {
        position_sigma: problem.sigma,
        shape_sigma: problem.sigma,
        ..ConsensusParams::default()
    };
    let start = Instant::now();
    let (mut affinity_ms, mut stored_share, mut raw) = (0.0, 0.0, None);
    if !matches!(method, "consensus" | "as-coded") {
        let affinity = Affinity::new(&map1, &map2, &affinity_params(problem.sigma, attr))?;
        affinity_ms = 1e3 * start.elapsed().as_secs_f64();
        stored_share = 2.0 * affinity.stored() as f64 / ((map1.len() * map2.len()) as f64).powi(2);
        raw = Some(affinity_pairs(&affinity, method)?);
    }
    let solved_ms = 1e3 * start.elapsed().as_secs_f64() - affinity_ms;
    let found = match &raw {
        Some(pairs) => consensus(&map1, &map2, &Only(pairs), &params)?,
        None => transform_method(&map1, &map2, method, attr, params)?,
    };
    let ms = if raw.is_some() { solved_ms } else { 1e3 * start.elapsed().as_secs_f64() };
    let raw = raw.unwrap_or_else(|| found.pairs.clone());
    let score = problem.score(&found.pairs, found.map1_from_map2.as_ref().map(|t| t.mean()));
    Ok(Answer {
        raw_recall: problem.score(&raw, None).recall,
        raw,
        precision: score.precision,
        recall: score.recall,
        success: score.success,
        verdict: found.verdict,
        probability: found.modes.first().map_or(0.0, |m| m.probability),
        affinity_ms,
        ms,
        stored_share,
        objects: map1.len(),
    })
}

fn transform_method(
    map1: &[Object],
    map2: &[Object],
    method: &str,
    attr: u8,
    params: ConsensusParams,
) -> Result<Match> {
    if method == "as-coded" {
        let mu_shape = if attr == 1 { AsCodedParams::default().mu_shape } else { 0.0 };
        let params = AsCodedParams { mu_shape, ..AsCodedParams::default() };
        return Ok(match_objects(map1, map2, &Method::AsCoded(params))?);
    }
    if attr == 1 {
        return Ok(match_objects(map1, map2, &Method::Consensus(params))?);
    }
    Ok(consensus(map1, map2, &NoSimilarity, &params)?)
}

/// The Gaussian affinity that the peers' runner uses.
fn affinity_params(sigma: f64, attr: u8) -> AffinityParams {
    let attributes = if attr == 1 { Attributes::Gaussian { sigma, gate: 3.5 } } else { Attributes::Ignore };
    AffinityParams { attributes, min_edge: 1.0, ..AffinityParams::default() }
}

fn affinity_pairs(affinity: &Affinity, method: &str) -> Result<Vec<Pair>> {
    let eigenvector = || principal_eigenvector(affinity, None).vector;
    Ok(match method {
        "sm" => assign_scores(affinity, &eigenvector())?,
        "smac" => assign_scores(affinity, &smac(affinity).vector)?,
        "rrwm" => assign_scores(affinity, &rrwm(affinity, &RrwmParams::default())?)?,
        "ipfp" => ipfp(affinity, &eigenvector(), 50)?,
        "ga" => assign_scores(affinity, &graduated_assignment(affinity, &GraduatedParams::default())?)?,
        _ => gcgc(affinity, &eigenvector(), 20)?,
    })
}

/// Admits the pairs of another solver only.
struct Only<'a>(&'a [Pair]);

impl Similarity for Only<'_> {
    fn log_ratio(&self, first: usize, second: usize) -> Option<f64> {
        self.0.contains(&Pair { first, second }).then_some(0.0)
    }
}
