//! Greedy agglomerative clustering, bottom up.
//!
//! The metric is that of Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005: two clusters
//! are as far apart as `I (α² + c² (1 - cos β)²)` of what they would become, with total intensity `I`, box
//! diagonal `α`, half angle `β` of the cone of normals, and `c` the scene's diagonal where there are oriented
//! lights.
//!
//! The way is that of Walter et al., "Fast Agglomerative Clustering for Rendering", 2008: no union is nearer
//! to a third cluster than the nearer of its parts was, so whenever two clusters are each other's nearest,
//! they can be joined at once, and a cluster's nearest stays the nearest until it is joined itself. Only then
//! it is sought again. It is sought as in Meister and Bittner, "Parallel Locally-Ordered Clustering for
//! Bounding Volume Hierarchy Construction", 2018: among the [`RADIUS`] clusters to either side along a Morton
//! curve.
//!
//! Differs from them: the curve runs through positions and axes, where Walter et al. search a k-d tree. What
//! is near but far along the curve is missed; in exchange a search costs the same whatever the lights, also
//! where directions are random and a k-d tree has little to prune by. All searches of a round run in
//! parallel. Equally near clusters pair up by the lowest exclusive or of their places, so that lights in one
//! place make a balanced tree; should no two clusters be each other's nearest, since others have come into
//! reach meanwhile, all search again.

use glam::{Vec3, Vec3A};

use super::{
    emit::Splitter,
    median::Place,
    radix, saoh, survey,
    survey::{Survey, half_center},
};
use crate::{Emitter, LightBounds, LightId, parallel};

/// No cluster.
const NONE: u32 = u32::MAX;
/// Searches in one task; fewer are not worth a second thread.
const PART: usize = 256;

/// Clusters that a search compares on either side.
const RADIUS: usize = 10;
/// On both.
const CANDIDATES: usize = 2 * RADIUS;

/// The finished hierarchy: which clusters were joined. Cluster `i` below the number of lights is the light at
/// place `i`; the others are the unions in the order they were made.
pub(crate) struct Unions {
    lights: u32,
    parts: Vec<[u32; 2]>,
    counts: Vec<u32>,
}

impl Splitter for Unions {
    type Item = Place;
    type Node = u32;

    fn split(&self, _: &mut [Place], node: u32) -> (usize, u32, u32) {
        let [left, right] = self.parts[(node - self.lights) as usize];
        (self.count(left) as usize, left, right)
    }
}

impl Unions {
    /// The cluster of all lights.
    pub(crate) fn root(&self) -> u32 {
        (self.lights + self.parts.len() as u32).saturating_sub(1)
    }

    fn count(&self, cluster: u32) -> u32 {
        if cluster < self.lights { 1 } else { self.counts[(cluster - self.lights) as usize] }
    }

    fn join(&mut self, left: u32, right: u32) -> u32 {
        self.parts.push([left, right]);
        self.counts.push(self.count(left) + self.count(right));
        self.root()
    }
}

/// Clusters the lights; returns them in the order in which the hierarchy has them.
pub(crate) fn cluster<E: Emitter + Sync>(lights: &[E], survey: &Survey) -> (Vec<Place>, Unions) {
    let order = &order(lights, survey);
    let mut clusters = Clusters::new(lights, order, survey);
    let mut searching: Vec<u32> = (0..order.len() as u32).collect();
    while clusters.unions.parts.len() + 1 < order.len() {
        // Search for the nearest of all that are new or have lost theirs.
        let found = parallel::map(searching.chunks(PART).collect(), |part| {
            part.iter().map(|&place| clusters.find_nearest(place)).collect::<Vec<_>>()
        });
        for (&place, nearest) in searching.iter().zip(found.into_iter().flatten()) {
            clusters.follow(place, nearest);
        }
        // Join those that found one another.
        let mut next = Vec::new();
        for &place in &searching {
            let nearest = clusters.nearest[place as usize];
            if nearest != NONE && clusters.nearest[nearest as usize] == place {
                clusters.join(place, nearest, &mut next);
            }
        }
        searching = if next.is_empty() { clusters.forget() } else { next };
    }

    let mut places = Vec::with_capacity(order.len());
    let mut open = vec![clusters.unions.root()];
    while let Some(cluster) = open.pop().filter(|_| !order.is_empty()) {
        if let Some([left, right]) =
            cluster.checked_sub(order.len() as u32).map(|i| clusters.unions.parts[i as usize])
        {
            open.extend([right, left]);
        } else {
            places.push(Place::new(lights, order[cluster as usize]));
        }
    }
    (places, clusters.unions)
}

/// The lights that shine along a Morton curve through positions and axes; equal keys by id.
///
/// 16 bits for each coordinate, most significant first, and after every second level one bit each of the
/// octahedral axis: in the metric an angle counts as a length by its square.
fn order<E: Emitter + Sync>(lights: &[E], survey: &Survey) -> Vec<LightId> {
    const LEVELS: u32 = 16;
    let cells = (1 << LEVELS) as f32;
    let scale = Vec3::splat(cells) / (survey.max - survey.min);
    let key = |bounds: &LightBounds| {
        // As for other Morton keys: NaN, where an axis has no extent, becomes cell 0.
        let place = (half_center(bounds) - survey.min) * scale;
        let place = place.to_array().map(|c| (c as u32).min((1 << LEVELS) - 1));
        let axis = if bounds.cos_theta_o > -1.0 { saoh::one_hemisphere(bounds) } else { Vec3::Z };
        let (u, v) = octahedral(axis);
        let mut key = 0;
        for level in (0..LEVELS).rev() {
            let bit = |c: u32| u64::from(c >> level & 1);
            key = key << 3 | bit(place[0]) << 2 | bit(place[1]) << 1 | bit(place[2]);
            let step = LEVELS - 1 - level;
            if step >= 2 && step.is_multiple_of(2) {
                let bit = |c: u32| u64::from(c >> (7 - step / 2) & 1);
                key = key << 2 | bit(u) << 1 | bit(v);
            }
        }
        key
    };
    let parts = parallel::map(survey::chunks(lights.len()), |range| {
        let keyed = |index: usize| {
            let bounds = lights[index].bounds();
            (bounds.intensity > 0.0).then(|| (key(&bounds), index as u32))
        };
        range.filter_map(keyed).collect::<Vec<_>>()
    });
    let mut keys = parts.concat();
    radix::sort(&mut keys, &mut Vec::new(), 0, 3 * LEVELS + 14);
    keys.into_iter().map(|(_, light)| LightId(light)).collect()
}

/// Octahedral coordinates of a direction, 7 bits each.
fn octahedral(axis: Vec3) -> (u32, u32) {
    let v = axis / axis.abs().element_sum();
    let folded = |a: f32, b: f32| (1.0 - b.abs()).copysign(a);
    let (x, y) = if v.z < 0.0 { (folded(v.x, v.y), folded(v.y, v.x)) } else { (v.x, v.y) };
    let cell = |c: f32| ((64.0 * (c + 1.0)) as u32).min(127);
    (cell(x), cell(y))
}

/// What the metric needs of a cluster.
#[derive(Clone, Copy)]
struct Cluster {
    low: Vec3A,
    high: Vec3A,
    axis: Vec3A,
    /// Half angle of the cone of normals, radians.
    theta_o: f32,
    intensity: f32,
    /// Whether any of its lights has a direction.
    oriented: bool,
    two_sided: bool,
    /// Its number in [`Unions`].
    id: u32,
}

struct Clusters {
    /// By place; unions live at the place of their first part.
    clusters: Vec<Cluster>,
    /// The place of the nearest cluster, or [`NONE`].
    nearest: Vec<u32>,
    /// Those whose nearest is this place, as a list: its head, and each one's successor.
    first_follower: Vec<u32>,
    next_follower: Vec<u32>,
    /// Neighbours along the curve among the clusters that are left.
    left: Vec<u32>,
    right: Vec<u32>,
    /// `c²` in the scaled unit; 0 where no light has a direction.
    direction_scale: f32,
    unions: Unions,
}

impl Clusters {
    fn new<E: Emitter + Sync>(lights: &[E], order: &[LightId], survey: &Survey) -> Self {
        // In units of about the scene's extent and of the strongest light, f32 has room for the metric.
        let extent = 2.0 * (survey.max.as_dvec3() - survey.min.as_dvec3()).max_element();
        let scale = if extent > 0.0 { (-extent.log2().round()).exp2() } else { 1.0 };
        let per_intensity = f64::from(survey.max_intensity).recip();
        let parts =
            parallel::map(order.chunks(1 << 12).zip(0..).collect(), |(part, index): (&[LightId], u32)| {
                let cluster = |(light, id): (&LightId, u32)| {
                    Cluster::new(&lights[light.0 as usize].bounds(), scale, per_intensity, id)
                };
                part.iter().zip(index << 12..).map(cluster).collect::<Vec<_>>()
            });
        let clusters: Vec<_> = parts.concat();

        let start = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let (low, high) = clusters.iter().fold(start, |(low, high), c| (low.min(c.low), high.max(c.high)));
        let diagonal = (high - low).max(Vec3A::ZERO).length_squared();
        let oriented = clusters.iter().any(|cluster| cluster.oriented);
        let n = clusters.len();
        Self {
            nearest: vec![NONE; n],
            first_follower: vec![NONE; n],
            next_follower: vec![NONE; n],
            left: (0..n as u32).map(|place| place.wrapping_sub(1)).collect(),
            right: (1..=n as u32).map(|place| if (place as usize) < n { place } else { NONE }).collect(),
            // Where all lights are in one place, only directions tell them apart.
            direction_scale: if !oriented {
                0.0
            } else if diagonal > 0.0 {
                diagonal
            } else {
                1.0
            },
            unions: Unions { lights: n as u32, parts: Vec::with_capacity(n), counts: Vec::with_capacity(n) },
            clusters,
        }
    }

    /// The place of the nearest cluster along the curve; [`NONE`] only if there is no other.
    fn find_nearest(&self, place: u32) -> u32 {
        let mut others = [NONE; CANDIDATES];
        let mut count = 0;
        for links in [&self.left, &self.right] {
            let (mut at, end) = (links[place as usize], count + RADIUS);
            while at != NONE && count < end {
                others[count] = at;
                count += 1;
                at = links[at as usize];
            }
        }
        let others = &others[..count];
        let distances = self.distances(&self.clusters[place as usize], others);
        let least = distances[..count].iter().fold(f32::INFINITY, |least, &distance| least.min(distance));
        let nearest = others.iter().zip(distances).filter(|&(_, distance)| distance == least);
        nearest.map(|(&other, _)| other).min_by_key(|other| other ^ place).unwrap_or(NONE)
    }

    /// The metric of the union of a cluster with each of some others, worked out side by side.
    fn distances(&self, cluster: &Cluster, others: &[u32]) -> [f32; CANDIDATES] {
        let mut diagonal = [0.0; CANDIDATES];
        let mut intensity = [0.0; CANDIDATES];
        let mut cosine = [0.0; CANDIDATES];
        let mut theta_o = [0.0; CANDIDATES];
        let mut direction_scale = [0.0; CANDIDATES];
        for (i, &other) in others.iter().enumerate() {
            let other = &self.clusters[other as usize];
            diagonal[i] = (cluster.high.max(other.high) - cluster.low.min(other.low)).length_squared();
            intensity[i] = cluster.intensity + other.intensity;
            let dot = cluster.axis.dot(other.axis);
            cosine[i] = if cluster.two_sided || other.two_sided { dot.abs() } else { dot };
            theta_o[i] = other.theta_o;
            if cluster.oriented || other.oriented {
                direction_scale[i] = self.direction_scale;
            }
        }
        core::array::from_fn(|i| {
            let beta = 0.5 * (cluster.theta_o + theta_o[i] + saoh::acos(cosine[i]));
            let beta = beta.max(cluster.theta_o).max(theta_o[i]);
            let one_minus_cos = one_minus_cos(beta);
            let distance = intensity[i] * (diagonal[i] + direction_scale[i] * one_minus_cos * one_minus_cos);
            // Nothing times infinity: as far as can be.
            if distance.is_nan() { f32::INFINITY } else { distance }
        })
    }

    fn follow(&mut self, place: u32, nearest: u32) {
        self.nearest[place as usize] = nearest;
        self.next_follower[place as usize] = self.first_follower[nearest as usize];
        self.first_follower[nearest as usize] = place;
    }

    /// Joins two clusters at the first one's place, and adds to `searching` who has lost their nearest by it.
    fn join(&mut self, a: u32, b: u32, searching: &mut Vec<u32>) {
        let (place, gone) = (a.min(b), a.max(b));
        let id = self.unions.join(self.clusters[place as usize].id, self.clusters[gone as usize].id);
        let union = self.clusters[place as usize].and(&self.clusters[gone as usize], id);
        self.clusters[place as usize] = union;

        searching.push(place);
        for target in [place, gone] {
            self.nearest[target as usize] = NONE;
            let mut follower = core::mem::replace(&mut self.first_follower[target as usize], NONE);
            while follower != NONE {
                if follower != place && follower != gone {
                    self.nearest[follower as usize] = NONE;
                    searching.push(follower);
                }
                follower = self.next_follower[follower as usize];
            }
        }
        let (before, after) = (self.left[gone as usize], self.right[gone as usize]);
        self.right[before as usize] = after;
        if after != NONE {
            self.left[after as usize] = before;
        }
    }

    /// Forgets what is nearest to what; every cluster that is left has to search.
    fn forget(&mut self) -> Vec<u32> {
        self.nearest.fill(NONE);
        self.first_follower.fill(NONE);
        // Place 0 is always taken: a union lives at its first part's.
        core::iter::successors(Some(0), |&at| Some(self.right[at as usize]).filter(|&at| at != NONE))
            .collect()
    }
}

/// 1 - cos β, `β` cut off at π, as 2 sin²(β/2); the sine is cut off after the seventh power.
#[inline(always)]
fn one_minus_cos(beta: f32) -> f32 {
    let x = 0.5 * beta.min(core::f32::consts::PI);
    let xx = x * x;
    let sine = x * (1.0 - xx * (1.0 / 6.0 - xx * (1.0 / 120.0 - xx / 5040.0)));
    2.0 * sine * sine
}

impl Cluster {
    fn new(bounds: &LightBounds, scale: f64, per_intensity: f64, id: u32) -> Self {
        let scaled = |v: Vec3| (v.as_dvec3() * scale).as_vec3a();
        Self {
            low: scaled(bounds.min),
            high: scaled(bounds.max),
            axis: bounds.axis.normalize_or(Vec3::Z).into(),
            theta_o: saoh::acos(bounds.cos_theta_o),
            intensity: (f64::from(bounds.intensity) * per_intensity) as f32,
            oriented: bounds.cos_theta_o > -1.0,
            two_sided: bounds.two_sided,
            id,
        }
    }

    fn and(&self, other: &Self, id: u32) -> Self {
        let (axis, theta_o) = self.union_of_cones(other);
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            theta_o,
            intensity: self.intensity + other.intensity,
            oriented: self.oriented || other.oriented,
            two_sided: self.two_sided || other.two_sided,
            id,
        }
    }

    /// Axis and half angle of the narrowest cone around both, as far as f32 and [`saoh::acos`] go.
    fn union_of_cones(&self, other: &Self) -> (Vec3A, f32) {
        let (wide, narrow) = if self.theta_o >= other.theta_o { (self, other) } else { (other, self) };
        let cosine = wide.axis.dot(narrow.axis);
        let flip = (wide.two_sided || narrow.two_sided) && cosine < 0.0;
        let (to, cosine) = if flip { (-narrow.axis, -cosine) } else { (narrow.axis, cosine) };
        let between = saoh::acos(cosine);
        let theta_o = 0.5 * (wide.theta_o + between + narrow.theta_o);
        if theta_o <= wide.theta_o {
            return (wide.axis, wide.theta_o);
        }
        // Turn the wide axis towards the other one; the last fallback is for opposite axes.
        let across = to - wide.axis * cosine;
        let across = across.try_normalize().unwrap_or_else(|| wide.axis.any_orthonormal_vector());
        let (sine, cosine) = (theta_o - wide.theta_o).sin_cos();
        let axis = (wide.axis * cosine + across * sine).normalize_or(wide.axis);
        (axis, theta_o.min(core::f32::consts::PI))
    }
}
