//! Points on lights: where a contribution comes from, and how strong it is.
//!
//! A point on a triangle is drawn by area, or by solid angle for one receiver. Where the triangle is far both
//! are as good and area is cheaper; where it is near, cosine ÷ squared distance varies over the triangle, and
//! points by area make speckles, without limit as the distance goes to zero.

use glam::{DVec3, Vec2, Vec3};
use lighttree::SphericalTriangle;

use super::Light;
use crate::Scene;
use crate::rays::error_in_world;

/// A point drawn from a [`Light`], and what it sends out: everything that an unoccluded contribution needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPoint {
    /// World-space position: where the contribution comes from.
    pub position: Vec3,
    /// Peak radiant intensity that the point stands for, W·sr⁻¹: the light's own; radiance × area for a
    /// surface by area; for [`Profile::Seen`] the intensity towards the receiver, cosine included.
    pub intensity: Vec3,
    /// How the intensity falls off with direction.
    pub profile: Profile,
    /// Distance along the normal that takes a ray's end safely off the light's surface; 0 where there is
    /// none.
    pub offset: f32,
}

/// How an intensity falls off with direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Profile {
    /// Not at all.
    Uniform,
    /// As in [`Light::Spot`].
    Spot {
        /// Unit direction of the beam.
        axis: Vec3,
        /// Cosine of the half angle up to which it is full.
        cos_inner: f32,
        /// Cosine of the half angle at which it ends.
        cos_outer: f32,
    },
    /// With the cosine to a surface's normal.
    Cosine {
        /// Unit normal.
        normal: Vec3,
        /// Emits from both sides.
        two_sided: bool,
        /// A virtual point light, whose contribution nearby has no bound: what a clamp is for.
        virtual_light: bool,
    },
    /// Drawn for one receiver, by solid angle: the intensity is that towards it, and of no use to another.
    Seen {
        /// Unit normal on the receiver's side.
        normal: Vec3,
    },
}

impl Light {
    /// A triangle is drawn by solid angle from receivers nearer to its centre than so many times the distance
    /// from there to its farthest corner.
    ///
    /// By area, what a point gives varies only with 1 ÷ distance³ (the cosine at the light is the plane's
    /// distance ÷ distance), so beyond this it varies by at most (33 ÷ 31)³, a tenth to either side; such a
    /// triangle's solid angle is below 1.3e-3 sr. By the distance rather than the solid angle, because a long
    /// triangle seen along its length has a small one and varies nevertheless.
    pub const NEAR: f64 = 32.0;

    /// The point of the light at `u` in [0, 1)² to light `receiver` with; any `u` for a light that is a
    /// point. The mean over `u` of what its [`LightPoint`]s contribute is what the light contributes.
    ///
    /// On a triangle that is [near](Self::NEAR), uniform in solid angle, and black where the receiver is
    /// behind it; otherwise by area. Textured emission is looked up at the point.
    #[inline]
    pub fn point(&self, scene: &Scene, u: [f32; 2], receiver: Vec3) -> LightPoint {
        self.toward(receiver).point(scene, u)
    }

    /// The light as `receiver` sees it, to draw several points from.
    #[inline]
    pub fn toward(&self, receiver: Vec3) -> LightView<'_> {
        LightView { light: self, receiver, seen: self.seen_from(receiver) }
    }

    /// The point of the light at `u` in [0, 1)² for any receiver, or several: uniform over a triangle's area.
    #[inline]
    pub fn point_by_area(&self, scene: &Scene, u: [f32; 2]) -> LightPoint {
        match *self {
            Self::Point { position, intensity } => {
                LightPoint { position, intensity, profile: Profile::Uniform, offset: 0.0 }
            }
            Self::Spot { position, axis, intensity, cos_inner, cos_outer } => LightPoint {
                position,
                intensity,
                profile: Profile::Spot { axis, cos_inner, cos_outer },
                offset: 0.0,
            },
            Self::Vpl { position, normal, intensity } => LightPoint {
                position,
                intensity,
                profile: Profile::Cosine { normal, two_sided: false, virtual_light: true },
                offset: 0.0,
            },
            Self::Triangle { vertices, two_sided, .. } => {
                let (normal, double_area) = plane(&vertices);
                let weights = uniform_barycentric(u);
                let [a, b, c] = vertices;
                LightPoint {
                    position: weights[0] * a + weights[1] * b + weights[2] * c,
                    intensity: self.radiance_at(scene, weights) * (0.5 * double_area) as f32,
                    profile: Profile::Cosine { normal, two_sided, virtual_light: false },
                    offset: error_in_world(&vertices, double_area),
                }
            }
        }
    }

    /// Whether [`point`](Self::point) draws by solid angle for any receiver that is up to `around` from
    /// `receiver`.
    #[inline]
    pub fn is_near(&self, receiver: Vec3, around: f64) -> bool {
        self.near_triangle(receiver, around).is_some()
    }

    /// Density per steradian with which [`point`](Self::point), with uniform `u`, draws a point of the light
    /// for `receiver`: the point in the unit direction `wi` at distance² `squared`. 0 for a light that is a
    /// point, and edge-on.
    pub fn density(&self, receiver: Vec3, wi: Vec3, squared: f64) -> f64 {
        if let Some(seen) = self.seen_from(receiver) {
            return 1.0 / seen.solid_angle();
        }
        let Self::Triangle { vertices: [a, b, c], .. } = *self else { return 0.0 };
        // Half the cross product is area × normal, so this is area × cosine.
        let projected = 0.5 * (b - a).as_dvec3().cross((c - a).as_dvec3()).dot(wi.as_dvec3()).abs();
        if projected > 0.0 { squared / projected } else { 0.0 }
    }

    /// The corners of a triangle near `receiver`, or near a place up to `around` from it.
    #[inline]
    fn near_triangle(&self, receiver: Vec3, around: f64) -> Option<[Vec3; 3]> {
        let Self::Triangle { vertices, .. } = *self else { return None };
        let [a, b, c] = vertices.map(Vec3::as_dvec3);
        let center = (a + b + c) / 3.0;
        let farthest = [a, b, c].map(|p| p.distance_squared(center)).into_iter().fold(0.0, f64::max);
        let near = center.distance(receiver.as_dvec3()) < Self::NEAR * farthest.sqrt() + around;
        near.then_some(vertices)
    }

    /// The triangle in the receiver's directions, where points of it are drawn by solid angle.
    #[inline]
    fn seen_from(&self, receiver: Vec3) -> Option<SphericalTriangle> {
        SphericalTriangle::new(self.near_triangle(receiver, 0.0)?, receiver)
    }

    /// Radiance where a triangle's corners have these weights, W·m⁻²·sr⁻¹.
    fn radiance_at(&self, scene: &Scene, weights: [f32; 3]) -> Vec3 {
        let Self::Triangle { radiance, instance, triangle, .. } = *self else { return Vec3::ZERO };
        textured_emission(scene, instance, triangle, weights).unwrap_or(radiance)
    }
}

/// A [`Light`] as one receiver sees it.
#[derive(Clone, Copy, Debug)]
pub struct LightView<'a> {
    light: &'a Light,
    receiver: Vec3,
    /// A near triangle.
    seen: Option<SphericalTriangle>,
}

impl LightView<'_> {
    /// Points per steradian that [`points`](Self::points) asks for.
    pub const POINTS_PER_STERADIAN: f64 = 32.0;
    /// The most that it asks for.
    pub const MOST_POINTS: u32 = 16;

    /// How many points do the light justice, where one shadow ray is cheap beside the rest: a power of two up
    /// to [`MOST_POINTS`](Self::MOST_POINTS), in proportion to the solid angle of a near triangle, because so
    /// is what it gives and with it the noise of one point; 1 for all other lights.
    #[inline]
    pub fn points(&self) -> u32 {
        let Some(seen) = &self.seen else { return 1 };
        let wanted = (Self::POINTS_PER_STERADIAN * seen.solid_angle()).min(f64::from(Self::MOST_POINTS));
        (wanted as u32).next_power_of_two().min(Self::MOST_POINTS)
    }

    /// As [`Light::point`].
    #[inline]
    pub fn point(&self, scene: &Scene, u: [f32; 2]) -> LightPoint {
        let (Some(seen), &Light::Triangle { vertices, two_sided, .. }) = (&self.seen, self.light) else {
            return self.light.point_by_area(scene, u);
        };
        let (normal, double_area) = plane(&vertices);
        let weights = seen.sample(u.map(f64::from));
        let [a, b, c] = vertices.map(Vec3::as_dvec3);
        let position = (weights[0] * a + weights[1] * b + weights[2] * c).as_vec3();
        let intensity = if two_sided || seen.is_front() {
            // What arrives is radiance × solid angle. The rounded point's own distance, by which a
            // contribution is divided.
            let squared = position.as_dvec3().distance_squared(self.receiver.as_dvec3());
            let radiance = self.light.radiance_at(scene, weights.map(|w| w as f32));
            radiance * (seen.solid_angle() * squared) as f32
        } else {
            Vec3::ZERO
        };
        LightPoint {
            position,
            intensity,
            profile: Profile::Seen { normal: if seen.is_front() { normal } else { -normal } },
            offset: error_in_world(&vertices, double_area),
        }
    }
}

impl LightPoint {
    /// Radiant intensity towards `direction` (unit, away from the light), W·sr⁻¹.
    #[inline]
    pub fn intensity_toward(&self, direction: Vec3) -> Vec3 {
        match self.profile {
            Profile::Uniform => self.intensity,
            Profile::Spot { axis, cos_inner, cos_outer } => {
                self.intensity * spot_falloff(axis.dot(direction), cos_inner, cos_outer)
            }
            Profile::Cosine { normal, two_sided, .. } => {
                let cos = normal.dot(direction);
                self.intensity * if two_sided { cos.abs() } else { cos.max(0.0) }
            }
            Profile::Seen { .. } => self.intensity,
        }
    }

    /// Where a shadow ray between the point and `receiver` ends: off the light's surface on the receiver's
    /// side.
    #[inline]
    pub fn end_toward(&self, receiver: Vec3) -> Vec3 {
        match self.profile {
            Profile::Cosine { normal, two_sided, .. } => {
                let behind = two_sided && normal.dot(receiver - self.position) < 0.0;
                self.position + if behind { -self.offset } else { self.offset } * normal
            }
            Profile::Seen { normal } => self.position + self.offset * normal,
            Profile::Uniform | Profile::Spot { .. } => self.position,
        }
    }

    /// Unit direction from `receiver` to the point and squared distance; `None` where they coincide, so that
    /// there is no direction. In f64 where squares and differences of f32 would lose digits or range.
    #[inline]
    pub fn from(&self, receiver: Vec3) -> Option<(Vec3, f64)> {
        let to: DVec3 = self.position.as_dvec3() - receiver.as_dvec3();
        let squared = to.length_squared();
        (squared > 0.0).then(|| ((to / squared.sqrt()).as_vec3(), squared))
    }
}

/// `KHR_lights_punctual`: full inside the inner cone, a squared linear ramp in the cosine, nothing outside.
/// Equal cones are a sharp edge.
fn spot_falloff(cos: f32, cos_inner: f32, cos_outer: f32) -> f32 {
    if cos >= cos_inner {
        1.0
    } else if cos <= cos_outer {
        0.0
    } else {
        ((cos - cos_outer) / (cos_inner - cos_outer)).powi(2)
    }
}

/// Barycentric weights of a uniform point of a triangle.
fn uniform_barycentric([u, v]: [f32; 2]) -> [f32; 3] {
    let root = u.sqrt();
    [1.0 - root, root * (1.0 - v), root * v]
}

/// Unit normal and twice the area of a triangle; any unit vector for one without area.
#[inline]
fn plane(&[a, b, c]: &[Vec3; 3]) -> (Vec3, f64) {
    let cross = (b - a).as_dvec3().cross((c - a).as_dvec3());
    let double_area = cross.length();
    (if double_area > 0.0 { (cross / double_area).as_vec3() } else { Vec3::Z }, double_area)
}

/// Radiance at a point of a triangle whose material has an emissive texture; the weights are those of the
/// light's corners.
fn textured_emission(scene: &Scene, instance: u32, triangle: u32, weights: [f32; 3]) -> Option<Vec3> {
    if scene.textures.is_empty() {
        return None;
    }
    let instance = scene.instances.get(instance as usize)?;
    let mesh = &scene.meshes[instance.mesh as usize];
    let material = &scene.materials[mesh.material as usize];
    let slot = material.emissive_texture?;
    let corners = mesh.triangles.get(triangle as usize)?.map(|i| i as usize);
    // A mirrored instance's light has its corners the other way round.
    let [u, v, w] = weights;
    let weights = if instance.is_mirrored() { [u, w, v] } else { weights };
    let uvs = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
    let uv = corners.map(|i| uvs.get(i).copied().unwrap_or(Vec2::ZERO));
    let uv = weights[0] * uv[0] + weights[1] * uv[1] + weights[2] * uv[2];
    let texel = scene.textures[slot.texture as usize].sample(slot.transform.transform_point2(uv));
    Some(material.emissive * texel.truncate())
}
