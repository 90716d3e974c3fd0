// Twin of stochastic/src/filter/guides.rs: what stops a filter between two pixels.

// How much speaks against mixing p and q, `offset` apart; both are surfaces. The same from both sides.
fn stop_exponent(p: Guide, q: Guide, offset: vec2f, svgf: SvgfUniform) -> f32 {
    let cosine = p.normal.x * q.normal.x + p.normal.y * q.normal.y + p.normal.z * q.normal.z;
    let turn = max(1.0 - cosine, 0.0);
    let of_p = p.slope.x * offset.x + p.slope.y * offset.y;
    let of_q = q.slope.x * offset.x + q.slope.y * offset.y;
    let unexplained = abs(q.depth - p.depth - 0.5 * (of_p + of_q));
    let scale = 0.5 * (abs(of_p) + abs(of_q)) + svgf.depth_floor * (0.5 * (p.depth + q.depth));
    return svgf.normal_power * turn + svgf.depth_stop * unexplained / scale;
}

// About exp(-exponent): (1 - exponent/64)^64, exactly 0 from 64 on.
fn falloff(exponent: f32) -> f32 {
    let rest = max(1.0 - exponent * (1.0 / 64.0), 0.0);
    let squared = rest * rest;
    let fourth = squared * squared;
    let eighth = fourth * fourth;
    let sixteenth = eighth * eighth;
    return (sixteenth * sixteenth) * (sixteenth * sixteenth);
}

// Weight of q in p by guides alone.
fn guide_weight(p: Guide, q: Guide, offset: vec2f, svgf: SvgfUniform) -> f32 {
    if (p.mesh != q.mesh || p.depth >= NO_SURFACE || q.depth >= NO_SURFACE) {
        return 0.0;
    }
    return falloff(stop_exponent(p, q, offset, svgf));
}
