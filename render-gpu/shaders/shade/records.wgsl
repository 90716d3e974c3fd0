// What is lit, and by what: shared with src/shade.rs.

// Kinds of emitters.
const POINT_EMITTER: u32 = 0u;
const SPOT_EMITTER: u32 = 1u;
const COSINE_EMITTER: u32 = 2u;
const TRIANGLE_EMITTER: u32 = 3u;
const TWO_SIDED_EMITTER: u32 = 4u;

struct Emitter {
    // Position, or the first corner.
    a: vec3f,
    kind: u32,
    // Axis of a spot, normal of a cosine, second corner.
    b: vec3f,
    cos_inner: f32,
    // Third corner.
    c: vec3f,
    cos_outer: f32,
    // Peak radiant intensity, or radiance of a triangle.
    color: vec3f,
    // How far along its normal a shadow ray ends off the light.
    offset: f32,
}

struct LitSurface {
    position: vec3f,
    // Distance along the geometric normal by which a shadow ray starts off the surface.
    offset: f32,
    geometric_normal: vec3f,
    // Of the random numbers for places on lights, the pixel as a rule.
    stream: u32,
    normal: vec3f,
    // Width of a GGX lobe, roughness squared; 0: none; negative: minus the exponent of a Phong lobe.
    alpha: f32,
    view: vec3f,
    // Reflectance of the lobe at grazing incidence.
    f90: f32,
    // Albedo of the base over pi, with what the interface takes from it.
    base: vec3f,
    // Reflectance of the interface over the base at normal incidence.
    interface_f0: f32,
    // Reflectance of the lobe at normal incidence.
    f0: vec3f,
    interface_f90: f32,
}

struct Radiance {
    color: vec3f,
    // Shadow rays in the lower 16 bits, lights looked at in the upper.
    counts: u32,
}
