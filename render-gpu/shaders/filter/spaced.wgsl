// Variance from pixels that drew from the same lights. Twin of the first step of interleaved sampling in Svgf::filter.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read> guides: array<Guide>;
@group(0) @binding(3) var<storage, read_write> variances: array<f32>;

@compute @workgroup_size(8, 8)
fn spaced(@builtin(global_invocation_id) at: vec3u) {
    if (at.x < svgf.width && at.y < svgf.height) {
        variances[at.y * svgf.width + at.x] = variance_around(vec2i(at.xy), i32(svgf.interleaved));
    }
}
