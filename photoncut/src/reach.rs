//! Which samples of a cut reach a place: space parted into cells, with a list of samples for each.
//!
//! Wang et al. 2009 descend the tree above the cut, whose boxes overlap as far as samples reach: among clutter
//! a look-up then visits hundreds of nodes. Here cells are disjoint, so that a look-up goes down one way, and
//! a sample is in the list of every cell that its ball touches.

use glam::Vec3;
use lighttree::parallel;

use crate::CutSample;

/// Lists of as many are not parted.
const SHORT: usize = 6;

/// Both parts of a list together may be as many times longer than it is: with twice, nothing is gained.
const MOST_TWICE: f32 = 1.7;

/// Entries of all lists for each sample, at most.
const ENTRIES: usize = 24;

/// Cells with fewer samples are parted by one thread.
const SERIAL: usize = 1 << 12;

/// `Cell::kind` of a cell that is not parted, with no sample in its list.
const LEAF: u32 = 3;

/// 12 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    /// Where it is parted.
    at: f32,
    /// The first of a pair of parts, that below `at`; or where the list begins.
    first: u32,
    /// The axis across which it is parted; or [`LEAF`] and more by the length of the list.
    kind: u32,
}

/// Lists of the samples that reach into each part of space. At most 24 entries of 4 bytes a sample, and fewer
/// cells of 12 bytes than entries; 50 to 95 bytes in rooms.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Reach {
    /// The first is all of space.
    cells: Vec<Cell>,
    lists: Vec<u32>,
}

impl Reach {
    /// In balls of each sample's radius around it; those whose squared radius is 0 or infinite weigh nothing
    /// anywhere.
    pub(crate) fn new(samples: &[CutSample]) -> Self {
        let weighs = |s: &CutSample| s.radius * s.radius > 0.0 && (s.radius * s.radius).is_finite();
        let list: Vec<u32> = (0..).zip(samples).filter(|(_, s)| weighs(s)).map(|(i, _)| i).collect();
        let budget = ENTRIES * list.len();
        part(samples, Bounds::EVERYWHERE, list, budget)
    }

    /// Those that may reach `point`, in ascending order, among others that do not.
    #[inline]
    pub(crate) fn around(&self, point: Vec3) -> &[u32] {
        let point = [point.x, point.y, point.z, 0.0];
        let Some(mut cell) = self.cells.first() else { return &[] };
        while cell.kind < LEAF {
            let above = u32::from(point[(cell.kind & 3) as usize] >= cell.at);
            cell = &self.cells[(cell.first + above) as usize];
        }
        &self.lists[cell.first as usize..(cell.first + cell.kind - LEAF) as usize]
    }

    /// Memory.
    pub(crate) fn bytes(&self) -> usize {
        self.cells.len() * size_of::<Cell>() + self.lists.len() * size_of::<u32>()
    }

    /// Puts another one's cells and lists behind its own, all but the first cell, which it returns.
    fn append(&mut self, other: Self) -> Cell {
        // The first of the other's cells does not come along.
        let (cells, lists) = (self.cells.len() as u32 - 1, self.lists.len() as u32);
        let moved =
            |cell: Cell| Cell { first: cell.first + if cell.kind < LEAF { cells } else { lists }, ..cell };
        self.lists.extend(other.lists);
        self.cells.extend(other.cells[1..].iter().copied().map(moved));
        moved(other.cells[0])
    }
}

/// A box.
#[derive(Clone, Copy)]
struct Bounds {
    min: Vec3,
    max: Vec3,
}

impl Bounds {
    const EVERYWHERE: Self = Self { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };

    /// What `list` reaches of it: outside of that a list is as good as any other.
    fn shrunk(self, samples: &[CutSample], list: &[u32]) -> Self {
        let (min, max) = list
            .iter()
            .map(|&i| &samples[i as usize])
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), s| {
                (min.min(s.position - s.radius), max.max(s.position + s.radius))
            });
        Self { min: self.min.max(min), max: self.max.min(max) }
    }

    /// Whether a sample's ball touches it.
    #[inline]
    fn is_reached(&self, sample: &CutSample) -> bool {
        // Rounded up: by more than a look-up's sums are rounded down.
        const SLACK: f32 = 1.0 + 1e-5;
        let way = (self.min - sample.position).max(sample.position - self.max).max(Vec3::ZERO);
        way.length_squared() <= SLACK * sample.radius * sample.radius
    }

    /// Below and above `at` across an axis.
    fn halves(self, axis: usize, at: f32) -> [Self; 2] {
        let (mut below, mut above) = (self, self);
        below.max[axis] = at;
        above.min[axis] = at;
        [below, above]
    }
}

/// The cells within `bounds`, the whole first, with no more than `budget` entries in all unless `list` is longer.
fn part(samples: &[CutSample], bounds: Bounds, list: Vec<u32>, budget: usize) -> Reach {
    let bounds = bounds.shrunk(samples, &list);
    let parted = if list.len() <= SHORT { None } else { best_halves(samples, bounds, &list) };
    let Some((axis, at, [below, above])) = parted.filter(|(.., halves)| {
        let both = halves[0].len() + halves[1].len();
        both <= budget && both as f32 <= MOST_TWICE * list.len() as f32
    }) else {
        let leaf = Cell { at: 0.0, first: 0, kind: LEAF + list.len() as u32 };
        return Reach { cells: vec![leaf], lists: list };
    };
    let [lower, upper] = bounds.halves(axis, at);
    let all = below.len() + above.len();
    let own = (budget as u64 * below.len() as u64 / all.max(1) as u64) as usize;
    let is_large = list.len() > SERIAL;
    drop(list);
    let left = || part(samples, lower, below, own);
    let right = || part(samples, upper, above, budget - own);
    let (left, right) = if is_large { parallel::join(left, right) } else { (left(), right()) };

    let blank = Cell { at, first: 1, kind: axis as u32 };
    let mut whole = Reach { cells: vec![blank; 3], lists: Vec::new() };
    whole.cells[1] = whole.append(left);
    whole.cells[2] = whole.append(right);
    whole
}

/// The middle across the axis that leaves the shortest lists, and these; `None` where there is no middle.
fn best_halves(samples: &[CutSample], bounds: Bounds, list: &[u32]) -> Option<(usize, f32, [Vec<u32>; 2])> {
    let side = bounds.max - bounds.min;
    let mut best: Option<(usize, f32, usize)> = None;
    for axis in 0..3 {
        let at = 0.5 * bounds.min[axis] + 0.5 * bounds.max[axis];
        if !(bounds.min[axis] < at && at < bounds.max[axis]) {
            continue;
        }
        let halves = bounds.halves(axis, at);
        let reached = |half: &Bounds| list.iter().filter(|&&i| half.is_reached(&samples[i as usize])).count();
        let entries = halves.iter().map(reached).sum();
        if best.is_none_or(|(other, _, least)| (entries, side[other]) < (least, side[axis])) {
            best = Some((axis, at, entries));
        }
    }
    let (axis, at, _) = best?;
    let parts = bounds
        .halves(axis, at)
        .map(|half| list.iter().copied().filter(|&i| half.is_reached(&samples[i as usize])).collect());
    Some((axis, at, parts))
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    fn sample(position: Vec3, radius: f32) -> CutSample {
        CutSample { position, radius, say: 1.0, normal: Vec3::Y, irradiance: Vec3::ONE }
    }

    /// Everybody who reaches a place is in its list, few others are, and memory is as stated.
    #[test]
    fn nobody_is_missed() {
        let mut random = Random::new(4, 0, 0);
        let mut any = || Vec3::new(random.f32(), random.f32(), random.f32());
        let radius = |x: f32| 0.002 * 100f32.powf(x * x);
        let mut samples: Vec<_> = (0..5000)
            .map(|i| {
                let at = any();
                // On walls, in clumps, and all in one place.
                let position = match i % 8 {
                    0 => at,
                    1 => Vec3::splat(0.25) + 1e-3 * at,
                    2 => Vec3::splat(0.75),
                    _ => at.with_y(0.5),
                };
                sample(position, radius(any().x))
            })
            .collect();
        samples[17].radius = 0.0;
        samples[18] = sample(Vec3::splat(0.5), f32::INFINITY);
        samples[19] = sample(Vec3::splat(1e30), 1e15);
        let reach = Reach::new(&samples);
        assert!(reach.lists.len() <= ENTRIES * samples.len() && reach.cells.len() <= reach.lists.len());
        let (mut listed, mut reaching) = (0, 0);
        for i in 0..4000 {
            let point = match i % 4 {
                0 => 3.0 * any() - 1.0,
                1 => Vec3::splat(0.25) + 1e-3 * any(),
                2 => samples[i].position,
                _ => any().with_y(0.5),
            };
            let list = reach.around(point);
            assert!(list.is_sorted() && !list.iter().any(|i| [17, 18].contains(i)));
            let reaches = |s: &CutSample| s.position.distance_squared(point) <= s.radius * s.radius;
            for (k, s) in (0..).zip(&samples).filter(|(k, s)| ![17, 18].contains(k) && reaches(s)) {
                assert!(
                    list.binary_search(&k).is_ok(),
                    "{point} lies {} from {k}",
                    s.position.distance(point)
                );
                reaching += usize::from(i % 4 == 3);
            }
            listed += if i % 4 == 3 { list.len() } else { 0 };
        }
        assert!(listed < 2 * reaching, "{listed} listed for {reaching}");
        assert!(Reach::new(&[]).around(Vec3::ZERO).is_empty());
        assert!(reach.around(Vec3::NAN).len() < samples.len());
    }

    /// The parts of large lists are made by other threads, and are the same.
    #[test]
    fn cells_are_where_they_were_on_one_thread() {
        let mut random = Random::new(1, 0, 0);
        let samples: Vec<_> =
            (0..3 * SERIAL).map(|_| sample(Vec3::new(random.f32(), 0.0, random.f32()), 0.01)).collect();
        let on = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let [one, four] = [1, 4].map(|threads| on(threads).install(|| Reach::new(&samples)));
        assert_eq!(one, four);
        assert!(one.cells.len() > 1000);
    }
}
