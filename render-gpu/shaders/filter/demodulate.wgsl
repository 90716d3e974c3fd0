// Twin of `demodulate` in stochastic/src/filter/illumination.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> light: array<vec4f>;
@group(0) @binding(2) var<storage, read> albedo: array<vec4f>;
@group(0) @binding(3) var<storage, read> emission: array<vec4f>;
@group(0) @binding(4) var<storage, read> guides: array<Guide>;
struct Counting {
    scale: f32,
    last_scale: f32,
    frames: u32,
    spare: u32,
    brightest: u32,
    non_finite: atomic<u32>,
    with_history: u32,
    surfaces: u32,
}
@group(0) @binding(5) var<storage, read_write> state: Counting;
@group(0) @binding(6) var<storage, read_write> signal: array<vec4f>;

// The mean of the finite values within two pixels of a hole on the same object, or else of any surface; 0
// without any.
fn from_neighbours(at: vec2i, mesh: u32) -> vec3f {
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    for (var same = 1; same >= 0; same--) {
        var sum = vec3f(0.0);
        var count = 0.0;
        for (var y = max(at.y - 2, 0); y < min(at.y + 3, size.y); y++) {
            for (var x = max(at.x - 2, 0); x < min(at.x + 3, size.x); x++) {
                let i = u32(y * size.x + x);
                if ((same == 0 || guides[i].mesh == mesh) && guides[i].depth < NO_SURFACE) {
                    let value = illumination(i) * state.scale;
                    if (finite3(value)) {
                        sum += value;
                        count += 1.0;
                    }
                }
            }
        }
        if (count > 0.0) {
            return sum / count;
        }
    }
    return vec3f(0.0);
}

@compute @workgroup_size(8, 8)
fn demodulate(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let i = at.y * svgf.width + at.x;
    var color = vec3f(0.0);
    if (guides[i].depth < NO_SURFACE) {
        color = illumination(i) * state.scale;
        if (!finite3(color)) {
            atomicAdd(&state.non_finite, 1u);
            color = from_neighbours(vec2i(at.xy), guides[i].mesh);
        }
    }
    signal[i] = vec4f(color, 0.0);
}
