// Records of rays, shared with src/rays/records.rs.

struct Ray {
    origin: vec3f,
    // End of the ray, exclusive, in lengths of the direction.
    t_max: f32,
    direction: vec3f,
    spare: u32,
}

struct Segment {
    start: vec3f,
    spare0: u32,
    end: vec3f,
    spare1: u32,
}

// `primitive` is NO_HIT where nothing was hit.
struct Hit {
    t: f32,
    primitive: u32,
    u: f32,
    v: f32,
}

const NO_HIT: u32 = 0xffffffffu;
