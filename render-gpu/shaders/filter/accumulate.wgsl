// Frames before this one, found again by motion. Twin of `accumulate` in stochastic/src/filter/temporal.rs.

@group(0) @binding(0) var<uniform> svgf: SvgfUniform;
@group(0) @binding(1) var<storage, read> signal: array<vec4f>;
@group(0) @binding(2) var<storage, read> guides: array<Guide>;
@group(0) @binding(3) var<storage, read> last_guides: array<Guide>;
@group(0) @binding(4) var<storage, read> last_history: array<History>;
@group(0) @binding(5) var<storage, read> motion: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> history: array<History>;
struct Counting {
    scale: f32,
    last_scale: f32,
    frames: u32,
    spare: u32,
    brightest: u32,
    non_finite: u32,
    with_history: atomic<u32>,
    surfaces: u32,
}
@group(0) @binding(7) var<storage, read_write> state: Counting;

// Largest cosine distance between a normal and its history: 25 degrees.
const SAME_NORMAL: f32 = 0.9;
// Most frames that are counted.
const MOST_FRAMES: f32 = 65536.0;

struct Mean {
    color: vec3f,
    first: f32,
    second: f32,
    squares: f32,
    frames: f32,
    weight: f32,
}

// Adds pixel `place` of the last frame if it shows the surface that `now` shows.
fn add(mean: ptr<function, Mean>, place: vec2i, weight: f32, now: Guide, depth_change: f32) {
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    if (weight <= 0.0 || any(place < vec2i(0)) || any(place >= size)) {
        return;
    }
    let i = u32(place.y * size.x + place.x);
    let then = last_guides[i];
    // Places lie up to a pixel and a half aside.
    let tolerance = 2.0 * (abs(now.slope.x) + abs(now.slope.y)) + 0.01 * now.depth;
    let cosine = now.normal.x * then.normal.x + now.normal.y * then.normal.y + now.normal.z * then.normal.z;
    let same_depth = then.depth < NO_SURFACE && abs(then.depth - (now.depth + depth_change)) <= tolerance;
    if (same_depth && cosine >= SAME_NORMAL && now.mesh == then.mesh) {
        let before = last_history[i];
        (*mean).color += weight * before.color;
        (*mean).first += weight * before.first;
        (*mean).second += weight * before.second;
        (*mean).squares += weight * before.squares;
        (*mean).frames += weight * before.frames;
        (*mean).weight += weight;
    }
}

@compute @workgroup_size(8, 8)
fn accumulate(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= svgf.width || at.y >= svgf.height) {
        return;
    }
    let here = at.y * svgf.width + at.x;
    let now = guides[here];
    let color = signal[here].xyz;
    let own = luminance(color);
    var next = History(color, own, own * own, 1.0, 1.0, 0.0);
    var mean = Mean(vec3f(0.0), 0.0, 0.0, 0.0, 0.0, 0.0);
    let moved = motion[here].xyz;
    let known = (svgf.inputs & 2u) != 0u && state.frames > 1u && finite3(moved) && now.depth < NO_SURFACE;
    let place = vec2f(at.xy) + 0.5 + moved.xy;
    let size = vec2f(f32(svgf.width), f32(svgf.height));
    if (known && all(place >= vec2f(0.0)) && all(place < size)) {
        let corner = floor(place - 0.5);
        let part = place - 0.5 - corner;
        let first = vec2i(corner);
        // Bilinear, or else from all nine around that show the same surface.
        add(&mean, first, (1.0 - part.x) * (1.0 - part.y), now, moved.z);
        add(&mean, first + vec2i(1, 0), part.x * (1.0 - part.y), now, moved.z);
        add(&mean, first + vec2i(0, 1), (1.0 - part.x) * part.y, now, moved.z);
        add(&mean, first + vec2i(1, 1), part.x * part.y, now, moved.z);
        // Less than a hundredth of four pixels would magnify what little they know.
        if (mean.weight < 0.01) {
            mean = Mean(vec3f(0.0), 0.0, 0.0, 0.0, 0.0, 0.0);
            let middle = vec2i(place);
            for (var dy = -1; dy <= 1; dy++) {
                for (var dx = -1; dx <= 1; dx++) {
                    add(&mean, middle + vec2i(dx, dy), 1.0, now, moved.z);
                }
            }
        }
    }
    if (mean.weight > 0.0) {
        let rescale = state.scale / state.last_scale;
        let before_color = mean.color / mean.weight * rescale;
        let before_first = mean.first / mean.weight * rescale;
        let before_second = mean.second / mean.weight * (rescale * rescale);
        let frames = min(mean.frames / mean.weight + 1.0, MOST_FRAMES);
        let share = max(svgf.alpha, 1.0 / frames);
        let share_moments = max(svgf.alpha_moments, 1.0 / frames);
        next.color = before_color + share * (color - before_color);
        next.first = before_first + share_moments * (next.first - before_first);
        next.second = before_second + share_moments * (next.second - before_second);
        next.squares = (1.0 - share) * (1.0 - share) * (mean.squares / mean.weight) + share * share;
        next.frames = frames;
        atomicAdd(&state.with_history, 1u);
    }
    history[here] = next;
}
