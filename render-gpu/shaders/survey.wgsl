// Twin of lighttree/src/build/survey.rs: where the lights are, how many, how strong.
// Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4: bounds by parallel reduction.
//
// Two dispatches: each workgroup of `survey` looks at a part of all lights, and the one of `plan` puts the
// parts together and lays out the tree. Every field is a minimum, a maximum or a count, so the order of
// looking does not matter.

struct Part {
    min: vec3f,
    kept: u32,
    max: vec3f,
    // Bits of the largest intensity: those of non-negative floats order as the floats do.
    strongest: u32,
    dropped: u32,
    invalid: u32,
}

const THREADS: u32 = 256u;
const HUGE: f32 = 3.4028234e38;
const NO_LIGHTS = Part(vec3f(HUGE), 0u, vec3f(-HUGE), 0u, 0u, 0u);

@group(0) @binding(0) var<uniform> params: BuildParams;
@group(0) @binding(1) var<storage, read> lights: array<LightRecord>;
@group(0) @binding(2) var<storage, read_write> parts: array<Part>;
@group(0) @binding(3) var<storage, read_write> header: TreeHeader;

var<workgroup> shared_parts: array<Part, THREADS>;

fn joined(a: Part, b: Part) -> Part {
    return Part(
        min(a.min, b.min),
        a.kept + b.kept,
        max(a.max, b.max),
        max(a.strongest, b.strongest),
        a.dropped + b.dropped,
        a.invalid + b.invalid,
    );
}

// Puts the parts of all threads together, in two steps of 16; the result is in the first.
fn reduce(thread: u32, own: Part) {
    shared_parts[thread] = own;
    workgroupBarrier();
    if (thread < 16u) {
        join_from(thread, 16u);
    }
    workgroupBarrier();
    if (thread == 0u) {
        join_from(0u, 1u);
    }
    workgroupBarrier();
}

// Into the part at `first` also the 15 after it, so far apart.
fn join_from(first: u32, apart: u32) {
    var all = shared_parts[first];
    for (var i = 1u; i < 16u; i++) {
        all = joined(all, shared_parts[first + i * apart]);
    }
    shared_parts[first] = all;
}

@compute @workgroup_size(THREADS)
fn survey(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) grid: vec3u,
) {
    var own = NO_LIGHTS;
    for (var i = workgroup.x * THREADS + thread; i < params.lights; i += grid.x * THREADS) {
        let light = lights[i];
        let excluded = exclusion(light);
        if (excluded == 0u) {
            let center = half_center(light);
            own.min = min(own.min, center);
            own.max = max(own.max, center);
            own.strongest = max(own.strongest, bitcast<u32>(light.intensity));
            own.kept += 1u;
        } else {
            own.dropped += u32(excluded == 1u);
            own.invalid += u32(excluded == 2u);
        }
    }
    reduce(thread, own);
    if (thread == 0u) {
        parts[workgroup.x] = shared_parts[0];
    }
}

// 1024 / x, rounded to nearest; 0 where that is infinite. Division on a device need not be that exact, and a
// cell must be the same everywhere.
fn cells_per(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let exponent = i32(bits >> 23u);
    if (exponent == 0) {
        // No extent, or one below the normal numbers.
        return 0.0;
    }
    // x = divisor · 2^(exponent - 150), and the quotient of 2^47 by the divisor is in (2^23, 2^24].
    let divisor = (bits & 0x7fffffu) | 0x800000u;
    var quotient = 0u;
    var remainder = 0u;
    for (var i = 0u; i < 48u; i++) {
        remainder = (remainder << 1u) | u32(i == 0u);
        quotient <<= 1u;
        if (remainder >= divisor) {
            remainder -= divisor;
            quotient |= 1u;
        }
    }
    // No tie: 2^48 would be the divisor times an odd number.
    if (2u * remainder > divisor) {
        quotient += 1u;
    }
    // 2^10 / x = quotient · 2^(113 - exponent).
    var biased = 263 - exponent;
    if (quotient == 0x1000000u) {
        quotient >>= 1u;
        biased += 1;
    }
    if (biased >= 255) {
        return 0.0;
    }
    return bitcast<f32>((u32(biased) << 23u) | (quotient & 0x7fffffu));
}

// The smallest exponent of a power of two as whose multiples the intensities of all lights sum up to no more
// than half of what f32 holds.
fn unit_exponent(strongest: u32, kept: u32) -> u32 {
    // strongest = mantissa · 2^(exponent - 150), and half of the largest f32 is (2^24 - 1) · 2^103.
    let exponent = strongest >> 23u;
    // Too weak to matter for any number of lights, and for the arithmetic below.
    if (exponent < 220u) {
        return 0u;
    }
    let most = wide_product((strongest & 0x7fffffu) | 0x800000u, kept);
    var unit = 0u;
    while (unit < 32u && is_above(most, i32(exponent) - 253 - i32(unit))) {
        unit += 1u;
    }
    return unit;
}

// Whether number · 2^shift > 2^24 - 1, for a number below 2^55 and a shift of at most 1.
fn is_above(number: vec2u, shift: i32) -> bool {
    if (shift >= 0) {
        let scaled = wide_scale(number, 1u << u32(shift));
        return wide_less(vec2u(0u, 0xffffffu), scaled);
    }
    let up = u32(-shift);
    if (up >= 40u) {
        return false;
    }
    var limit = vec2u(0u, 0xffffffu << (up & 31u));
    if (up >= 32u) {
        limit = vec2u(0xffffffu << (up - 32u), 0u);
    } else {
        limit.x = 0xffffffu >> (32u - up);
    }
    return wide_less(limit, number);
}

@compute @workgroup_size(THREADS)
fn plan(@builtin(local_invocation_index) thread: u32) {
    var own = NO_LIGHTS;
    if (thread < params.parts) {
        own = parts[thread];
    }
    reduce(thread, own);
    if (thread > 0u) {
        return;
    }
    let all = shared_parts[0];
    header.len = all.kept;
    header.dropped = all.dropped;
    header.invalid = all.invalid;
    header.min = all.min;
    header.scale = vec3f(0.0);
    header.unit_exponent = 0u;
    // Levels that halving needs until one is left.
    let depth = select(0u, firstLeadingBit(2u * max(all.kept, 1u) - 1u), all.kept > 1u);
    header.depth = depth;
    if (all.kept > 0u) {
        let extent = all.max - all.min;
        header.scale = vec3f(cells_per(extent.x), cells_per(extent.y), cells_per(extent.z));
        header.unit_exponent = unit_exponent(all.strongest, all.kept);
    }
    var start = 0u;
    for (var d = 0u; d < 32u; d++) {
        header.starts[d] = start;
        if (d == depth) {
            header.inner = start;
        }
        if (d <= depth && all.kept > 0u) {
            start += ((all.kept - 1u) >> (depth - d)) + 1u;
        }
    }
}
