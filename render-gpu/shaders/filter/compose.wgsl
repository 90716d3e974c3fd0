// Texture and emission put back. Twin of `compose` in stochastic/src/filter/illumination.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> light: array<vec4f>;
@group(0) @binding(2) var<storage, read> albedo: array<vec4f>;
@group(0) @binding(3) var<storage, read> emission: array<vec4f>;
@group(0) @binding(4) var<storage, read> guides: array<Guide>;
@group(0) @binding(5) var<storage, read> signal: array<vec4f>;
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
@group(0) @binding(6) var<storage, read_write> state: Counting;
@group(0) @binding(7) var<storage, read_write> out: array<vec4f>;

@compute @workgroup_size(8, 8)
fn compose(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let i = at.y * svgf.width + at.x;
    if (guides[i].depth < NO_SURFACE) {
        out[i] = vec4f(signal[i].xyz / state.scale * factor(i) + emitted(i), 1.0);
    } else if (finite3(light[i].xyz)) {
        out[i] = vec4f(light[i].xyz, 1.0);
    } else {
        out[i] = vec4f(0.0, 0.0, 0.0, 1.0);
        // Broken ones are counted where guides are read.
        if (guides[i].kind == EMPTY) {
            atomicAdd(&state.non_finite, 1u);
        }
    }
}
