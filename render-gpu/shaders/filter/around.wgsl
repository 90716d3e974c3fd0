// Twin of `around` and `unbiased` in stochastic/src/filter/moments.rs: the variance of luminance around a pixel. Needs `svgf`, `guides` and `signal`.

fn variance_around(at: vec2i, spacing: i32) -> f32 {
    let size = vec2i(i32(svgf.width), i32(svgf.height));
    let here = u32(at.y * size.x + at.x);
    let p = guides[here];
    let own = luminance(signal[here].xyz);
    var weights = 0.0;
    var squares = 0.0;
    var first = 0.0;
    var second = 0.0;
    for (var j = -3; j <= 3; j++) {
        for (var i = -3; i <= 3; i++) {
            let offset = vec2i(i, j) * spacing;
            let place = at + offset;
            if (all(place >= vec2i(0)) && all(place < size)) {
                let there = u32(place.y * size.x + place.x);
                let weight = guide_weight(p, guides[there], vec2f(offset), svgf);
                let difference = luminance(signal[there].xyz) - own;
                weights += weight;
                squares += weight * weight;
                first += weight * difference;
                second += weight * difference * difference;
            }
        }
    }
    if (weights <= 0.0) {
        return 0.0;
    }
    let mean = first / weights;
    let mean_square = second / weights;
    // The share that the correction for the mean leaves: 1 - 1/n for n equal weights.
    let free = 1.0 - squares / (weights * weights);
    if (free > 1e-3) {
        return max(mean_square - mean * mean, 0.0) / free;
    }
    return 0.0;
}
