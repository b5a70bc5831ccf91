use super::threshold::{CfarKind, threshold_factor};
use crate::Error;

/// A sonar image as the device gives it: rows are ranges from near to far, columns are beams from starboard to port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolarImage {
    columns: usize,
    cells: Vec<u8>,
}

impl PolarImage {
    /// From intensities row after row.
    ///
    /// # Errors
    /// [`Error::Parameter`] when `cells` is no whole number of rows, or there is no column.
    pub fn new(columns: usize, cells: Vec<u8>) -> Result<Self, Error> {
        if columns == 0 || !cells.len().is_multiple_of(columns) {
            let reason = "must be above 0 and divide the number of cells";
            return Err(Error::Parameter { name: "columns", value: columns as f64, reason });
        }
        Ok(Self { columns, cells })
    }

    /// Number of ranges.
    pub fn rows(&self) -> usize {
        self.cells.len() / self.columns
    }

    /// Number of beams.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Intensities row after row.
    pub fn as_cells(&self) -> &[u8] {
        &self.cells
    }

    fn row(&self, row: usize) -> &[u8] {
        &self.cells[row * self.columns..][..self.columns]
    }
}

/// Settings of a [`Cfar`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CfarParams {
    /// How the noise is estimated. Default SOCA.
    pub kind: CfarKind,
    /// Training cells, both sides together; even. Default 40.
    pub training: usize,
    /// Guard cells between a cell and its training cells, both sides together; even. Default 20, so that the smear
    /// of one echo over ranges does not count as noise.
    pub guard: usize,
    /// Share of noise cells let through. Default 0.1; most of them fall to `min_intensity`.
    pub false_alarm: f64,
    /// Weaker or equal cells are no hits whatever their surroundings. Default 85 of 255.
    pub min_intensity: u8,
}

impl Default for CfarParams {
    /// The values of the published system.
    fn default() -> Self {
        Self { kind: CfarKind::Soca, training: 40, guard: 20, false_alarm: 0.1, min_intensity: 85 }
    }
}

/// Finds cells that stand out of the noise around them at the same bearing.
///
/// Cells nearer than half the training and half the guard cells to either end of the range are never hits.
///
/// ```
/// use draco::sonar::{Cfar, CfarParams, PolarImage};
///
/// let mut cells = vec![20; 100];
/// cells[50] = 200;
/// let image = PolarImage::new(1, cells)?;
/// assert_eq!(Cfar::new(CfarParams::default())?.detect(&image), [(50, 0)]);
/// # Ok::<(), draco::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Cfar {
    params: CfarParams,
    factor: f64,
}

impl Cfar {
    /// A detector.
    ///
    /// # Errors
    /// [`Error::Parameter`] when a setting is out of range; see [`threshold_factor`].
    pub fn new(params: CfarParams) -> Result<Self, Error> {
        if params.guard % 2 == 1 {
            return Err(Error::Parameter {
                name: "guard",
                value: params.guard as f64,
                reason: "must be even",
            });
        }
        let factor = threshold_factor(params.kind, params.training, params.false_alarm)?;
        Ok(Self { params, factor })
    }

    /// Row and column of every hit, row after row. Cost O(cells); an order statistic adds O(256) at worst for each
    /// cell, a few steps as a rule.
    pub fn detect(&self, image: &PolarImage) -> Vec<(usize, usize)> {
        match self.params.kind {
            CfarKind::Os { rank } => self.detect_by_rank(image, rank),
            CfarKind::Ca => self.detect_by_sums(image, |before, behind| 0.5 * f64::from(before + behind)),
            CfarKind::Soca => self.detect_by_sums(image, |before, behind| f64::from(before.min(behind))),
            CfarKind::Goca => self.detect_by_sums(image, |before, behind| f64::from(before.max(behind))),
        }
    }

    /// Half the training and half the guard cells.
    fn halves(&self) -> (usize, usize) {
        (self.params.training / 2, self.params.guard / 2)
    }

    /// `noise` makes one estimate, times half the training cells, of the sums on both sides. The sums of all columns
    /// slide along the ranges together, so that memory is read in order.
    fn detect_by_sums(&self, image: &PolarImage, noise: impl Fn(u32, u32) -> f64) -> Vec<(usize, usize)> {
        let (train, guard) = self.halves();
        let reach = train + guard;
        let mut hits = Vec::new();
        if image.rows() <= 2 * reach {
            return hits;
        }
        let mut before = vec![0_u32; image.columns];
        let mut behind = vec![0_u32; image.columns];
        for row in 0..train {
            add(&mut before, image.row(row));
            add(&mut behind, image.row(row + reach + guard + 1));
        }
        let scale = self.factor / train as f64;
        for row in reach..image.rows() - reach {
            for (column, &cell) in image.row(row).iter().enumerate() {
                let strong = cell > self.params.min_intensity;
                if strong && f64::from(cell) > scale * noise(before[column], behind[column]) {
                    hits.push((row, column));
                }
            }
            if row + reach + 1 < image.rows() {
                slide(&mut before, image.row(row - guard), image.row(row - reach));
                slide(&mut behind, image.row(row + reach + 1), image.row(row + guard + 1));
            }
        }
        hits
    }

    /// Column by column with a histogram of the training cells; the wanted rank moves by a few levels from one range
    /// to the next.
    fn detect_by_rank(&self, image: &PolarImage, rank: usize) -> Vec<(usize, usize)> {
        let (train, guard) = self.halves();
        let reach = train + guard;
        let mut hits = Vec::new();
        if image.rows() <= 2 * reach {
            return hits;
        }
        for column in 0..image.columns {
            let cell = |row: usize| image.cells[row * image.columns + column];
            let mut training = Histogram::default();
            for row in 0..train {
                training.add(cell(row));
                training.add(cell(row + reach + guard + 1));
            }
            for row in reach..image.rows() - reach {
                if cell(row) > self.params.min_intensity {
                    let noise = f64::from(training.at_rank(rank));
                    if f64::from(cell(row)) > self.factor * noise {
                        hits.push((row, column));
                    }
                }
                if row + reach + 1 < image.rows() {
                    training.remove(cell(row - reach));
                    training.add(cell(row - guard));
                    training.remove(cell(row + guard + 1));
                    training.add(cell(row + reach + 1));
                }
            }
        }
        hits.sort_unstable();
        hits
    }
}

fn add(sums: &mut [u32], row: &[u8]) {
    for (sum, &cell) in sums.iter_mut().zip(row) {
        *sum += u32::from(cell);
    }
}

fn slide(sums: &mut [u32], enters: &[u8], leaves: &[u8]) {
    for ((sum, &enters), &leaves) in sums.iter_mut().zip(enters).zip(leaves) {
        *sum = *sum + u32::from(enters) - u32::from(leaves);
    }
}

/// Counts of intensities, with a level that remembers how many cells lie below it.
struct Histogram {
    counts: [usize; 256],
    level: u8,
    below: usize,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: [0; 256], level: 0, below: 0 }
    }
}

impl Histogram {
    fn add(&mut self, cell: u8) {
        self.counts[usize::from(cell)] += 1;
        self.below += usize::from(cell < self.level);
    }

    fn remove(&mut self, cell: u8) {
        self.counts[usize::from(cell)] -= 1;
        self.below -= usize::from(cell < self.level);
    }

    /// The intensity of the cell of this rank, counting from 1.
    fn at_rank(&mut self, rank: usize) -> u8 {
        while self.below >= rank {
            self.level -= 1;
            self.below -= self.counts[usize::from(self.level)];
        }
        while self.below + self.counts[usize::from(self.level)] < rank {
            self.below += self.counts[usize::from(self.level)];
            self.level += 1;
        }
        self.level
    }
}
