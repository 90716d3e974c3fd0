// The accumulated colours with their variance: over time where frames are enough, or else that around the pixel. Twin of `take` in
// stochastic/src/filter/temporal.rs and of `pool` in moments.rs. A pixel pays for the one that it needs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> history: array<History>;
@group(0) @binding(2) var<storage, read> variances: array<f32>;
@group(0) @binding(3) var<storage, read> signal: array<vec4f>;
@group(0) @binding(4) var<storage, read> guides: array<Guide>;
@group(0) @binding(5) var<storage, read_write> taken: array<vec4f>;

fn pooled(at: vec2i) -> f32 {
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    let p = guides[u32(at.y * size.x + at.x)];
    var weights = 0.0;
    var total = 0.0;
    for (var j = -3; j <= 3; j++) {
        for (var i = -3; i <= 3; i++) {
            let place = at + vec2i(i, j);
            if (all(place >= vec2i(0)) && all(place < size)) {
                let there = u32(place.y * size.x + place.x);
                let weight = guide_weight(p, guides[there], vec2f(vec2i(i, j)), svgf);
                weights += weight;
                total += weight * variances[there];
            }
        }
    }
    if (weights > 0.0) {
        return total / weights;
    }
    return 0.0;
}

@compute @workgroup_size(8, 8)
fn take(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let i = at.y * svgf.width + at.x;
    let h = history[i];
    var value = 0.0;
    if (h.frames >= svgf.least_frames) {
        value = pooled(vec2i(at.xy));
    } else if (svgf.interleaved > 1u) {
        value = signal[i].w * h.squares;
    } else {
        value = variance_around(vec2i(at.xy), 1) * h.squares;
    }
    taken[i] = vec4f(h.color, value);
}
