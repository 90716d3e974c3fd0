//! The virtual lights of a cell: few polygons and disks instead of many points.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.1. Members in one plane become a polygon, and what no plane
//! takes is grouped by orientation into disks.
//!
//! Differs from the paper:
//! - a polygon is the octagon around its members, to an eighth of the cell's side; that it may reach beyond
//!   the surface by a sixteenth shows nowhere, since shadow rays go to members, never to points between them;
//! - these are the eight with the least hashes of their names. All that lights are made of is rounded, or
//!   picked by hash: so a path that changes mostly changes the flux of the lights that it belongs to, and
//!   neither their outlines nor their shadow rays, which would be noise all over the map;
//! - a disk faces along its members' mean normal: a plane fitted to scattered members says little about where
//!   their light goes;
//! - small pieces of a plane that continues in the next cell stay disks of their own: a light that reaches
//!   over two cells would make the update of one depend on the other.

use glam::{DVec3, Vec3};

use crate::normal_code::{decode, encode};
use crate::planes::{PlaneRules, Vpl, grow, mean};
use crate::{Places, Polygon, Shape, VirtualLight};

/// Puts unit directions with weights into at most so many clusters: the cluster of each, counted from 0. The
/// same input must give the same answer.
///
/// With the crate `lighttree-clustering`, whose `angular_clusters` does that:
///
/// ```
/// # use glam::Vec3;
/// let group: bake::GroupDirections = |directions, weights, count| {
///     // One cluster for all is always right.
///     clustering::angular_clusters(directions, weights, count, 20)
///         .map_or_else(|_| vec![0; directions.len()], |clusters| clusters.cluster_of)
/// };
/// let groups = group(&[Vec3::X, Vec3::Y, Vec3::X], &[1.0; 3], 2);
/// assert!(groups[0] == groups[2] && groups[0] != groups[1]);
/// ```
pub type GroupDirections = fn(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32>;

/// Steps of outlines and centres along the side of a cell.
const STEPS: f64 = 8.0;

/// How members of a cell become lights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellRules {
    /// K: the most lights of a cell.
    pub(crate) lights: usize,
    /// `p_min`: a polygon has as many members.
    pub(crate) plane_members: usize,
    pub(crate) planes: PlaneRules,
    /// Side of the cell.
    pub(crate) side: f32,
    /// How far polygons are moved off their surface.
    pub(crate) lift: f32,
    pub(crate) group: GroupDirections,
}

/// The lights of members in canonical order; `seed` of a light's name within the cell, its normal and its
/// height, gives its seed.
pub(crate) fn cell_lights(
    vpls: &[Vpl],
    rules: &CellRules,
    seed: impl Fn([u32; 2]) -> u32,
) -> Vec<VirtualLight> {
    let (mut groups, mut scattered) = grow(vpls, &rules.planes);
    let clusters = groups.len() + usize::from(!scattered.is_empty());
    let most = if clusters > rules.lights { rules.lights - 1 } else { rules.lights };
    let (mut shapes, mut polygons) = (Vec::new(), 0);
    groups.retain(|group| {
        let polygon =
            (polygons < most && group.len() >= rules.plane_members).then(|| polygon(vpls, group, rules));
        match polygon.flatten() {
            Some(light) => {
                polygons += 1;
                shapes.push(light);
                false
            }
            None => true,
        }
    });
    scattered.extend(groups.into_iter().flatten());
    scattered.sort_unstable();
    shapes.extend(disks(vpls, &scattered, rules, (rules.lights - polygons) as u32));
    let light = |(shape, flux): (Shape, DVec3)| {
        let seed = seed(name(&shape, rules));
        VirtualLight { shape, flux: flux.as_vec3(), seed }
    };
    shapes.into_iter().map(light).collect()
}

/// What a light is called within its cell, which does not depend on which of them shine more: its
/// orientation, and of patches the height of their plane.
fn name(shape: &Shape, rules: &CellRules) -> [u32; 2] {
    match shape {
        Shape::Patch { polygon, .. } => {
            let height = polygon.normal().dot(polygon.centroid() - rules.planes.center) / rules.lift;
            [encode(rounded(polygon.normal())), height.round() as i32 as u32]
        }
        Shape::Disk { normal, .. } => [encode(*normal), u32::MAX],
        _ => [u32::MAX; 2],
    }
}

fn polygon(vpls: &[Vpl], group: &[u32], rules: &CellRules) -> Option<(Shape, DVec3)> {
    let (flux, normal) = mean(vpls, group);
    // Rounded, or the sum's last bits would be seen.
    let normal = decode(encode(normal.try_normalize()?.as_vec3()));
    let polygon = outline(vpls, group, normal, rules)?;
    let mut order: Vec<u32> = group.to_vec();
    let last = order.len().min(Places::MOST);
    order.sort_unstable_by_key(|&i| (vpls[i as usize].hash, i));
    let places: Vec<Vec3> = order[..last].iter().map(|&i| vpls[i as usize].position).collect();
    Some((Shape::Patch { polygon, places: Places::new(&places)?.into() }, flux))
}

/// The octagon around members, with sides at multiples of an eighth of the cell's side from the cell's
/// centre, on the plane through the farthest member: it must not lie below the surface anywhere.
fn outline(vpls: &[Vpl], group: &[u32], normal: Vec3, rules: &CellRules) -> Option<Polygon> {
    let center = rules.planes.center.as_dvec3();
    let axis = normal.as_dvec3();
    let (a, b) = axis.any_orthonormal_pair();
    // `any_orthonormal_pair` may be left-handed.
    let b = if a.cross(b).dot(axis) > 0.0 { b } else { -b };
    let (mut reach, mut height) = ([f64::NEG_INFINITY; 8], f64::NEG_INFINITY);
    for &i in group {
        let at = vpls[i as usize].position.as_dvec3() - center;
        let (x, y, diagonal) = (at.dot(a), at.dot(b), core::f64::consts::FRAC_1_SQRT_2);
        let along = [x, (x + y) * diagonal, y, (y - x) * diagonal];
        for (i, along) in along.into_iter().enumerate() {
            reach[i] = reach[i].max(along);
            reach[i + 4] = reach[i + 4].max(-along);
        }
        height = height.max(at.dot(axis));
    }
    let step = f64::from(rules.side) / STEPS;
    for i in 0..4 {
        let (mut low, mut high) = ((-reach[i + 4] / step).round(), (reach[i] / step).round());
        if low >= high {
            (low, high) = (low - 0.5, high + 0.5);
        }
        (reach[i], reach[i + 4]) = (high * step, -low * step);
    }
    let lift = f64::from(rules.lift);
    let height = ((height / lift).ceil() + 1.0) * lift;
    let mut corners: Vec<[f64; 2]> =
        vec![[reach[0], -reach[6]], [reach[0], reach[2]], [-reach[4], reach[2]], [-reach[4], -reach[6]]];
    for (i, [x, y]) in [(1, [1.0, 1.0]), (3, [-1.0, 1.0]), (5, [-1.0, -1.0]), (7, [1.0, -1.0])] {
        let scale = core::f64::consts::FRAC_1_SQRT_2;
        corners = cut_off(&corners, [x * scale, y * scale], reach[i]);
    }
    let in_space = |[x, y]: [f64; 2]| (center + x * a + y * b + height * axis).as_vec3();
    let corners: Vec<Vec3> = corners.into_iter().map(in_space).collect();
    let polygon = Polygon::new(&corners)?;
    // A sliver is no better than a line.
    let sliver = polygon.area() < 1e-3 * polygon.radius() * polygon.radius();
    (!sliver).then_some(polygon)
}

/// The part of a convex polygon where `along · p <= reach`.
fn cut_off(corners: &[[f64; 2]], along: [f64; 2], reach: f64) -> Vec<[f64; 2]> {
    let over = |p: [f64; 2]| along[0] * p[0] + along[1] * p[1] - reach;
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (i, &p) in corners.iter().enumerate() {
        let q = corners[(i + 1) % corners.len()];
        let (over_p, over_q) = (over(p), over(q));
        if over_p <= 0.0 {
            kept.push(p);
        }
        if (over_p < 0.0 && over_q > 0.0) || (over_p > 0.0 && over_q < 0.0) {
            let t = over_p / (over_p - over_q);
            kept.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
        }
    }
    kept
}

/// A direction in steps of some two degrees, along the axes exactly.
fn rounded(normal: Vec3) -> Vec3 {
    (normal * 32.0).round().try_normalize().unwrap_or(normal)
}

fn disks(vpls: &[Vpl], members: &[u32], rules: &CellRules, count: u32) -> Vec<(Shape, DVec3)> {
    if members.is_empty() {
        return Vec::new();
    }
    let directions: Vec<Vec3> = members.iter().map(|&i| vpls[i as usize].normal).collect();
    let weights: Vec<f32> = members.iter().map(|&i| vpls[i as usize].flux.element_sum()).collect();
    let cluster_of = (rules.group)(&directions, &weights, count);
    assert_eq!(cluster_of.len(), members.len(), "one cluster per direction");
    let clusters = cluster_of.iter().max().map_or(0, |last| last + 1);
    assert!(clusters <= count, "as many clusters as were asked for, or fewer");
    let of =
        |k: u32| members.iter().zip(&cluster_of).filter(move |&(_, &c)| c == k).map(|(&i, _)| i).collect();
    (0..clusters)
        .map(of)
        .filter(|group: &Vec<u32>| !group.is_empty())
        .map(|group| disk(vpls, &group, rules))
        .collect()
}

fn disk(vpls: &[Vpl], group: &[u32], rules: &CellRules) -> (Shape, DVec3) {
    let (flux, normal) = mean(vpls, group);
    let n = group.len() as f64;
    let at = |i: &u32| vpls[*i as usize].position.as_dvec3();
    let center = group.iter().map(at).sum::<DVec3>() / n;
    let variance = group.iter().map(|i| at(i).distance_squared(center)).sum::<f64>() / n;
    let step = f64::from(rules.side) / STEPS;
    let cell = rules.planes.center.as_dvec3();
    let middle = cell + ((center - cell) / step).round() * step;
    let nearest = |a: u32, b: u32| {
        if at(&b).distance_squared(middle) < at(&a).distance_squared(middle) { b } else { a }
    };
    let speaker = &vpls[group.iter().copied().reduce(nearest).expect("a disk has members") as usize];
    // Opposed normals have no mean; a lone light stands for an eighth of its cell.
    let normal = normal.try_normalize().map_or(speaker.normal, |normal| rounded(normal.as_vec3()));
    let radius = ((2.0 * variance).sqrt() / step).ceil().max(1.0) * step;
    (Shape::Disk { position: speaker.position, normal, radius: radius as f32 }, flux)
}
