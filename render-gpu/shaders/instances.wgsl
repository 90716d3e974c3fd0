// What a tree of two levels binds beside the tree over its instances.

// Where the lights of a mesh are: `InstanceRecord` of src/two_level.rs.
struct LightInstance {
    // Rows of the map from the mesh to the world.
    x: vec4f,
    y: vec4f,
    z: vec4f,
    mesh: u32,
    // Number of its first light.
    first_light: u32,
    // Index of its mesh's root in `mesh_nodes`.
    first_node: u32,
    // What intensities are multiplied by.
    strength: f32,
}

@group(1) @binding(0) var<storage, read> instances: array<LightInstance>;
@group(1) @binding(1) var<storage, read> mesh_headers: array<TreeHeader>;
@group(1) @binding(2) var<storage, read> mesh_nodes: array<PerfectNode>;
