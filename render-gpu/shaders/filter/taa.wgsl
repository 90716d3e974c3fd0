// Twin of stochastic/src/filter/taa.rs: a moving mean of finished pictures, kept honest by each pixel's neighbourhood.
//
// Differs from it in rounding alone: variances are taken around the mean in f32, where the CPU has f64.

struct TaaUniform {
    width: u32,
    height: u32,
    // 0: smallest to largest, 1: mean and deviations, 2: none.
    clip: u32,
    has_motion: u32,
    gamma: f32,
    alpha: f32,
    // 1 / white.
    inverse_white: f32,
    spare: u32,
}

struct Counting {
    frames: u32,
    spare0: u32,
    spare1: u32,
    spare2: u32,
    non_finite: atomic<u32>,
    with_history: atomic<u32>,
    without_history: atomic<u32>,
    clipped: atomic<u32>,
}

@group(0) @binding(0) var<uniform> taa: TaaUniform;
@group(0) @binding(1) var<storage, read> light: array<vec4f>;
// Normal and depth.
@group(0) @binding(2) var<storage, read> surface: array<vec4f>;
@group(0) @binding(3) var<storage, read> motion: array<vec4f>;
@group(0) @binding(4) var<storage, read> last: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> next: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> state: Counting;

const UNBOUNDED: f32 = 3.0e38;

fn finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

fn finite3(v: vec3f) -> bool {
    return finite(v.x) && finite(v.y) && finite(v.z);
}

fn luminance(c: vec3f) -> f32 {
    return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
}

// Luma, orange, green.
fn to_ycocg(c: vec3f) -> vec3f {
    return vec3f(
        0.25 * c.x + 0.5 * c.y + 0.25 * c.z, 0.5 * c.x - 0.5 * c.z, -0.25 * c.x + 0.5 * c.y - 0.25 * c.z
    );
}

fn from_ycocg(c: vec3f) -> vec3f {
    return vec3f(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z);
}

// Catmull and Rom 1974.
fn cubic(t: f32) -> vec4f {
    let t2 = t * t;
    let t3 = t * t * t;
    return vec4f(
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        -0.5 * t2 + 0.5 * t3,
    );
}

fn index_at(at: vec2i) -> u32 {
    let size = vec2i(i32(taa.width), i32(taa.height));
    let inside = clamp(at, vec2i(0), size - 1);
    return u32(inside.y * size.x + inside.x);
}

// Motion of the nearest surface among the 3 x 3 pixels around; the pixel's own where there is none.
fn motion_around(here: vec2i) -> vec2f {
    let size = vec2i(i32(taa.width), i32(taa.height));
    var nearest = UNBOUNDED;
    var found = motion[index_at(here)].xy;
    for (var y = max(here.y - 1, 0); y < min(here.y + 2, size.y); y++) {
        for (var x = max(here.x - 1, 0); x < min(here.x + 2, size.x); x++) {
            let i = u32(y * size.x + x);
            let depth = surface[i].w;
            let moved = motion[i].xy;
            if (depth > 0.0 && finite(depth) && depth < nearest && finite(moved.x) && finite(moved.y)) {
                nearest = depth;
                found = moved;
            }
        }
    }
    return found;
}

fn catmull_rom(place: vec2f) -> vec3f {
    let corner = floor(place);
    let wx = cubic(place.x - corner.x);
    let wy = cubic(place.y - corner.y);
    let first = vec2i(corner);
    var sum = vec3f(0.0);
    for (var j = 0; j < 4; j++) {
        for (var i = 0; i < 4; i++) {
            let weight = wx[i] * wy[j];
            if (weight != 0.0) {
                sum += weight * last[index_at(first + vec2i(i - 1, j - 1))].xyz;
            }
        }
    }
    return sum;
}

struct Range {
    low: vec3f,
    high: vec3f,
}

// What the history of a pixel may be like, by luma and chromas.
fn range_around(here: vec2i) -> Range {
    let size = vec2i(i32(taa.width), i32(taa.height));
    var low = vec3f(UNBOUNDED);
    var high = vec3f(-UNBOUNDED);
    var sum = vec3f(0.0);
    var count = 0.0;
    for (var y = max(here.y - 1, 0); y < min(here.y + 2, size.y); y++) {
        for (var x = max(here.x - 1, 0); x < min(here.x + 2, size.x); x++) {
            let color = light[u32(y * size.x + x)].xyz;
            if (finite3(color)) {
                let value = to_ycocg(color);
                low = min(low, value);
                high = max(high, value);
                sum += value;
                count += 1.0;
            }
        }
    }
    if (count == 0.0 || taa.clip == 2u) {
        return Range(vec3f(-UNBOUNDED), vec3f(UNBOUNDED));
    }
    if (taa.clip == 0u) {
        return Range(low, high);
    }
    // In units of the range, where squares neither over- nor underflow.
    let mean = sum / count;
    let unit = max(high - low, vec3f(1e-37));
    var squares = vec3f(0.0);
    for (var y = max(here.y - 1, 0); y < min(here.y + 2, size.y); y++) {
        for (var x = max(here.x - 1, 0); x < min(here.x + 2, size.x); x++) {
            let color = light[u32(y * size.x + x)].xyz;
            if (finite3(color)) {
                let away = (to_ycocg(color) - mean) / unit;
                squares += away * away;
            }
        }
    }
    let reach = taa.gamma * (sqrt(squares / count) * unit);
    return Range(mean - reach, mean + reach);
}

fn weight_of(color: vec3f) -> f32 {
    return 1.0 / (1.0 + max(luminance(color), 0.0) * taa.inverse_white);
}

@compute @workgroup_size(8, 8)
fn blend(@builtin(global_invocation_id) at: vec3u) {
    if (at.x >= taa.width || at.y >= taa.height) {
        return;
    }
    let here = vec2i(at.xy);
    let i = at.y * taa.width + at.x;
    let color = light[i].xyz;
    let is_number = finite3(color);
    if (!is_number) {
        atomicAdd(&state.non_finite, 1u);
    }
    var known = false;
    var history = vec3f(0.0);
    if (taa.has_motion != 0u && state.frames > 0u) {
        let moved = motion_around(here);
        let place = vec2f(at.xy) + 0.5 + moved;
        let size = vec2f(f32(taa.width), f32(taa.height));
        if (finite(moved.x) && finite(moved.y) && all(place >= vec2f(0.0)) && all(place < size)) {
            history = catmull_rom(place - 0.5);
            // Near the end of f32 the kernel's negative weights may overflow.
            known = finite3(history);
        }
    }
    if (!known) {
        atomicAdd(&state.without_history, 1u);
        next[i] = vec4f(select(vec3f(0.0), color, is_number), 1.0);
        return;
    }
    atomicAdd(&state.with_history, 1u);
    let range = range_around(here);
    let was = to_ycocg(history);
    let kept = min(max(was, range.low), range.high);
    let change = abs(kept - was);
    // A hair's breadth is rounding.
    let largest = max(abs(was.x), max(abs(was.y), abs(was.z)));
    if (max(change.x, max(change.y, change.z)) > 1e-5 * largest) {
        atomicAdd(&state.clipped, 1u);
        history = from_ycocg(kept);
    }
    if (is_number) {
        let new_weight = taa.alpha * weight_of(color);
        let old_weight = (1.0 - taa.alpha) * weight_of(history);
        history += (color - history) * (new_weight / (new_weight + old_weight));
    }
    next[i] = vec4f(history, 1.0);
}

@compute @workgroup_size(1)
fn count_frame() {
    state.frames = min(state.frames, 65535u) + 1u;
}
