// One ray an invocation. Twin of lighttree's BatchRayQueries::closest_batch.

@group(0) @binding(0) var<uniform> batch: BatchParams;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
@group(0) @binding(2) var<storage, read_write> hits: array<Hit>;

@compute @workgroup_size(64)
fn closest(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = workgroup_index(group, groups) * 64u + lane;
    if (i >= batch.count) {
        return;
    }
    let ray = rays[i];
    hits[i] = trace_closest(ray.origin, ray.direction, ray.t_max);
}
