// The scale of this frame's colours. Twin of `scale` in stochastic/src/filter/illumination.rs and of its use in Svgf::filter.

@group(0) @binding(0) var<storage, read_write> state: SvgfState;

@compute @workgroup_size(1)
fn begin() {
    var scale = 1.0;
    if (state.brightest > 0u) {
        let exponent = clamp(i32(state.brightest >> 23u) - 127, -126, 126);
        scale = bitcast<f32>(u32(127 - exponent) << 23u);
    }
    // What is remembered was about 1 at its own scale, and must not overflow at this one.
    if (state.frames > 0u) {
        scale = min(scale, 256.0 * state.scale);
    }
    state.last_scale = state.scale;
    state.scale = scale;
    state.frames = min(state.frames, 65535u) + 1u;
}
