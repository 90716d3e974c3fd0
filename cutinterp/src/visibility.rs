//! Visibility of the nodes of a cut, from cuts whose nodes were tested with shadow rays.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 3.3, interpolate visibility "along with
//! the nodes' levels" and do not say how, where an output node covers several input nodes or only a part of
//! one. Here an input's visibility of a node is the mean over the lights below it, weighted by their
//! intensity: the share of the light that is seen.

use lighttree::{LightHierarchy, NodeId};

use crate::{InputCut, Levels};

/// The visibility of each node of the cut `nodes` as the inputs have it, averaged with `weights`; in [0, 1].
/// Replaces what is in `visibility`.
///
/// For cuts of any origin, such as [`Streaming`](crate::Streaming)'s; [`MergedCuts`](crate::MergedCuts) has
/// the same numbers at hand. `levels` are those of `tree`. Weights need not sum to one, but at least one must
/// be positive and none negative.
///
/// # Panics
/// If there is not one weight per input, or `nodes` or an input is not a cut of `tree`.
pub fn interpolate_visibility<T: LightHierarchy + ?Sized>(
    tree: &T,
    levels: &Levels,
    inputs: &[InputCut<'_>],
    weights: &[f32],
    nodes: &[NodeId],
    visibility: &mut Vec<f32>,
) {
    assert_eq!(weights.len(), inputs.len(), "one weight per input");
    let weight_sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let entry = |node: NodeId| levels.at(tree.node_index(node));
    visibility.clear();
    visibility.resize(nodes.len(), 0.0);
    for (input, &weight) in inputs.iter().zip(weights) {
        let part = f64::from(weight) / weight_sum;
        // Walk both cuts by the slots up to which they have come.
        let (mut from, mut end) = (0, 0u32);
        let mut next = 0;
        for (&node, visibility) in nodes.iter().zip(visibility.iter_mut()) {
            let begin = from;
            from += entry(node).lights;
            if end >= from {
                // The input node that was entered last covers this one too.
                *visibility += if input.sees(next - 1) { part as f32 } else { 0.0 };
                continue;
            }
            assert!(end == begin, "all must be cuts of this tree");
            let (mut seen, mut all) = (0.0, 0.0);
            while end < from {
                let &covered = input.nodes.get(next).expect("all must be cuts of this tree");
                let intensity = f64::from(entry(covered).intensity);
                all += intensity;
                seen += if input.sees(next) { intensity } else { 0.0 };
                end += entry(covered).lights;
                next += 1;
            }
            *visibility += if all > 0.0 { (seen / all * part) as f32 } else { 0.0 };
        }
    }
    // The parts sum to one but for rounding.
    visibility.iter_mut().for_each(|v| *v = v.min(1.0));
}
