//! Irradiance anywhere, out of the samples of a cut.

use glam::Vec3;

use crate::{CutSample, DensityParams, IlluminationCut, PhotonMap, PhotonScratch};

impl IlluminationCut {
    /// Irradiance of a surface at `point` that faces `normal`, W·m⁻² per channel: the mean of the samples
    /// that reach it, with weights K(d/r) · max(0, n·nⱼ), K(x) = 1 - x² (Wang et al. 2009, equations 4 and
    /// 5), times what each sample counts ([`CutSample::say`]), divided by their sum: neither is in the paper.
    /// `None` where no sample reaches.
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
        near / squared * sample.say * sample.normal.dot(normal).max(0.0)
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

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use lighttree::NodeId;

    use super::*;
    use crate::cut::SAY;

    /// Light that swells and fades, exact samples in proportion to it, each as wide as one over its root: what the
    /// mean of look-ups loses is what the second order says of what wide samples count.
    #[test]
    fn loses_by_wide_samples_what_theory_says() {
        const SIDE: u32 = 40;
        const STRENGTH: f32 = 0.5;
        // Reached by so many at every place.
        const MANY: f32 = 60.0;
        let light = |x: f32| (STRENGTH * (TAU * x).sin()).exp();
        // Where each of equal parts of a period's light has its middle.
        const FINE: u32 = 100_000;
        let steps: Vec<f32> = (0..FINE).map(|i| light((i as f32 + 0.5) / FINE as f32)).collect();
        let all: f64 = steps.iter().map(|&e| f64::from(e)).sum();
        let (mut columns, mut sum) = (Vec::new(), 0.0);
        for (i, &step) in steps.iter().enumerate() {
            sum += f64::from(step) / all;
            if sum * f64::from(SIDE) > columns.len() as f64 + 0.5 {
                columns.push((i as f32 + 0.5) / FINE as f32);
            }
        }
        let mean = (all / f64::from(FINE)) as f32;
        let mut samples = Vec::new();
        for period in [-1.0, 0.0, 1.0] {
            for &x in &columns {
                for row in 0..3 * SIDE {
                    let z = (row as f32 + 0.5) / SIDE as f32 - 1.0;
                    let density = (SIDE * SIDE) as f32 * light(x) / mean;
                    let radius = (MANY / (core::f32::consts::PI * density)).sqrt();
                    samples.push(CutSample {
                        position: Vec3::new(period + x, 0.0, z),
                        radius,
                        say: 1.0,
                        normal: Vec3::Y,
                        irradiance: Vec3::splat(light(x)),
                    });
                }
            }
        }
        let nodes = (0..samples.len() as u32).map(NodeId).collect();
        let cut = IlluminationCut::with_says(nodes, samples, 1.0, 0);
        const POINTS: u32 = 200;
        let mut found = 0.0;
        for i in 0..POINTS {
            for j in 0..POINTS {
                let [x, z] = [i, j].map(|k| (k as f32 + 0.5) / POINTS as f32);
                found += f64::from(cut.irradiance(Vec3::new(x, 0.0, z), Vec3::Y).unwrap().x);
            }
        }
        let found = found / f64::from(POINTS * POINTS);
        // s² E is the same everywhere: a sixth of r² E.
        let kernel = MANY / (6.0 * core::f32::consts::PI * (SIDE * SIDE) as f32);
        let gradients = 0.5 * (STRENGTH * TAU).powi(2);
        let expected = 0.5 * (1.0 - SAY) * kernel * gradients;
        let lost = 1.0 - found as f32 / mean;
        assert!((lost / expected - 1.0).abs() < 0.1, "{lost} lost, {expected} by theory");
    }
}
