//! k-means with an angle for a metric: virtual lights that face the same way.
//!
//! Luksch, Wimmer and Schwärzler, "Incrementally Baked Global Illumination", 2019, section 4: what no plane
//! takes is clustered by orientation. First centres: the point farthest from the mean, then always the one
//! farthest from all centres so far.

use glam::{DVec3, Vec3};

use crate::ClusterError;

/// Directions in groups.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AngularClusters {
    /// Unit mean directions, weighted.
    pub axes: Vec<Vec3>,
    /// The cluster of each direction.
    pub cluster_of: Vec<u32>,
    /// Of each cluster, the direction nearest to its axis, ties to the first.
    pub representatives: Vec<u32>,
    /// Rounds that it took.
    pub rounds: u32,
}

/// Puts unit `directions` into at most `count` clusters by angle; fewer where there are fewer different
/// directions, to 1e-3 radians. Weights (flux, as a rule) pull the axes; a direction of weight 0 is put
/// somewhere, too. No direction or `count` 0: no clusters, if there are no directions.
///
/// Runs on the caller's thread: a cell of an octree has few directions, and there are many cells.
///
/// # Errors
/// The first direction that is not of unit length, or weight that is not a number from 0 on; directions
/// without any cluster.
///
/// # Panics
/// If the slices differ in length.
pub fn angular_clusters(
    directions: &[Vec3],
    weights: &[f32],
    count: u32,
    max_rounds: u32,
) -> Result<AngularClusters, ClusterError> {
    assert_eq!(directions.len(), weights.len(), "one weight per direction");
    for (index, (direction, weight)) in directions.iter().zip(weights).enumerate() {
        if !direction.is_finite() {
            return Err(ClusterError::NonFinite { index });
        }
        if (direction.length() - 1.0).abs() > 0.01 {
            return Err(ClusterError::NotUnit { index });
        }
        if !(weight.is_finite() && *weight >= 0.0) {
            return Err(ClusterError::BadWeight { index });
        }
    }
    if directions.is_empty() {
        return Ok(AngularClusters::default());
    }
    if count == 0 {
        return Err(ClusterError::NoClusters);
    }

    let mut axes = farthest_first(directions, weights, count);
    let mut cluster_of = vec![0; directions.len()];
    let mut rounds = 0;
    loop {
        let mut moved = rounds == 0;
        for (direction, cluster) in directions.iter().zip(&mut cluster_of) {
            let nearest = nearest(&axes, *direction);
            moved |= nearest != *cluster;
            *cluster = nearest;
        }
        if !moved || rounds == max_rounds {
            break;
        }
        rounds += 1;
        for (k, axis) in (0..).zip(&mut axes) {
            let members = || directions.iter().zip(weights).zip(&cluster_of).filter(move |(_, c)| **c == k);
            let weighted: DVec3 = members().map(|((d, w), _)| d.as_dvec3() * f64::from(*w)).sum();
            let plain: DVec3 = members().map(|((d, _), _)| d.as_dvec3()).sum();
            // Where all weights are zero, or opposites cancel, the axis stays.
            let mean = weighted.try_normalize().or(plain.try_normalize());
            *axis = mean.map_or(*axis, |mean| mean.as_vec3());
        }
    }
    Ok(without_empty(directions, &axes, &cluster_of, rounds))
}

/// First axes: all different, at least one.
fn farthest_first(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<Vec3> {
    let weighted: DVec3 = directions.iter().zip(weights).map(|(d, w)| d.as_dvec3() * f64::from(*w)).sum();
    let mean = weighted.try_normalize().map_or(directions[0], |mean| mean.as_vec3());
    let farthest = |distance: &dyn Fn(Vec3) -> f32| {
        let all = directions.iter().map(|&d| (distance(d), d));
        all.fold((-1.0, Vec3::Z), |best, next| if next.0 > best.0 { next } else { best })
    };
    let mut axes = vec![farthest(&|d| d.distance(mean)).1];
    while axes.len() < count as usize {
        let nearest = |d: Vec3| axes.iter().map(|axis| axis.distance(d)).fold(f32::INFINITY, f32::min);
        let (distance, direction) = farthest(&nearest);
        if distance <= SAME {
            break;
        }
        axes.push(direction);
    }
    axes
}

/// Directions nearer than this are one, in radians.
const SAME: f32 = 1e-3;

/// The axis at the smallest angle, ties to the first. A chord grows with its angle, and keeps small ones
/// apart where a cosine does not.
fn nearest(axes: &[Vec3], direction: Vec3) -> u32 {
    let distances = (0..).zip(axes).map(|(k, axis)| (axis.distance_squared(direction), k));
    distances.fold((f32::INFINITY, 0), |best, next| if next.0 < best.0 { next } else { best }).1
}

/// Numbers the clusters that have members, and finds who speaks for each.
fn without_empty(directions: &[Vec3], axes: &[Vec3], cluster_of: &[u32], rounds: u32) -> AngularClusters {
    let mut place = vec![u32::MAX; axes.len()];
    let mut clusters = AngularClusters { rounds, ..AngularClusters::default() };
    for (k, axis) in axes.iter().enumerate() {
        let members = (0..).zip(directions.iter().zip(cluster_of)).filter(|(_, (_, c))| **c as usize == k);
        let distances = members.map(|(i, (d, _))| (d.distance_squared(*axis), i));
        let best = distances.reduce(|best: (f32, u32), next| if next.0 < best.0 { next } else { best });
        if let Some((_, representative)) = best {
            place[k] = clusters.axes.len() as u32;
            clusters.axes.push(*axis);
            clusters.representatives.push(representative);
        }
    }
    clusters.cluster_of = cluster_of.iter().map(|&k| place[k as usize]).collect();
    clusters
}
