//! Of rays this crate knows only the questions.

use glam::Vec3;

/// The points `origin + t · direction` with `0 < t < t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// World-space start. Already moved off its surface: a query has no epsilon of its own.
    pub origin: Vec3,
    /// Direction; its length is the unit of `t`. Zero or not finite: hits nothing.
    pub direction: Vec3,
    /// End of the ray, exclusive; may be infinite.
    pub t_max: f32,
}

/// The open segment between two points; both already moved off their surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// World-space start.
    pub from: Vec3,
    /// World-space end.
    pub to: Vec3,
}

/// The nearest surface on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Distance in lengths of the ray's direction.
    pub t: f32,
    /// Index of the primitive in the host's own order.
    pub primitive: u32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex.
    pub v: f32,
}

/// The questions that shadow rays, particles and gather rays ask of a host's geometry.
///
/// Only the first two have to be written. The rest are the same questions for many rays at once, with defaults; a
/// host overrides those that it can answer faster. Answers must not depend on which of them was asked.
pub trait RayQueries {
    /// Memory for a traversal, reused from query to query: one per thread.
    type Scratch: Default + Send;

    /// The nearest hit, ties to the lowest primitive index.
    fn closest(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Option<RayHit>;

    /// Whether anything lies between the ends of the segment.
    fn occluded(&self, segment: &Segment, scratch: &mut Self::Scratch) -> bool;

    /// [`closest`](Self::closest) of each ray.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn closest_each(&self, rays: &[Ray], hits: &mut [Option<RayHit>], scratch: &mut Self::Scratch) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest(ray, scratch);
        }
    }

    /// [`occluded`](Self::occluded) of each segment.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded_each(&self, segments: &[Segment], occluded: &mut [bool], scratch: &mut Self::Scratch) {
        assert_eq!(segments.len(), occluded.len(), "one answer per segment");
        for (segment, occluded) in segments.iter().zip(occluded) {
            *occluded = self.occluded(segment, scratch);
        }
    }

    /// [`occluded`](Self::occluded), asking first whatever blocked the last segment of this kind: keep one
    /// `blocker` per light and neighbourhood, starting at [`NO_BLOCKER`](Self::NO_BLOCKER).
    fn occluded_via(&self, segment: &Segment, blocker: &mut u32, scratch: &mut Self::Scratch) -> bool {
        let _ = blocker;
        self.occluded(segment, scratch)
    }

    /// The value of `blocker` where nothing is known yet.
    const NO_BLOCKER: u32 = u32::MAX;

    /// [`occluded`](Self::occluded) of the segments from one point, a light as a rule, to many near one another.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded_from(
        &self,
        origin: Vec3,
        targets: &[Vec3],
        occluded: &mut [bool],
        scratch: &mut Self::Scratch,
    ) {
        assert_eq!(targets.len(), occluded.len(), "one answer per target");
        for (&to, occluded) in targets.iter().zip(occluded) {
            *occluded = self.occluded(&Segment { from: origin, to }, scratch);
        }
    }
}
