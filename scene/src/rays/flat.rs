//! A scene's geometry as plain arrays: for whoever traces rays elsewhere, on a GPU as a rule.
//!
//! Binary trees in the layout of `obvhs`' small nodes, which are easy to make wide, to quantise and to
//! upload: what a device makes of them is its own business.

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec3, Vec3A};
use obvhs::aabb::Aabb;

use super::RaysParams;
use super::alpha::{AlphaMasks, Asked};
use super::binary::{Binary, NONE};
use super::error::RaysError;
use super::primitives::Primitives;
use super::surface::world_triangle;
use super::two_level::{exact, inverse, world_box};
use crate::Scene;

/// A node of a [`FlatTree`], 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FlatNode {
    /// Lowest corner of the box around all that is below.
    pub min: [f32; 3],
    /// Primitives of a leaf; 0: the node has two children.
    pub count: u32,
    /// Highest corner.
    pub max: [f32; 3],
    /// Of a leaf, its first entry in [`FlatTree::order`]; otherwise the first child, the second comes after
    /// it.
    pub first: u32,
}

/// A binary tree over boxes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlatTree {
    /// The root first, parents before children; empty without primitives.
    pub nodes: Vec<FlatNode>,
    /// Primitives in the order of the leaves.
    pub order: Vec<u32>,
}

/// Triangles and the tree over them.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatMesh {
    /// Corners, in the mesh's own space.
    pub triangles: Vec<[Vec3; 3]>,
    /// Over those that a ray can hit: two equal corners leave a triangle out.
    pub tree: FlatTree,
}

/// A mesh in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatInstance {
    /// Index into [`FlatRays::meshes`].
    pub mesh: u32,
    /// The primitive of its first triangle.
    pub first_primitive: u32,
    /// Mesh to world.
    pub to_world: Affine3A,
}

/// A scene's geometry in plain arrays, exactly what [`SceneRays`](crate::SceneRays) traces, but for the holes
/// of alpha masks.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatRays {
    /// One mesh with all triangles in world space, or one for each mesh of the scene, empty where that stands
    /// nowhere.
    pub meshes: Vec<FlatMesh>,
    /// One in place of all, or one for each instance of the scene.
    pub instances: Vec<FlatInstance>,
    /// Over the instances' boxes in world space; empty where one mesh holds everything.
    pub top: FlatTree,
    /// Meshes of the scene with holes that rays pass through: they are solid here.
    pub masked: usize,
}

impl FlatRays {
    /// Writes out a scene: in world space as far as `params` allow, with a tree per mesh beyond.
    ///
    /// # Errors
    /// As [`SceneRays::build_with`](crate::SceneRays::build_with).
    pub fn new(scene: &Scene, params: &RaysParams) -> Result<Self, RaysError> {
        let primitives = Primitives::new(scene, u64::from(u32::MAX))?;
        let alpha = AlphaMasks::new(scene);
        let masked = (0..scene.meshes.len()).filter(|&m| alpha.is_masked(m as u32, Asked::Occlusion)).count();
        if u64::from(primitives.count()) <= params.max_flattened {
            return Self::in_world_space(scene, &primitives, masked);
        }

        // As `SceneRays`, nothing is built of meshes that stand nowhere.
        let mut placed_by = vec![None; scene.meshes.len()];
        for (i, placed) in (0u32..).zip(&scene.instances) {
            placed_by[placed.mesh as usize].get_or_insert(i);
        }
        let mut meshes = Vec::with_capacity(scene.meshes.len());
        for (mesh, placed_by) in scene.meshes.iter().zip(placed_by) {
            let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
            let triangles = placed_by.map_or_else(Vec::new, |_| mesh.triangles.iter().map(corners).collect());
            meshes.push(FlatMesh::new(triangles).map_err(|error| match (error, placed_by) {
                (RaysError::NonFinite { triangle }, Some(instance)) => {
                    RaysError::NonFiniteVertex { instance, triangle }
                }
                (other, _) => other,
            })?);
        }
        let (mut instances, mut boxes) = (Vec::new(), Vec::new());
        for (i, placed) in (0u32..).zip(&scene.instances) {
            inverse(exact(placed.to_world)).ok_or(RaysError::Singular { instance: i })?;
            instances.push(FlatInstance {
                mesh: placed.mesh,
                first_primitive: primitives.first(i),
                to_world: placed.to_world,
            });
            let mesh = &scene.meshes[placed.mesh as usize];
            let bounds = world_box(&mesh.positions, exact(placed.to_world));
            if !(mesh.triangles.is_empty() || bounds.min.is_finite() && bounds.max.is_finite()) {
                return Err(RaysError::NonFiniteVertex { instance: i, triangle: 0 });
            }
            boxes.push(if mesh.triangles.is_empty() {
                Aabb { min: Vec3A::ZERO, max: Vec3A::ZERO }
            } else {
                bounds
            });
        }
        Ok(Self { meshes, instances, top: FlatTree::new(&boxes), masked })
    }

    fn in_world_space(scene: &Scene, primitives: &Primitives, masked: usize) -> Result<Self, RaysError> {
        let mut triangles = Vec::with_capacity(primitives.count() as usize);
        for instance in &scene.instances {
            let mesh = &scene.meshes[instance.mesh as usize];
            triangles.extend(mesh.triangles.iter().map(|&t| world_triangle(mesh, instance, t)));
        }
        let mesh = FlatMesh::new(triangles).map_err(|error| match error {
            RaysError::NonFinite { triangle } => {
                let (instance, triangle) = primitives.locate(triangle);
                RaysError::NonFiniteVertex { instance, triangle }
            }
            other => other,
        })?;
        let all = FlatInstance { mesh: 0, first_primitive: 0, to_world: Affine3A::IDENTITY };
        Ok(Self { meshes: vec![mesh], instances: vec![all], top: FlatTree::default(), masked })
    }

    /// Triangles in all meshes, each counted once however often it is placed.
    pub fn triangles(&self) -> usize {
        self.meshes.iter().map(|mesh| mesh.triangles.len()).sum()
    }
}

impl FlatMesh {
    /// A tree over triangles.
    ///
    /// # Errors
    /// [`RaysError::NonFinite`].
    pub fn new(triangles: Vec<[Vec3; 3]>) -> Result<Self, RaysError> {
        if let Some(i) = triangles.iter().position(|t| !t.iter().all(|v| v.is_finite())) {
            return Err(RaysError::NonFinite { triangle: i as u32 });
        }
        // As `WideBvh::build_masked` leaves them out.
        let kept: Vec<u32> = (0u32..)
            .zip(&triangles)
            .filter(|(_, [a, b, c])| a != b && b != c && c != a)
            .map(|(i, _)| i)
            .collect();
        let boxes: Vec<Aabb> = kept
            .iter()
            .map(|&i| {
                let [a, b, c] = triangles[i as usize].map(Vec3A::from);
                Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }
            })
            .collect();
        let mut tree = FlatTree::new(&boxes);
        tree.order.iter_mut().for_each(|at| *at = kept[*at as usize]);
        Ok(Self { triangles, tree })
    }
}

/// Levels of a tree from which on it is balanced instead: far above what scenes need.
const DEEP: usize = 96;

impl FlatTree {
    fn new(boxes: &[Aabb]) -> Self {
        let tree = Binary::build(boxes);
        let flat = Self::of(&tree);
        if flat.depth() > DEEP { Self::of(&tree.halved(boxes)) } else { flat }
    }

    /// The same tree, siblings beside one another.
    fn of(tree: &Binary) -> Self {
        let mut flat = Self { nodes: Vec::with_capacity(tree.nodes.len()), order: Vec::new() };
        if tree.nodes.is_empty() {
            return flat;
        }
        let blank = FlatNode::zeroed();
        flat.nodes.push(blank);
        let mut work = vec![(0u32, 0usize)];
        while let Some((from, to)) = work.pop() {
            let node = &tree.nodes[from as usize];
            let (count, first) = if node.primitive == NONE {
                let first = flat.nodes.len();
                flat.nodes.extend([blank, blank]);
                work.extend([(node.right, first + 1), (node.left, first)]);
                (0, first)
            } else {
                flat.order.push(node.primitive);
                (1, flat.order.len() - 1)
            };
            flat.nodes[to] = FlatNode { min: node.low, count, max: node.high, first: first as u32 };
        }
        flat
    }

    /// Levels below the root; 0 for a root alone or no tree.
    pub fn depth(&self) -> usize {
        let mut depth = vec![0usize; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            if node.count == 0 {
                depth[node.first as usize] = depth[i] + 1;
                depth[node.first as usize + 1] = depth[i] + 1;
            }
        }
        depth.into_iter().max().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_hold_what_is_below_and_leaves_hold_every_triangle_once() {
        let scene = crate::builtin("cornell").unwrap();
        let flat = FlatRays::new(&scene, &RaysParams::default()).unwrap();
        let mesh = &flat.meshes[0];
        let mut seen = vec![0; mesh.triangles.len()];
        mesh.tree.order.iter().for_each(|&i| seen[i as usize] += 1);
        assert!(seen.iter().all(|&n| n == 1));
        for node in &mesh.tree.nodes {
            let inside =
                |min: [f32; 3], max: [f32; 3]| (0..3).all(|k| node.min[k] <= min[k] && max[k] <= node.max[k]);
            if node.count == 0 {
                let children = &mesh.tree.nodes[node.first as usize..][..2];
                assert!(children.iter().all(|child| inside(child.min, child.max)));
            } else {
                let at = mesh.tree.order[node.first as usize] as usize;
                assert!(mesh.triangles[at].iter().all(|v| inside(v.to_array(), v.to_array())));
            }
        }
    }

    #[test]
    fn two_levels_are_written_out_where_asked_for() {
        let scene = crate::builtin("hall:100").unwrap();
        let flat = FlatRays::new(&scene, &RaysParams { max_flattened: 0 }).unwrap();
        assert_eq!(flat.instances.len(), scene.instances.len());
        assert_eq!(flat.top.order.len(), scene.instances.len());
        assert_eq!(flat.meshes.len(), scene.meshes.len());
    }

    /// A mesh that stands nowhere is in nobody's way, whatever it is.
    #[test]
    fn meshes_that_stand_nowhere_are_left_out() {
        let mut scene = crate::builtin("cornell").unwrap();
        let mut odd = scene.meshes[0].clone();
        odd.positions[0].x = f32::NAN;
        scene.meshes.push(odd);
        let two_levels = RaysParams { max_flattened: 0 };
        crate::SceneRays::build_with(&scene, &two_levels).unwrap();
        let flat = FlatRays::new(&scene, &two_levels).unwrap();
        assert!(flat.meshes.last().unwrap().triangles.is_empty());
        scene.instances[1].mesh = scene.meshes.len() as u32 - 1;
        let error = FlatRays::new(&scene, &two_levels).unwrap_err();
        assert!(matches!(error, RaysError::NonFiniteVertex { instance: 1, .. }), "{error}");
    }
}
