//! The experiments behind the figures that this crate claims, each repeatable by its name and number of seeds.
//!
//! Seeds are run on all cores; the result does not depend on how many there are. Start with [`Experiment::run`].

mod ate;
mod bias;
mod chaos;
mod dynamic;
mod figure;
mod loss;
mod maps;
mod missions;
mod overlap;
mod pairs;
mod published;
mod real;
mod registration_time;
mod scale;
mod sensitivity;
mod table;
mod traffic;

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

pub use figure::{Figure, Series};
pub use table::{Cell, Table};

use crate::error::Error;

/// What all experiments may be told.
#[derive(Clone)]
pub struct Settings<'a> {
    /// Number of seeds; `None` for what the experiment needs by itself.
    pub seeds: Option<u64>,
    /// The first seed. Default 0.
    pub first_seed: u64,
    /// Folder of recorded data, for the experiments that use some.
    pub data: Option<PathBuf>,
    /// Called when a part is done.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Settings<'_> {
    /// The seeds, `count` of them unless told otherwise.
    fn seeds_or(&self, count: u64) -> std::ops::Range<u64> {
        self.first_seed..self.first_seed + self.seeds.unwrap_or(count)
    }
}

/// What an experiment found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result.
    pub table: Table,
    /// Every single run, where the table tells means.
    pub runs: Option<Table>,
    /// The result as a picture.
    pub figure: Figure,
    /// What else there is to say, a sentence each.
    pub notes: Vec<String>,
}

type Run = fn(&Settings<'_>) -> Result<Outcome, Error>;

/// An experiment.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it asks.
    pub question: &'static str,
    run: Run,
}

impl fmt::Debug for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Experiment {
    /// All experiments.
    pub const ALL: &'static [Experiment] = &[
        Experiment {
            name: "ate",
            question: "error of each robot by consistency test and optimisation",
            run: ate::run,
        },
        Experiment {
            name: "published",
            question: "the published system with each consistency test, ours beside",
            run: published::run,
        },
        Experiment {
            name: "loss",
            question: "what losses, disorder and outages of the link cost",
            run: loss::run,
        },
        Experiment {
            name: "traffic",
            question: "bits by type of message; updates against whole maps",
            run: traffic::run,
        },
        Experiment {
            name: "bias",
            question: "biased groups of closures that each consistency test accepts",
            run: bias::run,
        },
        Experiment {
            name: "scale",
            question: "time, bits and memory of a robot by the size of its team",
            run: scale::run,
        },
        Experiment {
            name: "chaos",
            question: "whether anything breaks when everything goes wrong",
            run: chaos::run,
        },
        Experiment {
            name: "overlap",
            question: "right closures and precision by the gate, DRACo1 beside",
            run: overlap::run,
        },
        Experiment {
            name: "registration-time",
            question: "time of a local registration and of DRACo1's global one",
            run: registration_time::run,
        },
        Experiment { name: "dynamic", question: "missions among moving objects", run: dynamic::run },
        Experiment {
            name: "sensitivity",
            question: "a recorded mission with every default halved and doubled, and with yaw drift; needs --data",
            run: sensitivity::run,
        },
        Experiment { name: "real", question: "recorded missions; needs --data", run: real::run },
    ];

    /// Runs it.
    ///
    /// # Errors
    /// Those of the missions it runs, and [`Error::Io`] for data it cannot find.
    pub fn run(&self, settings: &Settings<'_>) -> Result<Outcome, Error> {
        (self.run)(settings)
    }
}

impl FromStr for Experiment {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let names = || Self::ALL.iter().map(|e| e.name).collect::<Vec<_>>().join(", ");
        let found = Self::ALL.iter().find(|experiment| experiment.name == name);
        found.copied().ok_or_else(|| format!("there is no experiment `{name}`; there are {}", names()))
    }
}

impl Outcome {
    /// Table and notes for a terminal.
    pub fn text(&self) -> String {
        let notes = self.notes.iter().map(|note| format!("{note}\n"));
        self.table.text() + &notes.collect::<String>()
    }

    /// Writes `<name>.csv`, `<name>.json`, `<name>.svg` and, where there are single runs, `<name>_runs.csv` into `dir`,
    /// which is made if need be.
    ///
    /// # Errors
    /// [`Error::Io`] with the file that cannot be written.
    pub fn write(&self, name: &str, dir: &Path) -> Result<(), Error> {
        fs::create_dir_all(dir).map_err(|source| Error::io(dir, source))?;
        let runs = self.runs.as_ref().map(Table::json);
        let json = serde_json::json!({
            "experiment": name, "rows": self.table.json(), "runs": runs, "notes": self.notes,
        });
        let mut files = vec![
            (format!("{name}.csv"), self.table.csv()),
            (format!("{name}.json"), format!("{json:#}\n")),
            (format!("{name}.svg"), self.figure.svg()),
        ];
        files.extend(self.runs.as_ref().map(|runs| (format!("{name}_runs.csv"), runs.csv())));
        for (file, text) in files {
            let path = dir.join(file);
            fs::write(&path, text).map_err(|source| Error::io(&path, source))?;
        }
        Ok(())
    }
}
