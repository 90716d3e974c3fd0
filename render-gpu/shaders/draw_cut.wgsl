// Twin of stochastic/src/cut.rs: `CutSampler::select`, and stochastic/src/subtrees.rs: `draw`.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.2.
//
// One thread a receiver makes its own cut and draws from each of its nodes.

@compute @workgroup_size(64)
fn draw_cut(
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
    var length = 0u;
    if (all_finite(position)) {
        let view = view_of(position);
        select_cut(view, receiver, params.nodes, params.distance_floor);
        length = cut_length * params.per_node;
        var decisions = decisions_new(random_new(params.seed, params.first_stream + i, params.index));
        let offset = decisions_stream_u64(&decisions);
        for (var slot = 0u; slot < length; slot++) {
            decisions_restart(&decisions, slot_start(offset, slot, length, params.per_node));
            let sample = draw_light(cut_nodes[slot / params.per_node], view, receiver, &decisions);
            var entry = NO_LIGHT;
            if (sample.light != NONE) {
                entry = WeightedLight(sample.light, probability_weight(sample.pmf, f32(params.per_node)));
            }
            drawn[first + slot] = entry;
        }
    }
    for (var slot = length; slot < params.lights; slot++) {
        drawn[first + slot] = NO_LIGHT;
    }
}
