//! Scenes of the reference host on the device.

/// The program's own conversions, which are tested with it.
#[path = "../../../xtask/src/device/records.rs"]
pub mod records;

use glam::Vec3;
use render_gpu::Gpu;
use render_gpu::rays::RayGeometry;
use scene::{FlatRays, RaysParams, Scene};

/// A scene, its arrays, and these on the device.
pub struct Uploaded {
    pub scene: Scene,
    pub flat: FlatRays,
    pub geometry: RayGeometry,
}

/// A built-in scene.
pub fn uploaded(gpu: &Gpu, name: &str, params: &RaysParams) -> Uploaded {
    let scene = scene::builtin(name).unwrap();
    let flat = FlatRays::new(&scene, params).unwrap();
    let geometry = upload(gpu, &flat);
    Uploaded { scene, flat, geometry }
}

pub fn upload(gpu: &Gpu, flat: &FlatRays) -> RayGeometry {
    records::geometry(flat, |geometry| RayGeometry::new(gpu, geometry)).unwrap()
}

impl Uploaded {
    /// All triangles in the order of the primitives.
    pub fn world_triangles(&self) -> Vec<[Vec3; 3]> {
        let placed = self.flat.instances.iter().map(|i| {
            let mesh = &self.flat.meshes[i.mesh as usize];
            mesh.triangles.iter().map(|t| t.map(|v| i.to_world.transform_point3(v)))
        });
        placed.flatten().collect()
    }
}
