//! Texels in the world: where light is gathered for each, under one version of the geometry.
//!
//! What keeps lightmaps from leaking is done here, before any light:
//!
//! - Samples start off their triangle by more than rounding, on its front, so that no ray meets the triangle
//!   itself.
//! - *Terminator*: on smooth surfaces they start on the surface that the vertex normals suggest, never below
//!   the triangle, so that facets don't shade themselves (Hanika, "Hacking the Shadow Terminator", Ray
//!   Tracing Gems II, 2021).
//! - *Pushed out*: a sample from which the back of a surface is seen within a texel's length, along its own
//!   surface, lies within a solid that stands on it. It is carried through that back, to where the solid
//!   ends, if the surface goes on there (what bakers have done since The Witness, with the last condition
//!   added: without it, what is within a wall comes out on the wrong side).
//! - *Back-face test*: a sample that sees nothing but backs above it lies deep within a solid. Its texel is
//!   filled from its neighbours instead of with a solid's darkness, if all of its samples are such.

use glam::{Affine3A, DVec3, Vec3};
use lighttree::{Ray, RayHit, RayQueries};

use super::coverage::Site;
use super::layout::{ChartedMesh, Placement};

/// Rays as a lightmap needs them: [`RayQueries`], and which side of a surface was met.
///
/// Whether a segment is occluded must depend on the surfaces alone that it comes near: not on how a tree over
/// them was built, nor on what else is asked. Then a segment that crosses no box of anything that moved has
/// the same answer in the next version, and is not asked again.
pub trait LightmapRays: RayQueries + Sync {
    /// Whether `hit` of `ray` is the back of a surface that has solid matter behind it. Always false for
    /// surfaces that are lit from both sides: such a surface has no inside.
    fn is_back(&self, ray: &Ray, hit: &RayHit) -> bool;
}

/// Roundings that a point on a triangle may be off by, and a ray that starts there, in units of
/// [`f32::EPSILON`] times coordinates.
const ROUNDINGS: f32 = 4.0;
/// Slenderness (longest edge by height) beyond which rounding no longer grows with it.
const MOST_SLENDER: f64 = 1e4;

/// A sample of a texel in the world. 20 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Where rays start: off the surface already.
    pub(super) position: Vec3,
    /// Interpolated normal; [`DEAD`] where no light is gathered.
    shading: Octahedral,
    /// The triangle's normal.
    geometric: Octahedral,
}

impl Sample {
    pub(super) fn is_dead(&self) -> bool {
        self.shading == DEAD
    }

    pub(super) fn shading_normal(&self) -> Vec3 {
        self.shading.unpack()
    }

    pub(super) fn geometric_normal(&self) -> Vec3 {
        self.geometric.unpack()
    }
}

/// A unit vector in 32 bits, off by 4·10⁻⁵ at most (Cigolle et al., "Survey of Efficient Representations for
/// Independent Unit Vectors", 2014).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Octahedral([i16; 2]);

/// No direction packs to this.
const DEAD: Octahedral = Octahedral([i16::MIN; 2]);

impl Octahedral {
    fn pack(n: Vec3) -> Self {
        let n = n / (n.x.abs() + n.y.abs() + n.z.abs());
        let sign = |x: f32| 1f32.copysign(x);
        let [x, y] = if n.z >= 0.0 {
            [n.x, n.y]
        } else {
            [(1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)]
        };
        Self([x, y].map(|c| (c.clamp(-1.0, 1.0) * 32767.0).round() as i16))
    }

    fn unpack(self) -> Vec3 {
        let [x, y] = self.0.map(|c| f32::from(c) / 32767.0);
        let z = 1.0 - x.abs() - y.abs();
        let fold = (-z).max(0.0);
        Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
    }
}

/// An object as it stands in the world.
pub(super) struct Standing<'a> {
    pub(super) mesh: &'a ChartedMesh,
    /// Positions of the host's vertices, in the mesh's space.
    pub(super) positions: &'a [Vec3],
    /// Their normals, or nothing.
    pub(super) normals: &'a [Vec3],
    pub(super) placement: &'a Placement,
    pub(super) to_world: Affine3A,
}

/// What became of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiverReport {
    /// Samples in all.
    pub samples: u64,
    /// Samples carried out of a solid that covers a part of their texel.
    pub pushed: u64,
    /// Samples deep within a solid, or on triangles without area: they gather no light.
    pub dead: u64,
}

impl core::ops::AddAssign for ReceiverReport {
    fn add_assign(&mut self, other: Self) {
        self.samples += other.samples;
        self.pushed += other.pushed;
        self.dead += other.dead;
    }
}

impl Standing<'_> {
    /// The sample of a site in the world.
    pub(super) fn sample<R: LightmapRays>(
        &self,
        site: Site,
        rays: &R,
        scratch: &mut R::Scratch,
        report: &mut ReceiverReport,
    ) -> Sample {
        report.samples += 1;
        let found = self.on_surface(site);
        let Some(mut point) = found else {
            report.dead += 1;
            return Sample { position: Vec3::ZERO, shading: DEAD, geometric: DEAD };
        };
        if point.push_out(rays, scratch) {
            report.pushed += 1;
        }
        if point.is_inside(rays, scratch) {
            report.dead += 1;
            return Sample { position: point.position, shading: DEAD, geometric: DEAD };
        }
        Sample {
            position: point.position,
            shading: Octahedral::pack(point.shading),
            geometric: Octahedral::pack(point.geometric),
        }
    }

    /// Length of a texel's side at a site, in the world; 0 on a triangle without area.
    pub(super) fn texel_length(&self, site: Site) -> f32 {
        self.on_surface(site).map_or(0.0, |point| point.texel)
    }

    /// Where rays of a site start, before anything is known of other surfaces; `None` on a triangle without
    /// area.
    fn on_surface(&self, site: Site) -> Option<Point> {
        let own = self.mesh.triangles[site.triangle as usize];
        let corners = own.map(|v| self.mesh.vertices[v as usize] as usize);
        let world = corners.map(|v| self.to_world.transform_point3(self.positions[v]).as_dvec3());
        let [a, b, c] = world;
        let mirror = if self.to_world.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
        let cross = (b - a).cross(c - a) * mirror;
        let double_area = cross.length();
        let geometric = cross.try_normalize()?;
        let [u, v] = site.barycentric();
        let weights = [1.0 - u - v, u, v];
        let flat = a + u * (b - a) + v * (c - a);

        // Normals, and the surface that they suggest.
        let (mut shading, mut position) = (geometric, flat);
        if !self.normals.is_empty() {
            let matrix = self.to_world.matrix3.inverse().transpose();
            let normals = corners.map(|v| {
                let normal = (matrix * self.normals[v]).as_dvec3().normalize_or(geometric);
                if normal.dot(geometric) < 0.0 { -normal } else { normal }
            });
            let mean = weights[0] * normals[0] + weights[1] * normals[1] + weights[2] * normals[2];
            shading = mean.normalize_or(geometric);
            position = (0..3).fold(DVec3::ZERO, |sum, i| {
                let below = (flat - world[i]).dot(normals[i]).min(0.0);
                sum + weights[i] * (flat - below * normals[i])
            });
        }

        // Off the triangle by more than rounding.
        let coordinate = world.iter().fold(0.0f64, |m, p| m.max(p.abs().max_element()));
        let squared = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        let slenderness = (squared / double_area).min(MOST_SLENDER);
        let error = ROUNDINGS * f32::EPSILON * (coordinate + squared.sqrt() * slenderness) as f32;

        let uvs = own.map(|v| self.placement.texel(self.mesh.uvs[v as usize]).as_dvec2());
        let texels = (uvs[1] - uvs[0]).perp_dot(uvs[2] - uvs[0]).abs();
        let texel = if texels > 0.0 { (double_area / texels).sqrt() } else { 0.0 };
        Some(Point {
            position: (position + f64::from(error) * geometric).as_vec3(),
            geometric: geometric.as_vec3(),
            shading: shading.as_vec3(),
            error,
            texel: texel as f32,
        })
    }
}

/// A sample under way.
struct Point {
    position: Vec3,
    geometric: Vec3,
    shading: Vec3,
    error: f32,
    /// Length of a texel's side on the surface.
    texel: f32,
}

impl Point {
    /// Carries the point through the nearest back that it sees along its surface within a texel; whether
    /// there was one.
    fn push_out<R: LightmapRays>(&mut self, rays: &R, scratch: &mut R::Scratch) -> bool {
        let (x, y) = self.geometric.any_orthonormal_pair();
        let mut nearest: Option<(f32, Vec3)> = None;
        for direction in [x, y, -x, -y] {
            let ray = Ray { origin: self.position, direction, t_max: self.texel };
            let Some(hit) = rays.closest(&ray, scratch) else { continue };
            if rays.is_back(&ray, &hit) && nearest.is_none_or(|(t, _)| hit.t < t) {
                nearest = Some((hit.t, direction));
            }
        }
        let Some((t, direction)) = nearest else { return false };
        // Beyond it by as much as a point on a surface is off.
        let beyond = 2.0 * self.error + ROUNDINGS * f32::EPSILON * t;
        let position = self.position + (t + beyond) * direction;
        // Only to where the surface goes on: what lies within a wall must not come out on its other side.
        let down = Ray { origin: position, direction: -self.geometric, t_max: 0.5 * self.texel };
        let goes_on = rays.closest(&down, scratch).is_some_and(|hit| !rays.is_back(&down, &hit));
        if goes_on {
            self.position = position;
        }
        goes_on
    }

    /// Whether all that is to be seen above are the backs of solids.
    fn is_inside<R: LightmapRays>(&self, rays: &R, scratch: &mut R::Scratch) -> bool {
        let (x, y) = self.geometric.any_orthonormal_pair();
        let n = self.geometric;
        [n, n + x, n - x, n + y, n - y].into_iter().all(|direction| {
            let ray = Ray { origin: self.position, direction: direction.normalize(), t_max: f32::INFINITY };
            rays.closest(&ray, scratch).is_some_and(|hit| rays.is_back(&ray, &hit))
        })
    }
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    #[test]
    fn packed_normals_are_close() {
        let mut random = Random::new(1, 0, 0);
        let mut worst = 0f32;
        for _ in 0..20_000 {
            let v = Vec3::from_array([(); 3].map(|()| 2.0 * random.f32() - 1.0));
            let Some(n) = v.try_normalize() else { continue };
            let packed = Octahedral::pack(n);
            assert_ne!(packed, DEAD);
            worst = worst.max((packed.unpack() - n).length());
        }
        assert!(worst < 1e-4, "{worst}");
        for axis in Vec3::AXES.into_iter().flat_map(|a| [a, -a]) {
            assert_eq!(Octahedral::pack(axis).unpack(), axis, "axes are exact");
        }
    }

    #[test]
    fn a_sample_takes_twenty_bytes() {
        assert_eq!((size_of::<Sample>(), size_of::<Site>()), (20, 8));
    }
}
