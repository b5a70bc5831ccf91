use std::collections::BTreeMap;
use std::fmt::Write;

use nalgebra::Vector2;

use super::svg::{escape, number, polyline, ticks};
use super::{RobotReport, RunReport};
use crate::evaluate::{Decision, TrajectoryError};

/// Widths of the charts in their own units: about what they get on a page, so that letters keep their size.
const TRAFFIC_WIDTH: f64 = 500.0;
const ERROR_WIDTH: f64 = 350.0;
const HEIGHT: f64 = 230.0;
/// Room for labels on the left, at the top, on the right and below.
const MARGIN: [f64; 4] = [44.0, 12.0, 10.0, 30.0];
/// Bars over the time of a mission.
const BINS: usize = 48;

/// A chart's plane: x from 0 to `right`, y from 0 to the last tick.
struct Plane {
    width: f64,
    right: f64,
    top: f64,
    svg: String,
}

impl Plane {
    fn new(label: &str, width: f64, [right, highest]: [f64; 2]) -> Self {
        let ticks_y = ticks(highest, 5.0);
        let top = ticks_y.last().copied().unwrap_or(1.0);
        let right = if right > 0.0 { right } else { 1.0 };
        let mut plane = Self { width, right, top, svg: String::new() };
        let _ = write!(
            plane.svg,
            "<svg class=\"chart\" viewBox=\"0 0 {width} {HEIGHT}\" role=\"img\" aria-label=\"{}\">",
            escape(label)
        );
        for tick in ticks_y {
            let y = plane.at(0.0, tick).y;
            let _ = write!(
                plane.svg,
                "<path class=\"grid\" d=\"M{} {y:.1}H{}\"/><text class=\"y\" x=\"{}\" y=\"{:.1}\">{}</text>",
                MARGIN[0],
                width - MARGIN[2],
                MARGIN[0] - 6.0,
                y + 3.5,
                number(tick)
            );
        }
        for tick in ticks(right, 6.0).into_iter().filter(|tick| *tick <= right) {
            let x = plane.at(tick, 0.0).x;
            let (y, tick) = (HEIGHT - MARGIN[3] + 16.0, number(tick));
            let _ = write!(plane.svg, "<text class=\"x\" x=\"{x:.1}\" y=\"{y}\">{tick}</text>");
        }
        plane
    }

    fn at(&self, x: f64, y: f64) -> Vector2<f64> {
        let [left, top, right, bottom] = MARGIN;
        let across = left + x / self.right * (self.width - left - right);
        Vector2::new(across, HEIGHT - bottom - y / self.top * (HEIGHT - top - bottom))
    }

    fn finish(mut self, x_name: &str) -> String {
        let _ = write!(
            self.svg,
            "<text class=\"x name\" x=\"{}\" y=\"{}\">{}</text></svg>",
            0.5 * (MARGIN[0] + self.width - MARGIN[2]),
            HEIGHT - 2.0,
            escape(x_name)
        );
        self.svg
    }
}

/// Distance of each keyframe with a truth from it, under the one alignment of `error`.
fn distances(
    poses: &[nalgebra::Isometry2<f64>],
    robot: &RobotReport,
    error: &TrajectoryError,
) -> Vec<(f64, f64)> {
    let one = |(index, (pose, truth)): (usize, (&nalgebra::Isometry2<f64>, &Option<_>))| {
        let truth: &nalgebra::Isometry2<f64> = truth.as_ref()?;
        let aligned = (error.truth_from_estimate * pose).translation.vector;
        Some((index as f64, (aligned - truth.translation.vector).norm()))
    };
    poses.iter().zip(&robot.truth).enumerate().filter_map(one).collect()
}

impl RunReport {
    /// Kilobits sent over time, stacked by type of message; empty when nothing was sent.
    pub(super) fn traffic_chart(&self) -> String {
        let kinds = self.message_kinds();
        let end = self.traffic.iter().map(|message| message.time).fold(0.0, f64::max);
        if kinds.is_empty() {
            return String::new();
        }
        let width = if end > 0.0 { end / BINS as f64 } else { 1.0 };
        let mut bins = vec![vec![0.0; kinds.len()]; BINS];
        for message in &self.traffic {
            let bin = ((message.time / width) as usize).min(BINS - 1);
            if let Some(kind) = kinds.iter().position(|kind| *kind == message.kind) {
                bins[bin][kind] += message.bits as f64 / 1000.0 / width;
            }
        }
        let highest = bins.iter().map(|bin| bin.iter().sum()).fold(0.0, f64::max);
        let mut plane = Plane::new("Traffic over time", TRAFFIC_WIDTH, [end, highest]);
        for (index, bin) in bins.iter().enumerate() {
            let mut below = 0.0;
            for (kind, rate) in bin.iter().enumerate().filter(|(_, rate)| **rate > 0.0) {
                let low = plane.at(index as f64 * width, below);
                below += rate;
                let high = plane.at((index as f64 + 0.86) * width, below);
                let _ = write!(
                    plane.svg,
                    "<rect class=\"k{kind}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"><title>\
                     {}: {rate:.3} kbit/s at {:.0} s</title></rect>",
                    low.x,
                    high.y,
                    high.x - low.x,
                    low.y - high.y,
                    escape(&kinds[kind]),
                    index as f64 * width,
                );
            }
        }
        plane.finish("time, s")
    }

    /// Distance from the truth along each robot's mission: dead reckoning against the final estimate.
    pub(super) fn error_chart(&self, robot: &RobotReport) -> String {
        let (Some(before), Some(after)) = (robot.dead_reckoning_error(), robot.error()) else {
            return String::new();
        };
        let curves = [
            ("before", distances(&robot.dead_reckoning, robot, &before)),
            ("after", distances(&robot.trajectory, robot, &after)),
        ];
        let highest = curves.iter().flat_map(|(_, curve)| curve).map(|(_, y)| *y).fold(0.0, f64::max);
        let last = robot.trajectory.len().saturating_sub(1) as f64;
        let label = format!("Distance of robot {} from the truth", robot.id);
        let mut plane = Plane::new(&label, ERROR_WIDTH, [last, highest]);
        for (class, curve) in curves {
            let path = polyline(curve.into_iter().map(|(x, y)| plane.at(x, y)));
            let color = self.color_of(robot.id);
            let _ = write!(plane.svg, "<path class=\"{class} c{color}\" d=\"{path}\"/>");
        }
        plane.finish("keyframe")
    }

    /// Counts of closures by what became of them and why, most frequent first; numbers in a reason are left out, so
    /// that one cause makes one row.
    pub(super) fn reasons(&self) -> Vec<(Decision, String, [usize; 3])> {
        let mut rows: BTreeMap<(Decision, String), [usize; 3]> = BTreeMap::new();
        for closure in &self.closures {
            let key = (closure.decision, without_numbers(&closure.reason));
            let column = match self.grade(closure) {
                Some(grade) if grade.correct => 0,
                Some(_) => 1,
                None => 2,
            };
            rows.entry(key).or_default()[column] += 1;
        }
        let mut rows: Vec<_> = rows.into_iter().map(|((what, why), counts)| (what, why, counts)).collect();
        rows.sort_by_key(|(what, _, counts)| (*what, std::cmp::Reverse(counts.iter().sum::<usize>())));
        rows
    }
}

fn without_numbers(reason: &str) -> String {
    let mut text = String::new();
    let mut rest = reason.chars().peekable();
    while let Some(character) = rest.next() {
        let in_number = text.ends_with('…');
        let sign = character == '-' && !in_number && rest.peek().is_some_and(char::is_ascii_digit);
        if character.is_ascii_digit() || sign {
            if !in_number {
                text.push('…');
            }
        } else if !(in_number && character == '.') {
            text.push(character);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::without_numbers;

    #[test]
    fn reasons_differ_by_words_not_by_numbers() {
        assert_eq!(without_numbers("12.5 m above 11.34."), "… m above …");
        assert_eq!(without_numbers("off by (-0.31, 2) m"), "off by (…, …) m");
        assert_eq!(without_numbers("overlap too small"), "overlap too small");
    }
}
