//! About how much each of many nodes sends to one receiver: one pass over records, four nodes at a time.
//!
//! A walk asks about two nodes, and each answer decides where it goes next. Here all nodes of a cut are asked
//! at once, so nothing waits for anything, and means take the place of bounds: the light of a box is that of
//! its centre, with cosines averaged over its height above a horizon.
//!
//! Own construction. For a box whose points are between `h - e` and `h + e` above a plane, the mean of the
//! positive part of a height that is spread evenly between them is `h`, or `(h + e)²/(4 e)` where the plane
//! cuts the box, and 0 where all of it is below. Both cosines, at the receiver and at the light, are such
//! heights ÷ distance; a cone of normals adds sin `theta_o` × distance to the spread, and so all normals
//! together have the cosine's mean over a sphere, 1/4.

use glam::{DVec3, Vec3, Vec4};
use lighttree::{LightBounds, Receiver, ScatterLobes, Toward};

/// Nodes side by side in one record.
pub(crate) const LANES: usize = 4;

/// Four nodes, field by field. Lengths are relative to [`Space`].
#[derive(Clone, Copy, Debug)]
struct Record {
    center: [Vec4; 3],
    /// Half the box's sides.
    half: [Vec4; 3],
    /// Squared length of `half`.
    radius_squared: Vec4,
    /// Share of the tree's intensity; 0 for a lane without a node.
    intensity: Vec4,
    axis: [Vec4; 3],
    /// cos and sin of `theta_o`, the sine of all angles from 90° up being 1.
    cos_o: Vec4,
    sin_o: Vec4,
    /// 0: the cosine profile of a surface. 1: the same in all directions up to `theta_o`, as points and spots
    /// are.
    flat: Vec4,
    /// -1: only one side emits. 0: both do.
    one_sided: Vec4,
}

const _: () = assert!(size_of::<Record>() == 240);

impl Record {
    const EMPTY: Self = Self {
        center: [Vec4::ZERO; 3],
        half: [Vec4::ZERO; 3],
        radius_squared: Vec4::ZERO,
        intensity: Vec4::ZERO,
        axis: [Vec4::ZERO; 3],
        cos_o: Vec4::NEG_ONE,
        sin_o: Vec4::ONE,
        flat: Vec4::ONE,
        one_sided: Vec4::NEG_ONE,
    };
}

/// The coordinates of records: a scene of any size and place becomes one about 1 across, around 0.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Space {
    origin: DVec3,
    /// A power of two.
    scale: f64,
}

impl Space {
    fn new(root: &LightBounds) -> Self {
        let (min, max) = (root.min.as_dvec3(), root.max.as_dvec3());
        let size = (max - min).max_element();
        // The power of two of a number that is neither 0 nor infinite: its bits without sign and fraction.
        let power = f64::from_bits(size.to_bits() & 0x7ff0_0000_0000_0000);
        let scale = if size > 0.0 && size < f64::INFINITY { 1.0 / power } else { 1.0 };
        Self { origin: 0.5 * (min + max), scale }
    }

    fn place(&self, position: Vec3) -> DVec3 {
        (position.as_dvec3() - self.origin) * self.scale
    }
}

/// Places farther away than this many times the size of all lights see them as one point.
const FARTHEST: f32 = 1e9;

/// Rounding of a coordinate near 1, and then some.
const ROUNDING: f32 = 1.0 / 2_097_152.0;

/// The least length of an axis along the surface that has a direction.
const LEAST_ALONG: f32 = 1e-6;

/// The least that an oriented node counts for, relative to what it would be unoriented, while some of it may
/// face the receiver.
const LEAST_EMISSION: f32 = 1e-3;

/// What many nodes send to a receiver, up to a factor of all.
///
/// 240 bytes for 4 nodes, 60 a node, and what the vector has spare.
#[derive(Clone, Debug, Default)]
pub struct NodeRecords {
    records: Vec<Record>,
    len: usize,
    space: Option<Space>,
    /// 1 ÷ the tree's intensity.
    unit: f64,
}

impl NodeRecords {
    /// Forgets all nodes, and begins anew for nodes of a tree with this root.
    pub fn begin(&mut self, root: &LightBounds) {
        self.records.clear();
        self.len = 0;
        self.space = Some(Space::new(root));
        let intensity = f64::from(root.intensity);
        self.unit = if intensity > 0.0 { 1.0 / intensity } else { 0.0 };
    }

    /// Nodes noted.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.records.capacity() * size_of::<Record>()
    }

    /// Notes one more node.
    ///
    /// # Panics
    /// Before [`begin`](Self::begin).
    pub fn push(&mut self, node: &LightBounds) {
        let space = self.space.expect("`begin` comes before `push`");
        let (low, high) = (space.place(node.min), space.place(node.max));
        let center = (0.5 * (low + high)).as_vec3();
        let half = (0.5 * (high - low)).as_vec3();
        let lane = self.len % LANES;
        if lane == 0 {
            self.records.push(Record::EMPTY);
        }
        self.len += 1;
        let record = self.records.last_mut().expect("one was pushed");
        for i in 0..3 {
            record.center[i][lane] = center[i];
            record.half[i][lane] = half[i];
            record.axis[i][lane] = node.axis[i];
        }
        record.radius_squared[lane] = half.length_squared();
        record.intensity[lane] = ((f64::from(node.intensity) * self.unit) as f32).max(f32::MIN_POSITIVE);
        let cos = node.cos_theta_o;
        record.cos_o[lane] = cos;
        record.sin_o[lane] = if cos <= 0.0 { 1.0 } else { ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt() };
        record.flat[lane] = if node.cos_theta_e >= 1.0 { 1.0 } else { 0.0 };
        record.one_sided[lane] = if node.two_sided { 0.0 } else { -1.0 };
    }

    /// Writes one weight a node to `out`: about its unoccluded contribution to `receiver`, up to a factor of
    /// all; 0 only for nodes that contribute nothing. Where the numbers are not in the range of f32 the
    /// weights are the intensities.
    pub fn estimate(&self, receiver: &(impl Receiver + ?Sized), out: &mut Vec<f32>) -> NodeEstimate {
        out.clear();
        out.resize(self.records.len() * LANES, 0.0);
        let Some(space) = self.space else { return NodeEstimate::NONE };
        let at = space.place(receiver.position()).as_vec3();
        let is_near = at.is_finite() && at.abs().max_element() <= FARTHEST;
        let sums = is_near.then(|| match receiver.lobes() {
            Some(lobes) => self.estimate_lobes(at, &lobes, out),
            None => self.estimate_any(receiver, at, out),
        });
        let sums = sums.filter(|sums| sums.weight.is_finite() && sums.over_squared.is_finite());
        let estimate = match sums {
            Some(Sums { weight, over_squared }) => {
                let (weight, over) = (f64::from(weight.element_sum()), f64::from(over_squared.element_sum()));
                let near = if weight > 0.0 { over / weight } else { 0.0 };
                NodeEstimate { total: weight, inverse_squared: near * space.scale * space.scale }
            }
            None => {
                for (record, out) in self.records.iter().zip(out.chunks_exact_mut(LANES)) {
                    record.intensity.write_to_slice(out);
                }
                let total = out.iter().map(|&x| f64::from(x)).sum();
                NodeEstimate { total, inverse_squared: f64::INFINITY }
            }
        };
        out.truncate(self.len);
        estimate
    }

    /// The rule: a diffuse part and a lobe.
    fn estimate_lobes(&self, at: Vec3, lobes: &ScatterLobes, out: &mut [f32]) -> Sums {
        let eye = Eye::new(at, lobes);
        if lobes.peak > 0.0 { self.pass::<true>(&eye, out) } else { self.pass::<false>(&eye, out) }
    }

    #[inline]
    fn pass<const GLOSSY: bool>(&self, eye: &Eye<'_>, out: &mut [f32]) -> Sums {
        let mut sums = Sums::default();
        for (record, out) in self.records.iter().zip(out.chunks_exact_mut(LANES)) {
            let (weight, inverse_squared) = eye.weigh::<GLOSSY>(record);
            sums.weight += weight;
            sums.over_squared += weight * inverse_squared;
            weight.write_to_slice(out);
        }
        sums
    }

    /// A receiver of another kind says itself what it scatters, node by node.
    #[cold]
    fn estimate_any(&self, receiver: &(impl Receiver + ?Sized), at: Vec3, out: &mut [f32]) -> Sums {
        let everywhere = ScatterLobes {
            normal: Vec3::ZERO,
            diffuse: 1.0,
            axis: Vec3::ZERO,
            peak: 0.0,
            width_squared: 1.0,
        };
        let eye = Eye::new(at, &everywhere);
        let space = self.space.expect("asked for after `begin`");
        let scattering = |record: &Record, lane: usize| {
            let of = |v: &[Vec4; 3]| Vec3::new(v[0][lane], v[1][lane], v[2][lane]);
            let (center, half) = (of(&record.center), of(&record.half));
            // Wider by what rounding may have taken, and back to where the receiver knows its way.
            let reach = half + Vec3::splat(4.0 * ROUNDING * (1.0 + at.length()));
            let world = |p: Vec3| (p.as_dvec3() / space.scale + space.origin).as_vec3();
            let toward = Toward::new(receiver.position(), world(center - reach), world(center + reach));
            receiver.scatter_importance(&toward)
        };
        let mut sums = Sums::default();
        for (record, out) in self.records.iter().zip(out.chunks_exact_mut(LANES)) {
            let scattered = Vec4::from_array(core::array::from_fn(|lane| scattering(record, lane)));
            let (weight, inverse_squared) = eye.weigh::<false>(record);
            // What vanished as a product has to stay positive.
            let both = weight.cmpgt(Vec4::ZERO) & scattered.cmpgt(Vec4::ZERO);
            let weight =
                Vec4::select(both, (weight * scattered).max(Vec4::splat(f32::MIN_POSITIVE)), Vec4::ZERO);
            sums.weight += weight;
            sums.over_squared += weight * inverse_squared;
            weight.write_to_slice(out);
        }
        sums
    }
}

/// What a pass over all nodes says as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeEstimate {
    /// Sum of the weights.
    pub total: f64,
    /// Mean of 1 ÷ squared distance, by weight, in the scene's own length unit: how fast the estimate changes
    /// with the receiver's place. Infinite where nothing is known of it.
    pub inverse_squared: f64,
}

impl NodeEstimate {
    /// No nodes at all.
    const NONE: Self = Self { total: 0.0, inverse_squared: 0.0 };
}

/// Sums over lanes.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: Vec4,
    over_squared: Vec4,
}

/// A receiver, prepared for one pass.
struct Eye<'a> {
    at: [Vec4; 3],
    normal: [Vec4; 3],
    normal_abs: [Vec4; 3],
    /// Where the lobe is narrowest at a grazing view: unit, perpendicular to the normal and the axis.
    sideways: [Vec4; 3],
    sideways_abs: [Vec4; 3],
    /// The axis as it is along the surface; unit.
    forward: [Vec4; 3],
    /// Perpendicular to the axis and to `sideways`; unit.
    upright_abs: [Vec4; 3],
    /// No horizon.
    everywhere: bool,
    lobes: &'a ScatterLobes,
    /// What rounding may do to a height.
    margin: Vec4,
}

impl<'a> Eye<'a> {
    fn new(at: Vec3, lobes: &'a ScatterLobes) -> Self {
        let splat = |v: Vec3| [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)];
        let everywhere = lobes.normal == Vec3::ZERO;
        let along = lobes.axis - lobes.normal * lobes.normal.dot(lobes.axis);
        let length = along.length();
        let (sideways, forward) = if everywhere || length <= LEAST_ALONG {
            (if everywhere { lobes.axis } else { lobes.normal }).any_orthonormal_pair()
        } else {
            let forward = along / length;
            (lobes.normal.cross(forward), forward)
        };
        Self {
            at: splat(at),
            normal: splat(lobes.normal),
            normal_abs: splat(lobes.normal.abs()),
            sideways: splat(sideways),
            sideways_abs: splat(sideways.abs()),
            forward: splat(forward),
            upright_abs: splat(sideways.cross(lobes.axis).abs()),
            everywhere,
            lobes,
            margin: Vec4::splat(ROUNDING * (1.0 + at.abs().max_element())),
        }
    }

    /// About the mean of the lobe over the directions to the box: `peak` where it is a point in the middle.
    ///
    /// GGX falls with sin² of the angle between the normal and the half vector, whose tangent parts are those
    /// of (light - axis) ÷ |view + light|, since the axis is the view mirrored: no difference of near numbers
    /// but those of directions, where 1 - cos² would leave nothing of a narrow lobe. Sideways the half vector
    /// turns by 1 ÷ |view + light| with the light, up and down by a half; at grazing views these are far
    /// apart, and boxes of windows and walls are flat. So the box widens the lobe each way by its own extent
    /// there, and it is as much lower as it is wider.
    #[inline(always)]
    fn lobe(&self, v: &[Vec4; 3], half: &[Vec4; 3], inverse: Vec4) -> Vec4 {
        let axis = self.lobes.axis;
        let off = [v[0] * inverse - axis.x, v[1] * inverse - axis.y, v[2] * inverse - axis.z];
        let sideways = dot(&off, &self.sideways);
        let sideways_squared = sideways * sideways;
        let (upright_squared, sum_squared) = if self.everywhere {
            ((dot(&off, &off) - sideways_squared).max(Vec4::ZERO), Vec4::splat(4.0))
        } else {
            let forward = dot(&off, &self.forward);
            let height = (dot(v, &self.normal) * inverse).max(Vec4::ZERO) + self.lobes.normal.dot(axis);
            let sum_squared = sideways_squared + forward * forward + height * height;
            (forward * forward, sum_squared.max(Vec4::splat(ScatterLobes::LEAST_SUM)))
        };
        let per_sum = sum_squared.recip();

        // Squared widths, in half vectors.
        let own = Vec4::splat(self.lobes.width_squared);
        let extent = |along: &[Vec4; 3]| dot(half, along) * inverse;
        let (wide, high) = (extent(&self.sideways_abs), extent(&self.upright_abs));
        let across = (own + wide * wide * per_sum).min(Vec4::ONE);
        let up = (own + 0.25 * high * high).min(Vec4::ONE);
        let fall_across = sideways_squared * (Vec4::ONE - across) / across;
        let fall_up = upright_squared * (Vec4::ONE - up) / up;
        let fall = (Vec4::ONE + per_sum * (fall_across + fall_up)).recip();
        self.lobes.peak * own * (across * up).sqrt().recip() * fall * fall
    }

    #[inline(always)]
    fn weigh<const GLOSSY: bool>(&self, node: &Record) -> (Vec4, Vec4) {
        let v = [node.center[0] - self.at[0], node.center[1] - self.at[1], node.center[2] - self.at[2]];
        let squared = dot(&v, &v);
        let distance = squared.sqrt();
        let reach = distance + node.radius_squared.sqrt();
        // As if everything were at the centre, but no nearer than half the box's diagonal / √2.
        let effective = squared.max(0.5 * node.radius_squared).max(Vec4::splat(f32::MIN_POSITIVE));
        let inverse = effective.sqrt().recip();

        // Mean cosine at the receiver; positive unless the box is below the horizon.
        let spread = self.margin + ROUNDING * reach;
        let (above, height, around) = if self.everywhere {
            (Vec4::ONE, Vec4::ONE, Vec4::ONE)
        } else {
            let height = dot(&v, &self.normal);
            let around = dot(&node.half, &self.normal_abs) + spread;
            (mean_above(height, around) * inverse, height, around)
        };
        let mut scattered = above.min(Vec4::ONE) * self.lobes.diffuse;
        if GLOSSY {
            let lobe = self.lobe(&v, &node.half, inverse);
            let gate = if self.everywhere {
                Vec4::ONE
            } else {
                ((height + around) / (2.0 * around)).clamp(Vec4::ZERO, Vec4::ONE)
            };
            scattered += lobe * gate;
        }

        // Mean cosine at the lights.
        let toward = -dot(&v, &node.axis);
        let sides = node.one_sided.cmpge(Vec4::ZERO);
        let facing = Vec4::select(sides, toward.abs(), toward);
        let axis_abs = [node.axis[0].abs(), node.axis[1].abs(), node.axis[2].abs()];
        let extent = dot(&node.half, &axis_abs) + spread;
        let mean = facing * (0.5 * (Vec4::ONE + node.cos_o));
        let spread_of_normals = extent + node.sin_o * distance;
        let back = Vec4::select(sides, mean_above(-mean, spread_of_normals), Vec4::ZERO);
        let emitted = ((mean_above(mean, spread_of_normals) + back) * inverse)
            .clamp(Vec4::splat(LEAST_EMISSION), Vec4::ONE);
        let all = node.cos_o.cmple(Vec4::ZERO);
        let faces = all | (node.cos_o * (facing + extent) + node.sin_o * reach).cmpgt(Vec4::ZERO);
        // Flat profiles: whether the nearest direction is within the cone.
        let nearest = 2.0 * distance - reach - spread;
        let edge = Vec4::select(all, reach + spread, nearest.max(Vec4::ZERO));
        let within = (facing + extent).cmpge(node.cos_o * edge) | node.cos_o.cmple(Vec4::NEG_ONE);
        let is_flat = node.flat.cmpgt(Vec4::ZERO);
        let emitted = Vec4::select(is_flat, Vec4::ONE, emitted);
        let emits = (is_flat & within) | (!is_flat & faces);

        let inverse_squared = inverse * inverse;
        let weight = node.intensity * emitted * scattered * inverse_squared;
        let possible = emits & scattered.cmpgt(Vec4::ZERO) & node.intensity.cmpgt(Vec4::ZERO);
        (Vec4::select(possible, weight.max(Vec4::splat(f32::MIN_POSITIVE)), Vec4::ZERO), inverse_squared)
    }
}

#[inline(always)]
fn dot(a: &[Vec4; 3], b: &[Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Mean of the positive part of what is spread evenly between `h - e` and `h + e`, for `e` > 0.
#[inline(always)]
fn mean_above(h: Vec4, e: Vec4) -> Vec4 {
    let part = (h + e).max(Vec4::ZERO);
    Vec4::select(h.cmpge(e), h, 0.25 * part * part / e)
}
