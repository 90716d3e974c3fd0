//! Directions by angle.

use clustering::{ClusterError, angular_clusters};
use glam::Vec3;
use lighttree::rng::Random;
use proptest::prelude::*;

fn around(axis: Vec3, spread: f32, random: &mut Random) -> Vec3 {
    let jitter = Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
    (axis + spread * jitter).normalize()
}

#[test]
fn bundles_are_told_apart() {
    let mut random = Random::new(1, 0, 0);
    let axes = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::Z];
    let directions: Vec<_> = (0..200).map(|i| around(axes[i % 4], 0.2, &mut random)).collect();
    let clusters = angular_clusters(&directions, &[1.0; 200], 4, 20).unwrap();
    assert_eq!(clusters.axes.len(), 4);
    for i in 4..200 {
        assert_eq!(clusters.cluster_of[i], clusters.cluster_of[i % 4]);
    }
    for (axis, &representative) in clusters.axes.iter().zip(&clusters.representatives) {
        let least = directions.iter().map(|d| d.distance(*axis)).fold(f32::INFINITY, f32::min);
        assert_eq!(directions[representative as usize].distance(*axis), least);
    }
}

#[test]
fn weights_pull() {
    let directions = [Vec3::X, Vec3::Y];
    let clusters = angular_clusters(&directions, &[3.0, 1.0], 1, 10).unwrap();
    assert!(clusters.axes[0].distance(Vec3::new(3.0, 1.0, 0.0).normalize()) < 1e-6);
    assert_eq!(clusters.representatives, [0]);
    let zero = angular_clusters(&directions, &[0.0, 0.0], 1, 10).unwrap();
    assert!(zero.axes[0].is_normalized());
}

#[test]
fn extremes() {
    assert!(angular_clusters(&[], &[], 0, 5).unwrap().axes.is_empty());
    assert_eq!(angular_clusters(&[Vec3::X], &[1.0], 0, 5), Err(ClusterError::NoClusters));
    assert_eq!(angular_clusters(&[Vec3::ZERO], &[1.0], 1, 5), Err(ClusterError::NotUnit { index: 0 }));
    assert_eq!(angular_clusters(&[Vec3::X], &[f32::NAN], 1, 5), Err(ClusterError::BadWeight { index: 0 }));
    // No more clusters than directions that differ.
    let same = angular_clusters(&[Vec3::X; 9], &[1.0; 9], 4, 5).unwrap();
    assert_eq!((same.axes.len(), same.cluster_of), (1, vec![0; 9]));
    let opposed = angular_clusters(&[Vec3::X, Vec3::NEG_X], &[1.0; 2], 1, 5).unwrap();
    assert!(opposed.axes.len() == 1 && opposed.axes[0].is_normalized());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn is_a_partition(size in 1usize..60, count in 1u32..8, rounds in 0u32..10, seed in 0u32..1000) {
        let mut random = Random::new(seed, 0, 0);
        let directions: Vec<_> = (0..size).map(|_| around(Vec3::ZERO, 1.0, &mut random)).collect();
        let weights: Vec<_> = (0..size).map(|_| random.f32()).collect();
        let clusters = angular_clusters(&directions, &weights, count, rounds).unwrap();
        prop_assert!((1..=count as usize).contains(&clusters.axes.len()));
        prop_assert_eq!(clusters.cluster_of.len(), size);
        for (k, &representative) in (0..).zip(&clusters.representatives) {
            prop_assert_eq!(clusters.cluster_of[representative as usize], k);
        }
        prop_assert!(clusters.axes.iter().all(|axis| axis.is_normalized()));
        let total = clusters.cluster_of.iter().all(|&k| (k as usize) < clusters.axes.len());
        prop_assert!(total);
    }
}
