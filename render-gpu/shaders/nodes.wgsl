// Twin of lighttree/src/perfect.rs: `leaf`, `parent`, and the way from a light to its slot.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.
//
// `leaves`: one thread a leaf. `levels`: one workgroup makes up to 9 levels above 512 nodes of one level,
// each once: three by threads with 8 nodes (256 bytes) of their own, six in workgroup memory; so a million
// lights take three dispatches. The paper's threads each read all nodes of the source level below their own
// instead: no barriers, and more to read. `slots`: one thread a leaf tells the inner node with its light's
// number.

struct LevelGroup {
    // Levels between the leaves and the level that is read.
    height: u32,
}

@group(0) @binding(0) var<uniform> group: LevelGroup;
@group(0) @binding(1) var<storage, read> header: TreeHeader;
@group(0) @binding(2) var<storage, read> lights: array<LightRecord>;
// Two to a node: min and intensity, max and id.
@group(0) @binding(3) var<storage, read_write> nodes: array<vec4u>;

// The bits of a positive intensity as those of intensity / 2^exponent, rounded to nearest, ties to even, but
// not to nothing: on whole numbers, since what comes out may be below the normal numbers, which a device need
// not have.
fn in_units(bits: u32, exponent: u32) -> u32 {
    if (exponent == 0u) {
        return bits;
    }
    let biased = bits >> 23u;
    if (biased > exponent) {
        return bits - (exponent << 23u);
    }
    // Down by so many places, of a mantissa whose unit is the least there is.
    let mantissa = select(bits & 0x7fffffu, (bits & 0x7fffffu) | 0x800000u, biased > 0u);
    let shift = exponent - max(biased, 1u) + 1u;
    if (shift > 25u) {
        return 1u;
    }
    let kept = mantissa >> shift;
    let rest = mantissa & ((1u << shift) - 1u);
    let middle = 1u << (shift - 1u);
    let up = rest > middle || (rest == middle && (kept & 1u) == 1u);
    return max(kept + u32(up), 1u);
}

fn late_slot(light: u32, slot: u32) {
    let late = light - header.inner;
    nodes[2u * (header.inner + header.len) + late / 4u][late % 4u] = slot;
}

@compute @workgroup_size(256)
fn leaves(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let slot = workgroup_index(workgroup, grid) * 256u + thread;
    // Lights that no inner node has the number of have their slots after all nodes.
    if (slot >= header.inner && slot < header.len + header.dropped + header.invalid) {
        late_slot(slot, NONE);
    }
    if (slot >= header.len) {
        return;
    }
    let id = nodes[slot / 4u][slot % 4u];
    let light = lights[id];
    let intensity = in_units(bitcast<u32>(light.intensity), header.unit_exponent);
    let at = 2u * (header.inner + slot);
    nodes[at] = vec4u(bitcast<vec3u>(light.min), intensity);
    nodes[at + 1u] = vec4u(bitcast<vec3u>(light.max), id);
}

@compute @workgroup_size(256)
fn slots(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let slot = workgroup_index(workgroup, grid) * 256u + thread;
    if (slot >= header.len) {
        return;
    }
    let light = nodes[2u * (header.inner + slot) + 1u].w;
    if (light < header.inner) {
        nodes[2u * light + 1u].w = slot;
    } else {
        late_slot(light, slot);
    }
}

struct Box {
    low: vec4f,
    high: vec4f,
}

// Of two zeros of different sign the second, as the CPU's instruction has it; the fourth of `low` is a sum.
fn joined(a: Box, b: Box) -> Box {
    let low = select(b.low.xyz, a.low.xyz, a.low.xyz < b.low.xyz);
    let high = select(b.high.xyz, a.high.xyz, a.high.xyz > b.high.xyz);
    return Box(vec4f(low, a.low.w + b.low.w), vec4f(high, 0.0));
}

fn write_node(index: u32, box: Box) {
    nodes[2u * index] = bitcast<vec4u>(box.low);
    nodes[2u * index + 1u] = vec4u(bitcast<vec3u>(box.high.xyz), NONE);
}

fn read_node(index: u32) -> Box {
    return Box(bitcast<vec4f>(nodes[2u * index]), vec4f(bitcast<vec3f>(nodes[2u * index + 1u].xyz), 0.0));
}

// Number of nodes at a depth, of a tree that has lights.
fn level_size(depth: u32) -> u32 {
    return ((header.len - 1u) >> (header.depth - depth)) + 1u;
}

// Writes the parent of two nodes that follow one another, or of one where the level ends between them.
fn make_parent(depth: u32, node: u32, left: Box, right: Box) -> Box {
    var box = left;
    if (2u * node + 1u < level_size(depth + 1u)) {
        box = joined(left, right);
    }
    if (node < level_size(depth)) {
        write_node(header.starts[depth] + node, box);
    }
    return box;
}

// The node above these two.
fn above_two(depth: u32, node: u32) -> Box {
    var left: Box;
    var right: Box;
    let first = header.starts[depth + 1u] + 2u * node;
    if (2u * node + 1u < level_size(depth + 1u)) {
        right = read_node(first + 1u);
    }
    if (node < level_size(depth)) {
        left = read_node(first);
    }
    return make_parent(depth, node, left, right);
}

// What is above four nodes, or above the first two where that is the root.
fn above_four(source: u32, first: u32) -> Box {
    let left = above_two(source - 1u, first / 2u);
    let right = above_two(source - 1u, first / 2u + 1u);
    if (source == 1u) {
        return left;
    }
    return make_parent(source - 2u, first / 4u, left, right);
}

fn above_eight(source: u32, first: u32) -> Box {
    let left = above_four(source, first);
    let right = above_four(source, first + 4u);
    if (source <= 2u) {
        return left;
    }
    return make_parent(source - 3u, first / 8u, left, right);
}

const THREADS: u32 = 64u;
// A level of w nodes lies from w on.
var<workgroup> lows: array<vec4f, 128>;
var<workgroup> highs: array<vec4f, 128>;

@compute @workgroup_size(THREADS)
fn levels(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let part = workgroup_index(workgroup, grid);
    let first = part * 8u * THREADS;
    // The same for all threads: nothing is left to do.
    if (header.len < 2u || header.depth <= group.height || first >= level_size(header.depth - group.height)) {
        return;
    }
    let source = header.depth - group.height;

    // Three levels by each thread for itself.
    var box = above_eight(source, first + 8u * thread);

    // The others from what the threads have: a barrier for each.
    var depth = max(source, 3u) - 3u;
    for (var width = THREADS; width > 1u && depth > 0u; width /= 2u) {
        if (thread < width) {
            lows[width + thread] = box.low;
            highs[width + thread] = box.high;
        }
        workgroupBarrier();
        depth -= 1u;
        if (thread < width / 2u) {
            let at = width + 2u * thread;
            let left = Box(lows[at], highs[at]);
            let right = Box(lows[at + 1u], highs[at + 1u]);
            box = make_parent(depth, part * (width / 2u) + thread, left, right);
        }
    }
}
