//! Lights: those with a place, which go into a tree, and those without.

use glam::{DVec3, Vec3};
use lighttree::{Emitter, LightBounds};

use crate::Scene;
use crate::rays::error_in_world;

/// A light with a place. RGB, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same in every direction.
    Point {
        /// World-space position.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Vec3,
    },
    /// `KHR_lights_punctual` spot: full inside the inner angle, `clamp((cos θ - cos_outer)/(cos_inner - cos_outer), 0, 1)²` up to the outer.
    Spot {
        /// World-space position.
        position: Vec3,
        /// Unit direction of the beam.
        axis: Vec3,
        /// Radiant intensity inside the inner angle, W·sr⁻¹.
        intensity: Vec3,
        /// Cosine of the inner half angle; at least `cos_outer`.
        cos_inner: f32,
        /// Cosine of the outer half angle.
        cos_outer: f32,
    },
    /// An emissive triangle in world space.
    Triangle {
        /// Corners, counter-clockwise seen from the emitting side.
        vertices: [Vec3; 3],
        /// Mean emitted radiance over the triangle, W·m⁻²·sr⁻¹ (what a texture multiplies is in the mean).
        radiance: Vec3,
        /// Emits from both sides.
        two_sided: bool,
        /// Index into [`Scene::instances`](crate::Scene::instances).
        instance: u32,
        /// Index into that instance's [`Mesh::triangles`](crate::Mesh::triangles).
        triangle: u32,
    },
    /// A virtual point light: what a diffuse surface sends on, intensity × cosine.
    Vpl {
        /// World-space position, already off the surface.
        position: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Radiant intensity along the normal, W·sr⁻¹.
        intensity: Vec3,
    },
}

/// A light without a place: parallel rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistantLight {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance on a plane perpendicular to it, W·m⁻².
    pub irradiance: Vec3,
}

impl Emitter for Light {
    /// Largest colour channel, so that bounds hold for each channel.
    fn bounds(&self) -> LightBounds {
        let (min, max, axis, cos_theta_o, cos_theta_e, two_sided, intensity) = match *self {
            Self::Point { position, intensity } => (position, position, Vec3::Z, -1.0, 1.0, false, intensity),
            Self::Spot { position, axis, intensity, cos_outer, .. } => {
                (position, position, axis, cos_outer, 1.0, false, intensity)
            }
            Self::Triangle { vertices: [a, b, c], radiance, two_sided, .. } => {
                let double_area = (b - a).cross(c - a);
                let length = double_area.length();
                let normal = if length > 0.0 { double_area / length } else { Vec3::Z };
                (a.min(b).min(c), a.max(b).max(c), normal, 1.0, 0.0, two_sided, 0.5 * length * radiance)
            }
            Self::Vpl { position, normal, intensity } => {
                (position, position, normal, 1.0, 0.0, false, intensity)
            }
        };
        let intensity = intensity.max_element();
        LightBounds { min, max, axis, cos_theta_o, cos_theta_e, two_sided, intensity }
    }
}

/// A point drawn from a [`Light`], and what it sends out: everything that an unoccluded contribution needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPoint {
    /// World-space position: where the contribution comes from.
    pub position: Vec3,
    /// Peak radiant intensity that the point stands for, W·sr⁻¹; the light's own, or radiance × area for a surface.
    pub intensity: Vec3,
    /// How the intensity falls off with direction.
    pub profile: Profile,
    /// Distance along the normal that takes a ray's end safely off the light's surface; 0 where there is none.
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
}

impl Light {
    /// The point of the light at `u` in [0, 1)²; any `u` for a light that is a point. Uniform over a triangle's area, and the mean over
    /// `u` of what its [`LightPoint`]s contribute is what the light contributes. Textured emission is looked up at the point.
    #[inline]
    pub fn point(&self, scene: &Scene, u: [f32; 2]) -> LightPoint {
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
            Self::Triangle { vertices, radiance, two_sided, instance, triangle } => {
                let [a, b, c] = vertices;
                let cross = (b - a).as_dvec3().cross((c - a).as_dvec3());
                let double_area = cross.length();
                let normal = if double_area > 0.0 { (cross / double_area).as_vec3() } else { Vec3::Z };
                let weights = uniform_barycentric(u);
                let (position, radiance) = textured_emission(scene, instance, triangle, weights)
                    .unwrap_or_else(|| (weights[0] * a + weights[1] * b + weights[2] * c, radiance));
                LightPoint {
                    position,
                    intensity: radiance * (0.5 * double_area) as f32,
                    profile: Profile::Cosine { normal, two_sided, virtual_light: false },
                    offset: error_in_world(&vertices, double_area),
                }
            }
        }
    }

    /// Whether nothing of the light can reach the upper side of a surface at `receiver` whose unit normal is `normal`: it
    /// is below the horizon, or faces away. Cheaper than a point of the light, and always right; where it is unsure it says no.
    #[inline]
    pub fn is_turned_away(&self, receiver: Vec3, normal: Vec3) -> bool {
        let Self::Triangle { vertices, two_sided, .. } = *self else { return false };
        // In f64, where differences of f32 are exact.
        let (receiver, normal) = (receiver.as_dvec3(), normal.as_dvec3());
        let [a, b, c] = vertices.map(|v| v.as_dvec3() - receiver);
        let below = normal.dot(a).max(normal.dot(b)).max(normal.dot(c)) <= 0.0;
        let behind = (b - a).cross(c - a).dot(a) >= 0.0;
        // Together: one branch that is hard to foretell instead of two.
        below | (behind & !two_sided)
    }

    /// Whether every point of the light is the same.
    #[inline]
    pub const fn is_point(&self) -> bool {
        !matches!(self, Self::Triangle { .. })
    }

    /// Radiant flux, W per channel, for emission in proportion to power.
    pub fn flux(&self) -> Vec3 {
        use core::f32::consts::PI;
        match *self {
            Self::Point { intensity, .. } => intensity * (4.0 * PI),
            // Full inside the inner cone; the squared ramp between them has a third of the solid angle's weight.
            Self::Spot { intensity, cos_inner, cos_outer, .. } => {
                intensity * (2.0 * PI * ((1.0 - cos_inner) + (cos_inner - cos_outer) / 3.0))
            }
            Self::Triangle { vertices: [a, b, c], radiance, two_sided, .. } => {
                let sides = if two_sided { 2.0 } else { 1.0 };
                radiance * (sides * PI * 0.5 * (b - a).cross(c - a).length())
            }
            Self::Vpl { intensity, .. } => intensity * PI,
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
        }
    }

    /// Where a shadow ray between the point and `receiver` ends: off the light's surface on the receiver's side.
    #[inline]
    pub fn end_toward(&self, receiver: Vec3) -> Vec3 {
        match self.profile {
            Profile::Cosine { normal, two_sided, .. } => {
                let behind = two_sided && normal.dot(receiver - self.position) < 0.0;
                self.position + if behind { -self.offset } else { self.offset } * normal
            }
            _ => self.position,
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

/// `KHR_lights_punctual`: full inside the inner cone, a squared linear ramp in the cosine, nothing outside. Equal cones are a sharp edge.
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

/// Position and radiance at a point of a triangle whose material has an emissive texture. In the mesh's own vertex
/// order, because a mirrored instance's light has the other.
fn textured_emission(scene: &Scene, instance: u32, triangle: u32, weights: [f32; 3]) -> Option<(Vec3, Vec3)> {
    if scene.textures.is_empty() {
        return None;
    }
    let instance = scene.instances.get(instance as usize)?;
    let mesh = &scene.meshes[instance.mesh as usize];
    let material = &scene.materials[mesh.material as usize];
    let slot = material.emissive_texture?;
    let corners = mesh.triangles.get(triangle as usize)?.map(|i| i as usize);
    let uvs = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
    let mix = |values: [Vec3; 3]| weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2];
    let position = mix(corners.map(|i| instance.to_world.transform_point3(mesh.positions[i])));
    let uv = mix(corners.map(|i| uvs.get(i).map_or(Vec3::ZERO, |uv| uv.extend(0.0)))).truncate();
    let texel = scene.textures[slot.texture as usize].sample(slot.transform.transform_point2(uv));
    Some((position, material.emissive * texel.truncate()))
}
