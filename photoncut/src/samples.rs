//! Irradiance at every point, out of samples at few.
//!
//! Ward, Rubinstein and Clear 1988: the mean of nearby samples by their errors e = |x - s| ÷ R + |n - nₛ|,
//! R the harmonic mean of the distances that the sample's rays went; as Wang et al. 2009 have it. Differs
//! from both: what a sample is off along its normal counts more ([`planes`](InterpolationParams::planes)); R
//! is no larger than that of the place that asks, where that is known ([`Place::mean_distance`]); and there
//! is no radius beyond which a sample ends. A sample is off by its own noise, too
//! ([`noise`](InterpolationParams::noise)): weights are 1/(e² + noise²/rays) for two independent errors, where
//! Ward's 1/e shows the noise of a sample at its place in full. The samples of least error are taken, and the
//! weight of the next one after them is subtracted from all: a sample comes and goes with weight zero, so the
//! result is continuous wherever samples are, and never undefined. Gradients are limited: those of Ward and
//! Heckbert 1992 have no bound.
//!
//! Křivánek et al., "Making Radiance and Irradiance Caching Practical", 2006, section 3: no sample's R is
//! larger than a neighbour's plus the distance between them, on request.

use glam::Vec3;

use crate::gather::GatherSample;
use crate::points::{self, Located, SpatialNode};
use crate::search::{Measure, SampleSearch, Searched};

/// How samples are interpolated. Any values may be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterpolationParams {
    /// Samples in a mean, 1 to 32; as many as there are where those are fewer.
    pub neighbours: u32,
    /// Whether samples speak for their surroundings to first order (Ward and Heckbert 1992), and not as
    /// constants.
    pub gradients: bool,
    /// Whether neighbours bound each other's R.
    pub clamp_neighbours: bool,
    /// How much a sample's distance along its own normal counts, added to its distance: from 0 on (Ward's e;
    /// what is less, or NaN, counts as 0) to a million. A shelf above a point is near it and faces the same
    /// way, and sees other light; Ward 1988 leaves out what lies behind, which is not continuous.
    pub planes: f32,
    /// What the noise of a single ray counts as in e, at least 0 (what is less, or NaN, counts as 0): that of a
    /// sample is this over the square root of its rays. 0: samples are exact, and speak alone where they are.
    pub noise: f32,
    /// Least R, in the scene's length unit; at least 0.
    pub min_distance: f32,
    /// Largest R, in the scene's length unit: that of samples whose rays hit nothing, too.
    pub max_distance: f32,
}

impl InterpolationParams {
    /// Eight neighbours, neighbour clamping, no gradients; planes count 8 times, and a ray's noise as an e of 3;
    /// R from a thousandth of the scene's radius to all of it.
    pub const fn new(scene_radius: f32) -> Self {
        Self {
            neighbours: 8,
            gradients: false,
            clamp_neighbours: true,
            planes: 8.0,
            noise: 3.0,
            min_distance: 1e-3 * scene_radius,
            max_distance: scene_radius,
        }
    }

    /// Of one ray.
    fn squared_noise(&self) -> f32 {
        #[expect(clippy::manual_clamp, reason = "NaN counts as 0")]
        let noise = self.noise.max(0.0).min(1e9);
        noise * noise
    }

    /// R within its limits, and above zero.
    fn clamped(&self, r: f32) -> f32 {
        let floor = if self.min_distance.is_finite() { self.min_distance.max(0.0) } else { 0.0 };
        r.min(self.max_distance).max(floor).max(f32::MIN_POSITIVE)
    }
}

/// A surface that asks for its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Harmonic mean of the distances to what the place sees, as a few rays tell, in the scene's length unit.
    /// In a gap it is small, and samples in the open beside it then count as far. Infinite or NaN: nothing is
    /// known. At most 0: as small as R can be.
    pub mean_distance: f32,
}

impl Place {
    /// One that nothing is known of but where it is.
    pub const fn new(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, mean_distance: f32::INFINITY }
    }
}

/// Most samples in a mean.
const MAX_NEIGHBOURS: usize = 32;

/// Below this squared error a sample is the point itself.
const SAME: f32 = 1e-12;

/// Samples that can be interpolated. Memory: 164 bytes a sample with its share of the index.
#[derive(Clone, Debug)]
pub struct IrradianceSamples {
    samples: Vec<Indexed>,
    search: SampleSearch,
    params: InterpolationParams,
}

#[derive(Clone, Copy, Debug)]
struct Indexed {
    sample: GatherSample,
    /// R, clamped.
    distance: f32,
    /// Place in the caller's list.
    index: u32,
}

impl Located for Indexed {
    fn position(&self) -> Vec3 {
        self.sample.position
    }
    fn normal(&self) -> Vec3 {
        self.sample.normal
    }
}

impl Indexed {
    /// What the search asks of it; `noise`: squared, of one ray.
    #[inline]
    fn searched(&self, noise: f32) -> Searched {
        let GatherSample { position, normal, rays, .. } = self.sample;
        Searched { position, normal, distance: self.distance, noise: noise / rays.max(1) as f32 }
    }

    /// No gradient is larger than the steepest that the split sphere has, which Ward, Rubinstein and Clear
    /// 1988 bound the error by: 4/π of the irradiance over R, and √2 of it for a turn by a radian. Few rays
    /// past a near edge say more, by chance.
    fn limit_gradients(&mut self) {
        let GatherSample { irradiance, mean_distance, rotation, translation, .. } = &mut self.sample;
        let distance = mean_distance.max(self.distance);
        for (c, &own) in irradiance.to_array().iter().enumerate() {
            let own = own.max(0.0);
            rotation[c] = limited(rotation[c], core::f32::consts::SQRT_2 * own);
            translation[c] = limited(translation[c], 4.0 * core::f32::consts::FRAC_1_PI * own / distance);
        }
    }
}

/// `vector`, or one of the same direction that is `longest` long; none where it is not a number.
fn limited(vector: Vec3, longest: f32) -> Vec3 {
    if vector.is_finite() && longest.is_finite() { vector.clamp_length_max(longest) } else { Vec3::ZERO }
}

/// A sample's part in a mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Place in the list that was given.
    pub index: u32,
    /// In (0, 1]; all shares sum up to 1.
    pub weight: f32,
    slot: u32,
}

/// Memory of an interpolation, reused from point to point.
#[derive(Clone, Debug, Default)]
pub struct SampleScratch {
    stack: Vec<(f32, u32)>,
    /// Squared error and slot, least first.
    best: Vec<(f32, u32)>,
    shares: Vec<Share>,
}

impl SampleScratch {
    /// Who spoke for the last place that was asked about.
    pub fn shares(&self) -> &[Share] {
        &self.shares
    }
}

/// What samples foretell of a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Foretold {
    /// W·m⁻² per channel, from 0 on; 0 without samples.
    pub irradiance: Vec3,
    /// How far below zero gradients had extrapolated a channel, which was cut off there: from 0 on.
    pub cut_off: Vec3,
    /// How little they know: [`IrradianceSamples::doubt`].
    pub doubt: f32,
}

impl IrradianceSamples {
    /// Indexes samples; those with a NaN or infinite position, normal or irradiance are left out and counted
    /// in the second result.
    pub fn new(samples: &[GatherSample], params: &InterpolationParams) -> (Self, usize) {
        let mut kept: Vec<Indexed> = (0..)
            .zip(samples)
            .filter(|(_, s)| s.position.is_finite() && s.normal.is_finite() && s.irradiance.is_finite())
            .map(|(index, &sample)| Indexed { sample, distance: params.clamped(sample.mean_distance), index })
            .collect();
        let left_out = samples.len() - kept.len();
        let nodes = points::build(&mut kept, 4);
        if params.clamp_neighbours {
            clamp_by_neighbours(&mut kept, &nodes);
        }
        kept.iter_mut().for_each(Indexed::limit_gradients);
        let noise = params.squared_noise();
        let searched: Vec<Searched> = kept.iter().map(|sample| sample.searched(noise)).collect();
        let search = SampleSearch::new(&searched);
        (Self { samples: kept, search, params: *params }, left_out)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Who speaks for a place, and with what weight; nobody only where there are no samples.
    pub fn shares<'s>(&self, place: &Place, scratch: &'s mut SampleScratch) -> &'s [Share] {
        self.find_nearest(place, scratch);
        let SampleScratch { best, shares, .. } = scratch;
        shares.clear();
        let share = |slot: u32, weight: f32| Share { index: self.samples[slot as usize].index, weight, slot };
        match **best {
            [] => return shares,
            [(error, slot), ..] if error < SAME => {
                shares.push(share(slot, 1.0));
                return shares;
            }
            _ => {}
        }
        // The one too many says how much less all others weigh.
        let wanted = self.wanted();
        let cut_off = best.get(wanted).map_or(0.0, |&(error, _)| 1.0 / error);
        let counted = &best[..best.len().min(wanted)];
        let weight = |error: f32| (1.0 / error - cut_off).max(0.0);
        let sum: f32 = counted.iter().map(|&(error, _)| weight(error)).sum();
        // All as near as the one too many, as on a regular grid: then they count alike.
        let alike = !(sum.is_finite() && sum * counted[0].0 > 1e-6);
        for &(error, slot) in counted {
            let weight = if alike { 1.0 / counted.len() as f32 } else { weight(error) / sum };
            if weight > 0.0 {
                shares.push(share(slot, weight));
            }
        }
        shares
    }

    /// Irradiance of a place, W·m⁻² per channel; zero without samples. With gradients a channel may be
    /// extrapolated to below zero: it is cut off there, and the second result is how far below, from 0 on.
    pub fn irradiance(&self, place: &Place, scratch: &mut SampleScratch) -> (Vec3, Vec3) {
        let Foretold { irradiance, cut_off, .. } = self.foretell(place, scratch);
        (irradiance, cut_off)
    }

    /// How little samples know about a place. Dimensionless, from 0 on; without samples 0. Where it is large,
    /// light gathered at the place itself is worth its rays most.
    ///
    /// The squares of two parts are added: the standard deviation of what each sample foretells, by their
    /// shares, over the largest irradiance that any of them gathered; and a twentieth of the least error (e
    /// and noise), for what no sample is near may be dark though all around it agree.
    pub fn doubt(&self, place: &Place, scratch: &mut SampleScratch) -> f32 {
        self.foretell(place, scratch).doubt
    }

    /// Irradiance and doubt of a place by one search; [`SampleScratch::shares`] says afterwards who spoke.
    pub fn foretell(&self, place: &Place, scratch: &mut SampleScratch) -> Foretold {
        const UNSEEN: f32 = 0.05;
        self.shares(place, scratch);
        let (mut sum, mut largest) = (Vec3::ZERO, 0.0f64);
        let (mut mean, mut squares) = (0.0f64, 0.0f64);
        for share in &scratch.shares {
            let foretold = self.foretold(share, place);
            sum += share.weight * foretold;
            let all = f64::from(foretold.element_sum());
            mean += f64::from(share.weight) * all;
            squares += f64::from(share.weight) * all * all;
            let gathered = self.samples[share.slot as usize].sample.irradiance;
            largest = largest.max(f64::from(gathered.element_sum()));
        }
        let deviation = (squares - mean * mean).max(0.0).sqrt();
        let spread = if largest > 0.0 { deviation / largest } else { 0.0 };
        let unseen = UNSEEN * scratch.best.first().map_or(0.0, |&(error, _)| error.sqrt());
        let doubt = spread.hypot(unseen.into()).min(f64::from(f32::MAX)) as f32;
        Foretold { irradiance: sum.max(Vec3::ZERO), cut_off: (-sum).max(Vec3::ZERO), doubt }
    }

    /// What one sample says of a place.
    #[inline]
    fn foretold(&self, share: &Share, place: &Place) -> Vec3 {
        let Indexed { sample, distance, .. } = &self.samples[share.slot as usize];
        if !self.params.gradients {
            return sample.irradiance;
        }
        // Farther away than R a gradient says nothing.
        let way = (place.position - sample.position).clamp_length_max(*distance);
        let turn = sample.normal.cross(place.normal);
        let change = |c: usize| turn.dot(sample.rotation[c]) + way.dot(sample.translation[c]);
        sample.irradiance + Vec3::new(change(0), change(1), change(2))
    }

    fn wanted(&self) -> usize {
        (self.params.neighbours as usize).clamp(1, MAX_NEIGHBOURS)
    }

    /// Fills `best` with the samples of least e, ties to the lower slot, one more than wanted.
    fn find_nearest(&self, place: &Place, scratch: &mut SampleScratch) {
        let SampleScratch { stack, best, .. } = scratch;
        let count = self.wanted() + 1;
        let own = place.mean_distance;
        let reach = if own.is_finite() { self.params.clamped(own) } else { f32::INFINITY };
        #[expect(clippy::manual_clamp, reason = "NaN counts as 0")]
        let planes = self.params.planes.max(0.0).min(1e6);
        let measure = Measure { place, reach, planes };

        // Who was near the place before may be near this one: a bound to begin with. What is found does not
        // depend on it.
        let noise = self.params.squared_noise();
        best.retain_mut(|(error, slot)| {
            let near = self.samples.get(*slot as usize);
            *error = near.map_or(f32::NAN, |sample| measure.error(&sample.searched(noise)));
            error.is_finite()
        });
        best.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        best.truncate(count);
        self.search.nearest(&measure, count, stack, best);
    }
}

/// R of each sample to the least of any sample's R plus the distance between the two. Once is enough, by the
/// triangle inequality.
fn clamp_by_neighbours(samples: &mut [Indexed], nodes: &[SpatialNode]) {
    // The least R below each node.
    let mut least = vec![f32::INFINITY; nodes.len()];
    for id in (0..nodes.len()).rev() {
        let children = nodes[id].children();
        least[id] = if children.is_empty() {
            let items = nodes[id].items();
            samples[items.start as usize..items.end as usize]
                .iter()
                .map(|s| s.distance)
                .fold(f32::INFINITY, f32::min)
        } else {
            least[children.start as usize].min(least[children.start as usize + 1])
        };
    }
    let mut bounded: Vec<f32> = samples.iter().map(|sample| sample.distance).collect();
    lighttree::parallel::for_each(&mut bounded, Vec::new, |stack: &mut Vec<u32>, i, best| {
        let position = samples[i].sample.position;
        stack.push(0);
        while let Some(id) = stack.pop() {
            let node = &nodes[id as usize];
            let bound = least[id as usize] + node.distance_squared(position).sqrt();
            if (1.0 - 1e-5) * bound > *best {
                continue;
            }
            for slot in if node.children().is_empty() { node.items() } else { 0..0 } {
                let other = &samples[slot as usize];
                *best = best.min(other.distance + other.sample.position.distance(position));
            }
            stack.extend(node.children());
        }
    });
    samples.iter_mut().zip(bounded).for_each(|(sample, distance)| sample.distance = distance);
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    #[test]
    fn memory_is_as_stated() {
        // 32 of a block, and 8 of the groups above.
        assert_eq!(size_of::<Indexed>() + 40, 164);
    }

    /// By the tree as by asking everybody.
    #[test]
    fn neighbours_bound_each_other() {
        let mut random = Random::new(1, 0, 0);
        let samples: Vec<_> = (0..500)
            .map(|_| GatherSample {
                position: Vec3::new(random.f32(), random.f32(), random.f32()),
                normal: Vec3::Y,
                irradiance: Vec3::ONE,
                mean_distance: random.f32().powi(3),
                rotation: [Vec3::ZERO; 3],
                translation: [Vec3::ZERO; 3],
                rays: 1,
            })
            .collect();
        let (index, _) = IrradianceSamples::new(&samples, &InterpolationParams::new(1.0));
        let mut changed = 0;
        for Indexed { sample, distance, .. } in &index.samples {
            let own = sample.mean_distance.max(1e-3);
            let expected = samples.iter().fold(own, |least, other| {
                least.min(other.mean_distance.max(1e-3) + other.position.distance(sample.position))
            });
            assert_eq!(*distance, expected);
            changed += u32::from(expected < own);
        }
        assert!((100..500).contains(&changed), "{changed}");
    }
}
