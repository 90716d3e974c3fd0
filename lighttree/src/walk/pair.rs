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

use super::sphere::Sphere;
use crate::{LightBounds, Receiver, ScatterLobes};

/// A receiver, prepared for walks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    position: Vec3,
    /// Power of two that scales lengths to about the larger of the scene and its distance.
    scale: f32,
    /// The least squared distance that a sampler tells from others, scaled.
    pub(super) least_squared: f32,
    lobes: Option<ScatterLobes>,
}

/// What decides between two children, of two pairs; lengths are scaled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Both {
    /// Emission × scattering, each, up to a factor of both siblings; 0 only for nodes that cannot contribute.
    strength: [f32; 4],
    near_squared: [f32; 4],
    far_squared: [f32; 4],
    center_squared: [f32; 4],
    diagonal_squared: [f32; 4],
    /// A bit for each lane in which rounding decides nothing.
    sure: u32,
}

/// What decides between two children; lengths are scaled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighed {
    /// Intensity × emission × scattering, each, up to a factor of both; 0 only for nodes that cannot
    /// contribute.
    pub(super) strength: [f64; 2],
    /// Squared distances to the nearest point of each box, but not below the least unless 0.
    pub(super) near_squared: [f32; 2],
    /// Squared distances to the farthest point of each box, but not below the least.
    pub(super) far_squared: [f32; 2],
    /// Four times the squared distances to the boxes' centres.
    pub(super) center_squared: [f32; 2],
    /// Squared lengths of the boxes' diagonals.
    pub(super) diagonal_squared: [f32; 2],
}

impl Both {
    /// Pair `I`, of these siblings; `None` where rounding might decide.
    #[inline(always)]
    pub(super) fn of<const I: usize>(&self, pair: &Siblings<'_>) -> Option<Weighed> {
        if self.sure >> (2 * I) & 0b11 != 0b11 {
            return None;
        }
        let of = |values: &[f32; 4]| [values[2 * I], values[2 * I + 1]];
        let [a, b] = of(&self.strength);
        Some(Weighed {
            strength: [
                f64::from(pair.first.intensity) * f64::from(a),
                f64::from(pair.second.intensity) * f64::from(b),
            ],
            near_squared: of(&self.near_squared),
            far_squared: of(&self.far_squared),
            center_squared: of(&self.center_squared),
            diagonal_squared: of(&self.diagonal_squared),
        })
    }
}

/// Two siblings and who looks at them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Siblings<'a> {
    pub(super) viewpoint: &'a Viewpoint,
    pub(super) first: &'a LightBounds,
    pub(super) second: &'a LightBounds,
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

/// Weighs two pairs. `scatter` is asked about nodes seen by a receiver without
/// [`lobes`](Viewpoint::has_lobes), in which case both have to be the same.
#[inline(always)]
pub(super) fn weigh(pairs: [&Siblings<'_>; 2], scatter: impl Fn(&LightBounds) -> f32) -> Both {
    let scale = of_views(pairs, |view| view.scale);
    let position = Lanes {
        x: of_views(pairs, |view| view.position.x),
        y: of_views(pairs, |view| view.position.y),
        z: of_views(pairs, |view| view.position.z),
    };
    let low = Lanes {
        x: (of_nodes(pairs, |node| node.min.x) - position.x) * scale,
        y: (of_nodes(pairs, |node| node.min.y) - position.y) * scale,
        z: (of_nodes(pairs, |node| node.min.z) - position.z) * scale,
    };
    let high = Lanes {
        x: (of_nodes(pairs, |node| node.max.x) - position.x) * scale,
        y: (of_nodes(pairs, |node| node.max.y) - position.y) * scale,
        z: (of_nodes(pairs, |node| node.max.z) - position.z) * scale,
    };
    let near_squared = low.with(high, |low, high| low.max(-high).max(Vec4::ZERO)).dot_self();
    let far_squared = low.with(high, |low, high| high.max(-low)).dot_self();
    let mut sure = far_squared.cmpge(Vec4::splat(SMALLEST)) & far_squared.cmple(Vec4::splat(LARGEST));

    let sphere = Sphere::around(low, high);
    let everywhere = |pair: &Siblings<'_>| pair.first.cos_theta_o <= -1.0 && pair.second.cos_theta_o <= -1.0;
    let (emitted, of) = if everywhere(pairs[0]) && everywhere(pairs[1]) {
        (Vec4::ONE, Vec4::ONE)
    } else {
        let axis = Lanes {
            x: of_nodes(pairs, |node| node.axis.x),
            y: of_nodes(pairs, |node| node.axis.y),
            z: of_nodes(pairs, |node| node.axis.z),
        };
        let two_sided = of_nodes(pairs, |node| if node.two_sided { -1.0 } else { 1.0 }).cmplt(Vec4::ZERO);
        sphere.emission(
            axis,
            of_nodes(pairs, |node| node.cos_theta_o),
            of_nodes(pairs, |node| node.cos_theta_e),
            two_sided,
        )
    };
    // Spheres and boxes disagree about the last of a cone: what is left out altogether is for f64 to say.
    sure &= emitted.cmpgt(Vec4::ZERO);

    let factor = if let (Some(a), Some(b)) = (&pairs[0].viewpoint.lobes, &pairs[1].viewpoint.lobes) {
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
        let ask = |lane: usize, node| if emitted[lane] > 0.0 { scatter(node) } else { 0.0 };
        let (first, second) = (ask(0, pairs[0].first), ask(1, pairs[0].second));
        let scattered = Vec4::new(first, second, first, second);
        // Where it is infinite, f64 sorts it out.
        let both = emitted * scattered;
        sure &= both.is_finite_mask() & !(both.cmpgt(Vec4::ZERO) ^ scattered.cmpgt(Vec4::ZERO));
        both
    };

    // Distances that are too small to tell apart, but for those inside.
    let least = of_views(pairs, |view| view.least_squared);
    let near_squared = Vec4::select(near_squared.cmpgt(Vec4::ZERO), near_squared.max(least), Vec4::ZERO);
    Both {
        strength: factor.to_array(),
        near_squared: near_squared.to_array(),
        far_squared: far_squared.max(least).to_array(),
        center_squared: sphere.squared.to_array(),
        diagonal_squared: sphere.radius_squared.to_array(),
        sure: sure.bitmask(),
    }
}

/// A number of each node.
#[inline(always)]
fn of_nodes(pairs: [&Siblings<'_>; 2], f: impl Fn(&LightBounds) -> f32) -> Vec4 {
    let [a, b] = pairs;
    Vec4::new(f(a.first), f(a.second), f(b.first), f(b.second))
}

/// A number of each receiver.
#[inline(always)]
fn of_views(pairs: [&Siblings<'_>; 2], f: impl Fn(&Viewpoint) -> f32) -> Vec4 {
    let (a, b) = (f(pairs[0].viewpoint), f(pairs[1].viewpoint));
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
