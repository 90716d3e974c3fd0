//! A transform from mesh to world space, and what it does to bounds of lights and to receivers.

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use lighttree::{LightBounds, ScatterLobes};

use super::Keeps;

/// Where an instance stands. 208 bytes.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    to_world: DAffine3,
    /// Turns normals into world space, up to length, if `stretch` > 1; otherwise takes vectors into mesh
    /// space.
    turn: DMat3,
    /// Largest scale ÷ smallest; 1 exactly where all are the same, but for rounding.
    stretch: f64,
    /// How far rounding may move a light in world space, in the scene's unit of length.
    rounding: f32,
    /// Largest coordinate of any light in mesh space, absolute.
    extent: f32,
    /// World-space intensity ÷ intensity in mesh space; at least that where axes are scaled unequally.
    pub(super) factor: f64,
    /// The same in the units of both trees.
    pub(super) in_units: f64,
    pub(super) mesh: u32,
}

/// Why there is no such frame.
#[derive(Clone, Copy, Debug)]
pub(super) enum FrameError {
    NonFinite,
    Singular,
}

/// Scales that differ by less are the same: what is left of a rotation times a scale in f32.
const SAME: f64 = 1.0 / (1 << 20) as f64;

/// Smallest scale ÷ largest of what counts as flat.
const FLAT: f64 = 1.0 / (1 << 22) as f64;

/// Cosine and sine of the angle by which cones are widened for all that rounding does to directions: the
/// smallest but one that f32 can tell from 0 by its cosine, 4.9e-4 rad. The same for all cones, so that those
/// in others stay so.
const WIDER: (f64, f64) = (1.0 - 2.0 * (f32::EPSILON / 2.0) as f64, 4.882_812_4e-4);

impl Frame {
    /// The frame of an instance of lights within `lights`, if there are any.
    pub(super) fn new(
        mesh: u32,
        to_world: &Affine3A,
        keeps: Keeps,
        lights: Option<&LightBounds>,
    ) -> Result<Self, FrameError> {
        if !to_world.is_finite() {
            return Err(FrameError::NonFinite);
        }
        let to_world = DAffine3::from_mat3_translation(
            DMat3::from_cols(
                to_world.matrix3.x_axis.as_dvec3(),
                to_world.matrix3.y_axis.as_dvec3(),
                to_world.matrix3.z_axis.as_dvec3(),
            ),
            to_world.translation.as_dvec3(),
        );
        let matrix = to_world.matrix3;
        let [largest, middle, smallest] = singular_values(matrix).ok_or(FrameError::Singular)?;

        // Normals turn with the inverse transpose, which the cofactors are up to a factor.
        let cofactors = DMat3::from_cols(
            matrix.y_axis.cross(matrix.z_axis),
            matrix.z_axis.cross(matrix.x_axis),
            matrix.x_axis.cross(matrix.y_axis),
        );
        let is_similar = largest - smallest <= SAME * largest;
        let (turn, stretch) = if is_similar {
            (matrix.inverse(), 1.0)
        } else {
            (cofactors * matrix.determinant().signum(), largest / smallest * (1.0 + 1e-9))
        };
        let factor = match keeps {
            Keeps::Intensity => 1.0,
            Keeps::Radiance if is_similar => (largest * middle * smallest).cbrt().powi(2),
            Keeps::Radiance => lights.map_or(1.0, |b| largest_area_factor(&cofactors, largest * middle, b)),
        };
        let extent = lights.map_or(0.0, |b| b.min.abs().max(b.max.abs()).max_element());
        // A host that transforms in f32 rounds three products and as many sums a coordinate.
        let reach = largest * f64::from(extent) * 2.0 + to_world.translation.abs().max_element();
        let rounding = (reach / f64::from(1 << 21)) as f32;
        let frame = Self { to_world, turn, stretch, rounding, extent, factor, in_units: factor, mesh };
        if frame.turn.is_finite() && rounding.is_finite() && factor.is_finite() && factor > 0.0 {
            Ok(frame)
        } else {
            Err(FrameError::NonFinite)
        }
    }

    /// Bounds in world space of lights that are bounded in mesh space; contains those of whatever `lights`
    /// contains.
    pub(super) fn bounds(&self, lights: &LightBounds) -> LightBounds {
        let (min, max) = self.world_box(lights.min, lights.max);
        let mut normals = lights.normals();
        if normals.cos_half_angle > -1.0 {
            let turn = if self.is_similar() { &self.to_world.matrix3 } else { &self.turn };
            normals.axis = (*turn * lights.axis.as_dvec3()).normalize_or(DVec3::Z).as_vec3();
            normals.cos_half_angle = self.stretched(normals.cos_half_angle);
        }
        LightBounds {
            min,
            max,
            axis: normals.axis,
            cos_theta_o: normals.cos_half_angle,
            intensity: intensity(f64::from(lights.intensity), self.in_units),
            ..*lights
        }
    }

    /// The box around a transformed box, with room for rounding. Each step keeps the order of its numbers, so
    /// boxes in boxes stay so.
    fn world_box(&self, min: Vec3, max: Vec3) -> (Vec3, Vec3) {
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        let (mut low, mut high) = (self.to_world.translation, self.to_world.translation);
        let DMat3 { x_axis, y_axis, z_axis } = self.to_world.matrix3;
        for (axis, from, to) in [(x_axis, min.x, max.x), (y_axis, min.y, max.y), (z_axis, min.z, max.z)] {
            let (a, b) = (axis * from, axis * to);
            low += a.min(b);
            high += a.max(b);
        }
        let rounding = f64::from(self.rounding);
        let low = (low - rounding).as_vec3().map(f32::next_down);
        let high = (high + rounding).as_vec3().map(f32::next_up);
        (low, high)
    }

    /// Cosine of the half angle of a cone that holds the image of one whose cosine is given.
    fn stretched(&self, cos: f32) -> f32 {
        let mut cos = f64::from(cos).clamp(-1.0, 1.0);
        if !self.is_similar() {
            let angle = self.stretch * cos.acos();
            cos = if angle >= core::f64::consts::PI { -1.0 } else { angle.cos() };
        }
        let (cos_wider, sin_wider) = WIDER;
        if cos <= -cos_wider {
            return -1.0;
        }
        (cos * cos_wider - ((1.0 - cos) * (1.0 + cos)).sqrt() * sin_wider) as f32
    }

    /// Whether mesh space is world space turned, mirrored and scaled, so that angles are the same in both.
    pub(super) fn is_similar(&self) -> bool {
        self.stretch == 1.0
    }

    /// A receiver in mesh space, and by how much boxes there have to grow for what rounding does on the way.
    /// `None` where that cannot be had: the frame is no similarity, or f32 has no such numbers.
    pub(super) fn to_mesh(&self, position: Vec3, lobes: &ScatterLobes) -> Option<(Vec3, ScatterLobes, f32)> {
        if !self.is_similar() {
            return None;
        }
        let position = (self.turn * (position.as_dvec3() - self.to_world.translation)).as_vec3();
        let turned = |v: Vec3| (self.turn * v.as_dvec3()).normalize_or_zero().as_vec3();
        let lobes = ScatterLobes { normal: turned(lobes.normal), axis: turned(lobes.axis), ..*lobes };
        // Of angles between both spaces, of rounded normals and axes, and of the position just found; and of
        // the lights in world space. No light is farther away than a few times `reach`, so that growing boxes
        // tilts directions by more than rounding does.
        let reach = position.abs().max_element() + self.extent;
        let rounding = f64::from(self.rounding) / self.factor_of_length();
        let grow = 4.0 * SAME as f32 * reach + rounding as f32;
        (position.is_finite() && grow.is_finite()).then_some((position, lobes, grow))
    }

    /// World length ÷ mesh length of a similarity.
    fn factor_of_length(&self) -> f64 {
        self.to_world.matrix3.x_axis.length()
    }
}

/// An intensity in other units; one that is positive never vanishes, and none becomes infinite.
pub(super) fn intensity(intensity: f64, factor: f64) -> f32 {
    if intensity > 0.0 { ((intensity * factor) as f32).clamp(f32::from_bits(1), f32::MAX) } else { 0.0 }
}

/// The largest factor by which the area of a surface may grow whose normal is among those of `lights`: |C n|
/// for the matrix C of cofactors, whose largest singular value is `most`.
fn largest_area_factor(cofactors: &DMat3, most: f64, lights: &LightBounds) -> f64 {
    let cos = f64::from(lights.cos_theta_o).clamp(0.0, 1.0);
    let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    let of_axis = (*cofactors * lights.axis.as_dvec3().normalize_or(DVec3::Z)).length();
    most.min(of_axis + sin * most)
}

/// Largest first; `None` if the smallest is 0 or as good as that.
///
/// The eigenvalues of `MᵀM` in closed form (Smith, "Eigenvalues of a Symmetric 3 × 3 Matrix", 1961), the
/// smallest from the determinant, where nothing cancels.
fn singular_values(matrix: DMat3) -> Option<[f64; 3]> {
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let scale = columns.iter().map(|c| c.abs().max_element()).fold(0.0, f64::max);
    if scale == 0.0 {
        return None;
    }
    let m = matrix * (1.0 / scale);
    let s = m.transpose() * m;
    let mean = (s.x_axis.x + s.y_axis.y + s.z_axis.z) / 3.0;
    let b = s - DMat3::from_diagonal(DVec3::splat(mean));
    let aside = b.x_axis.length_squared() + b.y_axis.length_squared() + b.z_axis.length_squared();
    let p = (aside / 6.0).sqrt();
    let (first, last) = if p > 0.0 {
        let angle = (0.5 * (b * (1.0 / p)).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
        (mean + 2.0 * p * angle.cos(), mean + 2.0 * p * (angle + core::f64::consts::TAU / 3.0).cos())
    } else {
        (mean, mean)
    };
    let second = 3.0 * mean - first - last;
    let (largest, middle) = (first.sqrt(), second.max(0.0).sqrt());
    let smallest = m.determinant().abs() / (largest * middle);
    // Not `<=`, which would let NaN pass.
    let is_flat = !(middle > FLAT * largest && smallest > FLAT * largest);
    (!is_flat).then(|| [largest, middle, smallest.min(middle)].map(|x| x * scale))
}
