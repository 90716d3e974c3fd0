// Twin of lighttree/src/build/radix.rs: a stable sort by the least significant digit first.
// Satish, Harris and Garland, "Designing Efficient Sorting Algorithms for Manycore GPUs", 2009.
//
// Three dispatches for each digit of 6 bits: `count` how often each occurs in each block of keys (`morton`
// has done that for the first digit), `scan` where each block's share begins, `scatter` blocks, sorted in
// workgroup memory, so that what goes to one place is written side by side. A thread owns 16 keys that follow
// one another, and its own counters: that keeps equal keys in order without atomics. It reads them by four:
// 16 bytes at a time.

@group(0) @binding(0) var<uniform> params: BuildParams;
@group(0) @binding(1) var<uniform> sorting: SortPass;
@group(0) @binding(2) var<storage, read> header: TreeHeader;
@group(0) @binding(3) var<storage, read_write> words: array<vec4u>;

const THREADS: u32 = 64u;
// Fours of keys.
const FOURS: u32 = 4u;

fn word(at: u32) -> u32 {
    return words[at / 4u][at % 4u];
}

fn set_word(at: u32, value: u32) {
    words[at / 4u][at % 4u] = value;
}

fn digit(key: u32) -> u32 {
    return (key >> sorting.shift) & (DIGITS - 1u);
}

// Keys that the pass reads.
fn length() -> u32 {
    return select(header.len, params.lights, sorting.first == 1u);
}

// Four keys from `at` on, a multiple of 4; what is at `end` or behind it is left out.
fn read_keys(at: u32, end: u32) -> vec4u {
    let there = vec4u(at) + vec4u(0u, 1u, 2u, 3u) < vec4u(end);
    var keys = vec4u(LEFT_OUT);
    if (at < end) {
        keys = select(keys, words[(sorting.from_keys + at) / 4u], there);
    }
    return keys;
}

var<workgroup> histogram: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(THREADS)
fn count(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let block = workgroup_index(workgroup, grid);
    let end = length();
    atomicStore(&histogram[thread], 0u);
    workgroupBarrier();
    for (var i = 0u; i < FOURS; i++) {
        let keys = read_keys(block * BLOCK + 4u * (i * THREADS + thread), end);
        for (var j = 0u; j < 4u; j++) {
            if (keys[j] != LEFT_OUT) {
                atomicAdd(&histogram[digit(keys[j])], 1u);
            }
        }
    }
    workgroupBarrier();
    if (block < params.blocks) {
        set_word(table(params, thread, block), atomicLoad(&histogram[thread]));
    }
}

var<workgroup> sums: array<vec2u, THREADS>;
var<workgroup> eighths: array<vec2u, 8>;

// The sum of what all threads before this one have.
fn sum_before(thread: u32, own: vec2u) -> vec2u {
    sums[thread] = own;
    workgroupBarrier();
    if (thread < 8u) {
        var sum = vec2u(0u);
        for (var i = 8u * thread; i < 8u * thread + 8u; i++) {
            sum += sums[i];
        }
        eighths[thread] = sum;
    }
    workgroupBarrier();
    var sum = vec2u(0u);
    for (var i = 0u; i < thread / 8u; i++) {
        sum += eighths[i];
    }
    for (var i = thread & 56u; i < thread; i++) {
        sum += sums[i];
    }
    return sum;
}

// One workgroup a digit: each thread adds up a part of the row, and the sums before it say where that begins.
@compute @workgroup_size(THREADS)
fn scan(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) workgroup: vec3u) {
    let blocks = (length() + BLOCK - 1u) / BLOCK;
    let part = (blocks + THREADS - 1u) / THREADS;
    let first = min(thread * part, blocks);
    let end = min(first + part, blocks);
    var sum = 0u;
    for (var block = first; block < end; block++) {
        sum += word(table(params, workgroup.x, block));
    }
    var place = sum_before(thread, vec2u(sum, 0u)).x;
    for (var block = first; block < end; block++) {
        let at = table(params, workgroup.x, block);
        let count = word(at);
        set_word(at, place);
        place += count;
    }
    if (thread == THREADS - 1u) {
        set_word(total(params, workgroup.x), place);
    }
}

// Counters of 16 bits, two digits in a word: a row of threads for each pair, one longer than there are
// threads so that a column is not all in one bank. After that the sorted block: its keys, and its ids.
const ROW: u32 = THREADS + 1u;
const PAIRS: u32 = DIGITS / 2u;
var<workgroup> counters: array<u32, 2080>;
// Numbers of a pair of digits in the keys of the lower and of the upper half of the threads.
var<workgroup> pair_totals: array<u32, DIGITS>;
// Where a digit begins in the sorted block, for keys of the lower half and for those of the upper half.
var<workgroup> starts: array<u32, 128>;
// What is added to a key's place in the sorted block to have its place in the output, by its digit.
var<workgroup> onward: array<u32, DIGITS>;
var<workgroup> block_total: u32;

fn half_of(word: u32, digit: u32) -> u32 {
    return (word >> (16u * (digit & 1u))) & 0xffffu;
}

fn counter(digit: u32, thread: u32) -> u32 {
    return (digit / 2u) * ROW + thread;
}

@compute @workgroup_size(THREADS)
fn scatter(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let block = workgroup_index(workgroup, grid);
    let end = length();
    let own = block * BLOCK + 4u * FOURS * thread;

    // Count, and note how many of its own came before each key.
    for (var pair = 0u; pair < PAIRS; pair++) {
        counters[pair * ROW + thread] = 0u;
    }
    var keys: array<vec4u, FOURS>;
    var places: array<vec4u, FOURS>;
    for (var i = 0u; i < FOURS; i++) {
        keys[i] = read_keys(own + 4u * i, end);
        for (var j = 0u; j < 4u; j++) {
            if (keys[i][j] != LEFT_OUT) {
                let d = digit(keys[i][j]);
                let at = counter(d, thread);
                let count = counters[at];
                places[i][j] = half_of(count, d);
                counters[at] = count + (1u << (16u * (d & 1u)));
            }
        }
    }
    workgroupBarrier();

    // Sum up over threads: each takes half a row. No sum exceeds the block's 1024, so the halves of words
    // don't spill.
    let half = thread / PAIRS;
    var sum = 0u;
    for (var t = half * PAIRS; t < half * PAIRS + PAIRS; t++) {
        let at = (thread % PAIRS) * ROW + t;
        let count = counters[at];
        counters[at] = sum;
        sum += count;
    }
    pair_totals[thread] = sum;
    workgroupBarrier();

    // A digit begins where all smaller ones end: here, and in the output.
    let lower = half_of(pair_totals[thread / 2u], thread);
    let here = lower + half_of(pair_totals[PAIRS + thread / 2u], thread);
    let start = sum_before(thread, vec2u(here, word(total(params, thread))));
    starts[thread] = start.x;
    starts[DIGITS + thread] = start.x + lower;
    // A workgroup beyond all blocks has nothing to write, nor a column to read.
    onward[thread] = start.y + word(table(params, thread, min(block, params.blocks - 1u))) - start.x;
    if (thread == DIGITS - 1u) {
        block_total = start.x + here;
    }
    workgroupBarrier();

    for (var i = 0u; i < FOURS; i++) {
        for (var j = 0u; j < 4u; j++) {
            let d = digit(keys[i][j]);
            places[i][j] += starts[half * DIGITS + d] + half_of(counters[counter(d, thread)], d);
        }
    }
    workgroupBarrier();

    // Sort the block, and write it out: what has one digit goes side by side.
    for (var i = 0u; i < FOURS; i++) {
        // At first a key's place is its id.
        var ids = vec4u(own + 4u * i) + vec4u(0u, 1u, 2u, 3u);
        if (sorting.first == 0u && own + 4u * i < end) {
            ids = words[(sorting.from_ids + own) / 4u + i];
        }
        for (var j = 0u; j < 4u; j++) {
            if (keys[i][j] != LEFT_OUT) {
                counters[places[i][j]] = keys[i][j];
                counters[BLOCK + places[i][j]] = ids[j];
            }
        }
    }
    workgroupBarrier();
    for (var local = thread; local < block_total; local += THREADS) {
        let key = counters[local];
        let at = onward[digit(key)] + local;
        set_word(sorting.to_ids + at, counters[BLOCK + local]);
        if (sorting.last == 0u) {
            set_word(sorting.to_keys + at, key);
        }
    }
}
