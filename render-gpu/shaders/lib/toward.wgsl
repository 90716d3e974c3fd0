// Twin of lighttree/src/walk/pair.rs and sphere.rs: a box of lights as it is seen from a receiver, all lengths scaled by a power of two that makes the scene as
// seen from there about 1 across.
//
// Differs from it: where rounding decides, the CPU asks f64; here what might contribute counts as if it did.

struct View {
    position: vec3f,
    scale: f32,
    // The least squared distance that is told from others, scaled.
    least_squared: f32,
}

// From `position`, of a scene whose lights are within this box.
fn view_from(position: vec3f, low: vec3f, high: vec3f) -> View {
    let reach = max(abs(high - position), abs(low - position));
    let far = max(reach.x, max(reach.y, reach.z));
    // 1 over the largest power of two that is not above it.
    let exponent = clamp(bitcast<u32>(far) >> 23u, 1u, 253u);
    let scale = bitcast<f32>((254u - exponent) << 23u);
    let extent = (high - low) * scale;
    let squared = dot(extent, extent);
    // A scene without extent has no least distance of its own; any does, for all are the same.
    let limited = min(scale, 1e4);
    let least = select(limited * limited, squared * 9.094947e-13, squared > 0.0);
    return View(position, scale, least);
}

struct Toward {
    // The box, relative to the receiver, scaled.
    low: vec3f,
    high: vec3f,
    // Squared distances to its nearest and farthest points; the nearest 0 inside.
    near_squared: f32,
    far_squared: f32,
}

fn toward(view: View, low: vec3f, high: vec3f) -> Toward {
    let a = (low - view.position) * view.scale;
    let b = (high - view.position) * view.scale;
    let near = max(max(a, -b), vec3f(0.0));
    let far = max(b, -a);
    return Toward(a, b, dot(near, near), dot(far, far));
}

// Relative error of a height above a plane, and then some.
const HEIGHT_ERROR: f32 = 4.7683716e-7;

// About the largest cosine to the unit vector `normal` of directions into the box, as if the box were as high
// as its highest point and as far aside as its nearest; 0 only where all of it is below the horizon for sure.
// 1 for a zero vector.
fn toward_cos(box: Toward, normal: vec3f) -> f32 {
    if (all(normal == vec3f(0.0))) {
        return 1.0;
    }
    let highest = max(box.low * normal, box.high * normal);
    let height = highest.x + highest.y + highest.z;
    let least = HEIGHT_ERROR * sqrt(box.far_squared);
    if (height < -least) {
        return 0.0;
    }
    let up = max(height, least);
    let along = dot(max(box.low, vec3f(0.0)) + min(box.high, vec3f(0.0)), normal);
    let squared = up * up + max(box.near_squared - along * along, 0.0);
    // Nothing but the receiver's own place: any direction.
    if (!(squared > 0.0)) {
        return 1.0;
    }
    return up / sqrt(squared);
}

// How far a lobe of squared width w² around `axis` has fallen at the direction into the box's bounding sphere
// that is nearest to it, relative to its peak: (w² / (w² + (1 - w²) sin²(ψ/2)))².
fn toward_fall(box: Toward, axis: vec3f, width_squared: f32) -> f32 {
    // All lengths doubled.
    let center = box.low + box.high;
    let diagonal = box.high - box.low;
    let squared = dot(center, center);
    let radius_squared = dot(diagonal, diagonal);
    let along = dot(center, axis);
    let cos_squared = max(squared - radius_squared, 0.0);
    if (radius_squared >= squared || (along >= 0.0 && along * along >= cos_squared)) {
        return 1.0;
    }
    let aside_squared = max(squared - along * along, 0.0);
    let outside = along * sqrt(cos_squared) + sqrt(aside_squared * radius_squared);
    let short = max(squared - outside, 0.0);
    let wide = width_squared * squared;
    let fall = wide / (wide + 0.5 * (1.0 - width_squared) * short);
    return fall * fall;
}

// Share of a lobe's peak that a box which it may reach counts for at least.
const LEAST_LOBE: f32 = 0.015625;
// The least |view + light|² that is told from others.
const LEAST_SUM: f32 = 1e-8;

// What a GGX lobe of squared width w² gives in the mean over the directions to the box, about, relative to
// its peak: by the half vector of view and light at the box's centre, wider by the angle under which its
// sphere is seen and as much lower. `axis` is the view mirrored at `normal`.
fn toward_lobe(box: Toward, normal: vec3f, axis: vec3f, width_squared: f32) -> f32 {
    // All lengths doubled.
    let center = box.low + box.high;
    let diagonal = box.high - box.low;
    let radius_squared = dot(diagonal, diagonal);
    // No nearer than half the diagonal / √2.
    let squared = max(max(dot(center, center), 0.5 * radius_squared), 1.1754944e-38);
    let inverse = 1.0 / sqrt(squared);

    // Without a normal it is a lobe around its axis alone, of half the angle.
    let off = center * inverse - axis;
    var sin_squared = 0.25 * dot(off, off);
    var sum_squared = 4.0;
    if (any(normal != vec3f(0.0))) {
        // n × (view + light) is n × (light - axis), since the axis is the view mirrored. 1 - cos² would leave
        // nothing of a narrow lobe.
        let aside = cross(normal, off);
        let aside_squared = dot(aside, aside);
        let height = max(dot(center, normal) * inverse, 0.0) + dot(axis, normal);
        sum_squared = max(aside_squared + height * height, LEAST_SUM);
        sin_squared = min(aside_squared / sum_squared, 1.0);
    }
    let width = min(width_squared + radius_squared * inverse * inverse / sum_squared, 1.0);
    let fall = width / (width + (1.0 - width) * sin_squared);
    return max(width_squared / width * fall * fall, LEAST_LOBE * toward_fall(box, axis, width_squared));
}

// About how a surface scatters: `lighttree::ScatterLobes`.
struct Lobes {
    normal: vec3f,
    diffuse: f32,
    axis: vec3f,
    peak: f32,
    width_squared: f32,
}
