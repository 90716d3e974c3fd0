// Records of filters, shared with src/filter/svgf.rs and taa.rs. Rows from the top, pixel (x, y) at y * width + x.

struct SvgfUniform {
    width: u32,
    height: u32,
    // Period of interleaved sampling; 1 for none.
    interleaved: u32,
    // Bit 0: there is emission; bit 1: there is motion.
    inputs: u32,
    sigma_luminance: f32,
    // 1 / sigma_depth.
    depth_stop: f32,
    depth_floor: f32,
    normal_power: f32,
    alpha: f32,
    alpha_moments: f32,
    least_frames: f32,
    albedo_floor: f32,
    // Pixels between the kernel's places.
    step: i32,
    conserving: u32,
    spare0: u32,
    spare1: u32,
}

// The second half starts every frame at 0.
struct SvgfState {
    // Power of two that colours of this frame, and of the last, are kept at.
    scale: f32,
    last_scale: f32,
    // Frames seen, this one included.
    frames: u32,
    spare: u32,
    // Bits of the largest illumination.
    brightest: u32,
    non_finite: u32,
    with_history: u32,
    surfaces: u32,
}

struct Guide {
    normal: vec3f,
    // NO_SURFACE where nothing is filtered.
    depth: f32,
    // Change of depth per pixel to the right and down.
    slope: vec2f,
    mesh: u32,
    kind: u32,
}

struct History {
    color: vec3f,
    // Moments of luminance.
    first: f32,
    second: f32,
    // Sum of squared weights of the frames in the mean, and their number.
    squares: f32,
    frames: f32,
    spare: f32,
}

// Kinds of pixels: filtered; left as it is; the same, because a guide is not a number.
const SURFACE: u32 = 0u;
const EMPTY: u32 = 1u;
const BROKEN: u32 = 2u;
// In place of an infinite depth.
const NO_SURFACE: f32 = 3.0e38;

fn finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

fn finite3(v: vec3f) -> bool {
    return finite(v.x) && finite(v.y) && finite(v.z);
}

// Rec. 709.
fn luminance(c: vec3f) -> f32 {
    return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
}
