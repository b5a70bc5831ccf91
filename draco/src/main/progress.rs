//! How far a mission is, on stderr: a bar on a terminal, a line now and then elsewhere.

use std::time::{Duration, Instant};

use draco::mission::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Time between two lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

pub(crate) struct Teller {
    bar: ProgressBar,
    /// Steps with keyframes.
    steps: u64,
    begun: Instant,
    told: Instant,
    /// Steps that were done before this process began.
    before: Option<u64>,
}

impl Teller {
    pub(crate) fn new(steps: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        let template = "{bar:32} step {pos}/{len}, {elapsed} of {duration}  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Teller { bar, steps, begun: Instant::now(), told: Instant::now(), before: None }
    }

    pub(crate) fn tell(&mut self, progress: Progress) {
        let before = *self.before.get_or_insert_with(|| {
            self.bar.set_position(progress.done.saturating_sub(1));
            self.bar.reset_eta();
            progress.done.saturating_sub(1)
        });
        self.bar.set_position(progress.done.min(self.steps));
        if self.bar.is_hidden() && self.told.elapsed() >= LINE_EVERY {
            self.told = Instant::now();
            let seconds = self.begun.elapsed().as_secs_f64();
            let left = self.steps.saturating_sub(progress.done) as f64;
            let left = seconds * left / progress.done.saturating_sub(before).max(1) as f64;
            eprintln!(
                "step {} of {}, {seconds:.0} s, about {left:.0} s left: {}",
                progress.done.min(self.steps),
                self.steps,
                progress.message
            );
        }
        self.bar.set_message(progress.message);
    }

    pub(crate) fn end(self) {
        self.bar.finish_and_clear();
    }
}
