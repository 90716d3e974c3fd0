//! Which centre is nearest: a k-d tree of the centres, and each centre's neighbours.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use lighttree::parallel;

use crate::{Metric, OrientedPoint};

/// Two sides of one inequality, each rounded a few times.
const SLACK: f32 = 1.0 + 1e-5;

/// Centres that can be searched. The tree is in the metric's six dimensions, where Euclid's distance is from
/// ε/√2 to ε.
pub(crate) struct Centres<'a> {
    metric: &'a Metric,
    centres: &'a [OrientedPoint],
    tree: ImmutableKdTree<f32, 6>,
}

impl<'a> Centres<'a> {
    /// At least one centre.
    pub(crate) fn new(metric: &'a Metric, centres: &'a [OrientedPoint]) -> Self {
        let embedded: Vec<[f32; 6]> = centres.iter().map(|c| metric.embed(c)).collect();
        let tree = ImmutableKdTree::new_from_slice(&embedded).expect("indices of centres fit into 32 bits");
        Self { metric, centres, tree }
    }

    /// A centre that is near: its error is at most √2 times the least.
    pub(crate) fn near(&self, point: &OrientedPoint) -> u32 {
        self.tree.query(&self.metric.embed(point)).nearest_one::<SquaredEuclidean<f32>>().execute().item
    }

    /// The nearest centre, ties to the first, and its error. The search widens until no centre outside it can
    /// be nearer.
    pub(crate) fn nearest(&self, point: &OrientedPoint) -> (u32, f32) {
        let embedded = self.metric.embed(point);
        let mut wanted = 4;
        loop {
            let count = core::num::NonZero::new(wanted).unwrap_or(core::num::NonZero::<usize>::MIN);
            let found = self.tree.query(&embedded).nearest_n::<SquaredEuclidean<f32>>(count).execute();
            let exact = |item: u32| (self.metric.between(point, &self.centres[item as usize]), item);
            let best =
                found.iter().map(|n| exact(n.item)).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let searched = found.iter().map(|n| n.distance).fold(0.0, f32::max).sqrt();
            if let Some((error, item)) = best
                && (found.len() >= self.centres.len() || searched > error * SLACK)
            {
                return (item, error);
            }
            wanted *= 2;
        }
    }

    /// All centres whose error against centre `from` is at most `radius`, itself excluded, nearest first.
    fn neighbours(&self, from: u32, radius: f32) -> Vec<(f32, u32)> {
        let centre = &self.centres[from as usize];
        let reach = (radius * SLACK).powi(2) * SLACK;
        let embedded = self.metric.embed(centre);
        let found = self.tree.query(&embedded).within::<SquaredEuclidean<f32>>(reach).unsorted().execute();
        let others = found.iter().map(|n| n.item).filter(|&item| item != from);
        let mut list: Vec<_> = others
            .map(|item| (self.metric.between(centre, &self.centres[item as usize]), item))
            .filter(|&(error, _)| error <= radius * SLACK)
            .collect();
        list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        list
    }
}

/// A point's cluster and how badly it fits there.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Fit {
    pub(crate) cluster: u32,
    pub(crate) error: f32,
    /// Whether the last assignment changed the cluster.
    pub(crate) moved: bool,
}

/// Puts every point to its nearest centre, ties to the first, given a guess in `fits`.
///
/// A centre that is farther from the point's own than twice the point's error cannot be nearer; so neighbours
/// are looked at nearest first, and few of them.
pub(crate) fn assign(points: &[OrientedPoint], metric: &Metric, centres: &[OrientedPoint], fits: &mut [Fit]) {
    // How far each point's guess is off.
    parallel::for_each(
        fits,
        || (),
        |(), i, fit| {
            fit.error = metric.between(&points[i], &centres[fit.cluster as usize]);
        },
    );
    let mut largest = vec![0.0f32; centres.len()];
    for fit in fits.iter() {
        let largest = &mut largest[fit.cluster as usize];
        *largest = largest.max(fit.error);
    }

    // Who could be nearer to any member.
    let search = Centres::new(metric, centres);
    let mut lists = vec![Vec::new(); centres.len()];
    parallel::for_each(
        &mut lists,
        || (),
        |(), k, list| {
            if largest[k] > 0.0 {
                *list = search.neighbours(k as u32, 2.0 * largest[k]);
            }
        },
    );

    // Who is.
    parallel::for_each(
        fits,
        || (),
        |(), i, fit| {
            let own = *fit;
            let mut best = (own.error, own.cluster);
            for &(distance, k) in &lists[own.cluster as usize] {
                if distance > (own.error + best.0) * SLACK {
                    break;
                }
                let error = metric.between(&points[i], &centres[k as usize]);
                if error < best.0 || (error == best.0 && k < best.1) {
                    best = (error, k);
                }
            }
            *fit = Fit { cluster: best.1, error: best.0, moved: best.1 != own.cluster };
        },
    );
}
