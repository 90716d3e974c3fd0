// Twin of `Bsdf::scatter` in scene/src/bsdf.rs: Lambert, a Lambert base under a GGX lobe (bsdf/ggx.rs), and one with a Phong lobe (bsdf/phong.rs).
// Needs records.wgsl.

const INVERSE_PI: f32 = 0.31830987;

fn pow5(x: f32) -> f32 {
    let x2 = x * x;
    return x2 * x2 * x;
}

// Schlick 1994.
fn schlick(f0: f32, f90: f32, cosine: f32) -> f32 {
    return f0 + (f90 - f0) * pow5(1.0 - clamp(cosine, 0.0, 1.0));
}

// cos sqrt(1 + alpha^2 tan^2).
fn smith(a2: f32, cosine: f32) -> f32 {
    return sqrt(cosine * cosine * (1.0 - a2) + a2);
}

// f * cos per channel; every direction is a unit vector away from the surface.
fn scatter(surface: LitSurface, wi: vec3f) -> vec3f {
    let cos_i = dot(surface.normal, wi);
    if (cos_i <= 0.0) {
        return vec3f(0.0);
    }
    // A surface without a lobe is Lambert.
    if (surface.alpha == 0.0) {
        return surface.base * cos_i;
    }
    let cos_o = dot(surface.normal, surface.view);
    if (surface.alpha < 0.0) {
        // Lafortune and Willems 1994; the exponent is -alpha.
        let mirrored = normalize(2.0 * cos_o * surface.normal - surface.view);
        let cosine = max(dot(mirrored, wi), 0.0);
        let lobe = (2.0 - surface.alpha) * 0.5 * INVERSE_PI * select(0.0, pow(cosine, -surface.alpha), cosine > 0.0);
        return (surface.base + surface.f0 * lobe) * cos_i;
    }
    if (cos_o <= 0.0) {
        return vec3f(0.0);
    }
    let through = (1.0 - schlick(surface.interface_f0, surface.interface_f90, cos_o))
        * (1.0 - schlick(surface.interface_f0, surface.interface_f90, cos_i));
    let half_vector = surface.view + wi;
    let squared = dot(half_vector, half_vector);
    let a2 = surface.alpha * surface.alpha;
    let along = dot(surface.normal, half_vector);
    let across = cross(surface.normal, half_vector);
    let d = (a2 * along * along + dot(across, across)) / squared;
    let smiths = cos_i * smith(a2, cos_o) + cos_o * smith(a2, cos_i);
    let lobe = 0.5 * INVERSE_PI * a2 / (d * d * smiths);
    let weight = pow5(max(1.0 - 0.5 * sqrt(squared), 0.0));
    let fresnel = surface.f0 + (surface.f90 - surface.f0) * weight;
    return (surface.base * through + fresnel * lobe) * cos_i;
}
