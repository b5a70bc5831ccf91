use std::fmt::Write;

use draco_graphmatch::{Method, Object, Verdict, match_objects};
use nalgebra::{Point2, Vector2};

use super::svg::{number, polyline};
use super::{ObjectReport, RobotReport, RunReport};

/// Width of one pair's picture and height of its maps, in its own units.
const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 240.0;
/// Neighbours of an object that its graph is drawn with: all pairs, as they are matched, would hide everything.
const DRAWN_NEIGHBOURS: usize = 3;
/// Distance in the common frame up to which a match is right, metres: less than things stand apart.
const RIGHT_M: f64 = 4.0;

/// Which objects of two robots' maps are the same, by their graphs alone.
struct ObjectMatch<'a> {
    robots: [&'a RobotReport; 2],
    verdict: Verdict,
    /// Places of the objects in both lists.
    pairs: Vec<(usize, usize)>,
}

impl RunReport {
    /// The object graphs of every two robots side by side, with the matches between them. The matches are made for the
    /// report, from nothing but the graphs; a mission uses them only if it aligns maps by objects.
    pub(super) fn object_figures(&self) -> String {
        let mut figures = String::new();
        for (at, a) in self.robots.iter().enumerate() {
            for b in &self.robots[at + 1..] {
                if let Some(found) = match_of(a, b) {
                    figures += &self.object_figure(&found);
                }
            }
        }
        if figures.is_empty() {
            return figures;
        }
        format!(
            "<section id=\"objects\"><h2>Object graphs and their matches</h2><p class=\"note\">Rectangles are objects, thin \
             lines their graph (three nearest neighbours are drawn, all are compared), lines across are matches.</p>\
             <div class=\"charts\">{figures}</div></section>"
        )
    }

    fn object_figure(&self, found: &ObjectMatch) -> String {
        let [a, b] = found.robots;
        let panels = [Panel::new(a, 0.0), Panel::new(b, 0.5 * WIDTH)];
        let mut svg = format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" class=\"graphs\" role=\"img\">");
        for (panel, robot) in panels.iter().zip(found.robots) {
            let _ = write!(svg, "<g class=\"c{}\">", self.color_of(robot.id));
            panel.draw(&mut svg, &robot.objects);
            svg += "</g>";
        }
        let common = a.merged && b.merged;
        let mut right = 0;
        for &(i, j) in &found.pairs {
            let (one, other) = (&a.objects[i], &b.objects[j]);
            let good = (one.centroid - other.centroid).norm() <= RIGHT_M;
            right += usize::from(good && common);
            let class = if !common {
                "unknown"
            } else if good {
                "right"
            } else {
                "wrong"
            };
            let ends = [panels[0].place(&one.centroid), panels[1].place(&other.centroid)];
            let _ = write!(svg, "<path class=\"match {class}\" d=\"{}\"/>", polyline(ends));
        }
        let verdict = match found.verdict {
            Verdict::Unique => "one way",
            Verdict::Ambiguous => "ambiguous",
            Verdict::None => "no match",
        };
        let judged =
            if common { format!(", {right} where the estimate has them too") } else { String::new() };
        format!(
            "<figure><figcaption>robots {} and {}: {verdict}, {} pairs{judged}</figcaption>{svg}</svg></figure>",
            a.id,
            b.id,
            found.pairs.len()
        )
    }
}

/// `None` where one of the robots has no objects.
fn match_of<'a>(a: &'a RobotReport, b: &'a RobotReport) -> Option<ObjectMatch<'a>> {
    if a.objects.is_empty() || b.objects.is_empty() {
        return None;
    }
    let side = |p: &Point2<f64>, q: &Point2<f64>| (p - q).norm();
    let object = |o: &ObjectReport| {
        let (one, other) = (side(&o.corners[0], &o.corners[1]), side(&o.corners[1], &o.corners[2]));
        Object::new(o.centroid, one.max(other), one.min(other))
    };
    let [first, second] = [a, b].map(|robot| robot.objects.iter().map(object).collect::<Vec<_>>());
    // objects that cannot be compared are no reason to fail a report
    let found = match_objects(&first, &second, &Method::default()).ok()?;
    let pairs = found.pairs.iter().map(|pair| (pair.first, pair.second)).collect();
    Some(ObjectMatch { robots: [a, b], verdict: found.verdict, pairs })
}

/// Where the map of one robot is drawn.
struct Panel {
    low: Vector2<f64>,
    high: Vector2<f64>,
    scale: f64,
    offset: Vector2<f64>,
}

impl Panel {
    fn new(robot: &RobotReport, left: f64) -> Self {
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for corner in robot.objects.iter().flat_map(|object| &object.corners) {
            low = low.inf(&corner.coords);
            high = high.sup(&corner.coords);
        }
        let extent = (high - low).map(|side| side.max(1.0));
        let room = Vector2::new(0.5 * WIDTH - 40.0, HEIGHT - 20.0);
        let scale = (room.x / extent.x).min(room.y / extent.y);
        let offset = Vector2::new(left + 20.0, 10.0) + 0.5 * (room - extent * scale);
        Panel { low, high, scale, offset }
    }

    fn place(&self, p: &Point2<f64>) -> Vector2<f64> {
        Vector2::new(p.x - self.low.x, self.high.y - p.y) * self.scale + self.offset
    }

    fn draw(&self, svg: &mut String, objects: &[ObjectReport]) {
        for (at, object) in objects.iter().enumerate() {
            let mut others: Vec<(f64, usize)> = (0..objects.len())
                .filter(|other| *other != at)
                .map(|other| ((objects[other].centroid - object.centroid).norm(), other))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0));
            for &(_, other) in others.iter().take(DRAWN_NEIGHBOURS) {
                let edge = [self.place(&object.centroid), self.place(&objects[other].centroid)];
                let _ = write!(svg, "<path class=\"edge\" d=\"{}\"/>", polyline(edge));
            }
        }
        for object in objects {
            let corners = polyline(object.corners.iter().map(|corner| self.place(corner)));
            let centre = self.place(&object.centroid);
            let _ = write!(
                svg,
                "<path class=\"object\" d=\"{corners}z\"><title>object {}</title></path><circle cx=\"{}\" cy=\"{}\" \
                 r=\"2\"/>",
                object.id,
                number(centre.x),
                number(centre.y)
            );
        }
    }
}
