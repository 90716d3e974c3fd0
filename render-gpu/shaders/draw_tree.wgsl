// Twin of lighttree/src/sampler.rs: `PerReceiver` over lighttree/src/walk.rs: `TreeSampler`.
//
// One thread a receiver draws its row of lights, each by one walk from the root; their first numbers are
// stratified.

@compute @workgroup_size(64)
fn draw_tree(
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
    let view = view_of(position);
    let is_lit = header.len > 0u && all_finite(position);
    var decisions = Decisions(vec2u(0u), WIDE_MAX, random_new(params.seed, params.first_stream + i, params.index));
    for (var j = 0u; j < params.lights; j++) {
        var entry = NO_LIGHT;
        if (is_lit) {
            let within = decisions_stream_u64(&decisions);
            decisions_restart(&decisions, wide_divide(j, within, params.lights).quotient);
            let sample = draw_light(1u, view, receiver, &decisions);
            if (sample.light != NONE) {
                entry = WeightedLight(sample.light, probability_weight(sample.pmf, f32(params.lights)));
            }
        }
        drawn[i * params.lights + j] = entry;
    }
}
