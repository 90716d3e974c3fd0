// The records of src/records.rs, and lighttree's PerfectNode. tests/layout.rs compares both sides.

// A box and the strength in it.
struct LightRecord {
    min: vec3f,
    intensity: f32,
    max: vec3f,
    user: u32,
}

// A node of the perfect tree: leaf: `id` is the light; inner node number n: the slot of light n.
struct PerfectNode {
    min: vec3f,
    intensity: f32,
    max: vec3f,
    id: u32,
}

struct TreeHeader {
    min: vec3f,
    len: u32,
    scale: vec3f,
    depth: u32,
    dropped: u32,
    invalid: u32,
    unit_exponent: u32,
    inner: u32,
    starts: array<u32, 32>,
}

const NONE: u32 = 0xffffffffu;
