// Twin of stochastic/src/filter/illumination.rs: radiance without texture. Needs `svgf`, `light`, `albedo` and `emission`.

fn factor(i: u32) -> vec3f {
    return max(albedo[i].xyz, vec3f(svgf.albedo_floor));
}

fn emitted(i: u32) -> vec3f {
    if ((svgf.inputs & 1u) == 0u) {
        return vec3f(0.0);
    }
    return emission[i].xyz;
}

fn illumination(i: u32) -> vec3f {
    return (light[i].xyz - emitted(i)) / factor(i);
}
