//! Updates at work: into the sums piece by piece, and before readers as a whole.

use std::sync::Arc;

use super::fixed_point::FixedPointCounts;
use super::gather::{Gather, Scratch};
use super::parallel;
use super::receivers::LightmapRays;
use super::store::{Lightmap, LightmapError};
use crate::{Bounds, Contribution, Update};

/// Chunks between two looks at the clock.
const BATCH: usize = 64;

/// An update under way: it is in the sums of the first chunks.
pub(super) struct Job {
    update: Update,
    /// Of each pass, boxes around what differs between its versions.
    moved: Vec<Vec<Bounds>>,
    next: usize,
    touched: Vec<bool>,
}

/// What readers see: the light of every texel after a whole number of updates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
    /// Updates that it holds.
    pub updates: u64,
    /// Values by texel: three of irradiance, W·m⁻², or twelve of radiance in spherical harmonics (coefficient
    /// by coefficient, RGB each, W·m⁻²·sr⁻¹).
    pub values: Vec<f32>,
}

/// Whether there is more to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Nothing is under way; readers see every update.
    Done,
    /// An update is in the sums in part; readers see none of it.
    UnderWay,
}

impl<R: LightmapRays> Lightmap<R> {
    /// Begins an update. [`work`](Self::work) carries it out.
    ///
    /// # Errors
    /// An update under way, or a version that isn't held.
    pub fn begin(&mut self, update: Update) -> Result<(), LightmapError> {
        self.check(&update)?;
        let touched = vec![false; self.chunks.len()];
        let objects = |side: Option<&Contribution>| Some(&self.versions.get(&side?.version)?.objects);
        let passes = update.passes();
        let moved = passes.iter().map(|pass| match (objects(pass.subtract), objects(pass.add)) {
            (Some(before), Some(after)) => self.moved(before, after),
            _ => Vec::new(),
        });
        let moved = moved.collect();
        drop(passes);
        self.job = Some(Job { update, moved, next: 0, touched });
        Ok(())
    }

    fn check(&self, update: &Update) -> Result<(), LightmapError> {
        if self.job.is_some() {
            return Err(LightmapError::Busy);
        }
        let all = update.subtract.iter().chain(&update.add);
        match all.map(|c| c.version).find(|version| !self.versions.contains_key(version)) {
            Some(version) => Err(LightmapError::Version { version }),
            None => Ok(()),
        }
    }

    /// Works on the update under way for as long as `keep_going` says so, asked every few thousand texels; at
    /// least that much is done. Readers see the update when all of it is done, and nothing of it before.
    pub fn work(&mut self, mut keep_going: impl FnMut() -> bool) -> Work {
        let Some(mut job) = self.job.take() else { return Work::Done };
        while job.next < self.chunks.len() {
            let batch = job.next..(job.next + BATCH).min(self.chunks.len());
            self.accumulate(&mut job, batch.clone());
            job.next = batch.end;
            if job.next < self.chunks.len() && !keep_going() {
                self.job = Some(job);
                return Work::UnderWay;
            }
        }
        self.note(&job.update);
        self.publish(&job.touched);
        Work::Done
    }

    /// [`begin`](Self::begin) and [`work`](Self::work) to the end.
    ///
    /// # Errors
    /// As [`begin`](Self::begin).
    pub fn apply(&mut self, update: &Update) -> Result<(), LightmapError> {
        self.begin(update.clone())?;
        self.work(|| true);
        Ok(())
    }

    /// Counts contributions, and lets versions go that none names any more.
    fn note(&mut self, update: &Update) {
        for contribution in &update.add {
            if let Some(version) = self.versions.get_mut(&contribution.version) {
                version.live += 1;
            }
        }
        for contribution in &update.subtract {
            if let Some(version) = self.versions.get_mut(&contribution.version) {
                version.live = version.live.saturating_sub(1);
            }
        }
        self.updates += 1;
        self.accumulations += update.accumulations() as u64;
        self.let_go();
    }

    fn let_go(&mut self) {
        let current = self.current;
        self.versions.retain(|&version, state| state.live > 0 || Some(version) == current);
    }

    /// All contributions of the job into a range of chunks.
    fn accumulate(&mut self, job: &mut Job, batch: core::ops::Range<usize>) {
        let gather = Gather {
            versions: &self.versions,
            samples: self.samples as usize,
            fixed: self.fixed,
            directional: self.directional,
        };
        let sums = &mut self.sums[batch.clone()];
        let places = &self.chunks[batch.clone()];
        let passes = job.update.passes();
        let done = parallel::map_mut(sums, Scratch::<R>::default, |i, sums, scratch| {
            let (index, place) = (batch.start + i, places[i]);
            let mut counts = FixedPointCounts::default();
            let mut touched = false;
            for (pass, moved) in passes.iter().zip(&job.moved) {
                touched |= gather.pass(pass, moved, index, place, sums, scratch, &mut counts);
            }
            (touched, counts)
        });
        for (index, (touched, counts)) in batch.zip(done) {
            job.touched[index] = touched;
            self.counts += counts;
        }
    }

    /// Shows readers the sums of the chunks that changed.
    fn publish(&mut self, touched: &[bool]) {
        // In place where nobody looks; a reader that still does keeps what it has.
        if Arc::get_mut(&mut self.front).is_none() {
            self.front = Arc::new(Published::clone(&self.front));
        }
        let channels = self.channels();
        let (fixed, updates) = (self.fixed, self.updates);
        let Some(front) = Arc::get_mut(&mut self.front) else { unreachable!("nobody else has it yet") };
        front.updates = updates;
        for ((place, sums), _) in
            self.chunks.iter().zip(&self.sums).zip(touched).filter(|(_, touched)| **touched)
        {
            let texels = place.texels();
            let values = &mut front.values[texels.start * channels..texels.end * channels];
            for (value, &sum) in values.iter_mut().zip(sums) {
                *value = fixed.value(sum) as f32;
            }
        }
    }
}
