//! The virtual lights of a cell: few polygons and disks instead of many points.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.1. Members in one plane become a polygon, and what no plane takes is grouped by orientation into disks.
//!
//! Differs from the paper:
//! - a polygon is the convex hull of its members, so it lies within its cell and never beyond the surface it stands for; at most 8 corners of it are kept;
//! - a disk faces along its members' mean normal: a plane fitted to scattered members says little about where their light goes;
//! - small pieces of a plane that continues in the next cell stay disks of their own: a light that reaches over two cells would make the update of one depend
//!   on the other.

use glam::{DVec3, Vec3};

use crate::hull::convex_hull;
use crate::planes::{PlaneRules, Vpl, grow, mean};
use crate::{Polygon, Shape, VirtualLight};

/// Puts unit directions with weights into at most so many clusters: the cluster of each, counted from 0. The same input must give the same answer.
///
/// `clustering::angular_clusters` is one (crate `lighttree-clustering`).
pub type GroupDirections = fn(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32>;

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

/// The lights of members in canonical order; `seed` names the cell.
pub(crate) fn cell_lights(vpls: &[Vpl], rules: &CellRules, seed: impl Fn(u32) -> u32) -> Vec<VirtualLight> {
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
    let number = |(i, (shape, flux)): (u32, (Shape, DVec3))| VirtualLight {
        shape,
        flux: flux.as_vec3(),
        seed: seed(i),
    };
    (0..).zip(shapes).map(number).collect()
}

fn polygon(vpls: &[Vpl], group: &[u32], rules: &CellRules) -> Option<(Shape, DVec3)> {
    let (flux, normal) = mean(vpls, group);
    let normal = normal.try_normalize()?.as_vec3();
    // On the plane through the farthest member: a polygon must not lie below the surface anywhere.
    let points: Vec<Vec3> = group.iter().map(|&i| vpls[i as usize].position).collect();
    let mut corners = convex_hull(&points, normal);
    for corner in &mut corners {
        *corner += rules.lift * normal;
    }
    let polygon = Polygon::new(&corners)?;
    // A sliver is no better than a line.
    let sliver = polygon.area() < 1e-3 * polygon.radius() * polygon.radius();
    (!sliver).then_some((Shape::Polygon(polygon), flux))
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
    let nearest = |a: u32, b: u32| {
        if at(&b).distance_squared(center) < at(&a).distance_squared(center) { b } else { a }
    };
    let speaker = &vpls[group.iter().copied().reduce(nearest).expect("a disk has members") as usize];
    // Opposed normals have no mean; a lone light stands for an eighth of its cell.
    let normal = normal.try_normalize().map_or(speaker.normal, |normal| normal.as_vec3());
    let radius = ((2.0 * variance).sqrt() as f32).max(rules.side / 8.0);
    (Shape::Disk { position: speaker.position, normal, radius }, flux)
}
