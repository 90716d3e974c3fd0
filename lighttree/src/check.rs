//! What a well-formed tree is, and a function that says where one is not.

use crate::{LightHierarchy, LightTree, NodeId, PerfectTree, build::emit::MAX_DEPTH};

/// Where and how a tree is malformed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Malformed {
    /// Nodes without lights, or lights without nodes.
    Empty,
    /// The place of this node is not below the number of nodes.
    NoSuchNode {
        /// The node.
        node: NodeId,
    },
    /// This node can be reached in two ways, or from itself.
    ReachedTwice {
        /// The node.
        node: NodeId,
    },
    /// The node at this place cannot be reached from the root.
    Unreachable {
        /// Its place, as of [`LightHierarchy::node_index`].
        index: usize,
    },
    /// This node is deeper than 64.
    TooDeep {
        /// The node.
        node: NodeId,
    },
    /// The slots of this node are none, or its children do not split them left to right; or the root's are
    /// not all.
    Items {
        /// The node.
        node: NodeId,
    },
    /// The box of this node is inverted, NaN, or sticks out of its parent's.
    Box {
        /// The node.
        node: NodeId,
    },
    /// The cone or the emission angle of this node sticks out of its parent's.
    Cone {
        /// The node.
        node: NodeId,
    },
    /// The intensity of this node is negative or not finite, or not the sum of its children's.
    Intensity {
        /// The node.
        node: NodeId,
    },
    /// The light of this slot is not said to be there.
    Slot {
        /// The slot.
        slot: u32,
    },
}

impl core::fmt::Display for Malformed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Empty => write!(f, "there are nodes without lights or lights without nodes"),
            Self::NoSuchNode { node } => write!(f, "node {} is out of range", node.0),
            Self::ReachedTwice { node } => write!(f, "node {} is reached twice", node.0),
            Self::Unreachable { index } => {
                write!(f, "the node at index {index} is not reached from the root")
            }
            Self::TooDeep { node } => write!(f, "node {} is deeper than {MAX_DEPTH}", node.0),
            Self::Items { node } => write!(f, "the slots of node {} are not split by its children", node.0),
            Self::Box { node } => {
                write!(f, "the box of node {} sticks out of its parent's or is none", node.0)
            }
            Self::Cone { node } => write!(f, "the cone of node {} sticks out of its parent's", node.0),
            Self::Intensity { node } => {
                write!(f, "the intensity of node {} is not its children's sum", node.0)
            }
            Self::Slot { slot } => write!(f, "the light in slot {slot} is not said to be there"),
        }
    }
}

impl core::error::Error for Malformed {}

/// Angle by which a cone may stick out of its parent's, radians: rounding of the comparison.
const CONE_SLACK: f32 = 1e-6;

impl LightTree {
    /// Says where the tree is malformed; never so for one that was built or refit.
    ///
    /// # Errors
    /// The first damage found.
    pub fn check(&self) -> Result<(), Malformed> {
        check(self, self.len())
    }
}

impl PerfectTree {
    /// Says where the tree is malformed; never so for one that was built or refit.
    ///
    /// # Errors
    /// The first damage found.
    pub fn check(&self) -> Result<(), Malformed> {
        check(self, self.len())
    }
}

/// Says where a tree over `lights` lights is malformed. Terminates for any tree whose `children` and `bounds`
/// do.
///
/// Well formed means: every node is reached once; slots are split left to right; boxes and cones lie within
/// their parent's; intensities are finite, not negative, and sum up; and the light of every slot is said to
/// be there.
///
/// # Errors
/// The first damage found.
pub fn check(tree: &impl LightHierarchy, lights: usize) -> Result<(), Malformed> {
    let Some(root) = tree.root() else {
        return if tree.node_count() == 0 && lights == 0 { Ok(()) } else { Err(Malformed::Empty) };
    };
    let mut reached = vec![false; tree.node_count()];
    reach(tree, root, &mut reached)?;
    let items = tree.items(root);
    if items.start != 0 || items.end as usize != lights {
        return Err(Malformed::Items { node: root });
    }
    check_box(tree, root)?;

    let mut open = vec![(root, 0)];
    while let Some((node, depth)) = open.pop() {
        if depth > MAX_DEPTH {
            return Err(Malformed::TooDeep { node });
        }
        for child in tree.children(node).map(NodeId) {
            reach(tree, child, &mut reached)?;
            check_box(tree, child)?;
            open.push((child, depth + 1));
        }
        check_children(tree, node)?;
    }

    if let Some(index) = reached.iter().position(|&reached| !reached) {
        return Err(Malformed::Unreachable { index });
    }
    match items.into_iter().find(|&slot| tree.slot_of(tree.light_at(slot)) != Some(slot)) {
        Some(slot) => Err(Malformed::Slot { slot }),
        None => Ok(()),
    }
}

fn reach(tree: &impl LightHierarchy, node: NodeId, reached: &mut [bool]) -> Result<(), Malformed> {
    match reached.get_mut(tree.node_index(node)) {
        None => Err(Malformed::NoSuchNode { node }),
        Some(true) => Err(Malformed::ReachedTwice { node }),
        Some(reached) => {
            *reached = true;
            Ok(())
        }
    }
}

fn check_box(tree: &impl LightHierarchy, node: NodeId) -> Result<(), Malformed> {
    let bounds = tree.bounds(node);
    if bounds.is_empty() || !bounds.min.is_finite() || !bounds.max.is_finite() {
        return Err(Malformed::Box { node });
    }
    if !(bounds.intensity >= 0.0 && bounds.intensity.is_finite()) {
        return Err(Malformed::Intensity { node });
    }
    Ok(())
}

/// Compares a node with its children, if it has any.
fn check_children(tree: &impl LightHierarchy, node: NodeId) -> Result<(), Malformed> {
    let (bounds, items) = (tree.bounds(node), tree.items(node));
    if items.is_empty() {
        return Err(Malformed::Items { node });
    }
    let mut next = items.start;
    let mut intensity = None;
    for child in tree.children(node).map(NodeId) {
        let (inside, slots) = (tree.bounds(child), tree.items(child));
        if slots.start != next || slots.is_empty() {
            return Err(Malformed::Items { node });
        }
        next = slots.end;
        if !(inside.min.cmpge(bounds.min).all() && inside.max.cmple(bounds.max).all()) {
            return Err(Malformed::Box { node: child });
        }
        if !bounds.contains(&inside, CONE_SLACK) {
            return Err(Malformed::Cone { node: child });
        }
        intensity = Some(intensity.map_or(inside.intensity, |sum: f32| sum + inside.intensity));
    }
    let Some(intensity) = intensity else { return Ok(()) };
    if next != items.end {
        return Err(Malformed::Items { node });
    }
    if intensity != bounds.intensity {
        return Err(Malformed::Intensity { node });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{BuildParams, LightBounds, LightId, MortonBits};

    fn lights() -> Vec<LightBounds> {
        let light = |i: u8| {
            let place = Vec3::new(f32::from(i % 7), f32::from(i % 5), f32::from(i));
            let normal = Vec3::new(f32::from(i % 3) - 1.0, 0.5, 0.2).normalize();
            LightBounds::surface(place, place + 0.5, normal, false, 1.0 + f32::from(i))
        };
        (0..40).map(light).collect()
    }

    /// What `check` says of a tree that was damaged like this.
    fn damaged(damage: impl FnOnce(&mut LightTree)) -> Malformed {
        let mut tree = LightTree::build(&lights(), &BuildParams::default()).unwrap();
        assert_eq!(tree.check(), Ok(()));
        damage(&mut tree);
        tree.check().unwrap_err()
    }

    #[test]
    fn every_kind_of_damage_is_found() {
        let last = |tree: &LightTree| NodeId(tree.nodes.len() as u32 - 1);
        let mut node = NodeId(0);
        // A leaf at the end: nothing below it can be blamed first.
        assert_eq!(
            damaged(|tree| {
                node = last(tree);
                tree.nodes[node.0 as usize].max[2] += 1e3;
            }),
            Malformed::Box { node }
        );
        assert_eq!(damaged(|tree| tree.nodes[node.0 as usize].min[0] = f32::NAN), Malformed::Box { node });
        assert_eq!(damaged(|tree| tree.nodes[node.0 as usize].cone |= 0xffff), Malformed::Cone { node });
        assert_eq!(damaged(|tree| tree.nodes[node.0 as usize].cone |= 1 << 31), Malformed::Cone { node });
        assert_eq!(
            damaged(|tree| tree.nodes[node.0 as usize].intensity = -1.0),
            Malformed::Intensity { node }
        );
        assert_eq!(damaged(|tree| tree.nodes[0].intensity *= 1.01), Malformed::Intensity { node: NodeId(0) });
        assert_eq!(damaged(|tree| tree.nodes[0].item_count -= 1), Malformed::Items { node: NodeId(0) });
        assert!(matches!(
            damaged(|tree| tree.nodes[node.0 as usize].first_item += 1),
            Malformed::Items { .. }
        ));
        assert!(matches!(
            damaged(|tree| tree.nodes[node.0 as usize].item_count = 0),
            Malformed::Items { .. }
        ));
        assert_eq!(damaged(|tree| tree.nodes[0].first_child = 0), Malformed::Unreachable { index: 1 });
        assert!(matches!(damaged(|tree| tree.nodes[0].first_child = 1000), Malformed::NoSuchNode { .. }));
        assert!(matches!(
            damaged(|tree| tree.nodes[node.0 as usize].first_child = 1),
            Malformed::ReachedTwice { .. }
        ));
        assert_eq!(damaged(|tree| tree.slots.swap(3, 5)), Malformed::Slot { slot: 3 });
        assert_eq!(damaged(|tree| tree.slots[7] = LightId::NONE), Malformed::Slot { slot: 7 });
        assert_eq!(damaged(|tree| tree.nodes.clear()), Malformed::Empty);
    }

    #[test]
    fn too_deep_is_found() {
        let light = LightBounds::point(Vec3::ZERO, 1.0);
        let mut tree = LightTree::build(&vec![light; 70], &BuildParams::median()).unwrap();
        // A comb: every left child is a leaf, every right one an inner node.
        let leaf = tree.nodes[tree.nodes.len() - 1];
        for i in 0..70u32 {
            let rest =
                crate::LightNode { first_item: i, item_count: 70 - i, intensity: (70 - i) as f32, ..leaf };
            let inner = if i < 69 { 2 * i + 1 } else { 0 };
            tree.nodes[2 * i as usize] = crate::LightNode { first_child: inner, ..rest };
            if i < 69 {
                tree.nodes[2 * i as usize + 1] = crate::LightNode { first_item: i, item_count: 1, ..leaf };
            }
        }
        assert!(matches!(tree.check(), Err(Malformed::TooDeep { .. })));
    }

    #[test]
    fn damage_to_a_perfect_tree_is_found() {
        for damage in [
            (|nodes| nodes[0].min[0] = 1.0) as fn(&mut [crate::PerfectNode]),
            |nodes| nodes[3].intensity += 1.0,
            |nodes| nodes[3].id += 1,
            |nodes| nodes.last_mut().unwrap().id = 0,
        ] {
            let mut tree = PerfectTree::build(&lights(), MortonBits::Thirty).unwrap();
            assert_eq!(tree.check(), Ok(()));
            damage(&mut tree.nodes);
            assert!(tree.check().is_err());
        }
    }
}
