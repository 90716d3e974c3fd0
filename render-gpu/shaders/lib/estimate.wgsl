// Twin of stochastic/src/node_estimate.rs, for nodes without directions, and of `ReceiverGroup::doubt` and `NodeCdf` in stochastic/src/cut_cdf.rs.
// There everything is explained.

// Coordinates in which all lights are about 1 across, around 0.
struct Space {
    origin: vec3f,
    // A power of two.
    scale: f32,
}

fn space_of(root: PerfectNode) -> Space {
    let extent = root.max - root.min;
    let size = max(extent.x, max(extent.y, extent.z));
    let exponent = clamp(bitcast<u32>(size) >> 23u, 1u, 253u);
    let scale = select(1.0, bitcast<f32>((254u - exponent) << 23u), size > 0.0);
    let half = vec3f(0.5);
    return Space(fma(root.min, half, half * root.max), scale);
}

fn place(space: Space, position: vec3f) -> vec3f {
    return (position - space.origin) * space.scale;
}

// A node as it is estimated: half the box's sides, and its share of all intensity.
struct NodeRecord {
    center: vec3f,
    intensity: f32,
    half: vec3f,
    radius_squared: f32,
}

const LEAST: f32 = 1.1754944e-38;

fn node_record(space: Space, node: PerfectNode, all: f32) -> NodeRecord {
    let low = place(space, node.min);
    let high = place(space, node.max);
    let half = 0.5 * (high - low);
    return NodeRecord(0.5 * (low + high), max(node.intensity / all, LEAST), half, dot(half, half));
}

// Rounding of a coordinate near 1, and then some.
const ROUNDING: f32 = 4.7683716e-7;
// Places farther away than this many times the size of all lights see them as one point.
const FARTHEST: f32 = 1e9;

// The least length of an axis along the surface that has a direction.
const LEAST_ALONG: f32 = 1e-6;

// A receiver, prepared for one pass over all nodes.
struct Eye {
    at: vec3f,
    margin: f32,
    lobes: Lobes,
    // Unit: perpendicular to the normal and the lobe's axis, and that axis as it is along the surface.
    sideways: vec3f,
    forward: vec3f,
    everywhere: bool,
    // Not so far away that only intensities are left.
    near: bool,
}

fn eye_of(at: vec3f, lobes: Lobes) -> Eye {
    let reach = max(abs(at.x), max(abs(at.y), abs(at.z)));
    let everywhere = all(lobes.normal == vec3f(0.0));
    let along = lobes.axis - lobes.normal * dot(lobes.normal, lobes.axis);
    let length = length(along);
    let is_oblique = !everywhere && length > LEAST_ALONG;
    let upward = select(lobes.normal, lobes.axis, everywhere);
    let forward = select(perpendicular(upward), along / max(length, LEAST), is_oblique);
    let sideways = cross(upward, forward);
    return Eye(at, ROUNDING * (1.0 + reach), lobes, sideways, forward, everywhere, reach <= FARTHEST);
}

// Mean of the positive part of what is spread evenly between `h - e` and `h + e`, for `e` > 0.
fn mean_above(h: f32, e: f32) -> f32 {
    let part = max(h + e, 0.0);
    return select(0.25 * part * part / e, h, h >= e);
}

// About the mean of the lobe over the directions to a box around v, the inverse of whose distance is given.
fn lobe_of(eye: Eye, v: vec3f, half: vec3f, inverse: f32) -> f32 {
    let axis = eye.lobes.axis;
    let off = v * inverse - axis;
    let sideways = dot(off, eye.sideways);
    let sideways_squared = sideways * sideways;
    var upright_squared = max(dot(off, off) - sideways_squared, 0.0);
    var per_sum = 0.25;
    if (!eye.everywhere) {
        let forward = dot(off, eye.forward);
        let height = max(dot(v, eye.lobes.normal) * inverse, 0.0) + dot(eye.lobes.normal, axis);
        upright_squared = forward * forward;
        per_sum = 1.0 / max(sideways_squared + upright_squared + height * height, LEAST_SUM);
    }
    // Squared widths, in half vectors.
    let own = eye.lobes.width_squared;
    let wide = dot(half, abs(eye.sideways)) * inverse;
    let high = dot(half, abs(cross(eye.sideways, axis))) * inverse;
    let across = min(own + wide * wide * per_sum, 1.0);
    let up = min(own + 0.25 * high * high, 1.0);
    let falling = sideways_squared * (1.0 - across) / across + upright_squared * (1.0 - up) / up;
    let fall = 1.0 / (1.0 + per_sum * falling);
    return eye.lobes.peak * own / sqrt(across * up) * fall * fall;
}

// A unit vector perpendicular to a unit vector.
fn perpendicular(n: vec3f) -> vec3f {
    let sign = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (sign + n.z);
    return vec3f(n.x * n.y * a, sign + n.y * n.y * a, -n.y);
}

// About what a node sends to the receiver, up to a factor of all; 0 only if it sends nothing.
fn node_weight(eye: Eye, node: NodeRecord) -> f32 {
    if (!eye.near) {
        return node.intensity;
    }
    let v = node.center - eye.at;
    let squared = dot(v, v);
    let reach = sqrt(squared) + sqrt(node.radius_squared);
    let inverse = 1.0 / sqrt(max(max(squared, 0.5 * node.radius_squared), LEAST));
    let spread = eye.margin + ROUNDING * reach;

    var above = 1.0;
    var height = 1.0;
    var around = 1.0;
    if (!eye.everywhere) {
        height = dot(v, eye.lobes.normal);
        around = dot(node.half, abs(eye.lobes.normal)) + spread;
        above = mean_above(height, around) * inverse;
    }
    var scattered = min(above, 1.0) * eye.lobes.diffuse;
    if (eye.lobes.peak > 0.0) {
        let gate = select(clamp((height + around) / (2.0 * around), 0.0, 1.0), 1.0, eye.everywhere);
        scattered += lobe_of(eye, v, node.half, inverse) * gate;
    }
    if (!(scattered > 0.0)) {
        return 0.0;
    }
    // Of lights whose directions are not known the reference takes the mean over all normals, whose cosine
    // profile reaches as far as the box is high along its own axis, z.
    let emitted = clamp(0.25 * (node.half.z + spread + sqrt(squared)) * inverse, 1e-3, 1.0);
    // Never so much that a sum of them is beyond f32.
    return clamp(node.intensity * emitted * scattered * inverse * inverse, LEAST, 1e35);
}

// Receivers that share a cut, placed.
struct ReceiverGroup {
    low: vec3f,
    high: vec3f,
    mean_normal: vec3f,
}

// How much the choice of a light below a node matters to the group.
fn doubt(group: ReceiverGroup, node: NodeRecord) -> f32 {
    let gap = max(max(node.center - node.half - group.high, group.low - node.center - node.half), vec3f(0.0));
    let gap_squared = dot(gap, gap);
    let between = node.center - 0.5 * (group.low + group.high);
    let distance = length(between);
    let size = sqrt(node.radius_squared) + 0.5 * length(group.high - group.low);
    var at_receiver = 1.0;
    if (any(group.mean_normal != vec3f(0.0))) {
        let loose = 1.0 - min(length(group.mean_normal), 1.0);
        let nearest = dot(group.mean_normal, between) + size;
        // Boxes without extent in the same place: no split tells their lights apart.
        if (distance == 0.0 && nearest == 0.0) {
            return 0.0;
        }
        at_receiver = clamp(nearest / max(distance, LEAST) + 2.0 * loose, 0.0, 1.0);
    }
    if (at_receiver == 0.0) {
        return 0.0;
    }
    let sent = node.intensity * at_receiver / max(max(gap_squared, 0.25 * node.radius_squared), 1e-35);
    let share = select(1.0, node.radius_squared / gap_squared, gap_squared > node.radius_squared);
    return min(sent * share, 3e38);
}
