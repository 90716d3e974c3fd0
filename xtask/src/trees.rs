//! The light trees that a user may choose between, behind one type.

mod two_level;

use std::ops::Range;

use lighttree::{
    BuildParams, ChildChoice, FourBounds, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId,
    LightTree, MortonBits, NodeId, PerfectTree,
};

use scene::{Light, Scene};
use stochastic::TwoLevelTree;

pub(crate) use two_level::{KeptMeshes, Levels};

use crate::settings::{Key, Range as KeyRange, Settings};

/// Names of the builders, as `--set builder=` takes them.
pub(crate) const BUILDERS: [&str; 6] = ["saoh", "agglomerative", "median", "morton", "perfect", "two-level"];

/// The key that every method with a tree has.
pub(crate) const BUILDER: Key = Key {
    name: "builder",
    default: "saoh",
    range: KeyRange::OneOf(&BUILDERS),
    trades: "how lights are clustered: agglomerative has the tightest clusters and the slowest build, then saoh, median, morton; perfect builds fastest and keeps no orientations; two-level is saoh for each mesh and over their instances, which share a mesh's tree",
};

/// The key that every method with walks has.
pub(crate) const CHOICE: Key = Key {
    name: "choice",
    default: "minmax",
    range: KeyRange::OneOf(&["minmax", "yuksel", "center", "upper"]),
    trades: "what a walk compares two children by: minmax averages the nearest and the farthest distance (Lin and Yuksel 2020), yuksel ignores distance near a node (Yuksel 2019), center takes the boxes' centres, upper the nearest distance; which has least noise depends on the scene (docs/stochastic.md)",
};

/// What [`CHOICE`] says.
///
/// # Panics
/// If the settings were made without it.
pub(crate) fn choice(settings: &Settings) -> ChildChoice {
    match settings.text("choice") {
        "minmax" => ChildChoice::MinMaxAverage,
        "yuksel" => ChildChoice::Yuksel2019,
        "center" => ChildChoice::Center,
        "upper" => ChildChoice::Upper,
        other => panic!("`{other}` is not a choice"),
    }
}

/// A built light tree of either layout.
pub(crate) enum Tree {
    /// Nodes with cones.
    Oriented(LightTree),
    /// Without, over a Morton order.
    Perfect(PerfectTree),
    /// A tree with cones for each mesh, and one over the instances.
    TwoLevel(TwoLevelTree<LightTree>),
}

impl Tree {
    /// Builds with the builder of that name, over the lights of `scene` or a list that begins with them.
    /// `kept` is what the frame before left.
    ///
    /// # Errors
    /// A sentence about the light or the instance that cannot be used.
    ///
    /// # Panics
    /// For a name that is not in [`BUILDERS`].
    pub(crate) fn build(
        builder: &str,
        lights: &[Light],
        scene: &Scene,
        kept: &mut KeptMeshes,
    ) -> Result<Self, String> {
        let params = match builder {
            "saoh" => BuildParams::saoh(),
            "agglomerative" => BuildParams::agglomerative(),
            "median" => BuildParams::median(),
            "morton" => BuildParams::morton(),
            "perfect" => {
                let tree = PerfectTree::build(lights, MortonBits::SixtyThree);
                return tree.map(Self::Perfect).map_err(|error| error.to_string());
            }
            "two-level" => return two_level::build(lights, scene, kept).map(Self::TwoLevel),
            _ => panic!("`{builder}` is not a builder"),
        };
        LightTree::build(lights, &params).map(Self::Oriented).map_err(|error| error.to_string())
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Oriented(tree) => tree.bytes(),
            Self::Perfect(tree) => tree.bytes(),
            Self::TwoLevel(tree) => {
                tree.bytes() + tree.meshes().iter().map(|mesh| mesh.tree().bytes()).sum::<usize>()
            }
        }
    }

    /// Lights that were left out because they do not shine.
    pub(crate) fn dropped(&self) -> usize {
        match self {
            Self::Oriented(tree) => tree.dropped(),
            Self::Perfect(tree) => tree.dropped(),
            Self::TwoLevel(tree) => {
                tree.light_count() as usize - tree.root().map_or(0, |root| tree.items(root).len())
            }
        }
    }
}

/// Asks which kind of tree it is once, and not at each step of a walk.
macro_rules! either {
    ($tree:expr, $inner:ident => $answer:expr) => {
        match $tree {
            crate::trees::Tree::Oriented($inner) => $answer,
            crate::trees::Tree::Perfect($inner) => $answer,
            crate::trees::Tree::TwoLevel($inner) => $answer,
        }
    };
}
pub(crate) use either;

impl Hierarchy for Tree {
    fn root(&self) -> Option<NodeId> {
        either!(self, tree => tree.root())
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        either!(self, tree => tree.children(node))
    }
}

impl ItemRanges for Tree {
    fn items(&self, node: NodeId) -> Range<u32> {
        either!(self, tree => tree.items(node))
    }
}

impl LightHierarchy for Tree {
    fn bounds(&self, node: NodeId) -> LightBounds {
        either!(self, tree => tree.bounds(node))
    }
    fn bounds_of_pairs(&self, first: [NodeId; 2]) -> FourBounds {
        either!(self, tree => tree.bounds_of_pairs(first))
    }
    fn light_at(&self, slot: u32) -> LightId {
        either!(self, tree => tree.light_at(slot))
    }
    fn slot_of(&self, light: LightId) -> Option<u32> {
        either!(self, tree => tree.slot_of(light))
    }
    fn node_count(&self) -> usize {
        either!(self, tree => tree.node_count())
    }
    fn node_index(&self, node: NodeId) -> usize {
        either!(self, tree => tree.node_index(node))
    }
}
