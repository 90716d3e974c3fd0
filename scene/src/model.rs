//! A scene as plain data: what an importer or a generator fills and everything else reads.

use glam::{Affine3A, Vec2, Vec3};

use crate::{Camera, DistantLight, Light, Material, Texture};

/// A scene: geometry, materials, lights, cameras. Indices are valid and every number finite: importers and
/// generators see to it.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// File name or built-in name with its count.
    pub name: String,
    /// Geometry in object space.
    pub meshes: Vec<Mesh>,
    /// Where meshes stand; a mesh used many times is stored once.
    pub instances: Vec<Instance>,
    /// Surface descriptions, by [`Mesh::material`].
    pub materials: Vec<Material>,
    /// Images, by [`TextureSlot::texture`](crate::TextureSlot::texture).
    pub textures: Vec<Texture>,
    /// Lights that have a place; emissive triangles are among them, one by one, in world space.
    pub lights: Vec<Light>,
    /// Lights without a place: outside every tree.
    pub distant: Vec<DistantLight>,
    /// Cameras in file order; may be empty.
    pub cameras: Vec<Camera>,
    /// What was decided or dropped on the way, a sentence each, for people.
    pub notes: Vec<String>,
}

/// Triangles of one material in object space.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals, unit; empty: flat shading.
    pub normals: Vec<Vec3>,
    /// First texture coordinates (`TEXCOORD_0`); empty: all zero.
    pub uvs: Vec<Vec2>,
    /// Second texture coordinates (`TEXCOORD_1`); empty: none.
    pub uvs1: Vec<Vec2>,
    /// Vertex indices, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// One mesh in one place.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Object to world; invertible.
    pub to_world: Affine3A,
}

impl Scene {
    /// Triangles after instancing.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh as usize].triangles.len()).sum()
    }

    /// World-space box of all instances as (min, max); `None` without geometry.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let points = self.instances.iter().flat_map(|i| {
            self.meshes[i.mesh as usize].positions.iter().map(|&p| i.to_world.transform_point3(p))
        });
        points.fold(None, |b, p| match b {
            None => Some((p, p)),
            Some((min, max)) => Some((min.min(p), max.max(p))),
        })
    }
}
