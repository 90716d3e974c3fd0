//! k-means under the metric of distance and normals: Wang et al. 2009, section 3.2, "K-Means Clustering".

use std::collections::BinaryHeap;

use glam::DVec3;
use lighttree::parallel;

use crate::centres::{Centres, Fit, assign};
use crate::clusters::group;
use crate::{ClusterError, Clusters, Metric, OrientedPoint, Round, Seeding, metric};

/// How many clusters, and how long to look for them. Any values may be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterParams {
    /// Clusters wanted; as many as there are points where those are fewer. 1000 to 6000 in the paper.
    pub count: u32,
    /// Most rounds of k-means; 0 leaves every point with its nearest seed. Later rounds bring little: see
    /// `docs/photoncut.md`.
    pub max_rounds: u32,
    /// A round that moves no more than this share of the points is the last. In [0, 1].
    pub settled: f32,
    /// Of the jitter of seeds.
    pub seed: u32,
}

impl ClusterParams {
    /// `count` clusters, at most 10 rounds, until less than a thousandth of the points move.
    pub const fn with_count(count: u32) -> Self {
        Self { count, max_rounds: 10, settled: 1e-3, seed: 0 }
    }
}

/// Partitions `points`: exactly `min(count, points)` clusters, none empty. No points: no clusters.
///
/// # Errors
/// The first point that has no place or no normal; pixels that do not fit the points; a count of 0 for points
/// that are there.
pub fn cluster(
    points: &[OrientedPoint],
    seeding: Seeding<'_>,
    metric: &Metric,
    params: &ClusterParams,
) -> Result<Clusters, ClusterError> {
    metric::check(points)?;
    seeding.check(points.len())?;
    if points.is_empty() {
        return Ok(Clusters::default());
    }
    if params.count == 0 {
        return Err(ClusterError::NoClusters);
    }
    let count = params.count.min(points.len() as u32);
    let seeds = seeding.seeds(points, metric, count, params.seed);
    let centres = seeds.iter().map(|&i| points[i as usize]).collect();
    Ok(refine(points, metric, centres, params))
}

/// Rounds of k-means from centres that are given, not more of them than points.
pub(crate) fn refine(
    points: &[OrientedPoint],
    metric: &Metric,
    mut centres: Vec<OrientedPoint>,
    params: &ClusterParams,
) -> Clusters {
    // Put every point to its nearest seed.
    let mut fits = vec![Fit::default(); points.len()];
    let search = Centres::new(metric, &centres);
    parallel::for_each(&mut fits, || (), |(), i, fit| fit.cluster = search.near(&points[i]));
    assign(points, metric, &centres, &mut fits);
    fill_empty(points, &mut centres, &mut fits);

    // Move the centres, and put the points to their nearest ones, until few of them change.
    let mut rounds = Vec::new();
    for _ in 0..params.max_rounds {
        move_to_means(points, &mut centres, &fits);
        assign(points, metric, &centres, &mut fits);
        let moved = fits.iter().filter(|fit| fit.moved).count() as u32;
        let reseeded = fill_empty(points, &mut centres, &mut fits);
        let sum: f64 = fits.iter().map(|fit| f64::from(fit.error)).sum();
        rounds.push(Round { moved, reseeded, mean_error: sum / points.len() as f64 });
        if f64::from(moved) <= f64::from(params.settled) * points.len() as f64 {
            break;
        }
    }
    Clusters::new(points, metric, centres, &fits, rounds)
}

/// Each centre to the mean of its members. Where their normals cancel out, the centre keeps its own.
fn move_to_means(points: &[OrientedPoint], centres: &mut [OrientedPoint], fits: &[Fit]) {
    let (starts, members) = group(fits, centres.len());
    parallel::for_each(
        centres,
        || (),
        |(), k, centre| {
            let members = &members[starts[k] as usize..starts[k + 1] as usize];
            let (mut position, mut normal) = (DVec3::ZERO, DVec3::ZERO);
            for &i in members {
                position += points[i as usize].position.as_dvec3();
                normal += points[i as usize].normal.as_dvec3();
            }
            centre.position = (position / members.len() as f64).as_vec3();
            if normal.length() > 1e-6 * members.len() as f64 {
                centre.normal = normal.normalize().as_vec3();
            }
        },
    );
}

/// Gives every cluster without members the point that fits its own worst (ties: the first), out of those that
/// are not alone. Returns how many there were.
fn fill_empty(points: &[OrientedPoint], centres: &mut [OrientedPoint], fits: &mut [Fit]) -> u32 {
    let mut sizes = vec![0u32; centres.len()];
    for fit in fits.iter() {
        sizes[fit.cluster as usize] += 1;
    }
    let empty: Vec<usize> = (0..sizes.len()).filter(|&k| sizes[k] == 0).collect();
    if empty.is_empty() {
        return 0;
    }
    // Errors are not negative, so their bits are in their order.
    let by_error = |(i, fit): (usize, &Fit)| (fit.error.to_bits(), core::cmp::Reverse(i));
    let mut worst: BinaryHeap<_> = fits.iter().enumerate().map(by_error).collect();
    for &k in &empty {
        while let Some((_, core::cmp::Reverse(i))) = worst.pop() {
            let size = &mut sizes[fits[i].cluster as usize];
            if *size > 1 {
                *size -= 1;
                sizes[k] = 1;
                centres[k] = points[i];
                fits[i] = Fit { cluster: k as u32, error: 0.0, moved: true };
                break;
            }
        }
    }
    empty.len() as u32
}
