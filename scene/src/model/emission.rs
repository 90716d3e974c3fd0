//! Emissive surfaces as lights: one triangle light for each triangle that emits.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::footprint::Footprints;
use super::{Mesh, Scene};
use crate::{Light, Material};

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
    /// The radiance is the mean of `emissive × texture` over the triangle, exact up to rounding for
    /// footprints of up to some two thousand texels across and from an averaged image beyond; never black
    /// where the texture is not. A mirrored instance's triangles are turned round, so that the light's front
    /// stays the surface's.
    pub fn add_emissive_triangles(&mut self) -> EmissionSummary {
        let mut summary = EmissionSummary::default();
        let mut footprints: HashMap<u32, Footprints> = HashMap::new();
        // By mesh, since instances share it.
        let mut radiances: HashMap<u32, Vec<Vec3>> = HashMap::new();
        for (index, instance) in self.instances.iter().enumerate() {
            let mesh = &self.meshes[instance.mesh as usize];
            let material = &self.materials[mesh.material as usize];
            if material.emissive == Vec3::ZERO {
                continue;
            }
            let texture = material.emissive_texture.map(|slot| slot.texture);
            let footprints = texture.map(|texture| {
                let entry = footprints.entry(texture);
                &*entry.or_insert_with(|| Footprints::new(&self.textures[texture as usize]))
            });
            let radiances =
                radiances.entry(instance.mesh).or_insert_with(|| mean_radiance(mesh, material, footprints));
            let mirrored = instance.is_mirrored();
            for (triangle, (corners, &radiance)) in mesh.triangles.iter().zip(&*radiances).enumerate() {
                summary.emissive_triangles += 1;
                let [a, b, c] =
                    corners.map(|i| instance.to_world.transform_point3(mesh.positions[i as usize]));
                let double_area = (b - a).cross(c - a).length();
                if !(double_area > 0.0 && double_area.is_finite()) {
                    summary.without_area += 1;
                    continue;
                }
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

/// Mean emitted radiance of each triangle of `mesh`, black where its texture is.
fn mean_radiance(mesh: &Mesh, material: &Material, footprints: Option<&Footprints>) -> Vec<Vec3> {
    let (Some(slot), Some(footprints)) = (material.emissive_texture, footprints) else {
        return vec![material.emissive; mesh.triangles.len()];
    };
    let uvs = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
    let uv = |i: u32| slot.transform.transform_point2(uvs.get(i as usize).copied().unwrap_or(Vec2::ZERO));
    mesh.triangles.par_iter().map(|corners| material.emissive * footprints.mean(corners.map(uv))).collect()
}
