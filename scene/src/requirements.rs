//! What a scene asks of a renderer, found out once, so that nothing is modelled that it does not have.

use core::fmt;

use crate::{AlphaMode, Light, Scene};

/// Summary of a scene. Counts are of lights, materials in use and triangles after instancing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Requirements {
    /// Lights that are the same in every direction.
    pub point_lights: usize,
    /// Lights with a cone.
    pub spot_lights: usize,
    /// Emissive triangles.
    pub triangle_lights: usize,
    /// Emissive triangles whose radiance a texture modulates.
    pub textured_lights: usize,
    /// Virtual point lights.
    pub virtual_lights: usize,
    /// Lights without a place.
    pub distant_lights: usize,
    /// Materials with a lobe: GGX or Phong.
    pub glossy_materials: usize,
    /// Perfect mirrors and glass.
    pub specular_materials: usize,
    /// Materials with holes.
    pub masked_materials: usize,
    /// Materials that cover partly.
    pub blended_materials: usize,
    /// Meshes that stand in more than one place.
    pub shared_meshes: usize,
    /// Triangles after instancing.
    pub triangles: usize,
}

impl Requirements {
    /// Looks at everything once. `lights` is the list that is rendered with: [`Scene::lights`], or a longer
    /// one with virtual lights.
    pub fn new(scene: &Scene, lights: &[Light]) -> Self {
        let mut found = Self {
            distant_lights: scene.distant.len(),
            triangles: scene.triangle_count(),
            ..Self::default()
        };
        let mut places = vec![0_usize; scene.meshes.len()];
        for instance in &scene.instances {
            places[instance.mesh as usize] += 1;
        }
        found.shared_meshes = places.iter().filter(|&&n| n > 1).count();

        for light in lights {
            match *light {
                Light::Point { .. } => found.point_lights += 1,
                Light::Spot { .. } => found.spot_lights += 1,
                Light::Vpl { .. } => found.virtual_lights += 1,
                Light::Triangle { instance, .. } => {
                    found.triangle_lights += 1;
                    let mesh = scene.instances.get(instance as usize).map(|i| &scene.meshes[i.mesh as usize]);
                    let material = mesh.map(|mesh| &scene.materials[mesh.material as usize]);
                    found.textured_lights +=
                        usize::from(material.is_some_and(|m| m.emissive_texture.is_some()));
                }
            }
        }

        let mut in_use = vec![false; scene.materials.len()];
        for (mesh, _) in scene.meshes.iter().zip(&places).filter(|&(_, &n)| n > 0) {
            in_use[mesh.material as usize] = true;
        }
        for material in scene.materials.iter().zip(&in_use).filter_map(|(m, &used)| used.then_some(m)) {
            let specular = material.mirror || material.transmission > 0.0;
            let lobe =
                material.phong_exponent.is_some() || material.metallic > 0.0 || material.specular > 0.0;
            found.specular_materials += usize::from(specular);
            found.glossy_materials += usize::from(!material.mirror && material.transmission < 1.0 && lobe);
            found.masked_materials += usize::from(matches!(material.alpha_mode, AlphaMode::Mask(_)));
            found.blended_materials += usize::from(material.alpha_mode == AlphaMode::Blend);
        }
        found
    }

    /// Whether any light sends more to one side than to another: without, a light tree needs no cones.
    pub const fn needs_cones(&self) -> bool {
        self.spot_lights + self.triangle_lights + self.virtual_lights > 0
    }

    /// Whether any light has an area, so that points on lights have to be drawn.
    pub const fn has_area_lights(&self) -> bool {
        self.triangle_lights > 0
    }

    /// Whether everything that is lit is Lambertian.
    pub const fn is_diffuse(&self) -> bool {
        self.glossy_materials + self.specular_materials == 0
    }
}

/// One line per kind of thing that is there.
impl fmt::Display for Requirements {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = [
            (self.triangles, "triangles after instancing"),
            (self.shared_meshes, "meshes in more than one place"),
            (self.point_lights, "point lights"),
            (self.spot_lights, "spot lights"),
            (self.triangle_lights, "emissive triangles"),
            (self.textured_lights, "of them textured"),
            (self.virtual_lights, "virtual point lights"),
            (self.distant_lights, "lights without a place, outside every light tree"),
            (self.glossy_materials, "glossy materials"),
            (self.specular_materials, "mirrors and glass"),
            (self.masked_materials, "materials with holes"),
            (self.blended_materials, "materials that cover partly"),
        ];
        for (count, what) in lines.iter().filter(|(count, _)| *count > 0) {
            writeln!(f, "{count:>10} {what}")?;
        }
        write!(f, "{:>10} light trees need {}cones", "", if self.needs_cones() { "" } else { "no " })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;

    #[test]
    fn built_in_scenes() {
        let of = |name: &str| {
            let scene = builtin(name).unwrap();
            Requirements::new(&scene, &scene.lights)
        };
        let hall = of("hall:100");
        assert_eq!((hall.point_lights, hall.needs_cones(), hall.has_area_lights()), (100, false, false));
        let cornell = of("cornell");
        assert_eq!((cornell.triangle_lights, cornell.needs_cones(), cornell.is_diffuse()), (2, true, true));
        let glossy = of("glossy:10");
        assert!(glossy.glossy_materials > 0 && glossy.specular_materials > 0 && !glossy.is_diffuse());
        assert!(of("wall:100").virtual_lights > 0);
        assert!(hall.to_string().contains("100 point lights") && !hall.to_string().contains("spot"));
    }
}
