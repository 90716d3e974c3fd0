// A node of a mesh's tree as an instance has it. Twin of `Frame::bounds` in stochastic/src/two_level/frame.rs, for nodes without directions.

// What rounding may move a point by, of the sum of all magnitudes that go into it, and then some.
const PLACING_ERROR: f32 = 4.7683716e-7;

// The box around the transformed box. The strength of an instance is the same for all its nodes and is left
// to those who compare instances.
fn in_world(instance: LightInstance, node: PerfectNode) -> PerfectNode {
    let center = 0.5 * node.min + 0.5 * node.max;
    let half = 0.5 * node.max - 0.5 * node.min;
    let x = along(instance.x, center, half);
    let y = along(instance.y, center, half);
    let z = along(instance.z, center, half);
    return PerfectNode(vec3f(x.x, y.x, z.x), node.intensity, vec3f(x.y, y.y, z.y), node.id);
}

// Lowest and highest coordinate along one axis of the world.
fn along(row: vec4f, center: vec3f, half: vec3f) -> vec2f {
    let weights = abs(row.xyz);
    let middle = row.x * center.x + row.y * center.y + row.z * center.z + row.w;
    let magnitude = weights.x * abs(center.x) + weights.y * abs(center.y) + weights.z * abs(center.z) + abs(row.w);
    let reach = weights.x * half.x + weights.y * half.y + weights.z * half.z;
    let away = reach + PLACING_ERROR * (magnitude + reach);
    return vec2f(middle - away, middle + away);
}
