//! Problem files of pairs of object maps with their answers.

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
        let problems: Vec<Self> =
            serde_json::from_str(&text).with_context(|| format!("parsing {}", path.display()))?;
        for (k, p) in problems.iter().enumerate() {
            for [i, a] in &p.gt {
                anyhow::ensure!(
                    *i < p.map1.len() && *a < p.map2.len(),
                    "{}: problem {k} has a true pair ({i}, {a}) outside its maps",
                    path.display()
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
