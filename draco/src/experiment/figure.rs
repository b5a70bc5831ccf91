use std::fmt::Write;

use nalgebra::Vector2;

use crate::report::svg::{escape, number, polyline, ticks};

/// A row of points with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// The points, in order of x; those that are not finite are left out.
    pub points: Vec<[f64; 2]>,
    /// Whether the points are joined.
    pub joined: bool,
}

/// A chart over two axes that start at 0.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figure {
    /// What it shows.
    pub title: String,
    /// Name and unit of the x axis.
    pub x: String,
    /// Name and unit of the y axis.
    pub y: String,
    /// Names of the whole numbers on the x axis, from 0; empty for a numeric axis.
    pub categories: Vec<String>,
    /// What is drawn.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 420.0;
/// Left, top, right, bottom.
const MARGIN: [f64; 4] = [64.0, 44.0, 170.0, 56.0];
const COLORS: [&str; 8] =
    ["#0b6fb8", "#d1495b", "#2f8f4e", "#b8860b", "#7b4fa3", "#11868f", "#666666", "#c2567c"];

impl Figure {
    /// Adds a series whose points are joined by a line.
    pub fn line(&mut self, name: impl Into<String>, points: impl IntoIterator<Item = [f64; 2]>) {
        self.add(name, points, true);
    }

    /// Adds a series of points.
    pub fn dots(&mut self, name: impl Into<String>, points: impl IntoIterator<Item = [f64; 2]>) {
        self.add(name, points, false);
    }

    fn add(&mut self, name: impl Into<String>, points: impl IntoIterator<Item = [f64; 2]>, joined: bool) {
        let points = points.into_iter().filter(|p| p.iter().all(|v| v.is_finite())).collect();
        self.series.push(Series { name: name.into(), points, joined });
    }

    /// The chart as an SVG file.
    pub fn svg(&self) -> String {
        let highest =
            |axis: usize| self.series.iter().flat_map(|s| &s.points).map(|p| p[axis]).fold(0.0, f64::max);
        let y_ticks = ticks(highest(1), 6.0);
        let top = y_ticks.last().copied().unwrap_or(1.0);
        let (left, right) = match self.categories.len() {
            0 => (0.0, highest(0).max(1e-9)),
            count => (-0.5, count as f64 - 0.5),
        };
        let at = |[x, y]: [f64; 2]| {
            let across = MARGIN[0] + (x - left) / (right - left) * (WIDTH - MARGIN[0] - MARGIN[2]);
            Vector2::new(across, HEIGHT - MARGIN[3] - y / top * (HEIGHT - MARGIN[1] - MARGIN[3]))
        };
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
             font-size=\"13\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><text x=\"{}\" y=\"24\" \
             font-size=\"16\">{}</text>",
            MARGIN[0],
            escape(&self.title)
        );
        for tick in y_ticks {
            let y = number(at([left, tick]).y);
            let _ = write!(
                svg,
                "<path d=\"M{} {y}H{}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{y}\" dy=\"4\" text-anchor=\"end\" \
                 fill=\"#444\">{}</text>",
                MARGIN[0],
                WIDTH - MARGIN[2],
                MARGIN[0] - 8.0,
                number(tick)
            );
        }
        let labels: Vec<(f64, String)> = match self.categories.len() {
            0 => ticks(right, 8.0).into_iter().filter(|t| *t <= right).map(|t| (t, number(t))).collect(),
            _ => self.categories.iter().enumerate().map(|(i, name)| (i as f64, escape(name))).collect(),
        };
        for (x, label) in labels {
            let (x, y) = (number(at([x, 0.0]).x), HEIGHT - MARGIN[3] + 20.0);
            let _ =
                write!(svg, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"#444\">{label}</text>");
        }
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text><text transform=\"translate(18 {}) rotate(-90)\" \
             text-anchor=\"middle\">{}</text>",
            0.5 * (MARGIN[0] + WIDTH - MARGIN[2]),
            HEIGHT - 12.0,
            escape(&self.x),
            0.5 * HEIGHT,
            escape(&self.y)
        );
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            if series.joined {
                let path = polyline(series.points.iter().map(|p| at(*p)));
                let _ =
                    write!(svg, "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>");
            }
            for point in series.points.iter().map(|p| at(*p)) {
                let (x, y) = (number(point.x), number(point.y));
                let _ = write!(
                    svg,
                    "<circle cx=\"{x}\" cy=\"{y}\" r=\"3.5\" fill=\"{color}\" fill-opacity=\".75\"/>"
                );
            }
            let y = MARGIN[1] + 20.0 * index as f64;
            let x = WIDTH - MARGIN[2] + 16.0;
            let _ = write!(
                svg,
                "<circle cx=\"{x}\" cy=\"{y}\" r=\"5\" fill=\"{color}\"/><text x=\"{}\" y=\"{y}\" dy=\"4\">{}</text>",
                x + 12.0,
                escape(&series.name)
            );
        }
        svg + "</svg>\n"
    }
}
