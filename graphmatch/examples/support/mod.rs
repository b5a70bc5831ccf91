//! Problem files of pairs of object maps with their answers, and pictures of matched maps.
#![allow(dead_code, reason = "each example uses its part")]

use std::fmt::Write;

use std::path::Path;

use anyhow::Context;
use draco_graphmatch::{Object, Pair};
use nalgebra::{Isometry2, Point2, Vector2};
use serde::Deserialize;

/// One problem as its file has it.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Problem {
    pub(crate) map1: Vec<[f64; 4]>,
    pub(crate) map2: Vec<[f64; 4]>,
    pub(crate) gt: Vec<[usize; 2]>,
    #[serde(rename = "T")]
    pub(crate) transform: [f64; 3],
    #[serde(default = "default_sigma")]
    pub(crate) sigma: f64,
}

fn default_sigma() -> f64 {
    0.2
}

/// What an answer is worth.
pub(crate) struct Score {
    pub(crate) precision: f64,
    pub(crate) recall: f64,
    pub(crate) success: bool,
}

impl Problem {
    pub(crate) fn read_all(path: &Path) -> anyhow::Result<Vec<Self>> {
        let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
        Self::parse_all(&text).with_context(|| format!("parsing {}", path.display()))
    }

    pub(crate) fn parse_all(text: &str) -> anyhow::Result<Vec<Self>> {
        let problems: Vec<Self> = serde_json::from_str(text)?;
        for (k, p) in problems.iter().enumerate() {
            for [i, a] in &p.gt {
                anyhow::ensure!(
                    *i < p.map1.len() && *a < p.map2.len(),
                    "problem {k} has a true pair ({i}, {a}) outside its maps"
                );
            }
        }
        Ok(problems)
    }

    pub(crate) fn objects(map: &[[f64; 4]]) -> Vec<Object> {
        map.iter()
            .map(|[x, y, length, breadth]| Object::new(Point2::new(*x, *y), *length, *breadth))
            .collect()
    }

    /// Success: the truly common objects land within 1 m RMS of where the true transform puts them.
    pub(crate) fn score(&self, pairs: &[Pair], found: Option<&Isometry2<f64>>) -> Score {
        let hits = self.gt.iter().filter(|[i, a]| pairs.contains(&Pair { first: *i, second: *a })).count();
        let share = |of: usize| if of == 0 { 0.0 } else { hits as f64 / of as f64 };
        let [theta, x, y] = self.transform;
        let truth = Isometry2::new(Vector2::new(x, y), theta);
        let success = found.is_some_and(|found| {
            let sum: f64 = self
                .gt
                .iter()
                .map(|[_, a]| Point2::new(self.map2[*a][0], self.map2[*a][1]))
                .map(|p| (found * p - truth * p).norm_squared())
                .sum();
            (sum / self.gt.len() as f64).sqrt() < 1.0
        });
        Score { precision: share(pairs.len()), recall: share(self.gt.len()), success }
    }
}

/// Both maps side by side with a line from each object of a pair to its partner.
pub(crate) fn picture(map1: &[Object], map2: &[Object], pairs: &[Pair]) -> String {
    let (from1, size1) = frame(map1);
    let (from2, size2) = frame(map2);
    let (gap, margin) = (12.0, 6.0);
    let place1 = |o: &Object| (o.centroid - from1) + Vector2::new(margin, margin);
    let place2 = |o: &Object| (o.centroid - from2) + Vector2::new(margin + size1.x + gap, margin);
    let (width, height) = (size1.x + gap + size2.x + 2.0 * margin, size1.y.max(size2.y) + 2.0 * margin);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:.1} {height:.1}' width='900'>\n\
         <rect width='100%' height='100%' fill='white'/>\n"
    );
    for p in pairs {
        let (a, b) = (place1(&map1[p.first]), place2(&map2[p.second]));
        let line = (a.x, height - a.y, b.x, height - b.y);
        let _ = writeln!(
            svg,
            "<line x1='{:.2}' y1='{:.2}' x2='{:.2}' y2='{:.2}' stroke='#2a9d54' stroke-width='0.25'/>",
            line.0, line.1, line.2, line.3
        );
    }
    let places1 = map1.iter().map(|o| (place1(o), o, "#1f4e9c"));
    for (p, o, colour) in places1.chain(map2.iter().map(|o| (place2(o), o, "#c0392b"))) {
        let _ = writeln!(
            svg,
            "<ellipse cx='{:.2}' cy='{:.2}' rx='{:.2}' ry='{:.2}' fill='{colour}' fill-opacity='0.6'/>",
            p.x,
            height - p.y,
            0.5 * o.length,
            0.5 * o.breadth
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// Lower corner and size of the box around a map's centres.
fn frame(map: &[Object]) -> (Point2<f64>, Vector2<f64>) {
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = -low;
    for o in map {
        low = low.inf(&o.centroid.coords);
        high = high.sup(&o.centroid.coords);
    }
    (Point2::from(low), high - low)
}
