use std::collections::BTreeSet;
use std::fmt::Write;

use nalgebra::{Isometry2, Point2, Vector2};

use super::svg::{dots, escape, number, polyline, round_below};
use super::{ClosureReport, RobotReport, RunReport};
use crate::evaluate::Decision;

/// Width of the drawing, in its own units.
const WIDTH: f64 = 1000.0;
/// Greatest height of the drawing, in its own units.
const MAX_HEIGHT: f64 = 900.0;
/// Edge of the cells in which one robot's points show as one dot, metres: finer than the dots themselves.
const DOT_CELL_M: f64 = 0.2;
/// Slots of the colour scheme; robots beyond them share colours.
const COLORS: usize = 8;

impl RunReport {
    /// The map of all robots as an SVG file of its own: points, trajectories against truth, closures.
    ///
    /// ```
    /// let svg = draco::report::RunReport::default().map_svg();
    /// assert!(svg.starts_with("<svg") && svg.contains("</svg>"));
    /// ```
    pub fn map_svg(&self) -> String {
        let style = concat!("<style>", include_str!("colors.css"), include_str!("map.css"), "</style>");
        let style = format!("{style}<rect class=\"paper\" width=\"100%\" height=\"100%\"/>");
        self.map(&style, "xmlns=\"http://www.w3.org/2000/svg\"")
    }

    /// The map as an element; `head` goes in first.
    pub(super) fn map(&self, head: &str, attributes: &str) -> String {
        let canvas = Canvas::around(self);
        let (width, height) = (number(canvas.size.x), number(canvas.size.y));
        let mut svg = format!(
            "<svg {attributes} class=\"map\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"Map of all robots\">{head}"
        );
        for robot in self.drawn() {
            canvas.points(&mut svg, self, robot);
        }
        for robot in self.drawn() {
            canvas.truth(&mut svg, self, robot);
        }
        for closure in &self.closures {
            canvas.closure(&mut svg, self, closure);
        }
        for robot in self.drawn() {
            canvas.trajectory(&mut svg, self, robot);
        }
        canvas.scale_bar(&mut svg);
        svg + "</svg>"
    }

    /// Robots that share one frame: the merged ones, or the first alone.
    pub(super) fn drawn(&self) -> impl Iterator<Item = &RobotReport> {
        let any_merged = self.robots.iter().any(|robot| robot.merged);
        let first = self.robots.first().map(|robot| robot.id);
        self.robots.iter().filter(move |robot| robot.merged || (!any_merged && Some(robot.id) == first))
    }

    /// Slot of the colour scheme for a robot, counting from 1.
    pub(super) fn color_of(&self, id: crate::keyframe::RobotId) -> usize {
        1 + self.robots.iter().position(|robot| robot.id == id).unwrap_or(0) % COLORS
    }
}

/// Maps the common frame to drawing coordinates: north up, one scale.
struct Canvas {
    /// Puts the estimate on the truth, where there is one.
    frame: Isometry2<f64>,
    low: Vector2<f64>,
    high: Vector2<f64>,
    scale: f64,
    size: Vector2<f64>,
}

impl Canvas {
    fn around(report: &RunReport) -> Self {
        let error = report.team_error().or_else(|| report.drawn().next()?.error());
        let frame = error.map_or_else(Isometry2::identity, |error| error.truth_from_estimate);
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for robot in report.drawn() {
            let truth = robot.truth.iter().flatten().map(|pose| pose.translation.vector);
            let path = robot.trajectory.iter().map(|pose| (frame * pose).translation.vector);
            let map = robot.map_points().map(|(_, point)| (frame * point).coords);
            for position in truth.chain(path).chain(map).filter(|p| p.iter().all(|v| v.is_finite())) {
                low = low.inf(&position);
                high = high.sup(&position);
            }
        }
        if low.x > high.x {
            (low, high) = (Vector2::zeros(), Vector2::repeat(1.0));
        }
        let margin = Vector2::repeat(1.0 + 0.02 * (high - low).norm());
        let (low, high) = (low - margin, high + margin);
        let extent = high - low;
        let scale = f64::min(WIDTH / extent.x, MAX_HEIGHT / extent.y);
        Self { frame, low, high, scale, size: extent * scale }
    }

    fn place(&self, position: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(position.x - self.low.x, self.high.y - position.y) * self.scale
    }

    fn estimate(&self, pose: &Isometry2<f64>) -> Vector2<f64> {
        self.place(&(self.frame * pose).translation.vector)
    }

    fn points(&self, svg: &mut String, report: &RunReport, robot: &RobotReport) {
        let color = report.color_of(robot.id);
        let _ = write!(svg, "<g class=\"points c{color} r{}\">", robot.id);
        let mut shown = BTreeSet::new();
        let mut of_keyframe: Vec<Vec<Vector2<f64>>> = vec![Vec::new(); robot.points.len()];
        for (keyframe, point) in robot.map_points() {
            let position = (self.frame * point).coords;
            let cell = position.map(|value| (value / DOT_CELL_M) as i64);
            if shown.insert((cell.x, cell.y)) {
                of_keyframe[keyframe].push(self.place(&position));
            }
        }
        for (keyframe, points) in of_keyframe.into_iter().enumerate().filter(|(_, points)| !points.is_empty())
        {
            let _ = write!(svg, "<path data-k=\"{keyframe}\" d=\"{}\"/>", dots(points));
        }
        svg.push_str("</g>");
    }

    fn truth(&self, svg: &mut String, report: &RunReport, robot: &RobotReport) {
        let color = report.color_of(robot.id);
        let path = polyline(robot.truth.iter().flatten().map(|pose| self.place(&pose.translation.vector)));
        if !path.is_empty() {
            let _ = write!(svg, "<path class=\"truth c{color} r{}\" d=\"{path}\"/>", robot.id);
        }
    }

    fn trajectory(&self, svg: &mut String, report: &RunReport, robot: &RobotReport) {
        let (color, id) = (report.color_of(robot.id), robot.id);
        let _ = write!(svg, "<g class=\"path c{color} r{id}\">");
        for (keyframe, pair) in robot.trajectory.windows(2).enumerate() {
            let step = polyline([self.estimate(&pair[0]), self.estimate(&pair[1])]);
            let _ = write!(svg, "<path data-k=\"{}\" d=\"{step}\"/>", keyframe + 1);
        }
        if let Some(start) = robot.trajectory.first() {
            let at = self.estimate(start);
            let _ = write!(
                svg,
                "<circle cx=\"{x}\" cy=\"{y}\" r=\"7\"/><text x=\"{x}\" y=\"{y}\" dy=\"3.6\">{id}</text>",
                x = number(at.x),
                y = number(at.y),
            );
        }
        svg.push_str("</g>");
    }

    fn closure(&self, svg: &mut String, report: &RunReport, closure: &ClosureReport) {
        let drawn = |robot| report.drawn().any(|one| one.id == robot);
        let ends = (report.position_of(closure.a), report.position_of(closure.b));
        let (Some(a), Some(b)) = ends else { return };
        if !drawn(closure.a.robot) || !drawn(closure.b.robot) {
            return;
        }
        let place = |position| self.place(&(self.frame * Point2::from(position)).coords);
        let grade = report.grade(closure).map(|grade| grade.correct);
        let class = match (closure.decision, grade) {
            (Decision::Accepted, Some(false)) => "accepted wrong",
            (Decision::Accepted, _) => "accepted",
            (Decision::Rejected, _) => "rejected",
            (Decision::Undecided, _) => "undecided",
        };
        let judged = match grade {
            Some(true) => ", right by the truth",
            Some(false) => ", wrong by the truth",
            None => "",
        };
        let _ = write!(
            svg,
            "<path class=\"closure {class}\" data-k=\"{}\" d=\"{}\"><title>robot {} keyframe {} – robot {} \
             keyframe {}: {}{judged}. {}</title></path>",
            closure.a.index.max(closure.b.index),
            polyline([place(a), place(b)]),
            closure.a.robot,
            closure.a.index,
            closure.b.robot,
            closure.b.index,
            closure.decision.as_str(),
            escape(&closure.reason),
        );
    }

    fn scale_bar(&self, svg: &mut String) {
        let length = round_below(0.2 * (self.high.x - self.low.x));
        let (x, y) = (self.size.x - 24.0, self.size.y - 20.0);
        let from = x - length * self.scale;
        let _ = write!(
            svg,
            "<g class=\"scale\"><path d=\"M{} {}v6H{}v-6\"/><text x=\"{}\" y=\"{}\">{} m</text></g>",
            number(from),
            number(y - 6.0),
            number(x),
            number(0.5 * (from + x)),
            number(y - 8.0),
            number(length),
        );
    }
}

impl RobotReport {
    /// Points of the map in the frame of the final trajectory, each with the index of its keyframe.
    fn map_points(&self) -> impl Iterator<Item = (usize, Point2<f64>)> {
        let scans = self.points.iter().zip(&self.trajectory).enumerate();
        scans.flat_map(|(keyframe, (points, pose))| points.iter().map(move |point| (keyframe, pose * point)))
    }
}
