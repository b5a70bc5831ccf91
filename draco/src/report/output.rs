use std::fs;
use std::path::{Path, PathBuf};

use super::RunReport;
use crate::Error;

/// Writes the run into the folder `dir`: `summary.json`, `report.html`, `map.svg`, `trajectory_<robot>.tum` and, if
/// the run has a graph, `graph.g2o`.
///
/// Everything is first written beside `dir` under another name and moved at the end, `summary.json` last: a folder
/// with a summary holds a whole run. Results of an earlier run in `dir` are replaced; other files there stay.
///
/// # Errors
/// [`Error::Io`] with the file that could not be written; `dir` is then as it was.
pub fn write_run(report: &RunReport, dir: &Path) -> Result<(), Error> {
    let staging = staging_folder(dir)?;
    let written = stage(report, &staging).and_then(|names| publish(&staging, dir, &names));
    // On success the folder is empty or gone; on failure it must not be mistaken for a result.
    let _ = fs::remove_dir_all(&staging);
    written
}

const SUMMARY: &str = "summary.json";

fn io(path: &Path) -> impl Fn(std::io::Error) -> Error {
    move |source| Error::io(path, source)
}

fn staging_folder(dir: &Path) -> Result<PathBuf, Error> {
    let mut name = dir.file_name().map_or_else(|| "run".into(), std::ffi::OsStr::to_os_string);
    name.push(format!(".partial-{}", std::process::id()));
    let parent = match dir.parent() {
        Some(parent) if dir.file_name().is_some() => parent.to_path_buf(),
        _ => dir.to_path_buf(),
    };
    if !parent.as_os_str().is_empty() {
        fs::create_dir_all(&parent).map_err(io(&parent))?;
    }
    let staging = parent.join(name);
    if staging.exists() {
        fs::remove_dir_all(&staging).map_err(io(&staging))?;
    }
    fs::create_dir(&staging).map_err(io(&staging))?;
    Ok(staging)
}

/// Writes all files into `staging` and returns their names, the summary's last.
fn stage(report: &RunReport, staging: &Path) -> Result<Vec<String>, Error> {
    let mut files: Vec<(String, String)> = Vec::new();
    for robot in &report.robots {
        files.push((format!("trajectory_{}.tum", robot.id), tum(&robot.times, &robot.trajectory)));
    }
    files.push(("report.html".to_owned(), report.html()));
    files.push(("map.svg".to_owned(), report.map_svg()));
    if !report.graph_g2o.is_empty() {
        files.push(("graph.g2o".to_owned(), report.graph_g2o.clone()));
    }
    let summary = serde_json::to_string_pretty(&report.summary())
        .map_err(|error| Error::io(&staging.join(SUMMARY), error.into()))?;
    files.push((SUMMARY.to_owned(), summary + "\n"));
    let mut names = Vec::new();
    for (name, text) in files {
        let path = staging.join(&name);
        fs::write(&path, text).map_err(io(&path))?;
        names.push(name);
    }
    Ok(names)
}

fn publish(staging: &Path, dir: &Path, names: &[String]) -> Result<(), Error> {
    if !dir.exists() {
        return fs::rename(staging, dir).map_err(io(dir));
    }
    // Without a summary the folder counts as no result until the new one arrives.
    remove_if_there(&dir.join(SUMMARY))?;
    for entry in fs::read_dir(dir).map_err(io(dir))? {
        let entry = entry.map_err(io(dir))?;
        if is_result(&entry.file_name().to_string_lossy()) {
            remove_if_there(&entry.path())?;
        }
    }
    for name in names {
        let (from, to) = (staging.join(name), dir.join(name));
        fs::rename(&from, &to).map_err(io(&to))?;
    }
    Ok(())
}

fn is_result(name: &str) -> bool {
    ["report.html", "map.svg", "graph.g2o"].contains(&name)
        || (name.starts_with("trajectory_") && name.ends_with(".tum"))
}

fn remove_if_there(path: &Path) -> Result<(), Error> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path, error)),
        _ => Ok(()),
    }
}

/// One line a keyframe, `time x y z qx qy qz qw`.
fn tum(times: &[f64], poses: &[nalgebra::Isometry2<f64>]) -> String {
    let line = |(time, pose): (&f64, &nalgebra::Isometry2<f64>)| {
        let half = 0.5 * pose.rotation.angle();
        let (x, y) = (pose.translation.x, pose.translation.y);
        format!("{time} {x} {y} 0 0 0 {} {}\n", half.sin(), half.cos())
    };
    times.iter().zip(poses).map(line).collect()
}
