// Twin of lighttree/src/build/morton.rs: `keyed`, with 10 bits an axis.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.
//
// One thread a light writes its key.

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

@compute @workgroup_size(256)
fn morton(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let i = workgroup_index(workgroup, grid) * 256u + thread;
    if (i >= params.lights) {
        return;
    }
    let light = lights[i];
    var key = LEFT_OUT;
    if (exclusion(light) == 0u) {
        let center = half_center(light);
        let x = cell(center.x, header.min.x, header.scale.x);
        let y = cell(center.y, header.min.y, header.scale.y);
        let z = cell(center.z, header.min.z, header.scale.z);
        key = (spread_10(x) << 2u) | (spread_10(y) << 1u) | spread_10(z);
    }
    words[3u * params.capacity + i] = key;
}
