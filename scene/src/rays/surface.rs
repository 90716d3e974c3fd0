//! What a hit means to a shader, and how a ray leaves a surface without meeting it again.

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::{Instance, Mesh, Scene};

/// Roundings that a point on a triangle and a ray that leaves it may be off by together, in units of
/// [`f32::EPSILON`] times coordinate plus length times slenderness (see [`Surface::error`]). Over 20 million
/// rays from triangles of slenderness 1 to 10⁵, near the origin and far from it, one unit was always enough.
const ROUNDINGS: f32 = 2.0;
/// The same for two levels, whose rays are rounded once more in the mesh's space; two units were always
/// enough.
const ROUNDINGS_TWO_LEVEL: f32 = 4.0;
/// Slenderness beyond which errors no longer grow with it: they end at a fraction of the triangle's own
/// length.
const MOST_SLENDER: f64 = 1e4;

/// A point on a triangle of a scene, in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// World space.
    pub position: Vec3,
    /// Unit normal of the triangle on its front, from where its corners run counter-clockwise (clockwise
    /// where the instance is mirrored, as glTF has it). The direction asked from, where the triangle has no
    /// area.
    pub geometric_normal: Vec3,
    /// Unit interpolated vertex normal, on the front like `geometric_normal`; equal to it without vertex
    /// normals.
    pub shading_normal: Vec3,
    /// `TEXCOORD_0`, untransformed; zero where there is none.
    pub uv: Vec2,
    /// `TEXCOORD_1`, untransformed; zero where there is none.
    pub uv1: Vec2,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index into that instance's [`Mesh::triangles`].
    pub triangle: u32,
    /// Seen from its front.
    pub front: bool,
    /// Upper bound of the distance along `geometric_normal` by which rounding may have moved the point off
    /// its triangle, or may let a ray that leaves it think so; in the scene's length unit. In proportion to
    /// the triangle's largest coordinate, for that is what positions round by, plus its longest edge times
    /// its slenderness (longest edge by height), for in thin triangles the test's weights are ill
    /// conditioned.
    pub error: f32,
}

impl Surface {
    /// Where a ray into direction `toward` (any length) starts: off the surface by its own rounding error, on
    /// the side of the triangle that the ray goes to. There is no epsilon in it: scaling the scene scales the
    /// offset.
    pub fn offset(&self, toward: Vec3) -> Vec3 {
        offset(self.position, self.geometric_normal, self.error, toward)
    }

    /// The texture coordinates of `set` (see [`TextureSlot::uv_set`](crate::TextureSlot::uv_set)).
    pub fn uv_set(&self, set: u8) -> Vec2 {
        if set == 0 { self.uv } else { self.uv1 }
    }

    /// The geometric normal on the side that the point is seen from.
    pub fn facing_normal(&self) -> Vec3 {
        if self.front { self.geometric_normal } else { -self.geometric_normal }
    }

    /// The shading normal on the side that the point is seen from.
    pub fn facing_shading_normal(&self) -> Vec3 {
        if self.front { self.shading_normal } else { -self.shading_normal }
    }
}

/// [`Surface::offset`] for a point whose error is known by
/// [`SceneRays::surface_error`](crate::SceneRays::surface_error).
pub fn offset(position: Vec3, normal: Vec3, error: f32, toward: Vec3) -> Vec3 {
    position + error.copysign(normal.dot(toward)) * normal
}

/// A triangle's corners in world space, to the bit as the flattened tree has them.
pub(super) fn world_triangle(mesh: &Mesh, instance: &Instance, triangle: [u32; 3]) -> [Vec3; 3] {
    triangle.map(|v| instance.to_world.transform_point3(mesh.positions[v as usize]))
}

/// What surfaces need beside the scene: how normals of each instance transform.
#[derive(Clone, Debug)]
pub(super) struct Surfaces {
    normals: Vec<NormalMap>,
    two_level: bool,
}

#[derive(Clone, Copy, Debug)]
struct NormalMap {
    /// Inverse transpose up to a positive factor.
    matrix: Mat3,
    mirrored: bool,
}

impl Surfaces {
    pub(super) fn new(scene: &Scene, two_level: bool) -> Self {
        Self { normals: scene.instances.iter().map(NormalMap::new).collect(), two_level }
    }

    /// Memory held, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.normals.capacity() * size_of::<NormalMap>()
    }

    /// The point at barycentric `[u, v]` of a triangle, seen from the direction `toward`.
    pub(super) fn at(
        &self,
        scene: &Scene,
        instance: u32,
        triangle: u32,
        [u, v]: [f32; 2],
        toward: Vec3,
    ) -> Surface {
        let placed = &scene.instances[instance as usize];
        let mesh = &scene.meshes[placed.mesh as usize];
        let indices = mesh.triangles[triangle as usize];
        let corners = world_triangle(mesh, placed, indices);
        let map = self.normals[instance as usize];
        let w = 1.0 - u - v;

        // In f64, so that the position rounds once and thin triangles keep their normal.
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let (ab, ac) = (b - a, c - a);
        let position = (a + f64::from(u) * ab + f64::from(v) * ac).as_vec3();
        let cross = if map.mirrored { ac.cross(ab) } else { ab.cross(ac) };
        let toward = unit(toward.as_dvec3()).unwrap_or(Vec3::Z);
        let geometric_normal = unit(cross).unwrap_or(toward);

        let interpolate = |values: &[Vec2]| match indices.map(|i| values.get(i as usize)) {
            [Some(a), Some(b), Some(c)] => w * *a + u * *b + v * *c,
            _ => Vec2::ZERO,
        };
        let shading_normal = match indices.map(|i| mesh.normals.get(i as usize)) {
            [Some(a), Some(b), Some(c)] => {
                let normal =
                    unit((map.matrix * (w * *a + u * *b + v * *c)).as_dvec3()).unwrap_or(geometric_normal);
                if normal.dot(geometric_normal) < 0.0 { -normal } else { normal }
            }
            _ => geometric_normal,
        };
        Surface {
            position,
            geometric_normal,
            shading_normal,
            uv: interpolate(&mesh.uvs),
            uv1: interpolate(&mesh.uvs1),
            material: mesh.material,
            instance,
            triangle,
            front: geometric_normal.dot(toward) >= 0.0,
            error: self.error_of(mesh, placed, indices, &corners, cross),
        }
    }

    /// [`Surface::error`] of all points of a triangle.
    pub(super) fn error(&self, scene: &Scene, instance: u32, triangle: u32) -> f32 {
        let placed = &scene.instances[instance as usize];
        let mesh = &scene.meshes[placed.mesh as usize];
        let indices = mesh.triangles[triangle as usize];
        let corners = world_triangle(mesh, placed, indices);
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        self.error_of(mesh, placed, indices, &corners, (b - a).cross(c - a))
    }

    /// `cross` is that of two edges.
    fn error_of(
        &self,
        mesh: &Mesh,
        instance: &Instance,
        indices: [u32; 3],
        corners: &[Vec3; 3],
        cross: DVec3,
    ) -> f32 {
        let largest = |points: [Vec3; 3]| points.iter().fold(Vec3::ZERO, |m, p| m.max(p.abs()));
        let (roundings, coordinate) = if self.two_level {
            // Coordinates in the mesh's space may be larger than the sum that the map makes of them.
            let local = largest(indices.map(|v| mesh.positions[v as usize]));
            let to_world = instance.to_world;
            let size = Mat3::from(to_world.matrix3).abs() * local + Vec3::from(to_world.translation.abs());
            (ROUNDINGS_TWO_LEVEL, size.max_element())
        } else {
            (ROUNDINGS, largest(*corners).max_element())
        };
        roundings * f32::EPSILON * (coordinate + ill_conditioned(corners, cross.length()))
    }
}

/// Bound of [`Surface::error`] for a triangle in world space whatever tree holds it, given twice its area:
/// for those who know no more of it, because it is a light.
///
/// Coordinates in the mesh's own space may be up to 8 times those in the world; a mesh modelled farther from
/// its own origin than that is beyond it where it is in a tree of two levels.
#[inline]
pub(crate) fn error_in_world(corners: &[Vec3; 3], double_area: f64) -> f32 {
    let coordinate = corners.iter().fold(0.0f32, |m, p| m.max(p.abs().max_element()));
    ROUNDINGS_TWO_LEVEL * f32::EPSILON * (16.0 * coordinate + ill_conditioned(corners, double_area))
}

/// Longest edge times slenderness: how far the weights of a thin triangle may carry a point along it, in
/// roundings.
#[inline]
fn ill_conditioned(corners: &[Vec3; 3], double_area: f64) -> f32 {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let squared = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    // Longest edge by height; not a number without area, where `min` takes the other.
    let slenderness = (squared / double_area).min(MOST_SLENDER);
    (squared.sqrt() * slenderness) as f32
}

impl NormalMap {
    fn new(instance: &Instance) -> Self {
        let [x, y, z] = [0, 1, 2].map(|k| Vec3::from(instance.to_world.matrix3.col(k)).as_dvec3());
        // Scale out, so that products of columns neither overflow nor vanish.
        let largest = x.abs().max(y.abs()).max(z.abs()).max_element();
        let [x, y, z] = if largest > 0.0 { [x / largest, y / largest, z / largest] } else { [x, y, z] };
        let mirrored = x.dot(y.cross(z)) < 0.0;
        let sign = if mirrored { -1.0 } else { 1.0 };
        // Cofactors: the inverse transpose times the determinant.
        let column = |a: DVec3| (sign * a).as_vec3();
        Self { matrix: Mat3::from_cols(column(y.cross(z)), column(z.cross(x)), column(x.cross(y))), mirrored }
    }
}

/// The vector at unit length; `None` for zero or what isn't finite.
fn unit(v: DVec3) -> Option<Vec3> {
    let largest = v.abs().max_element();
    (largest > 0.0 && largest.is_finite()).then(|| (v / largest).normalize().as_vec3())
}
