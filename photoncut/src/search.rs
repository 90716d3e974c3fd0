//! The search for the samples of least error: eight side by side, below boxes of eight parts each.

use glam::Vec3;

use crate::samples::Place;

/// Samples of a block, and parts of a group.
pub(crate) const LANES: usize = 8;

/// What is farther is as far as this: so that squares, and one over them, are numbers.
const FARTHEST: f32 = 1e18;

/// A bound is rounded otherwise than the error that it bounds: whoever is out by no more than this is looked
/// at.
const SLACK: f32 = 1.0 - 1e-5;

type Lanes = [f32; LANES];

/// What the search asks of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Searched {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    /// R.
    pub(crate) distance: f32,
    /// Squared.
    pub(crate) noise: f32,
}

/// The error of samples against one place.
pub(crate) struct Measure<'a> {
    pub(crate) place: &'a Place,
    /// R of the place; infinite: not known.
    pub(crate) reach: f32,
    pub(crate) planes: f32,
}

impl Measure<'_> {
    /// Squared: Ward's e, and the noise.
    #[inline]
    pub(crate) fn error(&self, sample: &Searched) -> f32 {
        let offset = self.place.position - sample.position;
        let off_plane = offset.dot(sample.normal).abs();
        let e = (offset.length() + self.planes * off_plane) / least(sample.distance, self.reach)
            + self.place.normal.distance(sample.normal);
        let e = least(FARTHEST, e);
        e * e + sample.noise
    }
}

/// The lesser one, or `b` where either is no number: one instruction, where `f32::min` is three.
#[inline(always)]
const fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater one, or `b` where either is no number.
#[inline(always)]
const fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Eight samples, field by field: 256 bytes. Nobody is in a lane of infinite noise.
#[derive(Clone, Copy, Debug)]
struct Block {
    position: [Lanes; 3],
    normal: [Lanes; 3],
    distance: Lanes,
    noise: Lanes,
}

/// Bounds of eight blocks or groups, field by field: 448 bytes. Nothing is in a lane of infinite noise.
#[derive(Clone, Copy, Debug)]
struct Group {
    min: [Lanes; 3],
    max: [Lanes; 3],
    normal_min: [Lanes; 3],
    normal_max: [Lanes; 3],
    /// Largest R.
    reach: Lanes,
    /// Least squared noise.
    noise: Lanes,
    /// Number of the first part: a block's, or that of a group and how many blocks there are.
    first: u32,
}

/// Samples to be searched: 40 bytes each.
#[derive(Clone, Debug, Default)]
pub(crate) struct SampleSearch {
    blocks: Vec<Block>,
    /// From those above blocks up to the one above all.
    groups: Vec<Group>,
}

/// Bounds of a part.
#[derive(Clone, Copy)]
struct Bounds {
    min: Vec3,
    max: Vec3,
    normal_min: Vec3,
    normal_max: Vec3,
    reach: f32,
    noise: f32,
}

impl Bounds {
    const NOTHING: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
        normal_min: Vec3::INFINITY,
        normal_max: Vec3::NEG_INFINITY,
        reach: 0.0,
        noise: f32::INFINITY,
    };

    fn of(sample: &Searched) -> Self {
        let Searched { position, normal, distance, noise } = *sample;
        Self { min: position, max: position, normal_min: normal, normal_max: normal, reach: distance, noise }
    }

    fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            normal_min: self.normal_min.min(other.normal_min),
            normal_max: self.normal_max.max(other.normal_max),
            reach: self.reach.max(other.reach),
            noise: self.noise.min(other.noise),
        }
    }
}

impl SampleSearch {
    /// Of samples in an order in which those next to each other are near each other.
    pub(crate) fn new(samples: &[Searched]) -> Self {
        let blocks: Vec<Block> = samples.chunks(LANES).map(Block::new).collect();
        let union = |all: Bounds, one: Bounds| all.union(one);
        let mut bounds: Vec<Bounds> = samples
            .chunks(LANES)
            .map(|samples| samples.iter().map(Bounds::of).fold(Bounds::NOTHING, union))
            .collect();
        let (mut groups, mut first) = (Vec::new(), 0);
        while !bounds.is_empty() {
            groups.extend(
                (first..)
                    .step_by(LANES)
                    .zip(bounds.chunks(LANES))
                    .map(|(first, parts)| Group::new(parts, first)),
            );
            first += bounds.len() as u32;
            if bounds.len() <= LANES {
                break;
            }
            bounds = bounds
                .chunks(LANES)
                .map(|parts| parts.iter().copied().fold(Bounds::NOTHING, union))
                .collect();
        }
        Self { blocks, groups }
    }

    /// Puts those of least error among the `count` best that there are in `best`, where some may be already,
    /// with these very errors; ties go to the lower slot. Least first.
    pub(crate) fn nearest(
        &self,
        measure: &Measure<'_>,
        count: usize,
        stack: &mut Vec<(f32, u32)>,
        best: &mut Vec<(f32, u32)>,
    ) {
        let farthest = |best: &[(f32, u32)]| if best.len() == count { best[count - 1].0 } else { f32::MAX };
        let blocks = self.blocks.len() as u32;
        stack.clear();
        if !self.groups.is_empty() {
            stack.push((0.0, blocks + self.groups.len() as u32 - 1));
        }
        let mut bound = farthest(best);
        while let Some((least, part)) = stack.pop() {
            if least > bound {
                continue;
            }
            if part < blocks {
                let errors = self.blocks[part as usize].errors(measure);
                for (lane, &error) in (0..).zip(&errors) {
                    if error <= bound {
                        insert(best, (error, part * LANES as u32 + lane), count);
                        bound = farthest(best);
                    }
                }
                continue;
            }
            // The nearest last, so that it comes first.
            let group = &self.groups[(part - blocks) as usize];
            let here = stack.len();
            for (lane, &least) in (0..).zip(&group.least(measure)) {
                if least <= bound {
                    stack.push((least, group.first + lane));
                    let mut place = stack.len() - 1;
                    while place > here && stack[place - 1].0 < least {
                        stack.swap(place - 1, place);
                        place -= 1;
                    }
                }
            }
        }
    }
}

/// Puts an entry in its place among the `count` best, unless it is there already.
#[inline]
fn insert(best: &mut Vec<(f32, u32)>, entry: (f32, u32), count: usize) {
    if best.len() == count && entry >= best[count - 1] {
        return;
    }
    let place = best.partition_point(|other| *other < entry);
    if best.get(place).is_none_or(|there| there.1 != entry.1) {
        best.truncate(count - 1);
        best.insert(place, entry);
    }
}

/// A lane for each of up to eight, and `rest` for what is missing.
fn lanes<T>(items: &[T], rest: f32, of: impl Fn(&T) -> f32) -> Lanes {
    core::array::from_fn(|lane| items.get(lane).map_or(rest, &of))
}

impl Block {
    fn new(samples: &[Searched]) -> Self {
        let each = |of: fn(&Searched) -> Vec3| [0, 1, 2].map(|axis| lanes(samples, 0.0, |s| of(s)[axis]));
        Self {
            position: each(|s| s.position),
            normal: each(|s| s.normal),
            distance: lanes(samples, 1.0, |s| s.distance),
            noise: lanes(samples, f32::INFINITY, |s| s.noise),
        }
    }

    /// [`Measure::error`] of each, the same bits.
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "lanes of many arrays at once, which become vectors")]
    fn errors(&self, measure: &Measure<'_>) -> Lanes {
        let Place { position: at, normal, .. } = *measure.place;
        let mut errors = [0.0; LANES];
        for lane in 0..LANES {
            let (x, y, z) =
                (at.x - self.position[0][lane], at.y - self.position[1][lane], at.z - self.position[2][lane]);
            let (u, v, w) = (self.normal[0][lane], self.normal[1][lane], self.normal[2][lane]);
            let height = x * u + y * v + z * w;
            let (u, v, w) = (normal.x - u, normal.y - v, normal.z - w);
            let e = ((x * x + y * y + z * z).sqrt() + measure.planes * height.abs())
                / least(self.distance[lane], measure.reach)
                + (u * u + v * v + w * w).sqrt();
            let e = least(FARTHEST, e);
            errors[lane] = e * e + self.noise[lane];
        }
        errors
    }
}

impl Group {
    fn new(parts: &[Bounds], first: u32) -> Self {
        // Finite where nobody is, so that the noise decides.
        let each = |of: fn(&Bounds) -> Vec3| [0, 1, 2].map(|axis| lanes(parts, 0.0, |part| of(part)[axis]));
        Self {
            min: each(|part| part.min),
            max: each(|part| part.max),
            normal_min: each(|part| part.normal_min),
            normal_max: each(|part| part.normal_max),
            reach: lanes(parts, 1.0, |part| part.reach),
            noise: lanes(parts, f32::INFINITY, |part| part.noise),
            first,
        }
    }

    /// Nobody in a part has a lesser error than this. What is off a sample's plane is left out.
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "lanes of many arrays at once, which become vectors")]
    fn least(&self, measure: &Measure<'_>) -> Lanes {
        let Place { position: at, normal, .. } = *measure.place;
        let off = |min: f32, max: f32, at: f32| most(most(min - at, at - max), 0.0);
        let mut bounds = [0.0; LANES];
        for lane in 0..LANES {
            let x = off(self.min[0][lane], self.max[0][lane], at.x);
            let y = off(self.min[1][lane], self.max[1][lane], at.y);
            let z = off(self.min[2][lane], self.max[2][lane], at.z);
            let u = off(self.normal_min[0][lane], self.normal_max[0][lane], normal.x);
            let v = off(self.normal_min[1][lane], self.normal_max[1][lane], normal.y);
            let w = off(self.normal_min[2][lane], self.normal_max[2][lane], normal.z);
            let e = (x * x + y * y + z * z).sqrt() / least(self.reach[lane], measure.reach)
                + (u * u + v * v + w * w).sqrt();
            let e = least(FARTHEST, e);
            bounds[lane] = SLACK * (e * e + self.noise[lane]);
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    /// Blocks have the bits of single samples, and no part has one of less error than its bound.
    #[test]
    fn lanes_say_what_samples_say() {
        let mut random = Random::new(3, 0, 0);
        let mut any = || Vec3::new(random.f32(), random.f32(), random.f32());
        let samples: Vec<_> = (0..700)
            .map(|i| Searched {
                position: if i % 3 == 0 { 1e15 * any() } else { any() },
                normal: (any() - 0.5).normalize(),
                distance: any().x.powi(4).max(f32::MIN_POSITIVE),
                noise: if i % 2 == 0 { any().x } else { 0.0 },
            })
            .collect();
        assert_eq!((size_of::<Block>(), size_of::<Group>()), (256, 452));
        let search = SampleSearch::new(&samples);
        assert_eq!((search.blocks.len(), search.groups.len()), (88, 11 + 2 + 1));
        let samples_of = |part: u32| {
            // All those below.
            let (mut parts, mut all) = (vec![part], Vec::new());
            while let Some(part) = parts.pop() {
                match search.groups.get((part as usize).wrapping_sub(88)) {
                    Some(group) => {
                        parts.extend(
                            (group.first..).take(LANES).zip(group.noise).filter(|p| p.1 < 1e9).map(|p| p.0),
                        );
                    }
                    None => all.extend(&samples[8 * part as usize..samples.len().min(8 * part as usize + 8)]),
                }
            }
            all
        };
        assert_eq!(samples_of(88 + 13).len(), 700);
        for i in 0..40 {
            let place = Place::new(any(), (any() - 0.5).normalize());
            let reach = if i % 2 == 0 { f32::INFINITY } else { any().x };
            let measure = Measure { place: &place, reach, planes: 8.0 };
            for (block, samples) in search.blocks.iter().zip(samples.chunks(8)) {
                let errors = block.errors(&measure);
                for (k, error) in errors.into_iter().enumerate() {
                    assert_eq!(error, samples.get(k).map_or(f32::INFINITY, |s| measure.error(s)));
                }
            }
            for group in &search.groups {
                for (part, least) in
                    (group.first..).zip(group.least(&measure)).filter(|(_, least)| *least < f32::MAX)
                {
                    let nearest = samples_of(part).iter().map(|s| measure.error(s)).fold(f32::MAX, f32::min);
                    assert!(least <= nearest, "{least} bounds {nearest}");
                }
            }
        }
    }
}
