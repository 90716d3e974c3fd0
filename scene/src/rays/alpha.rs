//! Holes in masked triangles: what a texture says at the place of a hit.

use glam::Vec2;

use super::triangle::HitFilter;
use crate::{AlphaMode, Material, Mesh, Scene, Texture};

/// The masks of a scene, copied out of it: texture coordinates of masked meshes and the textures that they look up.
#[derive(Clone, Debug, Default)]
pub(super) struct AlphaMasks {
    /// By mesh; `None`: no holes.
    meshes: Vec<Option<MeshMask>>,
    /// By texture; only those needed.
    textures: Vec<Option<Texture>>,
}

/// A mesh with holes: a hit counts where `alpha` times the texture's is not below the cut-off.
#[derive(Clone, Debug)]
struct MeshMask {
    /// Texture coordinates of each triangle's corners, with the slot's transform; empty without a texture.
    uvs: Vec<[Vec2; 3]>,
    alpha: f32,
    cutoff: f32,
    texture: Option<usize>,
}

impl AlphaMasks {
    pub(super) fn new(scene: &Scene) -> Self {
        let meshes: Vec<_> = scene.meshes.iter().map(|mesh| MeshMask::new(mesh, scene)).collect();
        let mut textures = vec![None; scene.textures.len()];
        for texture in meshes.iter().flatten().filter_map(|mask| mask.texture) {
            textures[texture].get_or_insert_with(|| scene.textures[texture].clone());
        }
        if meshes.iter().any(Option::is_some) { Self { meshes, textures } } else { Self::default() }
    }

    /// Whether there are no holes at all.
    pub(super) fn is_empty(&self) -> bool {
        self.meshes.is_empty()
    }

    /// Whether hits on this mesh must be asked about.
    pub(super) fn is_masked(&self, mesh: u32) -> bool {
        self.meshes.get(mesh as usize).is_some_and(Option::is_some)
    }

    /// Whether a hit on this place of a mesh is none in a hole.
    pub(super) fn is_solid(&self, mesh: u32, triangle: u32, u: f32, v: f32) -> bool {
        let Some(Some(mask)) = self.meshes.get(mesh as usize) else { return true };
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
    /// `None` where the material has no holes.
    fn new(mesh: &Mesh, scene: &Scene) -> Option<Self> {
        let material: &Material = scene.materials.get(mesh.material as usize)?;
        let AlphaMode::Mask(cutoff) = material.alpha_mode else { return None };
        let slot = material.base_color_texture.filter(|slot| (slot.texture as usize) < scene.textures.len());
        let Some(slot) = slot else {
            // The same everywhere: all solid, or all a hole.
            let solid = material.alpha >= cutoff;
            return (!solid).then_some(Self {
                uvs: Vec::new(),
                alpha: material.alpha,
                cutoff,
                texture: None,
            });
        };
        let set = if slot.uv_set == 0 { &mesh.uvs } else { &mesh.uvs1 };
        let corner =
            |i: u32| slot.transform.transform_point2(set.get(i as usize).copied().unwrap_or(Vec2::ZERO));
        let uvs = mesh.triangles.iter().map(|t| t.map(corner)).collect();
        Some(Self { uvs, alpha: material.alpha, cutoff, texture: Some(slot.texture as usize) })
    }
}

/// Holes of one mesh, whose triangles are the primitives.
pub(super) struct MeshHoles<'a> {
    pub(super) masks: &'a AlphaMasks,
    pub(super) mesh: u32,
}

impl HitFilter for MeshHoles<'_> {
    fn accepts(&self, triangle: u32, u: f32, v: f32) -> bool {
        self.masks.is_solid(self.mesh, triangle, u, v)
    }
}
