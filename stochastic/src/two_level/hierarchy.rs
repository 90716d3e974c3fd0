//! A two-level tree as one tree in world space.

use core::ops::Range;

use lighttree::{Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, NodeId};

use super::{LightMesh, TwoLevelTree, segment_of};

/// Where a node is.
enum Place<'t, T> {
    /// Inner node of the tree over the instances.
    Top(NodeId),
    /// The root of this instance's mesh, as a leaf of that tree.
    Root(u32),
    /// Further down: a node of this instance's mesh, by its own id.
    Below(u32, &'t LightMesh<T>, NodeId),
}

impl<T: LightHierarchy> TwoLevelTree<T> {
    fn place(&self, node: NodeId) -> Place<'_, T> {
        let over = &self.over;
        if (node.0 as usize) < over.top.nodes().len() {
            let top = over.top.node(node);
            if top.is_leaf() {
                return Place::Root(over.top.light_at(top.first_item).0);
            }
            return Place::Top(node);
        }
        let (instance, id) = segment_of(&over.first_node, node.0);
        Place::Below(instance as u32, self.mesh(&over.frames[instance]), NodeId(id))
    }

    /// Mesh and its root of an instance that is in the tree.
    fn root_of(&self, instance: u32) -> (&LightMesh<T>, NodeId) {
        let mesh = self.mesh(&self.over.frames[instance as usize]);
        (mesh, mesh.tree.root().expect("an instance in the tree has lights"))
    }

    /// The slot of an instance's first light, which its mesh's own slots count from.
    fn first_slot(&self, instance: u32) -> u32 {
        let slot = self.over.top.slot_of(LightId(instance)).expect("an instance in the tree has a slot");
        self.over.first_slot[slot as usize]
    }
}

impl<T: LightHierarchy> Hierarchy for TwoLevelTree<T> {
    fn root(&self) -> Option<NodeId> {
        self.over.top.root()
    }

    fn children(&self, node: NodeId) -> Range<u32> {
        let (instance, children) = match self.place(node) {
            Place::Top(node) => return self.over.top.children(node),
            Place::Root(instance) => {
                let (mesh, root) = self.root_of(instance);
                (instance, mesh.tree.children(root))
            }
            Place::Below(instance, mesh, node) => (instance, mesh.tree.children(node)),
        };
        let first = self.over.first_node[instance as usize];
        first + children.start..first + children.end
    }
}

impl<T: LightHierarchy> ItemRanges for TwoLevelTree<T> {
    fn items(&self, node: NodeId) -> Range<u32> {
        match self.place(node) {
            Place::Top(node) => {
                let Range { start, end } = self.over.top.items(node);
                self.over.first_slot[start as usize]..self.over.first_slot[end as usize]
            }
            Place::Root(instance) => {
                let (mesh, root) = self.root_of(instance);
                let first = self.first_slot(instance);
                first..first + mesh.tree.items(root).len() as u32
            }
            Place::Below(instance, mesh, node) => {
                let first = self.first_slot(instance);
                let Range { start, end } = mesh.tree.items(node);
                first + start..first + end
            }
        }
    }
}

impl<T: LightHierarchy> LightHierarchy for TwoLevelTree<T> {
    fn bounds(&self, node: NodeId) -> LightBounds {
        match self.place(node) {
            Place::Top(node) => self.over.top.bounds(node),
            Place::Root(_) => self.over.top.bounds(node),
            Place::Below(instance, mesh, node) => {
                self.over.frames[instance as usize].bounds(&mesh.tree.bounds(node))
            }
        }
    }

    fn light_at(&self, slot: u32) -> LightId {
        let (place, local) = segment_of(&self.over.first_slot, slot);
        let instance = self.over.top.light_at(place as u32).0 as usize;
        let LightId(light) = self.mesh(&self.over.frames[instance]).tree.light_at(local);
        LightId(self.over.first_light[instance] + light)
    }

    fn slot_of(&self, light: LightId) -> Option<u32> {
        let (instance, light) = self.locate(light)?;
        let place = self.over.top.slot_of(LightId(instance))?;
        let local = self.mesh(&self.over.frames[instance as usize]).tree.slot_of(light)?;
        Some(self.over.first_slot[place as usize] + local)
    }

    fn node_count(&self) -> usize {
        self.over.first_index.last().map_or(0, |&end| end as usize)
    }

    fn node_index(&self, node: NodeId) -> usize {
        match self.place(node) {
            Place::Top(node) => node.0 as usize,
            Place::Root(_) => node.0 as usize,
            Place::Below(instance, mesh, node) => {
                self.over.first_index[instance as usize] as usize + mesh.tree.node_index(node)
            }
        }
    }
}
