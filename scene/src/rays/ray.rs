//! A ray made ready for the tree, and the memory a traversal needs.

use glam::{Vec3, Vec4};
use lighttree::{Ray, Segment};

use super::group::GROUP;
use super::node::STACK;

/// How far slabs are padded, in units of the rounding of the largest coordinate: the subtractions, products
/// and quotients of slab and triangle test together round by less than six of them.
pub(super) const PADDING: f32 = 8.0 * f32::EPSILON;

/// Directions in the tree's own scale below this are lengthened, or their inverses would overflow.
pub(super) const SHORT: f32 = 1e-20;

/// Traversal stacks, reused from ray to ray: clearing them for each costs 10 to 20 ns. One per thread.
pub struct Scratch {
    pub(super) single: [u32; STACK],
    pub(super) near: [(u32, f32); STACK],
    pub(super) group: [(u32, u64); STACK],
    /// Rays that walk together.
    pub(super) bundle: [Traced; GROUP],
    /// Of the tree over instances, while another is used inside a mesh.
    pub(super) top: [(u32, f32); STACK],
    /// The same for rays that walk together.
    pub(super) top_group: TopGroup,
}

/// What rays that walk together through the tree over instances need, while [`Scratch::group`] is used inside
/// a mesh. Grows once.
#[derive(Default)]
pub(super) struct TopGroup {
    pub(super) stack: Vec<(u32, u64)>,
    pub(super) rays: Vec<Traced>,
    /// By ray, its place among the targets.
    pub(super) index: Vec<u32>,
    /// Of those that reach an instance: number of the ray, target in the mesh's space, answer.
    pub(super) which: Vec<u32>,
    pub(super) targets: Vec<Vec3>,
    pub(super) blocked: Vec<bool>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self {
            single: [0; STACK],
            near: [(0, 0.0); STACK],
            group: [(0, 0); STACK],
            bundle: [Traced::default(); GROUP],
            top: [(0, 0.0); STACK],
            top_group: TopGroup::default(),
        }
    }
}

/// A ray in the tree's own scale with all that does not change on its way.
///
/// `enter` and `leave` are the origin moved outwards on both sides of every slab. That is the padding: per
/// ray rather than per box, so it is right for origins far outside too, and costs nothing in the loop.
#[derive(Clone, Copy, Default)]
pub(super) struct Traced {
    pub(super) origin: [f32; 3],
    /// Exclusive end.
    pub(super) t_max: f32,
    /// 0 where the low plane of an axis is entered first, else 1.
    pub(super) side: [usize; 3],
    pub(super) inverse: [f32; 3],
    /// Slabs: `(plane - enter) · inverse`.
    pub(super) enter: [f32; 3],
    pub(super) leave: [f32; 3],
    /// The same for fused operations: `plane · inverse - enter_scaled`.
    pub(super) enter_scaled: [f32; 3],
    pub(super) leave_scaled: [f32; 3],
    /// Triangle test: the axes, the dominant one last, ...
    pub(super) axis: [usize; 3],
    /// ... and the shear that turns the ray into it.
    pub(super) shear: [f32; 3],
}

/// The tree's own scale: its coordinates are the user's times `factor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// A power of two.
    pub(super) factor: f32,
    /// Largest coordinate of the tree in its own scale, in [0.5, 1) (0 of an empty tree); with `PADDING` in
    /// the slabs.
    pub(super) reach: f32,
    /// [`PADDING`], a parameter so that a test can see what happens without.
    pub(super) padding: f32,
}

impl Scale {
    /// The scale for coordinates up to `largest`.
    pub(super) fn of(largest: f32) -> Self {
        let factor = if largest > 0.0 { power_of_two(-1 - exponent(largest)) } else { 1.0 };
        Self { factor, reach: largest * factor, padding: PADDING }
    }
}

/// `e` such that `2^e <= a < 2^(e+1)`, `a` positive and finite.
fn exponent(a: f32) -> i32 {
    let biased = (a.to_bits() >> 23) as i32;
    if biased > 0 { biased - 127 } else { ((a * power_of_two(64)).to_bits() >> 23) as i32 - 127 - 64 }
}

/// `2^e`, held inside the range of normal numbers.
fn power_of_two(e: i32) -> f32 {
    f32::from_bits(((e.clamp(-126, 127) + 127) as u32) << 23)
}

/// What a ray's `t` is multiplied by to become the tree's, a power of two. In f64, where the quotient of two
/// such can't overflow.
#[derive(Clone, Copy)]
pub(super) struct Unit(f64);

impl Unit {
    /// The tree's `t` in the user's unit.
    #[inline(always)]
    pub(super) fn user(self, t: f32) -> f32 {
        (f64::from(t) / self.0) as f32
    }

    /// The user's `t` in the tree's unit.
    pub(super) fn tree(self, t: f32) -> f32 {
        (f64::from(t) * self.0) as f32
    }
}

impl Traced {
    /// A segment; `None` where nothing can be hit: not finite, or of no length.
    #[inline(always)]
    pub(super) fn segment(segment: &Segment, scale: &Scale) -> Option<Self> {
        let origin = segment.from * scale.factor;
        let direction = segment.to * scale.factor - origin;
        if direction.abs().max_element() < SHORT {
            return Self::new(origin, direction * power_of_two(64), power_of_two(-64), scale);
        }
        Self::new(origin, direction, 1.0, scale)
    }

    /// A ray and the unit of its `t`. The direction is brought to a length near 1 by a power of two, so `t`
    /// cannot overflow inside the tree whatever the direction's length.
    #[inline(always)]
    pub(super) fn ray(ray: &Ray, scale: &Scale) -> Option<(Self, Unit)> {
        let length = ray.direction.abs().max_element();
        if !(length > 0.0 && length < f32::INFINITY) {
            return None;
        }
        let (e, s) = (exponent(length), f64::from(scale.factor));
        // Two steps, since 2^-e is no normal number for the shortest directions.
        let half = -e / 2;
        let direction = ray.direction * power_of_two(half) * power_of_two(-e - half);
        let unit = s * f64::from(power_of_two(e / 2)) * f64::from(power_of_two(e - e / 2));
        let traced =
            Self::new(ray.origin * scale.factor, direction, (f64::from(ray.t_max) * unit) as f32, scale)?;
        Some((traced, Unit(unit)))
    }

    /// All in the tree's own scale; the direction not shorter than [`SHORT`].
    #[inline(always)]
    pub(super) fn new(origin: Vec3, direction: Vec3, t_max: f32, scale: &Scale) -> Option<Self> {
        let (o, d, a) = (origin.to_array(), direction.to_array(), direction.abs().to_array());
        let z = if a[0] > a[1] {
            if a[0] > a[2] { 0 } else { 2 }
        } else if a[1] > a[2] {
            1
        } else {
            2
        };
        // All three axes in one register: four scalar divisions are a tenth of what a short ray costs. A
        // relative floor: infinities would meet in `plane · inverse - scaled`. It bends the ray by 1e-12 of
        // its length at most, and leaves the dominant axis as it is.
        let towards = direction.extend(0.0);
        let inverse = towards.abs().max(Vec4::splat(1e-12 * a[z])).copysign(towards).recip();
        let far = o[0].abs().max(o[1].abs()).max(o[2].abs());
        let inverse_z = inverse[z];
        // False where anything is not a number; `max` alone would drop it.
        let sum = (o[0] + o[1] + o[2]).abs() + (a[0] + a[1] + a[2]) + inverse_z.abs();
        if !(sum < f32::INFINITY && t_max > 0.0) {
            return None;
        }

        let outward = Vec4::splat(scale.padding * (far + scale.reach)).copysign(towards);
        let (enter, leave) = (origin.extend(0.0) + outward, origin.extend(0.0) - outward);
        let three = |v: Vec4| v.truncate().to_array();
        let negative = towards.is_negative_bitmask() as usize;
        let [x, y] = [(z + 1) % 3, (z + 2) % 3];
        let ray = Self {
            origin: o,
            t_max,
            side: [negative & 1, negative >> 1 & 1, negative >> 2 & 1],
            inverse: three(inverse),
            enter: three(enter),
            leave: three(leave),
            enter_scaled: three(enter * inverse),
            leave_scaled: three(leave * inverse),
            axis: [x, y, z],
            shear: [d[x] * inverse_z, d[y] * inverse_z, inverse_z],
        };
        Some(ray)
    }
}
