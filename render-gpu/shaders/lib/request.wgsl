// What the drawing kernels are asked for: `DrawParams` of src/records.rs; and what they answer.

struct DrawParams {
    // Receivers in the buffer.
    receivers: u32,
    // Entries for each.
    lights: u32,
    seed: u32,
    // Frame or pass.
    index: u32,
    // Stream of the first receiver.
    first_stream: u32,
    // Most nodes of a cut.
    nodes: u32,
    // Lights from each of its nodes.
    per_node: u32,
    // Nodes nearer than this share of the radius of all lights count as that far, when a cut is made.
    distance_floor: f32,
    // Picture and blocks of pixels that share a cut; side of the sub-blocks that it is interleaved over.
    width: u32,
    height: u32,
    block: u32,
    interleave: u32,
    // Of distributions: whether anything is learned, and the share of draws that does not go by it.
    learn: u32,
    defensive: f32,
    // Of guarded shared cuts: least cosine between normals, where the camera is, and largest distances in
    // depths.
    guard: u32,
    min_normal_cos: f32,
    eye: vec3f,
    max_plane_distance: f32,
    max_distance: f32,
    spare0: u32,
    spare1: u32,
    spare2: u32,
}

// What an entry is to be learned by: the place of its node in the cut (NONE if none was drawn), and 1 ÷
// (probability below it × the node's weight), 0 if no light was.
struct NodeTag {
    node: u32,
    scale: f32,
}

struct WeightedLight {
    light: u32,
    weight: f32,
}

const NO_LIGHT = WeightedLight(NONE, 0.0);
