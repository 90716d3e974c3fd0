//! Bounds of eight nodes at once, none below the exact one: which nodes of a cut need a closer look from one
//! receiver?
//!
//! [`GeometricBound`](lighttree::GeometricBound) takes a hundred nanoseconds and more, most of it for the
//! largest cosines of two axes to a box. An interpolated cut has hundreds of nodes, and nearly all of them
//! are well below what a receiver tolerates. Here a cosine's bound is the highest point of the box over its
//! nearest one, in f32 with all rounding upwards: some nanoseconds a node, and what is not surely tolerated
//! is left to the exact bound. So the answer is the exact bound's own.

use glam::{DVec3, Vec3};
use lighttree::{LambertReceiver, LightBounds, PhongReceiver};

/// Nodes that are looked at together.
const LANES: usize = 8;

/// Part of the farthest distance by which the rounded height of a box over a plane may be off; eight
/// roundings of f32.
const SLACK: f32 = 2e-6;

/// Squared distances from here on may hide an overflow.
const FAR: f32 = 1e30;

/// A receiver with a diffuse part and at most one Phong lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuickReceiver {
    position: Vec3,
    normal: Vec3,
    /// 1 where there is no normal: every cosine counts as 1.
    bias: f32,
    /// Albedo / π, sr⁻¹.
    diffuse: f32,
    /// The mirrored view.
    axis: Vec3,
    /// The lobe at its axis, sr⁻¹, rounding of its power included.
    peak: f32,
    /// What the exponent is at least: the power is no smaller for it.
    exponent: u32,
    /// The cosine whose power is e⁻⁶⁰, the least that a power counts as: nothing is too small for a fast
    /// multiplication.
    least: f32,
}

impl From<&LambertReceiver> for QuickReceiver {
    fn from(receiver: &LambertReceiver) -> Self {
        let &LambertReceiver { position, normal, albedo } = receiver;
        let (normal, bias) = unit_or_any(normal);
        let diffuse = albedo * core::f32::consts::FRAC_1_PI;
        Self { position, normal, bias, diffuse, axis: Vec3::ZERO, peak: 0.0, exponent: 0, least: 1.0 }
    }
}

impl From<&PhongReceiver> for QuickReceiver {
    fn from(receiver: &PhongReceiver) -> Self {
        let &PhongReceiver { position, normal, view, diffuse, specular, exponent } = receiver;
        let base = Self::from(&LambertReceiver { position, normal, albedo: diffuse });
        let (n, v) = (normal.as_dvec3().normalize_or_zero(), view.as_dvec3().normalize_or_zero());
        let whole = exponent as u32;
        Self {
            axis: (2.0 * n.dot(v) * n - v).as_vec3(),
            // Two roundings a multiplication.
            peak: specular * (exponent + 2.0) / core::f32::consts::TAU * (1.0 + 4e-7 * exponent),
            exponent: whole,
            least: (-60.0 / f64::from(whole.max(1))).exp() as f32,
            ..base
        }
    }
}

/// A unit vector, and 1 where there is none.
fn unit_or_any(normal: Vec3) -> (Vec3, f32) {
    let unit = normal.as_dvec3().normalize_or_zero();
    (unit.as_vec3(), if unit == DVec3::ZERO { 1.0 } else { 0.0 })
}

/// Bounds of many nodes, to be asked from many receivers.
///
/// Memory: 48 bytes a node, in blocks of eight.
#[derive(Clone, Debug, Default)]
pub struct QuickBounds {
    lanes: Vec<Lanes>,
    len: usize,
}

/// Eight nodes, one number after the other.
#[derive(Clone, Copy, Debug, Default)]
struct Lanes {
    min: [[f32; LANES]; 3],
    max: [[f32; LANES]; 3],
    /// Against the light: a receiver looks along it.
    axis: [[f32; LANES]; 3],
    /// Of the cone of normals; -1 where everything may be lit.
    cos: [f32; LANES],
    sin: [f32; LANES],
    intensity: [f32; LANES],
}

impl QuickBounds {
    /// Takes all nodes out and keeps the memory.
    pub fn clear(&mut self) {
        self.lanes.clear();
        self.len = 0;
    }

    /// Adds a node. Its intensity may be in any unit.
    pub fn push(&mut self, node: &LightBounds) {
        let lane = self.len % LANES;
        if lane == 0 {
            self.lanes.push(Lanes::default());
        }
        self.len += 1;
        let Some(lanes) = self.lanes.last_mut() else { return };
        let (axis, no_axis) = unit_or_any(-node.axis);
        let everywhere = node.two_sided || no_axis > 0.0 || !(node.cos_theta_o > -1.0 && axis.is_finite());
        let cos = if everywhere { -1.0 } else { node.cos_theta_o };
        for i in 0..3 {
            lanes.min[i][lane] = node.min[i];
            lanes.max[i][lane] = node.max[i];
            lanes.axis[i][lane] = if everywhere { 0.0 } else { axis[i] };
        }
        lanes.cos[lane] = cos;
        lanes.sin[lane] = (1.0 - f64::from(cos).powi(2)).max(0.0).sqrt() as f32;
        lanes.intensity[lane] = node.intensity;
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whose bound may be above `limit` at `receiver`: bit `i % 8` of byte `i / 8` for the `i`-th node;
    /// replaces what is in `above`. A bit that is not set says that the exact bound is at most `limit`. For
    /// distances from 1e-15 to 1e15 in the scene's unit; beyond them, and for a limit that is no number, all
    /// bits are set.
    pub fn above(&self, receiver: &QuickReceiver, limit: f32, above: &mut Vec<u8>) {
        above.clear();
        above.extend(self.lanes.iter().map(|lanes| lanes.above(receiver, limit)));
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.lanes.capacity() * size_of::<Lanes>()
    }
}

/// As machines have it: the second of the two where one is no number.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Lanes {
    #[inline]
    fn above(&self, receiver: &QuickReceiver, limit: f32) -> u8 {
        let (strength, squared) = self.strength_and_squared_distance(receiver);
        let mut bits = 0;
        for lane in 0..LANES {
            let tolerated = strength[lane] <= limit * squared[lane] && squared[lane] < FAR;
            bits |= u8::from(!tolerated) << lane;
        }
        bits
    }

    /// What is divided by what.
    #[inline]
    fn strength_and_squared_distance(&self, receiver: &QuickReceiver) -> ([f32; LANES], [f32; LANES]) {
        // The box from the receiver: nearest and farthest points, and the highest along three axes.
        let mut squared = [0.0f32; LANES];
        let mut farthest = [0.0f32; LANES];
        let mut heights = [[0.0f32; LANES]; 3];
        for i in 0..3 {
            for lane in 0..LANES {
                let low = self.min[i][lane] - receiver.position[i];
                let high = self.max[i][lane] - receiver.position[i];
                let near = larger(larger(low, -high), 0.0);
                let far = larger(high, -low);
                squared[lane] += near * near;
                farthest[lane] += far * far;
                let along = [receiver.normal[i], receiver.axis[i], self.axis[i][lane]];
                for (height, along) in heights.iter_mut().zip(along) {
                    height[lane] += larger(along * low, along * high);
                }
            }
        }

        // The largest cosines: so high at most, and so far away at least.
        let [normal, lobe, light] = heights;
        let mut strength = [0.0f32; LANES];
        let mut lobes = [0.0f32; LANES];
        for lane in 0..LANES {
            let far = farthest[lane].sqrt();
            let (slack, per_distance) = (SLACK * far, 1.0 / squared[lane].sqrt());
            let cosine = smaller((normal[lane] + slack) * per_distance + receiver.bias, 1.0);
            lobes[lane] = smaller((lobe[lane] + slack) * per_distance + SLACK, 1.0);

            // Emission falls with the angle outside of the cone of normals.
            let height = light[lane] + slack;
            let over = if height > 0.0 { per_distance } else { 1.0 / far };
            let at_light = larger(smaller(height * over + SLACK, 1.0), -1.0);
            let sine = larger(1.0 - at_light * at_light, 0.0).sqrt();
            let outside = at_light * self.cos[lane] + sine * self.sin[lane] + SLACK;
            let emitted = if at_light >= self.cos[lane] { 1.0 } else { larger(outside, 0.0) };
            strength[lane] = self.intensity[lane] * emitted * larger(cosine, 0.0);
        }
        let scattered = receiver.scattered(lobes);
        for lane in 0..LANES {
            // A thousandth is more than all roundings of products together.
            strength[lane] = strength[lane] * scattered[lane] * 1.001 + 1e-37;
        }
        (strength, squared)
    }
}

impl QuickReceiver {
    /// Scattering without the cosine, sr⁻¹, for these cosines to the lobe's axis.
    #[inline]
    fn scattered(&self, cosines: [f32; LANES]) -> [f32; LANES] {
        if self.peak == 0.0 {
            return [self.diffuse; LANES];
        }
        let mut square = cosines.map(|cosine| larger(cosine, self.least));
        let mut power = [1.0f32; LANES];
        let mut left = self.exponent;
        while left > 0 {
            if left & 1 != 0 {
                (0..LANES).for_each(|lane| power[lane] *= square[lane]);
            }
            left >>= 1;
            (0..LANES).for_each(|lane| square[lane] *= square[lane]);
        }
        power.map(|power| self.diffuse + self.peak * power)
    }
}
