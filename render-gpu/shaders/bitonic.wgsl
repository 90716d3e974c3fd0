// Lights by their keys, as in the paper: Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.
// Batcher, "Sorting Networks and Their Applications", 1968.
//
// A key and its light's number are compared together, so that the order does not depend on the network.
// `pair` sets them up, filled up to a power of two with what goes last; `sort_local` sorts runs of 512; then
// runs are merged, twice as long each time: by `merge_global` while what is compared is far apart, then by
// `merge_local`.

struct Step {
    // Keys, filled up to a power of two.
    length: u32,
    // Length of the runs that are merged.
    run: u32,
    // Distance of the two that are compared.
    distance: u32,
}

@group(0) @binding(0) var<uniform> params: BuildParams;
@group(0) @binding(1) var<uniform> merging: Step;
@group(0) @binding(2) var<storage, read_write> words: array<u32>;

const THREADS: u32 = 256u;
// Keys of a workgroup.
const PAIRS: u32 = 512u;

// Ids are at the start, keys after where `morton` wrote its own.
fn load(at: u32) -> vec2u {
    return vec2u(words[at], words[4u * params.stride + at]);
}

fn store(at: u32, pair: vec2u) {
    words[at] = pair.x;
    words[4u * params.stride + at] = pair.y;
}

fn is_after(a: vec2u, b: vec2u) -> bool {
    return a.y > b.y || (a.y == b.y && a.x > b.x);
}

// The lower of the two places that a thread compares at this distance.
fn lower(thread: u32, distance: u32) -> u32 {
    return 2u * thread - (thread & (distance - 1u));
}

@compute @workgroup_size(THREADS)
fn pair(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let first = workgroup_index(workgroup, grid) * PAIRS + thread;
    for (var at = first; at < first + PAIRS; at += THREADS) {
        if (at < merging.length) {
            var key = LEFT_OUT;
            if (at < params.lights) {
                key = words[3u * params.stride + at];
            }
            store(at, vec2u(at, key));
        }
    }
}

var<workgroup> pairs: array<vec2u, PAIRS>;

fn load_block(thread: u32, first: u32) {
    for (var at = thread; at < PAIRS; at += THREADS) {
        var pair = vec2u(NONE, LEFT_OUT);
        if (first + at < merging.length) {
            pair = load(first + at);
        }
        pairs[at] = pair;
    }
    workgroupBarrier();
}

fn store_block(thread: u32, first: u32) {
    for (var at = thread; at < PAIRS; at += THREADS) {
        if (first + at < merging.length) {
            store(first + at, pairs[at]);
        }
    }
}

// One step within the block.
fn exchange(thread: u32, first: u32, run: u32, distance: u32) {
    let low = lower(thread, distance);
    let a = pairs[low];
    let b = pairs[low + distance];
    let ascending = ((first + low) & run) == 0u;
    if (is_after(a, b) == ascending) {
        pairs[low] = b;
        pairs[low + distance] = a;
    }
    workgroupBarrier();
}

@compute @workgroup_size(THREADS)
fn sort_local(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let first = workgroup_index(workgroup, grid) * PAIRS;
    load_block(thread, first);
    for (var run = 2u; run <= PAIRS; run *= 2u) {
        for (var distance = run / 2u; distance > 0u; distance /= 2u) {
            exchange(thread, first, run, distance);
        }
    }
    store_block(thread, first);
}

@compute @workgroup_size(THREADS)
fn merge_local(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let first = workgroup_index(workgroup, grid) * PAIRS;
    load_block(thread, first);
    for (var distance = PAIRS / 2u; distance > 0u; distance /= 2u) {
        exchange(thread, first, merging.run, distance);
    }
    store_block(thread, first);
}

@compute @workgroup_size(THREADS)
fn merge_global(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let low = lower(workgroup_index(workgroup, grid) * THREADS + thread, merging.distance);
    let high = low + merging.distance;
    if (high >= merging.length) {
        return;
    }
    let a = load(low);
    let b = load(high);
    let ascending = (low & merging.run) == 0u;
    if (is_after(a, b) == ascending) {
        store(low, b);
        store(high, a);
    }
}
