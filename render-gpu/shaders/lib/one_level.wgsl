// Lights of a tree that has one level: a leaf is a light.

// One light from the subtree below a node.
fn draw_light(node: u32, view: View, receiver: Receiver, decisions: ptr<function, Decisions>) -> Drawn {
    return draw_below(node, view, receiver, decisions);
}
