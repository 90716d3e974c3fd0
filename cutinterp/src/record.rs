//! Records: points whose exact cuts are known, with what each node's shadow ray found.

use lighttree::{LightHierarchy, NodeId};

use crate::{Canopy, InputCut, Levels, Site};

/// What a host says of a record beside its cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// Place and radius.
    pub site: Site,
    /// Harmonic mean distance to the geometry around, in the scene's unit of length; infinite where there is
    /// none near.
    pub harmonic_mean: f32,
    /// Of the pixel that it was placed at, see [`Point::footprint`](crate::Point::footprint).
    pub footprint: f32,
    /// Luminance that the exact cut gave, in any unit that is the same for all records: what neighbours are
    /// compared by.
    pub brightness: f32,
}

/// A record and where its cut is.
#[derive(Clone, Copy, Debug)]
struct Kept {
    record: Record,
    nodes: u32,
    first_node: usize,
    first_word: usize,
}

/// Records by id, with their cuts.
///
/// Memory: 64 bytes a record, and 4 bytes and a bit a node of its cut; a cut's bits begin a new word of 32.
#[derive(Clone, Debug, Default)]
pub struct Records {
    records: Vec<Kept>,
    nodes: Vec<NodeId>,
    visible: Vec<u32>,
}

impl Records {
    /// Adds a record, whose id is the number of those before it. `cut` has the nodes of its exact cut, left
    /// to right, and whether the shadow ray to each node's representative found it; false for those that give
    /// the record nothing.
    ///
    /// # Panics
    /// Beyond 2³² - 1 records, or nodes in one cut.
    pub fn push(&mut self, record: Record, cut: impl Iterator<Item = (NodeId, bool)>) -> u32 {
        let (first_node, first_word) = (self.nodes.len(), self.visible.len());
        for (i, (node, seen)) in cut.enumerate() {
            if i % 32 == 0 {
                self.visible.push(0);
            }
            self.nodes.push(node);
            self.visible[first_word + i / 32] |= u32::from(seen) << (i % 32);
        }
        let nodes = u32::try_from(self.nodes.len() - first_node).expect("a cut has fewer than 2^32 nodes");
        let id = u32::try_from(self.records.len()).expect("there are fewer than 2^32 records");
        self.records.push(Kept { record, nodes, first_node, first_word });
        id
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// All records by id.
    pub fn all(&self) -> impl ExactSizeIterator<Item = &Record> {
        self.records.iter().map(|kept| &kept.record)
    }

    /// A record.
    ///
    /// # Panics
    /// If there is no such record.
    #[inline]
    pub fn get(&self, id: u32) -> &Record {
        &self.records[id as usize].record
    }

    /// The cut of a record, ready to be interpolated.
    ///
    /// # Panics
    /// If there is no such record.
    pub fn cut(&self, id: u32) -> InputCut<'_> {
        let &Kept { nodes, first_node, first_word, .. } = &self.records[id as usize];
        let nodes = &self.nodes[first_node..first_node + nodes as usize];
        InputCut { nodes, visible: &self.visible[first_word..first_word + nodes.len().div_ceil(32)] }
    }

    /// Collects what the cuts of all records reach of `tree`, and gives their nodes the names that they have
    /// in there: from now on they are cuts of the canopy, for
    /// [`MergedCuts::merge_in`](crate::MergedCuts::merge_in). `levels` are those of `tree`.
    ///
    /// # Panics
    /// If one of them is not a cut of `tree`.
    pub fn settle<T: LightHierarchy + ?Sized>(&mut self, tree: &T, levels: &Levels) -> Canopy {
        let canopy = Canopy::over(tree, levels, std::iter::once(&self.nodes[..]));
        for &Kept { nodes, first_node, .. } in &self.records {
            canopy.rename(&mut self.nodes[first_node..first_node + nodes as usize]);
        }
        canopy
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.records.capacity() * size_of::<Kept>()
            + self.nodes.capacity() * size_of::<NodeId>()
            + self.visible.capacity() * size_of::<u32>()
    }
}
