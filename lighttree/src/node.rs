//! The records a tree is made of, in the layout that a GPU reads.
//!
//! [`LightNode`] packs the cone of Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive
//! Tree Splitting", 2018, into two words; [`PerfectNode`] is the cone-less node of Lin and Yuksel, "Real-Time
//! Stochastic Lightcuts", 2020, section 4.
//!
//! Packing is conservative: boxes are kept to the bit, and the packed cone is wide enough for its own
//! rounding. The axis is an octahedral vector of 2 × 16 bits (Meyer et al., "On Floating-Point Normal
//! Vectors", 2010); an angle θ is kept as sin(θ/2), whose steps are even in the angle where cones are narrow,
//! and which needs no trigonometry to be turned into cos θ = 1 - 2 sin²(θ/2).

use core::ops::Range;

use bytemuck::{Pod, Zeroable, must_cast_ref};
use glam::{DVec3, Vec3, Vec4};

use crate::four::{columns, words};
use crate::{FourBounds, FourCones, LightBounds};

/// A node of a [`LightTree`](crate::LightTree): bounds with a cone, and where its children and lights are.
///
/// `vec3<f32>, u32` pairs in WGSL have the same offsets.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(16))]
pub struct LightNode {
    /// Smallest coordinates of the box.
    pub min: [f32; 3],
    /// Id of the left child, the right one follows it; 0 for a leaf.
    pub first_child: u32,
    /// Largest coordinates of the box.
    pub max: [f32; 3],
    /// Number of lights below this node, at least 1.
    pub item_count: u32,
    /// Axis of the cone of normals: octahedral, two signed 16-bit numbers, x in the low half.
    pub axis: u32,
    /// Low 16 bits: sin(`theta_o` / 2) × 65535. Next 15: √2 · sin(`theta_e` / 2) × 32767. Top bit: two-sided.
    pub cone: u32,
    /// Sum of the peak radiant intensities, in units of the tree's
    /// [`intensity_unit`](crate::LightTree::intensity_unit).
    pub intensity: f32,
    /// Slot of the first light below this node.
    pub first_item: u32,
}

impl LightNode {
    /// A leaf without lights that has these bounds: the decoded box is `bounds`' own, the decoded cone
    /// contains it.
    ///
    /// The axis need not be normalised; cosines must be in their ranges.
    pub fn new(bounds: &LightBounds) -> Self {
        let (axis, cone) = pack_cone(bounds);
        Self {
            min: bounds.min.to_array(),
            first_child: 0,
            max: bounds.max.to_array(),
            item_count: 0,
            axis,
            cone,
            intensity: bounds.intensity,
            first_item: 0,
        }
    }

    /// Whether it has no children.
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.first_child == 0
    }

    /// Slots of the lights below it.
    #[inline]
    pub fn items(&self) -> Range<u32> {
        self.first_item..self.first_item.saturating_add(self.item_count)
    }

    /// The decoded bounds; the intensity is in the tree's unit.
    #[inline]
    pub fn bounds(&self) -> LightBounds {
        LightBounds {
            min: Vec3::from_array(self.min),
            max: Vec3::from_array(self.max),
            axis: decode_axis(self.axis),
            cos_theta_o: decode_theta_o(self.cone & 0xffff),
            cos_theta_e: decode_theta_e(self.cone >> 16 & 0x7fff),
            two_sided: self.cone >> 31 != 0,
            intensity: self.intensity,
        }
    }
}

/// [`LightNode::bounds`] of four nodes, to the bit, each step for all of them together.
#[inline(always)]
pub(crate) fn four_light_nodes(nodes: [&LightNode; 4]) -> FourBounds {
    let [a, b, c, d] = nodes.map(must_cast_ref::<LightNode, [Vec4; 3]>);
    let [min_x, min_y, min_z, _] = columns([a[0], b[0], c[0], d[0]]);
    let [max_x, max_y, max_z, _] = columns([a[1], b[1], c[1], d[1]]);
    let [axis, cone, intensity, _] = columns([a[2], b[2], c[2], d[2]]);
    FourBounds {
        min: [min_x, min_y, min_z],
        max: [max_x, max_y, max_z],
        intensity,
        cones: four_cones(words(axis), words(cone)),
    }
}

/// Of the two words of each; `None` if every `theta_o` is 180°.
#[inline(always)]
fn four_cones(axis: [u32; 4], cone: [u32; 4]) -> Option<FourCones> {
    let [a, b, c, d] = cone;
    if a & b & c & d & 0xffff == 0xffff {
        return None;
    }
    let of =
        |words: [u32; 4], f: fn(u32) -> f32| Vec4::new(f(words[0]), f(words[1]), f(words[2]), f(words[3]));
    // As `decode_axis` does it.
    let unquantised = |half: fn(u32) -> f32| (of(axis, half) / AXIS_STEPS).max(Vec4::NEG_ONE);
    let x = unquantised(|word| f32::from((word as u16).cast_signed()));
    let y = unquantised(|word| f32::from(((word >> 16) as u16).cast_signed()));
    let z = Vec4::ONE - x.abs() - y.abs();
    let is_folded = z.cmplt(Vec4::ZERO);
    let folded = |a: Vec4, b: Vec4| Vec4::select(is_folded, (Vec4::ONE - b.abs()).copysign(a), a);
    let (x, y) = (folded(x, y), folded(y, x));
    let inverse = (x * x + y * y + z * z).sqrt().recip();

    let sin_o = of(cone, |word| f32::from(word as u16)) / 65535.0;
    let sin_e = of(cone, |word| f32::from((word >> 16) as u16 & 0x7fff)) / 32767.0;
    Some(FourCones {
        axis: [x * inverse, y * inverse, z * inverse],
        cos_theta_o: Vec4::ONE - 2.0 * sin_o * sin_o,
        cos_theta_e: Vec4::ONE - sin_e * sin_e,
        two_sided: of(cone, |word| f32::from_bits(word & 1 << 31 | 1.0f32.to_bits())).cmplt(Vec4::ZERO),
    })
}

/// [`PerfectNode::bounds`] of four nodes.
#[inline(always)]
pub(crate) fn four_perfect_nodes(nodes: [&PerfectNode; 4]) -> FourBounds {
    let [a, b, c, d] = nodes.map(must_cast_ref::<PerfectNode, [Vec4; 2]>);
    let [min_x, min_y, min_z, intensity] = columns([a[0], b[0], c[0], d[0]]);
    let [max_x, max_y, max_z, _] = columns([a[1], b[1], c[1], d[1]]);
    FourBounds { min: [min_x, min_y, min_z], max: [max_x, max_y, max_z], intensity, cones: None }
}

/// A node of a [`PerfectTree`](crate::PerfectTree): box, intensity, and one word that leaves and inner nodes
/// use differently. No cone; children are implied by the node's place.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(16))]
pub struct PerfectNode {
    /// Smallest coordinates of the box.
    pub min: [f32; 3],
    /// Sum of the peak radiant intensities, in units of the tree's
    /// [`intensity_unit`](crate::PerfectTree::intensity_unit).
    pub intensity: f32,
    /// Largest coordinates of the box.
    pub max: [f32; 3],
    /// Leaf: the light. Inner node number `n` in storage order: the slot of light `n`, or `u32::MAX` if the
    /// tree was built without it.
    pub id: u32,
}

impl PerfectNode {
    /// The node as bounds whose cone holds every direction; the intensity is in the tree's unit.
    #[inline]
    pub fn bounds(&self) -> LightBounds {
        LightBounds {
            min: Vec3::from_array(self.min),
            max: Vec3::from_array(self.max),
            axis: Vec3::Z,
            cos_theta_o: -1.0,
            // Without effect on any bound; 0 contains every other.
            cos_theta_e: 0.0,
            two_sided: false,
            intensity: self.intensity,
        }
    }
}

/// The two words of a cone: the nearest octahedral axis, and angles rounded up until they hold what that axis
/// lost.
fn pack_cone(bounds: &LightBounds) -> (u32, u32) {
    let axis = encode_axis(bounds.axis);
    let theta_o = encode_theta_o(widened_cos(bounds, decode_axis(axis)));
    let theta_e = encode_theta_e(bounds.cos_theta_e);
    (axis, theta_o | theta_e << 16 | u32::from(bounds.two_sided) << 31)
}

/// Cosine of `theta_o` plus the angle between the axis and `decoded`.
fn widened_cos(bounds: &LightBounds, decoded: Vec3) -> f64 {
    let cos_o = f64::from(bounds.cos_theta_o);
    if bounds.axis == decoded || cos_o <= -1.0 {
        return cos_o;
    }
    let (a, b) = (bounds.axis.as_dvec3(), decoded.as_dvec3());
    let (sine, cosine) = (a.cross(b).length(), a.dot(b));
    let length = (sine * sine + cosine * cosine).sqrt();
    let (sine, cosine) = (sine / length, cosine / length);
    if cos_o <= -cosine {
        return -1.0;
    }
    // A few ulps on the wide side pay for the rounding of this very line.
    let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
    (cos_o * cosine - sin_o * sine - 4.0 * f64::EPSILON).max(-1.0)
}

const AXIS_STEPS: f32 = 32767.0;

fn encode_axis(axis: Vec3) -> u32 {
    let axis = axis.as_dvec3();
    let v = axis / axis.abs().element_sum();
    let v = if v.is_finite() { v } else { DVec3::Z };
    let folded = |a: f64, b: f64| (1.0 - b.abs()).copysign(a);
    let (x, y) = if v.z < 0.0 { (folded(v.x, v.y), folded(v.y, v.x)) } else { (v.x, v.y) };
    let quantised = |a: f64| u32::from(((a * f64::from(AXIS_STEPS)).round() as i16).cast_unsigned());
    quantised(x) | quantised(y) << 16
}

#[inline]
fn decode_axis(word: u32) -> Vec3 {
    let unquantised = |half: u32| (f32::from((half as u16).cast_signed()) / AXIS_STEPS).max(-1.0);
    let (x, y) = (unquantised(word), unquantised(word >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let folded = |a: f32, b: f32| (1.0 - b.abs()).copysign(a);
    let (x, y) = if z < 0.0 { (folded(x, y), folded(y, x)) } else { (x, y) };
    Vec3::new(x, y, z).normalize()
}

/// Smallest code whose decoded cosine is not above `cos`.
fn encode_theta_o(cos: f64) -> u32 {
    let start = ((0.5 * (1.0 - cos)).max(0.0).sqrt() * 65535.0) as u32;
    (start.saturating_sub(1)..65535).find(|&code| f64::from(decode_theta_o(code)) <= cos).unwrap_or(65535)
}

#[inline]
fn decode_theta_o(code: u32) -> f32 {
    let s = code as f32 / 65535.0;
    1.0 - 2.0 * s * s
}

/// Smallest code whose decoded cosine is not above `cos`.
fn encode_theta_e(cos: f32) -> u32 {
    let start = ((1.0 - f64::from(cos)).max(0.0).sqrt() * 32767.0) as u32;
    (start.saturating_sub(1)..32767).find(|&code| decode_theta_e(code) <= cos).unwrap_or(32767)
}

#[inline]
fn decode_theta_e(code: u32) -> f32 {
    let s = code as f32 / 32767.0;
    1.0 - s * s
}
