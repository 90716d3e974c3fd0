//! How far long work is: a bar where a person watches, plain lines where a log is kept. Always on standard
//! error.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Plain lines come no closer together than this.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);

/// Shows how far a renderer is, and passes Ctrl-C on to it.
pub(crate) struct Watched {
    what: String,
    bar: ProgressBar,
    /// When a plain line was last written; `None` on a terminal.
    last_said: Option<Mutex<Instant>>,
}

impl Watched {
    /// Work called `what`, none of it done.
    pub(crate) fn new(what: &str) -> Self {
        let on_terminal = std::io::stderr().is_terminal();
        let bar = if on_terminal { ProgressBar::new(1) } else { ProgressBar::hidden() };
        let style =
            ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %  {elapsed} elapsed, {eta} to go");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_message(what.to_owned());
        Self { what: what.to_owned(), bar, last_said: (!on_terminal).then(|| Mutex::new(Instant::now())) }
    }
}

impl scene::Progress for Watched {
    fn report(&self, done: usize, total: usize) {
        let (done, total) = (done as u64, total as u64);
        let Some(last_said) = &self.last_said else {
            // Threads report out of order; the bar never goes back.
            self.bar.set_length(total);
            return self.bar.set_position(done.max(self.bar.position()));
        };
        let mut last_said = last_said.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if last_said.elapsed() >= PLAIN_INTERVAL {
            *last_said = Instant::now();
            eprintln!("{}: {} %", self.what, 100 * done / total.max(1));
        }
    }

    fn cancelled(&self) -> bool {
        crate::stop::asked()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
