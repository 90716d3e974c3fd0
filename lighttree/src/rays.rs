//! Of rays this crate knows only the questions.

use core::convert::Infallible;

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
/// Only the first two have to be written. The rest are the same questions for many rays at once, with
/// defaults; a host overrides those that it can answer faster. Answers must not depend on which of them was
/// asked.
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

    /// [`occluded`](Self::occluded) of the segments from one point, a light as a rule, to many near one
    /// another.
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

impl<Q: RayQueries> RayQueries for &Q {
    type Scratch = Q::Scratch;

    fn closest(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Option<RayHit> {
        (**self).closest(ray, scratch)
    }

    fn occluded(&self, segment: &Segment, scratch: &mut Self::Scratch) -> bool {
        (**self).occluded(segment, scratch)
    }

    fn closest_each(&self, rays: &[Ray], hits: &mut [Option<RayHit>], scratch: &mut Self::Scratch) {
        (**self).closest_each(rays, hits, scratch);
    }

    fn occluded_each(&self, segments: &[Segment], occluded: &mut [bool], scratch: &mut Self::Scratch) {
        (**self).occluded_each(segments, occluded, scratch);
    }

    fn occluded_via(&self, segment: &Segment, blocker: &mut u32, scratch: &mut Self::Scratch) -> bool {
        (**self).occluded_via(segment, blocker, scratch)
    }

    fn occluded_from(
        &self,
        origin: Vec3,
        targets: &[Vec3],
        occluded: &mut [bool],
        scratch: &mut Self::Scratch,
    ) {
        (**self).occluded_from(origin, targets, occluded, scratch);
    }
}

/// Many rays at once: CPU threads or one dispatch. What [`BatchLightSampler`](crate::BatchLightSampler) is to
/// lights.
///
/// Contract: the answers are those of [`RayQueries`] for the same geometry, ray by ray, and do not depend on
/// how a batch is cut. An implementation whose arithmetic differs in rounding may differ where a ray passes
/// an edge within rounding; `conformance::check_batch_rays` counts such rays.
pub trait BatchRayQueries {
    /// What can go wrong on the way; [`Infallible`] on a CPU.
    type Error: core::error::Error;

    /// The nearest hit of each ray, `None` without one.
    ///
    /// # Errors
    /// Whatever keeps the rays from being traced; `hits` then holds nothing of meaning.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn closest_batch(&mut self, rays: &[Ray], hits: &mut [Option<RayHit>]) -> Result<(), Self::Error>;

    /// Whether anything lies between the ends of each segment.
    ///
    /// # Errors
    /// Whatever keeps the segments from being traced; `occluded` then holds nothing of meaning.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded_batch(&mut self, segments: &[Segment], occluded: &mut [bool]) -> Result<(), Self::Error>;
}

/// Any [`RayQueries`] as [`BatchRayQueries`], on all threads with the feature `parallel`.
#[derive(Clone, Copy, Debug)]
pub struct RayBatches<Q>(pub Q);

/// Rays that a thread takes at once: enough to share a call, few enough to be spread evenly.
const CHUNK: usize = 1024;

impl<Q: RayQueries + Sync> BatchRayQueries for RayBatches<Q> {
    type Error = Infallible;

    fn closest_batch(&mut self, rays: &[Ray], hits: &mut [Option<RayHit>]) -> Result<(), Infallible> {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        in_chunks(rays, hits, |rays, hits, scratch| self.0.closest_each(rays, hits, scratch));
        Ok(())
    }

    fn occluded_batch(&mut self, segments: &[Segment], occluded: &mut [bool]) -> Result<(), Infallible> {
        assert_eq!(segments.len(), occluded.len(), "one answer per segment");
        in_chunks(segments, occluded, |segments, occluded, scratch| {
            self.0.occluded_each(segments, occluded, scratch);
        });
        Ok(())
    }
}

/// Asks chunk by chunk; slices of one length.
fn in_chunks<A: Sync, B: Send, S: Default + Send>(
    asked: &[A],
    answers: &mut [B],
    ask: impl Fn(&[A], &mut [B], &mut S) + Sync,
) {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        asked
            .par_chunks(CHUNK)
            .zip(answers.par_chunks_mut(CHUNK))
            .for_each_init(S::default, |scratch, (asked, answers)| ask(asked, answers, scratch));
    }
    #[cfg(not(feature = "parallel"))]
    {
        let mut scratch = S::default();
        for (asked, answers) in asked.chunks(CHUNK).zip(answers.chunks_mut(CHUNK)) {
            ask(asked, answers, &mut scratch);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit square across the z axis at 1.
    struct Square;

    impl RayQueries for Square {
        type Scratch = ();

        fn closest(&self, ray: &Ray, (): &mut ()) -> Option<RayHit> {
            let t = (1.0 - ray.origin.z) / ray.direction.z;
            let at = ray.origin + t * ray.direction;
            let inside = at.x.abs() <= 0.5 && at.y.abs() <= 0.5;
            (inside && t > 0.0 && t < ray.t_max).then_some(RayHit { t, primitive: 0, u: 0.0, v: 0.0 })
        }

        fn occluded(&self, segment: &Segment, scratch: &mut ()) -> bool {
            let ray = Ray { origin: segment.from, direction: segment.to - segment.from, t_max: 1.0 };
            self.closest(&ray, scratch).is_some()
        }
    }

    #[cfg(feature = "conformance")]
    #[test]
    fn batches_answer_as_single_rays_do_and_a_wrong_one_is_found() {
        let points: Vec<Vec3> = (0..5000u32).map(|i| Vec3::new(i as f32 / 2500.0 - 1.0, 0.1, 2.0)).collect();
        let rays: Vec<Ray> =
            points.iter().map(|&p| Ray { origin: Vec3::ZERO, direction: p, t_max: f32::INFINITY }).collect();
        let segments: Vec<Segment> = points.iter().map(|&to| Segment { from: Vec3::ZERO, to }).collect();
        let check = |batch: &mut RayBatches<Square>, rays: &[Ray]| {
            crate::conformance::check_batch_rays(batch, &Square, rays, &segments, 0.0, 0)
        };
        let agreement = check(&mut RayBatches(Square), &rays).unwrap();
        assert!(agreement.hits > 2000 && agreement.blocked > 2000 && agreement.differ() == 0);

        struct Leaky;
        impl BatchRayQueries for Leaky {
            type Error = Infallible;
            fn closest_batch(&mut self, rays: &[Ray], hits: &mut [Option<RayHit>]) -> Result<(), Infallible> {
                RayBatches(Square).closest_batch(rays, hits)
            }
            fn occluded_batch(&mut self, _: &[Segment], occluded: &mut [bool]) -> Result<(), Infallible> {
                occluded.fill(false);
                Ok(())
            }
        }
        let wrong = crate::conformance::check_batch_rays(&mut Leaky, &Square, &rays, &segments, 0.0, 10);
        assert!(wrong.is_err());
    }
}
