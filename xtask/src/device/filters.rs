//! SVGF and TAA on the device: the same filters as `stochastic::filter`, with the same dials.

use glam::Vec3;
use render_gpu::filter::{self as gpu_filter, FilterFrame, FilterInputs, SvgfKernels, TaaKernels};
use render_gpu::{Gpu, GpuError};
use stochastic::filter::{Clip, FilterInput, FilterReport, Mixing, SvgfParams, TaaParams};

/// Filters with what they remember from frame to frame, on the device.
pub(crate) struct DeviceFilters {
    gpu: Gpu,
    svgf: SvgfKernels,
    taa: TaaKernels,
    /// For pictures of the size of the last.
    ready: Option<Ready>,
}

struct Ready {
    size: (u32, u32),
    svgf: gpu_filter::Svgf,
    taa: Option<gpu_filter::Taa>,
}

impl DeviceFilters {
    /// Compiles the kernels.
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let (svgf, taa) = (SvgfKernels::new(gpu)?, TaaKernels::new(gpu)?);
        Ok(Self { gpu: gpu.clone(), svgf, taa, ready: None })
    }

    /// Filters a frame by SVGF, and what comes out by TAA if there are parameters for it.
    ///
    /// # Errors
    /// What the device has against it, or a dial out of its range.
    pub(crate) fn filter(
        &mut self,
        svgf: &SvgfParams,
        taa: Option<&TaaParams>,
        input: &FilterInput<'_>,
        out: &mut [Vec3],
    ) -> Result<FilterReport, GpuError> {
        let size = (input.width, input.height);
        let gpu = self.gpu.clone();
        let mut ready = match self.ready.take().filter(|ready| ready.size == size) {
            Some(ready) => ready,
            None => self.ready(size, svgf, taa)?,
        };
        let frame = FilterFrame {
            color: input.color,
            emission: input.emission,
            albedo: input.albedo,
            normal: input.normal,
            depth: input.depth,
            motion: input.motion,
            mesh: input.mesh,
        };
        let gpu_filter::FilterReport { non_finite, with_history, without_history, mut clipped } =
            ready.svgf.filter(&gpu, &frame, out)?;
        if let Some(taa) = &mut ready.taa {
            let smooth = out.to_vec();
            clipped = taa.filter(&gpu, &FilterFrame { color: &smooth, ..frame }, out)?.clipped;
        }
        self.ready = Some(ready);
        Ok(FilterReport { non_finite, with_history, without_history, clipped })
    }

    fn ready(&self, size: (u32, u32), svgf: &SvgfParams, taa: Option<&TaaParams>) -> Result<Ready, GpuError> {
        let inputs = || FilterInputs::new(&self.gpu, size.0, size.1);
        let svgf = gpu_filter::Svgf::new(&self.gpu, &self.svgf, &svgf_params(svgf), &inputs()?)?;
        let of = |params| gpu_filter::Taa::new(&self.gpu, &self.taa, &taa_params(params), &inputs()?);
        Ok(Ready { size, svgf, taa: taa.map(of).transpose()? })
    }
}

/// The same dials for the device.
fn svgf_params(params: &SvgfParams) -> gpu_filter::SvgfParams {
    let SvgfParams {
        levels,
        sigma_luminance,
        sigma_depth,
        depth_floor,
        normal_power,
        alpha,
        alpha_moments,
        least_frames,
        feedback,
        interleaved,
        albedo_floor,
        mixing,
    } = *params;
    let mixing = match mixing {
        Mixing::Normalized => gpu_filter::Mixing::Normalized,
        Mixing::Conserving => gpu_filter::Mixing::Conserving,
    };
    gpu_filter::SvgfParams {
        levels,
        sigma_luminance,
        sigma_depth,
        depth_floor,
        normal_power,
        alpha,
        alpha_moments,
        least_frames,
        feedback,
        interleaved,
        albedo_floor,
        mixing,
    }
}

fn taa_params(params: &TaaParams) -> gpu_filter::TaaParams {
    let TaaParams { alpha, clip, white } = *params;
    let clip = match clip {
        Clip::Extremes => gpu_filter::Clip::Extremes,
        Clip::Deviations(deviations) => gpu_filter::Clip::Deviations(deviations),
        Clip::Off => gpu_filter::Clip::Off,
    };
    gpu_filter::TaaParams { alpha, clip, white }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The dials are stated in both crates, since neither knows the other: every one begins with the same
    /// value.
    #[test]
    fn dials_begin_with_the_same_values() {
        assert_eq!(svgf_params(&SvgfParams::default()), gpu_filter::SvgfParams::default());
        assert_eq!(svgf_params(&SvgfParams::paper()), gpu_filter::SvgfParams::paper());
        assert_eq!(taa_params(&TaaParams::default()), gpu_filter::TaaParams::default());
    }
}
