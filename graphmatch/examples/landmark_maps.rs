//! Do five real robots agree which landmark is which? Builds each robot's map from its own sightings in odometry's
//! frame, hides the numbers, matches every two maps and scores against the numbers.
//!
//! usage: landmark_maps [FOLDER]   (keyframes.csv and observations.csv of MRCLAM data set 7)

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use draco_graphmatch::{ConsensusParams, NoSimilarity, Object, consensus};
use nalgebra::{Isometry2, Matrix2, Point2, Vector2};

/// A window of a robot's log short enough for odometry to hold.
const WINDOW_S: f64 = 60.0;
/// Fewest sightings of a landmark that enters a map.
const SIGHTINGS: usize = 3;

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
    let keyframes = keyframes(&folder)?;
    let sightings = sightings(&folder, &keyframes)?;
    println!("robots  objects  common  verdict    right/pairs");
    for (a, first) in maps(&keyframes, &sightings) {
        for (b, second) in maps(&keyframes, &sightings).split_off(&(a + 1)) {
            // Odometry over a minute and centroids of few sightings: half a metre.
            let params =
                ConsensusParams { position_sigma: 0.3, mode_distance: 1.0, ..ConsensusParams::default() };
            let found = consensus(&first.objects, &second.objects, &NoSimilarity, &params)?;
            let right = found.pairs.iter().filter(|p| first.ids[p.first] == second.ids[p.second]).count();
            let common = first.ids.iter().filter(|id| second.ids.contains(id)).count();
            println!(
                "{a}-{b}     {:2} {:2}    {common:2}      {:9}  {right}/{}",
                first.ids.len(),
                second.ids.len(),
                format!("{:?}", found.verdict),
                found.pairs.len()
            );
        }
    }
    Ok(())
}

type Keyframes = BTreeMap<(u32, u32), (f64, Isometry2<f64>)>;
type Sightings = BTreeMap<(u32, u32), Vec<(f64, Point2<f64>)>>;

fn rows(path: &Path) -> Result<Vec<Vec<String>>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect())
}

/// Time and odometry pose of every keyframe of every robot.
fn keyframes(folder: &Path) -> Result<Keyframes> {
    let number = |row: &[String], k: usize| -> Result<f64> { Ok(row.get(k).context("short row")?.parse()?) };
    rows(&folder.join("keyframes.csv"))?
        .iter()
        .map(|row| {
            let pose = Isometry2::new(Vector2::new(number(row, 3)?, number(row, 4)?), number(row, 5)?);
            Ok(((number(row, 0)? as u32, number(row, 1)? as u32), (number(row, 2)?, pose)))
        })
        .collect()
}

/// Time and place, in odometry's frame, of every sighting of every landmark (numbers 6 to 20) by every robot.
fn sightings(folder: &Path, keyframes: &Keyframes) -> Result<Sightings> {
    let mut sightings = Sightings::new();
    for row in rows(&folder.join("observations.csv"))? {
        let number = |k: usize| -> Result<f64> { Ok(row.get(k).context("short row")?.parse()?) };
        let (robot, keyframe, target) = (number(0)? as u32, number(1)? as u32, number(2)? as u32);
        let Some((time, pose)) = keyframes.get(&(robot, keyframe)).filter(|_| target >= 6) else { continue };
        let (range, bearing) = (number(3)?, number(4)?);
        let place = pose * Point2::new(range * bearing.cos(), range * bearing.sin());
        sightings.entry((robot, target)).or_default().push((*time, place));
    }
    Ok(sightings)
}

/// Each robot's map of its window with the most landmarks.
fn maps(keyframes: &Keyframes, sightings: &Sightings) -> BTreeMap<u32, LandmarkMap> {
    let robots: std::collections::BTreeSet<u32> = keyframes.keys().map(|k| k.0).collect();
    let last = keyframes.values().map(|k| k.0).fold(0.0, f64::max);
    let starts = || (0..(last / (0.5 * WINDOW_S)) as usize).map(|k| 0.5 * WINDOW_S * k as f64);
    robots
        .into_iter()
        .filter_map(|robot| {
            let best = starts()
                .map(|start| window(robot, start, sightings))
                .rev()
                .max_by_key(|map| map.ids.len())?;
            Some((robot, best))
        })
        .collect()
}

fn window(robot: u32, start: f64, sightings: &Sightings) -> LandmarkMap {
    let mut map = LandmarkMap { objects: Vec::new(), ids: Vec::new() };
    for ((_, target), all) in sightings.range((robot, 0)..(robot + 1, 0)) {
        let inside: Vec<_> =
            all.iter().filter(|(time, _)| (start..start + WINDOW_S).contains(time)).map(|s| s.1).collect();
        if inside.len() >= SIGHTINGS {
            let n = inside.len() as f64;
            let mean = inside.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords) / n;
            let spread = inside.iter().map(|p| (p.coords - mean).norm_squared()).sum::<f64>() / (2.0 * n);
            // Sightings of one pass share odometry's error, so they do not average out.
            let covariance = Some(Matrix2::identity() * (spread + 0.15 * 0.15));
            map.objects.push(Object { covariance, ..Object::new(Point2::from(mean), 0.1, 0.1) });
            map.ids.push(*target);
        }
    }
    map
}
