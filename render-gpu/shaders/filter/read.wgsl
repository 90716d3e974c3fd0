// Guides of a frame, what is broken in it, and how bright it is. Twin of Guides::read in stochastic/src/filter/guides.rs and of `scale` in
// illumination.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
// Colour, and number of the object.
@group(0) @binding(1) var<storage, read> light: array<vec4f>;
// Normal and depth.
@group(0) @binding(2) var<storage, read> surface: array<vec4f>;
@group(0) @binding(3) var<storage, read> albedo: array<vec4f>;
@group(0) @binding(4) var<storage, read> emission: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> guides: array<Guide>;
struct Counting {
    scale: f32,
    last_scale: f32,
    frames: u32,
    spare: u32,
    brightest: atomic<u32>,
    non_finite: atomic<u32>,
    with_history: atomic<u32>,
    surfaces: atomic<u32>,
}
@group(0) @binding(6) var<storage, read_write> state: Counting;

var<workgroup> brightest: atomic<u32>;
var<workgroup> broken: atomic<u32>;
var<workgroup> surfaces: atomic<u32>;

fn kind(i: u32) -> u32 {
    let depth = bitcast<u32>(surface[i].w);
    if (depth == 0x7f800000u) {
        return EMPTY;
    }
    let is_number = depth > 0u && depth < 0x7f800000u && finite3(surface[i].xyz) && finite3(albedo[i].xyz)
        && ((svgf.inputs & 1u) == 0u || finite3(emission[i].xyz));
    return select(BROKEN, SURFACE, is_number);
}

fn depth_of(x: i32, y: i32) -> f32 {
    if (x < 0 || y < 0 || x >= i32(svgf.width) || y >= i32(svgf.height)) {
        return NO_SURFACE;
    }
    let i = u32(y) * svgf.width + u32(x);
    if (kind(i) != SURFACE) {
        return NO_SURFACE;
    }
    return surface[i].w;
}

// The smaller of the differences to both sides, since the larger may lead over an edge.
fn slope(here: f32, before: f32, after: f32) -> f32 {
    let back = here - before;
    let on = after - here;
    if (before < NO_SURFACE && after < NO_SURFACE) {
        return select(on, back, abs(back) < abs(on));
    }
    return select(select(0.0, on, after < NO_SURFACE), back, before < NO_SURFACE);
}

@compute @workgroup_size(8, 8)
fn read_guides(@builtin(global_invocation_id) at: vec3u, @builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        atomicStore(&brightest, 0u);
        atomicStore(&broken, 0u);
        atomicStore(&surfaces, 0u);
    }
    workgroupBarrier();
    if (at.x < svgf.width && at.y < svgf.height) {
        let i = at.y * svgf.width + at.x;
        let x = i32(at.x);
        let y = i32(at.y);
        let what = kind(i);
        var guide = Guide(vec3f(0.0), NO_SURFACE, vec2f(0.0), bitcast<u32>(light[i].w), what);
        if (what == BROKEN) {
            atomicAdd(&broken, 1u);
        }
        if (what == SURFACE) {
            atomicAdd(&surfaces, 1u);
            let here = surface[i].w;
            guide.depth = here;
            guide.slope = vec2f(
                slope(here, depth_of(x - 1, y), depth_of(x + 1, y)),
                slope(here, depth_of(x, y - 1), depth_of(x, y + 1)),
            );
            let normal = surface[i].xyz;
            let inverse = 1.0 / length(normal);
            guide.normal = select(vec3f(0.0), normal * inverse, finite(inverse) && inverse > 0.0);
            let value = illumination(i);
            if (finite3(value)) {
                // Bits of numbers that are not negative are in their order.
                atomicMax(&brightest, bitcast<u32>(max(abs(value.x), max(abs(value.y), abs(value.z)))));
            }
        }
        guides[i] = guide;
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicMax(&state.brightest, atomicLoad(&brightest));
        atomicAdd(&state.non_finite, atomicLoad(&broken));
        atomicAdd(&state.surfaces, atomicLoad(&surfaces));
    }
}
