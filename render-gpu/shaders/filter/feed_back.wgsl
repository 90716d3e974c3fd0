// Twin of `feed_back` in stochastic/src/filter/temporal.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> history: array<History>;

@compute @workgroup_size(8, 8)
fn feed_back(@builtin(global_invocation_id) at: vec3u) {
    if (at.x < svgf.width && at.y < svgf.height) {
        let i = at.y * svgf.width + at.x;
        history[i].color = signal[i].xyz;
    }
}
