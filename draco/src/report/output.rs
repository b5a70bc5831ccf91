use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use super::RunReport;
use crate::Error;

/// Writes the run into the folder `dir`: `summary.json`, `report.html`, `map.svg`, `trajectory_<robot>.tum`,
/// `points.ply`, `traffic.csv` and, if the run has a graph, `graph.g2o`.
///
/// Everything is first written into a folder beside `dir`, which then takes its place: `dir` holds a whole run or
/// what it held before. See [`check_output_folder`] for what may be replaced.
///
/// # Errors
/// [`Error::OutputFolder`], and [`Error::Io`] with the file that could not be written; `dir` is then as it was.
pub fn write_run(report: &RunReport, dir: &Path) -> Result<(), Error> {
    check_content(dir)?;
    let staging = beside(dir, "partial")?;
    let written = stage(report, &staging).and_then(|()| publish(&staging, dir));
    if written.is_err() {
        // a part of a result must not be mistaken for one; that it cannot be removed is no worse than the failure told
        let _ = fs::remove_dir_all(&staging);
    }
    written
}

/// Whether [`write_run`] may and can put its result at `dir`: where nothing is, in an empty folder, or in place of the
/// result of an earlier run with no other files in it. Ask before a long mission; makes the folders above `dir`.
///
/// # Errors
/// [`Error::OutputFolder`] that says what is in the way, [`Error::Io`] where nothing can be written.
pub fn check_output_folder(dir: &Path) -> Result<(), Error> {
    check_content(dir)?;
    let trial = beside(dir, "partial")?;
    fs::remove_dir(&trial).map_err(io(&trial))
}

/// Whether nothing but an earlier result is at `dir`.
fn check_content(dir: &Path) -> Result<(), Error> {
    let refuse = |reason: String| Err(Error::OutputFolder { path: dir.to_path_buf(), reason });
    if !dir.exists() {
        return Ok(());
    }
    if !dir.is_dir() {
        return refuse("is not a folder".into());
    }
    let mut names = Vec::new();
    for entry in fs::read_dir(dir).map_err(io(dir))? {
        names.push(entry.map_err(io(dir))?.file_name().to_string_lossy().into_owned());
    }
    names.sort_unstable();
    if let Some(foreign) = names.iter().find(|name| !is_result(name)) {
        return refuse(format!("holds {foreign}, which is no result of a run; choose another folder"));
    }
    if !names.is_empty() && !names.iter().any(|name| name == SUMMARY) {
        return refuse(format!(
            "holds {} but no {SUMMARY}, so no result of a run; choose another folder",
            names[0]
        ));
    }
    Ok(())
}

const SUMMARY: &str = "summary.json";

fn io(path: &Path) -> impl Fn(std::io::Error) -> Error {
    move |source| Error::io(path, source)
}

/// A new empty folder beside `dir`.
fn beside(dir: &Path, what: &str) -> Result<PathBuf, Error> {
    let mut name = dir.file_name().map_or_else(|| "run".into(), std::ffi::OsStr::to_os_string);
    name.push(format!(".{what}-{}", std::process::id()));
    let parent = match dir.parent() {
        Some(parent) if dir.file_name().is_some() => parent.to_path_buf(),
        _ => dir.to_path_buf(),
    };
    if !parent.as_os_str().is_empty() {
        fs::create_dir_all(&parent).map_err(io(&parent))?;
    }
    let folder = parent.join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(io(&folder))?;
    }
    fs::create_dir(&folder).map_err(io(&folder))?;
    Ok(folder)
}

/// Writes all files into `staging`.
fn stage(report: &RunReport, staging: &Path) -> Result<(), Error> {
    let mut files: Vec<(String, String)> = Vec::new();
    for robot in &report.robots {
        files.push((format!("trajectory_{}.tum", robot.id), tum(&robot.times, &robot.trajectory)));
    }
    files.push(("points.ply".to_owned(), ply(report)));
    files.push(("traffic.csv".to_owned(), traffic_csv(report)));
    files.push(("report.html".to_owned(), report.html()));
    files.push(("map.svg".to_owned(), report.map_svg()));
    if !report.graph_g2o.is_empty() {
        files.push(("graph.g2o".to_owned(), report.graph_g2o.clone()));
    }
    let summary = serde_json::to_string_pretty(&report.summary())
        .map_err(|error| Error::io(&staging.join(SUMMARY), error.into()))?;
    files.push((SUMMARY.to_owned(), summary + "\n"));
    for (name, text) in files {
        let path = staging.join(&name);
        fs::write(&path, text).map_err(io(&path))?;
    }
    Ok(())
}

/// Puts `staging` in the place of `dir`; what was there comes back when that fails.
fn publish(staging: &Path, dir: &Path) -> Result<(), Error> {
    if !dir.exists() {
        return fs::rename(staging, dir).map_err(io(dir));
    }
    let previous = beside(dir, "previous")?;
    fs::rename(dir, &previous).map_err(io(dir))?;
    if let Err(error) = fs::rename(staging, dir) {
        fs::rename(&previous, dir).map_err(io(&previous))?;
        return Err(Error::io(dir, error));
    }
    fs::remove_dir_all(&previous).map_err(io(&previous))
}

fn is_result(name: &str) -> bool {
    [SUMMARY, "report.html", "map.svg", "graph.g2o", "points.ply", "traffic.csv"].contains(&name)
        || (name.starts_with("trajectory_") && name.ends_with(".tum"))
}

/// All points of the merged robots in the common frame, or of the first robot if none are, as a PLY file of text with
/// the robot and the keyframe of each point.
fn ply(report: &RunReport) -> String {
    let mut robots: Vec<_> = report.merged().collect();
    if robots.is_empty() {
        robots.extend(report.robots.first());
    }
    let (mut lines, mut count) = (String::new(), 0);
    for robot in robots {
        for (keyframe, (pose, points)) in robot.trajectory.iter().zip(&robot.points).enumerate() {
            for point in points.iter().map(|point| pose * point) {
                let _ = writeln!(lines, "{:.3} {:.3} 0 {} {keyframe}", point.x, point.y, robot.id);
                count += 1;
            }
        }
    }
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
         property int robot\nproperty int keyframe\nend_header\n{lines}"
    )
}

/// One line a packet.
fn traffic_csv(report: &RunReport) -> String {
    let mut text = "time,robot,kind,bits\n".to_owned();
    for message in &report.traffic {
        let _ = writeln!(text, "{},{},{},{}", message.time, message.robot, message.kind, message.bits);
    }
    text
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
