// The scale that differences of luminance are measured by. Twin of `steer` in stochastic/src/filter/atrous.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> deviations: array<f32>;

@compute @workgroup_size(8, 8)
fn steer(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    let here = vec2i(at.xy);
    var sum = 0.0;
    var weights = 0.0;
    for (var y = max(here.y - 1, 0); y < min(here.y + 2, size.y); y++) {
        for (var x = max(here.x - 1, 0); x < min(here.x + 2, size.x); x++) {
            let weight = select(1.0, 2.0, x == here.x) * select(1.0, 2.0, y == here.y);
            sum += weight * signal[u32(y * size.x + x)].w;
            weights += weight;
        }
    }
    deviations[at.y * svgf.width + at.x] =
        min(svgf.sigma_luminance * sqrt(max(sum / weights, 0.0)), 3.0e38);
}
