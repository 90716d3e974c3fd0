//! Interpolation in one pass from left to right that reads only levels and widths: Listings 1 and 2,
//! corrected.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 3.3. The inputs are walked along their
//! lowest edge, the mean level is gathered between *sync positions*, where two inputs end a node at the same
//! leaf, and nodes of that level are emitted as far as the sync position.
//!
//! Differs from the listings, each of which changes the result:
//! - the sum of levels is weighted by the width of the nodes, as text and formula have it and the listing has
//!   not;
//! - sum and width begin anew after a sync position, and are carried on only where a node that reaches beyond
//!   it was put off;
//! - the loops end *before* the end of the tree (`<` for `<=`);
//! - after a node is emitted, the least level that may come next is that of the largest node that begins at
//!   the next leaf, for left and right children alike; the listing takes the interpolated level for the one
//!   and keeps no memory between calls for the other;
//! - the width of the candidate is tested, not that of a node that was not emitted yet, and that candidate is
//!   evaluated;
//! - levels are rounded, and a level deeper than the leaf means the leaf;
//! - with one input, every node ends at a sync position.
//!
//! Always a valid cut, and identical inputs return themselves. Other than the canonical rule it may leave the
//! range between the coarsest and the finest input, and a mirrored tree does not give the mirrored cut.

use lighttree::{LightHierarchy, NodeId};

use crate::{FirstNodes, InputCut, Levels};

/// Interpolation from left to right, with its memory, which is kept from call to call.
#[derive(Debug, Default)]
pub struct Streaming {
    inputs: Vec<Cursor>,
}

/// Where an input is.
#[derive(Clone, Copy, Debug)]
struct Cursor {
    /// Index of the current node.
    at: usize,
    /// Lights up to the end of that node.
    end: u32,
    /// Its level.
    level: f32,
}

impl Streaming {
    /// Interpolates `inputs` with these weights into `nodes`, left to right; replaces what is in there.
    /// `levels` and `first` are those of `tree`.
    ///
    /// Weights need not sum to one, but at least one must be positive and none negative: otherwise any valid
    /// cut may come out.
    ///
    /// # Panics
    /// If there is no input or not one weight for each, or one of them is not a cut of `tree`.
    pub fn interpolate<T: LightHierarchy + ?Sized>(
        &mut self,
        tree: &T,
        levels: &Levels,
        first: &FirstNodes,
        inputs: &[InputCut<'_>],
        weights: &[f32],
        nodes: &mut Vec<NodeId>,
    ) {
        assert!(!inputs.is_empty(), "there must be a cut to interpolate from");
        assert_eq!(weights.len(), inputs.len(), "one weight per input");
        nodes.clear();
        let Some(root) = tree.root() else { return };
        let total = levels.at(tree.node_index(root)).lights;
        let weight_sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        let enter = |input: &InputCut<'_>, at: usize, begin: u32| {
            let &node = input.nodes.get(at).expect("all inputs must be cuts of this tree");
            let level = levels.at(tree.node_index(node));
            Cursor { at, end: begin + level.lights, level: level.level }
        };
        self.inputs.clear();
        self.inputs.extend(inputs.iter().map(|input| enter(input, 0, 0)));

        let (mut emitted, mut begin, mut sum, mut width) = (0, 0, 0.0, 0.0);
        while emitted < total {
            // Go along the lowest edge to the end of the nearest node.
            let end = self.inputs.iter().map(|cursor| cursor.end).min().unwrap_or(total);
            let mean = |cursors: &[Cursor]| -> f64 {
                cursors.iter().zip(weights).map(|(c, &w)| f64::from(c.level) * f64::from(w)).sum()
            };
            sum += mean(&self.inputs) / weight_sum * f64::from(end - begin);
            width += f64::from(end - begin);
            begin = end;

            // At a sync position, emit what is wholly to the left of it.
            let synced = self.inputs.iter().filter(|cursor| cursor.end == end).count();
            if synced > 1 || inputs.len() == 1 {
                let level = sum / width;
                while emitted < end {
                    let node = candidate(tree, levels, first.at(emitted), level);
                    let lights = levels.at(tree.node_index(node)).lights;
                    if emitted + lights > end {
                        break;
                    }
                    nodes.push(node);
                    emitted += lights;
                }
                if emitted == end {
                    (sum, width) = (0.0, 0.0);
                }
            }

            // Take up the next nodes.
            if end < total {
                for (cursor, input) in self.inputs.iter_mut().zip(inputs) {
                    if cursor.end == end {
                        *cursor = enter(input, cursor.at + 1, end);
                    }
                }
            }
        }
    }
}

/// The node of about this level, or of the next that there is, among those that begin where `first` does.
fn candidate<T: LightHierarchy + ?Sized>(tree: &T, levels: &Levels, first: NodeId, level: f64) -> NodeId {
    let mut node = first;
    loop {
        let children = tree.children(node);
        if children.is_empty() {
            return node;
        }
        // Halfway along this very path, so that the level of a node on it finds that node. For depths this is
        // `split`.
        let child = NodeId(children.start);
        let of = |node: NodeId| f64::from(levels.at(tree.node_index(node)).level);
        if level < 0.5 * (of(node) + of(child)) {
            return node;
        }
        node = child;
    }
}
