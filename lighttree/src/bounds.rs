//! What a tree knows of one emitter, or of many together.
//!
//! Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018: a box, a
//! cone of normals (`theta_o`) and an emission angle around each of them (`theta_e`).
//!
//! Differs from it: the strength is the peak radiant intensity instead of the flux. A bound needs it (flux
//! alone does not say how much goes one way), and it makes a narrow spot light weigh what it gives inside its
//! cone. A profile that is flat inside an angle (point, spot) is written as `theta_o` = that angle and
//! `theta_e` = 0, so that one formula, `intensity · cos(angle outside theta_o)` up to `theta_e`, bounds flat
//! and cosine profiles alike.

use glam::{DVec3, Vec3};

/// Directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Unit axis. Another length does no harm; zero or not finite stands for every direction.
    pub axis: Vec3,
    /// Cosine of the half angle, in [-1, 1]; -1: every direction.
    pub cos_half_angle: f32,
}

/// Bounds of the position, direction and strength of one or more emitters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// Smallest coordinates of the box that holds all emitting points, world space.
    pub min: Vec3,
    /// Largest coordinates of that box.
    pub max: Vec3,
    /// Unit axis of the cone that holds all normals. Any unit vector where `cos_theta_o` is -1.
    pub axis: Vec3,
    /// Cosine of that cone's half angle, in [-1, 1]; -1: any normal.
    pub cos_theta_o: f32,
    /// Cosine of the emission angle around each normal, in [0, 1]. 1: nothing outside the normals themselves;
    /// 0: a cosine-shaped hemisphere.
    pub cos_theta_e: f32,
    /// Whether the emission is mirrored: with every normal its opposite is meant, too.
    pub two_sided: bool,
    /// Sum of the peak radiant intensities, W·sr⁻¹; finite and never negative.
    pub intensity: f32,
}

impl LightBounds {
    /// No emitters: the identity of [`union`](Self::union).
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
        axis: Vec3::Z,
        cos_theta_o: 1.0,
        cos_theta_e: 1.0,
        two_sided: false,
        intensity: 0.0,
    };

    /// A point that sends the same intensity (W·sr⁻¹) everywhere.
    pub const fn point(position: Vec3, intensity: f32) -> Self {
        Self::omnidirectional(position, position, intensity)
    }

    /// Anything between `min` and `max` that may emit everywhere, at most `intensity` W·sr⁻¹ into any
    /// direction.
    pub const fn omnidirectional(min: Vec3, max: Vec3, intensity: f32) -> Self {
        Self { min, max, axis: Vec3::Z, cos_theta_o: -1.0, cos_theta_e: 1.0, two_sided: false, intensity }
    }

    /// A point that sends at most `intensity` W·sr⁻¹ within `outer_angle` radians of `axis`, and nothing
    /// outside.
    ///
    /// The cone is widened by a few units in the last place, so that a cosine that was computed in f32 and
    /// found to be inside is inside of these bounds, too.
    pub fn spot(position: Vec3, axis: Vec3, outer_angle: f32, intensity: f32) -> Self {
        let cos = outer_angle.clamp(0.0, core::f32::consts::PI).cos() - 4.0 * f32::EPSILON;
        // Not `max`, which would make -1 of NaN and hide it from the builder.
        let cos_theta_o = if cos < -1.0 { -1.0 } else { cos };
        Self { axis, cos_theta_o, ..Self::point(position, intensity) }
    }

    /// A flat surface between `min` and `max` that emits by the cosine around its unit `normal`, at most
    /// `intensity` W·sr⁻¹ (radiance × area).
    pub const fn surface(min: Vec3, max: Vec3, normal: Vec3, two_sided: bool, intensity: f32) -> Self {
        Self { min, max, axis: normal, cos_theta_o: 1.0, cos_theta_e: 0.0, two_sided, intensity }
    }

    /// Whether there is no emitter in these bounds, i.e. no point in the box.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The cone that holds all normals (of one side).
    pub const fn normals(&self) -> Cone {
        Cone { axis: self.axis, cos_half_angle: self.cos_theta_o }
    }

    /// Centre of the box. Finite for every finite box.
    pub fn center(&self) -> Vec3 {
        0.5 * self.min + 0.5 * self.max
    }

    /// Bounds of the emitters of both. What either bounds, the union bounds: box, normals, emission angles
    /// and the sum of intensities (which may be infinite; builders rule that out).
    ///
    /// Where the result is two-sided, either axis may be flipped, and the narrower of the two cones is taken.
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        let two_sided = self.two_sided || other.two_sided;
        let flip = two_sided && self.axis.dot(other.axis) < 0.0;
        let normals = self.normals().union(&if flip { other.normals().flipped() } else { other.normals() });
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            axis: normals.axis,
            cos_theta_o: normals.cos_half_angle,
            cos_theta_e: self.cos_theta_e.min(other.cos_theta_e),
            two_sided,
            intensity: self.intensity + other.intensity,
        }
    }

    /// Whether box, normals and emission angle of `other` lie within these; `slack` is an angle in radians by
    /// which its normals may stick out. Intensities are not compared.
    pub fn contains(&self, other: &Self, slack: f32) -> bool {
        if other.is_empty() {
            return true;
        }
        let (mine, theirs) = (self.normals(), other.normals());
        let normals = match (self.two_sided, other.two_sided) {
            (false, false) => mine.contains(&theirs, slack),
            (true, _) => {
                mine.cos_half_angle <= 0.0
                    || mine.contains(&theirs, slack)
                    || mine.contains(&theirs.flipped(), slack)
            }
            (false, true) => mine.contains(&theirs, slack) && mine.contains(&theirs.flipped(), slack),
        };
        let in_box = self.min.cmple(other.min).all() && self.max.cmpge(other.max).all();
        in_box && normals && self.cos_theta_e <= other.cos_theta_e
    }
}

impl Cone {
    /// Every direction.
    pub const ALL: Self = Self { axis: Vec3::Z, cos_half_angle: -1.0 };

    /// The same cone around the opposite axis.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self { axis: -self.axis, ..*self }
    }

    /// The narrowest cone around both, to within f32's own steps (a half angle near 0 can only be told from
    /// another if they differ by 3.5e-4 rad, which is what the cosine nearest below 1 stands for).
    ///
    /// It contains both: axis and half angle come from angle sums (as complex products, in f64), then the
    /// half angle is taken anew around the axis as it was rounded, and its cosine is rounded down. Cones that
    /// together span the sphere, and opposite axes, where the axis of the result could be any, are no special
    /// cases for the caller.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        let (wide, narrow) =
            if self.cos_half_angle <= other.cos_half_angle { (self, other) } else { (other, self) };
        let (Some(a), Some(b)) =
            (wide.axis.as_dvec3().try_normalize(), narrow.axis.as_dvec3().try_normalize())
        else {
            return Self::ALL;
        };
        let (alpha, beta) = (Turn::from_cos(wide.cos_half_angle), Turn::from_cos(narrow.cos_half_angle));
        let theta = Turn::between(a, b);

        // One may hold the other already.
        if (theta + beta).is_at_most(alpha) {
            return *wide;
        }

        // In the plane of both axes, the edges of the union are the far edge of one cone and the far edge of
        // the other; its axis halves the angle between them. The sum of two unit vectors vanishes near half a
        // turn, the perpendicular to their difference near none, so take whichever is longer.
        let across = perpendicular_part(b, a);
        let near = Turn { cos: alpha.cos, sin: -alpha.sin };
        let far = theta + beta;
        let (sum_x, sum_y) = (near.cos + far.cos, near.sin + far.sin);
        let (perp_x, perp_y) = (far.sin - near.sin, near.cos - far.cos);
        let (x, y) = if sum_x * sum_x + sum_y * sum_y >= 2.0 && (theta + beta + alpha).sin >= 0.0 {
            (sum_x, sum_y)
        } else {
            (perp_x, perp_y)
        };
        let axis = (x * a + y * across).normalize_or(a).as_vec3();

        // The half angle around that axis, which f32 has rounded; down to -1 where the sum exceeds half a
        // turn.
        let rounded = axis.as_dvec3().normalize();
        let cos = (Turn::between(rounded, a) + alpha)
            .cos_or_half_turn()
            .min((Turn::between(rounded, b) + beta).cos_or_half_turn());
        Self { axis, cos_half_angle: round_down(cos - 4.0 * f64::EPSILON).max(-1.0) }
    }

    /// Whether every direction of `other` is within `slack` radians of a direction of this cone.
    pub fn contains(&self, other: &Self, slack: f32) -> bool {
        if self.cos_half_angle <= -1.0 {
            return true;
        }
        let (Some(a), Some(b)) =
            (self.axis.as_dvec3().try_normalize(), other.axis.as_dvec3().try_normalize())
        else {
            return false;
        };
        let theta = a.cross(b).length().atan2(a.dot(b));
        let acos = |cos: f32| f64::from(cos).clamp(-1.0, 1.0).acos();
        let reach = (theta + acos(other.cos_half_angle)).min(core::f64::consts::PI);
        reach <= acos(self.cos_half_angle) + f64::from(slack)
    }
}

/// An angle as the point at it on the unit circle, so that angles add without trigonometry.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    pub(crate) cos: f64,
    pub(crate) sin: f64,
}

impl Turn {
    /// The angle in [0, π] of that cosine.
    pub(crate) fn from_cos(cos: impl Into<f64>) -> Self {
        let cos = cos.into().clamp(-1.0, 1.0);
        Self { cos, sin: ((1.0 - cos) * (1.0 + cos)).sqrt() }
    }

    /// The angle in [0, π] between two unit vectors.
    fn between(a: DVec3, b: DVec3) -> Self {
        let (cos, sin) = (a.dot(b), a.cross(b).length());
        // Of about 1: no overflow for `hypot` to save from.
        let length = (cos * cos + sin * sin).sqrt();
        Self { cos: cos / length, sin: sin / length }
    }

    /// Whether this sum of two angles from [0, π] is at most `limit` from [0, π].
    fn is_at_most(self, limit: Self) -> bool {
        self.sin >= 0.0 && self.cos >= limit.cos
    }

    /// The cosine of this sum of two angles from [0, π], or -1 where it exceeds π.
    fn cos_or_half_turn(self) -> f64 {
        if self.sin < 0.0 { -1.0 } else { self.cos }
    }
}

impl core::ops::Add for Turn {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            cos: self.cos * other.cos - self.sin * other.sin,
            sin: self.sin * other.cos + self.cos * other.sin,
        }
    }
}

/// The unit vector across the unit vector `along` towards `v`; any across `along` where `v` has no such part.
fn perpendicular_part(v: DVec3, along: DVec3) -> DVec3 {
    let part = v - v.dot(along) * along;
    // What is left of parallel vectors is rounding error, whose direction need not be across.
    if part.length_squared() > 1e-24 { part.normalize() } else { along.any_orthonormal_vector() }
}

/// The largest f32 that is not above `x`.
fn round_down(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x { nearest.next_down() } else { nearest }
}
