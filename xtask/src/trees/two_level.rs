//! `--set builder=two-level`: a tree for the lights of each mesh, shared by its instances, and one over the
//! instances.

use std::collections::HashMap;

use glam::Affine3A;
use lighttree::{BuildParams, Emitter, LightBounds, LightTree, TriangleLight};
use scene::{Light, Scene};
use stochastic::{Keeps, LightInstance, LightMesh, TwoLevelTree};

/// Trees of meshes that one frame leaves to the next.
#[derive(Default)]
pub(crate) struct KeptMeshes {
    /// In the order in which they were built: what the lights were, and the tree over them.
    meshes: Vec<(Vec<LightBounds>, Keeps, LightMesh<LightTree>)>,
    /// Trees built for the last frame.
    built: usize,
}

impl KeptMeshes {
    /// How many trees of meshes were built for the last frame; the others were kept from the one before.
    #[cfg(test)]
    pub(crate) const fn built(&self) -> usize {
        self.built
    }

    /// The tree of mesh number `index`: that of the last frame if its lights are the same, otherwise a new
    /// one.
    fn mesh(
        &mut self,
        index: usize,
        bounds: Vec<LightBounds>,
        keeps: Keeps,
    ) -> Result<LightMesh<LightTree>, String> {
        if let Some((last, kept_as, mesh)) = self.meshes.get(index)
            && *kept_as == keeps
            && *last == bounds
        {
            return Ok(mesh.clone());
        }
        self.built += 1;
        let tree = LightTree::build(&bounds, &BuildParams::saoh()).map_err(|error| error.to_string())?;
        let mesh = LightMesh::new(tree, bounds.len() as u32).keeping(keeps);
        self.meshes.truncate(index);
        self.meshes.push((bounds, keeps, mesh.clone()));
        Ok(mesh)
    }
}

/// The lights of each mesh, and where it is. Lights of all instances, one after the other, are those of the
/// scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Levels {
    /// Bounds in the mesh's space, and what instances keep of them.
    pub(crate) meshes: Vec<(Vec<LightBounds>, Keeps)>,
    pub(crate) instances: Vec<LightInstance>,
}

impl Levels {
    /// Of `lights`, with the same ids: each run of lights on one instance is one of its mesh, and whatever
    /// else lies between them is taken as it is.
    pub(crate) fn of(lights: &[Light], scene: &Scene) -> Self {
        let mut levels = Self::default();
        // By mesh of the scene and triangles of it, since an instance may have lost some that have no area.
        let mut known: HashMap<(u32, Vec<u32>), u32> = HashMap::new();
        for run in lights.chunk_by(|a, b| instance_of(a) == instance_of(b)) {
            let next = levels.meshes.len() as u32;
            let Some(instance) = instance_of(&run[0]) else {
                levels.instances.push(LightInstance { mesh: next, to_world: Affine3A::IDENTITY });
                levels.meshes.push((run.iter().map(Emitter::bounds).collect(), Keeps::Intensity));
                continue;
            };
            let instance = scene.instances[instance as usize];
            let triangles: Vec<u32> = run.iter().filter_map(triangle_of).collect();
            let mesh = *known.entry((instance.mesh, triangles)).or_insert(next);
            if mesh == next {
                let bounds = run.iter().map(|light| in_mesh(light, scene)).collect();
                levels.meshes.push((bounds, Keeps::Radiance));
            }
            levels.instances.push(LightInstance { mesh, to_world: instance.to_world });
        }
        levels
    }
}

/// The tree over `lights`, with the same ids. Meshes whose lights are what they were in the last frame keep
/// their trees.
///
/// # Errors
/// A sentence about the light or the instance that cannot be used.
pub(super) fn build(
    lights: &[Light],
    scene: &Scene,
    kept: &mut KeptMeshes,
) -> Result<TwoLevelTree<LightTree>, String> {
    kept.built = 0;
    let Levels { meshes, instances } = Levels::of(lights, scene);
    let tree = |(index, (bounds, keeps))| kept.mesh(index, bounds, keeps);
    let trees = meshes.into_iter().enumerate().map(tree).collect::<Result<Vec<_>, _>>()?;
    kept.meshes.truncate(trees.len());
    TwoLevelTree::build(trees, &instances, &BuildParams::saoh()).map_err(|error| error.to_string())
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

    /// Every light is where its id says, within the bounds of every node above it; the same mesh is kept
    /// once.
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
        let tree = build(&scene.lights, &scene, &mut KeptMeshes::default()).unwrap();
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

    /// Bodies that only move keep their trees; one whose lights change gets a new one, and a frame with other
    /// trees than kept is what it is from scratch.
    #[test]
    fn unmoved_lights_of_a_mesh_keep_their_tree() {
        let mut scene = builtin("cornell-lights:300").unwrap();
        let mut kept = KeptMeshes::default();
        let mut built = Vec::new();
        for frame in 0..3 {
            scene.go_to_frame(frame).unwrap();
            let tree = build(&scene.lights, &scene, &mut kept).unwrap();
            built.push(kept.built());
            let fresh = build(&scene.lights, &scene, &mut KeptMeshes::default()).unwrap();
            for node in [tree.root().unwrap(), NodeId(tree.children(tree.root().unwrap()).start)] {
                assert_eq!(tree.bounds(node), fresh.bounds(node), "frame {frame}");
            }
        }
        assert_eq!(built, [12, 0, 0]);
        let Light::Triangle { radiance, .. } = &mut scene.lights[299] else { unreachable!() };
        *radiance *= 2.0;
        build(&scene.lights, &scene, &mut kept).unwrap();
        assert_eq!(kept.built(), 1);
    }
}
