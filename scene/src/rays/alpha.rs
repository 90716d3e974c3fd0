//! Holes in masked and blended triangles: what a texture says at the place of a hit.

use glam::Vec2;

use super::triangle::HitFilter;
use crate::{AlphaMode, Material, Mesh, Scene, Texture};

/// The masks of a scene, copied out of it: texture coordinates of masked meshes and the textures that they
/// look up.
#[derive(Clone, Debug, Default)]
pub(super) struct AlphaMasks {
    /// By mesh; `None`: no holes.
    meshes: Vec<Option<MeshMask>>,
    /// By texture; only those needed.
    textures: Vec<Option<Texture>>,
    /// Whether there are holes in the nearest hit's view.
    any_for_nearest: bool,
}

/// What is asked of the surfaces: holes of alpha masks are there always, those of thinly blended surfaces
/// only for occlusion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Nearest,
    Occlusion,
}

/// A mesh with holes: a hit counts where `alpha` times the texture's is not below the cut-off.
#[derive(Clone, Debug)]
struct MeshMask {
    /// Texture coordinates of each triangle's corners, with the slot's transform; empty without a texture.
    uvs: Vec<[Vec2; 3]>,
    alpha: f32,
    cutoff: f32,
    texture: Option<usize>,
    /// A blended surface, which the nearest hit may well be on.
    occlusion_only: bool,
}

impl AlphaMasks {
    pub(super) fn new(scene: &Scene) -> Self {
        let mut lowest = vec![None; scene.textures.len()];
        let mut lowest_alpha =
            |texture: usize| *lowest[texture].get_or_insert_with(|| scene.textures[texture].lowest_alpha());
        let meshes: Vec<_> =
            scene.meshes.iter().map(|mesh| MeshMask::new(mesh, scene, &mut lowest_alpha)).collect();
        let any_for_nearest = meshes.iter().flatten().any(|mask| !mask.occlusion_only);
        let mut textures = vec![None; scene.textures.len()];
        for texture in meshes.iter().flatten().filter_map(|mask| mask.texture) {
            textures[texture].get_or_insert_with(|| scene.textures[texture].clone());
        }
        if meshes.iter().any(Option::is_some) {
            Self { meshes, textures, any_for_nearest }
        } else {
            Self::default()
        }
    }

    /// Whether there are holes for those who ask this.
    pub(super) fn any(&self, asked: Asked) -> bool {
        match asked {
            Asked::Nearest => self.any_for_nearest,
            Asked::Occlusion => !self.meshes.is_empty(),
        }
    }

    /// Whether this mesh has holes for those who ask this.
    pub(super) fn is_masked(&self, mesh: u32, asked: Asked) -> bool {
        let mask = self.meshes.get(mesh as usize).and_then(Option::as_ref);
        mask.is_some_and(|mask| !mask.occlusion_only || asked == Asked::Occlusion)
    }

    /// Whether a hit on this place of a mesh is none in a hole.
    pub(super) fn is_solid(&self, mesh: u32, triangle: u32, u: f32, v: f32, asked: Asked) -> bool {
        let Some(Some(mask)) = self.meshes.get(mesh as usize) else { return true };
        if mask.occlusion_only && asked == Asked::Nearest {
            return true;
        }
        let texture = mask.texture.and_then(|t| self.textures[t].as_ref());
        let texel = match (texture, mask.uvs.get(triangle as usize)) {
            (Some(texture), Some([a, b, c])) => texture.sample((1.0 - u - v) * *a + u * *b + v * *c).w,
            _ => 1.0,
        };
        mask.alpha * texel >= mask.cutoff
    }

    /// Memory held, bytes.
    pub(super) fn bytes(&self) -> usize {
        let uvs = self.meshes.iter().flatten().map(|m| m.uvs.capacity() * size_of::<[Vec2; 3]>());
        let texels = self.textures.iter().flatten().map(|t| t.texels.capacity() * size_of::<[u8; 4]>());
        uvs.sum::<usize>() + texels.sum::<usize>()
    }
}

impl MeshMask {
    /// `None` where the material has no holes. `lowest_alpha` of a texture, in [0, 1].
    fn new(mesh: &Mesh, scene: &Scene, lowest_alpha: &mut impl FnMut(usize) -> f32) -> Option<Self> {
        let material: &Material = scene.materials.get(mesh.material as usize)?;
        let (cutoff, occlusion_only) = match material.alpha_mode {
            AlphaMode::Mask(cutoff) => (cutoff, false),
            _ => (material.shadow_cutoff()?, true),
        };
        let alpha = material.alpha;
        let slot = material.base_color_texture.filter(|slot| (slot.texture as usize) < scene.textures.len());
        let lowest = slot.map_or(1.0, |slot| lowest_alpha(slot.texture as usize));
        if alpha * lowest >= cutoff {
            return None;
        }
        let Some(slot) = slot.filter(|_| alpha >= cutoff) else {
            // A texture can only make it less: all is a hole.
            return Some(Self { uvs: Vec::new(), alpha, cutoff, texture: None, occlusion_only });
        };
        let set = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
        let corner =
            |i: u32| slot.transform.transform_point2(set.get(i as usize).copied().unwrap_or(Vec2::ZERO));
        let uvs = mesh.triangles.iter().map(|t| t.map(corner)).collect();
        Some(Self { uvs, alpha, cutoff, texture: Some(slot.texture as usize), occlusion_only })
    }
}

/// Holes of one mesh, whose triangles are the primitives.
pub(super) struct MeshHoles<'a> {
    pub(super) masks: &'a AlphaMasks,
    pub(super) mesh: u32,
    pub(super) asked: Asked,
}

impl HitFilter for MeshHoles<'_> {
    fn accepts(&self, triangle: u32, u: f32, v: f32) -> bool {
        self.masks.is_solid(self.mesh, triangle, u, v, self.asked)
    }
}
