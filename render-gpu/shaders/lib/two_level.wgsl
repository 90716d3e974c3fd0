// Lights of a tree that has two levels: a leaf is an instance, which has its mesh's tree below it, whose nodes are taken to world space where a walk
// meets them.
//
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4. The reference is a walk of
// `lighttree::TreeSampler` over both levels as one tree in world space.

// One light from what is below a node of the tree over the instances.
fn draw_light(node: u32, view: View, receiver: Receiver, decisions: ptr<function, Decisions>) -> Drawn {
    let drawn = draw_below(node, view, receiver, decisions);
    if (drawn.light == NONE) {
        return drawn;
    }
    let instance = instances[drawn.light];
    let mesh = instance.mesh;
    let lights = mesh_headers[mesh].len;
    let deepest = mesh_headers[mesh].depth;
    var depth = 0u;
    var place = 0u;
    var pmf = drawn.pmf;
    var visited = drawn.visited;
    var random = *decisions;
    while (depth < deepest) {
        depth += 1u;
        place *= 2u;
        if (place + 1u >= ((lights - 1u) >> (deepest - depth)) + 1u) {
            continue;
        }
        visited += 2u;
        let first = instance.first_node + mesh_headers[mesh].starts[depth] + place;
        let fork = fork_between(
            view, receiver, in_world(instance, mesh_nodes[first]), in_world(instance, mesh_nodes[first + 1u])
        );
        if (fork.kind == DEAD) {
            *decisions = random;
            return Drawn(NONE, pmf, visited);
        }
        place += u32(goes_second(fork, &random, &pmf));
    }
    *decisions = random;
    let leaf = instance.first_node + mesh_headers[mesh].inner + place;
    return Drawn(instance.first_light + mesh_nodes[leaf].id, pmf, visited);
}
