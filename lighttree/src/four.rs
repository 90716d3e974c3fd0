//! The bounds of four nodes side by side, as walks weigh them.

use bytemuck::must_cast;
use glam::{BVec4A, Mat4, Vec4};

use crate::LightBounds;

/// Bounds of four nodes, field by field: [`LightBounds`] with a lane for each.
///
/// What [`LightHierarchy::bounds_of_pairs`](crate::LightHierarchy::bounds_of_pairs) answers.
#[derive(Clone, Copy, Debug)]
pub struct FourBounds {
    /// Smallest coordinates of each box: x, y, z.
    pub min: [Vec4; 3],
    /// Largest coordinates of each box.
    pub max: [Vec4; 3],
    /// Sums of the peak radiant intensities.
    pub intensity: Vec4,
    /// `None` where all four emit into every direction alike: all cosines of `theta_o` are -1.
    pub cones: Option<FourCones>,
}

/// The cones of four nodes.
#[derive(Clone, Copy, Debug)]
pub struct FourCones {
    /// Axis of each cone of normals: x, y, z.
    pub axis: [Vec4; 3],
    /// Cosine of the half angle of each cone of normals.
    pub cos_theta_o: Vec4,
    /// Cosine of the angle that emission reaches beyond normals.
    pub cos_theta_e: Vec4,
    /// Where the normals' opposites count, too.
    pub two_sided: BVec4A,
}

impl FourBounds {
    /// Side by side.
    #[inline]
    pub fn new(nodes: &[LightBounds; 4]) -> Self {
        let of =
            |f: fn(&LightBounds) -> f32| Vec4::new(f(&nodes[0]), f(&nodes[1]), f(&nodes[2]), f(&nodes[3]));
        let cos_theta_o = of(|node| node.cos_theta_o);
        let cones = cos_theta_o.cmpgt(Vec4::NEG_ONE).any().then(|| FourCones {
            axis: [of(|node| node.axis.x), of(|node| node.axis.y), of(|node| node.axis.z)],
            cos_theta_o,
            cos_theta_e: of(|node| node.cos_theta_e),
            two_sided: of(|node| if node.two_sided { -1.0 } else { 1.0 }).cmplt(Vec4::ZERO),
        });
        Self {
            min: [of(|node| node.min.x), of(|node| node.min.y), of(|node| node.min.z)],
            max: [of(|node| node.max.x), of(|node| node.max.y), of(|node| node.max.z)],
            intensity: of(|node| node.intensity),
            cones,
        }
    }
}

/// Row `i` of four records becomes lane `i` of four columns.
#[inline(always)]
pub(crate) fn columns(rows: [Vec4; 4]) -> [Vec4; 4] {
    let [a, b, c, d] = rows;
    let Mat4 { x_axis, y_axis, z_axis, w_axis } = Mat4::from_cols(a, b, c, d).transpose();
    [x_axis, y_axis, z_axis, w_axis]
}

/// The words of four lanes.
#[inline(always)]
pub(crate) fn words(lanes: Vec4) -> [u32; 4] {
    must_cast(lanes)
}
