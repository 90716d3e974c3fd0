//! Bounds of two sets of lights together.

use glam::DVec3;

use crate::LightBounds;

/// Bounds that contain both: box, cone and emission angle; intensities add up.
///
/// Conty Estévez and Kulla 2018, algorithm 1, in f64 and with a perpendicular axis for opposite ones.
pub(crate) fn union(a: &LightBounds, b: &LightBounds) -> LightBounds {
    let two_sided = a.two_sided || b.two_sided;
    let (axis, cos_theta_o) = union_cones(a, b, two_sided);
    LightBounds {
        min: a.min.min(b.min),
        max: a.max.max(b.max),
        axis,
        cos_theta_o,
        cos_theta_e: a.cos_theta_e.min(b.cos_theta_e),
        two_sided,
        intensity: a.intensity + b.intensity,
    }
}

fn union_cones(a: &LightBounds, b: &LightBounds, two_sided: bool) -> (glam::Vec3, f32) {
    let (wide, narrow) = if a.cos_theta_o <= b.cos_theta_o { (a, b) } else { (b, a) };
    if wide.cos_theta_o <= -1.0 || wide.axis == narrow.axis {
        return (wide.axis, wide.cos_theta_o);
    }
    let from = wide.axis.as_dvec3().normalize();
    let mut to = narrow.axis.as_dvec3().normalize();
    if two_sided && from.dot(to) < 0.0 {
        to = -to;
    }
    let between = from.cross(to).length().atan2(from.dot(to));
    let (theta_wide, theta_narrow) =
        (f64::from(wide.cos_theta_o).acos(), f64::from(narrow.cos_theta_o).acos());
    if between + theta_narrow <= theta_wide {
        return (wide.axis, wide.cos_theta_o);
    }
    let theta = 0.5 * (theta_wide + between + theta_narrow);
    if theta >= core::f64::consts::PI {
        return (wide.axis, -1.0);
    }
    // Turn the wide axis towards the other one, by what it lacks; any way round where they are opposite.
    let across = to - from * from.dot(to);
    let across = across.try_normalize().unwrap_or_else(|| from.any_orthonormal_vector());
    let turn = theta - theta_wide;
    let axis: DVec3 = from * turn.cos() + across * turn.sin();
    // The axis is rounded to f32, and so is the cosine: both are paid for here.
    let cos = (theta + 1.5e-7).min(core::f64::consts::PI).cos() as f32;
    (axis.as_vec3(), cos.next_down().max(-1.0))
}
