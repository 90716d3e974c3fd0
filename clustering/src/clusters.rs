//! What clustering gives: a partition, its centres, and who speaks for each part.

use crate::centres::Fit;
use lighttree::parallel;

use crate::{Metric, OrientedPoint};

/// One round of k-means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Points that changed their cluster.
    pub moved: u32,
    /// Clusters that had lost all their members and were started anew.
    pub reseeded: u32,
    /// Mean error of a point against its centre, after the round.
    pub mean_error: f64,
}

/// A partition of points: every point is in exactly one cluster, and no cluster is empty.
///
/// Memory: 12 bytes a point and 32 a cluster.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clusters {
    centres: Vec<OrientedPoint>,
    cluster_of: Vec<u32>,
    errors: Vec<f32>,
    /// Members of cluster `k` are `members[starts[k]..starts[k + 1]]`, ascending.
    starts: Vec<u32>,
    members: Vec<u32>,
    representatives: Vec<u32>,
    pub(crate) rounds: Vec<Round>,
}

impl Clusters {
    /// From points with their clusters. Every centre has a member.
    pub(crate) fn new(
        points: &[OrientedPoint],
        metric: &Metric,
        centres: Vec<OrientedPoint>,
        fits: &[Fit],
        rounds: Vec<Round>,
    ) -> Self {
        let (starts, members) = group(fits, centres.len());
        let mut errors: Vec<f32> = vec![0.0; fits.len()];
        parallel::for_each(
            &mut errors,
            || (),
            |(), i, error| {
                *error = metric.between(&points[i], &centres[fits[i].cluster as usize]);
            },
        );
        let mut representatives = vec![0; centres.len()];
        parallel::for_each(
            &mut representatives,
            || (),
            |(), k, representative| {
                let members = &members[starts[k] as usize..starts[k + 1] as usize];
                let least = members
                    .iter()
                    .min_by(|&&a, &&b| errors[a as usize].total_cmp(&errors[b as usize]).then(a.cmp(&b)));
                *representative = *least.expect("no cluster is empty");
            },
        );
        let cluster_of = fits.iter().map(|fit| fit.cluster).collect();
        Self { centres, cluster_of, errors, starts, members, representatives, rounds }
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// Whether there were no points.
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }

    /// Means of the clusters' members when they were last moved; no point as a rule.
    pub fn centres(&self) -> &[OrientedPoint] {
        &self.centres
    }

    /// The cluster of each point.
    pub fn cluster_of(&self) -> &[u32] {
        &self.cluster_of
    }

    /// Error of each point against its cluster's centre.
    pub fn errors(&self) -> &[f32] {
        &self.errors
    }

    /// Indices of the points in cluster `k`, ascending; at least one.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn members(&self, k: usize) -> &[u32] {
        &self.members[self.starts[k] as usize..self.starts[k + 1] as usize]
    }

    /// The member of cluster `k` with the least error, ties to the first: where its irradiance is sampled.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn representative(&self, k: usize) -> u32 {
        self.representatives[k]
    }

    /// Error of the member of cluster `k` that fits worst.
    ///
    /// # Panics
    /// If there is no such cluster.
    pub fn largest_error(&self, k: usize) -> f32 {
        self.members(k).iter().map(|&i| self.errors[i as usize]).fold(0.0, f32::max)
    }

    /// Points that fit their cluster worse than `limit`: thin things that have no cluster of their own, and
    /// would need one.
    pub fn needs_more(&self, limit: f32) -> impl Iterator<Item = u32> + '_ {
        (0..).zip(&self.errors).filter_map(move |(i, &error)| (error > limit).then_some(i))
    }

    /// What each round of k-means did.
    pub fn rounds(&self) -> &[Round] {
        &self.rounds
    }
}

/// Points by cluster: where each cluster's begin, and all of them, ascending within a cluster.
pub(crate) fn group(fits: &[Fit], clusters: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; clusters + 1];
    for fit in fits {
        starts[fit.cluster as usize + 1] += 1;
    }
    for k in 0..clusters {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut members = vec![0; fits.len()];
    for (i, fit) in (0..).zip(fits) {
        let place = &mut next[fit.cluster as usize];
        members[*place as usize] = i;
        *place += 1;
    }
    (starts, members)
}
