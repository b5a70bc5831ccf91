use crate::Error;

/// A row-major cost matrix, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct Costs<'a> {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) values: &'a [f64],
}

impl<'a> Costs<'a> {
    /// A view of `values[row * columns + column]`; +∞ forbids a pair.
    ///
    /// # Errors
    /// `values` is not `rows × columns` long; an entry is NaN or -∞.
    pub fn new(rows: usize, columns: usize, values: &'a [f64]) -> Result<Self, Error> {
        let expected = rows.saturating_mul(columns);
        if values.len() != expected {
            return Err(Error::WrongLength { what: "the cost matrix", expected, found: values.len() });
        }
        // One vectorised pass; the entry is looked for only if there is a bad one.
        let good = values
            .chunks(4096)
            .all(|chunk| chunk.iter().fold(true, |good, x| good & (*x > f64::NEG_INFINITY)));
        if good {
            return Ok(Self { rows, columns, values });
        }
        match values.iter().position(|x| x.is_nan() || *x == f64::NEG_INFINITY) {
            Some(k) => Err(Error::BadCost { row: k / columns, column: k % columns, value: values[k] }),
            None => Ok(Self { rows, columns, values }),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    pub(super) fn row(&self, i: usize) -> &'a [f64] {
        &self.values[i * self.columns..(i + 1) * self.columns]
    }
}
