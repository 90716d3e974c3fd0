//! A tree per mesh and a tree over instances: for scenes that would be too large with every instance written
//! out.
//!
//! A ray is taken into the mesh's space in f64 with its parameter unchanged, so any invertible affine map
//! will do, mirrored or sheared, and distances of different instances compare. Answers are those of the
//! flattened scene up to rounding.

use glam::{Affine3A, DAffine3, DVec3, Vec3, Vec3A};
use lighttree::{Ray, RayHit, Segment};
use obvhs::aabb::Aabb;

use super::alpha::{AlphaMasks, Asked, MeshHoles};
use super::binary::Binary;
use super::build::WideBvh;
use super::collapse::Plan;
use super::error::RaysError;
use super::group::GROUP;
use super::lanes::pair::{array, le, load, max, min, slab, splat};
use super::node::{LANES, Link, Node, STACK, TOP, next_bit};
use super::primitives::Primitives;
use super::ray::{Scale, Scratch, TopGroup, Traced};
use super::triangle::AcceptAll;
use crate::Scene;

/// Trees of meshes, and a tree over their instances.
#[derive(Clone, Debug)]
pub(super) struct TwoLevel {
    nodes: Vec<Node>,
    scale: Scale,
    /// By mesh; `None`: without instances.
    meshes: Vec<Option<WideBvh>>,
    /// World to mesh, by instance.
    to_mesh: Vec<DAffine3>,
}

impl TwoLevel {
    /// # Errors
    /// Where a vertex isn't finite or a transform can't be inverted.
    pub(super) fn build(scene: &Scene, alpha: &AlphaMasks) -> Result<Self, RaysError> {
        let mut meshes = vec![None; scene.meshes.len()];
        let (mut to_mesh, mut boxes, mut largest) = (Vec::new(), Vec::new(), 0.0f32);
        for (i, instance) in (0u32..).zip(&scene.instances) {
            let inverse = inverse(exact(instance.to_world)).ok_or(RaysError::Singular { instance: i })?;
            let mesh = &scene.meshes[instance.mesh as usize];
            let tree = &mut meshes[instance.mesh as usize];
            if tree.is_none() {
                let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
                let triangles: Vec<[Vec3; 3]> = mesh.triangles.iter().map(corners).collect();
                let masked = alpha.is_masked(instance.mesh, Asked::Occlusion);
                *tree = Some(WideBvh::build_masked(&triangles, |_| masked).map_err(|error| match error {
                    RaysError::NonFinite { triangle } => RaysError::NonFiniteVertex { instance: i, triangle },
                    other => other,
                })?);
            }
            let bounds = world_box(&mesh.positions, exact(instance.to_world));
            if !(bounds.min.is_finite() && bounds.max.is_finite()) {
                if mesh.triangles.is_empty() {
                    to_mesh.push(inverse);
                    boxes.push(Aabb { min: Vec3A::ZERO, max: Vec3A::ZERO });
                    continue;
                }
                return Err(RaysError::NonFiniteVertex { instance: i, triangle: 0 });
            }
            largest = largest.max(bounds.min.abs().max(bounds.max.abs()).max_element());
            to_mesh.push(inverse);
            boxes.push(bounds);
        }
        let scale = Scale::of(largest);
        for b in &mut boxes {
            *b = Aabb { min: b.min * scale.factor, max: b.max * scale.factor };
        }
        let tree = Binary::build(&boxes);
        let emit = |tree: &Binary| Plan::new(tree, 1).emit(tree, |one| Link::leaf(one[0] as usize, 1, false));
        let (mut nodes, mut stack) = emit(&tree);
        if stack > STACK {
            (nodes, stack) = emit(&tree.halved(&boxes));
            assert!(stack <= STACK, "a balanced tree needs {stack} stack entries, more than can be");
        }
        Ok(Self { nodes, scale, meshes, to_mesh })
    }

    pub(super) fn closest(
        &self,
        ray: &Ray,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) -> Option<RayHit> {
        let (traced, unit) = Traced::ray(ray, &self.scale)?;
        let mut best: Option<RayHit> = None;
        self.walk(&traced, scratch, |instance, scratch| {
            let limit = best.map_or(ray.t_max, |hit| hit.t.next_up());
            let local = self.ray_in_mesh(instance, ray, limit);
            if let Some(mut hit) = self.closest_in(instance, &local, primitives, alpha, scratch) {
                hit.primitive += primitives.first(instance);
                if best.is_none_or(|best| (hit.t, hit.primitive) < (best.t, best.primitive)) {
                    best = Some(hit);
                }
            }
            best.map_or(traced.t_max, |hit| unit.tree(hit.t))
        });
        best
    }

    pub(super) fn occluded(
        &self,
        segment: &Segment,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) -> Option<u32> {
        let traced = Traced::segment(segment, &self.scale)?;
        let mut blocker = None;
        self.walk(&traced, scratch, |instance, scratch| {
            if self.occluded_by(instance, segment, primitives, alpha, scratch) {
                blocker = Some(instance);
                return 0.0;
            }
            traced.t_max
        });
        blocker
    }

    /// [`occluded`](Self::occluded) of the segments from `from` to each target, up to 64 at once: a node of
    /// the tree over instances is visited once for all that meet it, and so is each mesh.
    pub(super) fn occluded_from(
        &self,
        from: Vec3,
        targets: &[Vec3],
        occluded: &mut [bool],
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) {
        // Meshes use the rest of the scratch.
        let mut group = core::mem::take(&mut scratch.top_group);
        for (targets, occluded) in targets.chunks(GROUP).zip(occluded.chunks_mut(GROUP)) {
            group.rays.clear();
            group.index.clear();
            occluded.fill(false);
            for (i, &to) in (0u32..).zip(targets) {
                if let Some(ray) = Traced::segment(&Segment { from, to }, &self.scale) {
                    group.rays.push(ray);
                    group.index.push(i);
                }
            }
            if !group.rays.is_empty() {
                self.blocked_of_group(from, targets, occluded, &mut group, primitives, alpha, scratch);
            }
        }
        scratch.top_group = group;
    }

    /// Marks those rays of `group` that any instance stops. There is at least one.
    #[expect(clippy::too_many_arguments, reason = "the body of one loop")]
    fn blocked_of_group(
        &self,
        from: Vec3,
        targets: &[Vec3],
        occluded: &mut [bool],
        group: &mut TopGroup,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) {
        let mut open = u64::MAX >> (GROUP - group.rays.len());
        group.stack.clear();
        group.stack.push((Link::ROOT.0, open));
        while let Some((link, mask)) = group.stack.pop() {
            let active = mask & open;
            if active == 0 {
                continue;
            }
            let link = Link(link);
            if link.is_leaf() {
                open &= !self.blocked_by(
                    link.packets().0 as u32,
                    from,
                    targets,
                    active,
                    group,
                    primitives,
                    alpha,
                    scratch,
                );
                continue;
            }
            let node = &self.nodes[link.0 as usize];
            let mut masks = [0u64; LANES];
            let mut todo = active;
            while todo != 0 {
                let ray = todo.trailing_zeros();
                todo &= todo - 1;
                let traced = &group.rays[ray as usize];
                let (_, mut hits) = boxes(node, traced, traced.t_max);
                while hits != 0 {
                    masks[next_bit(&mut hits)] |= 1 << ray;
                }
            }
            let met = masks.iter().zip(&node.child).filter(|(mask, _)| **mask != 0);
            group.stack.extend(met.map(|(&mask, &child)| (child, mask)));
        }
        for (ray, &target) in group.index.iter().enumerate() {
            occluded[target as usize] = open >> ray & 1 == 0;
        }
    }

    /// Which of the `active` rays an instance stops, as a mask.
    #[expect(clippy::too_many_arguments, reason = "the body of one loop")]
    fn blocked_by(
        &self,
        instance: u32,
        from: Vec3,
        targets: &[Vec3],
        active: u64,
        group: &mut TopGroup,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) -> u64 {
        let mesh = primitives.mesh(instance);
        let Some(tree) = &self.meshes[mesh as usize] else { return 0 };
        let TopGroup { index, which, targets: local, blocked, .. } = group;
        which.clear();
        local.clear();
        let mut todo = active;
        while todo != 0 {
            let ray = todo.trailing_zeros();
            todo &= todo - 1;
            which.push(ray);
            local.push(self.point_in_mesh(instance, targets[index[ray as usize] as usize]));
        }
        blocked.clear();
        blocked.resize(local.len(), false);
        let (from, asked) = (self.point_in_mesh(instance, from), Asked::Occlusion);
        if alpha.is_masked(mesh, asked) {
            tree.occluded_from(from, local, blocked, &MeshHoles { masks: alpha, mesh, asked }, scratch);
        } else {
            tree.occluded_from(from, local, blocked, &AcceptAll, scratch);
        }
        which.iter().zip(&*blocked).fold(0, |mask, (&ray, &blocked)| mask | u64::from(blocked) << ray)
    }

    /// Whether one instance stops the segment; an instance that isn't there stops nothing.
    pub(super) fn occluded_by(
        &self,
        instance: u32,
        segment: &Segment,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) -> bool {
        if instance as usize >= self.to_mesh.len() {
            return false;
        }
        let place = |p: Vec3| self.point_in_mesh(instance, p);
        let local = Segment { from: place(segment.from), to: place(segment.to) };
        let mesh = primitives.mesh(instance);
        let Some(tree) = &self.meshes[mesh as usize] else { return false };
        let asked = Asked::Occlusion;
        if alpha.is_masked(mesh, asked) {
            tree.occluded(&local, &MeshHoles { masks: alpha, mesh, asked }, scratch)
        } else {
            tree.occluded(&local, &AcceptAll, scratch)
        }
    }

    /// Memory held, bytes.
    pub(super) fn bytes(&self) -> usize {
        let meshes = self.meshes.iter().flatten().map(WideBvh::bytes).sum::<usize>();
        meshes + self.nodes.capacity() * size_of::<Node>() + self.to_mesh.capacity() * size_of::<DAffine3>()
    }

    /// Trees of meshes that have instances.
    pub(super) fn trees(&self) -> impl Iterator<Item = &WideBvh> {
        self.meshes.iter().flatten()
    }

    /// For tests and benches.
    pub(super) fn set_path(&mut self, path: super::dispatch::Path) {
        for tree in self.meshes.iter_mut().flatten() {
            tree.set_path(path);
        }
    }

    fn point_in_mesh(&self, instance: u32, point: Vec3) -> Vec3 {
        self.to_mesh[instance as usize].transform_point3(point.as_dvec3()).as_vec3()
    }

    fn ray_in_mesh(&self, instance: u32, ray: &Ray, t_max: f32) -> Ray {
        let to_mesh = &self.to_mesh[instance as usize];
        Ray {
            origin: to_mesh.transform_point3(ray.origin.as_dvec3()).as_vec3(),
            direction: to_mesh.transform_vector3(ray.direction.as_dvec3()).as_vec3(),
            t_max,
        }
    }

    fn closest_in(
        &self,
        instance: u32,
        local: &Ray,
        primitives: &Primitives,
        alpha: &AlphaMasks,
        scratch: &mut Scratch,
    ) -> Option<RayHit> {
        let mesh = primitives.mesh(instance);
        let tree = self.meshes[mesh as usize].as_ref()?;
        let asked = Asked::Nearest;
        if alpha.is_masked(mesh, asked) {
            tree.closest(local, &MeshHoles { masks: alpha, mesh, asked }, scratch)
        } else {
            tree.closest(local, &AcceptAll, scratch)
        }
    }

    /// Visits the instances whose boxes the ray meets, nearest first. `visit` says where the ray now ends, in
    /// the tree's own unit; at 0 the walk is over.
    fn walk(&self, ray: &Traced, scratch: &mut Scratch, mut visit: impl FnMut(u32, &mut Scratch) -> f32) {
        let (mut link, mut sp, mut t_max) = (Link::ROOT, 0usize, ray.t_max);
        loop {
            if link.is_leaf() {
                t_max = visit(link.packets().0 as u32, scratch);
                if t_max <= 0.0 {
                    return;
                }
            } else {
                let node = &self.nodes[link.0 as usize];
                let (t, mut hits) = boxes(node, ray, t_max);
                let bottom = sp;
                while hits != 0 {
                    let i = next_bit(&mut hits);
                    let mut j = sp;
                    sp += 1;
                    while j > bottom && scratch.top[(j - 1) & TOP].1 < t[i] {
                        scratch.top[j & TOP] = scratch.top[(j - 1) & TOP];
                        j -= 1;
                    }
                    scratch.top[j & TOP] = (node.child[i], t[i]);
                }
            }
            loop {
                if sp == 0 {
                    return;
                }
                sp -= 1;
                let (next, t) = scratch.top[sp & TOP];
                if t <= t_max {
                    link = Link(next);
                    break;
                }
            }
        }
    }
}

/// Entry distance of each child box, and the children that the ray may meet before `t_max`.
fn boxes(node: &Node, ray: &Traced, t_max: f32) -> ([f32; LANES], u32) {
    let (mut enter, mut leave) = (splat(0.0), splat(t_max));
    for k in 0..3 {
        let (near, far) =
            (load(&node.planes[k][ray.side[k] & 1]), load(&node.planes[k][ray.side[k] & 1 ^ 1]));
        enter = max(slab(near, ray.enter[k], ray.inverse[k], ray.enter_scaled[k]), enter);
        leave = min(slab(far, ray.leave[k], ray.inverse[k], ray.leave_scaled[k]), leave);
    }
    (array(enter), le(enter, leave))
}

/// The same map in f64.
pub(super) fn exact(map: Affine3A) -> DAffine3 {
    DAffine3 { matrix3: map.matrix3.as_dmat3(), translation: map.translation.as_dvec3() }
}

/// The inverse of an affine map, if it has a finite one.
pub(super) fn inverse(map: DAffine3) -> Option<DAffine3> {
    let det = map.matrix3.determinant();
    let inverse = map.inverse();
    (det != 0.0 && inverse.is_finite()).then_some(inverse)
}

/// World-space box of transformed points, padded by the rounding of coordinates on both sides of the map: the
/// mesh may lie far from its own origin and be brought back by the map.
pub(super) fn world_box(points: &[Vec3], map: DAffine3) -> Aabb {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut largest = DVec3::ZERO;
    for p in points {
        let p = p.as_dvec3();
        let at = map.transform_point3(p);
        (min, max) = (min.min(at), max.max(at));
        largest = largest.max(p.abs());
    }
    let size = map.matrix3.abs() * largest + map.translation.abs();
    let pad = size * (16.0 * f64::from(f32::EPSILON));
    Aabb { min: (min - pad).as_vec3a(), max: (max + pad).as_vec3a() }
}
