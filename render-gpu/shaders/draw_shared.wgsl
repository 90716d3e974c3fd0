// Twin of stochastic/src/shared.rs: `BlockGrid::candidates`, and stochastic/src/interleave.rs.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, sections 3.3 and 3.4.
//
// `select_cuts`: one thread a block makes a cut for one of its pixels, drawn at random among those that show
// a surface. `draw_shared`: one thread a pixel draws from its part of its block's cut, or from that of a cut
// of its own where a guard does not admit it to its block's.

// For each block the length of its cut, the pixel that it was made for, and its nodes.
@group(0) @binding(5) var<storage, read_write> cuts: array<u32>;

// Keeps the numbers of blocks apart from those of pixels: `BLOCK_SALT` of src/draw.rs.
const BLOCK_SALT: u32 = 0x626c6f63u;

fn columns() -> u32 {
    return (params.width + params.block - 1u) / params.block;
}

// The pixel that speaks for a block, NONE if none shows a surface: the first in an order that is drawn.
fn representative(block: u32) -> u32 {
    let left = block % columns() * params.block;
    let top = block / columns() * params.block;
    let wide = min(params.block, params.width - left);
    let count = wide * min(params.block, params.height - top);
    let bits = select(32u - countLeadingZeros(count - 1u), 0u, count == 1u);
    let mask = (1u << bits) - 1u;
    var random = random_new(params.seed ^ BLOCK_SALT, block, params.index);
    var keys: array<vec2u, 4>;
    for (var i = 0u; i < 4u; i++) {
        let factor = random_u32(&random) | 1u;
        keys[i] = vec2u(factor, random_u32(&random));
    }
    let turn = wide_product(random_u32(&random), count).x;
    for (var i = 0u; i <= mask; i++) {
        var x = i;
        for (var k = 0u; k < 4u; k++) {
            x = (x * keys[k].x + keys[k].y) & mask;
            x ^= x >> (bits / 2u + 1u);
        }
        if (x >= count) {
            continue;
        }
        let at = (x + turn) % count;
        let pixel = (top + at / wide) * params.width + left + at % wide;
        if (all_finite(receiver_position(receivers[pixel]))) {
            return pixel;
        }
    }
    return NONE;
}

@compute @workgroup_size(64)
fn select_cuts(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let block = workgroup_index(workgroup, grid) * 64u + thread;
    if (block >= columns() * ((params.height + params.block - 1u) / params.block)) {
        return;
    }
    let pixel = representative(block);
    cut_length = 0u;
    if (pixel != NONE) {
        let receiver = receivers[pixel];
        select_cut(view_of(receiver_position(receiver)), receiver, params.nodes, params.distance_floor);
    }
    let first = block * (params.nodes + 2u);
    cuts[first] = cut_length;
    cuts[first + 1u] = pixel;
    for (var i = 0u; i < cut_length; i++) {
        cuts[first + 2u + i] = cut_nodes[i];
    }
}

@compute @workgroup_size(64)
fn draw_shared(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let i = workgroup_index(workgroup, grid) * 64u + thread;
    if (i >= params.receivers) {
        return;
    }
    let receiver = receivers[i];
    let position = receiver_position(receiver);
    let first = i * params.lights;
    var count = 0u;
    if (all_finite(position)) {
        let view = view_of(position);
        let x = i % params.width;
        let y = i / params.width;
        let cut = (y / params.block * columns() + x / params.block) * (params.nodes + 2u);
        let is_own = !is_admitted(receivers[cuts[cut + 1u]], receiver);
        if (is_own) {
            select_cut(view, receiver, params.nodes, params.distance_floor);
        }
        let length = select(cuts[cut], cut_length, is_own) * params.per_node;
        // This pixel's share of all draws.
        let parts = params.interleave * params.interleave;
        let within = (y % params.interleave) * params.interleave + x % params.interleave;
        let part = (within + params.index % parts) % parts;
        let start = part * length / parts;
        count = (part + 1u) * length / parts - start;
        var decisions = decisions_new(random_new(params.seed, params.first_stream + i, params.index));
        let offset = decisions_stream_u64(&decisions);
        for (var k = 0u; k < count; k++) {
            let slot = start + k;
            decisions_restart(&decisions, slot_start(offset, slot, length, params.per_node));
            let at = slot / params.per_node;
            let node = select(cuts[cut + 2u + at], cut_nodes[min(at, MOST_NODES - 1u)], is_own);
            let sample = draw_light(node, view, receiver, &decisions);
            var entry = NO_LIGHT;
            if (sample.light != NONE) {
                let weight = probability_weight(sample.pmf, f32(params.per_node));
                entry = WeightedLight(sample.light, weight * f32(parts));
            }
            drawn[first + k] = entry;
        }
    }
    for (var k = count; k < params.lights; k++) {
        drawn[first + k] = NO_LIGHT;
    }
}
