use serde::{Deserialize, Serialize};

use super::Object;

/// Keeps the numbers of objects from one extraction to the next.
///
/// An extraction numbers what it finds from zero. Tracks give an object the number of the nearest object of the
/// previous extraction of about the same size, or a number never used before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectTracks {
    /// Farthest a centroid moves between two extractions, metres. Default 3, half the spacing of pilings.
    pub gate_m: f64,
    /// Extractions an object may be missing in before its number is given up. Default 5.
    pub patience: u32,
    next_id: u32,
    known: Vec<(Object, u32)>,
}

impl Default for ObjectTracks {
    fn default() -> Self {
        Self { gate_m: 3.0, patience: 5, next_id: 0, known: Vec::new() }
    }
}

impl ObjectTracks {
    /// Renumbers `found` in place. Nearest pairs are matched first; ties go to the older number.
    pub fn update(&mut self, found: &mut [Object]) {
        let mut pairs = Vec::new();
        for (old, (known, _)) in self.known.iter().enumerate() {
            for (new, object) in found.iter().enumerate() {
                let distance = (object.centroid - known.centroid).norm();
                // A cluster that joins with its neighbour or splits is another object.
                let alike = object.length < 2.0 * known.length && known.length < 2.0 * object.length;
                if distance <= self.gate_m && alike {
                    pairs.push((distance, old, new));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut number_of = vec![None; found.len()];
        let mut taken = vec![false; self.known.len()];
        for (_, old, new) in pairs {
            if !taken[old] && number_of[new].is_none() {
                taken[old] = true;
                number_of[new] = Some(self.known[old].0.id);
            }
        }
        let mut taken = taken.into_iter();
        let patience = self.patience;
        self.known.retain_mut(|(_, missed)| {
            *missed += 1;
            !taken.next().unwrap_or(false) && *missed <= patience
        });
        for (object, number) in found.iter_mut().zip(number_of) {
            object.id = number.unwrap_or(self.next_id);
            self.next_id += u32::from(number.is_none());
            self.known.push((object.clone(), 0));
        }
        self.known.sort_by_key(|(object, _)| object.id);
    }
}
