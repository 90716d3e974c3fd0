//! A scene as plain data: what an importer or a generator fills and everything else reads.

mod emission;
mod footprint;

use glam::{Affine3A, Vec2, Vec3};

pub use self::emission::EmissionSummary;

use lighttree::Emitter;

use crate::{Camera, DistantLight, Light, Material, Motion, Texture};

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
    /// What changes from frame to frame: nothing but in some built-in scenes.
    pub motion: Motion,
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

impl Instance {
    /// Whether the transform mirrors (its determinant is negative), which turns the winding of triangles
    /// round: seen from the front they are then clockwise in world space.
    pub fn is_mirrored(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }
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

    /// A camera that sees the whole scene, for scenes that bring none: it looks down at the bounds' centre
    /// from the side where +Z and +X are, from as far as the sphere around the bounds needs. Without geometry
    /// it takes the lights' bounds, without either the unit box.
    pub fn framing_camera(&self) -> Camera {
        const FOV: f32 = 0.9;
        let lights = || {
            let boxes = self.lights.iter().map(|light| light.bounds()).map(|b| (b.min, b.max));
            boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        };
        let (min, max) = self.bounds().or_else(lights).unwrap_or((Vec3::splat(-0.5), Vec3::splat(0.5)));
        // Halves first: the sum of two large coordinates may overflow.
        let centre = 0.5 * min + 0.5 * max;
        let radius = (0.5 * max - 0.5 * min).length();
        let radius = if radius > 0.0 { radius } else { 1.0 };
        let away = Vec3::new(0.55, 0.45, 1.0).normalize();
        let position = centre + away * (radius / (0.5 * FOV).sin());
        let mut camera = Camera::look_at("framing", position, centre, Vec3::Y, FOV);
        if camera.forward.is_nan() {
            camera = Camera::look_at("framing", away, Vec3::ZERO, Vec3::Y, FOV);
            camera.position = position;
        }
        camera
    }
}
