//! What must hold of every bound, whatever the lights and the receiver.

use glam::{DVec3, Vec3};
use lighttree::strategies::{self, AnyReceiver};
use lighttree::{
    BoundTerms, Cone, Emitter, GeometricBound, LightBounds, NodeBound, PointwiseEmitter, Receiver, Toward,
    emission_bound,
};
use proptest::prelude::*;

/// So many cases, and no files left behind.
fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// Points of the unit square, evenly spread (Roberts' R2 sequence), corners first.
fn square(count: usize) -> impl Iterator<Item = [f32; 2]> {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let fraction = |x: f64| (x - x.floor()) as f32;
    let spread = (0..count)
        .map(move |i| [fraction(0.5 + 0.754_877_666 * i as f64), fraction(0.5 + 0.569_840_290 * i as f64)]);
    corners.into_iter().chain(spread)
}

/// Points of a box: corners, and a lattice between them.
fn points_of(bounds: &LightBounds) -> impl Iterator<Item = DVec3> {
    let (min, size) = (bounds.min.as_dvec3(), bounds.max.as_dvec3() - bounds.min.as_dvec3());
    let steps = [0.0, 0.1, 0.35, 0.5, 0.8, 1.0];
    let coordinates = move |i: usize| DVec3::new(steps[i % 6], steps[i / 6 % 6], steps[i / 36]);
    (0..216).map(move |i| min + size * coordinates(i))
}

/// The largest cosine to `n` of directions from `from` into the box, by ever finer lattices around the best
/// point.
fn refined_largest_cos(bounds: &LightBounds, from: Vec3, n: DVec3) -> f64 {
    let (mut min, mut max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let (mut best, mut at) = (-1.0, min);
    for _ in 0..60 {
        for i in 0..343 {
            let lattice = DVec3::new((i % 7) as f64, (i / 7 % 7) as f64, (i / 49) as f64) / 6.0;
            let p = min + (max - min) * lattice;
            let cos = n.dot((p - from.as_dvec3()).normalize_or_zero());
            if cos > best {
                (best, at) = (cos, p);
            }
        }
        let around = 0.4 * (max - min);
        (min, max) = (
            (at - around).max(bounds.min.as_dvec3()).min(at),
            (at + around).min(bounds.max.as_dvec3()).max(at),
        );
    }
    best
}

/// A spot whose inner angle is beyond its outer one has a hard rim at the outer one, where its bounds end.
#[test]
fn a_spot_ends_at_its_outer_angle() {
    let spot = lighttree::SpotLight {
        position: Vec3::ZERO,
        axis: Vec3::Z,
        inner_angle: 1.0,
        outer_angle: 0.5,
        intensity: 1.0,
    };
    assert_eq!((spot.falloff(0.7f64.cos()), spot.falloff(0.4f64.cos())), (0.0, 1.0));
}

/// Angle between two vectors, exact for small ones, too.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Directions of a cone: its axis and its rim.
fn directions_of(cone: &Cone) -> impl Iterator<Item = DVec3> {
    let axis = cone.axis.as_dvec3().normalize();
    let (x, y) = axis.any_orthonormal_pair();
    let cos = f64::from(cone.cos_half_angle);
    let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    let rim = (0..64).map(move |i| {
        let (s, c) = (core::f64::consts::TAU * f64::from(i) / 64.0).sin_cos();
        cos * axis + sin * (c * x + s * y)
    });
    rim.chain([axis])
}

fn half_angle_of(cone: &Cone) -> f64 {
    f64::from(cone.cos_half_angle).acos()
}

fn cone() -> impl Strategy<Value = Cone> {
    (strategies::direction(), strategies::half_angle())
        .prop_map(|(axis, angle)| Cone { axis, cos_half_angle: angle.cos() })
}

/// Two cones, opposed to one another now and then.
fn two_cones() -> impl Strategy<Value = (Cone, Cone)> {
    (cone(), cone(), 0..3).prop_map(|(a, b, how)| match how {
        0 => (a, Cone { axis: -a.axis, ..b }),
        1 => (a, Cone { axis: a.axis, ..b }),
        _ => (a, b),
    })
}

proptest! {
    #![proptest_config(config(2000))]

    #[test]
    fn union_of_cones_contains_both_and_is_tight((a, b) in two_cones()) {
        let union = a.union(&b);
        prop_assert!(union.axis.is_finite() && (union.axis.length() - 1.0).abs() < 1e-6);
        prop_assert!((-1.0..=1.0).contains(&union.cos_half_angle));
        for cone in [a, b] {
            for direction in directions_of(&cone) {
                prop_assert!(angle(direction, union.axis.as_dvec3()) <= half_angle_of(&union) + 1e-7);
            }
            prop_assert!(union.contains(&cone, 0.0));
        }
        let theta = angle(a.axis.as_dvec3(), b.axis.as_dvec3());
        let (alpha, beta) = (half_angle_of(&a), half_angle_of(&b));
        let least = (0.5 * (theta + alpha + beta)).max(alpha).max(beta).min(core::f64::consts::PI);
        // Half angles below and above which there is no other cosine in f32.
        let step = if (1e-3..core::f64::consts::PI - 1e-3).contains(&least) { 1e-4 } else { 5e-4 };
        prop_assert!(half_angle_of(&union) <= least + step, "{} > {least}", half_angle_of(&union));
    }

    #[test]
    fn union_of_bounds_contains_both(a in strategies::light_bounds(), b in strategies::light_bounds(), opposed in any::<bool>()) {
        let b = if opposed { LightBounds { axis: -a.axis, ..b } } else { b };
        let union = a.union(&b);
        prop_assert!(union.contains(&a, 0.0) && union.contains(&b, 0.0));
        prop_assert!(union.cos_theta_e <= a.cos_theta_e.min(b.cos_theta_e));
        prop_assert_eq!(union.intensity, a.intensity + b.intensity);
        prop_assert_eq!(union.two_sided, a.two_sided || b.two_sided);
        prop_assert_eq!(a.union(&LightBounds::EMPTY), a);
        prop_assert_eq!(LightBounds::EMPTY.union(&a), a);
        prop_assert_eq!(a.union(&a).normals(), a.normals());
    }

    #[test]
    fn no_direction_into_a_box_has_a_larger_cosine(
        bounds in strategies::light_bounds(),
        axis in strategies::direction(),
        from in strategies::position(),
        placement in strategies::scales(),
    ) {
        let (bounds, from) = (placement.bounds(&bounds), placement.position(from));
        let toward = Toward::new(from, bounds.min, bounds.max);
        let found = toward.max_cos_f64(axis.as_dvec3());
        let n = axis.as_dvec3().normalize();
        let cosines: Vec<f64> =
            points_of(&bounds).map(|p| n.dot((p - from.as_dvec3()).normalize_or(n))).collect();
        let largest = cosines.iter().copied().fold(-1.0, f64::max);
        prop_assert!(found >= largest - 1e-12, "{found} < {largest}");
        prop_assert!(f64::from(toward.max_cos(axis)) >= found);
        let below = points_of(&bounds).all(|p| n.dot(p - from.as_dvec3()) <= 0.0);
        prop_assert_eq!(found <= 0.0, below && !toward.is_inside());
        // Tight: the point at which it is reached lies in the box.
        if found > 0.0 && !toward.is_inside() {
            let reached = refined_largest_cos(&bounds, from, n);
            prop_assert!(found <= reached + 1e-3, "{found} is far above {reached}");
        }
    }
}

proptest! {
    #![proptest_config(config(3000))]

    /// E19, E27 and every emitter with every receiver: the bound holds for the whole contribution, summed up
    /// over the emitter.
    #[test]
    fn bound_of_an_emitter_holds_for_its_whole_contribution(
        (emitter, from, receiver) in strategies::emitter().prop_flat_map(|emitter| {
            (Just(emitter), strategies::position_near(emitter.bounds()), strategies::receiver())
        }),
    ) {
        let receiver = receiver.at(from);
        let upper = GeometricBound.bound(&emitter.bounds(), &receiver).upper;
        prop_assert!(upper >= 0.0);
        let weight = BoundTerms::importance(&emitter.bounds(), &receiver).strength;
        prop_assert!(weight >= 0.0 && (weight > 0.0) == (upper > 0.0), "an importance of {weight} where the bound is {upper}");
        let truth = contribution(&emitter, &receiver);
        prop_assert!(truth <= upper * (1.0 + 1e-5), "{truth} > {upper}");
    }

    #[test]
    fn emission_bound_holds_for_every_normal(
        bounds in strategies::light_bounds(),
        from in strategies::position(),
        placement in strategies::scales(),
    ) {
        let (bounds, from) = (placement.bounds(&bounds), placement.position(from));
        let found = emission_bound(&bounds, &Toward::new(from, bounds.min, bounds.max));
        prop_assert!((0.0..=1.0).contains(&found));
        for p in points_of(&bounds) {
            let Some(to_receiver) = (from.as_dvec3() - p).try_normalize() else { continue };
            for normal in directions_of(&bounds.normals()) {
                let mut cos = normal.dot(to_receiver);
                if bounds.two_sided {
                    cos = cos.abs();
                }
                if cos > f64::from(bounds.cos_theta_e) + 1e-7 {
                    prop_assert!(found >= cos - 1e-7, "{found} < {cos}");
                }
            }
        }
    }
}

/// The contribution itself, without visibility: the mean over many points of the emitter.
fn contribution(emitter: &impl PointwiseEmitter, receiver: &AnyReceiver) -> f64 {
    let is_a_point = emitter.bounds().min == emitter.bounds().max;
    let count = if is_a_point { 1 } else { 256 };
    let terms = square(count).skip(4).map(|u| pointwise_contribution(emitter, receiver, u));
    terms.sum::<f64>() / count as f64
}

fn pointwise_contribution(emitter: &impl PointwiseEmitter, receiver: &AnyReceiver, u: [f32; 2]) -> f64 {
    let point = emitter.point(u, receiver.position());
    let offset = point.position.as_dvec3() - receiver.position().as_dvec3();
    if offset == DVec3::ZERO {
        return 0.0; // undefined there, and bounded by infinity
    }
    point.intensity * receiver.eval(offset) / offset.length_squared()
}
