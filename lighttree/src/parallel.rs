//! One thread or many, the same bits: what the builders of this crate and of those on top of it do at the
//! same time with the feature `parallel`, and one after another without.
//!
//! Results come in the order of the work, so they depend neither on the number of threads nor on the feature,
//! as long as the closures look at nothing but what they are given.

use bytemuck::{Zeroable, zeroed_vec};

/// Items that one task of [`for_each`] handles.
const PART: usize = 1 << 10;

/// `work(memory, index, item)` for each item; `memory` is what `init` makes once for every 1024 of them.
pub fn for_each<T: Send, M>(
    items: &mut [T],
    init: impl Fn() -> M + Sync + Send,
    work: impl Fn(&mut M, usize, &mut T) + Sync + Send,
) {
    let part = |(part, items): (usize, &mut [T])| {
        let mut memory = init();
        for (offset, item) in items.iter_mut().enumerate() {
            work(&mut memory, part * PART + offset, item);
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
pub fn map<T: Send, R: Send>(tasks: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        tasks.into_par_iter().map(work).collect()
    }
    #[cfg(not(feature = "parallel"))]
    tasks.into_iter().map(work).collect()
}

/// Both closures' results.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "parallel")]
    return rayon::join(a, b);
    #[cfg(not(feature = "parallel"))]
    (a(), b())
}

/// Sorts. Items that are equal must be the same: which of them comes first is not said.
pub fn sort<T: Ord + Send>(items: &mut [T]) {
    #[cfg(feature = "parallel")]
    rayon::slice::ParallelSliceMut::par_sort_unstable(items);
    #[cfg(not(feature = "parallel"))]
    items.sort_unstable();
}

/// Makes it so long, of whatever is there and of zeros: for those who overwrite all of it. New memory comes
/// zeroed from the allocator, and is first touched by whoever fills it.
pub(crate) fn resize<T: Zeroable + Clone>(items: &mut Vec<T>, len: usize) {
    if items.capacity() < len {
        *items = zeroed_vec(len);
    } else {
        items.resize(len, T::zeroed());
    }
}

/// How many tasks keep every thread busy. Only for work whose result does not depend on how it was cut.
pub(crate) fn threads() -> usize {
    #[cfg(feature = "parallel")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "parallel"))]
    1
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_come_in_the_order_of_the_work() {
        let mut items = vec![0; 5000];
        super::for_each(&mut items, || 1, |one, i, item| *item = i + *one);
        assert!(items.iter().enumerate().all(|(i, &item)| item == i + 1));
        assert_eq!(
            super::map((0..3000).collect(), |i| 2 * i),
            (0..3000).map(|i| 2 * i).collect::<Vec<u32>>()
        );
        assert_eq!(super::join(|| 1, || "two"), (1, "two"));
        let mut items = vec![3, 1, 2];
        super::sort(&mut items);
        assert_eq!(items, [1, 2, 3]);
    }
}
