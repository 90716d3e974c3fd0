// Workgroups in two dimensions, as `grid` in src/kernel.rs dispatches them, numbered row by row.

fn workgroup_index(workgroup: vec3u, grid: vec3u) -> u32 {
    return workgroup.y * grid.x + workgroup.x;
}
