//! Places and directions of several lights at once, and what they give to a point.

use glam::Vec3;
use scene::ShadingPoint;
use scene::bsdf::Phong;

use super::super::lights::NodeLight;

/// Lights that are shaded at once.
pub(super) const LANES: usize = 8;

/// Places and directions of several virtual lights, one axis after the other.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lanes {
    pub(super) position: [[f32; LANES]; 3],
    pub(super) normal: [[f32; LANES]; 3],
}

/// What the lanes give to a point.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Lit {
    /// The geometry term cos·cos/d², not clamped; 0 below either horizon.
    pub(super) geometry: [f32; LANES],
    /// Cosine between the light and the mirrored viewer; then its power.
    pub(super) lobes: [f32; LANES],
}

impl Lanes {
    /// What is no virtual light stays dark.
    #[inline]
    pub(super) fn set(&mut self, lane: usize, node: &NodeLight) {
        for axis in 0..3 {
            self.position[axis][lane] = node.position[axis];
            self.normal[axis][lane] = node.normal[axis];
        }
    }

    pub(super) fn place(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.position.map(|axis| axis[lane]))
    }

    /// In f32, for scenes of plain scale. Lanes that were not set are dark.
    #[inline]
    pub(super) fn light<const GLOSSY: bool>(&self, point: &ShadingPoint) -> Lit {
        let mirror = 2.0 * point.normal.dot(point.wo) * point.normal - point.wo;
        let mut lit = Lit { geometry: [0.0; LANES], lobes: [0.0; LANES] };
        let [x, y, z] = &self.position;
        let [nx, ny, nz] = &self.normal;
        for lane in 0..LANES {
            let to = Vec3::new(x[lane], y[lane], z[lane]) - point.position;
            let at_light = -(nx[lane] * to.x + ny[lane] * to.y + nz[lane] * to.z);
            let (at_point, above) = (point.normal.dot(to), point.geometric_normal.dot(to));
            let inverse_squared = 1.0 / to.length_squared();
            let geometry = at_light * at_point * inverse_squared * inverse_squared;
            let faces = at_light.min(at_point).min(above) > 0.0;
            lit.geometry[lane] = if faces { geometry } else { 0.0 };
            if GLOSSY {
                lit.lobes[lane] = mirror.dot(to) * inverse_squared.sqrt();
            }
        }
        lit
    }
}

/// cosⁿ for several cosines at once.
pub(super) struct Power<'a> {
    phong: &'a Phong,
    /// The lobe at the mirror direction, sr⁻¹.
    pub(super) scale: f32,
    /// n where it is a whole number that few multiplications reach, else 0.
    whole: u32,
    /// The cosine whose power is e⁻⁸⁰: what is smaller counts as 0, so that no number is too small for a fast
    /// multiplication.
    least: f32,
}

impl<'a> Power<'a> {
    pub(super) fn of(phong: &'a Phong) -> Self {
        let n = phong.exponent;
        // Each multiplication may be off by 2⁻²⁴.
        let whole = if n.fract() == 0.0 && (1.0..=512.0).contains(&n) { n as u32 } else { 0 };
        Self { phong, scale: phong.lobe(1.0), whole, least: (-80.0 / n).exp() }
    }

    /// Replaces cosines by their powers; what is no number by 0.
    #[inline]
    pub(super) fn raise(&self, cosines: &mut [f32; LANES]) {
        let Self { phong, scale, whole, least } = *self;
        if whole == 0 {
            *cosines = cosines.map(|cos| if cos >= least { phong.lobe(cos) / scale } else { 0.0 });
            return;
        }
        let mut square = cosines.map(|cos| if cos >= least { cos.min(1.0) } else { 0.0 });
        let mut power = [1.0; LANES];
        let mut left = whole;
        loop {
            if left & 1 != 0 {
                (0..LANES).for_each(|lane| power[lane] *= square[lane]);
            }
            left >>= 1;
            if left == 0 {
                break;
            }
            (0..LANES).for_each(|lane| square[lane] *= square[lane]);
        }
        *cosines = power;
    }
}
