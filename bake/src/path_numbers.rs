//! Which numbers paths have: those of lights that went are used again.

use std::collections::BTreeMap;

use crate::paths::MAX_PATHS;

/// Numbers that are taken are the ranges between the gaps, up to `end`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct PathNumbers {
    /// First number and length of each gap; no two touch, and none touches `end`.
    gaps: BTreeMap<u32, u32>,
    /// No number from here on was ever taken, or all that were are free.
    end: u32,
}

impl PathNumbers {
    /// The first of `count` numbers in sequence, at least one: out of the first gap that is wide enough.
    /// `None` where there are no more.
    pub(crate) fn take(&mut self, count: u32) -> Option<u32> {
        if let Some((first, length)) = self.gaps.iter().map(|(&f, &l)| (f, l)).find(|&(_, l)| l >= count) {
            self.gaps.remove(&first);
            if length > count {
                self.gaps.insert(first + count, length - count);
            }
            return Some(first);
        }
        let end = self.end.checked_add(count).filter(|&end| end <= MAX_PATHS)?;
        Some(core::mem::replace(&mut self.end, end))
    }

    /// Gives back numbers that were taken together.
    pub(crate) fn give_back(&mut self, first: u32, count: u32) {
        let (mut first, mut end) = (first, first + count);
        if let Some((&before, &length)) = self.gaps.range(..first).next_back()
            && before + length == first
        {
            self.gaps.remove(&before);
            first = before;
        }
        if let Some(length) = self.gaps.remove(&end) {
            end += length;
        }
        if end == self.end {
            self.end = first;
        } else {
            self.gaps.insert(first, end - first);
        }
    }

    /// One more than the largest number that is taken.
    pub(crate) const fn end(&self) -> u32 {
        self.end
    }

    /// Leaves no room but in gaps.
    #[cfg(test)]
    pub(crate) const fn take_all(&mut self) {
        self.end = MAX_PATHS;
    }
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    /// Against a list of who has each number; once all is given back nothing is left.
    #[test]
    fn numbers_have_one_owner_and_gaps_grow_together() {
        let mut numbers = PathNumbers::default();
        let mut random = Random::new(4, 0, 0);
        let mut taken: Vec<(u32, u32)> = Vec::new();
        let mut owned = vec![false; 100_000];
        for _ in 0..5000 {
            if taken.is_empty() || (taken.len() < 40 && random.u32().is_multiple_of(2)) {
                let count = 1 + random.u32() % 60;
                let first = numbers.take(count).unwrap();
                for number in first..first + count {
                    assert!(!core::mem::replace(&mut owned[number as usize], true), "{number} has an owner");
                }
                taken.push((first, count));
            } else {
                let (first, count) = taken.swap_remove(random.u32() as usize % taken.len());
                numbers.give_back(first, count);
                owned[first as usize..(first + count) as usize].fill(false);
            }
            let last = owned.iter().rposition(|&owned| owned).map_or(0, |last| last + 1);
            assert_eq!(numbers.end() as usize, last);
        }
        assert!(numbers.end() < 40 * 60 * 2, "{}", numbers.end());
        taken.into_iter().for_each(|(first, count)| numbers.give_back(first, count));
        assert_eq!(numbers, PathNumbers::default());
    }

    #[test]
    fn there_are_so_many_and_no_more() {
        let mut numbers = PathNumbers::default();
        assert_eq!(numbers.take(MAX_PATHS), Some(0));
        assert_eq!(numbers.take(1), None);
        numbers.give_back(0, MAX_PATHS);
        assert_eq!(numbers.take(u32::MAX), None);
        assert_eq!(numbers.take(7), Some(0));
    }
}
