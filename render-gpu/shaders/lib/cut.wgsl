// Twin of stochastic/src/cut.rs and stochastic/src/subtrees.rs: a cut of at most so many nodes, worst first, and one light or a few from each.
//
// Differs from them: no heap, but a search through the list, which is short; and so the list is left to right
// from the start.

// As in the code that Lin and Yuksel published.
const MOST_NODES: u32 = 32u;

var<private> cut_nodes: array<u32, MOST_NODES>;
var<private> cut_errors: array<f32, MOST_NODES>;
var<private> cut_length: u32;

// What a node of the cut may get wrong, relative to the intensity of all lights: 0 for leaves, and for what
// contributes nothing.
fn node_error(view: View, receiver: Receiver, id: u32, floor_squared: f32) -> f32 {
    if (depth_of(id) == header.depth) {
        return 0.0;
    }
    let node = nodes[index_of(id)];
    let box = toward(view, node.min, node.max);
    let scatter = receiver_scatter(receiver, box);
    if (!(scatter > 0.0)) {
        return 0.0;
    }
    // Neither infinite nor vanishing: those have to be told from 0.
    let error = node.intensity / nodes[0].intensity * scatter / max(max(box.near_squared, floor_squared), 1e-30);
    return clamp(error, 1e-37, 3e38);
}

// Refines from the root into `cut_nodes`.
fn select_cut(view: View, receiver: Receiver, most: u32, distance_floor: f32) {
    cut_length = 0u;
    if (header.len == 0u) {
        return;
    }
    let extent = (nodes[0].max - nodes[0].min) * view.scale;
    let floor_squared = 0.25 * dot(extent, extent) * distance_floor * distance_floor;
    cut_nodes[0] = 1u;
    cut_errors[0] = node_error(view, receiver, 1u, floor_squared);
    cut_length = 1u;
    loop {
        // The worst; of equal ones the one with the lowest id.
        var worst = 0u;
        for (var i = 1u; i < cut_length; i++) {
            let more = cut_errors[i] > cut_errors[worst];
            let as_much = cut_errors[i] == cut_errors[worst] && cut_nodes[i] < cut_nodes[worst];
            worst = select(worst, i, more || as_much);
        }
        if (!(cut_errors[worst] > 0.0)) {
            return;
        }
        let id = cut_nodes[worst];
        let child = 2u * id;
        let depth = depth_of(child);
        let two = child + 1u - (1u << depth) < level_size(depth);
        if (!two) {
            cut_nodes[worst] = child;
            cut_errors[worst] = node_error(view, receiver, child, floor_squared);
            continue;
        }
        if (cut_length + 1u > most) {
            return;
        }
        for (var i = cut_length; i > worst + 1u; i--) {
            cut_nodes[i] = cut_nodes[i - 1u];
            cut_errors[i] = cut_errors[i - 1u];
        }
        cut_nodes[worst] = child;
        cut_nodes[worst + 1u] = child + 1u;
        cut_errors[worst] = node_error(view, receiver, child, floor_squared);
        cut_errors[worst + 1u] = node_error(view, receiver, child + 1u, floor_squared);
        cut_length += 1u;
    }
}

// The first number of draw `slot` % `per_node` of subtree `slot` / `per_node`: stratified over all of them.
fn slot_start(offset: vec2u, slot: u32, all: u32, per_node: u32) -> vec2u {
    let stratum = wide_divide(0u, WIDE_MAX, per_node).quotient;
    let step = wide_divide(0u, WIDE_MAX, all).quotient;
    let of_draw = wide_scale(stratum, slot % per_node);
    return wide_add(wide_add(offset, of_draw), wide_scale(step, slot / per_node));
}
