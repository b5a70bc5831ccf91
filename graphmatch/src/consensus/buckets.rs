use nalgebra::Point2;

/// Points of the plane in square buckets, for "which points lie within a radius".
#[derive(Debug, Clone)]
pub(super) struct Buckets {
    corner: Point2<f64>,
    inverse_side: f64,
    columns: usize,
    rows: usize,
    /// Points of bucket `b` are `order[start[b]..start[b + 1]]`.
    start: Vec<u32>,
    order: Vec<u32>,
}

impl Buckets {
    /// * `radius` – largest radius that will be asked for, positive.
    pub(super) fn new(points: &[Point2<f64>], radius: f64) -> Self {
        let fold = |f: fn(f64, f64) -> f64, start: f64, axis: usize| {
            points.iter().fold(start, |m, p| f(m, p.coords[axis]))
        };
        let (low, high) = if points.is_empty() {
            (Point2::origin(), Point2::origin())
        } else {
            (
                Point2::new(fold(f64::min, f64::INFINITY, 0), fold(f64::min, f64::INFINITY, 1)),
                Point2::new(fold(f64::max, f64::NEG_INFINITY, 0), fold(f64::max, f64::NEG_INFINITY, 1)),
            )
        };
        // Not more buckets an axis than points: far outliers must not blow the table up.
        let most = points.len().max(1) as f64;
        let side = radius.max((high.x - low.x) / most).max((high.y - low.y) / most);
        let inverse_side = side.recip();
        let columns = ((high.x - low.x) * inverse_side) as usize + 1;
        let rows = ((high.y - low.y) * inverse_side) as usize + 1;
        let mut buckets = Self {
            corner: low,
            inverse_side,
            columns,
            rows,
            start: vec![0; columns * rows + 1],
            order: Vec::new(),
        };
        let bucket: Vec<usize> = points.iter().map(|p| buckets.bucket(p)).collect();
        for &b in &bucket {
            buckets.start[b + 1] += 1;
        }
        for b in 0..columns * rows {
            buckets.start[b + 1] += buckets.start[b];
        }
        let mut next = buckets.start.clone();
        buckets.order = vec![0; points.len()];
        for (i, &b) in bucket.iter().enumerate() {
            buckets.order[next[b] as usize] = i as u32;
            next[b] += 1;
        }
        buckets
    }

    fn bucket(&self, p: &Point2<f64>) -> usize {
        let x = ((p.x - self.corner.x) * self.inverse_side) as usize;
        let y = ((p.y - self.corner.y) * self.inverse_side) as usize;
        y.min(self.rows - 1) * self.columns + x.min(self.columns - 1)
    }

    /// Calls `visit` with every point of the buckets around `p`; the caller checks the distance.
    #[inline]
    pub(super) fn around(&self, p: &Point2<f64>, mut visit: impl FnMut(usize)) {
        let x = (p.x - self.corner.x) * self.inverse_side;
        let y = (p.y - self.corner.y) * self.inverse_side;
        if !(x >= -1.0 && y >= -1.0 && x <= self.columns as f64 + 1.0 && y <= self.rows as f64 + 1.0) {
            return;
        }
        // Rounded down, which a cast does only of what is positive.
        let (x, y) = ((x + 1.0) as i64 - 1, (y + 1.0) as i64 - 1);
        let (x0, x1) = ((x - 1).max(0) as usize, ((x + 1) as usize).min(self.columns - 1));
        let (y0, y1) = ((y - 1).max(0) as usize, ((y + 1) as usize).min(self.rows - 1));
        for row in y0..=y1 {
            let base = row * self.columns;
            if x0 > x1 {
                continue;
            }
            // Buckets of a row are adjacent, so their points are one run.
            for &i in &self.order[self.start[base + x0] as usize..self.start[base + x1 + 1] as usize] {
                visit(i as usize);
            }
        }
    }
}
