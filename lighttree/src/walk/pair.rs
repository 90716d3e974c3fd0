//! Two pairs of siblings weighed together, in four lanes of f32.
//!
//! What [`BoundTerms::importance`](crate::BoundTerms::importance) says with f64 and the smallest angles to a
//! box, this says at a fraction of the cost, roughly. Differs from it:
//! - Differences of coordinates are formed as they are (f32 rounds them, but never to a wrong sign, and those
//!   of near numbers not at all), and then scaled by a power of two that makes the scene as seen from the
//!   receiver about 1 across. So scale changes no bit, and squares have room.
//! - Angles to a cone or a lobe are those to the bounding sphere of the box (Conty Estévez and Kulla 2018).
//! - No division but one for all four; cosines stay fractions until then.
//!
//! A node is weighed 0 only where it cannot contribute: within the rounding errors of f32 around a horizon
//! the answer is `None`, and the caller asks in f64.
//!
//! No lane looks at another, so a pair gets the same bits whatever stands beside it: a walk alone gives the
//! same pair twice.

use glam::{BVec4A, Vec3, Vec4};

use super::choice::Fork;
use super::sphere::Sphere;
use crate::{FourBounds, Receiver, ScatterLobes};

/// A receiver, prepared for walks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    position: Vec3,
    /// Power of two that scales lengths to about the larger of the scene and its distance.
    scale: f32,
    /// The least squared distance that a sampler tells from others, scaled.
    least_squared: f32,
    lobes: Option<ScatterLobes>,
}

/// What decides between two children, of two pairs; lengths are scaled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Both {
    pub(super) intensity: Vec4,
    /// Emission × scattering, each, up to a factor of both siblings; 0 only for nodes that cannot contribute.
    pub(super) strength: Vec4,
    /// Squared distances to the nearest point of each box, but not below the least unless 0.
    pub(super) near_squared: Vec4,
    /// Squared distances to the farthest point of each box, but not below the least.
    pub(super) far_squared: Vec4,
    /// Four times the squared distances to the boxes' centres.
    pub(super) center_squared: Vec4,
    /// Squared lengths of the boxes' diagonals.
    pub(super) diagonal_squared: Vec4,
    /// The least squared distance of each receiver.
    pub(super) least_squared: Vec4,
    /// A bit for each lane in which rounding decides nothing.
    sure: u32,
    /// A bit for each lane that may contribute.
    alive: u32,
}

impl Both {
    /// What becomes of pair `I`, `first` being the probability of the first if both may contribute; `None`
    /// where rounding might decide.
    #[inline(always)]
    pub(super) fn fork<const I: usize>(&self, first: u32) -> Option<Fork> {
        let of = |mask: u32| mask >> (2 * I) & 0b11;
        (of(self.sure) == 0b11).then(|| match of(self.alive) {
            0b11 => Fork::Either(first),
            0b01 => Fork::Only(true),
            0b10 => Fork::Only(false),
            _ => Fork::Dead,
        })
    }
}

/// A vector in each lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes {
    pub(super) x: Vec4,
    pub(super) y: Vec4,
    pub(super) z: Vec4,
}

/// Relative error of a scaled height above a plane, and then some: five roundings.
const HEIGHT_ERROR: f32 = 8.0 / 16_777_216.0;

/// Farthest squared distances, scaled, within which squares of products neither over- nor underflow.
const SMALLEST: f32 = 1e-14;
const LARGEST: f32 = 1e8;

impl Viewpoint {
    /// `root` is the box of all lights; squared distances below `least_squared` count as that. `None` where
    /// lengths span more than f32 does.
    #[inline]
    pub(super) fn new<R: Receiver + ?Sized>(
        receiver: &R,
        root: &(Vec3, Vec3),
        least_squared: f64,
    ) -> Option<Self> {
        let position = receiver.position();
        let far = (root.1 - position).abs().max((root.0 - position).abs()).max_element();
        // The largest power of two that is not above it; -126..=126 leaves room for its inverse.
        let exponent = (far.to_bits() >> 23) as i32 - 127;
        if !(-126..=126).contains(&exponent) {
            return None;
        }
        let scale = f32::from_bits(((127 - exponent) as u32) << 23);
        // Out of range only where all lights are at one place, and their distances the same in any case.
        let least_squared =
            (least_squared * f64::from(scale) * f64::from(scale)).min(f64::from(LARGEST)) as f32;
        Some(Self { position, scale, least_squared, lobes: receiver.lobes() })
    }

    /// Whether it may be weighed together with others.
    #[inline]
    pub(super) fn has_lobes(&self) -> bool {
        self.lobes.is_some()
    }
}

/// Weighs two pairs, each as seen by its viewpoint. `scatter` is asked about the first and the second node if
/// the receiver has no [`lobes`](Viewpoint::has_lobes), in which case both pairs have to be the same.
#[inline(always)]
pub(super) fn weigh(views: [&Viewpoint; 2], nodes: &FourBounds, scatter: impl Fn(usize) -> f32) -> Both {
    let scale = of_views(views, |view| view.scale);
    let position = Lanes {
        x: of_views(views, |view| view.position.x),
        y: of_views(views, |view| view.position.y),
        z: of_views(views, |view| view.position.z),
    };
    let seen = |[x, y, z]: [Vec4; 3]| Lanes {
        x: (x - position.x) * scale,
        y: (y - position.y) * scale,
        z: (z - position.z) * scale,
    };
    let (low, high) = (seen(nodes.min), seen(nodes.max));
    let near_squared = low.with(high, |low, high| low.max(-high).max(Vec4::ZERO)).dot_self();
    let far_squared = low.with(high, |low, high| high.max(-low)).dot_self();
    let mut sure = far_squared.cmpge(Vec4::splat(SMALLEST)) & far_squared.cmple(Vec4::splat(LARGEST));

    let sphere = Sphere::around(low, high);
    let (emitted, of) = match &nodes.cones {
        None => (Vec4::ONE, Vec4::ONE),
        Some(cones) => {
            let [x, y, z] = cones.axis;
            sphere.emission(Lanes { x, y, z }, cones.cos_theta_o, cones.cos_theta_e, cones.two_sided)
        }
    };
    // Spheres and boxes disagree about the last of a cone: what is left out altogether is for f64 to say,
    // unless both are the same point.
    sure &= emitted.cmpgt(Vec4::ZERO) | sphere.radius_squared.cmpeq(Vec4::ZERO);

    let factor = if let (Some(a), Some(b)) = (&views[0].lobes, &views[1].lobes) {
        let normal = Lanes {
            x: of_lobes(a, b, |lobes| lobes.normal.x),
            y: of_lobes(a, b, |lobes| lobes.normal.y),
            z: of_lobes(a, b, |lobes| lobes.normal.z),
        };
        let cos = RoughCos::new(low, high, normal, near_squared, far_squared);
        sure &= cos.sure;
        let mut scattered = of_lobes(a, b, |lobes| lobes.diffuse) * cos.height;
        if a.peak > 0.0 || b.peak > 0.0 {
            let axis = Lanes {
                x: of_lobes(a, b, |lobes| lobes.axis.x),
                y: of_lobes(a, b, |lobes| lobes.axis.y),
                z: of_lobes(a, b, |lobes| lobes.axis.z),
            };
            let width_squared = of_lobes(a, b, |lobes| lobes.width_squared);
            let lobe = of_lobes(a, b, |lobes| lobes.peak) * sphere.lobe(normal, axis, width_squared);
            let lobe = lobe * cos.distance;
            scattered = Vec4::select(cos.height.cmpgt(Vec4::ZERO), scattered + lobe, Vec4::ZERO);
        }
        emitted * scattered / (of * cos.distance)
    } else {
        let emitted = emitted / of;
        let ask = |lane: usize| if emitted[lane] > 0.0 { scatter(lane) } else { 0.0 };
        let (first, second) = (ask(0), ask(1));
        let scattered = Vec4::new(first, second, first, second);
        // Where it is infinite, f64 sorts it out.
        let both = emitted * scattered;
        sure &= both.is_finite_mask() & !(both.cmpgt(Vec4::ZERO) ^ scattered.cmpgt(Vec4::ZERO));
        both
    };

    // Distances that are too small to tell apart, but for those inside.
    let least = of_views(views, |view| view.least_squared);
    let near_squared = Vec4::select(near_squared.cmpgt(Vec4::ZERO), near_squared.max(least), Vec4::ZERO);
    Both {
        intensity: nodes.intensity,
        strength: factor,
        near_squared,
        far_squared: far_squared.max(least),
        center_squared: sphere.squared,
        diagonal_squared: sphere.radius_squared,
        least_squared: least,
        sure: sure.bitmask(),
        alive: (factor.cmpgt(Vec4::ZERO) & nodes.intensity.cmpgt(Vec4::ZERO)).bitmask(),
    }
}

/// A number of each receiver.
#[inline(always)]
fn of_views(views: [&Viewpoint; 2], f: impl Fn(&Viewpoint) -> f32) -> Vec4 {
    let (a, b) = (f(views[0]), f(views[1]));
    Vec4::new(a, a, b, b)
}

/// A number of each receiver's lobes.
#[inline(always)]
fn of_lobes(a: &ScatterLobes, b: &ScatterLobes, f: impl Fn(&ScatterLobes) -> f32) -> Vec4 {
    let (a, b) = (f(a), f(b));
    Vec4::new(a, a, b, b)
}

impl Lanes {
    #[inline]
    pub(super) fn with(self, other: Self, f: impl Fn(Vec4, Vec4) -> Vec4) -> Self {
        Self { x: f(self.x, other.x), y: f(self.y, other.y), z: f(self.z, other.z) }
    }

    #[inline]
    pub(super) fn dot(self, v: Self) -> Vec4 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }

    #[inline]
    pub(super) fn dot_self(self) -> Vec4 {
        self.dot(self)
    }

    #[inline]
    pub(super) fn cross(self, v: Self) -> Self {
        Self {
            x: self.y * v.z - self.z * v.y,
            y: self.z * v.x - self.x * v.z,
            z: self.x * v.y - self.y * v.x,
        }
    }
}

/// [`Toward::rough_max_cos`](crate::Toward::rough_max_cos) as a fraction: 0 where all of a box is below the
/// horizon, 1/1 for a zero vector.
struct RoughCos {
    height: Vec4,
    distance: Vec4,
    sure: BVec4A,
}

impl RoughCos {
    /// To the unit vectors `n`, or zero.
    #[inline]
    fn new(low: Lanes, high: Lanes, n: Lanes, near_squared: Vec4, far_squared: Vec4) -> Self {
        let highest = |low: Vec4, high: Vec4, n: Vec4| (low * n).max(high * n);
        let height = highest(low.x, high.x, n.x) + highest(low.y, high.y, n.y) + highest(low.z, high.z, n.z);
        let along = low.with(high, |low, high| low.max(Vec4::ZERO) + high.min(Vec4::ZERO)).dot(n);
        let aside = (near_squared - along * along).max(Vec4::ZERO);
        let distance = (height * height + aside).sqrt();
        let sure = (height * height).cmpgt(HEIGHT_ERROR * HEIGHT_ERROR * far_squared);

        let none = n.x.cmpeq(Vec4::ZERO) & n.y.cmpeq(Vec4::ZERO) & n.z.cmpeq(Vec4::ZERO);
        Self {
            height: Vec4::select(none, Vec4::ONE, height.max(Vec4::ZERO)),
            distance: Vec4::select(none, Vec4::ONE, distance),
            sure: sure | none,
        }
    }
}
