//! A lamp as a tree of pieces: the virtual lights of direct light, coarse and fine, and where paths start.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.1, "Direct Virtual Lights": a k-d tree that splits the
//! aperture along its major extent.
//!
//! Differs from the paper: a convex flat aperture is cut in two polygons of any shape; other meshes are
//! parted by triangles until they are convex and flat, or a 256th of the lamp; spheres and skies are parted
//! by direction.

use core::f32::consts::{PI, TAU};
use std::collections::BTreeMap;

use glam::{DVec3, Quat, Vec3};

use crate::{Aperture, Light, Polygon, Profile, Shape, hull::convex_hull};

/// A piece with less than this share of its light's flux is not split,
const SMALLEST: f64 = 1.0 / 256.0;
/// nor is one with fewer paths than this: of its parts next to nothing would be known, and hundreds of small
/// lamps would take more memory than their paths.
const FEWEST_PATHS: f64 = 256.0;

/// A node of the tree.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// What stands for it as a virtual light.
    pub(crate) shape: Shape,
    /// Its part of the light's flux.
    pub(crate) share: f64,
    /// Radius in lengths of the scene; of a sky its solid angle, sr.
    pub(crate) size: f64,
    /// Its two parts.
    pub(crate) children: Option<[u32; 2]>,
}

/// The world as lights see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    /// Middle of the world's cube.
    pub(crate) center: Vec3,
    /// Radius of the sphere around it.
    pub(crate) radius: f32,
    /// How far lights are moved off the surfaces that they lie on.
    pub(crate) lift: f32,
}

/// All pieces of one light.
#[derive(Clone, Debug)]
pub(crate) struct ApertureTree {
    /// A piece of a smaller share is not split.
    smallest: f64,
    /// The root is the first; children come after their parents.
    pub(crate) pieces: Vec<Piece>,
    /// Leaves in order, with the share of the flux up to each, itself included.
    leaves: Vec<(u32, f64)>,
    /// Of leaves with several triangles, these, and the area up to each.
    facets: BTreeMap<u32, Box<[(Polygon, f32)]>>,
}

/// The start of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Emission {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
    /// Power over that of a path: 1 in the mean.
    pub(crate) weight: f32,
    /// The piece that it leaves from, a leaf.
    pub(crate) piece: u32,
}

impl ApertureTree {
    pub(crate) fn build(light: &Light, stage: &Stage) -> Self {
        let smallest = SMALLEST.max(FEWEST_PATHS / f64::from(light.paths));
        let mut tree = Self { smallest, pieces: Vec::new(), leaves: Vec::new(), facets: BTreeMap::new() };
        let frame = light.frame();
        let position = light.transform.transform_point3(Vec3::ZERO);
        match &light.aperture {
            Aperture::Point => {
                let shape = Shape::Point { position, profile: light.profile.clone(), frame };
                tree.push(shape, 1.0, 0.0);
            }
            Aperture::Sphere { radius } => {
                let scale = light.transform.matrix3.determinant().abs().cbrt();
                tree.sphere(light, position, radius * scale, [0, 1], stage);
            }
            Aperture::Disk { radius } => {
                let corner = |i: u32| {
                    // As much area as the circle; clockwise around +Z, so that the front is -Z.
                    let (sine, cosine) = (-TAU * i as f32 / 16.0).sin_cos();
                    let radius = radius * (PI / (8.0 * (TAU / 16.0).sin())).sqrt();
                    light.transform.transform_point3(radius * Vec3::new(cosine, sine, 0.0))
                };
                let center = light.transform.transform_point3(Vec3::ZERO);
                let triangles: Vec<_> =
                    (0..16).filter_map(|i| Polygon::new(&[center, corner(i), corner(i + 1)])).collect();
                tree.mesh(light, facing(light, triangles), 1.0, stage);
            }
            Aperture::Mesh { triangles, two_sided } => {
                let to_world = |&corners: &[Vec3; 3]| {
                    Polygon::new(&corners.map(|c| light.transform.transform_point3(c)))
                };
                let front = facing(light, triangles.iter().filter_map(to_world).collect());
                if *two_sided {
                    let back = front.iter().map(Polygon::flipped).collect();
                    let (center, size, _) = summary(&front);
                    let root = tree.push(around(center, light), 1.0, size);
                    let front = tree.mesh(light, front, 0.5, stage);
                    let back = tree.mesh(light, back, 0.5, stage);
                    tree.pieces[root as usize].children = Some([front, back]);
                } else {
                    tree.mesh(light, front, 1.0, stage);
                }
            }
            Aperture::Sky { half_angle } => {
                // Towards -Z of the light.
                let frame = frame * Quat::from_rotation_x(PI);
                tree.sky(frame, [half_angle.cos(), 1.0], [0.0, TAU], *half_angle, 1.0);
            }
        }
        tree.pieces.shrink_to_fit();
        tree.number_leaves();
        tree
    }

    fn push(&mut self, shape: Shape, share: f64, size: f64) -> u32 {
        self.pieces.push(Piece { shape, share, size, children: None });
        (self.pieces.len() - 1) as u32
    }

    fn sphere(&mut self, light: &Light, center: Vec3, radius: f32, part: [u32; 2], stage: &Stage) -> u32 {
        let shape = match &light.profile {
            Profile::Lambert => Shape::Sphere { center, radius: radius + stage.lift, part },
            profile => Shape::Point { position: center, profile: profile.clone(), frame: light.frame() },
        };
        // The visible disk's part: its radius shrinks with the root of the area.
        let size = f64::from(radius) / f64::from(part[1]).sqrt();
        let piece = self.push(shape, 1.0 / f64::from(part[1]), size);
        if part[1] < 64 && 1.0 / f64::from(part[1]) > self.smallest && light.profile == Profile::Lambert {
            let children =
                [0, 1].map(|i| self.sphere(light, center, radius, [2 * part[0] + i, 2 * part[1]], stage));
            self.pieces[piece as usize].children = Some(children);
        }
        piece
    }

    fn sky(&mut self, frame: Quat, cos: [f32; 2], around: [f32; 2], half_angle: f32, share: f64) -> u32 {
        // Of a narrow sun, 1 - cos would lose all digits.
        let whole = if half_angle < 0.1 { 0.5 * half_angle * half_angle } else { 1.0 - half_angle.cos() };
        let size = f64::from(whole * TAU) * share;
        let piece = self.push(Shape::Sky { frame, cos, around }, share, size);
        if half_angle > 0.0 && share > self.smallest {
            let wide = around[1] - around[0] > 1.0 + (cos[1] - cos[0]) * PI;
            let middle = |[a, b]: [f32; 2]| 0.5 * (a + b);
            let parts = if wide {
                let m = middle(around);
                [(cos, [around[0], m]), (cos, [m, around[1]])]
            } else {
                let m = middle(cos);
                [([cos[0], m], around), ([m, cos[1]], around)]
            };
            let children = parts.map(|(cos, around)| self.sky(frame, cos, around, half_angle, 0.5 * share));
            self.pieces[piece as usize].children = Some(children);
        }
        piece
    }

    /// Triangles that are not empty.
    fn mesh(&mut self, light: &Light, triangles: Vec<Polygon>, share: f64, stage: &Stage) -> u32 {
        if let Some(polygon) = union(&triangles) {
            return self.polygon(light, polygon, share, stage);
        }
        let (center, size, normal) = summary(&triangles);
        let shape = if light.profile == Profile::Lambert && normal.length() > 0.1 {
            let normal = normal.normalize();
            Shape::Disk { position: center + stage.lift * normal, normal, radius: size as f32 + stage.lift }
        } else {
            around(center, light)
        };
        let piece = self.push(shape, share, size);
        if share > self.smallest && triangles.len() > 1 {
            let (first, second) = halves(triangles);
            let area = |part: &[Polygon]| part.iter().map(|p| f64::from(p.area())).sum::<f64>();
            let of_first = area(&first) / (area(&first) + area(&second));
            let first = self.mesh(light, first, share * of_first, stage);
            let second = self.mesh(light, second, share * (1.0 - of_first), stage);
            self.pieces[piece as usize].children = Some([first, second]);
        } else {
            let mut sum = 0.0;
            let upto = |triangle: Polygon| {
                sum += triangle.area();
                (lifted(&triangle, stage.lift), sum)
            };
            self.facets.insert(piece, triangles.into_iter().map(upto).collect());
        }
        piece
    }

    fn polygon(&mut self, light: &Light, polygon: Polygon, share: f64, stage: &Stage) -> u32 {
        let above = lifted(&polygon, stage.lift);
        let shape = match &light.profile {
            Profile::Lambert => Shape::Polygon(above),
            profile => {
                Shape::ShapedPolygon { polygon: above, profile: profile.clone(), frame: light.frame() }
            }
        };
        let piece = self.push(shape, share, f64::from(polygon.radius()));
        if share > self.smallest
            && let Some((first, second)) = bisect(&polygon)
        {
            let of_first = f64::from(first.area()) / (f64::from(first.area()) + f64::from(second.area()));
            let first = self.polygon(light, first, share * of_first, stage);
            let second = self.polygon(light, second, share * (1.0 - of_first), stage);
            self.pieces[piece as usize].children = Some([first, second]);
        }
        piece
    }

    fn number_leaves(&mut self) {
        let (mut stack, mut sum) = (vec![0u32], 0.0);
        while let Some(piece) = stack.pop() {
            match self.pieces[piece as usize].children {
                Some([first, second]) => stack.extend([second, first]),
                None => {
                    sum += self.pieces[piece as usize].share;
                    self.leaves.push((piece, sum));
                }
            }
        }
        self.leaves.shrink_to_fit();
    }

    /// Bytes of the tree.
    pub(crate) fn bytes(&self) -> usize {
        let facets: usize =
            self.facets.values().map(|facets| size_of_val(facets) + size_of_val(&**facets)).sum();
        size_of_val(&*self.pieces) + size_of_val(&*self.leaves) + facets
    }

    /// Whether it has the same pieces, wherever they are.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let alike = |(a, b): (&Piece, &Piece)| a.children == b.children && a.share == b.share;
        self.pieces.len() == other.pieces.len() && self.pieces.iter().zip(&other.pieces).all(alike)
    }

    /// The start of a path for four uniform numbers.
    pub(crate) fn emit(&self, light: &Light, stage: &Stage, [u, v, s, t]: [f32; 4]) -> Emission {
        // A leaf by its share; what is left of `u` is uniform again.
        let total = self.leaves[self.leaves.len() - 1].1;
        let at = f64::from(u) * total;
        let leaf = self.leaves.partition_point(|&(_, upto)| upto <= at).min(self.leaves.len() - 1);
        let piece = self.leaves[leaf].0;
        let below = if leaf == 0 { 0.0 } else { self.leaves[leaf - 1].1 };
        let u = ((at - below) / (self.leaves[leaf].1 - below)).clamp(0.0, 1.0 - f64::EPSILON) as f32;
        let (origin, direction, weight) = match &self.pieces[piece as usize].shape {
            Shape::Sphere { center, radius, .. } => {
                // The stratum is one of directions as a receiver sees it, so the number as a whole may choose
                // the point.
                let (normal, _) = Profile::Lambert.emit([at as f32, v]);
                (*center + *radius * normal, cosine_around(normal, [s, t]), 1.0)
            }
            Shape::Sky { frame, cos, around } => {
                let z = cos[0] + u * (cos[1] - cos[0]);
                let phi = around[0] + v * (around[1] - around[0]);
                let sine = (1.0 - z * z).max(0.0).sqrt();
                let toward = *frame * Vec3::new(sine * phi.cos(), sine * phi.sin(), z);
                let (a, b) = toward.any_orthonormal_pair();
                let (r, phi) = (s.sqrt(), TAU * t);
                let across = r * (phi.cos() * a + phi.sin() * b);
                (stage.center + stage.radius * (across + 2.0 * toward), -toward, 1.0)
            }
            Shape::Polygon(polygon) | Shape::ShapedPolygon { polygon, .. } => {
                off_facet(&[(*polygon, polygon.area())], light, [u, v, s, t], stage)
            }
            shape => match (self.facets.get(&piece), shape) {
                (Some(facets), _) => off_facet(facets, light, [u, v, s, t], stage),
                (None, Shape::Point { position, profile, frame }) => {
                    let (direction, weight) = profile.emit([s, t]);
                    (*position, *frame * direction, weight)
                }
                (None, _) => unreachable!("leaves of several triangles have facets"),
            },
        };
        Emission { origin, direction, weight, piece }
    }
}

/// From one of several polygons, each with the area up to it.
fn off_facet(
    facets: &[(Polygon, f32)],
    light: &Light,
    [u, v, s, t]: [f32; 4],
    stage: &Stage,
) -> (Vec3, Vec3, f32) {
    let area = u * facets[facets.len() - 1].1;
    let i = facets.partition_point(|&(_, upto)| upto <= area).min(facets.len() - 1);
    let below = if i == 0 { 0.0 } else { facets[i - 1].1 };
    let u = ((area - below) / (facets[i].1 - below)).clamp(0.0, 1.0);
    let polygon = &facets[i].0;
    let (point, normal) = (polygon.point([u, v]), polygon.normal());
    match &light.profile {
        Profile::Lambert => (point, cosine_around(normal, [s, t]), 1.0),
        profile => {
            let (direction, weight) = profile.emit([s, t]);
            let direction = light.frame() * direction;
            // Light that leaves backwards starts on the other side.
            let back = if direction.dot(normal) < 0.0 { 2.0 * stage.lift } else { 0.0 };
            (point - back * normal, direction, weight)
        }
    }
}

/// Cosine-distributed around `normal`.
pub(crate) fn cosine_around(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (sine, phi) = (u.sqrt(), TAU * v);
    let (a, b) = normal.any_orthonormal_pair();
    let direction = sine * (phi.cos() * a + phi.sin() * b) + (1.0 - u).max(0.0).sqrt() * normal;
    direction.normalize()
}

/// A mirrored transform turns triangles round.
fn facing(light: &Light, triangles: Vec<Polygon>) -> Vec<Polygon> {
    let mirrored = light.transform.matrix3.determinant() < 0.0;
    if mirrored { triangles.iter().map(Polygon::flipped).collect() } else { triangles }
}

/// Towards everywhere from one point, or as the profile says.
fn around(position: Vec3, light: &Light) -> Shape {
    Shape::Point { position, profile: light.profile.clone(), frame: light.frame() }
}

/// Centre of the area, radius around it, and mean normal.
fn summary(triangles: &[Polygon]) -> (Vec3, f64, Vec3) {
    let area: f64 = triangles.iter().map(|p| f64::from(p.area())).sum();
    let mean = |of: &dyn Fn(&Polygon) -> Vec3| -> DVec3 {
        triangles.iter().map(|p| of(p).as_dvec3() * f64::from(p.area())).sum::<DVec3>() / area
    };
    let center = mean(&|p| p.centroid());
    let corners = triangles.iter().flat_map(|p| p.corners());
    let radius = corners.map(|c| c.as_dvec3().distance(center)).fold(0.0, f64::max);
    (center.as_vec3(), radius, mean(&|p| p.normal()).as_vec3())
}

/// The one convex polygon that flat triangles make up, if they do.
fn union(triangles: &[Polygon]) -> Option<Polygon> {
    if let [only] = triangles {
        return Some(*only);
    }
    let normal = triangles.first()?.normal();
    let (center, radius, _) = summary(triangles);
    let flat = |p: &Polygon| {
        let high = |c: &Vec3| (c.as_dvec3() - center.as_dvec3()).dot(normal.as_dvec3()).abs() > 1e-4 * radius;
        p.normal().dot(normal) > 0.9999 && !p.corners().iter().any(high)
    };
    if !triangles.iter().all(flat) {
        return None;
    }
    let corners: Vec<Vec3> = triangles.iter().flat_map(|p| p.corners().iter().copied()).collect();
    let hull = convex_hull(&corners, normal);
    let polygon = Polygon::new(&hull)?;
    let area: f64 = triangles.iter().map(|p| f64::from(p.area())).sum();
    ((f64::from(polygon.area()) / area - 1.0).abs() < 1e-3).then_some(polygon)
}

/// Half of the triangles by their centres along the longest side of the box around these.
fn halves(mut triangles: Vec<Polygon>) -> (Vec<Polygon>, Vec<Polygon>) {
    let low = triangles.iter().map(|p| p.centroid()).fold(Vec3::INFINITY, Vec3::min);
    let high = triangles.iter().map(|p| p.centroid()).fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    // Stable, so that ties keep the order of the mesh.
    triangles.sort_by(|a, b| a.centroid()[axis].total_cmp(&b.centroid()[axis]));
    let second = triangles.split_off(triangles.len() / 2);
    (triangles, second)
}

/// The two parts of a polygon on both sides of its centroid, cut across its longest extent.
fn bisect(polygon: &Polygon) -> Option<(Polygon, Polygon)> {
    let corners = polygon.corners();
    let (mut along, mut longest) = (Vec3::ZERO, 0.0);
    for (i, &a) in corners.iter().enumerate() {
        // The direction of an edge in which the polygon extends farthest.
        let Some(edge) = (corners[(i + 1) % corners.len()] - a).try_normalize() else { continue };
        let extent =
            |sign: f32| corners.iter().map(|c| sign * edge.dot(*c)).fold(f32::NEG_INFINITY, f32::max);
        if extent(1.0) + extent(-1.0) > longest {
            (along, longest) = (edge, extent(1.0) + extent(-1.0));
        }
    }
    let at = along.dot(polygon.centroid());
    Some((polygon.clipped(along, at)?, polygon.clipped(-along, -at)?))
}

/// Moved along its normal.
fn lifted(polygon: &Polygon, lift: f32) -> Polygon {
    let mut corners = [Vec3::ZERO; Polygon::MAX_CORNERS];
    let count = polygon.corners().len();
    for (to, from) in corners.iter_mut().zip(polygon.corners()) {
        *to = *from + lift * polygon.normal();
    }
    Polygon::new(&corners[..count]).unwrap_or(*polygon)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine3A;

    use super::*;

    const STAGE: Stage = Stage { center: Vec3::ZERO, radius: 10.0, lift: 1e-5 };

    fn light(aperture: Aperture, profile: Profile) -> Light {
        Light { aperture, profile, flux: Vec3::ONE, transform: Affine3A::IDENTITY, paths: 100_000 }
    }

    fn apertures() -> Vec<Aperture> {
        let quad = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 3.0, 0.0), 3.0 * Vec3::Y];
        let bent: Arc<[_]> =
            [[quad[0], quad[1], quad[2]], [quad[0], quad[2], Vec3::new(0.0, 3.0, 1.0)]].into();
        vec![
            Aperture::Point,
            Aperture::Sphere { radius: 0.5 },
            Aperture::Disk { radius: 2.0 },
            Aperture::polygon(&quad, false),
            Aperture::polygon(&quad, true),
            Aperture::Mesh { triangles: bent, two_sided: false },
            Aperture::Sky { half_angle: 0.0 },
            Aperture::Sky { half_angle: 1.5 },
        ]
    }

    /// Every cut through the tree has all of the flux, and every leaf as many paths as its share says.
    #[test]
    fn shares_sum_up_and_paths_follow_them() {
        for aperture in apertures() {
            let light = light(aperture, Profile::Lambert);
            let tree = ApertureTree::build(&light, &STAGE);
            for piece in &tree.pieces {
                if let Some(children) = piece.children {
                    let sum: f64 = children.iter().map(|&c| tree.pieces[c as usize].share).sum();
                    assert!((sum - piece.share).abs() < 1e-9, "{:?}", light.aperture);
                }
            }
            assert!((tree.pieces[0].share - 1.0).abs() < 1e-12);
            let (n, mut counts) = (1 << 16, vec![0; tree.pieces.len()]);
            for i in 0..n {
                let emission = tree.emit(&light, &STAGE, [(i as f32 + 0.5) / n as f32, 0.3, 0.6, 0.1]);
                assert!(emission.origin.is_finite() && (emission.direction.length() - 1.0).abs() < 1e-5);
                counts[emission.piece as usize] += 1;
            }
            for (piece, count) in tree.pieces.iter().zip(&counts) {
                let expected = if piece.children.is_none() { piece.share * f64::from(n) } else { 0.0 };
                assert!(
                    (f64::from(*count) - expected).abs() <= 2.0,
                    "{:?}: {count} of {expected}",
                    light.aperture
                );
            }
        }
    }

    /// A rectangle is one polygon, and stays polygons; a disk has the area of its circle.
    #[test]
    fn flat_lamps_are_polygons() {
        let area = |shape: &Shape| match shape {
            Shape::Polygon(polygon) => polygon.area(),
            shape => panic!("{shape:?}"),
        };
        let quad = apertures().swap_remove(3);
        let tree = ApertureTree::build(&light(quad, Profile::Lambert), &STAGE);
        assert!(tree.pieces.iter().all(|piece| matches!(piece.shape, Shape::Polygon(_))));
        let leaves: f32 = tree.leaves.iter().map(|&(leaf, _)| area(&tree.pieces[leaf as usize].shape)).sum();
        assert!((leaves - 3.0).abs() < 1e-3);
        let disk = light(Aperture::Disk { radius: 2.0 }, Profile::Lambert);
        let tree = ApertureTree::build(&disk, &STAGE);
        let area: f32 = tree.leaves.iter().map(|&(leaf, _)| area(&tree.pieces[leaf as usize].shape)).sum();
        assert!((area / (4.0 * PI) - 1.0).abs() < 1e-3, "{area}");
        assert!(tree.emit(&disk, &STAGE, [0.1, 0.2, 0.3, 0.4]).direction.z < 0.0);
    }
}
