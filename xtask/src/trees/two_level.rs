//! `--set builder=two-level`: a tree for the lights of each mesh, shared by its instances, and one over the instances.

use std::collections::HashMap;

use glam::Affine3A;
use lighttree::{BuildParams, Emitter, LightBounds, LightTree, TriangleLight};
use scene::{Light, Scene};
use stochastic::{Keeps, LightInstance, LightMesh, TwoLevelTree};

/// The tree over `lights`, with the same ids: each run of lights on one instance is one of its mesh, and whatever else lies between them
/// is taken as it is.
///
/// # Errors
/// A sentence about the light or the instance that cannot be used.
pub(super) fn build(lights: &[Light], scene: &Scene) -> Result<TwoLevelTree<LightTree>, String> {
    let params = BuildParams::saoh();
    let mut meshes = Vec::new();
    let mut instances = Vec::new();
    // By mesh of the scene and triangles of it, since an instance may have lost some that have no area.
    let mut known: HashMap<(u32, Vec<u32>), u32> = HashMap::new();
    for run in lights.chunk_by(|a, b| instance_of(a) == instance_of(b)) {
        let tree = |bounds: &[LightBounds], keeps| {
            let tree = LightTree::build(bounds, &params).map_err(|error| error.to_string())?;
            Ok::<_, String>(LightMesh::new(tree, bounds.len() as u32).keeping(keeps))
        };
        let Some(instance) = instance_of(&run[0]) else {
            let bounds: Vec<_> = run.iter().map(Emitter::bounds).collect();
            instances.push(LightInstance { mesh: meshes.len() as u32, to_world: Affine3A::IDENTITY });
            meshes.push(tree(&bounds, Keeps::Intensity)?);
            continue;
        };
        let instance = scene.instances[instance as usize];
        let triangles: Vec<u32> = run.iter().filter_map(triangle_of).collect();
        let mesh = match known.get(&(instance.mesh, triangles.clone())) {
            Some(&mesh) => mesh,
            None => {
                let bounds: Vec<_> = run.iter().map(|light| in_mesh(light, scene)).collect();
                let mesh = meshes.len() as u32;
                meshes.push(tree(&bounds, Keeps::Radiance)?);
                known.insert((instance.mesh, triangles), mesh);
                mesh
            }
        };
        instances.push(LightInstance { mesh, to_world: instance.to_world });
    }
    TwoLevelTree::build(meshes, &instances, &params).map_err(|error| error.to_string())
}

/// The instance that a light is on, if it is on one.
fn instance_of(light: &Light) -> Option<u32> {
    match *light {
        Light::Triangle { instance, .. } => Some(instance),
        _ => None,
    }
}

fn triangle_of(light: &Light) -> Option<u32> {
    match *light {
        Light::Triangle { triangle, .. } => Some(triangle),
        _ => None,
    }
}

/// Bounds of a light in the space of its mesh; any other light's own.
fn in_mesh(light: &Light, scene: &Scene) -> LightBounds {
    let Light::Triangle { radiance, two_sided, instance, triangle, .. } = *light else {
        return light.bounds();
    };
    let mesh = &scene.meshes[scene.instances[instance as usize].mesh as usize];
    let corners = mesh.triangles[triangle as usize].map(|vertex| mesh.positions[vertex as usize]);
    TriangleLight { corners, radiance: radiance.max_element(), two_sided }.bounds()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use lighttree::{Hierarchy, ItemRanges, LightHierarchy, LightId, NodeId};
    use scene::{Instance, builtin};

    /// Every light is where its id says, within the bounds of every node above it; the same mesh is kept once.
    #[test]
    fn ids_are_those_of_the_scene() {
        let mut scene = builtin("cornell-lights:300").unwrap();
        // The last body a second time, mirrored, and a lamp without a mesh.
        let last = *scene.instances.last().unwrap();
        let mirrored = Affine3A::from_translation(Vec3::X) * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
        scene.instances.push(Instance { to_world: mirrored * last.to_world, ..last });
        scene.lights.clear();
        scene.add_emissive_triangles();
        scene.lights.push(Light::Point { position: Vec3::ONE, intensity: Vec3::ONE });
        let tree = build(&scene.lights, &scene).unwrap();
        assert_eq!(tree.light_count() as usize, scene.lights.len());
        assert_eq!((tree.meshes().len(), tree.instances()), (12 + 1, 13 + 1));
        for (id, light) in scene.lights.iter().enumerate() {
            let (slot, light) = (tree.slot_of(LightId(id as u32)).unwrap(), light.bounds());
            let mut node = tree.root();
            while let Some(at) = node {
                let bounds = tree.bounds(at);
                assert!(bounds.contains(&light, 1e-3), "light {id} sticks out of node {}", at.0);
                node = tree.children(at).map(NodeId).find(|&child| tree.items(child).contains(&slot));
            }
        }
    }
}
