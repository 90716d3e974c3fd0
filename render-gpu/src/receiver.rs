//! Points to be lit, as kernels see them: this crate's record, or a host's own.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use lighttree::{Receiver, ScatterLobes, Toward};

/// The WGSL of [`ReceiverRecord`]: what a host with other records replaces.
///
/// A host's own text declares a struct `Receiver`, whose array is the host's buffer, and two functions:
/// ```wgsl
/// // World-space position; not finite: there is nothing to be lit here, and no light is drawn.
/// fn receiver_position(receiver: Receiver) -> vec3f
/// // About how much of |f · cos θ| there is for light from the box, up to a factor that is the same for all boxes; 0 only
/// // where there is none.
/// fn receiver_scatter(receiver: Receiver, box: Toward) -> f32
/// ```
/// `toward_cos(box, normal)` is about the largest cosine to directions into the box, 0 only where all of it
/// is below the horizon; `toward_lobe(box, normal, axis, width_squared)` about what a GGX lobe gives in the
/// mean over them. The text may declare other things whose names begin with `host_`.
pub const DEFAULT_RECEIVER: &str = include_str!("../shaders/receiver.wgsl");

/// A point to be lit: 48 bytes, diffuse with one lobe ([`ScatterLobes`]).
///
/// As a [`Receiver`] it has the same walks on the CPU as on a device.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ReceiverRecord {
    /// World-space position. Not finite: there is nothing to be lit, and no light is drawn.
    pub position: [f32; 3],
    /// Diffuse albedo / π, sr⁻¹.
    pub diffuse: f32,
    /// Unit normal; zero: no preferred direction.
    pub normal: [f32; 3],
    /// Scattering along the lobe's axis, sr⁻¹; 0: no lobe.
    pub peak: f32,
    /// Unit axis of the lobe.
    pub axis: [f32; 3],
    /// Squared width of the lobe, in (0, 1]; GGX's α².
    pub width_squared: f32,
}

impl ReceiverRecord {
    /// No point: a pixel that shows the sky.
    pub const NONE: Self = Self {
        position: [f32::INFINITY; 3],
        diffuse: 0.0,
        normal: [0.0; 3],
        peak: 0.0,
        axis: [0.0; 3],
        width_squared: 1.0,
    };

    /// The lobes of a receiver; `None` if it has no such form.
    pub fn new(receiver: &(impl Receiver + ?Sized)) -> Option<Self> {
        let lobes = receiver.lobes()?;
        Some(Self {
            position: receiver.position().to_array(),
            diffuse: lobes.diffuse,
            normal: lobes.normal.to_array(),
            peak: lobes.peak,
            axis: lobes.axis.to_array(),
            width_squared: lobes.width_squared,
        })
    }

    const fn scatter_lobes(&self) -> ScatterLobes {
        ScatterLobes {
            normal: Vec3::from_array(self.normal),
            diffuse: self.diffuse,
            axis: Vec3::from_array(self.axis),
            peak: self.peak,
            width_squared: self.width_squared,
        }
    }

    /// The lobe at cosine `cos` to its axis, relative to its peak.
    fn fall(&self, cos: f64) -> f64 {
        let width = f64::from(self.width_squared);
        let fall = width / (width + (1.0 - width) * 0.5 * (1.0 - cos).max(0.0));
        fall * fall
    }
}

impl Receiver for ReceiverRecord {
    fn position(&self) -> Vec3 {
        self.position.into()
    }

    fn scatter_bound(&self, toward: &Toward) -> f32 {
        let cos = toward.max_cos(self.normal.into());
        if cos <= 0.0 {
            return 0.0;
        }
        let lobe = if self.peak > 0.0 {
            self.fall(toward.max_cos_f64(Vec3::from(self.axis).as_dvec3()))
        } else {
            0.0
        };
        let bound = f64::from(self.diffuse) * f64::from(cos) + f64::from(self.peak) * lobe;
        (bound as f32).next_up()
    }

    /// As kernels have it, `receiver_scatter` in `shaders/receiver.wgsl`.
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        self.scatter_lobes().importance(toward)
    }

    fn lobes(&self) -> Option<ScatterLobes> {
        Some(self.scatter_lobes())
    }
}
