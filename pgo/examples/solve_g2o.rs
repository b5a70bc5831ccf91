//! How well and how fast is a g2o file solved? One JSON line a file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use draco_pgo::io::g2o::{self, AnyGraph, G2oPose};
use draco_pgo::{ChordalPose, Kernel, Method, PoseGraph, SolveParams, chordal, solve};

const USAGE: &str = "usage: solve_g2o [--init file|odometry|chordal] [--method gn|lm|dogleg] \
[--kernel none|huber:K|cauchy:K|tukey:K|gm:K|welsch:K|dcs:K] [--write DIR] FILE...

One JSON line a file: file nodes edges init method iterations initial_chi2 final_chi2 termination init_ms
cpu_ms wall_ms, where chi2 = 1/2 sum e' W e with e the SE(d) log (under the kernel, if any). init_ms is the CPU
time of the initialisation, cpu_ms that of the solver without initialisation and file reading; ordering counts where it
is done, in init_ms for --init chordal, else in cpu_ms.
--write stores each solution as DIR/<file name>. Default: --init file --method lm. From any start the solver turns to
the chordal one by itself when the first step shows that the start is bad; restarted tells so.";

#[derive(Clone, Copy, PartialEq)]
enum Init {
    File,
    Odometry,
    Chordal,
}

struct Options {
    init: Init,
    method: Method,
    kernel: Kernel,
    write: Option<PathBuf>,
    files: Vec<PathBuf>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.iter().any(|a| a == "--help" || a == "-h") {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    let options = match parse(&arguments) {
        Ok(options) => options,
        Err(reason) => {
            eprintln!("solve_g2o: {reason}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    for file in &options.files {
        if let Err(reason) = run(file, &options) {
            eprintln!("solve_g2o: {}: {reason}", file.display());
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn parse(arguments: &[String]) -> Result<Options, String> {
    let mut options = Options {
        init: Init::File,
        method: Method::default(),
        kernel: Kernel::None,
        write: None,
        files: Vec::new(),
    };
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--init" => {
                options.init = match value()?.as_str() {
                    "file" => Init::File,
                    "odometry" => Init::Odometry,
                    "chordal" => Init::Chordal,
                    other => return Err(format!("unknown start {other:?}")),
                }
            }
            "--method" => {
                options.method = match value()?.as_str() {
                    "gn" => Method::GaussNewton,
                    "lm" => Method::LevenbergMarquardt,
                    "dogleg" => Method::Dogleg,
                    other => return Err(format!("unknown method {other:?}")),
                }
            }
            "--kernel" => options.kernel = kernel(value()?)?,
            "--write" => options.write = Some(value()?.into()),
            flag if flag.starts_with('-') => return Err(format!("unknown option {flag}")),
            file => options.files.push(file.into()),
        }
    }
    if options.files.is_empty() { Err("no file given".into()) } else { Ok(options) }
}

fn kernel(text: &str) -> Result<Kernel, String> {
    let (name, parameter) = text.split_once(':').unwrap_or((text, "1"));
    let k: f64 = parameter.parse().map_err(|_| format!("{parameter:?} is not a number"))?;
    let kernel = match name {
        "none" => Kernel::None,
        "huber" => Kernel::Huber(k),
        "cauchy" => Kernel::Cauchy(k),
        "tukey" => Kernel::Tukey(k),
        "gm" => Kernel::GemanMcClure(k),
        "welsch" => Kernel::Welsch(k),
        "dcs" => Kernel::Dcs(k),
        other => return Err(format!("unknown kernel {other:?}")),
    };
    if kernel.is_valid() { Ok(kernel) } else { Err(format!("{text:?}: the parameter must be positive")) }
}

fn run(file: &Path, options: &Options) -> Result<(), Box<dyn std::error::Error>> {
    match g2o::read(file)? {
        AnyGraph::Two(graph) => optimise(graph, file, options),
        AnyGraph::Three(graph) => optimise(graph, file, options),
    }
}

fn optimise<const N: usize, G: G2oPose<N> + ChordalPose<N>>(
    mut graph: PoseGraph<G, N>,
    file: &Path,
    options: &Options,
) -> Result<(), Box<dyn std::error::Error>> {
    if options.kernel != Kernel::None {
        let ids: Vec<_> = graph.factors().map(|(id, _)| id).collect();
        for id in ids {
            graph.set_kernel(id, options.kernel)?;
        }
    }
    let (wall, cpu) = (Instant::now(), cpu_ms());
    let init = initialise(&mut graph, options.init)?;
    let init_ms = cpu_ms() - cpu;
    let params = SolveParams { method: options.method, ..SolveParams::default() };
    let cpu = cpu_ms();
    let solution = solve(&graph, &params)?;
    let (cpu, wall) = (cpu_ms() - cpu, wall.elapsed().as_secs_f64() * 1e3);
    let name = file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    println!(
        "{{\"file\":{name:?},\"nodes\":{},\"edges\":{},\"init\":\"{init}\",\"method\":\"{:?}\",\
         \"iterations\":{},\"initial_chi2\":{},\"final_chi2\":{},\"termination\":\"{:?}\",\
         \"restarted\":{},\"init_ms\":{init_ms:.3},\"cpu_ms\":{cpu:.3},\"wall_ms\":{wall:.3}}}",
        graph.pose_count(),
        graph.factor_count(),
        params.method,
        solution.iterations,
        solution.initial_cost,
        solution.final_cost,
        solution.termination,
        solution.restarted,
    );
    if let Some(folder) = &options.write {
        std::fs::create_dir_all(folder)?;
        graph.update(&solution);
        g2o::write(&graph, folder.join(name))?;
    }
    Ok(())
}

fn initialise<const N: usize, G: ChordalPose<N>>(
    graph: &mut PoseGraph<G, N>,
    init: Init,
) -> Result<&'static str, draco_pgo::Error> {
    match init {
        Init::File => Ok("file"),
        Init::Odometry => draco_pgo::spanning_tree(graph).map(|()| "odometry"),
        Init::Chordal => chordal(graph).map(|()| "chordal"),
    }
}

/// CPU time of this process so far, all threads.
fn cpu_ms() -> f64 {
    cpu_time::ProcessTime::now().as_duration().as_secs_f64() * 1e3
}
