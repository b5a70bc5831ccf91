use std::fmt::Write;

use serde_json::{Map, Value};

/// One cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A word.
    Text(String),
    /// A measured number and the decimals it is shown with.
    Number(f64, usize),
    /// Something counted.
    Count(u64),
    /// Nothing to tell.
    Empty,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Cell::Count(count as u64)
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        Cell::Count(count)
    }
}

impl Cell {
    /// A number shown with so many decimals; `None` makes an empty cell.
    pub fn number(value: impl Into<Option<f64>>, decimals: usize) -> Self {
        value.into().filter(|v| v.is_finite()).map_or(Cell::Empty, |value| Cell::Number(value, decimals))
    }

    /// A share shown in percent with one decimal.
    pub fn percent(share: impl Into<Option<f64>>) -> Self {
        Cell::number(share.into().map(|share| 100.0 * share), 1)
    }

    fn shown(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Number(value, decimals) => format!("{value:.decimals$}"),
            Cell::Count(count) => count.to_string(),
            Cell::Empty => "-".into(),
        }
    }

    fn json(&self) -> Value {
        match self {
            Cell::Text(text) => text.clone().into(),
            Cell::Number(value, _) => (*value).into(),
            Cell::Count(count) => (*count).into(),
            Cell::Empty => Value::Null,
        }
    }
}

/// Rows under named columns: printed, as CSV and as JSON the same numbers, the files with all digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// An empty table.
    pub fn new<'a>(columns: impl IntoIterator<Item = &'a str>) -> Self {
        Table { columns: columns.into_iter().map(str::to_owned).collect(), rows: Vec::new() }
    }

    /// Adds a row; cells that are missing are empty, too many are cut.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        let mut row: Vec<Cell> = row.into_iter().collect();
        row.resize(self.columns.len(), Cell::Empty);
        self.rows.push(row);
    }

    /// The names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The rows.
    pub fn rows(&self) -> &[Vec<Cell>] {
        &self.rows
    }

    /// For a terminal: words flush left, numbers flush right.
    pub fn text(&self) -> String {
        let shown: Vec<Vec<String>> =
            self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()).collect();
        let width = |column: usize| {
            let cells = shown.iter().map(|row| row[column].chars().count());
            cells.chain([self.columns[column].chars().count()]).max().unwrap_or(0)
        };
        let is_text = |column: usize| self.rows.iter().any(|row| matches!(row[column], Cell::Text(_)));
        let line = |cells: &[String]| {
            let mut line = String::new();
            for (column, cell) in cells.iter().enumerate() {
                let (gap, width) = (if column == 0 { "" } else { "  " }, width(column));
                let _ = if is_text(column) {
                    write!(line, "{gap}{cell:<width$}")
                } else {
                    write!(line, "{gap}{cell:>width$}")
                };
            }
            line.trim_end().to_owned() + "\n"
        };
        line(&self.columns) + &shown.iter().map(|row| line(row)).collect::<String>()
    }

    /// As CSV with a header.
    pub fn csv(&self) -> String {
        let quoted = |text: String| {
            if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
        };
        let cell = |cell: &Cell| match cell {
            Cell::Number(value, _) => value.to_string(),
            Cell::Empty => String::new(),
            other => quoted(other.shown()),
        };
        let header = self.columns.iter().cloned().map(quoted).collect::<Vec<_>>().join(",");
        let rows = self.rows.iter().map(|row| row.iter().map(cell).collect::<Vec<_>>().join(",") + "\n");
        header + "\n" + &rows.collect::<String>()
    }

    /// As a list of objects, one a row.
    pub fn json(&self) -> Value {
        let object = |row: &Vec<Cell>| {
            let pairs = self.columns.iter().cloned().zip(row.iter().map(Cell::json));
            Value::Object(pairs.collect::<Map<_, _>>())
        };
        self.rows.iter().map(object).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_table_in_three_forms() {
        let mut table = Table::new(["method", "ATE m", "n"]);
        table.push(["gcm, ours".into(), Cell::number(0.30612, 2), 7usize.into()]);
        table.push(["pcm".into(), Cell::number(f64::NAN, 2)]);
        assert_eq!(table.text(), "method     ATE m  n\ngcm, ours   0.31  7\npcm            -  -\n");
        assert_eq!(table.csv(), "method,ATE m,n\n\"gcm, ours\",0.30612,7\npcm,,\n");
        assert_eq!(table.json()[0]["ATE m"], 0.30612);
        assert!(table.json()[1]["n"].is_null());
    }
}
