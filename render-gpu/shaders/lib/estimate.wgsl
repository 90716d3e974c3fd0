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

// A receiver, prepared for one pass over all nodes.
struct Eye {
    at: vec3f,
    margin: f32,
    lobes: Lobes,
    everywhere: bool,
    // Not so far away that only intensities are left.
    near: bool,
}

fn eye_of(at: vec3f, lobes: Lobes) -> Eye {
    let reach = max(abs(at.x), max(abs(at.y), abs(at.z)));
    return Eye(at, ROUNDING * (1.0 + reach), lobes, all(lobes.normal == vec3f(0.0)), reach <= FARTHEST);
}

// Mean of the positive part of what is spread evenly between `h - e` and `h + e`, for `e` > 0.
fn mean_above(h: f32, e: f32) -> f32 {
    let part = max(h + e, 0.0);
    return select(0.25 * part * part / e, h, h >= e);
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
        // The lobe, spread over the directions to the box: as much lower as it is wider.
        let off = v * inverse - eye.lobes.axis;
        var half_sin_squared = 0.25 * dot(off, off);
        var scale = 4.0;
        var gate = 1.0;
        if (!eye.everywhere) {
            let aside = cross(eye.lobes.normal, off);
            let aside_squared = dot(aside, aside);
            let rise = max(dot(v, eye.lobes.normal) * inverse, 0.0) + dot(eye.lobes.normal, eye.lobes.axis);
            scale = max(aside_squared + rise * rise, LEAST_SUM);
            half_sin_squared = min(aside_squared / scale, 1.0);
            gate = clamp((height + around) / (2.0 * around), 0.0, 1.0);
        }
        let own = eye.lobes.width_squared;
        let width = min(own + node.radius_squared * inverse * inverse / scale, 1.0);
        let fall = width / (width + (1.0 - width) * half_sin_squared);
        scattered += eye.lobes.peak * (own / width) * fall * fall * gate;
    }
    if (!(scattered > 0.0)) {
        return 0.0;
    }
    // Of lights whose directions are not known the reference takes the mean over all normals, whose cosine profile reaches as far as the box is
    // high along its own axis, z.
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
