use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use nalgebra::{Isometry2, Point2, Vector2};

use super::{KEYFRAMES_FILE, POINTS_FILE};
use crate::Error;
use crate::keyframe::{Keyframe, MissionData, Recording, RobotId};

/// Largest time still taken for one, seconds; clocks that count from 1970 are far below. Beyond it a table is damaged.
const LARGEST_TIME: f64 = 1e11;
/// Largest coordinate of a pose, metres; national grids are below.
const LARGEST_POSE: f64 = 1e7;
/// Largest coordinate of a point in the sensor frame, metres: imaging sonars see 1 to 200 m. A point far beyond would
/// only tell later, and without its line, by a map too large to be matched.
const LARGEST_POINT: f64 = 300.0;

/// Disagreement of two heading increments below which they are one measurement written twice, radians: ten times
/// the rounding of a table with four decimals.
const SAME_HEADING: f64 = 1e-3;

/// The mission stored in the folder `dir`, named after the folder.
///
/// # Errors
/// [`Error::Io`] when the folder or a table cannot be read; [`Error::MissingColumn`] and [`Error::Table`], naming
/// file, line and column, when a table is damaged: a cell that is no number or not finite, a line with too few
/// cells, a keyframe named twice, a point of an unknown keyframe, a time that runs backwards, a robot without
/// points, no keyframe at all.
pub fn read_keyframe_folder(dir: &Path) -> Result<MissionData, Error> {
    std::fs::read_dir(dir).map_err(|source| Error::io(dir, source))?;
    let (keyframes, points) = (dir.join(KEYFRAMES_FILE), dir.join(POINTS_FILE));
    let open =
        |path: &PathBuf| File::open(path).map_err(|source| Error::io(path, source)).map(BufReader::new);
    let canonical = dir.canonicalize().map_err(|source| Error::io(dir, source))?;
    let name = canonical.file_name().unwrap_or(canonical.as_os_str()).to_string_lossy().into_owned();
    let (keyframes_table, points_table) = (open(&keyframes)?, open(&points)?);
    let mut mission = assemble(Table::new(keyframes, keyframes_table)?, Table::new(points, points_table)?)?;
    mission.name = name;
    Ok(mission)
}

/// The mission in two tables already open; errors name them `keyframes.csv` and `points.csv`.
///
/// # Errors
/// As [`read_keyframe_folder`].
pub fn read_keyframe_tables(keyframes: impl Read, points: impl Read) -> Result<MissionData, Error> {
    assemble(Table::new(KEYFRAMES_FILE.into(), keyframes)?, Table::new(POINTS_FILE.into(), points)?)
}

/// A table with named columns that knows where it is.
struct Table<R: Read> {
    file: PathBuf,
    reader: csv::Reader<R>,
    columns: Vec<String>,
    row: csv::StringRecord,
    line: u64,
}

impl<R: Read> Table<R> {
    fn new(file: PathBuf, source: R) -> Result<Self, Error> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(source);
        let columns = match reader.headers() {
            Ok(headers) => headers.iter().map(str::to_owned).collect(),
            Err(error) => return Err(table_error(&file, 1, error)),
        };
        Ok(Self { file, reader, columns, row: csv::StringRecord::new(), line: 1 })
    }

    fn find(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|name| name == column)
    }

    fn require(&self, column: &'static str) -> Result<usize, Error> {
        self.find(column).ok_or_else(|| Error::MissingColumn { file: self.file.clone(), column })
    }

    /// Moves to the next row; `false` at the end of the table.
    fn advance(&mut self) -> Result<bool, Error> {
        let next_line = self.reader.position().line();
        let more = self
            .reader
            .read_record(&mut self.row)
            .map_err(|error| table_error(&self.file, next_line, error))?;
        self.line = self.row.position().map_or(next_line, csv::Position::line);
        Ok(more)
    }

    fn cell(&self, column: usize) -> &str {
        self.row.get(column).unwrap_or_default()
    }

    fn parse<T: FromStr>(&self, column: usize, wanted: &str) -> Result<T, Error> {
        let cell = self.cell(column);
        cell.parse().map_err(|_| self.fault(Some(column), format!("`{}` is not {wanted}", shown(cell))))
    }

    fn number(&self, column: usize, largest: f64) -> Result<f64, Error> {
        let value: f64 = self.parse(column, "a number")?;
        if value.abs() <= largest {
            return Ok(value);
        }
        let reason = if value.is_finite() { "is too large to be a measurement" } else { "is not finite" };
        Err(self.fault(Some(column), format!("`{}` {reason}", shown(self.cell(column)))))
    }

    fn fault(&self, column: Option<usize>, reason: impl Into<String>) -> Error {
        let column = column.and_then(|index| self.columns.get(index)).cloned();
        Error::Table { file: self.file.clone(), line: self.line, column, reason: reason.into() }
    }
}

fn table_error(file: &Path, line: u64, error: csv::Error) -> Error {
    let line = error.position().map_or(line, csv::Position::line);
    let reason = match error.into_kind() {
        csv::ErrorKind::Io(source) => return Error::io(file, source),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("the line has {len} cells where the header has {expected_len}; is it cut off?")
        }
        csv::ErrorKind::Utf8 { .. } => "the line is not UTF-8 text".to_owned(),
        _ => "the line is not CSV".to_owned(),
    };
    Error::Table { file: file.to_path_buf(), line, column: None, reason }
}

/// A cell as an error message shows it: one short line whatever the file holds.
fn shown(cell: &str) -> String {
    let mut text: String = cell.chars().take(40).flat_map(char::escape_default).collect();
    if cell.chars().nth(40).is_some() {
        text.push('…');
    }
    text
}

struct KeyframeColumns {
    robot: usize,
    kf: usize,
    time: usize,
    odometry: [usize; 3],
    truth: Option<[usize; 3]>,
    n_points: Option<usize>,
}

impl KeyframeColumns {
    fn of<R: Read>(table: &Table<R>) -> Result<Self, Error> {
        let any_truth = ["gt_x", "gt_y", "gt_theta"].iter().any(|name| table.find(name).is_some());
        let truth = if any_truth {
            Some([table.require("gt_x")?, table.require("gt_y")?, table.require("gt_theta")?])
        } else {
            None
        };
        Ok(Self {
            robot: table.require("robot")?,
            kf: table.require("kf")?,
            time: table.require("time")?,
            odometry: [table.require("dr_x")?, table.require("dr_y")?, table.require("dr_theta")?],
            truth,
            n_points: table.find("n_points"),
        })
    }
}

fn pose<R: Read>(table: &Table<R>, [x, y, theta]: [usize; 3]) -> Result<Isometry2<f64>, Error> {
    Ok(Isometry2::new(
        Vector2::new(table.number(x, LARGEST_POSE)?, table.number(y, LARGEST_POSE)?),
        table.number(theta, LARGEST_POSE)?,
    ))
}

fn optional_pose<R: Read>(
    table: &Table<R>,
    columns: Option<[usize; 3]>,
) -> Result<Option<Isometry2<f64>>, Error> {
    match columns {
        Some(columns) if columns.iter().any(|&column| !table.cell(column).is_empty()) => {
            pose(table, columns).map(Some)
        }
        _ => Ok(None),
    }
}

/// Where a keyframe of the tables went, and what the table said of it.
struct Entry {
    robot: RobotId,
    index: usize,
    line: u64,
    promised_points: Option<usize>,
}

/// Keyframes by the id the tables know them by.
type Entries = BTreeMap<(Option<RobotId>, u64), Entry>;

fn assemble<K: Read, P: Read>(mut keyframes: Table<K>, mut points: Table<P>) -> Result<MissionData, Error> {
    let points_name_robot = points.find("robot");
    let (mut recordings, entries) = read_keyframes(&mut keyframes, points_name_robot.is_some())?;
    read_points(&mut points, points_name_robot, &entries, &mut recordings)?;
    check_points(&keyframes, &entries, &recordings)?;
    let recordings: Vec<Recording> = recordings.into_values().collect();
    let truth_has_heading = truth_has_heading(&recordings);
    Ok(MissionData { name: "keyframes".to_owned(), recordings, truth_has_heading })
}

fn read_keyframes<R: Read>(
    table: &mut Table<R>,
    ids_within_robot: bool,
) -> Result<(BTreeMap<RobotId, Recording>, Entries), Error> {
    let columns = KeyframeColumns::of(table)?;
    let mut recordings: BTreeMap<RobotId, Recording> = BTreeMap::new();
    let mut entries = Entries::new();
    while table.advance()? {
        let robot: RobotId = table.parse(columns.robot, "a robot's number")?;
        let kf: u64 = table.parse(columns.kf, "a keyframe's number")?;
        let time = table.number(columns.time, LARGEST_TIME)?;
        let recording = recordings.entry(robot).or_insert_with(|| Recording {
            robot,
            keyframes: Vec::new(),
            truth: Vec::new(),
        });
        if let Some(last) = recording.keyframes.last().filter(|last| last.time > time) {
            let reason = format!("{time} s is before {} s of the robot's keyframe above", last.time);
            return Err(table.fault(Some(columns.time), reason));
        }
        let promised_points = match columns.n_points {
            Some(column) => Some(table.parse(column, "a count")?),
            None => None,
        };
        let entry = Entry { robot, index: recording.keyframes.len(), line: table.line, promised_points };
        if let Some(first) = entries.insert((ids_within_robot.then_some(robot), kf), entry) {
            let reason = format!("keyframe {kf} is already on line {}", first.line);
            return Err(table.fault(Some(columns.kf), reason));
        }
        let odometry = pose(table, columns.odometry)?;
        let index = recording.keyframes.len() as u32;
        recording.keyframes.push(Keyframe { index, time, odometry, points: Vec::new() });
        recording.truth.push(optional_pose(table, columns.truth)?);
    }
    if recordings.is_empty() {
        return Err(table.fault(None, "there is no keyframe, so there is no robot"));
    }
    Ok((recordings, entries))
}

fn read_points<R: Read>(
    table: &mut Table<R>,
    robot_column: Option<usize>,
    entries: &Entries,
    recordings: &mut BTreeMap<RobotId, Recording>,
) -> Result<(), Error> {
    let (kf_column, x, y) = (table.require("kf")?, table.require("x")?, table.require("y")?);
    while table.advance()? {
        let kf: u64 = table.parse(kf_column, "a keyframe's number")?;
        let robot = match robot_column {
            Some(column) => Some(table.parse(column, "a robot's number")?),
            None => None,
        };
        let point = Point2::new(table.number(x, LARGEST_POINT)?, table.number(y, LARGEST_POINT)?);
        let keyframe = entries
            .get(&(robot, kf))
            .and_then(|entry| recordings.get_mut(&entry.robot)?.keyframes.get_mut(entry.index));
        match keyframe {
            Some(keyframe) => keyframe.points.push(point),
            None => {
                let of_robot = robot.map(|robot| format!(" of robot {robot}")).unwrap_or_default();
                let reason = format!("keyframe {kf}{of_robot} is not in {KEYFRAMES_FILE}");
                return Err(table.fault(Some(kf_column), reason));
            }
        }
    }
    Ok(())
}

/// Checks what only the two tables together can tell; faults are laid at the keyframe's line.
fn check_points<R: Read>(
    table: &Table<R>,
    entries: &Entries,
    recordings: &BTreeMap<RobotId, Recording>,
) -> Result<(), Error> {
    let fault = |line, column: Option<&str>, reason| Error::Table {
        file: table.file.clone(),
        line,
        column: column.map(str::to_owned),
        reason,
    };
    let mut in_order: Vec<_> = entries.iter().collect();
    in_order.sort_by_key(|(_, entry)| entry.line);
    for ((_, kf), entry) in in_order {
        let Some(recording) = recordings.get(&entry.robot) else { continue };
        if recording.keyframes.iter().all(|keyframe| keyframe.points.is_empty()) {
            let reason = format!("robot {} has no point in {POINTS_FILE}", entry.robot);
            return Err(fault(entry.line, None, reason));
        }
        let found = recording.keyframes.get(entry.index).map_or(0, |keyframe| keyframe.points.len());
        if let Some(promised) = entry.promised_points.filter(|&promised| promised != found) {
            let reason = format!("keyframe {kf} promises {promised} points, {POINTS_FILE} has {found}");
            return Err(fault(entry.line, Some("n_points"), reason));
        }
    }
    Ok(())
}

/// Whether the truth's heading is a measurement of its own: where its increments repeat those of the dead reckoning
/// on more than half of the steps, both come from one compass and the truth can judge no heading.
fn truth_has_heading(recordings: &[Recording]) -> bool {
    let (mut steps, mut same) = (0_usize, 0_usize);
    for recording in recordings {
        for (truth, keyframes) in recording.truth.windows(2).zip(recording.keyframes.windows(2)) {
            if let ([Some(before), Some(after)], [first, second]) = (truth, keyframes) {
                let true_turn = before.rotation.rotation_to(&after.rotation);
                let turn = first.odometry.rotation.rotation_to(&second.odometry.rotation);
                steps += 1;
                same += usize::from(true_turn.angle_to(&turn).abs() < SAME_HEADING);
            }
        }
    }
    2 * same < steps
}
