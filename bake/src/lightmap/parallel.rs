//! Loops over chunks, on the caller's rayon pool where the feature is on. No result depends on it.

/// `f(index, item, scratch)` of each item, in order.
#[cfg(feature = "parallel")]
pub(super) fn map<T: Sync, S, U: Send>(
    items: &[T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    use rayon::prelude::*;
    items.par_iter().enumerate().with_min_len(4).map_init(scratch, |s, (i, item)| f(i, item, s)).collect()
}

/// `f(index, item, scratch)` of each item, in order.
#[cfg(not(feature = "parallel"))]
pub(super) fn map<T: Sync, S, U: Send>(
    items: &[T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    let mut scratch = scratch();
    items.iter().enumerate().map(|(i, item)| f(i, item, &mut scratch)).collect()
}

/// As [`map`], for items that change.
#[cfg(feature = "parallel")]
pub(super) fn map_mut<T: Send, S, U: Send>(
    items: &mut [T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &mut T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    use rayon::prelude::*;
    items.par_iter_mut().enumerate().with_min_len(4).map_init(scratch, |s, (i, item)| f(i, item, s)).collect()
}

/// As [`map`], for items that change.
#[cfg(not(feature = "parallel"))]
pub(super) fn map_mut<T: Send, S, U: Send>(
    items: &mut [T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &mut T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    let mut scratch = scratch();
    items.iter_mut().enumerate().map(|(i, item)| f(i, item, &mut scratch)).collect()
}
