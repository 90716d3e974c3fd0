//! Triangles in packets of eight, and the test of a ray against a packet.
//!
//! Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: translate to the origin,
//! shear the ray into its dominant axis, and ask on which side of the three projected edges the origin lies.
//!
//! Differs from the paper: edges are inclusive (`>= 0`), so an edge function that rounds to zero is accepted
//! and no double-precision fallback is needed; the accepted set only grows. What is left open is a triangle
//! edge-on to the ray (all three zero), which its neighbours cover. No axis is swapped to keep the winding:
//! both sides of a triangle are hit.

use glam::Vec3;

use super::node::LANES;

/// Set in a packet's id where the triangle is masked.
pub(super) const MASKED_ID: u32 = 1 << 31;

/// Which hits count. Asked only of triangles that were masked when the tree was built.
pub trait HitFilter {
    /// Every hit counts: nothing is asked, nothing is paid.
    const ACCEPTS_ALL: bool = false;

    /// Whether the hit on `primitive` at barycentric (`u`, `v`) (see [`RayHit`](lighttree::RayHit)) counts.
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool;
}

/// Every hit counts, masked or not.
#[derive(Clone, Copy, Debug, Default)]
pub struct AcceptAll;

impl HitFilter for AcceptAll {
    const ACCEPTS_ALL: bool = true;

    #[inline(always)]
    fn accepts(&self, _: u32, _: f32, _: f32) -> bool {
        true
    }
}

/// Eight triangles as rows, `vertex[corner][axis][lane]`, 320 bytes. Empty lanes are NaN, which no comparison
/// accepts.
#[repr(C, align(32))]
#[derive(Clone, Debug)]
pub(super) struct Packet {
    pub(super) vertex: [[[f32; LANES]; 3]; 3],
    /// Triangle's index, with [`MASKED_ID`].
    pub(super) id: [u32; LANES],
}

impl Packet {
    pub(super) const EMPTY: Self = Self { vertex: [[[f32::NAN; LANES]; 3]; 3], id: [u32::MAX; LANES] };

    pub(super) fn set(&mut self, lane: usize, id: u32, corners: [Vec3; 3]) {
        self.id[lane] = id;
        for (corner, vertex) in corners.iter().enumerate() {
            for axis in 0..3 {
                self.vertex[corner][axis][lane] = vertex[axis];
            }
        }
    }

    /// Index of the triangle in a lane.
    #[inline(always)]
    pub(super) fn primitive(&self, lane: usize) -> u32 {
        self.id[lane] & !MASKED_ID
    }

    /// Whether a hit in `lane` counts.
    #[inline(always)]
    pub(super) fn accepts<F: HitFilter>(&self, lane: usize, ray: &super::ray::Traced, filter: &F) -> bool {
        if F::ACCEPTS_ALL || self.id[lane] & MASKED_ID == 0 {
            return true;
        }
        let [u, v] = self.barycentric(lane, ray);
        filter.accepts(self.primitive(lane), u, v)
    }

    /// Weights of the second and third vertex where `ray` meets the triangle in `lane`, which it must: the
    /// operations of the test, one lane at a time.
    pub(super) fn barycentric(&self, lane: usize, ray: &super::ray::Traced) -> [f32; 2] {
        let [kx, ky, kz] = ray.axis;
        let [sx, sy, _] = ray.shear;
        let (mut x, mut y) = ([0.0; 3], [0.0; 3]);
        for corner in 0..3 {
            let at = |axis: usize| self.vertex[corner][axis][lane] - ray.origin[axis];
            let z = at(kz);
            x[corner] = at(kx) - sx * z;
            y[corner] = at(ky) - sy * z;
        }
        let a = x[2] * y[1] - y[2] * x[1];
        let b = x[0] * y[2] - y[0] * x[2];
        let c = x[1] * y[0] - y[1] * x[0];
        let sum = a + b + c;
        [b / sum, c / sum]
    }
}

/// The test of a ray against the eight triangles of a packet, to be compiled for the operations in scope.
macro_rules! triangle_kernel {
    ([$(#[$feature:meta])*]) => {
        /// `t` of each lane, and the lanes that the ray hits at `0 < t < t_max`.
        #[inline]
        $(#[$feature])*
        fn triangles(packet: &Packet, ray: &Traced, t_max: f32) -> (V, u32) {
            let [kx, ky, kz] = ray.axis.map(|k| k % 3);
            let [sx, sy, sz] = ray.shear.map(|s| splat(s));
            let [ox, oy, oz] = [splat(ray.origin[kx]), splat(ray.origin[ky]), splat(ray.origin[kz])];
            let zero = splat(0.0);

            // Translate and shear.
            let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
            for corner in 0..3 {
                z[corner] = sub(load(&packet.vertex[corner][kz]), oz);
                x[corner] = sub(sub(load(&packet.vertex[corner][kx]), ox), mul(sx, z[corner]));
                y[corner] = sub(sub(load(&packet.vertex[corner][ky]), oy), mul(sy, z[corner]));
            }

            // Ask the three edges, inclusively, either winding.
            let u = sub(mul(x[2], y[1]), mul(y[2], x[1]));
            let v = sub(mul(x[0], y[2]), mul(y[0], x[2]));
            let w = sub(mul(x[1], y[0]), mul(y[1], x[0]));
            let inside = le(zero, min(min(u, v), w)) | le(max(max(u, v), w), zero);
            if inside == 0 {
                return (zero, 0);
            }

            // Interpolate the distance; edge-on it is no number, hence a miss.
            let sum = add(add(u, v), w);
            let t = div(mul(add(add(mul(u, z[0]), mul(v, z[1])), mul(w, z[2])), sz), sum);
            (t, inside & lt(zero, t) & lt(t, splat(t_max)))
        }
    };
}
pub(super) use triangle_kernel;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_five_cache_lines() {
        assert_eq!(size_of::<Packet>(), 320);
    }
}
