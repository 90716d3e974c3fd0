//! Emissive surfaces as lights: one triangle light for each triangle that emits.

use glam::{Vec2, Vec3};

use super::{Mesh, Scene};
use crate::{Light, Material, Texture};

/// What [`Scene::add_emissive_triangles`] found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EmissionSummary {
    /// Triangles, after instancing, whose material emits: the lights added and the two below.
    pub emissive_triangles: usize,
    /// Among them: black wherever the emissive texture covers them, so no light.
    pub black: usize,
    /// Among them: of no area (or one that f32 cannot hold), so no light.
    pub without_area: usize,
}

impl Scene {
    /// Adds a [`Light::Triangle`] for each triangle, after instancing, whose material emits, in the order of
    /// instances and triangles. Call it once, when geometry and materials are complete.
    ///
    /// The radiance is the mean of `emissive × texture` over the triangle. A mirrored instance's triangles are
    /// turned round, so that the light's front stays the surface's.
    pub fn add_emissive_triangles(&mut self) -> EmissionSummary {
        let mut summary = EmissionSummary::default();
        for (index, instance) in self.instances.iter().enumerate() {
            let mesh = &self.meshes[instance.mesh as usize];
            let material = &self.materials[mesh.material as usize];
            if material.emissive == Vec3::ZERO {
                continue;
            }
            let mirrored = instance.is_mirrored();
            for (triangle, corners) in mesh.triangles.iter().enumerate() {
                summary.emissive_triangles += 1;
                let [a, b, c] =
                    corners.map(|i| instance.to_world.transform_point3(mesh.positions[i as usize]));
                let double_area = (b - a).cross(c - a).length();
                if !(double_area > 0.0 && double_area.is_finite()) {
                    summary.without_area += 1;
                    continue;
                }
                let radiance = mean_radiance(material, &self.textures, mesh, *corners);
                if radiance == Vec3::ZERO {
                    summary.black += 1;
                    continue;
                }
                self.lights.push(Light::Triangle {
                    vertices: if mirrored { [a, c, b] } else { [a, b, c] },
                    radiance,
                    two_sided: material.double_sided,
                    instance: index as u32,
                    triangle: triangle as u32,
                });
            }
        }
        summary
    }
}

/// Mean of what a triangle of `mesh` emits.
fn mean_radiance(material: &Material, textures: &[Texture], mesh: &Mesh, corners: [u32; 3]) -> Vec3 {
    let Some(slot) = material.emissive_texture else { return material.emissive };
    let uvs = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
    let uv = |i: u32| slot.transform.transform_point2(uvs.get(i as usize).copied().unwrap_or(Vec2::ZERO));
    let [a, b, c] = corners.map(uv);
    let texture = &textures[slot.texture as usize];
    const STEPS: u32 = 16;
    let mut sum = Vec3::ZERO;
    for i in 0..STEPS {
        for j in 0..STEPS - i {
            let (u, v) = ((i as f32 + 1.0 / 3.0) / STEPS as f32, (j as f32 + 1.0 / 3.0) / STEPS as f32);
            sum += texture.sample(a + u * (b - a) + v * (c - a)).truncate();
        }
    }
    material.emissive * sum / (STEPS * (STEPS + 1) / 2) as f32
}
