use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use nalgebra::Isometry2;

use super::{KEYFRAMES_FILE, POINTS_FILE};
use crate::Error;
use crate::keyframe::MissionData;

/// Writes `mission` into the folder `dir`, which is made if need be; existing tables there are replaced.
///
/// Numbers are written so that reading them gives the same bits. `kf` counts through all robots.
///
/// # Errors
/// [`Error::Io`] when the folder or a table cannot be written.
pub fn write_keyframe_folder(mission: &MissionData, dir: &Path) -> Result<(), Error> {
    std::fs::create_dir_all(dir).map_err(|source| Error::io(dir, source))?;
    let (keyframes, points) = (dir.join(KEYFRAMES_FILE), dir.join(POINTS_FILE));
    let create =
        |path: &Path| File::create(path).map(BufWriter::new).map_err(|source| Error::io(path, source));
    write_keyframe_tables(mission, create(&keyframes)?, create(&points)?)
        .map_err(|source| Error::io(dir, source))
}

/// Writes the two tables of `mission` into two sinks.
///
/// # Errors
/// Whatever a sink reports.
pub fn write_keyframe_tables(
    mission: &MissionData,
    mut keyframes: impl Write,
    mut points: impl Write,
) -> std::io::Result<()> {
    writeln!(keyframes, "robot,kf,time,dr_x,dr_y,dr_theta,gt_x,gt_y,gt_theta,n_points")?;
    writeln!(points, "kf,x,y")?;
    let mut kf = 0_u64;
    for recording in &mission.recordings {
        for (index, keyframe) in recording.keyframes.iter().enumerate() {
            let truth = recording.truth.get(index).copied().flatten();
            let truth = truth.as_ref().map_or_else(|| ",,".to_owned(), cells);
            let odometry = cells(&keyframe.odometry);
            let (robot, time, count) = (recording.robot, keyframe.time, keyframe.points.len());
            writeln!(keyframes, "{robot},{kf},{time},{odometry},{truth},{count}")?;
            for point in &keyframe.points {
                writeln!(points, "{kf},{},{}", point.x, point.y)?;
            }
            kf += 1;
        }
    }
    keyframes.flush()?;
    points.flush()
}

fn cells(pose: &Isometry2<f64>) -> String {
    format!("{},{},{}", pose.translation.x, pose.translation.y, pose.rotation.angle())
}
