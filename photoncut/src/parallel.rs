//! Two cores or one, the same bits: every split of work here depends on sizes only, and sums are taken in one order.

/// Items that one task handles.
const PART: usize = 1 << 10;

/// `work(index, item)` for each, with what `init` makes once a task.
pub(crate) fn for_each<T: Send, L>(
    items: &mut [T],
    init: impl Fn() -> L + Sync + Send,
    work: impl Fn(&mut L, usize, &mut T) + Sync + Send,
) {
    let part = |(part, items): (usize, &mut [T])| {
        let mut local = init();
        for (offset, item) in items.iter_mut().enumerate() {
            work(&mut local, part * PART + offset, item);
        }
    };
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        items.par_chunks_mut(PART).enumerate().for_each(part);
    }
    #[cfg(not(feature = "parallel"))]
    items.chunks_mut(PART).enumerate().for_each(part);
}

/// Results of `work` for every task, in the order of the tasks.
pub(crate) fn map<T: Send, R: Send>(tasks: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        tasks.into_par_iter().map(work).collect()
    }
    #[cfg(not(feature = "parallel"))]
    tasks.into_iter().map(work).collect()
}

/// Both closures' results; at the same time with feature `parallel`.
pub(crate) fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "parallel")]
    return rayon::join(a, b);
    #[cfg(not(feature = "parallel"))]
    (a(), b())
}
