// Rays against a tree of 4-wide quantised nodes. Twin of scene/src/rays: the same triangle test, operation for operation.
//
// `one_level.wgsl` or `two_level.wgsl` comes after this file. The whole face of both is `trace_closest` and
// `trace_occluded`: a host with hardware ray queries puts its own two functions, and what they bind in group
// 1, in their place.
//
// Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013; nodes after Ylitie, Karras,
// Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017, with four
// children and full links instead of eight.

struct RayTree {
    // Power of two that brings the world's coordinates into the tree's, and its exponent.
    scale: f32,
    scale_exponent: i32,
    // Largest coordinate in the tree's own scale.
    reach: f32,
    // Link to the root: of the tree over instances, or of the only mesh.
    root: u32,
    // Texels in a row of nodes and of triangles: 2^this.
    node_row: u32,
    triangle_row: u32,
    spare0: u32,
    spare1: u32,
}

// Four texels. Children lie in `origin + q * 2^e`, q from `low` to `high`, one byte for each child.
struct WideNode {
    origin: vec3f,
    // Biased exponents of x, y, z, a byte each.
    exponents: u32,
    child: vec4u,
    low: vec3u,
    spare0: u32,
    high: vec3u,
    spare1: u32,
}

// Three texels.
struct RayTriangle {
    a: vec3f,
    primitive: u32,
    b: vec3f,
    spare0: u32,
    c: vec3f,
    spare1: u32,
}

@group(1) @binding(0) var<uniform> ray_tree: RayTree;
// Records in texels of 16 bytes, row by row. In textures and not in buffers, since software reads a texel for
// eight threads in a few instructions, and a word of a buffer in a loop over the threads.
@group(1) @binding(1) var ray_nodes: texture_storage_2d<rgba32uint, read>;
@group(1) @binding(2) var ray_triangles: texture_storage_2d<rgba32uint, read>;

// A link is the index of a node, or LEAF | (count - 1) << 28 | index of the first of them.
const LEAF: u32 = 0x80000000u;
const NO_CHILD: u32 = 0xffffffffu;
// Links that wait. An upload proves that no traversal needs more; the next link goes through the stack, too,
// and one that is not hit may lie above it.
const STACK: u32 = 64u;
// In place of infinity, which WGSL need not know.
const FAR: f32 = 3.0e38;
// How far slabs are padded, in units of 2^-23 of the largest coordinate: twice the CPU's, for quotients of
// 2.5 ulp.
const PADDING: f32 = 16.0 * 1.1920929e-7;

// The stack of links in a mesh's tree. A function's own array is set to zero wherever the function is called,
// thread by thread where threads have diverged; this one once, before.
var<private> ray_stack: array<u32, STACK + 2u>;

struct Traced {
    origin: vec3f,
    inverse: vec3f,
    // Origin moved outwards on both sides of every slab.
    enter: vec3f,
    leave: vec3f,
    // Where the high planes are entered first.
    negative: vec3<bool>,
    // The dominant axis, and the shear that turns the ray into it.
    axis: u32,
    shear: vec3f,
    valid: bool,
}

// x, y, z with the dominant axis last; the other two keep their turn.
fn dominant_last(v: vec3f, axis: u32) -> vec3f {
    let turned = select(v.zxy, v.yzx, axis == 0u);
    return select(turned, v, axis == 2u);
}

fn is_number(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

// A ray in a tree's own scale; its direction not shorter than 1e-20.
fn traced(origin: vec3f, direction: vec3f, reach: f32) -> Traced {
    var ray: Traced;
    let size = abs(direction);
    ray.axis = select(select(2u, 1u, size.y > size.z), select(2u, 0u, size.x > size.z), size.x > size.y);
    ray.negative = vec3<bool>(direction.x < 0.0, direction.y < 0.0, direction.z < 0.0);
    let sign = select(vec3f(1.0), vec3f(-1.0), ray.negative);
    let dominant = dominant_last(direction, ray.axis);
    // A relative floor: infinite inverses would meet in the slabs.
    ray.inverse = sign / max(size, vec3f(1e-12 * abs(dominant.z)));
    let inverse_z = dominant_last(ray.inverse, ray.axis).z;
    ray.shear = vec3f(dominant.xy * inverse_z, inverse_z);
    let away = max(abs(origin.x), max(abs(origin.y), abs(origin.z)));
    let outward = PADDING * (away + reach) * sign;
    ray.origin = origin;
    ray.enter = origin + outward;
    ray.leave = origin - outward;
    ray.valid = is_number(away) && is_number(size.x + size.y + size.z) && is_number(inverse_z);
    return ray;
}

fn node_texel(texel: u32) -> vec4u {
    return textureLoad(ray_nodes, vec2u(texel & ((1u << ray_tree.node_row) - 1u), texel >> ray_tree.node_row));
}

fn wide_node(index: u32) -> WideNode {
    let texel = 4u * index;
    let frame = node_texel(texel);
    let low = node_texel(texel + 2u);
    let high = node_texel(texel + 3u);
    return WideNode(
        bitcast<vec3f>(frame.xyz), frame.w, node_texel(texel + 1u), low.xyz, low.w, high.xyz, high.w
    );
}

fn triangle_texel(texel: u32) -> vec4u {
    let row = ray_tree.triangle_row;
    return textureLoad(ray_triangles, vec2u(texel & ((1u << row) - 1u), texel >> row));
}

fn ray_triangle(index: u32) -> RayTriangle {
    let texel = 3u * index;
    let a = triangle_texel(texel);
    let b = triangle_texel(texel + 1u);
    let c = triangle_texel(texel + 2u);
    return RayTriangle(
        bitcast<vec3f>(a.xyz), a.w, bitcast<vec3f>(b.xyz), b.w, bitcast<vec3f>(c.xyz), c.w
    );
}

// Where the ray enters each child before `t_max`; FAR where it does not.
fn enter_children(node: WideNode, ray: Traced, t_max: f32) -> vec4f {
    let cell = bitcast<vec3f>(
        (vec3u(node.exponents, node.exponents >> 8u, node.exponents >> 16u) & vec3u(0xffu)) << vec3u(23u)
    );
    let step = cell * ray.inverse;
    let from_enter = (node.origin - ray.enter) * ray.inverse;
    let from_leave = (node.origin - ray.leave) * ray.inverse;
    let near = select(node.low, node.high, ray.negative);
    let far = select(node.high, node.low, ray.negative);
    let enter = max(
        max(bytes(near.x) * step.x + from_enter.x, bytes(near.y) * step.y + from_enter.y),
        max(bytes(near.z) * step.z + from_enter.z, vec4f(0.0)),
    );
    let leave = min(
        min(bytes(far.x) * step.x + from_leave.x, bytes(far.y) * step.y + from_leave.y),
        min(bytes(far.z) * step.z + from_leave.z, vec4f(t_max)),
    );
    // A child that is not there has an inverted box, but padding could turn it round.
    return select(vec4f(FAR), enter, (enter <= leave) & (node.child != vec4u(NO_CHILD)));
}

fn bytes(word: u32) -> vec4f {
    return vec4f(
        vec4u(word & 0xffu, (word >> 8u) & 0xffu, (word >> 16u) & 0xffu, word >> 24u)
    );
}

// Twice the signed area that two projected corners span with the ray. The ends are put in an order of their
// own first: the triangle on the other side of the edge then gets exactly the opposite, also where a driver
// fuses one of the products.
fn edge(p: vec2f, q: vec2f) -> f32 {
    let swap = p.x > q.x || (p.x == q.x && p.y > q.y);
    let a = select(p, q, swap);
    let b = select(q, p, swap);
    let area = a.x * b.y - a.y * b.x;
    return select(area, -area, swap);
}

// t and the weights of the second and third corner; t is -1 for a miss. The ends of edges belong to the
// triangle.
fn triangle(corners: RayTriangle, ray: Traced) -> vec3f {
    let a = dominant_last(corners.a - ray.origin, ray.axis);
    let b = dominant_last(corners.b - ray.origin, ray.axis);
    let c = dominant_last(corners.c - ray.origin, ray.axis);
    let pa = a.xy - ray.shear.xy * a.z;
    let pb = b.xy - ray.shear.xy * b.z;
    let pc = c.xy - ray.shear.xy * c.z;
    let u = edge(pc, pb);
    let v = edge(pa, pc);
    let w = edge(pb, pa);
    let inside = min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0;
    let sum = u + v + w;
    // Edge-on all three are 0: a miss, which its neighbours cover.
    if (!inside || sum == 0.0) {
        return vec3f(-1.0, 0.0, 0.0);
    }
    let t = (u * a.z + v * b.z + w * c.z) * ray.shear.z / sum;
    return vec3f(t, v / sum, w / sum);
}

// Whether anything below `root` lies at 0 < t < t_max.
fn any_below(root: u32, ray: Traced, t_max: f32) -> bool {
    var waiting = 0u;
    var link = root;
    if (root == NO_CHILD) {
        return false;
    }
    loop {
        // Down to a leaf.
        while ((link & LEAF) == 0u) {
            let node = wide_node(link);
            let enter = enter_children(node, ray, t_max);
            let child = node.child;
            // Written whether hit or not: cheaper than a branch for each.
            ray_stack[waiting] = child.x;
            waiting += u32(enter.x < FAR);
            ray_stack[waiting] = child.y;
            waiting += u32(enter.y < FAR);
            ray_stack[waiting] = child.z;
            waiting += u32(enter.z < FAR);
            ray_stack[waiting] = child.w;
            waiting += u32(enter.w < FAR);
            if (waiting == 0u) {
                return false;
            }
            waiting--;
            link = ray_stack[waiting];
        }
        // Its triangles.
        let first = link & 0x0fffffffu;
        let end = first + ((link >> 28u) & 7u) + 1u;
        for (var i = first; i < end; i++) {
            let t = triangle(ray_triangle(i), ray).x;
            if (t > 0.0 && t < t_max) {
                return true;
            }
        }
        if (waiting == 0u) {
            return false;
        }
        waiting--;
        link = ray_stack[waiting];
    }
    return false;
}

// The nearest of what is below `root` and of `best`; ties to the lowest primitive. Distances in the unit of
// `ray`.
fn nearest_below(root: u32, ray: Traced, first_primitive: u32, best_so_far: Hit) -> Hit {
    var best = best_so_far;
    var waiting = 0u;
    var link = root;
    if (root == NO_CHILD) {
        return best;
    }
    loop {
        while ((link & LEAF) == 0u) {
            let node = wide_node(link);
            var enter = enter_children(node, ray, best.t);
            var child = node.child;
            // Farthest first onto the stack, by a network of five comparisons.
            sort_pair(&enter, &child, 0u, 1u);
            sort_pair(&enter, &child, 2u, 3u);
            sort_pair(&enter, &child, 0u, 2u);
            sort_pair(&enter, &child, 1u, 3u);
            sort_pair(&enter, &child, 1u, 2u);
            ray_stack[waiting] = child.w;
            waiting += u32(enter.w < FAR);
            ray_stack[waiting] = child.z;
            waiting += u32(enter.z < FAR);
            ray_stack[waiting] = child.y;
            waiting += u32(enter.y < FAR);
            ray_stack[waiting] = child.x;
            waiting += u32(enter.x < FAR);
            if (waiting == 0u) {
                return best;
            }
            waiting--;
            link = ray_stack[waiting];
        }
        let first = link & 0x0fffffffu;
        let end = first + ((link >> 28u) & 7u) + 1u;
        for (var i = first; i < end; i++) {
            let corners = ray_triangle(i);
            let hit = triangle(corners, ray);
            if (hit.x > 0.0 && hit.x <= best.t) {
                let primitive = first_primitive + corners.primitive;
                if (hit.x < best.t || (primitive < best.primitive && best.primitive != NO_HIT)) {
                    best = Hit(hit.x, primitive, hit.y, hit.z);
                }
            }
        }
        if (waiting == 0u) {
            return best;
        }
        waiting--;
        link = ray_stack[waiting];
    }
    return best;
}

fn sort_pair(key: ptr<function, vec4f>, value: ptr<function, vec4u>, i: u32, j: u32) {
    let a = (*key)[i];
    let b = (*key)[j];
    let x = (*value)[i];
    let y = (*value)[j];
    let swap = b < a;
    (*key)[i] = select(a, b, swap);
    (*key)[j] = select(b, a, swap);
    (*value)[i] = select(x, y, swap);
    (*value)[j] = select(y, x, swap);
}

// x times 2^e. In two steps, so that neither leaves the range before the product does.
fn times_power(x: f32, e: i32) -> f32 {
    let bounded = clamp(e, -252, 252);
    let half = bounded / 2;
    return x * power_of_two(half) * power_of_two(bounded - half);
}

fn power_of_two(e: i32) -> f32 {
    return bitcast<f32>(u32(e + 127) << 23u);
}

// e such that 2^e <= the largest component < 2^(e + 1).
fn exponent_of(v: vec3f) -> i32 {
    let largest = max(abs(v.x), max(abs(v.y), abs(v.z)));
    return i32(bitcast<u32>(largest) >> 23u) - 127;
}

// The direction with its largest component in [1, 2). A power of two is exact.
fn near_unit(direction: vec3f, e: i32) -> vec3f {
    return vec3f(
        times_power(direction.x, -e), times_power(direction.y, -e), times_power(direction.z, -e)
    );
}

// A ray in the tree's scale.
struct Asked {
    start: vec3f,
    // Its largest component is in [1, 2).
    towards: vec3f,
    // Distances grow by 2^unit: the tree's scale and the direction's.
    unit: i32,
    // Nothing but what is nearer than this.
    best: Hit,
    valid: bool,
}

fn asked(origin: vec3f, direction: vec3f, t_max: f32) -> Asked {
    let e = exponent_of(direction);
    let unit = ray_tree.scale_exponent + e;
    // An end that is infinite is one beyond everything.
    let end = select(min(times_power(t_max, unit), FAR), FAR, !is_number(t_max));
    return Asked(
        origin * ray_tree.scale,
        near_unit(direction, e),
        unit,
        Hit(end, NO_HIT, 0.0, 0.0),
        e > -127 && e < 128 && t_max > 0.0,
    );
}

fn answered(best: Hit, unit: i32) -> Hit {
    if (best.primitive == NO_HIT) {
        return Hit(0.0, NO_HIT, 0.0, 0.0);
    }
    return Hit(times_power(best.t, -unit), best.primitive, best.u, best.v);
}

fn occluded_below(root: u32, start: vec3f, end: vec3f, reach: f32) -> bool {
    let ray = traced(start, end - start, reach);
    return ray.valid && any_below(root, ray, 1.0);
}
