// Twin of lighttree/src/build/morton.rs: `keyed`, with 10 bits an axis.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.
//
// One workgroup writes the keys of a block of lights, and how often each value of the lowest digit occurs:
// what `count` of sort.wgsl does for the others.

@group(0) @binding(0) var<uniform> params: BuildParams;
@group(0) @binding(1) var<storage, read> header: TreeHeader;
@group(0) @binding(2) var<storage, read> lights: array<LightRecord>;
@group(0) @binding(3) var<storage, read_write> words: array<u32>;

// Bits of a 10-bit number, two zeros between each and the next.
fn spread_10(number: u32) -> u32 {
    var x = number;
    x = (x | (x << 16u)) & 0x030000ffu;
    x = (x | (x << 8u)) & 0x0300f00fu;
    x = (x | (x << 4u)) & 0x030c30c3u;
    return (x | (x << 2u)) & 0x09249249u;
}

// The cell of a half centre on one axis. A scale of 0 stands for infinity: there is one place, or two.
fn cell(center: f32, lowest: f32, scale: f32) -> u32 {
    if (scale == 0.0) {
        return select(0u, 1023u, center > lowest);
    }
    return min(u32((center - lowest) * scale), 1023u);
}

fn key_of(light: LightRecord) -> u32 {
    if (exclusion(light) != 0u) {
        return LEFT_OUT;
    }
    let center = half_center(light);
    let x = cell(center.x, header.min.x, header.scale.x);
    let y = cell(center.y, header.min.y, header.scale.y);
    let z = cell(center.z, header.min.z, header.scale.z);
    return (spread_10(x) << 2u) | (spread_10(y) << 1u) | spread_10(z);
}

var<workgroup> histogram: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(DIGITS)
fn morton(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let block = workgroup_index(workgroup, grid);
    atomicStore(&histogram[thread], 0u);
    workgroupBarrier();
    let end = min((block + 1u) * BLOCK, params.lights);
    for (var at = block * BLOCK + thread; at < end; at += DIGITS) {
        let key = key_of(lights[at]);
        words[3u * params.stride + at] = key;
        if (key != LEFT_OUT) {
            atomicAdd(&histogram[key % DIGITS], 1u);
        }
    }
    workgroupBarrier();
    if (block < params.blocks) {
        words[table(params, thread, block)] = atomicLoad(&histogram[thread]);
    }
}
