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

// Half the centre of the box: the half keeps even the difference of two of them from overflowing. The products are exact,
// so it does not matter whether the sum is fused with one of them.
fn half_center(light: LightRecord) -> vec3f {
    return 0.25 * light.min + 0.25 * light.max;
}
