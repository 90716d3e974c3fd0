//! Proptest strategies that aim at trouble: coincident and coplanar lights, lasers and full spheres, opposite
//! axes, receivers in a box or on its face, grazing views, tiny and huge scenes far from the origin.
//!
//! All are about as large as the unit cube around the origin; [`Placement`] moves what they give to other
//! scales.

use core::f32::consts::PI;
use core::ops::Range;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use proptest::sample::select;

use crate::{
    DiskLight, Emitter, EmittingPoint, GgxReceiver, LambertReceiver, LightBounds, OrientedVpl, PhongReceiver,
    PointLight, PointwiseEmitter, Receiver, ScatterLobes, SphereLight, SpotLight, Toward, TriangleLight,
};

/// One of the plain emitters.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "each variant is named after what it holds")]
pub enum AnyEmitter {
    Point(PointLight),
    Spot(SpotLight),
    Triangle(TriangleLight),
    Disk(DiskLight),
    Sphere(SphereLight),
    Vpl(OrientedVpl),
}

impl AnyEmitter {
    fn inner(&self) -> &dyn PointwiseEmitter {
        match self {
            Self::Point(light) => light,
            Self::Spot(light) => light,
            Self::Triangle(light) => light,
            Self::Disk(light) => light,
            Self::Sphere(light) => light,
            Self::Vpl(light) => light,
        }
    }
}

impl Emitter for AnyEmitter {
    fn bounds(&self) -> LightBounds {
        self.inner().bounds()
    }
}

impl PointwiseEmitter for AnyEmitter {
    fn point(&self, u: [f32; 2], receiver: Vec3) -> EmittingPoint {
        self.inner().point(u, receiver)
    }
}

/// One of the plain receivers.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "each variant is named after what it holds")]
pub enum AnyReceiver {
    Lambert(LambertReceiver),
    Phong(PhongReceiver),
    Ggx(GgxReceiver),
}

impl AnyReceiver {
    /// f · cos θ for light from `direction`, of any length but 0, in sr⁻¹.
    pub fn eval(&self, direction: DVec3) -> f64 {
        match self {
            Self::Lambert(receiver) => receiver.eval(direction),
            Self::Phong(receiver) => receiver.eval(direction),
            Self::Ggx(receiver) => receiver.eval(direction),
        }
    }

    /// The same receiver elsewhere.
    #[must_use]
    pub fn at(mut self, to: Vec3) -> Self {
        match &mut self {
            Self::Lambert(receiver) => receiver.position = to,
            Self::Phong(receiver) => receiver.position = to,
            Self::Ggx(receiver) => receiver.position = to,
        }
        self
    }
}

impl Receiver for AnyReceiver {
    fn position(&self) -> Vec3 {
        match self {
            Self::Lambert(receiver) => receiver.position,
            Self::Phong(receiver) => receiver.position,
            Self::Ggx(receiver) => receiver.position,
        }
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        match self {
            Self::Lambert(receiver) => receiver.scatter_bound(toward),
            Self::Phong(receiver) => receiver.scatter_bound(toward),
            Self::Ggx(receiver) => receiver.scatter_bound(toward),
        }
    }
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        match self {
            Self::Lambert(receiver) => receiver.scatter_importance(toward),
            Self::Phong(receiver) => receiver.scatter_importance(toward),
            Self::Ggx(receiver) => receiver.scatter_importance(toward),
        }
    }
    fn lobes(&self) -> Option<ScatterLobes> {
        match self {
            Self::Lambert(receiver) => receiver.lobes(),
            Self::Phong(receiver) => receiver.lobes(),
            Self::Ggx(receiver) => receiver.lobes(),
        }
    }
}

/// Where a scene is and how large: `position · scale + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Factor of all positions.
    pub scale: f32,
    /// Added to all positions after that.
    pub offset: Vec3,
}

impl Placement {
    /// A position, placed.
    pub fn position(&self, position: Vec3) -> Vec3 {
        position * self.scale + self.offset
    }

    /// Bounds, placed; intensities stay.
    pub fn bounds(&self, bounds: &LightBounds) -> LightBounds {
        LightBounds { min: self.position(bounds.min), max: self.position(bounds.max), ..*bounds }
    }
}

/// Scales from 1e-20 to 1e18, without an offset.
pub fn scales() -> impl Strategy<Value = Placement> {
    select(vec![1e-20, 1e-6, 1.0, 1e6, 1e18]).prop_map(|scale| Placement { scale, offset: Vec3::ZERO })
}

/// Coordinates in [-1, 1], on a coarse lattice half of the time, so that some coincide.
pub fn position() -> impl Strategy<Value = Vec3> {
    let coordinate = prop_oneof![-1.0f32..1.0, select(vec![-1.0f32, -0.5, 0.0, 0.25, 1.0])];
    prop::array::uniform3(coordinate).prop_map(Vec3::from)
}

/// Unit vectors: any, along an axis, or all but along one.
pub fn direction() -> impl Strategy<Value = Vec3> {
    let any = (-1.0f32..=1.0, 0.0..2.0 * PI).prop_map(|(z, phi)| {
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    });
    let along = select(vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z]).boxed();
    let almost = (along.clone(), position(), select(vec![1e-3f32, 1e-5, 1e-7]))
        .prop_map(|(axis, aside, by)| (axis + by * aside).normalize());
    prop_oneof![4 => any, 1 => along, 1 => almost]
}

/// Half angles of cones, radians: 0, nearly 0, any, nearly π, π, and π/2 with its neighbours.
pub fn half_angle() -> impl Strategy<Value = f32> {
    prop_oneof![
        0.0f32..PI,
        select(vec![0.0, 1e-6, 1e-3, 0.5 * PI, 0.5 * PI + 1e-6, 0.5 * PI - 1e-6, PI - 1e-3, PI])
    ]
}

/// Intensities over some decades; never 0.
pub fn intensity() -> impl Strategy<Value = f32> {
    (-3.0f32..3.0).prop_map(|exponent| 10.0f32.powf(exponent))
}

/// Bounds of one emitter or of many: boxes that may be flat or points, cones of any width.
pub fn light_bounds() -> impl Strategy<Value = LightBounds> {
    let extent = prop_oneof![Just(0.0f32), 0.0f32..0.5];
    (
        (position(), prop::array::uniform3(extent)),
        (direction(), half_angle(), half_angle(), any::<bool>()),
        intensity(),
    )
        .prop_map(|((min, extent), (axis, theta_o, theta_e, two_sided), intensity)| LightBounds {
            min,
            max: min + Vec3::from(extent),
            axis,
            cos_theta_o: theta_o.cos(),
            cos_theta_e: theta_e.cos().max(0.0),
            two_sided,
            intensity,
        })
}

/// Any plain emitter.
pub fn emitter() -> impl Strategy<Value = AnyEmitter> {
    let place = || (position(), direction(), intensity());
    prop_oneof![
        place().prop_map(|(position, _, intensity)| AnyEmitter::Point(PointLight { position, intensity })),
        (place(), half_angle(), prop_oneof![Just(1.0f32), 0.0f32..1.0]).prop_map(
            |((position, axis, intensity), outer_angle, inner)| {
                let inner_angle = inner * outer_angle;
                AnyEmitter::Spot(SpotLight { position, axis, inner_angle, outer_angle, intensity })
            }
        ),
        (position(), [direction(), direction()], 0.01f32..0.7, intensity(), any::<bool>()).prop_map(
            |(a, [ab, ac], size, radiance, two_sided)| AnyEmitter::Triangle(TriangleLight {
                corners: [a, a + size * ab, a + size * ac],
                radiance,
                two_sided
            })
        ),
        (place(), 0.01f32..0.7, any::<bool>()).prop_map(|((center, normal, radiance), radius, two_sided)| {
            AnyEmitter::Disk(DiskLight { center, normal, radius, radiance, two_sided })
        }),
        (place(), 0.01f32..0.7).prop_map(|((center, _, radiance), radius)| AnyEmitter::Sphere(SphereLight {
            center,
            radius,
            radiance
        })),
        place().prop_map(|(position, normal, intensity)| AnyEmitter::Vpl(OrientedVpl {
            position,
            normal,
            intensity
        })),
    ]
}

/// Lights of one scene: scattered, all at one point, in a plane, on a line, or in clusters far smaller than
/// the scene.
pub fn lights(count: Range<usize>) -> impl Strategy<Value = Vec<LightBounds>> {
    let arrange = select(vec![
        (Vec3::ONE, 1.0f32),
        (Vec3::ZERO, 1.0),
        (Vec3::new(1.0, 1.0, 0.0), 1.0),
        (Vec3::new(0.0, 1.0, 0.0), 1.0),
        (Vec3::ONE, 1e-3),
    ]);
    (prop::collection::vec((light_bounds(), position()), count), arrange).prop_map(
        |(lights, (free, cluster_size))| {
            let place = |(mut light, aside): (LightBounds, Vec3)| {
                let extent = (light.max - light.min) * free * cluster_size;
                let center =
                    if cluster_size < 1.0 { light.min.round() + cluster_size * aside } else { light.min };
                light.min = center * free;
                light.max = light.min + extent;
                light
            };
            lights.into_iter().map(place).collect()
        },
    )
}

/// A Lambert, Phong or GGX receiver anywhere near, exponents from 1 to 1e5 and α from 1e-3 to 1.
pub fn receiver() -> impl Strategy<Value = AnyReceiver> {
    let surface = || (position(), direction(), direction());
    let part = || prop_oneof![Just(0.0f32), 0.0f32..1.0];
    prop_oneof![
        (position(), prop_oneof![9 => direction(), 1 => Just(Vec3::ZERO)], 0.01f32..1.0).prop_map(
            |(position, normal, albedo)| AnyReceiver::Lambert(LambertReceiver { position, normal, albedo })
        ),
        (surface(), part(), 0.01f32..1.0, 0.0f32..5.0).prop_map(
            |((position, normal, view), diffuse, specular, decades)| {
                let exponent = 10.0f32.powf(decades);
                AnyReceiver::Phong(PhongReceiver { position, normal, view, diffuse, specular, exponent })
            }
        ),
        (surface(), part(), 0.01f32..1.0, -3.0f32..0.0).prop_map(
            |((position, normal, view), diffuse, f0, decades)| {
                let alpha = 10.0f32.powf(decades);
                AnyReceiver::Ggx(GgxReceiver { position, normal, view, diffuse, f0, alpha })
            }
        ),
    ]
}

/// Somewhere relative to a box: anywhere, at a corner, on a face, inside, or just outside of it.
pub fn position_near(bounds: LightBounds) -> impl Strategy<Value = Vec3> {
    let inside = prop::array::uniform3(prop_oneof![Just(0.0f32), Just(1.0), 0.0f32..1.0]);
    (position(), inside, 0..4).prop_map(move |(anywhere, inside, kind)| {
        let inside = bounds.min + Vec3::from(inside) * (bounds.max - bounds.min);
        match kind {
            0 => inside,
            1 => inside.lerp(anywhere, 1e-3),
            _ => anywhere,
        }
    })
}
