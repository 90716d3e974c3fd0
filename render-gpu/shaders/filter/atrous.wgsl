// One level of the edge-avoiding wavelet. Twin of `level` in stochastic/src/filter/atrous.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read> guides: array<Guide>;
@group(0) @binding(3) var<storage, read> deviations: array<f32>;
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4f>;

// The B3 spline, from its centre outwards.
const SPLINE = vec3f(3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
// The weight of a pixel in itself.
const CENTER: f32 = 9.0 / 64.0;

@compute @workgroup_size(8, 8)
fn atrous(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    let here = at.y * svgf.width + at.x;
    let p = guides[here];
    let own = signal[here];
    let own_luminance = luminance(own.xyz);
    let own_deviation = deviations[here];
    var color = vec3f(0.0);
    var variance = 0.0;
    var weights = 0.0;
    for (var j = -2; j <= 2; j++) {
        for (var i = -2; i <= 2; i++) {
            let offset = vec2i(i, j) * svgf.step;
            let place = vec2i(at.xy) + offset;
            if ((i == 0 && j == 0) || any(place < vec2i(0)) || any(place >= size)) {
                continue;
            }
            let there = u32(place.y * size.x + place.x);
            let q = guides[there];
            if (p.mesh != q.mesh || p.depth >= NO_SURFACE || q.depth >= NO_SURFACE) {
                continue;
            }
            let value = signal[there];
            var deviation = own_deviation;
            if (svgf.conserving != 0u) {
                deviation = 0.5 * (own_deviation + deviations[there]);
            }
            // Without any deviation there is no weight.
            if (deviation <= 0.0) {
                continue;
            }
            let exponent = stop_exponent(p, q, vec2f(offset), svgf)
                + abs(own_luminance - luminance(value.xyz)) / deviation;
            let weight = SPLINE[abs(i)] * SPLINE[abs(j)] * falloff(exponent);
            weights += weight;
            color += weight * (value.xyz - own.xyz);
            variance += weight * weight * value.w;
        }
    }
    var center = CENTER;
    var total = CENTER + weights;
    if (svgf.conserving != 0u) {
        center = 1.0 - weights;
        total = 1.0;
    }
    filtered[here] = vec4f(own.xyz + color / total, (center * center * own.w + variance) / (total * total));
}
