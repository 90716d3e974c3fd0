//! Lights along a Morton curve.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4. Differs from it: equal keys are ordered
//! by light id instead of by chance, axes without extent count as one cell instead of dividing by zero, and
//! 21 bits per axis can be had.

use glam::Vec3;

use super::{
    MortonBits, emit::Item, emit::Splitter, radix, radix::Keyed, survey, survey::Survey, survey::half_center,
};
use crate::{Emitter, LightId, parallel};

/// Splits what is in Morton order already, where a perfect tree of the next power of two would.
pub(crate) struct Balanced;

impl Splitter for Balanced {
    type Item = LightId;
    type Node = ();

    fn split(&self, items: &mut [LightId], (): ()) -> (usize, (), ()) {
        (items.len().next_power_of_two() / 2, (), ())
    }
}

impl Item for LightId {
    fn light(&self) -> LightId {
        *self
    }
    fn half_center(&self) -> Vec3 {
        // Only the median fallback asks, and a balanced tree is never that deep.
        Vec3::ZERO
    }
}

/// The lights that shine, in Morton order of their centres; equal keys by id.
pub(crate) fn order<E: Emitter + Sync>(lights: &[E], survey: &Survey, bits: MortonBits) -> Vec<LightId> {
    fn ids<K: Keyed>(keys: &[K]) -> Vec<LightId> {
        keys.iter().map(Keyed::light).collect()
    }
    match bits {
        MortonBits::Thirty => ids(sorted_30(lights, survey, &mut Keys::default())),
        MortonBits::SixtyThree => ids(sorted_63(lights, survey, &mut Keys::default())),
    }
}

/// Memory for keys and for sorting them, reused from build to build.
#[derive(Clone, Debug, Default)]
pub(crate) struct Keys<K> {
    keys: Vec<K>,
    other: Vec<K>,
}

impl<K> Keys<K> {
    /// Heap memory, bytes.
    pub(crate) fn bytes(&self) -> usize {
        (self.keys.capacity() + self.other.capacity()) * size_of::<K>()
    }
}

/// The same with their keys of 30 bits, which stand above the lights' ids.
pub(crate) fn sorted_30<'a, E: Emitter + Sync>(
    lights: &[E],
    survey: &Survey,
    Keys { keys, other }: &'a mut Keys<u64>,
) -> &'a [u64] {
    keyed(lights, survey, 1 << 10, keys, |cell, light| {
        let key = spread_10(cell[0]) << 2 | spread_10(cell[1]) << 1 | spread_10(cell[2]);
        u64::from(key) << 32 | u64::from(light)
    });
    radix::sort(keys, other, 32, 30);
    keys
}

/// The same with their keys of 63 bits.
pub(crate) fn sorted_63<'a, E: Emitter + Sync>(
    lights: &[E],
    survey: &Survey,
    Keys { keys, other }: &'a mut Keys<(u64, u32)>,
) -> &'a [(u64, u32)] {
    keyed(lights, survey, 1 << 21, keys, |cell, light| {
        (spread_21(cell[0]) << 2 | spread_21(cell[1]) << 1 | spread_21(cell[2]), light)
    });
    radix::sort(keys, other, 0, 63);
    keys
}

/// Keys of the lights that shine, in the order of their ids.
fn keyed<E: Emitter + Sync, K: Keyed>(
    lights: &[E],
    survey: &Survey,
    cells: u32,
    keys: &mut Vec<K>,
    key: impl Fn([u32; 3], u32) -> K + Sync + Send,
) {
    let scale = Vec3::splat(cells as f32) / (survey.max - survey.min);
    let cell = |center: Vec3| {
        // No extent: infinite scale, times zero: NaN, which becomes cell 0. The far edge becomes the last
        // cell.
        ((center - survey.min) * scale).to_array().map(|c| (c as u32).min(cells - 1))
    };
    if survey.dropped == 0 {
        // One key a light: no need to find out where each part's go.
        parallel::resize(keys, lights.len());
        let part = lights.len().div_ceil(4 * parallel::threads()).max(1 << 12);
        let parts = keys.chunks_mut(part).zip(lights.chunks(part)).zip((0..).step_by(part));
        parallel::map(parts.collect(), |((keys, lights), first): ((&mut [K], &[E]), u32)| {
            for ((slot, light), index) in keys.iter_mut().zip(lights).zip(first..) {
                *slot = key(cell(half_center(&light.bounds())), index);
            }
        });
        return;
    }
    let parts = parallel::map(survey::chunks(lights.len()), |range| {
        let mut keys = Vec::with_capacity(range.len());
        for index in range {
            let bounds = lights[index].bounds();
            if bounds.intensity > 0.0 {
                keys.push(key(cell(half_center(&bounds)), index as u32));
            }
        }
        keys
    });
    keys.clear();
    keys.extend(parts.iter().flatten());
}

/// Bits of a 10-bit number, two zeros between each and the next.
fn spread_10(mut x: u32) -> u32 {
    x = (x | x << 16) & 0x0300_00ff;
    x = (x | x << 8) & 0x0300_f00f;
    x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

/// Bits of a 21-bit number, two zeros between each and the next: a third of a Morton code of 63 bits.
#[inline]
pub fn spread_21(x: u32) -> u64 {
    let mut x = u64::from(x & 0x001f_ffff);
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}
