//! Anything that can be put in a light tree, and the plain emitters.
//!
//! Lights without a position (the sun, an environment) are none of them: no box bounds them, and each of them
//! is worth a decision of its own. A host chooses between them and the tree, or evaluates all of them.

use core::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use crate::LightBounds;

/// Index of a light in the user's own array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct LightId(pub u32);

impl LightId {
    /// No light: the entry of an unused row.
    pub const NONE: Self = Self(u32::MAX);

    /// The same as an index into a slice: `lamps[light.index()]`.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// Anything that can be put in a light tree: all that a builder asks of a light.
pub trait Emitter {
    /// Bounds of this one emitter.
    fn bounds(&self) -> LightBounds;
}

impl Emitter for LightBounds {
    fn bounds(&self) -> LightBounds {
        *self
    }
}

impl<T: Emitter + ?Sized> Emitter for &T {
    fn bounds(&self) -> LightBounds {
        (**self).bounds()
    }
}

/// An emitter whose light can be summed up point by point: what a bound is a bound of.
///
/// The mean over `u` in the unit square of `intensity · scattering at the receiver / d²` is the contribution
/// of the emitter to the receiver, without visibility. So one such point is also an unbiased estimate of it.
pub trait PointwiseEmitter: Emitter {
    /// The point at `u`, uniform by area, seen from `receiver`.
    fn point(&self, u: [f32; 2], receiver: Vec3) -> EmittingPoint;
}

/// One point of an emitter that stands for all of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmittingPoint {
    /// World-space position, within the emitter's bounds.
    pub position: Vec3,
    /// Intensity towards the receiver as if the whole emitter were like this point, W·sr⁻¹: radiance × whole
    /// area × cosine at the emitter. May exceed the peak intensity of a curved emitter.
    pub intensity: f64,
}

/// A point that sends the same intensity everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// World-space position.
    pub position: Vec3,
    /// Radiant intensity, W·sr⁻¹.
    pub intensity: f32,
}

/// A point that sends light into a cone, less towards its rim: the spot of `KHR_lights_punctual`.
///
/// The falloff is the square of (cos θ - cos outer) / (cos inner - cos outer), clamped to [0, 1]. Differs
/// from the extension's suggested code: the denominator has no lower limit of 0.001, which would dim narrow
/// spots; equal angles give a hard rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotLight {
    /// World-space position.
    pub position: Vec3,
    /// Direction of the cone's axis; its length does not matter.
    pub axis: Vec3,
    /// Angle from the axis up to which the intensity is full, radians; more than `outer_angle` counts as
    /// that.
    pub inner_angle: f32,
    /// Angle from the axis at which it has fallen to 0, radians, at most π.
    pub outer_angle: f32,
    /// Radiant intensity on the axis, W·sr⁻¹.
    pub intensity: f32,
}

/// A triangle of constant radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleLight {
    /// World-space corners, counter-clockwise as seen from the side that emits.
    pub corners: [Vec3; 3],
    /// Emitted radiance, W·m⁻²·sr⁻¹.
    pub radiance: f32,
    /// Whether the other side emits the same.
    pub two_sided: bool,
}

/// A flat disk of constant radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskLight {
    /// World-space centre.
    pub center: Vec3,
    /// Normal of the side that emits; its length does not matter.
    pub normal: Vec3,
    /// Radius, in the scene's unit of length.
    pub radius: f32,
    /// Emitted radiance, W·m⁻²·sr⁻¹.
    pub radiance: f32,
    /// Whether the other side emits the same.
    pub two_sided: bool,
}

/// A sphere of constant radiance, lit outwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereLight {
    /// World-space centre.
    pub center: Vec3,
    /// Radius, in the scene's unit of length.
    pub radius: f32,
    /// Emitted radiance, W·m⁻²·sr⁻¹.
    pub radiance: f32,
}

/// A virtual point light on a diffuse surface: a point with a cosine lobe (Keller, "Instant Radiosity",
/// 1997).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedVpl {
    /// World-space position.
    pub position: Vec3,
    /// Surface normal; its length does not matter.
    pub normal: Vec3,
    /// Radiant intensity along the normal, W·sr⁻¹: reflected flux ÷ π.
    pub intensity: f32,
}

impl Emitter for PointLight {
    fn bounds(&self) -> LightBounds {
        LightBounds::point(self.position, self.intensity)
    }
}

impl PointwiseEmitter for PointLight {
    fn point(&self, _: [f32; 2], _: Vec3) -> EmittingPoint {
        EmittingPoint { position: self.position, intensity: self.intensity.into() }
    }
}

impl SpotLight {
    /// Part of the intensity that is sent at an angle of that cosine to the axis, in [0, 1].
    pub fn falloff(&self, cos: f64) -> f64 {
        let (inner, outer) = (f64::from(self.inner_angle).cos(), f64::from(self.outer_angle).cos());
        // The outer angle first: beyond it there must be nothing, or bounds would not hold.
        if cos < outer {
            0.0
        } else if cos >= inner {
            1.0
        } else {
            ((cos - outer) / (inner - outer)).powi(2)
        }
    }
}

impl Emitter for SpotLight {
    fn bounds(&self) -> LightBounds {
        LightBounds::spot(self.position, unit(self.axis).as_vec3(), self.outer_angle, self.intensity)
    }
}

impl PointwiseEmitter for SpotLight {
    fn point(&self, _: [f32; 2], receiver: Vec3) -> EmittingPoint {
        let cos = cos_toward(self.position, unit(self.axis), receiver);
        EmittingPoint { position: self.position, intensity: f64::from(self.intensity) * self.falloff(cos) }
    }
}

impl TriangleLight {
    /// Half the cross product of two edges: along the normal, as long as the area. In f64, where no triangle
    /// is too small.
    fn area_vector(&self) -> DVec3 {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        0.5 * (b - a).cross(c - a)
    }

    /// Area, in the square of the scene's unit of length.
    pub fn area(&self) -> f64 {
        self.area_vector().length()
    }

    /// Unit normal of the side that emits; any unit vector for a triangle without area.
    pub fn normal(&self) -> Vec3 {
        self.area_vector().normalize_or(DVec3::Z).as_vec3()
    }
}

impl Emitter for TriangleLight {
    fn bounds(&self) -> LightBounds {
        let [a, b, c] = self.corners;
        let intensity = (f64::from(self.radiance) * self.area()) as f32;
        LightBounds::surface(a.min(b).min(c), a.max(b).max(c), self.normal(), self.two_sided, intensity)
    }
}

impl PointwiseEmitter for TriangleLight {
    fn point(&self, u: [f32; 2], receiver: Vec3) -> EmittingPoint {
        let root = u[0].sqrt();
        let [a, b, c] = self.corners;
        let position = a * (1.0 - root) + b * (root * (1.0 - u[1])) + c * (root * u[1]);
        // Rounding must not put it outside of the bounds.
        let position = position.max(a.min(b).min(c)).min(a.max(b).max(c));
        let area_vector = self.area_vector();
        let cos = sided(cos_toward(position, area_vector.normalize_or(DVec3::Z), receiver), self.two_sided);
        EmittingPoint { position, intensity: f64::from(self.radiance) * area_vector.length() * cos }
    }
}

impl DiskLight {
    /// Area, in the square of the scene's unit of length.
    pub fn area(&self) -> f64 {
        PI * f64::from(self.radius).powi(2)
    }
}

impl Emitter for DiskLight {
    fn bounds(&self) -> LightBounds {
        let normal = unit(self.normal);
        let extent = f64::from(self.radius) * (DVec3::ONE - normal * normal).max(DVec3::ZERO).map(f64::sqrt);
        let (min, max) = box_around(self.center, extent);
        let intensity = (f64::from(self.radiance) * self.area()) as f32;
        LightBounds::surface(min, max, normal.as_vec3(), self.two_sided, intensity)
    }
}

impl PointwiseEmitter for DiskLight {
    fn point(&self, u: [f32; 2], receiver: Vec3) -> EmittingPoint {
        let normal = unit(self.normal);
        let (x, y) = normal.any_orthonormal_pair();
        let (sin, cos) = (TAU * f64::from(u[1])).sin_cos();
        let r = f64::from(self.radius) * f64::from(u[0]).sqrt();
        let position = (self.center.as_dvec3() + x * (r * cos) + y * (r * sin)).as_vec3();
        let cos = sided(cos_toward(position, normal, receiver), self.two_sided);
        EmittingPoint { position, intensity: f64::from(self.radiance) * self.area() * cos }
    }
}

impl SphereLight {
    /// Area, in the square of the scene's unit of length.
    pub fn area(&self) -> f64 {
        4.0 * PI * f64::from(self.radius).powi(2)
    }
}

impl Emitter for SphereLight {
    fn bounds(&self) -> LightBounds {
        let (min, max) = box_around(self.center, DVec3::splat(self.radius.into()));
        // From afar it is a disk.
        let intensity = (f64::from(self.radiance) * 0.25 * self.area()) as f32;
        LightBounds::omnidirectional(min, max, intensity)
    }
}

impl PointwiseEmitter for SphereLight {
    fn point(&self, u: [f32; 2], receiver: Vec3) -> EmittingPoint {
        let z = 1.0 - 2.0 * f64::from(u[0]);
        let (sin, cos) = (TAU * f64::from(u[1])).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        let normal = DVec3::new(r * cos, r * sin, z);
        let position = (self.center.as_dvec3() + f64::from(self.radius) * normal).as_vec3();
        let cos = cos_toward(position, normal, receiver).max(0.0);
        EmittingPoint { position, intensity: f64::from(self.radiance) * self.area() * cos }
    }
}

impl Emitter for OrientedVpl {
    fn bounds(&self) -> LightBounds {
        let normal = unit(self.normal).as_vec3();
        LightBounds::surface(self.position, self.position, normal, false, self.intensity)
    }
}

impl PointwiseEmitter for OrientedVpl {
    fn point(&self, _: [f32; 2], receiver: Vec3) -> EmittingPoint {
        let cos = cos_toward(self.position, unit(self.normal), receiver).max(0.0);
        EmittingPoint { position: self.position, intensity: f64::from(self.intensity) * cos }
    }
}

/// The unit vector along `v`; not finite where `v` is zero or not finite, for a builder to report.
fn unit(v: Vec3) -> DVec3 {
    let v = v.as_dvec3();
    v / v.length()
}

/// Cosine between `axis` and the direction from `position` to `receiver`; 0 where they coincide.
fn cos_toward(position: Vec3, axis: DVec3, receiver: Vec3) -> f64 {
    axis.dot((receiver.as_dvec3() - position.as_dvec3()).normalize_or_zero())
}

fn sided(cos: f64, two_sided: bool) -> f64 {
    if two_sided { cos.abs() } else { cos.max(0.0) }
}

/// The box `center ± extent`, one step wider than rounded.
fn box_around(center: Vec3, extent: DVec3) -> (Vec3, Vec3) {
    let center = center.as_dvec3();
    ((center - extent).as_vec3().map(f32::next_down), (center + extent).as_vec3().map(f32::next_up))
}
