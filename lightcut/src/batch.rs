//! Many receivers at once.

use lighttree::{LightHierarchy, LightId, NodeBound};

use crate::{Lightcut, Lit, Scratch, Transfer};

impl<T: LightHierarchy + Sync> Lightcut<'_, T> {
    /// [`shade`](Self::shade) for each receiver; on all threads of the current rayon pool with the feature
    /// `parallel`, with the same bits for any number of them.
    ///
    /// `local` makes what one thread keeps between receivers (traversal stacks, counters), and `transfer`
    /// gets it, the receiver and a light. Keep receivers in image order, tile by tile: neighbours then find
    /// the same nodes in cache.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn shade_each<R: Sync, B: NodeBound<R> + Sync, L>(
        &self,
        receivers: &[R],
        bound: &B,
        local: impl Fn() -> L + Sync,
        transfer: impl Fn(&mut L, &R, LightId) -> Transfer + Sync,
        out: &mut [Lit],
    ) {
        assert_eq!(receivers.len(), out.len(), "one result per receiver");
        let one = |(scratch, local): &mut (Scratch, L), receiver: &R, out: &mut Lit| {
            *out = self.shade(receiver, bound, |light| transfer(local, receiver, light), scratch);
        };
        #[cfg(feature = "parallel")]
        {
            use rayon::prelude::*;
            let init = || (Scratch::default(), local());
            receivers
                .par_iter()
                .with_min_len(16)
                .zip(out.par_iter_mut())
                .for_each_init(init, |kept, (receiver, out)| one(kept, receiver, out));
        }
        #[cfg(not(feature = "parallel"))]
        {
            let mut kept = (Scratch::default(), local());
            receivers.iter().zip(out).for_each(|(receiver, out)| one(&mut kept, receiver, out));
        }
    }
}
