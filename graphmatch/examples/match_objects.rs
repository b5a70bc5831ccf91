//! Which objects of two maps are the same? Reads problem files and scores the answers against their truth.
//!
//! One JSON line a file, method and use of shapes (`attr`): shares over the file's problems, times as medians.

mod support;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Parser;
use draco_graphmatch::{
    AsCodedParams, ConsensusParams, Match, Method, NoSimilarity, Object, Verdict, consensus, match_objects,
};
use serde_json::json;
use support::Problem;

/// Matches pairs of object maps.
#[derive(Parser)]
struct Arguments {
    /// Problem files: JSON lists of {map1, map2, gt, T}.
    #[arg(required = true)]
    problems: Vec<PathBuf>,
    /// Methods, comma separated: consensus, as-coded.
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

/// One answered problem.
struct Answer {
    precision: f64,
    recall: f64,
    success: bool,
    verdict: Verdict,
    probability: f64,
    ms: f64,
    objects: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    for method in &arguments.methods {
        anyhow::ensure!(matches!(method.as_str(), "consensus" | "as-coded"), "unknown method {method}");
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
                    "probability": a.probability, "t_solve_ms": a.ms})
            );
        }
        return Ok(());
    }
    let mean = |f: fn(&Answer) -> f64| answers.iter().map(f).sum::<f64>() / answers.len().max(1) as f64;
    let count = |verdict: Verdict| answers.iter().filter(|a| a.verdict == verdict).count();
    let wrong_unique = answers.iter().filter(|a| a.verdict == Verdict::Unique && !a.success).count();
    let mut times: Vec<f64> = answers.iter().map(|a| a.ms).collect();
    times.sort_by(f64::total_cmp);
    println!(
        "{}",
        json!({"cell": cell, "method": method, "attr": attr,
            "n": answers.iter().map(|a| a.objects).max(), "trials": answers.len(),
            "precision": mean(|a| a.precision), "recall": mean(|a| a.recall),
            "success": mean(|a| f64::from(u8::from(a.success))),
            "t_aff_ms": 0.0, "t_solve_ms": times.get(times.len() / 2), "nnz_frac": null,
            "verdict": {"unique": count(Verdict::Unique), "ambiguous": count(Verdict::Ambiguous),
                "none": count(Verdict::None), "wrong_unique": wrong_unique}})
    );
    Ok(())
}

fn answer(problem: &Problem, method: &str, attr: u8) -> Result<Answer> {
    let (map1, map2) = (Problem::objects(&problem.map1), Problem::objects(&problem.map2));
    let start = Instant::now();
    let found = solve(&map1, &map2, method, attr, problem.sigma)?;
    let ms = 1e3 * start.elapsed().as_secs_f64();
    let score = problem.score(&found.pairs, found.map1_from_map2.as_ref().map(|t| t.mean()));
    Ok(Answer {
        precision: score.precision,
        recall: score.recall,
        success: score.success,
        verdict: found.verdict,
        probability: found.modes.first().map_or(0.0, |m| m.probability),
        ms,
        objects: map1.len(),
    })
}

fn solve(map1: &[Object], map2: &[Object], method: &str, attr: u8, sigma: f64) -> Result<Match> {
    if method == "as-coded" {
        let mu_shape = if attr == 1 { AsCodedParams::default().mu_shape } else { 0.0 };
        let params = AsCodedParams { mu_shape, ..AsCodedParams::default() };
        return Ok(match_objects(map1, map2, &Method::AsCoded(params))?);
    }
    let params = ConsensusParams { position_sigma: sigma, shape_sigma: sigma, ..ConsensusParams::default() };
    if attr == 1 {
        return Ok(match_objects(map1, map2, &Method::Consensus(params))?);
    }
    Ok(consensus(map1, map2, &NoSimilarity, &params)?)
}
