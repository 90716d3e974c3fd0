// Rays against one mesh in world space.
//
// A file of its own, since software runs what a branch skips: with the tree over instances in the same
// kernel, Mesa's takes twice as long for a shadow ray.

// The nearest hit at 0 < t < t_max, ties to the lowest primitive; `primitive` is NO_HIT without one.
fn trace_closest(origin: vec3f, direction: vec3f, t_max: f32) -> Hit {
    let ask = asked(origin, direction, t_max);
    let ray = traced(ask.start, ask.towards, ray_tree.reach);
    var best = ask.best;
    if (ask.valid && ray.valid) {
        best = nearest_below(ray_tree.root, ray, 0u, best);
    }
    return answered(best, ask.unit);
}

// Whether anything lies strictly between both points.
fn trace_occluded(start: vec3f, end: vec3f) -> bool {
    return occluded_below(ray_tree.root, start * ray_tree.scale, end * ray_tree.scale, ray_tree.reach);
}
