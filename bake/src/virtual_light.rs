//! The record in which lights, direct and indirect, reach whoever stores baked light.

use glam::{Quat, Vec3};

use crate::{Polygon, Profile};

/// A light that shines on receivers: a piece of a lamp, or a cluster of what surfaces send on.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualLight {
    /// Where it shines from.
    pub shape: Shape,
    /// Radiant flux, W per channel. Of [`Shape::Sky`]: irradiance on a plane that faces it, W·m⁻² per
    /// channel.
    pub flux: Vec3,
    /// Key of the jitter of shadow rays: a function of what the light stands for, so that the same light has
    /// the same one again. Hash it with the receiver's index.
    pub seed: u32,
}

/// Where a virtual light shines from. World space.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A point; intensity as its profile says.
    Point {
        /// Position.
        position: Vec3,
        /// Spread over directions.
        profile: Profile,
        /// Turns the profile's frame into the world's.
        frame: Quat,
    },
    /// A part of a sphere's surface with the same radiance everywhere: strata of the disk that a receiver
    /// sees, so that all parts together are the sphere, and each has the same irradiance.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
        /// Which part, and of how many: a power of two.
        part: [u32; 2],
    },
    /// A cluster of light that surfaces send on: a Lambertian disk around a point. A receiver sees intensity
    /// × cosine ÷ (distance² + radius²), as on the axis of a disk; shadow rays go to its centre, which lies
    /// on a surface where the rest of the disk may not (Prutkin et al. 2012).
    Disk {
        /// Centre, just off a surface.
        position: Vec3,
        /// Unit normal on the side that shines.
        normal: Vec3,
        /// Radius, above 0: at most this takes the pole 1/d² away.
        radius: f32,
    },
    /// A flat piece of lamp with the same radiance everywhere, on the side of its normal.
    Polygon(Polygon),
    /// A cluster of light that a flat surface sends on. It shines as the polygon does; shadow rays go to some
    /// of the places where light met the surface, so that nothing is seen of it from where none of these is,
    /// though its outline is a rough one.
    Patch {
        /// Outline, just off the surface.
        polygon: Polygon,
        /// Where shadow rays go.
        places: Box<Places>,
    },
    /// A flat piece of lamp whose every point has the same profile.
    ShapedPolygon {
        /// Its outline; light leaves wherever the profile says, on both sides.
        polygon: Polygon,
        /// Spread over directions.
        profile: Profile,
        /// Turns the profile's frame into the world's.
        frame: Quat,
    },
    /// A part of the sky, or of the sun's disk, at infinity: from directions at angles around the frame's +Z.
    Sky {
        /// Turns +Z into the direction towards the middle of the sky.
        frame: Quat,
        /// Cosines of the angles to +Z, least first; both the same: one ring, or with 1 a direction.
        cos: [f32; 2],
        /// Azimuths from +X towards +Y, radians, least first.
        around: [f32; 2],
    },
}

/// One to eight points. 100 bytes.
#[derive(Clone, Copy, Debug)]
pub struct Places {
    points: [Vec3; Self::MOST],
    count: u8,
}

impl Places {
    /// The most points.
    pub const MOST: usize = 8;

    /// The first eight of some points; `None` for none at all.
    pub fn new(points: &[Vec3]) -> Option<Self> {
        let count = points.len().min(Self::MOST);
        let mut all = [*points.first()?; Self::MOST];
        all[..count].copy_from_slice(&points[..count]);
        Some(Self { points: all, count: count as u8 })
    }

    /// The points.
    pub fn points(&self) -> &[Vec3] {
        &self.points[..usize::from(self.count)]
    }

    /// The point for a uniform number in [0, 1).
    pub(crate) fn point(&self, u: f32) -> Vec3 {
        let points = self.points();
        points[((u * points.len() as f32) as usize).min(points.len() - 1)]
    }
}

impl PartialEq for Places {
    fn eq(&self, other: &Self) -> bool {
        self.points() == other.points()
    }
}
