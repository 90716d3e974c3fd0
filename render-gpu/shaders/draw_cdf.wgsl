// Twin of stochastic/src/cut_cdf.rs: `SharedCut::select`, `NodeCdf` and `CutCdf`.
//
// `select_group_cuts`: one workgroup a block of pixels finds what its receivers have in common and refines
// the cut node by node, all threads looking for the worst. `draw_cdf`: one workgroup a block, one thread a
// pixel; nodes, but for the last of a long cut, are staged in workgroup memory, and each pixel passes over
// them twice: for the sum of their weights, and for cumulative probabilities, of which it keeps every eighth.
// A draw finds its eighth and passes over that again.

// For each block the length of its cut and its nodes.
@group(0) @binding(5) var<storage, read_write> cuts: array<u32>;
// For each block and node what was learned: samples drawn, and the sum of their squared ratios.
@group(0) @binding(6) var<storage, read_write> learned: array<vec2f>;
// For each entry what it is to be learned by.
@group(0) @binding(7) var<storage, read_write> tags: array<NodeTag>;

const THREADS: u32 = 64u;
// Most nodes of a cut, those of them whose records are staged in workgroup memory, of which there are 16 KiB,
// and of what one thread keeps every how many.
const MOST: u32 = 512u;
const STAGED: u32 = 384u;
const STRIDE: u32 = 8u;

// Pixels of a block, row by row within it.
struct Block {
    left: u32,
    top: u32,
    columns: u32,
    count: u32,
}

fn block_at(block: u32) -> Block {
    let columns = (params.width + params.block - 1u) / params.block;
    let left = block % columns * params.block;
    let top = block / columns * params.block;
    let wide = min(params.block, params.width - left);
    return Block(left, top, wide, wide * min(params.block, params.height - top));
}

fn pixel_of(block: Block, i: u32) -> u32 {
    return (block.top + i / block.columns) * params.width + block.left + i % block.columns;
}

fn blocks() -> u32 {
    return ((params.width + params.block - 1u) / params.block) * ((params.height + params.block - 1u) / params.block);
}

var<workgroup> group_low: array<vec3f, THREADS>;
var<workgroup> group_high: array<vec3f, THREADS>;
// Sum of normals, and their number.
var<workgroup> group_normal: array<vec4f, THREADS>;

// What the receivers of a block have in common; the number of them is in the fourth of the result's normal's
// place.
fn group_of(thread: u32, block: Block, space: Space) -> u32 {
    var low = vec3f(3e38);
    var high = vec3f(-3e38);
    var normal = vec4f(0.0);
    for (var i = thread; i < block.count; i += THREADS) {
        let receiver = receivers[pixel_of(block, i)];
        let position = receiver_position(receiver);
        if (all_finite(position)) {
            let at = place(space, position);
            low = min(low, at);
            high = max(high, at);
            normal += vec4f(receiver_lobes(receiver).normal, 1.0);
        }
    }
    group_low[thread] = low;
    group_high[thread] = high;
    group_normal[thread] = normal;
    workgroupBarrier();
    for (var width = THREADS / 2u; width > 0u; width /= 2u) {
        if (thread < width) {
            group_low[thread] = min(group_low[thread], group_low[thread + width]);
            group_high[thread] = max(group_high[thread], group_high[thread + width]);
            group_normal[thread] += group_normal[thread + width];
        }
        workgroupBarrier();
    }
    return u32(group_normal[0].w);
}

var<workgroup> ids: array<u32, MOST>;
var<workgroup> doubts: array<f32, MOST>;
var<workgroup> worst: array<vec2u, THREADS>;
var<workgroup> cut_count: u32;
var<workgroup> ended: u32;

// Whether a candidate (bits of its doubt, its id) goes before another: more doubt, or the lower id. Those of
// floats that are not negative order as the floats do.
fn is_worse(a: vec2u, b: vec2u) -> bool {
    return a.x > b.x || (a.x == b.x && a.y < b.y);
}

// Share of what the cut before has learned that a new one begins with.
override KEEP: f32 = 0.0;

var<workgroup> earlier_ids: array<u32, MOST>;
var<workgroup> earlier: array<vec2f, MOST>;

// What is known of a node from the cut before: what was learned of itself or of nodes below it, or its part
// of what was of the node above it.
fn kept(id: u32, count: u32) -> vec2f {
    let depth = depth_of(id);
    var sum = vec2f(0.0);
    for (var k = 0u; k < count; k++) {
        let other = earlier_ids[k];
        let other_depth = depth_of(other);
        if (other_depth >= depth) {
            sum += select(vec2f(0.0), earlier[k], other >> (other_depth - depth) == id);
        } else if (id >> (depth - other_depth) == other) {
            sum += earlier[k] / f32(1u << (depth - other_depth));
        }
    }
    return halved(KEEP * sum);
}

fn doubt_of(group: ReceiverGroup, space: Space, id: u32) -> f32 {
    if (depth_of(id) == header.depth) {
        return 0.0;
    }
    return doubt(group, node_record(space, nodes[index_of(id)], nodes[0].intensity));
}

@compute @workgroup_size(THREADS)
fn select_group_cuts(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let number = workgroup_index(workgroup, grid);
    if (number >= blocks()) {
        return;
    }
    let first = number * (params.nodes + 1u);
    if (header.len == 0u) {
        if (thread == 0u) {
            cuts[first] = 0u;
        }
        return;
    }
    let space = space_of(nodes[0]);
    let count = group_of(thread, block_at(number), space);
    let mean = group_normal[0].xyz / max(f32(count), 1.0);
    let group = ReceiverGroup(group_low[0], group_high[0], mean);
    if (thread == 0u) {
        ids[0] = 1u;
        doubts[0] = doubt_of(group, space, 1u);
        cut_count = u32(count > 0u);
        ended = u32(count == 0u);
    }
    loop {
        if (workgroupUniformLoad(&ended) == 1u) {
            break;
        }
        let nodes_now = workgroupUniformLoad(&cut_count);
        var own = vec2u(0u, NONE);
        var at = 0u;
        for (var i = thread; i < nodes_now; i += THREADS) {
            own = select(own, vec2u(bitcast<u32>(doubts[i]), ids[i]), is_worse(vec2u(bitcast<u32>(doubts[i]), ids[i]), own));
        }
        worst[thread] = own;
        workgroupBarrier();
        for (var width = THREADS / 2u; width > 0u; width /= 2u) {
            if (thread < width && is_worse(worst[thread + width], worst[thread])) {
                worst[thread] = worst[thread + width];
            }
            workgroupBarrier();
        }
        let chosen = worst[0];
        let child = 2u * chosen.y;
        let is_split = chosen.x > 0u;
        var two = false;
        if (is_split) {
            let depth = depth_of(child);
            two = child + 1u - (1u << depth) < level_size(depth);
        }
        let fits = is_split && (!two || nodes_now < params.nodes);
        // Whoever has it replaces it by its first child; the second goes to the end.
        for (var i = thread; i < nodes_now; i += THREADS) {
            if (fits && ids[i] == chosen.y) {
                ids[i] = child;
                doubts[i] = doubt_of(group, space, child);
            }
        }
        workgroupBarrier();
        if (thread == 0u) {
            if (fits && two) {
                ids[nodes_now] = child + 1u;
                doubts[nodes_now] = doubt_of(group, space, child + 1u);
                cut_count = nodes_now + 1u;
            }
            ended = u32(!fits);
        }
    }

    let all = workgroupUniformLoad(&cut_count);
    let learned_first = number * params.nodes;
    var known = 0u;
    if (KEEP > 0.0 && params.learn == 1u) {
        known = min(cuts[first], params.nodes);
        for (var i = thread; i < known; i += THREADS) {
            earlier_ids[i] = max(cuts[first + 1u + i], 1u);
            earlier[i] = learned[learned_first + i];
        }
    }
    workgroupBarrier();

    // Left to right: by the slot that each begins with.
    for (var i = thread; i < all; i += THREADS) {
        let own = first_slot(ids[i]);
        var before = 0u;
        for (var k = 0u; k < all; k++) {
            before += u32(first_slot(ids[k]) < own);
        }
        cuts[first + 1u + before] = ids[i];
        if (params.learn == 1u) {
            learned[learned_first + before] = kept(ids[i], known);
        }
    }
    if (thread == 0u) {
        cuts[first] = all;
    }
}

fn first_slot(id: u32) -> u32 {
    let depth = depth_of(id);
    return (id - (1u << depth)) << (header.depth - depth);
}

var<workgroup> records: array<NodeRecord, STAGED>;
// What was learned of each node: what its weight is multiplied by, about 1; 1 where nothing is.
var<workgroup> factors: array<f32, MOST>;
var<workgroup> sums: array<vec2f, THREADS>;

fn node_of(number: u32, i: u32) -> u32 {
    return cuts[number * (params.nodes + 1u) + 1u + i];
}

fn record_of(space: Space, number: u32, i: u32) -> NodeRecord {
    return node_record(space, nodes[index_of(node_of(number, i))], nodes[0].intensity);
}

// Node `i` of the block's cut. All threads ask for the same ones together, but for the few that a draw ends
// at.
fn record_at(space: Space, number: u32, i: u32) -> NodeRecord {
    if (i < STAGED) {
        return records[i];
    }
    return record_of(space, number, i);
}

// What is lent to a node by its neighbours in the cut, and to those by all nodes: in samples.
const NEIGHBOURS: u32 = 8u;
const OF_NEIGHBOURS: f32 = 2.0;
const OF_ALL: f32 = 4.0;

// Twin of stochastic/src/visibility.rs: `NodeLearning::factors`.
fn learn_factors(thread: u32, number: u32, count: u32) -> bool {
    let first = number * params.nodes;
    var own = vec2f(0.0);
    for (var i = thread; i < count; i += THREADS) {
        own += learned[first + i];
    }
    sums[thread] = own;
    workgroupBarrier();
    for (var width = THREADS / 2u; width > 0u; width /= 2u) {
        if (thread < width) {
            sums[thread] += sums[thread + width];
        }
        workgroupBarrier();
    }
    let all = sums[0];
    let mean = all.y / max(all.x, 1.0);
    let known = mean > 0.0 && is_finite(mean);
    for (var i = thread; i < count; i += THREADS) {
        if (known) {
            let group = i / NEIGHBOURS * NEIGHBOURS;
            var near = vec2f(0.0);
            for (var k = group; k < min(group + NEIGHBOURS, count); k++) {
                near += learned[first + k];
            }
            let lent = (near.y / mean + OF_ALL) / (near.x + OF_ALL);
            let one = learned[first + i];
            factors[i] = sqrt((one.y / mean + OF_NEIGHBOURS * lent) / (one.x + OF_NEIGHBOURS));
        }
    }
    return known;
}

// All probabilities sum up to this; floors take one part in so many, more where all nodes have them.
const WHOLE: u32 = 0x80000000u;
const FLOORS: u32 = 1024u;
const SHARED_FLOORS: u32 = 64u;

// What turns weights into probabilities.
struct Scale {
    total: f32,
    rest: f32,
    floor: u32,
    // Shares of the weight times its factor, and of the weight alone.
    learned: f32,
    plain: f32,
    // Nodes of weight 0 have the floor, too.
    everyone: bool,
}

fn mixed(scale: Scale, weight: f32, factor: f32) -> f32 {
    return weight * (scale.learned * factor + scale.plain);
}

// Probability of a node in 2^-31s, but for what rounding leaves to the last.
fn width_of(scale: Scale, weight: f32) -> u32 {
    let unit = scale.rest / scale.total;
    let share = select(weight / scale.total * scale.rest, weight * unit, scale.total > 1e-28);
    return u32(share) + select(0u, scale.floor, scale.everyone || weight > 0.0);
}

@compute @workgroup_size(THREADS)
fn draw_cdf(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let number = workgroup_index(workgroup, grid);
    if (number >= blocks()) {
        return;
    }
    let block = block_at(number);
    let space = space_of(nodes[0]);
    if (thread == 0u) {
        cut_count = cuts[number * (params.nodes + 1u)];
    }
    let count = workgroupUniformLoad(&cut_count);
    for (var i = thread; i < min(count, STAGED); i += THREADS) {
        records[i] = record_of(space, number, i);
    }
    for (var i = thread; i < count; i += THREADS) {
        factors[i] = 1.0;
    }
    var is_learned = false;
    if (params.learn == 1u) {
        is_learned = learn_factors(thread, number, count);
    }
    workgroupBarrier();
    for (var i = thread; i < block.count; i += THREADS) {
        draw_pixel(pixel_of(block, i), number, count, space, is_learned);
    }
}

fn in_order(low: vec4f, high: vec4f) -> f32 {
    return low.x + low.y + low.z + low.w + high.x + high.y + high.z + high.w;
}

fn draw_pixel(pixel: u32, number: u32, count: u32, space: Space, is_learned: bool) {
    let receiver = receivers[pixel];
    let position = receiver_position(receiver);
    let first = pixel * params.lights;
    var coarse: array<u32, MOST / STRIDE>;
    var scale = Scale(0.0, 0.0, 0u, 0.0, 1.0, is_learned);
    var last = NONE;
    let eye = eye_of(place(space, position), receiver_lobes(receiver));
    if (all_finite(position) && count > 0u) {
        // The sums of weights, eight at a time as the CPU adds them up, and of weights times factors.
        var low: array<vec4f, 2>;
        var high: array<vec4f, 2>;
        var rest = vec2f(0.0);
        var positive = 0u;
        for (var i = 0u; i < count; i++) {
            let weight = node_weight(eye, record_at(space, number, i));
            let both = vec2f(weight, weight * factors[i]);
            positive += u32(weight > 0.0);
            if (i >= count / 8u * 8u) {
                rest += both;
            } else if ((i & 4u) == 0u) {
                low[0][i & 3u] += both.x;
                low[1][i & 3u] += both.y;
            } else {
                high[0][i & 3u] += both.x;
                high[1][i & 3u] += both.y;
            }
        }
        let plain = in_order(low[0], high[0]) + rest.x;
        let with_factors = in_order(low[1], high[1]) + rest.y;
        scale.total = plain;
        // A share of what is drawn stays without learning.
        if (is_learned && with_factors > 0.0 && plain > 0.0) {
            scale.learned = (1.0 - params.defensive) * (plain / with_factors);
            scale.plain = params.defensive;
        }
        let drawable = select(positive, count, is_learned);
        if (drawable > 0u && plain > 0.0) {
            scale.floor = max(WHOLE / select(FLOORS, SHARED_FLOORS, is_learned) / drawable, 1u);
            let margin = (f32(count) / 8.0 + 16.0) * 1.1920929e-7;
            scale.rest = f32(WHOLE - drawable * scale.floor) * (1.0 - margin);
            var sum = 0u;
            for (var i = 0u; i < count; i++) {
                if (i % STRIDE == 0u) {
                    coarse[i / STRIDE] = sum;
                }
                let width = width_of(scale, mixed(scale, node_weight(eye, record_at(space, number, i)), factors[i]));
                sum += width;
                last = select(last, i, width > 0u);
            }
        }
    }

    let view = view_of(position);
    var decisions = Decisions(vec2u(0u), WIDE_MAX, random_new(params.seed, params.first_stream + pixel, params.index));
    for (var j = 0u; j < params.lights; j++) {
        var entry = NO_LIGHT;
        var tag = NodeTag(NONE, 0.0);
        if (last != NONE) {
            let within = decisions_stream_u64(&decisions);
            let value = wide_divide(j, within, params.lights).quotient;

            // The last of the eighths that begin at or before it, and in that the node.
            let at = value.x >> 1u;
            var part = 0u;
            for (var k = 1u; k * STRIDE <= last; k++) {
                part = select(part, k, coarse[k] <= at);
            }
            var node = part * STRIDE;
            var begin = coarse[part];
            var weight = 0.0;
            var width = 0u;
            for (; node <= last; node++) {
                weight = node_weight(eye, record_at(space, number, node));
                width = select(width_of(scale, mixed(scale, weight, factors[node])), WHOLE - begin, node == last);
                if (at - begin < width) {
                    break;
                }
                begin += width;
            }
            decisions.value = wide_sub(value, vec2u(begin << 1u, 0u));
            decisions.last = wide_sub(vec2u(width << 1u, 0u), vec2u(0u, 1u));
            let node_pmf = f32(width) * (1.0 / 2147483648.0);
            let sample = draw_light(node_of(number, node), view, receiver, &decisions);
            // What gives nothing was drawn as well.
            tag.node = node;
            if (sample.light != NONE) {
                let pmf = probability_times(sample.pmf, node_pmf);
                entry = WeightedLight(sample.light, probability_weight(pmf, f32(params.lights)));
                tag.scale = probability_weight(sample.pmf, weight);
            }
        }
        drawn[first + j] = entry;
        if (params.learn == 1u) {
            tags[first + j] = tag;
        }
    }
}
