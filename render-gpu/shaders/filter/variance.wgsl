// Variance of each pixel's mean over time. Twin of `variance` in stochastic/src/filter/temporal.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> history: array<History>;
@group(0) @binding(2) var<storage, read_write> variances: array<f32>;

@compute @workgroup_size(8, 8)
fn variance(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let i = at.y * svgf.width + at.x;
    let h = history[i];
    let one = max(h.second - h.first * h.first, 0.0);
    var value = 0.0;
    if (h.frames > 1.0) {
        value = one * h.squares * h.frames / (h.frames - 1.0);
    }
    variances[i] = value;
}
