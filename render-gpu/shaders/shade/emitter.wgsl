// Twin of `Light::point_by_area` and `LightPoint::intensity_toward` in scene/src/light. Needs records.wgsl.
//
// Differs from there: points on triangles are drawn by area however near they are, and emission has no
// texture.

struct EmitterPoint {
    position: vec3f,
    // Where a shadow ray to it ends.
    end: vec3f,
    // Radiant intensity towards whoever asked.
    intensity: vec3f,
}

// Uniform over a triangle's area.
fn barycentric(u: vec2f) -> vec3f {
    let root = sqrt(u.x);
    return vec3f(1.0 - root, root * (1.0 - u.y), root * u.y);
}

// KHR_lights_punctual: full inside the inner cone, a squared ramp in the cosine, nothing outside.
fn spot_falloff(cosine: f32, cos_inner: f32, cos_outer: f32) -> f32 {
    if (cosine >= cos_inner) {
        return 1.0;
    }
    if (cosine <= cos_outer) {
        return 0.0;
    }
    let ramp = (cosine - cos_outer) / (cos_inner - cos_outer);
    return ramp * ramp;
}

// The point of the emitter at `u` as `position` sees it.
fn emitter_point(emitter: Emitter, u: vec2f, position: vec3f) -> EmitterPoint {
    var at = emitter.a;
    var normal = emitter.b;
    var intensity = emitter.color;
    if (emitter.kind >= TRIANGLE_EMITTER) {
        let weights = barycentric(u);
        at = weights.x * emitter.a + weights.y * emitter.b + weights.z * emitter.c;
        let spanned = cross(emitter.b - emitter.a, emitter.c - emitter.a);
        let double_area = length(spanned);
        if (double_area <= 0.0) {
            return EmitterPoint(at, at, vec3f(0.0));
        }
        normal = spanned / double_area;
        intensity *= 0.5 * double_area;
    }
    let to = position - at;
    let distance = length(to);
    if (distance <= 0.0) {
        return EmitterPoint(at, at, vec3f(0.0));
    }
    let cosine = dot(normal, to) / distance;
    var end = at;
    switch emitter.kind {
        case POINT_EMITTER: {}
        case SPOT_EMITTER: {
            intensity *= spot_falloff(cosine, emitter.cos_inner, emitter.cos_outer);
        }
        case TWO_SIDED_EMITTER: {
            intensity *= abs(cosine);
            end += select(emitter.offset, -emitter.offset, cosine < 0.0) * normal;
        }
        default: {
            intensity *= max(cosine, 0.0);
            end += emitter.offset * normal;
        }
    }
    return EmitterPoint(at, end, intensity);
}
