// The box that takes the pattern of interleaved sampling out. Twin of stochastic/src/filter/interleaved.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read> guides: array<Guide>;
@group(0) @binding(3) var<storage, read> variances: array<f32>;
@group(0) @binding(4) var<storage, read_write> filtered: array<vec4f>;

@compute @workgroup_size(8, 8)
fn smooth_period(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    let here = at.y * svgf.width + at.x;
    let p = guides[here];
    let period = i32(svgf.interleaved);
    let reach = period / 2;
    // Half weights at the ends of an even period: each residue counts the same.
    let end = select(1.0, 0.5, period % 2 == 0);
    var color = vec3f(0.0);
    var variance = 0.0;
    var weights = 0.0;
    for (var j = -reach; j <= reach; j++) {
        for (var i = -reach; i <= reach; i++) {
            let place = vec2i(at.xy) + vec2i(i, j);
            if (all(place >= vec2i(0)) && all(place < size)) {
                let there = u32(place.y * size.x + place.x);
                let kernel = select(1.0, end, abs(i) == reach) * select(1.0, end, abs(j) == reach);
                let weight = kernel * guide_weight(p, guides[there], vec2f(vec2i(i, j)), svgf);
                color += weight * signal[there].xyz;
                variance += weight * weight * variances[there];
                weights += weight;
            }
        }
    }
    if (weights > 0.0) {
        filtered[here] = vec4f(color / weights, variance / (weights * weights));
    } else {
        filtered[here] = signal[here];
    }
}
