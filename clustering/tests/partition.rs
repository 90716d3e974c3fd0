//! What must hold of any partition.

use clustering::{ClusterError, ClusterParams, Clusters, Metric, OrientedPoint, Seeding, cluster};
use glam::Vec3;
use lighttree::rng::Random;
use proptest::prelude::*;

/// Points on the inside of a box, with clumps, copies and opposite normals.
fn points(count: usize, seed: u32) -> Vec<OrientedPoint> {
    let mut random = Random::new(seed, 0, 0);
    (0..count)
        .map(|i| {
            let side = i % 6;
            let mut at = [random.f32(), random.f32(), random.f32()];
            if random.f32() < 0.3 {
                at = at.map(|c| (c * 4.0).round() / 4.0);
            }
            at[side / 2] = (side % 2) as f32;
            let mut normal = [0.0; 3];
            normal[side / 2] = if random.f32() < 0.1 { -1.0 } else { 1.0 };
            OrientedPoint { position: Vec3::from(at), normal: Vec3::from(normal) }
        })
        .collect()
}

fn metric() -> Metric {
    Metric::new(0.3, 1.0).unwrap()
}

/// Every point in one cluster, no cluster empty, and who speaks fits best.
fn assert_partition(clusters: &Clusters, points: &[OrientedPoint], metric: &Metric) {
    assert_eq!(clusters.cluster_of().len(), points.len());
    let mut seen = vec![false; points.len()];
    for k in 0..clusters.len() {
        let members = clusters.members(k);
        assert!(!members.is_empty());
        for &i in members {
            assert!(!std::mem::replace(&mut seen[i as usize], true));
            assert_eq!(clusters.cluster_of()[i as usize], k as u32);
            let error = metric.between(&points[i as usize], &clusters.centres()[k]);
            assert_eq!(error, clusters.errors()[i as usize]);
            assert!(clusters.errors()[clusters.representative(k) as usize] <= error);
        }
        assert!(members.contains(&clusters.representative(k)));
    }
    assert!(seen.iter().all(|&seen| seen));
}

/// The oracle: all centres, one by one.
fn brute(point: &OrientedPoint, centres: &[OrientedPoint], metric: &Metric) -> f32 {
    centres.iter().map(|centre| metric.between(point, centre)).fold(f32::INFINITY, f32::min)
}

fn assert_nearest(clusters: &Clusters, points: &[OrientedPoint], metric: &Metric, but: u32) {
    let worse = |(point, &error): (&OrientedPoint, &f32)| error > brute(point, clusters.centres(), metric);
    let wrong = points.iter().zip(clusters.errors()).filter(|&pair| worse(pair)).count();
    assert!(wrong <= but as usize, "{wrong} points are not with their nearest centre");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn is_a_partition(size in 1usize..400, count in 1u32..500, seed in 0u32..1000, rounds in 0u32..4) {
        let (points, metric) = (points(size, seed), metric());
        let pixels: Vec<u32> = (0..size as u32).map(|i| i * 7 % 101).collect();
        for seeding in [Seeding::Octree, Seeding::Screen { width: 10, pixels: &pixels }] {
            let params = ClusterParams { max_rounds: rounds, seed, ..ClusterParams::with_count(count) };
            let clusters = cluster(&points, seeding, &metric, &params).unwrap();
            prop_assert_eq!(clusters.len(), size.min(count as usize), "exactly as many as asked for");
            assert_partition(&clusters, &points, &metric);
            if clusters.rounds().last().is_some_and(|round| round.reseeded == 0) {
                assert_nearest(&clusters, &points, &metric, 0);
            }

            // The next frame: others, and a few of the same.
            let next = [&points[..size / 2], &self::points(size / 3 + 1, seed + 1)].concat();
            let pixels: Vec<u32> = (0..next.len() as u32).collect();
            let seeding = match seeding {
                Seeding::Octree => seeding,
                Seeding::Screen { width, .. } => Seeding::Screen { width, pixels: &pixels },
            };
            let (after, stayed) = clusters.follow(&next, seeding, &metric, &params).unwrap();
            prop_assert_eq!(after.len(), next.len().min(count as usize));
            prop_assert!(stayed <= clusters.len().min(after.len()));
            assert_partition(&after, &next, &metric);
        }
    }

    /// A scene has no unit of length. Powers of two from 1e-30 to 1e30, so that nothing is rounded otherwise.
    #[test]
    fn scales_do_not_show(size in 100usize..300, count in 2u32..60, seed in 0u32..1000, exponent in -100i32..=100) {
        let points = points(size, seed);
        let scale = 2.0f32.powi(exponent);
        let scaled: Vec<_> =
            points.iter().map(|p| OrientedPoint { position: scale * p.position, normal: p.normal }).collect();
        let params = ClusterParams { seed, ..ClusterParams::with_count(count) };
        let of = |points: &[_], radius| {
            cluster(points, Seeding::Octree, &Metric::new(0.3, radius).unwrap(), &params).unwrap()
        };
        let (plain, large) = (of(&points, 1.0), of(&scaled, scale));
        prop_assert_eq!(plain.cluster_of(), large.cluster_of());
        prop_assert_eq!(plain.errors(), large.errors());
        prop_assert!(plain.errors().iter().any(|&error| error > 0.0));
    }
}

#[test]
fn extremes() {
    let metric = metric();
    let params = |count| ClusterParams::with_count(count);
    let none = cluster(&[], Seeding::Octree, &metric, &params(5)).unwrap();
    assert!(none.is_empty() && none.cluster_of().is_empty());
    let some = points(10, 1);
    let error = cluster(&some, Seeding::Octree, &metric, &params(0)).unwrap_err();
    assert_eq!(error, ClusterError::NoClusters);
    assert_eq!(cluster(&some, Seeding::Octree, &metric, &params(1)).unwrap().members(0).len(), 10);
    assert_eq!(cluster(&some, Seeding::Octree, &metric, &params(10)).unwrap().len(), 10);
    assert_eq!(cluster(&some, Seeding::Octree, &metric, &params(u32::MAX)).unwrap().len(), 10);

    // All in one place: still as many clusters as asked for, none empty.
    let same = [OrientedPoint { position: Vec3::ONE, normal: Vec3::Y }; 100];
    let clusters = cluster(&same, Seeding::Octree, &metric, &params(7)).unwrap();
    assert_eq!(clusters.len(), 7);
    assert_partition(&clusters, &same, &metric);

    let at = |position, normal| OrientedPoint { position, normal };
    let bad = [at(Vec3::ZERO, Vec3::Y), at(Vec3::splat(f32::NAN), Vec3::Y)];
    let refused = |points: &[_]| cluster(points, Seeding::Octree, &metric, &params(1)).unwrap_err();
    assert_eq!(refused(&bad), ClusterError::NonFinite { index: 1 });
    assert_eq!(refused(&[at(Vec3::ZERO, Vec3::ZERO)]), ClusterError::NotUnit { index: 0 });
    let pixels = Seeding::Screen { width: 4, pixels: &[1, 2] };
    let error = cluster(&same, pixels, &metric, &params(1)).unwrap_err();
    assert_eq!(error, ClusterError::PixelCount { points: 100, pixels: 2 });
    let pixels = Seeding::Screen { width: 0, pixels: &[0; 100] };
    assert_eq!(cluster(&same, pixels, &metric, &params(1)).unwrap_err(), ClusterError::Screen { width: 0 });
    assert!(Metric::new(f32::NAN, 1.0).is_err() && Metric::new(0.1, 0.0).is_err());
}

#[test]
fn weighted_seeds_go_where_the_weight_is() {
    // A screen of 64 by 64, of which a corner of 8 by 8 weighs something, and one point there most.
    let pixels: Vec<u32> = (0..64 * 64).collect();
    let place = |i: u32| Vec3::new((i % 64) as f32, (i / 64) as f32, 0.0) / 64.0;
    let points: Vec<_> =
        pixels.iter().map(|&i| OrientedPoint { position: place(i), normal: Vec3::Z }).collect();
    let heavy = 3 * 64 + 5;
    let corner = |i: u32| i % 64 < 8 && i / 64 < 8;
    let weigh = |&i: &u32| if i == heavy { 40.0 } else { f32::from(u8::from(corner(i))) };
    let weights: Vec<f32> = pixels.iter().map(weigh).collect();
    for seeding in [Seeding::Screen { width: 64, pixels: &pixels }, Seeding::Octree] {
        for count in [1, 10, 64] {
            let mut seeds = seeding.weighted(&points, &weights, count).unwrap();
            assert!(seeds.contains(&heavy) && seeds.iter().all(|&i| corner(i)), "{seeds:?}");
            seeds.sort_unstable();
            seeds.dedup();
            assert_eq!(seeds.len(), count as usize);
        }
        // More than there is weight for: still all different, and as many.
        let mut seeds = seeding.weighted(&points, &weights, 500).unwrap();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!((seeds.len(), seeds.iter().filter(|&&i| corner(i)).count()), (500, 64));
        assert_eq!(seeding.weighted(&points, &weights, u32::MAX).unwrap().len(), points.len());
        assert_eq!(seeding.weighted(&points, &weights, 0).unwrap(), []);
        let error = seeding.weighted(&points, &weights[1..], 1).unwrap_err();
        assert_eq!(error, ClusterError::WeightCount { points: 4096, weights: 4095 });
        let mut bad = weights.clone();
        bad[7] = -1.0;
        assert_eq!(seeding.weighted(&points, &bad, 1).unwrap_err(), ClusterError::BadWeight { index: 7 });
    }
    assert_eq!(Seeding::Octree.weighted(&[], &[], 3).unwrap(), []);
}

#[test]
fn scale_does_not_matter() {
    let plain = points(500, 3);
    let of = |scale: f32| {
        let scaled: Vec<_> =
            plain.iter().map(|p| OrientedPoint { position: p.position * scale, ..*p }).collect();
        let metric = Metric::new(0.3, scale).unwrap();
        cluster(&scaled, Seeding::Octree, &metric, &ClusterParams::with_count(40)).unwrap()
    };
    // Powers of two, so that even rounding is the same.
    let expected = of(1.0);
    assert_eq!(of(2.0f32.powi(-60)).cluster_of(), expected.cluster_of());
    assert_eq!(of(2.0f32.powi(60)).cluster_of(), expected.cluster_of());
}

#[test]
fn rounds_bring_points_and_centres_together() {
    let (points, metric) = (points(20_000, 5), metric());
    let clusters = cluster(&points, Seeding::Octree, &metric, &ClusterParams::with_count(300)).unwrap();
    let rounds = clusters.rounds();
    assert!(
        rounds.len() >= 3 && rounds.last().unwrap().mean_error < 0.95 * rounds[0].mean_error,
        "{rounds:?}"
    );
    // Only points that started a cluster anew may be elsewhere.
    assert_nearest(&clusters, &points, &metric, rounds.last().unwrap().reseeded);
    let limit = clusters.largest_error(0);
    assert!(clusters.needs_more(limit).all(|i| clusters.errors()[i as usize] > limit));
}

#[test]
fn seeds_go_where_geometry_varies() {
    // The left half of the screen is flat, the right half is a box of folds.
    let width = 64;
    let pixels: Vec<u32> = (0..width * width).collect();
    let fold = |x: u32| if x.is_multiple_of(2) { Vec3::X } else { Vec3::Z };
    let points: Vec<_> = pixels
        .iter()
        .map(|&pixel| {
            let (x, y) = (pixel % width, pixel / width);
            let normal = if x < width / 2 { Vec3::Y } else { fold(x) };
            OrientedPoint { position: Vec3::new(x as f32, 0.0, y as f32) / 64.0, normal }
        })
        .collect();
    let params = ClusterParams { max_rounds: 0, ..ClusterParams::with_count(200) };
    let clusters = cluster(&points, Seeding::Screen { width, pixels: &pixels }, &metric(), &params).unwrap();
    let right = clusters.centres().iter().filter(|centre| centre.position.x >= 0.5).count();
    assert!(right > 150 && right < 200, "{right} of 200 seeds in the folds");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (points, metric) = (points(30_000, 9), metric());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let first = cluster(&points, Seeding::Octree, &metric, &ClusterParams::with_count(400)).unwrap();
            let next = &points[5000..];
            let params = ClusterParams::with_count(380);
            let after = first.follow(next, Seeding::Octree, &metric, &params).unwrap();
            (first, after)
        })
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn what_does_not_move_keeps_its_clusters() {
    let (points, metric) = (points(5000, 11), metric());
    let params = ClusterParams::with_count(100);
    let first = cluster(&points, Seeding::Octree, &metric, &params).unwrap();
    let (after, stayed) = first.follow(&points, Seeding::Octree, &metric, &params).unwrap();
    assert_eq!((stayed, after.centres()), (100, first.centres()));

    // A quarter of the points jumps away: clusters elsewhere stay.
    let jump = |p: &OrientedPoint| p.position.x > 0.75;
    let away = |p: &OrientedPoint| OrientedPoint { position: p.position + Vec3::X * 3.0, ..*p };
    let moved: Vec<_> = points.iter().map(|p| if jump(p) { away(p) } else { *p }).collect();
    let (after, stayed) = first.follow(&moved, Seeding::Octree, &metric, &params).unwrap();
    assert!(after.len() == 100 && stayed > 50 && stayed < 100, "{stayed} centres stayed");
    assert_partition(&after, &moved, &metric);
}
