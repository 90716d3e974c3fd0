//! The next frame: old centres stay where they are, as far as they still have points.
//!
//! Wang et al. 2009, section 3.2, "Temporal Coherence". A point stays with an old cluster if it fits no worse
//! than that cluster's worst member did; the others are clustered anew. Differs from the paper, which leaves
//! the numbers open: the total stays exactly the count that is asked for, new clusters get at least the share
//! of the points that nobody claims, and the smallest old ones make room.

use lighttree::parallel;

use crate::centres::{Centres, Fit};
use crate::kmeans::refine;
use crate::{ClusterError, ClusterParams, Clusters, Metric, OrientedPoint, Seeding, cluster, metric};

/// A point that no old cluster claims.
const NOBODY: u32 = u32::MAX;

impl Clusters {
    /// Clusters of the next frame's `points`, as many as [`cluster`] would make. Centres that stay are the
    /// very same: nothing flickers there as long as the points around them are.
    ///
    /// Returns how many of the old centres stayed. Those that still have points come first, in their old
    /// order.
    ///
    /// # Errors
    /// As [`cluster`].
    pub fn follow(
        &self,
        points: &[OrientedPoint],
        seeding: Seeding<'_>,
        metric: &Metric,
        params: &ClusterParams,
    ) -> Result<(Self, usize), ClusterError> {
        metric::check(points)?;
        seeding.check(points.len())?;
        if self.is_empty() || points.is_empty() || params.count == 0 {
            return Ok((cluster(points, seeding, metric, params)?, 0));
        }
        let count = (params.count as usize).min(points.len());

        // Ask every point whether an old cluster still fits.
        let thresholds: Vec<f32> = (0..self.len()).map(|k| self.largest_error(k)).collect();
        let mut fits = vec![Fit::default(); points.len()];
        let search = Centres::new(metric, self.centres());
        parallel::for_each(
            &mut fits,
            || (),
            |(), i, fit| {
                let (cluster, error) = search.nearest(&points[i]);
                let cluster = if error <= thresholds[cluster as usize] { cluster } else { NOBODY };
                *fit = Fit { cluster, error, moved: false };
            },
        );

        // Keep what has members; the smallest make room for as many new clusters as the unclaimed points are
        // worth.
        let mut sizes = vec![0usize; self.len()];
        for fit in fits.iter().filter(|fit| fit.cluster != NOBODY) {
            sizes[fit.cluster as usize] += 1;
        }
        let unclaimed = fits.iter().filter(|fit| fit.cluster == NOBODY).count();
        let alive = sizes.iter().filter(|&&size| size > 0).count();
        let share = (count * unclaimed).div_ceil(points.len());
        let fresh = share.max(count.saturating_sub(alive)).min(unclaimed);
        let mut by_size: Vec<usize> = (0..self.len()).filter(|&k| sizes[k] > 0).collect();
        by_size.sort_by_key(|&k| core::cmp::Reverse(sizes[k]));
        by_size.truncate(count - fresh);
        by_size.sort_unstable();
        let kept: Vec<OrientedPoint> = by_size.iter().map(|&k| self.centres()[k]).collect();

        // Cluster the rest, and put every point to its nearest centre.
        let mut centres = kept.clone();
        if fresh > 0 {
            let rest: Vec<usize> = (0..points.len()).filter(|&i| fits[i].cluster == NOBODY).collect();
            let rest_points: Vec<_> = rest.iter().map(|&i| points[i]).collect();
            let rest_pixels: Vec<u32>;
            let rest_seeding = match seeding {
                Seeding::Screen { width, pixels } => {
                    rest_pixels = rest.iter().map(|&i| pixels[i]).collect();
                    Seeding::Screen { width, pixels: &rest_pixels }
                }
                Seeding::Octree => Seeding::Octree,
            };
            let params = ClusterParams { count: fresh as u32, ..*params };
            centres.extend_from_slice(cluster(&rest_points, rest_seeding, metric, &params)?.centres());
        }
        // Too few are left where all points are claimed by few clusters: those that fit worst found new ones.
        while centres.len() < count {
            centres.push(points[0]);
        }
        let settled = ClusterParams { max_rounds: 0, ..*params };
        let clusters = refine(points, metric, centres, &settled);
        // One that lost all its points to a new neighbour was started anew.
        let stayed = kept.iter().zip(clusters.centres()).filter(|(old, new)| old == new).count();
        Ok((clusters, stayed))
    }
}
