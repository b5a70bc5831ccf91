//! Do five real robots agree which landmark is which? Every robot maps 15 tubes by itself, from odometry and its own
//! sightings; the numbers on the tubes serve the robot to know a tube again, as tracking would, and are then hidden.
//! Every two maps are matched by place alone and scored against the numbers.
//!
//! usage: landmark_maps [FOLDER]   (keyframes.csv and observations.csv of MRCLAM data set 7)

mod slam;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use draco_graphmatch::{ConsensusParams, NoSimilarity, Object, consensus};
use nalgebra::{Isometry2, Vector2};
use slam::Slam;

/// Fewest sightings of a landmark that enters a map.
const SIGHTINGS: usize = 5;
/// Error of a landmark that the filter does not know of, metres.
const FLOOR: f64 = 0.05;

/// A map and the landmark number of each object.
struct LandmarkMap {
    objects: Vec<Object>,
    ids: Vec<u32>,
}

fn main() -> Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || {
            let root = std::env::var_os("DRACO_DATA").map_or_else(
                || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
                PathBuf::from,
            );
            root.join("multirobot-real/mrclam7")
        },
        PathBuf::from,
    );
    if !folder.is_dir() {
        println!("{} is not there: give the folder of the data set", folder.display());
        return Ok(());
    }
    let maps = maps(&folder)?;
    // Tubes stand 0.2 m apart in groups: modes and edges are smaller than a harbour's.
    let params = ConsensusParams {
        position_sigma: 2_f64.sqrt() * FLOOR,
        min_edge: 0.5,
        mode_distance: 0.5,
        ..ConsensusParams::default()
    };
    println!("robots  objects  common  verdict    right/pairs");
    let (mut right_pairs, mut all_pairs, mut matched) = (0, 0, 0);
    let numbers: Vec<u32> = maps.keys().copied().collect();
    for (k, a) in numbers.iter().enumerate() {
        for b in &numbers[k + 1..] {
            let (first, second) = (&maps[a], &maps[b]);
            let found = consensus(&first.objects, &second.objects, &NoSimilarity, &params)?;
            let right = found.pairs.iter().filter(|p| first.ids[p.first] == second.ids[p.second]).count();
            let common = first.ids.iter().filter(|id| second.ids.contains(id)).count();
            right_pairs += right;
            all_pairs += found.pairs.len();
            matched += usize::from(2 * right > found.pairs.len());
            println!(
                "{a}-{b}     {:2} {:2}    {common:2}      {:9}  {right}/{}",
                first.ids.len(),
                second.ids.len(),
                format!("{:?}", found.verdict),
                found.pairs.len()
            );
        }
    }
    println!("{matched} pairs of maps matched; {right_pairs} of {all_pairs} pairs of landmarks right");
    Ok(())
}

fn rows(path: &Path) -> Result<Vec<Vec<String>>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect())
}

fn number(row: &[String], column: usize) -> Result<f64> {
    Ok(row.get(column).context("short row")?.parse()?)
}

struct Sighting {
    target: u32,
    range: f64,
    bearing: f64,
}

/// Every robot's own map of landmarks (numbers 6 to 20; 1 to 5 are robots).
fn maps(folder: &Path) -> Result<BTreeMap<u32, LandmarkMap>> {
    let mut sightings: BTreeMap<(u32, u32), Vec<Sighting>> = BTreeMap::new();
    for row in rows(&folder.join("observations.csv"))? {
        let (robot, keyframe, target) =
            (number(&row, 0)? as u32, number(&row, 1)? as u32, number(&row, 2)? as u32);
        if target >= 6 {
            let sighting = Sighting { target, range: number(&row, 3)?, bearing: number(&row, 4)? };
            sightings.entry((robot, keyframe)).or_default().push(sighting);
        }
    }
    let mut filters: BTreeMap<u32, (f64, Isometry2<f64>, Slam)> = BTreeMap::new();
    for row in rows(&folder.join("keyframes.csv"))? {
        let (robot, keyframe) = (number(&row, 0)? as u32, number(&row, 1)? as u32);
        let pose = Isometry2::new(Vector2::new(number(&row, 3)?, number(&row, 4)?), number(&row, 5)?);
        let time = number(&row, 2)?;
        let (before, last, slam) = filters.entry(robot).or_insert_with(|| (time, pose, Slam::new()));
        slam.predict(&(last.inverse() * pose), time - *before);
        (*before, *last) = (time, pose);
        for seen in sightings.get(&(robot, keyframe)).into_iter().flatten() {
            slam.observe(seen.target, seen.range, seen.bearing);
        }
    }
    Ok(filters.into_iter().map(|(robot, (_, _, slam))| (robot, map_of(&slam))).collect())
}

fn map_of(slam: &Slam) -> LandmarkMap {
    let objects = slam.objects(FLOOR).into_iter().zip(&slam.landmarks);
    let (objects, ids) =
        objects.filter(|(_, (_, seen))| *seen >= SIGHTINGS).map(|(object, (id, _))| (object, *id)).unzip();
    LandmarkMap { objects, ids }
}
