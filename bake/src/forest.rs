//! The hierarchies that light is clustered in: one octree of all virtual point lights, and one tree of pieces
//! for each lamp.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.1.
//!
//! Which cells there are is a function of the members alone: a cell exists if it has members, and is parted
//! if it has more than `leaf_members` of them and is not one of the finest. So no history of edits leaves a
//! trace.
//!
//! Differs from the paper: a member belongs to the cell of its position less 2⁻²⁰ of the world's side along
//! its normal, so that all of a surface that coincides with a face between cells falls on one side of it.

use glam::Vec3;

use crate::LightKey;
use crate::sums::{Sums, Units};

/// No node, no vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// Levels of the octree below its root.
pub(crate) const MAX_DEPTH: u8 = 20;

/// What a node stands for: its name, which outlives the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Place {
    /// A cell of the octree: three bits of `code` for each level, the root's first.
    Cell { depth: u8, code: u64 },
    /// A piece of a lamp.
    Piece { light: LightKey, piece: u32 },
}

/// A node of any of the trees. 144 bytes.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) place: Place,
    pub(crate) parent: u32,
    /// Index into [`Forest::families`], or [`NONE`] for leaves.
    family: u32,
    /// Of a leaf cell, its first member.
    pub(crate) first_member: u32,
    /// What the cut knows of it, or [`NONE`].
    pub(crate) state: u32,
    pub(crate) sums: Sums,
    /// B*: the metric, or that of a node below, if that is larger.
    pub(crate) importance: f64,
    /// Depth below its root.
    pub(crate) depth: u8,
    /// In `stale`.
    is_stale: bool,
}

const _: () = assert!(size_of::<Node>() == 144);

/// A member of the octree as the forest needs to know it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Member {
    pub(crate) position: Vec3,
    pub(crate) normal: Vec3,
    pub(crate) sums: Sums,
}

/// What the forest asks of whoever keeps the members.
pub(crate) trait Members {
    fn member(&self, vertex: u32) -> Member;
    fn next(&self, vertex: u32) -> u32;
    fn set_next(&mut self, vertex: u32, next: u32);
}

/// What becomes of the states of nodes that go: the cut keeps what is baked.
pub(crate) trait Goodbye {
    /// `node` goes for good.
    fn gone(&mut self, nodes: &mut [Node], node: u32);
    /// What went just now stood for nothing any more.
    fn left(&mut self);
    /// All below `node` went, and it becomes a leaf.
    fn folded(&mut self, nodes: &mut [Node], node: u32);
    /// `node` came, below one that has children already or was just parted.
    fn born(&mut self, nodes: &mut [Node], node: u32);
    /// The members of `node` changed; it has a state.
    fn touched(&mut self, nodes: &mut [Node], node: u32);
}

/// All trees.
#[derive(Clone, Debug)]
pub(crate) struct Forest {
    pub(crate) nodes: Vec<Node>,
    families: Vec<[u32; 8]>,
    free_nodes: Vec<u32>,
    free_families: Vec<u32>,
    /// Nodes whose sums changed.
    stale: Vec<u32>,
    pub(crate) units: Units,
    /// More members than that, and a cell is parted.
    leaf_members: u32,
    /// Members outside the world's cube.
    pub(crate) outside: u32,
}

/// The octree's root is always there.
pub(crate) const OCTREE: u32 = 0;

impl Forest {
    pub(crate) fn new(units: Units, leaf_members: u32) -> Self {
        let mut forest = Self {
            nodes: Vec::new(),
            families: Vec::new(),
            free_nodes: Vec::new(),
            free_families: Vec::new(),
            stale: Vec::new(),
            units,
            leaf_members,
            outside: 0,
        };
        forest.plant(Place::Cell { depth: 0, code: 0 }, NONE);
        forest
    }

    /// A new node, not yet among its parent's children.
    pub(crate) fn plant(&mut self, place: Place, parent: u32) -> u32 {
        let depth = if parent == NONE { 0 } else { self.nodes[parent as usize].depth + 1 };
        let node = Node {
            place,
            parent,
            family: NONE,
            first_member: NONE,
            state: NONE,
            sums: Sums::default(),
            importance: 0.0,
            depth,
            is_stale: false,
        };
        if let Some(index) = self.free_nodes.pop() {
            // A node that went while it was stale is still listed.
            let is_stale = self.nodes[index as usize].is_stale;
            self.nodes[index as usize] = Node { is_stale, ..node };
            return index;
        }
        grow(&mut self.nodes);
        self.nodes.push(node);
        (self.nodes.len() - 1) as u32
    }

    pub(crate) fn set_child(&mut self, parent: u32, slot: usize, child: u32) {
        if self.nodes[parent as usize].family == NONE {
            let family = self.free_families.pop().unwrap_or_else(|| {
                grow(&mut self.families);
                self.families.push([NONE; 8]);
                (self.families.len() - 1) as u32
            });
            self.families[family as usize] = [NONE; 8];
            self.nodes[parent as usize].family = family;
        }
        self.families[self.nodes[parent as usize].family as usize][slot] = child;
    }

    pub(crate) fn is_leaf(&self, node: u32) -> bool {
        self.nodes[node as usize].family == NONE
    }

    /// Children that there are, in order.
    pub(crate) fn children(&self, node: u32) -> impl Iterator<Item = u32> + use<> {
        let family = self.nodes[node as usize].family;
        let all = if family == NONE { [NONE; 8] } else { self.families[family as usize] };
        all.into_iter().filter(|&child| child != NONE)
    }

    /// The child of a node that `place` is, or lies below.
    pub(crate) fn child_towards(&self, node: u32, place: Place) -> Option<u32> {
        let towards = |child: &u32| match (self.nodes[*child as usize].place, place) {
            (Place::Cell { depth: above, code: prefix }, Place::Cell { depth, code }) => {
                above <= depth && code >> (3 * u32::from(depth - above).min(21)) == prefix
            }
            // A lamp's trees are small: any child that has the piece below it.
            (Place::Piece { .. }, Place::Piece { .. }) => self.has_below(*child, place),
            _ => false,
        };
        self.children(node).find(towards)
    }

    fn has_below(&self, node: u32, place: Place) -> bool {
        self.nodes[node as usize].place == place
            || self.children(node).any(|child| self.has_below(child, place))
    }

    /// Members below a cell, in no order that means anything.
    pub(crate) fn members_below(&self, node: u32, members: &impl Members, each: &mut impl FnMut(u32)) {
        for child in self.children(node) {
            self.members_below(child, members, each);
        }
        let mut member = self.nodes[node as usize].first_member;
        while member != NONE {
            each(member);
            member = members.next(member);
        }
    }

    /// Bits of each level of the cell that a member belongs to, and whether it lies outside the world.
    fn code(&self, member: &Member) -> (u64, bool) {
        let pushed = member.position.as_dvec3() - self.units.length * member.normal.as_dvec3();
        let (cell, outside) = self.units.cell(pushed);
        let mut code = 0;
        for bit in (0..u32::from(MAX_DEPTH)).rev() {
            let octant = (cell[0] >> bit & 1) | (cell[1] >> bit & 1) << 1 | (cell[2] >> bit & 1) << 2;
            code = code << 3 | u64::from(octant);
        }
        (code, outside)
    }

    /// Puts `vertex` into the octree.
    pub(crate) fn insert(&mut self, vertex: u32, members: &mut impl Members, cut: &mut impl Goodbye) {
        let member = members.member(vertex);
        let (code, outside) = self.code(&member);
        self.outside += u32::from(outside);
        let mut node = OCTREE;
        loop {
            self.nodes[node as usize].sums.add(&member.sums);
            if self.nodes[node as usize].state != NONE {
                cut.touched(&mut self.nodes, node);
            }
            if self.is_leaf(node) {
                break;
            }
            let octant = octant(code, self.nodes[node as usize].depth);
            node = self.child_or_new(node, octant, code, cut);
        }
        members.set_next(vertex, self.nodes[node as usize].first_member);
        self.nodes[node as usize].first_member = vertex;
        self.mark(node);
        self.part(node, members, cut);
    }

    fn child_or_new(&mut self, node: u32, octant: usize, code: u64, cut: &mut impl Goodbye) -> u32 {
        let family = self.nodes[node as usize].family;
        if family != NONE && self.families[family as usize][octant] != NONE {
            return self.families[family as usize][octant];
        }
        let depth = self.nodes[node as usize].depth + 1;
        let code = code >> (3 * u32::from(MAX_DEPTH - depth));
        let child = self.plant(Place::Cell { depth, code }, node);
        self.set_child(node, octant, child);
        cut.born(&mut self.nodes, child);
        child
    }

    /// Parts a leaf with too many members, and its children likewise.
    fn part(&mut self, node: u32, members: &mut impl Members, cut: &mut impl Goodbye) {
        let Node { sums, depth, .. } = self.nodes[node as usize];
        if sums.count <= self.leaf_members || depth == MAX_DEPTH {
            return;
        }
        let mut vertex = core::mem::replace(&mut self.nodes[node as usize].first_member, NONE);
        while vertex != NONE {
            let next = members.next(vertex);
            let member = members.member(vertex);
            let (code, _) = self.code(&member);
            let child = self.child_or_new(node, octant(code, depth), code, cut);
            self.nodes[child as usize].sums.add(&member.sums);
            members.set_next(vertex, self.nodes[child as usize].first_member);
            self.nodes[child as usize].first_member = vertex;
            vertex = next;
        }
        if self.nodes[node as usize].state != NONE {
            cut.touched(&mut self.nodes, node);
        }
        for child in self.children(node) {
            self.mark(child);
            self.part(child, members, cut);
        }
    }

    /// Takes `vertex` out of the octree; its member must be what it was when it was put in.
    pub(crate) fn remove(&mut self, vertex: u32, members: &mut impl Members, cut: &mut impl Goodbye) {
        let member = members.member(vertex);
        let leaf = self.descend(&member, cut, |sums| sums.subtract(&member.sums));
        self.outside -= u32::from(self.code(&member).1);
        // Unlink.
        let mut at = self.nodes[leaf as usize].first_member;
        let after = members.next(vertex);
        if at == vertex {
            self.nodes[leaf as usize].first_member = after;
        } else {
            while members.next(at) != vertex {
                at = members.next(at);
            }
            members.set_next(at, after);
        }
        // Fold the topmost cell that has few enough now; drop what is empty.
        let (mut node, mut top) = (leaf, NONE);
        while node != NONE {
            if !self.is_leaf(node) && self.nodes[node as usize].sums.count <= self.leaf_members {
                top = node;
            }
            node = self.nodes[node as usize].parent;
        }
        if top != NONE {
            self.fold(top, members, cut);
            self.mark(top);
            self.drop_empty(top, cut);
        } else {
            self.mark(leaf);
            self.drop_empty(leaf, cut);
        }
    }

    /// Replaces what a member adds to the sums, without moving it.
    pub(crate) fn adjust(&mut self, before: &Member, after: &Member, cut: &mut impl Goodbye) {
        let leaf = self.descend(before, cut, |sums| {
            sums.subtract(&before.sums);
            sums.add(&after.sums);
        });
        self.mark(leaf);
    }

    fn descend(&mut self, member: &Member, cut: &mut impl Goodbye, each: impl Fn(&mut Sums)) -> u32 {
        let (code, _) = self.code(member);
        let mut node = OCTREE;
        loop {
            each(&mut self.nodes[node as usize].sums);
            if self.nodes[node as usize].state != NONE {
                cut.touched(&mut self.nodes, node);
            }
            let family = self.nodes[node as usize].family;
            if family == NONE {
                return node;
            }
            node = self.families[family as usize][octant(code, self.nodes[node as usize].depth)];
        }
    }

    /// The leaf cell of a member, or the node with a state above it, whichever `stop` says.
    pub(crate) fn find(&self, member: &Member, stop: impl Fn(&Node) -> bool) -> u32 {
        let (code, _) = self.code(member);
        let mut node = OCTREE;
        while !stop(&self.nodes[node as usize]) && !self.is_leaf(node) {
            let family = self.nodes[node as usize].family;
            node = self.families[family as usize][octant(code, self.nodes[node as usize].depth)];
        }
        node
    }

    /// Makes a cell a leaf again.
    fn fold(&mut self, node: u32, members: &mut impl Members, cut: &mut impl Goodbye) {
        let mut first = NONE;
        self.gather(node, &mut first, members, cut);
        self.nodes[node as usize].first_member = first;
        cut.folded(&mut self.nodes, node);
    }

    fn gather(&mut self, node: u32, first: &mut u32, members: &mut impl Members, cut: &mut impl Goodbye) {
        for child in self.children(node) {
            self.gather(child, first, members, cut);
            let mut member = self.nodes[child as usize].first_member;
            while member != NONE {
                let next = members.next(member);
                members.set_next(member, *first);
                *first = member;
                member = next;
            }
            self.release(child, cut);
        }
        self.drop_family(node);
    }

    fn drop_family(&mut self, node: u32) {
        let family = core::mem::replace(&mut self.nodes[node as usize].family, NONE);
        if family != NONE {
            self.free_families.push(family);
        }
    }

    fn release(&mut self, node: u32, cut: &mut impl Goodbye) {
        if self.nodes[node as usize].state != NONE {
            cut.gone(&mut self.nodes, node);
        }
        self.nodes[node as usize].first_member = NONE;
        self.free_nodes.push(node);
    }

    /// Takes an empty leaf, and parents that it leaves empty, out of the tree.
    fn drop_empty(&mut self, mut node: u32, cut: &mut impl Goodbye) {
        while node != OCTREE && self.nodes[node as usize].sums.count == 0 && self.is_leaf(node) {
            let parent = self.nodes[node as usize].parent;
            let family = self.nodes[parent as usize].family as usize;
            for child in &mut self.families[family] {
                if *child == node {
                    *child = NONE;
                }
            }
            if self.families[family].iter().all(|&child| child == NONE) {
                self.drop_family(parent);
            }
            self.release(node, cut);
            cut.left();
            self.mark(parent);
            node = parent;
        }
    }

    /// Takes a tree of pieces out, root last.
    pub(crate) fn fell(&mut self, node: u32, cut: &mut impl Goodbye) {
        for child in self.children(node) {
            self.fell(child, cut);
        }
        self.drop_family(node);
        self.release(node, cut);
        cut.left();
    }

    /// Its importance, and that of all above, will be found anew by [`refresh`](Self::refresh).
    pub(crate) fn mark(&mut self, node: u32) {
        let entry = &mut self.nodes[node as usize];
        if !entry.is_stale {
            entry.is_stale = true;
            self.stale.push(node);
        }
    }

    /// Brings the importance of all nodes up to date, and names those that may have changed.
    pub(crate) fn refresh(&mut self, metric: impl Fn(&Node) -> f64) -> Vec<u32> {
        // Ancestors of what is marked are stale, too.
        let mut i = 0;
        while i < self.stale.len() {
            let parent = self.nodes[self.stale[i] as usize].parent;
            if parent != NONE {
                self.mark(parent);
            }
            i += 1;
        }
        let mut stale = core::mem::take(&mut self.stale);
        stale.sort_unstable_by_key(|&node| core::cmp::Reverse(self.nodes[node as usize].depth));
        for &node in &stale {
            let of_children = self.children(node).map(|child| self.nodes[child as usize].importance);
            let below = of_children.fold(0.0, f64::max);
            let entry = &mut self.nodes[node as usize];
            entry.importance = metric(entry).max(below);
            entry.is_stale = false;
        }
        stale
    }

    /// Gives back what growing ahead took, once no more comes for a while.
    pub(crate) fn trim(&mut self) {
        trim(&mut self.nodes);
        trim(&mut self.families);
        trim(&mut self.free_nodes);
        trim(&mut self.free_families);
        trim(&mut self.stale);
    }

    /// Bytes that the trees take.
    pub(crate) fn bytes(&self) -> usize {
        let lists = [&self.free_nodes, &self.free_families, &self.stale].map(Vec::capacity);
        self.nodes.capacity() * size_of::<Node>()
            + self.families.capacity() * size_of::<[u32; 8]>()
            + lists.iter().sum::<usize>() * size_of::<u32>()
    }
}

/// Makes room for one more, and few besides: twice as much would spoil the bytes per vertex.
fn grow<T>(vec: &mut Vec<T>) {
    if vec.len() == vec.capacity() {
        vec.reserve_exact(vec.len() / 16 + 256);
    }
}

/// Room for few more than there are.
fn trim<T>(vec: &mut Vec<T>) {
    if vec.capacity() - vec.len() > vec.len() / 128 + 64 {
        vec.shrink_to_fit();
    }
}

/// The octant that a code takes below a node of this depth.
fn octant(code: u64, depth: u8) -> usize {
    (code >> (3 * u32::from(MAX_DEPTH - 1 - depth)) & 7) as usize
}
