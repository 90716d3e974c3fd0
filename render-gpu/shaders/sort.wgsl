// Twin of lighttree/src/build/radix.rs: a stable sort by the least significant digit first.
// Satish, Harris and Garland, "Designing Efficient Sorting Algorithms for Manycore GPUs", 2009.
//
// Three dispatches for each digit of 6 bits: `count` how often each occurs in each block of keys, `scan` where each block's share begins,
// `scatter` blocks, sorted in workgroup memory, so that what goes to one place is written side by side. A thread owns 8 keys that follow
// one another, and its own counters: that keeps equal keys in order without atomics.

@group(0) @binding(0) var<uniform> params: BuildParams;
@group(0) @binding(1) var<uniform> sorting: SortPass;
@group(0) @binding(2) var<storage, read> header: TreeHeader;
@group(0) @binding(3) var<storage, read_write> words: array<u32>;

const THREADS: u32 = 64u;
const PER_THREAD: u32 = 8u;

fn digit(key: u32) -> u32 {
    return (key >> sorting.shift) & (DIGITS - 1u);
}

// Keys that the pass reads.
fn length() -> u32 {
    return select(header.len, params.lights, sorting.first == 1u);
}

// The table: a row of blocks for each digit, then the number of all keys of each digit.
fn table(digit: u32, block: u32) -> u32 {
    return 4u * params.capacity + digit * params.blocks + block;
}

fn total(digit: u32) -> u32 {
    return 4u * params.capacity + DIGITS * params.blocks + digit;
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
    for (var i = 0u; i < PER_THREAD; i++) {
        let at = block * BLOCK + i * THREADS + thread;
        if (at < end) {
            let key = words[sorting.from_keys + at];
            if (key != LEFT_OUT) {
                atomicAdd(&histogram[digit(key)], 1u);
            }
        }
    }
    workgroupBarrier();
    if (block < params.blocks) {
        words[table(thread, block)] = atomicLoad(&histogram[thread]);
    }
}

const SCAN_THREADS: u32 = 256u;
var<workgroup> sums: array<u32, SCAN_THREADS>;

// One workgroup a digit: each thread adds up a part of the row, and the sums before it say where that begins.
@compute @workgroup_size(SCAN_THREADS)
fn scan(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) workgroup: vec3u) {
    let blocks = (length() + BLOCK - 1u) / BLOCK;
    let part = (blocks + SCAN_THREADS - 1u) / SCAN_THREADS;
    let first = min(thread * part, blocks);
    let end = min(first + part, blocks);
    var sum = 0u;
    for (var block = first; block < end; block++) {
        sum += words[table(workgroup.x, block)];
    }
    sums[thread] = sum;
    workgroupBarrier();
    // Sums of threads that had no block need nobody's.
    for (var reach = 1u; reach < min(SCAN_THREADS, blocks); reach *= 2u) {
        var before = 0u;
        if (thread >= reach) {
            before = sums[thread - reach];
        }
        workgroupBarrier();
        sums[thread] += before;
        workgroupBarrier();
    }
    var place = sums[thread] - sum;
    for (var block = first; block < end; block++) {
        let at = table(workgroup.x, block);
        let count = words[at];
        words[at] = place;
        place += count;
    }
    if (end == blocks && (first < end || thread == 0u)) {
        words[total(workgroup.x)] = place;
    }
}

var<workgroup> block_keys: array<u32, BLOCK>;
var<workgroup> block_ids: array<u32, BLOCK>;
// Counters of 16 bits, two digits in a word; a row of threads for each pair, one longer than there are threads so that a column is
// not all in one bank.
const ROW: u32 = THREADS + 1u;
var<workgroup> counters: array<u32, 2080>;
// Numbers of a pair of digits in the block.
var<workgroup> pair_totals: array<u32, 32>;
// Where a digit begins in the sorted block, and where its keys of this block go in the output.
var<workgroup> local_starts: array<u32, DIGITS>;
var<workgroup> global_starts: array<u32, DIGITS>;
var<workgroup> block_total: u32;
// Numbers of a digit here and everywhere, and of eight digits that follow one another.
var<workgroup> totals: array<vec2u, DIGITS>;
var<workgroup> eighths: array<vec2u, 8>;

fn half_of(word: u32, digit: u32) -> u32 {
    return (word >> (16u * (digit & 1u))) & 0xffffu;
}

@compute @workgroup_size(THREADS)
fn scatter(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let block = workgroup_index(workgroup, grid);
    let end = length();

    // Stage the block, so that each thread can have keys that follow one another.
    for (var pair = 0u; pair < DIGITS / 2u; pair++) {
        counters[pair * ROW + thread] = 0u;
    }
    for (var i = 0u; i < PER_THREAD; i++) {
        let local = i * THREADS + thread;
        let at = block * BLOCK + local;
        var key = LEFT_OUT;
        var id = at;
        if (at < end) {
            key = words[sorting.from_keys + at];
            if (sorting.first == 0u) {
                id = words[sorting.from_ids + at];
            }
        }
        block_keys[local] = key;
        block_ids[local] = id;
    }
    workgroupBarrier();

    // Count, and note how many of its own came before each key.
    var keys: array<u32, PER_THREAD>;
    var ids: array<u32, PER_THREAD>;
    var ranks: array<u32, PER_THREAD>;
    for (var i = 0u; i < PER_THREAD; i++) {
        let key = block_keys[thread * PER_THREAD + i];
        keys[i] = key;
        ids[i] = block_ids[thread * PER_THREAD + i];
        if (key != LEFT_OUT) {
            let d = digit(key);
            let counter = (d / 2u) * ROW + thread;
            let word = counters[counter];
            ranks[i] = half_of(word, d);
            counters[counter] = word + (1u << (16u * (d & 1u)));
        }
    }
    workgroupBarrier();

    // Sum up over threads: half of them take a row each. No sum exceeds the block's 512, so halves don't spill.
    if (thread < DIGITS / 2u) {
        var sum = 0u;
        for (var t = 0u; t < THREADS; t++) {
            let word = counters[thread * ROW + t];
            counters[thread * ROW + t] = sum;
            sum += word;
        }
        pair_totals[thread] = sum;
    }
    workgroupBarrier();

    // A digit begins where all smaller ones end: here, and in the output.
    totals[thread] = vec2u(half_of(pair_totals[thread / 2u], thread), words[total(thread)]);
    workgroupBarrier();
    if (thread < 8u) {
        var sum = vec2u(0u);
        for (var d = 8u * thread; d < 8u * thread + 8u; d++) {
            sum += totals[d];
        }
        eighths[thread] = sum;
    }
    workgroupBarrier();
    var start = vec2u(0u);
    for (var i = 0u; i < 8u; i++) {
        start += select(vec2u(0u), eighths[i], i < thread / 8u);
        start += select(vec2u(0u), totals[(thread & 56u) + i], i < (thread & 7u));
    }
    local_starts[thread] = start.x;
    // A workgroup beyond all blocks has nothing to write, nor a column to read.
    global_starts[thread] = start.y + words[table(thread, min(block, params.blocks - 1u))];
    if (thread == DIGITS - 1u) {
        block_total = start.x + totals[thread].x;
    }
    workgroupBarrier();

    for (var i = 0u; i < PER_THREAD; i++) {
        if (keys[i] != LEFT_OUT) {
            let d = digit(keys[i]);
            let before = half_of(counters[(d / 2u) * ROW + thread], d);
            let place = local_starts[d] + before + ranks[i];
            block_keys[place] = keys[i];
            block_ids[place] = ids[i];
        }
    }
    workgroupBarrier();

    for (var i = 0u; i < PER_THREAD; i++) {
        let local = i * THREADS + thread;
        if (local < block_total) {
            let key = block_keys[local];
            let d = digit(key);
            let at = global_starts[d] + local - local_starts[d];
            words[sorting.to_ids + at] = block_ids[local];
            if (sorting.last == 0u) {
                words[sorting.to_keys + at] = key;
            }
        }
    }
}
