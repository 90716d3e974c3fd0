//! The two children of a node weighed together, in four lanes of f32.
//!
//! What [`BoundTerms::importance`](crate::BoundTerms::importance) says with f64 and the smallest angles to a box, this says at a fraction of
//! the cost, roughly. Differs from it:
//! - Differences of coordinates are formed as they are (f32 rounds them, but never to a wrong sign, and those of near
//!   numbers not at all), and then scaled by a power of two that makes the scene as seen from the receiver about 1
//!   across. So scale changes no bit, and squares have room.
//! - Angles to a cone or a lobe are those to the bounding sphere of the box (Conty Estévez and Kulla 2018).
//! - No division but one for both children; cosines stay fractions until then.
//!
//! A node is weighed 0 only where it cannot contribute: within the rounding errors of f32 around a horizon the answer
//! is `None`, and the caller asks in f64.

use glam::{BVec4A, Vec3, Vec4, Vec4Swizzles};

use crate::{LightBounds, Receiver, ScatterLobes};

/// A receiver, prepared for one walk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    position: Vec3,
    /// Power of two that scales lengths to about the larger of the scene and its distance.
    scale: f32,
    /// Square of `scale`, exact.
    pub(super) scale_squared: f64,
    lobes: Option<ScatterLobes>,
}

/// What decides between two children; lengths are scaled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighed {
    /// Intensity × emission × scattering, each, up to a factor of both; 0 only for nodes that cannot contribute.
    pub(super) strength: [f64; 2],
    /// Squared distance to the nearest point of each box, then to the farthest.
    pub(super) squared: [f32; 4],
    /// The corners: smallest coordinates of both boxes, then largest.
    corners: Lanes,
}

/// Vectors to the corners of two boxes, coordinate by coordinate: first's low, second's low, first's high, second's
/// high.
#[derive(Clone, Copy, Debug)]
struct Lanes {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

/// Relative error of a scaled height above a plane, and then some: five roundings.
const HEIGHT_ERROR: f32 = 8.0 / 16_777_216.0;

/// Farthest squared distances, scaled, within which squares of products neither over- nor underflow.
const SMALLEST: f32 = 1e-14;
const LARGEST: f32 = 1e8;

impl Viewpoint {
    /// `root` is the box of all lights. `None` where lengths span more than f32 does.
    #[inline]
    pub(super) fn new<R: Receiver + ?Sized>(receiver: &R, root: &(Vec3, Vec3)) -> Option<Self> {
        let position = receiver.position();
        let far = (root.1 - position).abs().max((root.0 - position).abs()).max_element();
        // The largest power of two that is not above it; -126..=126 leaves room for its inverse.
        let exponent = (far.to_bits() >> 23) as i32 - 127;
        if !(-126..=126).contains(&exponent) {
            return None;
        }
        let scale = f32::from_bits(((127 - exponent) as u32) << 23);
        let lobes = receiver.lobes();
        Some(Self { position, scale, scale_squared: f64::from(scale) * f64::from(scale), lobes })
    }

    /// Both children of a node; `None` where rounding might decide.
    #[inline]
    pub(super) fn weigh<R: Receiver + ?Sized>(
        &self,
        a: &LightBounds,
        b: &LightBounds,
        receiver: &R,
    ) -> Option<Weighed> {
        let lane = |low_a: f32, low_b, high_a, high_b, from: f32| {
            (Vec4::new(low_a, low_b, high_a, high_b) - Vec4::splat(from)) * self.scale
        };
        let corners = Lanes {
            x: lane(a.min.x, b.min.x, a.max.x, b.max.x, self.position.x),
            y: lane(a.min.y, b.min.y, a.max.y, b.max.y, self.position.y),
            z: lane(a.min.z, b.min.z, a.max.z, b.max.z, self.position.z),
        };
        let squared = corners.squared_distances();
        let far = squared.zwzw();
        if !(far.cmpge(Vec4::splat(SMALLEST)) & far.cmple(Vec4::splat(LARGEST))).all() {
            return None;
        }

        let sphere = Sphere::around(&corners);
        let (emitted, of) = if a.cos_theta_o <= -1.0 && b.cos_theta_o <= -1.0 {
            (Vec4::ONE, Vec4::ONE)
        } else {
            sphere.emission(a, b)
        };
        // Spheres and boxes disagree about the last of a cone: what is left out altogether is for f64 to say.
        if !(emitted.x > 0.0 && emitted.y > 0.0) {
            return None;
        }
        let intensity = [f64::from(a.intensity), f64::from(b.intensity)];
        let [first, second] = match &self.lobes {
            Some(lobes) => {
                let (height, distance) = corners.rough_cos(lobes.normal, squared)?;
                let scattered = lobes.weigh(&sphere, height, distance);
                (emitted * scattered / (of * distance)).xy().to_array()
            }
            None => {
                let scatter = |bounds: &LightBounds| {
                    receiver.scatter_importance(&crate::Toward::new(self.position, bounds.min, bounds.max))
                };
                let emitted = emitted / of;
                let scattered = Vec4::new(
                    if emitted.x > 0.0 { scatter(a) } else { 0.0 },
                    if emitted.y > 0.0 { scatter(b) } else { 0.0 },
                    0.0,
                    0.0,
                );
                // Where it is infinite, f64 sorts it out.
                let both = emitted * scattered;
                if !both.is_finite() || both.cmpgt(Vec4::ZERO) != scattered.cmpgt(Vec4::ZERO) {
                    return None;
                }
                both.xy().to_array()
            }
        };
        let strength = [intensity[0] * f64::from(first), intensity[1] * f64::from(second)];
        Some(Weighed { strength, squared: squared.to_array(), corners })
    }
}

impl Weighed {
    /// Four times the squared distances to the boxes' centres.
    pub(super) fn center_squared(&self) -> [f32; 2] {
        let squared = self.corners.map(|v| v + v.zwxy()).dot_self();
        [squared.x, squared.y]
    }

    /// Squared lengths of the boxes' diagonals.
    pub(super) fn diagonal_squared(&self) -> [f32; 2] {
        let squared = self.corners.map(|v| v.zwxy() - v).dot_self();
        [squared.x, squared.y]
    }
}

impl Lanes {
    #[inline]
    fn map(self, f: impl Fn(Vec4) -> Vec4) -> Self {
        Self { x: f(self.x), y: f(self.y), z: f(self.z) }
    }

    #[inline]
    fn dot_self(self) -> Vec4 {
        self.x * self.x + self.y * self.y + self.z * self.z
    }

    #[inline]
    fn dot(self, v: Vec3) -> Vec4 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }

    /// To the nearest point of the first and of the second box, then to the farthest ones.
    #[inline]
    fn squared_distances(self) -> Vec4 {
        self.map(|v| v.max(-v.zwxy()).max(Vec4::ZERO)).dot_self()
    }

    /// [`Toward::rough_max_cos`](crate::Toward::rough_max_cos) to the unit vector `n`, as a numerator, 0 where all of a box is below the horizon, and
    /// a denominator; 1/1 for a zero vector.
    #[inline]
    fn rough_cos(self, n: Vec3, squared: Vec4) -> Option<(Vec4, Vec4)> {
        if n == Vec3::ZERO {
            return Some((Vec4::ONE, Vec4::ONE));
        }
        let highest = |v: Vec4, n: f32| {
            let height = v * n;
            height.max(height.zwxy())
        };
        let height = highest(self.x, n.x) + highest(self.y, n.y) + highest(self.z, n.z);
        let unsure = HEIGHT_ERROR * HEIGHT_ERROR * squared.zwzw();
        if !(height * height).cmpgt(unsure).all() {
            return None;
        }
        let along = self.map(|v| v.max(Vec4::ZERO) + v.zwxy().min(Vec4::ZERO)).dot(n);
        let aside = (squared - along * along).max(Vec4::ZERO);
        Some((height.max(Vec4::ZERO), (height * height + aside).sqrt()))
    }
}

/// The bounding spheres of two boxes; all lengths are doubled.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Lanes,
    /// Squared distance to the centre.
    squared: Vec4,
    radius_squared: Vec4,
}

impl Sphere {
    #[inline]
    fn around(corners: &Lanes) -> Self {
        let center = corners.map(|v| v + v.zwxy());
        let radius_squared = corners.map(|v| v.zwxy() - v).dot_self();
        Self { center, squared: center.dot_self(), radius_squared }
    }

    /// cos max(0, θ - φ) for the angle θ with cosine `along` / distance and φ the sphere's own plus one of these cosine
    /// and sine: as a fraction of `self.squared`. Also sin(θ - φ) by the same measure, and whether θ ≤ φ.
    #[inline]
    fn cos_outside(&self, along: Vec4, cos: Vec4, sin: Vec4) -> (Vec4, Vec4, BVec4A) {
        let aside = (self.squared - along * along).max(Vec4::ZERO).sqrt();
        let (cos_u, sin_u) =
            ((self.squared - self.radius_squared).max(Vec4::ZERO).sqrt(), self.radius_squared.sqrt());
        let (cos_phi, sin_phi) = (cos * cos_u - sin * sin_u, sin * cos_u + cos * sin_u);
        let beyond = aside * cos_phi - along * sin_phi;
        let within =
            beyond.cmple(Vec4::ZERO) | sin_phi.cmplt(Vec4::ZERO) | self.radius_squared.cmpge(self.squared);
        (along * cos_phi + aside * sin_phi, beyond, within)
    }

    /// What each node emits towards the receiver relative to its peak, as a fraction; 0 only if it emits nothing.
    #[inline]
    fn emission(&self, a: &LightBounds, b: &LightBounds) -> (Vec4, Vec4) {
        let lanes = |a, b| Vec4::new(a, b, a, b);
        let axis = Lanes {
            x: lanes(a.axis.x, b.axis.x),
            y: lanes(a.axis.y, b.axis.y),
            z: lanes(a.axis.z, b.axis.z),
        };
        let along = -(axis.x * self.center.x + axis.y * self.center.y + axis.z * self.center.z);
        let sides = |two_sided| if two_sided { -1.0f32 } else { 1.0 };
        let two_sided = lanes(sides(a.two_sided), sides(b.two_sided)).cmplt(Vec4::ZERO);
        let along = Vec4::select(two_sided, along.abs(), along);
        let cos = lanes(a.cos_theta_o, b.cos_theta_o);
        let sin = ((Vec4::ONE - cos) * (Vec4::ONE + cos)).max(Vec4::ZERO).sqrt();
        let (outside, beyond, within) = self.cos_outside(along, cos, sin);

        let everywhere = cos.cmple(Vec4::NEG_ONE) | two_sided & cos.cmple(Vec4::ZERO);
        let full = within | everywhere;
        // Square roots near 0 are wrong by up to 1e-3 each, as angles; what is wrong by rounding alone is less than 2e-6.
        let sure = outside + 2e-3 * beyond.abs() + 2e-6 * self.squared;
        let dead = sure.cmplt(lanes(a.cos_theta_e, b.cos_theta_e) * self.squared);
        let some = Vec4::select(dead, Vec4::ZERO, outside.max(1e-4 * self.squared));
        (Vec4::select(full, Vec4::ONE, some), Vec4::select(full, Vec4::ONE, self.squared))
    }
}

impl ScatterLobes {
    /// Scattering × `distance`, for cosines to the normal that are `height` / `distance`.
    #[inline]
    fn weigh(&self, sphere: &Sphere, height: Vec4, distance: Vec4) -> Vec4 {
        let diffuse = self.diffuse * height;
        if self.peak <= 0.0 {
            return diffuse;
        }
        let along = sphere.center.dot(self.axis);
        let (outside, _, within) = sphere.cos_outside(along, Vec4::ONE, Vec4::ZERO);
        let cos = Vec4::select(within, Vec4::ONE, outside / sphere.squared);
        let half_sin_squared = 0.5 * (Vec4::ONE - cos).max(Vec4::ZERO);
        let fall = self.width_squared / (self.width_squared + (1.0 - self.width_squared) * half_sin_squared);
        let lobe = self.peak * fall * fall * distance;
        Vec4::select(height.cmpgt(Vec4::ZERO), diffuse + lobe, Vec4::ZERO)
    }
}
