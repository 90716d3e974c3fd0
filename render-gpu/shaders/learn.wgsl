// Twin of stochastic/src/visibility.rs: `NodeLearning::drawn` and `gave`.
//
// One workgroup a block; a thread owns a node of its cut and looks through all entries of the block's pixels,
// which come in order: so sums are the same in every run, without atomics.

@group(0) @binding(0) var<uniform> params: DrawParams;
@group(0) @binding(1) var<storage, read> cuts: array<u32>;
@group(0) @binding(2) var<storage, read> tags: array<NodeTag>;
// Of each entry what its light gave the receiver: contribution, 0 in shadow, not weighted.
@group(0) @binding(3) var<storage, read> outcomes: array<f32>;
@group(0) @binding(4) var<storage, read_write> learned: array<vec2f>;

@compute @workgroup_size(64)
fn learn_blocks(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let number = workgroup_index(workgroup, grid);
    let columns = (params.width + params.block - 1u) / params.block;
    let left = number % columns * params.block;
    let top = number / columns * params.block;
    if (top >= params.height) {
        return;
    }
    let right = min(left + params.block, params.width);
    let bottom = min(top + params.block, params.height);
    let count = cuts[number * (params.nodes + 1u)];
    for (var node = thread; node < count; node += 64u) {
        var sum = learned[number * params.nodes + node];
        for (var y = top; y < bottom; y++) {
            for (var x = left; x < right; x++) {
                let first = (y * params.width + x) * params.lights;
                for (var j = 0u; j < params.lights; j++) {
                    let tag = tags[first + j];
                    if (tag.node == node) {
                        // An outlier steers no more than this; it costs variance at worst.
                        let ratio = min(outcomes[first + j], 1e30) * tag.scale;
                        sum = halved(sum + vec2f(1.0, 0.0));
                        sum.y += select(0.0, min(ratio * ratio, 1e30), ratio > 0.0);
                    }
                }
            }
        }
        learned[number * params.nodes + node] = sum;
    }
}
