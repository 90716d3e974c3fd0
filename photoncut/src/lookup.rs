//! Irradiance anywhere, out of the samples of a cut.

use glam::Vec3;

use crate::{CutSample, DensityParams, IlluminationCut, PhotonMap, PhotonScratch};

impl IlluminationCut {
    /// Irradiance of a surface at `point` that faces `normal`, W·m⁻² per channel: the mean of the samples
    /// that reach it, with weights K(d/r) · max(0, n·nⱼ), K(x) = 1 - x² (Wang et al. 2009, equations 4 and
    /// 5), divided by their sum, which the paper leaves out. `None` where no sample reaches.
    pub fn irradiance(&self, point: Vec3, normal: Vec3) -> Option<Vec3> {
        let samples = self.cut().values();
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0f32);
        for &index in self.reach.around(point) {
            let sample = &samples[index as usize];
            let weight = self.weight(sample, point, normal);
            if weight > 0.0 {
                sum += weight * sample.irradiance;
                weights += weight;
            }
        }
        let mean = sum / weights;
        (weights > 0.0 && mean.is_finite()).then_some(mean)
    }

    /// Equations 4 and 5, in a ball that is flat along the sample's normal.
    #[inline]
    fn weight(&self, sample: &CutSample, point: Vec3, normal: Vec3) -> f32 {
        let squared = sample.radius * sample.radius;
        let offset = point - sample.position;
        let off_surface = offset.dot(sample.normal);
        let near = squared - offset.length_squared() - (self.flatten - 1.0) * off_surface * off_surface;
        if near <= 0.0 || squared <= 0.0 {
            return 0.0;
        }
        near / squared * sample.normal.dot(normal).max(0.0)
    }

    /// The same, and where no sample reaches, from the photons themselves. Also returns whether it had to.
    pub fn irradiance_or_density(
        &self,
        map: &PhotonMap,
        point: Vec3,
        normal: Vec3,
        density: &DensityParams,
        scratch: &mut PhotonScratch,
    ) -> (Vec3, bool) {
        match self.irradiance(point, normal) {
            Some(irradiance) => (irradiance, false),
            None => (map.irradiance(point, normal, density, scratch).irradiance, true),
        }
    }
}
