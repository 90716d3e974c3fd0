//! A photon: light that arrives.

use glam::Vec3;

use crate::PhotonError;
use crate::points::Located;

/// Light that arrives at a surface, as the caller has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon {
    /// World-space position on the surface.
    pub position: Vec3,
    /// Unit normal of the surface, on the side where it arrives.
    pub normal: Vec3,
    /// Unit direction to where it came from.
    pub direction: Vec3,
    /// W per channel. Not irradiance: how densely photons lie says the rest, the cosine included.
    pub power: Vec3,
}

/// A photon as a map keeps it: 32 bytes. Directions are to about a third of a degree, which is enough to tell
/// sides and walls apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub(crate) struct Packed {
    position: [f32; 3],
    normal: [i8; 4],
    power: [f32; 3],
    direction: [i8; 4],
}

impl Packed {
    pub(crate) fn new(photon: &Photon, index: usize) -> Result<Self, PhotonError> {
        let Photon { position, normal, direction, power } = *photon;
        if !(position.is_finite() && normal.is_finite() && direction.is_finite() && power.is_finite()) {
            return Err(PhotonError::NonFinite { index });
        }
        if [normal, direction].iter().any(|v| (v.length() - 1.0).abs() > 0.01) {
            return Err(PhotonError::NotUnit { index });
        }
        if power.min_element() < 0.0 {
            return Err(PhotonError::NegativePower { index });
        }
        Ok(Self {
            position: position.to_array(),
            normal: pack_unit(normal),
            power: power.to_array(),
            direction: pack_unit(direction),
        })
    }

    pub(crate) fn power(&self) -> Vec3 {
        Vec3::from(self.power)
    }

    /// To where it came from; of about unit length.
    pub(crate) fn direction(&self) -> Vec3 {
        unpack_unit(self.direction)
    }
}

impl Located for Packed {
    #[inline]
    fn position(&self) -> Vec3 {
        Vec3::from(self.position)
    }

    #[inline]
    fn normal(&self) -> Vec3 {
        unpack_unit(self.normal)
    }
}

impl From<&Packed> for Photon {
    fn from(packed: &Packed) -> Self {
        Self {
            position: packed.position(),
            normal: packed.normal().normalize_or(Vec3::Z),
            direction: packed.direction().normalize_or(Vec3::Z),
            power: packed.power(),
        }
    }
}

/// A unit vector in steps of 1/127 an axis.
pub(crate) fn pack_unit(v: Vec3) -> [i8; 4] {
    let [x, y, z] = (v * 127.0).to_array().map(|c| c.round() as i8);
    [x, y, z, 0]
}

#[inline]
pub(crate) fn unpack_unit([x, y, z, _]: [i8; 4]) -> Vec3 {
    Vec3::new(f32::from(x), f32::from(y), f32::from(z)) * (1.0 / 127.0)
}
