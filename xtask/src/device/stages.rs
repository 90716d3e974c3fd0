//! What the stages of all frames took.

use std::time::Instant;

/// Seconds by stage, in the order in which stages were first met.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stages(Vec<(&'static str, f64)>);

impl Stages {
    /// Adds what a stage took.
    pub(crate) fn add(&mut self, name: &'static str, seconds: f64) {
        match self.0.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => *sum += seconds,
            None => self.0.push((name, seconds)),
        }
    }

    /// Runs `work` and adds what it took.
    pub(super) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let done = work();
        self.add(name, start.elapsed().as_secs_f64());
        done
    }

    /// Name and seconds of each.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.0.iter().copied()
    }
}
