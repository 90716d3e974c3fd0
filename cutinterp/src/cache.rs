//! Merged cuts that were needed a moment ago.

use crate::MergedCuts;

/// Remembers the merged cuts of the last sets of records, with what a host computed for them: neighbouring
/// receivers share them.
///
/// One for each thread. It says only what need not be done again and never changes a result. Slots are found
/// by the records' ids and overwritten by what comes later; their memory is kept, so that nothing is
/// allocated once all have grown.
///
/// Memory: the merged cuts of as many sets as there are slots, see [`MergedCuts`].
#[derive(Debug)]
pub struct MergeCache<H> {
    slots: Vec<Slot<H>>,
    /// Sets that were looked for and not found.
    misses: u64,
}

#[derive(Debug, Default)]
struct Slot<H> {
    ids: [u32; 3],
    len: usize,
    merged: MergedCuts,
    host: H,
}

impl<H: Default> MergeCache<H> {
    /// A cache of `slots` sets, at least one.
    pub fn new(slots: usize) -> Self {
        let slots = core::iter::repeat_with(Slot::default).take(slots.max(1)).collect();
        Self { slots, misses: 0 }
    }

    /// The merged cuts of these records, at most three, in this order; `fill` makes them if they are not
    /// there.
    ///
    /// # Panics
    /// With no record, or more than three.
    pub fn get(&mut self, ids: &[u32], fill: impl FnOnce(&mut MergedCuts, &mut H)) -> (&MergedCuts, &mut H) {
        assert!((1..=3).contains(&ids.len()), "one to three records");
        // Fibonacci hashing, one step an id.
        let hash = ids.iter().fold(0u64, |hash, &id| {
            (hash.rotate_left(23) ^ u64::from(id)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        let count = self.slots.len() as u64;
        let slot = &mut self.slots[((hash >> 32) % count) as usize];
        if &slot.ids[..slot.len] != ids {
            self.misses += 1;
            slot.len = ids.len();
            slot.ids[..ids.len()].copy_from_slice(ids);
            fill(&mut slot.merged, &mut slot.host);
        }
        (&slot.merged, &mut slot.host)
    }

    /// Bytes held, without what hosts keep.
    pub fn bytes(&self) -> usize {
        let merged: usize = self.slots.iter().map(|slot| slot.merged.bytes()).sum();
        merged + self.slots.capacity() * size_of::<Slot<H>>()
    }

    /// How often `fill` was called.
    pub fn misses(&self) -> u64 {
        self.misses
    }
}
