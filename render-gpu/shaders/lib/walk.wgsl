// Twin of lighttree/src/walk.rs: `sample_below`, `pmf_below` and the choice between two children, on the perfect tree that the kernel
// binds as `header` and `nodes`.

// How the probabilities of two children follow from their bounds: `ChildChoice`.
override CHILD_CHOICE: u32 = 0u;
const MIN_MAX_AVERAGE: u32 = 0u;
const YUKSEL_2019: u32 = 1u;
const CENTER: u32 = 2u;
const UPPER: u32 = 3u;

// Neither of two children that may contribute is less probable than this many 2^-32s.
const FLOOR: u32 = 65536u;

// Number of nodes at a depth, of a tree that has lights.
fn level_size(depth: u32) -> u32 {
    return ((header.len - 1u) >> (header.depth - depth)) + 1u;
}

// Depth of a node of this id; ids are those of a heap, the root is 1.
fn depth_of(id: u32) -> u32 {
    return firstLeadingBit(id);
}

// Index of a node in `nodes`.
fn index_of(id: u32) -> u32 {
    let depth = depth_of(id);
    return header.starts[depth] + id - (1u << depth);
}

fn view_of(position: vec3f) -> View {
    return view_from(position, nodes[0].min, nodes[0].max);
}

// What decides between two children; lengths scaled.
struct Weighed {
    intensity: f32,
    scatter: f32,
    near_squared: f32,
    far_squared: f32,
    // Doubled lengths.
    center_squared: f32,
    diagonal_squared: f32,
}

fn weigh(view: View, receiver: Receiver, node: PerfectNode) -> Weighed {
    let box = toward(view, node.min, node.max);
    let center = box.low + box.high;
    let diagonal = box.high - box.low;
    return Weighed(
        node.intensity,
        receiver_scatter(receiver, box),
        select(0.0, max(box.near_squared, view.least_squared), box.near_squared > 0.0),
        max(box.far_squared, view.least_squared),
        dot(center, center),
        dot(diagonal, diagonal),
    );
}

// a / (a + b), 1/2 where both vanish.
fn fraction(a: f32, b: f32) -> f32 {
    let sum = a + b;
    return select(0.5, a / sum, sum > 0.0);
}

// Probability of the first of two that may both contribute. Strengths are relative to the larger of each
// factor, so that no product is beyond f32; one that vanishes has the floor.
fn first_probability(a: Weighed, b: Weighed, least_squared: f32) -> f32 {
    let most = max(a.intensity, b.intensity);
    let highest = max(a.scatter, b.scatter);
    let w_a = (a.intensity / most) * (a.scatter / highest);
    let w_b = (b.intensity / most) * (b.scatter / highest);
    let inside_both = a.near_squared == 0.0 && b.near_squared == 0.0;
    let near_a = select(a.near_squared, 1.0, inside_both);
    let near_b = select(b.near_squared, 1.0, inside_both);
    let near = fraction(w_a * near_b, w_b * near_a);
    if (CHILD_CHOICE == MIN_MAX_AVERAGE) {
        return 0.5 * (near + fraction(w_a * b.far_squared, w_b * a.far_squared));
    }
    if (CHILD_CHOICE == CENTER) {
        let of_a = max(0.25 * a.center_squared, least_squared);
        let of_b = max(0.25 * b.center_squared, least_squared);
        return fraction(w_a * of_b, w_b * of_a);
    }
    if (CHILD_CHOICE == YUKSEL_2019) {
        let is_close = a.near_squared < a.diagonal_squared || b.near_squared < b.diagonal_squared;
        return select(near, fraction(w_a, w_b), is_close);
    }
    return near;
}

// What can become of two children: neither contributes, only one does, or the first with probability q /
// 2^32.
struct Fork {
    kind: u32,
    q: u32,
}

const DEAD: u32 = 0u;
const ONLY_FIRST: u32 = 1u;
const ONLY_SECOND: u32 = 2u;
const EITHER: u32 = 3u;

fn fork(view: View, receiver: Receiver, first_index: u32) -> Fork {
    return fork_between(view, receiver, nodes[first_index], nodes[first_index + 1u]);
}

fn fork_between(view: View, receiver: Receiver, first: PerfectNode, second: PerfectNode) -> Fork {
    let a = weigh(view, receiver, first);
    let b = weigh(view, receiver, second);
    let kind = select(0u, ONLY_FIRST, a.scatter > 0.0) | select(0u, ONLY_SECOND, b.scatter > 0.0);
    if (kind != EITHER) {
        return Fork(kind, 0u);
    }
    return Fork(EITHER, quantized(first_probability(a, b, view.least_squared), FLOOR));
}

// Where a walk goes at a fork that is not dead: whether to the second, with `pmf` multiplied by the
// probability of that.
fn goes_second(fork: Fork, random: ptr<function, Decisions>, pmf: ptr<function, Probability>) -> bool {
    if (fork.kind != EITHER) {
        return fork.kind == ONLY_SECOND;
    }
    let second = !choose(random, fork.q);
    // 2^32 - q, modulo 2^32, is the second's.
    *pmf = probability_times(*pmf, probability_of(select(fork.q, 0u - fork.q, second)));
    return second;
}

struct Drawn {
    // NONE where it is certain that what was drawn contributes nothing.
    light: u32,
    pmf: Probability,
    // Nodes looked at.
    visited: u32,
}

// One light from the subtree below a node.
fn draw_below(node: u32, view: View, receiver: Receiver, decisions: ptr<function, Decisions>) -> Drawn {
    var depth = depth_of(node);
    var place = node - (1u << depth);
    var pmf = Probability(1.0, 0);
    var visited = 0u;
    // Its own copy: what is reached through a pointer may not be kept in registers.
    var random = *decisions;
    while (depth < header.depth) {
        depth += 1u;
        place *= 2u;
        if (place + 1u >= level_size(depth)) {
            continue;
        }
        visited += 2u;
        let fork = fork(view, receiver, header.starts[depth] + place);
        if (fork.kind == DEAD) {
            *decisions = random;
            return Drawn(NONE, pmf, visited);
        }
        place += u32(goes_second(fork, &random, &pmf));
    }
    *decisions = random;
    return Drawn(nodes[header.inner + place].id, pmf, visited);
}

// The slot of a light; NONE if it is not in the tree.
fn slot_of(light: u32) -> u32 {
    if (light < header.inner) {
        return nodes[light].id;
    }
    let late = light - header.inner;
    let all = header.len + header.dropped + header.invalid;
    if (light >= all) {
        return NONE;
    }
    // After the nodes there is a word for each light that has no inner node.
    let index = header.inner + header.len + late / 8u;
    let words = nodes[index];
    let low = vec4u(bitcast<vec3u>(words.min), bitcast<u32>(words.intensity));
    let high = vec4u(bitcast<vec3u>(words.max), words.id);
    return select(low, high, (late % 8u) >= 4u)[late % 4u];
}

// Probability with which `draw_below` draws the light of a slot, within the subtree; 0 for one that is not
// there.
fn pmf_below(node: u32, view: View, receiver: Receiver, slot: u32) -> Probability {
    var depth = depth_of(node);
    var pmf = Probability(1.0, 0);
    if (slot >= header.len || (slot >> (header.depth - depth)) != node - (1u << depth)) {
        return Probability(0.0, 0);
    }
    while (depth < header.depth) {
        depth += 1u;
        let place = slot >> (header.depth - depth);
        let first = place & 0xfffffffeu;
        if (first + 1u >= level_size(depth)) {
            continue;
        }
        let second = (place & 1u) == 1u;
        let fork = fork(view, receiver, header.starts[depth] + first);
        if (fork.kind == EITHER) {
            pmf = probability_times(pmf, probability_of(select(fork.q, 0u - fork.q, second)));
        } else if (fork.kind != select(ONLY_FIRST, ONLY_SECOND, second)) {
            return Probability(0.0, 0);
        }
    }
    return pmf;
}
