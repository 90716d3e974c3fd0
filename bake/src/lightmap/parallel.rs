//! Loops over chunks, each task with a memory of its own: [`lighttree::parallel`], a few chunks a task.

/// Chunks of one task.
const PART: usize = 4;

/// `f(index, item, scratch)` of each item, in order.
pub(super) fn map<T: Sync, S, U: Send>(
    items: &[T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    let part = |(part, items): (usize, &[T])| -> Vec<U> {
        let mut scratch = scratch();
        items.iter().enumerate().map(|(i, item)| f(part * PART + i, item, &mut scratch)).collect()
    };
    lighttree::parallel::map(items.chunks(PART).enumerate().collect(), part).into_iter().flatten().collect()
}

/// As [`map`], for items that change.
pub(super) fn map_mut<T: Send, S, U: Send>(
    items: &mut [T],
    scratch: impl Fn() -> S + Sync + Send,
    f: impl Fn(usize, &mut T, &mut S) -> U + Sync + Send,
) -> Vec<U> {
    let part = |(part, items): (usize, &mut [T])| -> Vec<U> {
        let mut scratch = scratch();
        items.iter_mut().enumerate().map(|(i, item)| f(part * PART + i, item, &mut scratch)).collect()
    };
    lighttree::parallel::map(items.chunks_mut(PART).enumerate().collect(), part)
        .into_iter()
        .flatten()
        .collect()
}
