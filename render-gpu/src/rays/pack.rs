//! From a host's binary trees to what is uploaded: 4-wide nodes with quantised boxes, triangles in the order
//! of the leaves.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::geometry::{BinaryTree, Geometry, GeometryError, InstanceGeometry, MeshGeometry};
use super::records::{LEAF, NO_CHILD, RayInstance, RayTree, RayTriangle, WideNode};

/// Links that `shaders/rays/bvh.wgsl` has room for while a traversal goes on.
const STACK: usize = 64;
/// The same in the tree over instances.
const TOP_STACK: usize = 48;
/// Most triangles of a leaf.
const MAX_LEAF: u32 = 4;
/// What a test of a node's child costs, in tests of a triangle.
const NODE_COST: f32 = 0.5;

/// All that a device needs of a host's geometry.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Packed {
    pub(crate) tree: RayTree,
    pub(crate) nodes: Vec<WideNode>,
    pub(crate) triangles: Vec<RayTriangle>,
    pub(crate) instances: Vec<RayInstance>,
}

/// A box in the tree's own scale.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bounds {
    min: Vec3,
    max: Vec3,
}

impl Bounds {
    const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    fn of(points: &[Vec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn half_area(&self) -> f32 {
        let Vec3 { x, y, z } = self.max - self.min;
        x * y + y * z + z * x
    }
}

/// A binary tree put in order: parents before children, boxes found anew.
struct Binary {
    nodes: Vec<Inner>,
    /// Primitives, leaf by leaf.
    order: Vec<u32>,
}

/// A subtree still to be made: a node of the host's, or a run of its order.
#[derive(Clone, Copy, Debug)]
enum Source {
    Node(usize),
    Run(usize, usize),
}

struct Inner {
    bounds: Bounds,
    /// Indices of both children; `None`: a leaf.
    children: Option<[u32; 2]>,
    /// Primitives below, a range of the order.
    first: u32,
    count: u32,
}

impl Packed {
    /// # Errors
    /// The first thing that is wrong.
    pub(crate) fn new(geometry: &Geometry<'_>) -> Result<Self, GeometryError> {
        let mut packed =
            Self { tree: RayTree::default_empty(), nodes: vec![], triangles: vec![], instances: vec![] };
        let Some((instances, top)) = geometry.instances else {
            let [mesh] = geometry.meshes else {
                return Err(GeometryError::MeshCount { count: geometry.meshes.len() });
            };
            let placed = packed.mesh(0, mesh)?;
            let (scale, scale_exponent) = (power_of_two(placed.exponent), placed.exponent);
            packed.tree =
                RayTree { scale, scale_exponent, reach: placed.reach, root: placed.root, ..packed.tree };
            packed.check()?;
            return Ok(packed);
        };
        let meshes: Vec<_> = geometry
            .meshes
            .iter()
            .enumerate()
            .map(|(i, mesh)| packed.mesh(i, mesh))
            .collect::<Result<_, _>>()?;
        packed.instances(instances, &meshes, top)?;
        packed.check()?;
        Ok(packed)
    }

    /// Appends the tree and the triangles of a mesh.
    fn mesh(&mut self, index: usize, mesh: &MeshGeometry<'_>) -> Result<PackedMesh, GeometryError> {
        let corner_is_bad = |t: &[Vec3; 3]| !t.iter().all(|v| v.is_finite());
        if let Some(triangle) = mesh.triangles.iter().position(corner_is_bad) {
            return Err(GeometryError::NonFinite { mesh: index, triangle });
        }
        let largest = mesh.triangles.iter().flatten().fold(0.0f32, |m, v| m.max(v.abs().max_element()));
        let exponent = scale_exponent(largest);
        let scaled = |i: u32| mesh.triangles[i as usize].map(|v| v * power_of_two(exponent));
        let tree = Binary::new(
            Some(index),
            &mesh.tree,
            mesh.triangles.len(),
            |i| Bounds::of(&scaled(i)),
            STACK,
            MAX_LEAF,
        )?;
        let first = self.triangles.len();
        self.triangles.extend(tree.order.iter().map(|&i| {
            let [a, b, c] = scaled(i).map(|v| v.to_array());
            RayTriangle { a, primitive: i, b, spare0: 0, c, spare1: 0 }
        }));
        let root = tree.emit(&mut self.nodes, first as u32, MAX_LEAF);
        let bounds = tree.nodes.first().map_or(Bounds { min: Vec3::ZERO, max: Vec3::ZERO }, |n| n.bounds);
        Ok(PackedMesh { root, exponent, reach: largest * power_of_two(exponent), bounds })
    }

    /// Fills in the instances and the tree over them.
    fn instances(
        &mut self,
        instances: &[InstanceGeometry],
        meshes: &[PackedMesh],
        top: BinaryTree<'_>,
    ) -> Result<(), GeometryError> {
        let mut placed = Vec::with_capacity(instances.len());
        for (i, instance) in instances.iter().enumerate() {
            let wrong = GeometryError::Instance { instance: i };
            let mesh = meshes.get(instance.mesh as usize).ok_or(wrong.clone())?;
            let map = DAffine3 {
                matrix3: instance.to_world.matrix3.as_dmat3(),
                translation: instance.to_world.translation.as_dvec3(),
            };
            let inverse = map.inverse();
            let bounds = world_box(&mesh.bounds, f64::from(power_of_two(-mesh.exponent)), &map);
            let fine = map.matrix3.determinant() != 0.0 && inverse.is_finite();
            if !(fine && bounds.0.as_vec3().is_finite() && bounds.1.as_vec3().is_finite()) {
                return Err(wrong);
            }
            placed.push((inverse, bounds));
        }
        let largest =
            placed.iter().fold(0.0f64, |m, (_, (a, b))| m.max(a.abs().max(b.abs()).max_element())) as f32;
        let exponent = scale_exponent(largest);
        let to_tree = f64::from(power_of_two(exponent));
        // Boxes were padded by far more than this rounds.
        let bounds_of = |i: u32| {
            let (min, max) = placed[i as usize].1;
            Bounds { min: (min * to_tree).as_vec3(), max: (max * to_tree).as_vec3() }
        };
        let tree = Binary::new(None, &top, instances.len(), bounds_of, TOP_STACK, 1)?;
        for &i in &tree.order {
            let (instance, inverse) = (&instances[i as usize], &placed[i as usize].0);
            let mesh = &meshes[instance.mesh as usize];
            let to_mesh = f64::from(power_of_two(mesh.exponent));
            let DMat3 { x_axis, y_axis, z_axis } = inverse.matrix3 * (to_mesh / to_tree);
            let moved = inverse.translation * to_mesh;
            let row = |k: usize| [x_axis[k], y_axis[k], z_axis[k], moved[k]].map(|v| v as f32);
            self.instances.push(RayInstance {
                x: row(0),
                y: row(1),
                z: row(2),
                root: mesh.root,
                first_primitive: instance.first_primitive,
                reach: mesh.reach,
                spare: 0,
            });
        }
        let root = tree.emit(&mut self.nodes, 0, 1);
        let (scale, reach) = (power_of_two(exponent), largest * power_of_two(exponent));
        self.tree = RayTree { scale, scale_exponent: exponent, reach, root, ..self.tree };
        Ok(())
    }

    fn check(&self) -> Result<(), GeometryError> {
        let counts = [("nodes", self.nodes.len()), ("triangles", self.triangles.len())];
        match counts.into_iter().find(|&(_, count)| count >= 1 << 28) {
            Some((what, count)) => Err(GeometryError::TooMany { what, count }),
            None => Ok(()),
        }
    }
}

impl RayTree {
    const fn default_empty() -> Self {
        Self {
            scale: 1.0,
            scale_exponent: 0,
            reach: 0.0,
            root: NO_CHILD,
            node_row: 0,
            triangle_row: 0,
            spare0: 0,
            spare1: 0,
        }
    }
}

/// A mesh that was appended.
struct PackedMesh {
    root: u32,
    /// Of the power of two that brings its coordinates into the tree's.
    exponent: i32,
    reach: f32,
    /// In the tree's scale.
    bounds: Bounds,
}

impl Binary {
    /// Checks a host's tree and puts it in order; balances it where a traversal would need more than `stack`
    /// links.
    fn new(
        mesh: Option<usize>,
        tree: &BinaryTree<'_>,
        primitives: usize,
        bounds: impl Fn(u32) -> Bounds,
        stack: usize,
        max_leaf: u32,
    ) -> Result<Self, GeometryError> {
        if let Some(at) = tree.order.iter().position(|&i| i as usize >= primitives) {
            return Err(GeometryError::MissingPrimitive { mesh, at });
        }
        let root = (!tree.nodes.is_empty()).then_some(Source::Node(0));
        let binary = Self::grow(mesh, tree, root, &bounds)?;
        if binary.stack_need(max_leaf) <= stack {
            return Ok(binary);
        }
        let runs = BinaryTree { nodes: &[], order: &binary.order };
        let balanced = Self::grow(mesh, &runs, Some(Source::Run(0, binary.order.len())), &bounds)?;
        let needed = balanced.stack_need(max_leaf);
        if needed > stack {
            return Err(GeometryError::TooDeep { mesh, needed, most: stack });
        }
        Ok(balanced)
    }

    /// The host's topology, parents first, with one primitive a leaf; runs are halved.
    fn grow(
        mesh: Option<usize>,
        tree: &BinaryTree<'_>,
        root: Option<Source>,
        bounds: &impl Fn(u32) -> Bounds,
    ) -> Result<Self, GeometryError> {
        let mut binary = Self { nodes: Vec::with_capacity(2 * tree.order.len()), order: vec![] };
        let mut seen = vec![false; tree.nodes.len()];
        // What is there, and whose child it is here.
        let mut work: Vec<(Source, Option<(usize, usize)>)> =
            root.map(|root| (root, None)).into_iter().collect();
        while let Some((source, parent)) = work.pop() {
            let (start, end) = match source {
                Source::Run(start, end) => (start, end),
                Source::Node(at) => {
                    let malformed = || GeometryError::Malformed { mesh, node: at };
                    let node = tree.nodes.get(at).ok_or_else(malformed)?;
                    if core::mem::replace(&mut seen[at], true) {
                        return Err(malformed());
                    }
                    let first = node.first as usize;
                    if node.count == 0 {
                        let here = binary.push(parent, Bounds::EMPTY, 0);
                        let second = first.saturating_add(1);
                        work.push((Source::Node(second), Some((here, 1))));
                        work.push((Source::Node(first), Some((here, 0))));
                        continue;
                    }
                    let end = first.saturating_add(node.count as usize);
                    // Leaves that share entries would lead to more primitives than there are.
                    if end > tree.order.len() || binary.order.len() >= tree.order.len() {
                        return Err(malformed());
                    }
                    (first, end)
                }
            };
            if end - start > 1 {
                let here = binary.push(parent, Bounds::EMPTY, 0);
                let middle = usize::midpoint(start, end);
                work.push((Source::Run(middle, end), Some((here, 1))));
                work.push((Source::Run(start, middle), Some((here, 0))));
            } else if let Some(&primitive) = tree.order.get(start) {
                binary.push(parent, bounds(primitive), 1);
                binary.order.push(primitive);
            }
        }
        binary.gather();
        Ok(binary)
    }

    /// Appends a node, `count` of whose primitives come next, as a child of `parent`.
    fn push(&mut self, parent: Option<(usize, usize)>, bounds: Bounds, count: u32) -> usize {
        let here = self.nodes.len();
        if let Some((parent, side)) = parent {
            self.nodes[parent].children.get_or_insert([0; 2])[side] = here as u32;
        }
        self.nodes.push(Inner { bounds, children: None, first: self.order.len() as u32, count });
        here
    }

    /// Gives inner nodes the boxes and ranges of their children.
    fn gather(&mut self) {
        for i in (0..self.nodes.len()).rev() {
            if let Some([left, right]) = self.nodes[i].children {
                let (l, r) = (&self.nodes[left as usize], &self.nodes[right as usize]);
                let (bounds, first, count) = (l.bounds.union(r.bounds), l.first, l.count + r.count);
                self.nodes[i] = Inner { bounds, first, count, ..self.nodes[i] };
            }
        }
    }

    /// Which nodes become leaves: where that is no dearer than what is below.
    fn leaves(&self, max_leaf: u32) -> Vec<bool> {
        let mut cost = vec![0.0f32; self.nodes.len()];
        let mut leaf = vec![false; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate().rev() {
            let area = node.bounds.half_area();
            let as_leaf = area * node.count as f32;
            let as_node = node
                .children
                .map(|[left, right]| cost[left as usize] + cost[right as usize] + 2.0 * NODE_COST * area);
            leaf[i] = node.count <= max_leaf && as_node.is_none_or(|as_node| as_leaf <= as_node);
            cost[i] = if leaf[i] { as_leaf } else { as_node.unwrap_or(as_leaf) };
        }
        leaf
    }

    /// Up to four children of a wide node: the largest is opened until there are four.
    fn wide_children(&self, node: usize, leaf: &[bool]) -> ([usize; 4], usize) {
        let mut children = [usize::MAX; 4];
        let mut count = 0;
        if let Some(pair) = self.nodes[node].children {
            children[..2].copy_from_slice(&pair.map(|i| i as usize));
            count = 2;
        }
        while count < 4 {
            let open = (0..count).filter(|&k| !leaf[children[k]]).max_by(|&a, &b| {
                let area = |k: usize| self.nodes[children[k]].bounds.half_area();
                area(a).total_cmp(&area(b))
            });
            let Some(k) = open else { break };
            let Some([left, right]) = self.nodes[children[k]].children else { break };
            children[k] = left as usize;
            children[count] = right as usize;
            count += 1;
        }
        (children, count)
    }

    /// Links that can wait at once, in whatever order children are visited.
    fn stack_need(&self, max_leaf: u32) -> usize {
        let leaf = self.leaves(max_leaf);
        let (mut most, mut work) = (0, vec![(0usize, 0usize)]);
        while let Some((node, waiting)) = work.pop() {
            most = most.max(waiting);
            if node < self.nodes.len() && !leaf[node] {
                let (children, count) = self.wide_children(node, &leaf);
                // All but the one that is visited wait; a closest hit pushes that one, too, for a moment.
                most = most.max(waiting + count);
                work.extend(children[..count].iter().map(|&child| (child, waiting + count - 1)));
            }
        }
        most
    }

    /// Appends the wide nodes; returns the link to the root. `first` is added to the indices of primitives.
    fn emit(&self, nodes: &mut Vec<WideNode>, first: u32, max_leaf: u32) -> u32 {
        if self.nodes.is_empty() {
            return NO_CHILD;
        }
        let leaf = self.leaves(max_leaf);
        let leaf_link = |i: usize| LEAF | (self.nodes[i].count - 1) << 28 | (first + self.nodes[i].first);
        if leaf[0] {
            return leaf_link(0);
        }
        let root = nodes.len();
        nodes.push(WideNode::EMPTY);
        // Depth first, so that what is near in space is near in memory.
        let mut work = vec![(0usize, root)];
        while let Some((from, to)) = work.pop() {
            let (children, count) = self.wide_children(from, &leaf);
            let mut links = [NO_CHILD; 4];
            let mut boxes = [None; 4];
            for (k, &child) in children[..count].iter().enumerate() {
                boxes[k] = Some(self.nodes[child].bounds);
                links[k] = if leaf[child] {
                    leaf_link(child)
                } else {
                    nodes.push(WideNode::EMPTY);
                    work.push((child, nodes.len() - 1));
                    nodes.len() as u32 - 1
                };
            }
            nodes[to] = WideNode::around(&boxes, links);
        }
        root as u32
    }
}

impl WideNode {
    const EMPTY: Self = Self {
        origin: [0.0; 3],
        exponents: 0,
        child: [NO_CHILD; 4],
        low: [0; 3],
        spare0: 0,
        high: [0; 3],
        spare1: 0,
    };

    /// The finest grid on which every box is held.
    fn around(boxes: &[Option<Bounds>; 4], child: [u32; 4]) -> Self {
        let whole = boxes.iter().flatten().fold(Bounds::EMPTY, |whole, b| whole.union(*b));
        let mut node = Self { origin: whole.min.to_array(), child, ..Self::EMPTY };
        for axis in 0..3 {
            let origin = f64::from(whole.min[axis]);
            let extent = f64::from(whole.max[axis]) - origin;
            // 2^e such that 255 steps reach the far end; not below the least normal number.
            let mut exponent = -126;
            while f64::from(power_of_two(exponent)) * 255.0 < extent {
                exponent = if exponent == -126 {
                    (extent / 255.0).log2().ceil().max(-125.0) as i32
                } else {
                    exponent + 1
                };
            }
            let step = f64::from(power_of_two(exponent));
            node.exponents |= ((exponent + 127) as u32) << (8 * axis);
            for (k, bounds) in boxes.iter().enumerate() {
                // What isn't there is never entered: its low end is beyond its high one on every axis, by
                // more than padding.
                let (low, high) = bounds.map_or((255, 0), |b| {
                    let low = ((f64::from(b.min[axis]) - origin) / step).floor();
                    let high = ((f64::from(b.max[axis]) - origin) / step).ceil();
                    (low as u32, high as u32)
                });
                node.low[axis] |= low << (8 * k);
                node.high[axis] |= high << (8 * k);
            }
        }
        node
    }
}

/// The exponent of the power of two that brings `largest` into [0.5, 1), 0 for nothing.
fn scale_exponent(largest: f32) -> i32 {
    if largest > 0.0 { (-1 - f64::from(largest).log2().floor() as i32).clamp(-126, 126) } else { 0 }
}

/// 2^e for -126 <= e <= 127.
fn power_of_two(e: i32) -> f32 {
    f32::from_bits(((e + 127) as u32) << 23)
}

/// World-space corners of a box of a mesh, padded by what f32 rounds on both sides of the map.
fn world_box(bounds: &Bounds, from_tree: f64, map: &DAffine3) -> (DVec3, DVec3) {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut largest = DVec3::ZERO;
    for corner in 0..8u32 {
        let pick = |k: usize| if corner >> k & 1 == 0 { bounds.min[k] } else { bounds.max[k] };
        let local = DVec3::new(pick(0).into(), pick(1).into(), pick(2).into()) * from_tree;
        let at = map.transform_point3(local);
        (min, max) = (min.min(at), max.max(at));
        largest = largest.max(local.abs());
    }
    let size = map.matrix3.abs() * largest + map.translation.abs();
    let pad = size * (16.0 * f64::from(f32::EPSILON));
    (min - pad, max + pad)
}
