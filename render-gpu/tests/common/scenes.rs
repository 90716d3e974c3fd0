//! Scenes of the reference host on the device.

use bytemuck::cast_slice;
use glam::Vec3;
use render_gpu::Gpu;
use render_gpu::rays::{BinaryTree, Geometry, InstanceGeometry, MeshGeometry, RayGeometry};
use scene::{FlatRays, FlatTree, RaysParams, Scene};

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
    let meshes: Vec<_> = flat
        .meshes
        .iter()
        .map(|mesh| MeshGeometry { triangles: &mesh.triangles, tree: tree(&mesh.tree) })
        .collect();
    let instances: Vec<_> = flat
        .instances
        .iter()
        .map(|i| InstanceGeometry { mesh: i.mesh, first_primitive: i.first_primitive, to_world: i.to_world })
        .collect();
    let instances = (!flat.top.nodes.is_empty()).then(|| (&instances[..], tree(&flat.top)));
    RayGeometry::new(gpu, &Geometry { meshes: &meshes, instances }).unwrap()
}

fn tree(tree: &FlatTree) -> BinaryTree<'_> {
    BinaryTree { nodes: cast_slice(&tree.nodes), order: &tree.order }
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
