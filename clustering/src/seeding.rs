//! Seeds where geometry varies, by a quadtree of the screen or an octree of space.
//!
//! Wang et al. 2009, section 3.2, "Adaptive Seeding of Sample Points". A node's variation is the sum of its
//! members' errors against its own mean; seeds are passed down in proportion. Both trees are ranges of one
//! order along a Morton curve, so no node is ever stored.

use core::ops::Range;

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{parallel, spread_21};

use crate::{ClusterError, Metric, OrientedPoint, budget, metric};

/// What tells which points are neighbours before there are clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seeding<'a> {
    /// Their pixels, row by row; any number of points to a pixel. As in the paper: what is small on the
    /// screen gets few seeds.
    Screen {
        /// Of the screen, in pixels, from 1 to 65,536.
        width: u32,
        /// One for each point.
        pixels: &'a [u32],
    },
    /// Their places: seeds do not depend on any view.
    Octree,
}

/// A range of the order shorter than this is not worth a second thread.
const SERIAL: usize = 1 << 13;

impl Seeding<'_> {
    /// Refuses a screen that is none.
    pub(crate) fn check(&self, points: usize) -> Result<(), ClusterError> {
        if let Self::Screen { width, pixels } = *self {
            if pixels.len() != points {
                return Err(ClusterError::PixelCount { points, pixels: pixels.len() });
            }
            let fits = |&pixel: &u32| pixel / width < 1 << 16;
            if width == 0 || width > 1 << 16 || !pixels.iter().all(fits) {
                return Err(ClusterError::Screen { width });
            }
        }
        Ok(())
    }

    /// `count` of the points, all different, in the order of the curve. There must be as many points.
    pub(crate) fn seeds(&self, points: &[OrientedPoint], metric: &Metric, count: u32, seed: u32) -> Vec<u32> {
        self.plant(points, Variation::Errors(metric), count, seed)
    }

    fn plant(&self, points: &[OrientedPoint], variation: Variation<'_>, count: u32, seed: u32) -> Vec<u32> {
        let (mut order, bits, levels) = match *self {
            Self::Screen { width, pixels } => {
                let key =
                    |i: usize| u64::from(spread_16(pixels[i] % width) | spread_16(pixels[i] / width) << 1);
                (keyed(points.len(), key), 2, 16)
            }
            Self::Octree => (keyed(points.len(), octree_keys(points)), 3, 21),
        };
        parallel::sort(&mut order);
        let tree = RangeTree { points, variation, order: &order, bits, seed };
        let mut seeds = Vec::with_capacity(count as usize);
        tree.plant(0..order.len(), levels, count, &mut seeds);
        seeds
    }

    /// `count` of the points, or all where those are fewer, all different, in the order of the curve: where
    /// `weights` are large, one weight for each point. The tree that spreads seeds by what geometry says
    /// spreads them here by what is known better, say by how badly interpolated light may be; a node that
    /// gets one seed gives it to the point that weighs most.
    ///
    /// # Errors
    /// Pixels or weights that are not as many as the points, a screen that is none; the first weight that is
    /// negative, NaN or infinite.
    pub fn weighted(
        &self,
        points: &[OrientedPoint],
        weights: &[f32],
        count: u32,
    ) -> Result<Vec<u32>, ClusterError> {
        metric::check(points)?;
        self.check(points.len())?;
        if weights.len() != points.len() {
            return Err(ClusterError::WeightCount { points: points.len(), weights: weights.len() });
        }
        if let Some(index) = weights.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
            return Err(ClusterError::BadWeight { index });
        }
        let count = count.min(points.len() as u32);
        Ok(self.plant(points, Variation::Weights(weights), count, 0))
    }
}

/// Keys with the indices of their points.
fn keyed(count: usize, key: impl Fn(usize) -> u64 + Sync + Send) -> Vec<(u64, u32)> {
    let mut order = vec![(0, 0); count];
    parallel::for_each(&mut order, || (), |(), i, entry| *entry = (key(i), i as u32));
    order
}

/// Cells of 2⁻²¹ of the points' longest extent, along a Morton curve.
fn octree_keys(points: &[OrientedPoint]) -> impl Fn(usize) -> u64 + Sync + Send + '_ {
    let (min, max) = points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), point| {
        (min.min(point.position), max.max(point.position))
    });
    let extent = f64::from((max - min).max_element());
    let scale = if extent > 0.0 { f64::from(1 << 21) / extent } else { 0.0 };
    move |i| {
        let cell = (points[i].position.as_dvec3() - min.as_dvec3()) * scale;
        let [x, y, z] = cell.to_array().map(|c| spread_21((c as u32).min((1 << 21) - 1)));
        x | y << 1 | z << 2
    }
}

/// What says how many seeds a node is worth.
#[derive(Clone, Copy, Debug)]
enum Variation<'a> {
    /// Sum of its members' errors against their mean.
    Errors(&'a Metric),
    /// Sum of these.
    Weights(&'a [f32]),
}

/// A quadtree or octree: a node is a range of the order whose keys agree above `bits * level`.
struct RangeTree<'a> {
    points: &'a [OrientedPoint],
    variation: Variation<'a>,
    order: &'a [(u64, u32)],
    /// 2 or 3: bits of a key that a level looks at.
    bits: u32,
    seed: u32,
}

impl RangeTree<'_> {
    /// Plants `count` seeds in `node`, which has as many points or more. `level` levels are left below it.
    fn plant(&self, node: Range<usize>, level: u32, count: u32, seeds: &mut Vec<u32>) {
        match count {
            0 => {}
            _ if count as usize == node.len() => seeds.extend(self.order[node].iter().map(|&(_, i)| i)),
            1 => self.pick(node, 1, seeds),
            _ if level == 0 => self.pick(node, count, seeds),
            _ => self.pass_down(&node, level - 1, count, seeds),
        }
    }

    /// Shares seeds out among the children in proportion to their variation.
    fn pass_down(&self, node: &Range<usize>, level: u32, count: u32, seeds: &mut Vec<u32>) {
        let children = self.children(node, level);
        let caps = children.clone().map(|child| child.len() as u32);
        // Where one child has everything there is nothing to weigh.
        if let Some(only) = caps.iter().position(|&cap| cap as usize == node.len()) {
            return self.plant(children[only].clone(), level, count, seeds);
        }
        let wide = node.len() > SERIAL;
        let variations = if wide {
            let all = parallel::map(children.to_vec(), |child| self.variation(child));
            core::array::from_fn(|i| all[i])
        } else {
            children.clone().map(|child| self.variation(child))
        };
        let shares = budget::share(count, variations, caps);
        let tasks = children.into_iter().zip(shares).filter(|(_, share)| *share > 0);
        if wide {
            let planted = parallel::map(tasks.collect(), |(child, share)| {
                let mut seeds = Vec::with_capacity(share as usize);
                self.plant(child, level, share, &mut seeds);
                seeds
            });
            planted.iter().for_each(|part| seeds.extend(part));
        } else {
            tasks.for_each(|(child, share)| self.plant(child, level, share, seeds));
        }
    }

    /// The ranges of the children, in the order of the curve; a quadtree leaves the last four empty.
    fn children(&self, node: &Range<usize>, level: u32) -> [Range<usize>; 8] {
        let digit = |key: u64| (key >> (self.bits * level)) & ((1 << self.bits) - 1);
        let mut start = node.start;
        core::array::from_fn(|child| {
            let rest = &self.order[start..node.end];
            let end = start + rest.partition_point(|&(key, _)| digit(key) <= child as u64);
            let range = start..end;
            start = end;
            range
        })
    }

    fn variation(&self, node: Range<usize>) -> f64 {
        let metric = match self.variation {
            Variation::Errors(metric) => metric,
            Variation::Weights(weights) => {
                return self.order[node].iter().map(|&(_, i)| f64::from(weights[i as usize])).sum();
            }
        };
        let members = || self.order[node.clone()].iter().map(|&(_, i)| &self.points[i as usize]);
        let (position, normal) = members().fold((DVec3::ZERO, DVec3::ZERO), |(position, normal), point| {
            (position + point.position.as_dvec3(), normal + point.normal.as_dvec3())
        });
        let Some(normal) = normal.try_normalize() else {
            // Opposite normals that cancel: as far from any of them as a right angle.
            return core::f64::consts::SQRT_2 * node.len() as f64;
        };
        let mean =
            OrientedPoint { position: (position / node.len() as f64).as_vec3(), normal: normal.as_vec3() };
        members().map(|point| f64::from(metric.between(point, &mean))).sum()
    }

    /// One point of each of `count` equal parts of the order: at random, or the one that weighs most (ties:
    /// the first).
    fn pick(&self, node: Range<usize>, count: u32, seeds: &mut Vec<u32>) {
        let mut random = Random::new(self.seed, node.start as u32, node.end as u32);
        let (length, count) = (node.len() as u64, u64::from(count));
        seeds.extend((0..count).map(|part| {
            let (from, to) = (part * length / count, (part + 1) * length / count);
            if let Variation::Weights(weights) = self.variation {
                let part = &self.order[node.start + from as usize..node.start + to as usize];
                let best = part
                    .iter()
                    .map(|&(_, i)| i)
                    .reduce(|best, i| if weights[i as usize] > weights[best as usize] { i } else { best });
                return best.expect("no part is empty");
            }
            let jitter = (random.f64() * (to - from) as f64) as u64;
            self.order[node.start + (from + jitter.min(to - from - 1)) as usize].1
        }));
    }
}

/// Bits of a 16-bit number, a zero between each and the next.
fn spread_16(x: u32) -> u32 {
    let mut x = x & 0xffff;
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}
