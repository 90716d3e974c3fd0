// Which lights are in a tree, and where they count as being.

// A number that is neither NaN nor infinite; by its bits, since comparisons may assume that there are none.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

fn all_finite(v: vec3f) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// 0: in the tree. 1: without intensity. 2: not a light at all.
fn exclusion(light: LightRecord) -> u32 {
    let finite = all_finite(light.min) && all_finite(light.max) && is_finite(light.intensity);
    // By bits, so that an intensity below the normal numbers is not lost where a device has none.
    let bits = bitcast<u32>(light.intensity);
    if (!finite || any(light.min > light.max) || bits > 0x80000000u) {
        return 2u;
    }
    return select(0u, 1u, (bits & 0x7fffffffu) == 0u);
}

// A quarter of a number, by its exponent where it is large enough. As a product a compiler may take 0.25 · a +
// 0.25 · b together, and their sum overflow.
fn quarter(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    if (((bits >> 23u) & 0xffu) < 3u) {
        return 0.25 * x;
    }
    return bitcast<f32>(bits - 0x1000000u);
}

// Half the centre of the box: the half keeps even the difference of two of them from overflowing.
fn half_center(light: LightRecord) -> vec3f {
    let low = vec3f(quarter(light.min.x), quarter(light.min.y), quarter(light.min.z));
    let high = vec3f(quarter(light.max.x), quarter(light.max.y), quarter(light.max.z));
    return low + high;
}
