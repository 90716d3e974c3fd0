// Rays against instances of meshes: a tree over them, and each mesh's own.

struct RayInstance {
    // Rows of the map from the tree's scale of the world to that of the mesh.
    x: vec4f,
    y: vec4f,
    z: vec4f,
    root: u32,
    first_primitive: u32,
    reach: f32,
    spare: u32,
}

@group(1) @binding(3) var<storage, read> ray_instances: array<RayInstance>;

// Links that wait in the tree over instances.
const TOP_STACK: u32 = 48u;

var<private> top_stack: array<u32, TOP_STACK>;

fn into_mesh(instance: u32, point: vec3f) -> vec3f {
    let p = vec4f(point, 1.0);
    return vec3f(
        dot(ray_instances[instance].x, p), dot(ray_instances[instance].y, p), dot(ray_instances[instance].z, p)
    );
}

fn turned_into_mesh(instance: u32, direction: vec3f) -> vec3f {
    return vec3f(
        dot(ray_instances[instance].x.xyz, direction),
        dot(ray_instances[instance].y.xyz, direction),
        dot(ray_instances[instance].z.xyz, direction),
    );
}

// The nearest hit at 0 < t < t_max, ties to the lowest primitive; `primitive` is NO_HIT without one.
fn trace_closest(origin: vec3f, direction: vec3f, t_max: f32) -> Hit {
    let ask = asked(origin, direction, t_max);
    let ray = traced(ask.start, ask.towards, ray_tree.reach);
    var best = ask.best;
    if (!ask.valid || !ray.valid || ray_tree.root == NO_CHILD) {
        return answered(best, ask.unit);
    }
    var waiting = 0u;
    var link = ray_tree.root;
    loop {
        if ((link & LEAF) == 0u) {
            let node = wide_node(link);
            let enter = enter_children(node, ray, best.t);
            let child = node.child;
            for (var i = 0u; i < 4u; i++) {
                if (enter[i] < FAR) {
                    top_stack[waiting] = child[i];
                    waiting++;
                }
            }
        } else {
            best = nearest_in_instance(link & 0x0fffffffu, ask.start, ask.towards, best);
        }
        if (waiting == 0u) {
            break;
        }
        waiting--;
        link = top_stack[waiting];
    }
    return answered(best, ask.unit);
}

fn nearest_in_instance(instance: u32, start: vec3f, towards: vec3f, best: Hit) -> Hit {
    let direction = turned_into_mesh(instance, towards);
    let e = exponent_of(direction);
    if (e <= -127 || e >= 128) {
        return best;
    }
    let ray = traced(into_mesh(instance, start), near_unit(direction, e), ray_instances[instance].reach);
    if (!ray.valid) {
        return best;
    }
    var local = best;
    local.t = min(times_power(best.t, e), FAR);
    let found = nearest_below(
        ray_instances[instance].root, ray, ray_instances[instance].first_primitive, local
    );
    if (found.primitive == best.primitive) {
        return best;
    }
    return Hit(times_power(found.t, -e), found.primitive, found.u, found.v);
}

// Whether anything lies strictly between both points.
fn trace_occluded(start: vec3f, end: vec3f) -> bool {
    let from_ = start * ray_tree.scale;
    let to = end * ray_tree.scale;
    let ray = traced(from_, to - from_, ray_tree.reach);
    if (!ray.valid || ray_tree.root == NO_CHILD) {
        return false;
    }
    var waiting = 0u;
    var link = ray_tree.root;
    loop {
        if ((link & LEAF) == 0u) {
            let node = wide_node(link);
            let enter = enter_children(node, ray, 1.0);
            let child = node.child;
            for (var i = 0u; i < 4u; i++) {
                if (enter[i] < FAR) {
                    top_stack[waiting] = child[i];
                    waiting++;
                }
            }
        } else {
            let instance = link & 0x0fffffffu;
            if (occluded_below(
                ray_instances[instance].root,
                into_mesh(instance, from_),
                into_mesh(instance, to),
                ray_instances[instance].reach,
            )) {
                return true;
            }
        }
        if (waiting == 0u) {
            return false;
        }
        waiting--;
        link = top_stack[waiting];
    }
    return false;
}
