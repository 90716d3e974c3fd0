//! Which of the two compilations of the traversal answers; the only `unsafe` of the crate.

use glam::Vec3;
use lighttree::{Ray, RayHit, Segment};

use super::build::WideBvh;
use super::ray::Scratch;
use super::triangle::HitFilter;

/// The instructions that a tree is traversed with. Answers are the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// What every processor of the target has: SSE2 on x86-64, NEON on ARM.
    Portable,
    /// AVX2 and FMA.
    Avx2,
}

impl Path {
    /// The fastest that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Self::Avx2;
        }
        Self::Portable
    }
}

macro_rules! traversal {
    ($name:ident, $lanes:ident, $features:tt) => {
        mod $name {
            use glam::Vec3;
            use lighttree::{Ray, RayHit, Segment};

            use super::super::build::WideBvh;
            use super::super::group::{FEW, GROUP, group_kernel};
            use super::super::lanes::$lanes::*;
            use super::super::node::{LANES, Link, Node, STACK, TOP, next_bit};
            use super::super::ray::{Scratch, Traced};
            use super::super::traverse::traverse_kernel;
            use super::super::triangle::{HitFilter, Packet, triangle_kernel};

            triangle_kernel!($features);
            traverse_kernel!($features);
            group_kernel!($features);
        }
    };
}
traversal!(portable, pair, []);
#[cfg(target_arch = "x86_64")]
traversal!(avx2, ymm, [#[target_feature(enable = "avx2,fma")]]);

macro_rules! dispatch {
    ($bvh:expr, $function:ident($($argument:expr),*)) => {{
        #[cfg(target_arch = "x86_64")]
        if $bvh.path() == Path::Avx2 {
            #[expect(unsafe_code, reason = "calls a function compiled for features that were found at run time")]
            // SAFETY: a tree's path is `Avx2` only where `Path::detect` found AVX2 and FMA
            // (`WideBvh::set_path` holds to it), and the functions are safe but for needing them.
            return unsafe { avx2::$function($bvh, $($argument),*) };
        }
        portable::$function($bvh, $($argument),*)
    }};
}

/// Queries. `filter` is asked about hits on masked triangles only; a tree without such takes
/// [`AcceptAll`](super::AcceptAll).
impl WideBvh {
    /// The nearest hit on the ray; of equally near ones, the lowest index.
    pub fn closest<F: HitFilter>(&self, ray: &Ray, filter: &F, scratch: &mut Scratch) -> Option<RayHit> {
        dispatch!(self, closest(ray, filter, scratch))
    }

    /// [`closest`](Self::closest) of each ray.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest_each<F: HitFilter>(
        &self,
        rays: &[Ray],
        hits: &mut [Option<RayHit>],
        filter: &F,
        scratch: &mut Scratch,
    ) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        dispatch!(self, closest_each(rays, hits, filter, scratch));
    }

    /// Whether anything lies strictly between the ends of the segment.
    pub fn occluded<F: HitFilter>(&self, segment: &Segment, filter: &F, scratch: &mut Scratch) -> bool {
        dispatch!(self, occluded(segment, filter, scratch))
    }

    /// [`occluded`](Self::occluded) of each segment. Keep them in image order: sorting costs more than it
    /// gains.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded_each<F: HitFilter>(
        &self,
        segments: &[Segment],
        occluded: &mut [bool],
        filter: &F,
        scratch: &mut Scratch,
    ) {
        assert_eq!(segments.len(), occluded.len(), "one answer per segment");
        dispatch!(self, occluded_each(segments, occluded, filter, scratch));
    }

    /// [`occluded`](Self::occluded), after asking the leaf that `blocker` remembers. Pays off where
    /// neighbours ask about the same light. Any value of `blocker` is allowed; `u32::MAX` knows nothing.
    pub fn occluded_via<F: HitFilter>(
        &self,
        segment: &Segment,
        blocker: &mut u32,
        filter: &F,
        scratch: &mut Scratch,
    ) -> bool {
        dispatch!(self, occluded_via(segment, blocker, filter, scratch))
    }

    /// [`occluded`](Self::occluded) of the segments from `origin` to each target. Pays off where they point
    /// alike: from a light to a tile of receivers.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded_from<F: HitFilter>(
        &self,
        origin: Vec3,
        targets: &[Vec3],
        occluded: &mut [bool],
        filter: &F,
        scratch: &mut Scratch,
    ) {
        assert_eq!(targets.len(), occluded.len(), "one answer per target");
        dispatch!(self, occluded_from(origin, targets, occluded, filter, scratch));
    }
}
