//! Virtual point lights of a cell that lie in planes: greedy growing in four dimensions.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.1, "Similarity Clustering". A light at p with normal n has
//! the plane (n, n·(p - c) sin `σ_n` / `σ_d`), c the cell's centre; planes are one where they are within sin
//! `σ_n` of each other.
//!
//! Differs from the paper: seeds are taken by flux, then by name, so that the order of members does not
//! matter; members are compared with the seed's plane, and the plane is fitted once at the end; after 64
//! seeds the rest counts as scattered.

use glam::{DVec3, Vec3, Vec4};

/// A virtual point light as it goes into a cluster, in an order that its cell's history does not change:
/// flux, then name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vpl {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    pub(crate) flux: Vec3,
    /// A hash of its name.
    pub(crate) hash: u32,
}

/// Tolerances of planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlaneRules {
    /// Sine of `σ_n`.
    pub(crate) sine: f32,
    /// `σ_d`, in lengths of the scene.
    pub(crate) distance: f32,
    /// Centre of the cell.
    pub(crate) center: Vec3,
}

/// Seeds that are tried.
const SEEDS: usize = 64;

/// Groups of lights in one plane each, largest flux first, every light in one group at most; what is in none
/// comes last.
pub(crate) fn grow(vpls: &[Vpl], rules: &PlaneRules) -> (Vec<Vec<u32>>, Vec<u32>) {
    let plane = |vpl: &Vpl| -> Vec4 {
        let height = vpl.normal.as_dvec3().dot((vpl.position - rules.center).as_dvec3());
        vpl.normal.extend((height * f64::from(rules.sine / rules.distance)) as f32)
    };
    let planes: Vec<Vec4> = vpls.iter().map(plane).collect();
    let mut left: Vec<u32> = (0..vpls.len() as u32).collect();
    let mut groups: Vec<(f64, Vec<u32>)> = Vec::new();
    while let Some(&seed) = left.first()
        && groups.len() < SEEDS
    {
        let near =
            |i: u32| planes[i as usize].distance_squared(planes[seed as usize]) <= rules.sine * rules.sine;
        let (group, rest) = left.iter().partition(|&&i| near(i));
        left = rest;
        groups.push((flux(vpls, &group), group));
    }
    // Stable: the earlier seed wins a tie.
    groups.sort_by(|a, b| b.0.total_cmp(&a.0));
    (groups.into_iter().map(|(_, group)| group).collect(), left)
}

/// Scalar flux of some lights.
fn flux(vpls: &[Vpl], group: &[u32]) -> f64 {
    group.iter().map(|&i| vpls[i as usize].flux.as_dvec3().element_sum()).sum()
}

/// Flux of some lights, W per channel, and their mean normal by flux, not of unit length.
pub(crate) fn mean(vpls: &[Vpl], group: &[u32]) -> (DVec3, DVec3) {
    let (mut flux, mut normal, mut plain) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for &i in group {
        let vpl = &vpls[i as usize];
        flux += vpl.flux.as_dvec3();
        normal += vpl.normal.as_dvec3() * vpl.flux.as_dvec3().element_sum();
        plain += vpl.normal.as_dvec3();
    }
    let total = flux.element_sum();
    (flux, if total > 0.0 { normal / total } else { plain / group.len().max(1) as f64 })
}
