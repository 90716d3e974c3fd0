// Twin of lighttree/src/perfect.rs: `leaf`, `parent`, and the way from a light to its slot.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.
//
// `leaves`: one thread a leaf. `levels`: one workgroup makes up to 9 levels above 512 nodes of one level, each once, in workgroup memory; so a
// million lights take three dispatches. The paper's threads each read all nodes of the source level below their own instead: no
// barriers, and more to read. `slots`: one thread a leaf tells the inner node with its light's number.

struct LevelGroup {
    // Levels between the leaves and the level that is read.
    height: u32,
}

@group(0) @binding(0) var<uniform> group: LevelGroup;
@group(0) @binding(1) var<storage, read> header: TreeHeader;
@group(0) @binding(2) var<storage, read> lights: array<LightRecord>;
// Two to a node: min and intensity, max and id.
@group(0) @binding(3) var<storage, read_write> nodes: array<vec4u>;

// The bits of a positive intensity as those of intensity / 2^exponent, rounded to nearest, ties to even, but not to nothing: on whole numbers, since what comes
// out may be below the normal numbers, which a device need not have.
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

var<workgroup> lows: array<vec4f, 256>;
var<workgroup> highs: array<vec4f, 256>;

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

@compute @workgroup_size(256)
fn levels(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let first = workgroup_index(workgroup, grid) * 256u;
    // The same for all threads: nothing is left to do.
    if (header.len < 2u || header.depth <= group.height || first >= level_size(header.depth - group.height - 1u)) {
        return;
    }
    let source = header.depth - group.height;

    // The first level from memory.
    var depth = source - 1u;
    let parent = first + thread;
    if (parent < level_size(depth)) {
        let child = header.starts[source] + 2u * parent;
        var box = read_node(child);
        if (2u * parent + 1u < level_size(source)) {
            box = joined(box, read_node(child + 1u));
        }
        write_node(header.starts[depth] + parent, box);
        lows[thread] = box.low;
        highs[thread] = box.high;
    }

    // The others from what the threads have.
    for (var width = 128u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if (depth == 0u) {
            break;
        }
        let below = level_size(depth);
        depth -= 1u;
        let node = first / (256u / width) + thread;
        var box: Box;
        let mine = thread < width && node < level_size(depth);
        if (mine) {
            box = Box(lows[2u * thread], highs[2u * thread]);
            if (2u * node + 1u < below) {
                box = joined(box, Box(lows[2u * thread + 1u], highs[2u * thread + 1u]));
            }
            write_node(header.starts[depth] + node, box);
        }
        workgroupBarrier();
        if (mine) {
            lows[thread] = box.low;
            highs[thread] = box.high;
        }
    }
}
