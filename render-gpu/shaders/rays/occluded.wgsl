// One segment an invocation. Twin of lighttree's BatchRayQueries::occluded_batch.

@group(0) @binding(0) var<uniform> batch: BatchParams;
@group(0) @binding(1) var<storage, read> segments: array<Segment>;
// 1 where anything is between the ends, else 0.
@group(0) @binding(2) var<storage, read_write> answers: array<u32>;

@compute @workgroup_size(64)
fn occluded(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = workgroup_index(group, groups) * 64u + lane;
    if (i >= batch.count) {
        return;
    }
    let segment = segments[i];
    answers[i] = select(0u, 1u, trace_occluded(segment.start, segment.end));
}
