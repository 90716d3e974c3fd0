// Instances as lights of the tree over them: the box around the mesh's lights in world space, and the sum of their intensities.
//
// One thread an instance. Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4.

@group(0) @binding(0) var<uniform> placed_count: vec4u;
@group(0) @binding(1) var<storage, read_write> placed: array<LightRecord>;

@compute @workgroup_size(64)
fn place_instances(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let i = workgroup_index(workgroup, grid) * 64u + thread;
    if (i >= placed_count.x) {
        return;
    }
    let instance = instances[i];
    // Nothing shines in it: left out of the tree, and counted.
    if (mesh_headers[instance.mesh].len == 0u) {
        placed[i] = LightRecord(vec3f(0.0), 0.0, vec3f(0.0), i);
        return;
    }
    let box = in_world(instance, mesh_nodes[instance.first_node]);
    // A unit of the mesh's intensities is a power of two. What is beyond f32 in the end is left out and
    // counted as no light.
    let unit = bitcast<f32>((127u + min(mesh_headers[instance.mesh].unit_exponent, 127u)) << 23u);
    placed[i] = LightRecord(box.min, box.intensity * instance.strength * unit, box.max, i);
}
