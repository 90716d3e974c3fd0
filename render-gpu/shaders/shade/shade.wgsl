// What drawn lights give, with a shadow ray each. Twin of `Drawn` in scene/src/sampled.rs.
//
// One thread a surface: its lights are added up in their order, so the sum has the same bits every time.

struct ShadeParams {
    // Surfaces in the buffer.
    surfaces: u32,
    // Entries of each in `drawn`.
    lights: u32,
    seed: u32,
    // Which of many passes: a camera sample, a frame.
    index: u32,
    // Emitters in the buffer: an entry beyond draws nothing.
    emitters: u32,
    // Whether `outcomes` has room for what each entry gave.
    tell: u32,
    spare0: u32,
    spare1: u32,
}

@group(0) @binding(0) var<uniform> params: ShadeParams;
@group(0) @binding(1) var<storage, read> surfaces: array<LitSurface>;
@group(0) @binding(2) var<storage, read> emitters: array<Emitter>;
@group(0) @binding(3) var<storage, read> drawn: array<WeightedLight>;
@group(0) @binding(4) var<storage, read_write> lit: array<Radiance>;
// Of each entry the luminance that its light gave, 0 in shadow, not weighted: for those who learn.
@group(0) @binding(5) var<storage, read_write> outcomes: array<f32>;

// Keeps places on lights apart from choices of lights.
const PLACES: u32 = 0x504c4143u;

@compute @workgroup_size(64)
fn shade(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    let i = workgroup_index(workgroup, grid) * 64u + thread;
    if (i >= params.surfaces) {
        return;
    }
    let surface = surfaces[i];
    let start = surface.position + surface.offset * surface.geometric_normal;
    var sum = vec3f(0.0);
    var counts = 0u;
    for (var j = 0u; j < params.lights; j++) {
        let entry = drawn[i * params.lights + j];
        if (params.tell != 0u) {
            outcomes[i * params.lights + j] = 0.0;
        }
        if (entry.light >= params.emitters || entry.weight <= 0.0) {
            continue;
        }
        counts += 0x10000u;
        let words = pcg4d(vec4u(params.seed ^ PLACES, surface.stream, params.index, j));
        let u = vec2f(words.xy >> vec2u(8u)) * (1.0 / 16777216.0);
        let light = emitter_point(emitters[entry.light], u, surface.position);
        let to = light.position - surface.position;
        if (dot(surface.geometric_normal, to) <= 0.0 || all(light.intensity == vec3f(0.0))) {
            continue;
        }
        let inverse_squared = 1.0 / dot(to, to);
        let value = scatter(surface, to * sqrt(inverse_squared)) * light.intensity * inverse_squared;
        if (all(value == vec3f(0.0))) {
            continue;
        }
        counts += 1u;
        if (!trace_occluded(start, light.end)) {
            sum += entry.weight * value;
            if (params.tell != 0u) {
                outcomes[i * params.lights + j] = 0.2126 * value.x + 0.7152 * value.y + 0.0722 * value.z;
            }
        }
    }
    lit[i] = Radiance(sum, counts);
}
