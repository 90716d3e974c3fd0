//! What must hold of points drawn by solid angle.

use glam::{DVec3, Vec3};
use lighttree::SphericalTriangle;
use lighttree::conformance::chi_squared_p_value;
use lighttree::rng::Random;
use proptest::prelude::*;

const OCTANT: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// The integral of cosine ÷ squared distance over the triangle, by the midpoint rule on `n`² congruent parts.
fn integrated(corners: [DVec3; 3], receiver: DVec3, n: u32) -> f64 {
    let [a, b, c] = corners.map(|p| p - receiver);
    let (x, y) = ((b - a) / f64::from(n), (c - a) / f64::from(n));
    let twice_area = x.cross(y);
    let (i, middle) = (f64::from, 1.0 / 3.0);
    let part = |p: DVec3| 0.5 * twice_area.dot(p).abs() / p.length().powi(3);
    let mut sum = 0.0;
    for row in 0..n {
        for column in 0..n - row {
            sum += part(a + x * (i(column) + middle) + y * (i(row) + middle));
            if column + row + 1 < n {
                sum += part(a + x * (i(column) + 2.0 * middle) + y * (i(row) + 2.0 * middle));
            }
        }
    }
    sum
}

fn at(corners: [Vec3; 3], weights: [f64; 3]) -> DVec3 {
    (0..3).map(|i| weights[i] * corners[i].as_dvec3()).sum()
}

fn assert_point_of_triangle(weights: [f64; 3]) {
    assert!(weights.iter().all(|w| (0.0..=1.0 + 1e-15).contains(w)), "{weights:?}");
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14, "{weights:?}");
}

#[test]
fn known_solid_angles() {
    let octant = SphericalTriangle::new(OCTANT, Vec3::ZERO).unwrap();
    assert!((octant.solid_angle() - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
    // Half of a cube's face: a sixth of the sphere, halved.
    let face = [Vec3::new(-1.0, -1.0, 1.0), Vec3::new(1.0, -1.0, 1.0), Vec3::new(1.0, 1.0, 1.0)];
    let half_face = SphericalTriangle::new(face, Vec3::ZERO).unwrap();
    assert!((half_face.solid_angle() - core::f64::consts::PI / 3.0).abs() < 1e-15);
}

#[test]
fn either_side_has_the_same_solid_angle() {
    let receiver = Vec3::new(0.1, -0.2, -0.4);
    let [a, b, c] = OCTANT;
    let one = SphericalTriangle::new([a, b, c], receiver).unwrap();
    let other = SphericalTriangle::new([a, c, b], receiver).unwrap();
    assert!((one.solid_angle() - other.solid_angle()).abs() < 1e-15);
    // Counter-clockwise from outside, where the receiver isn't.
    assert!(!one.is_front() && other.is_front());
    assert!(SphericalTriangle::new(OCTANT, Vec3::ONE).unwrap().is_front());
}

#[test]
fn what_has_no_solid_angle_is_none() {
    let none = |corners, receiver| assert_eq!(SphericalTriangle::new(corners, receiver), None, "{corners:?}");
    let flat = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // In the plane: beside it, within it, on an edge, on a corner.
    for receiver in [Vec3::new(5.0, 3.0, 0.0), Vec3::new(0.25, 0.25, 0.0), Vec3::X * 0.5, Vec3::X] {
        none(flat, receiver);
    }
    // No area: one point, one line.
    none([Vec3::ONE; 3], Vec3::ZERO);
    none([Vec3::ZERO, Vec3::X, Vec3::X * 2.0], Vec3::Z);
    // Not finite.
    none([Vec3::NAN, Vec3::X, Vec3::Y], Vec3::Z);
    none([Vec3::INFINITY, Vec3::X, Vec3::Y], Vec3::Z);
    none(flat, Vec3::splat(f32::INFINITY));
}

#[test]
fn half_a_sphere_is_the_most() {
    let flat = [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(-1.0, 1.0, 0.0)];
    let mut last = 0.0;
    for exponent in 0..44 {
        let triangle = SphericalTriangle::new(flat, Vec3::Z * 0.1f32.powi(exponent)).unwrap();
        let solid_angle = triangle.solid_angle();
        assert!((last..=core::f64::consts::TAU).contains(&solid_angle), "1e-{exponent}: {solid_angle}");
        last = solid_angle;
        for u in [[0.0, 0.0], [0.3, 0.7], [0.999, 0.001], [1.0 - 1e-16; 2]] {
            assert_point_of_triangle(triangle.sample(u));
        }
    }
    assert!(last > 0.999_999 * core::f64::consts::TAU);
}

/// Chi² over 64 parts of the triangle, whose solid angles are integrated.
fn p_value(corners: [Vec3; 3], receiver: Vec3, sample: impl Fn([f64; 2]) -> [f64; 3]) -> f64 {
    const N: usize = 8;
    let part = |weights: [f64; 3]| {
        let cell = weights.map(|w| ((w * N as f64) as usize).min(N - 1));
        let turned = usize::from(cell.iter().sum::<usize>() + 2 == N);
        (cell[0] * N + cell[1]) * 2 + turned
    };
    let (mut expected, mut counts) = (vec![0.0; 2 * N * N], vec![0u32; 2 * N * N]);
    let step = 1.0 / N as f64;
    for i in 0..N {
        for j in 0..N - i {
            let corner = |di: usize, dj: usize| {
                let (x, y) = ((i + di) as f64 * step, (j + dj) as f64 * step);
                [x, y, 1.0 - x - y]
            };
            let mut add = |three: [[f64; 3]; 3]| {
                let middle = [0, 1, 2].map(|k| three.iter().map(|w| w[k]).sum::<f64>() / 3.0);
                expected[part(middle)] = integrated(three.map(|w| at(corners, w)), receiver.as_dvec3(), 48);
            };
            add([corner(0, 0), corner(1, 0), corner(0, 1)]);
            if i + j + 1 < N {
                add([corner(1, 1), corner(1, 0), corner(0, 1)]);
            }
        }
    }
    let mut random = Random::new(3, 0, 0);
    for _ in 0..200_000 {
        counts[part(sample([random.f64(), random.f64()]))] += 1;
    }
    // The solid angle itself is the density's reciprocal, so the parts sum up to it.
    let whole = SphericalTriangle::new(corners, receiver).unwrap().solid_angle();
    let sum = expected.iter().sum::<f64>();
    assert!((sum / whole - 1.0).abs() < 2e-3, "{sum} is not {whole}");
    expected.iter_mut().for_each(|e| *e /= sum);
    chi_squared_p_value(&counts, &expected).unwrap()
}

#[test]
fn points_are_uniform_in_solid_angle() {
    let near = [Vec3::new(-1.0, -0.5, 0.2), Vec3::new(3.0, -0.5, 0.3), Vec3::new(0.0, 2.0, 0.6)];
    let slanted = [Vec3::new(0.3, -0.1, 0.05), Vec3::new(0.3, 0.1, 0.05), Vec3::new(6.0, 0.0, 0.3)];
    let far = [Vec3::new(100.0, 0.0, 0.0), Vec3::new(100.0, 1.0, 0.0), Vec3::new(100.5, 0.0, 1.0)];
    for corners in [OCTANT, near, slanted, far] {
        for turn in 0..3 {
            let mut corners = corners;
            corners.rotate_left(turn);
            let triangle = SphericalTriangle::new(corners, Vec3::ZERO).unwrap();
            let p = p_value(corners, Vec3::ZERO, |u| triangle.sample(u));
            assert!(p > 1e-4, "{corners:?}: p-value {p}");
        }
    }
    // The test can fail: points by area are not uniform in solid angle.
    let by_area = |[u, v]: [f64; 2]| [1.0 - u.sqrt(), u.sqrt() * (1.0 - v), u.sqrt() * v];
    assert!(p_value(near, Vec3::ZERO, by_area) < 1e-4);
}

/// Corners and a receiver of all kinds: near, far, slivers, on a lattice (so in planes and on edges), at any
/// scale.
fn anything() -> impl Strategy<Value = ([Vec3; 3], Vec3)> {
    let coordinate = || prop_oneof![3 => -1.0f32..1.0, 1 => (-2i8..=2).prop_map(|i| f32::from(i) * 0.5)];
    let point = move || prop::array::uniform3(coordinate()).prop_map(Vec3::from);
    let size = prop_oneof![Just(1.0f32), (-8.0f32..1.0).prop_map(|e| 10.0f32.powf(e))];
    (point(), point(), point(), point(), size, -16i32..16).prop_map(|(a, b, c, receiver, size, exponent)| {
        let scale = 10.0f32.powi(exponent);
        ([a, a + size * (b - a), a + size * (c - a)].map(|p| p * scale), receiver * scale)
    })
}

proptest! {
    #![proptest_config(config(2000))]

    #[test]
    fn a_sample_is_a_point_of_the_triangle((corners, receiver) in anything(), u in 0.0f64..1.0, v in 0.0f64..1.0) {
        let Some(triangle) = SphericalTriangle::new(corners, receiver) else { return Ok(()) };
        prop_assert!(triangle.solid_angle() > 0.0 && triangle.solid_angle() <= core::f64::consts::TAU);
        for u in [[u, v], [0.0, v], [u, 0.0], [1.0 - f64::EPSILON, v], [u, 1.0 - f64::EPSILON], [0.0, 0.0]] {
            assert_point_of_triangle(triangle.sample(u));
        }
    }

    #[test]
    fn scale_changes_nothing((corners, receiver) in anything(), u in 0.0f64..1.0, v in 0.0f64..1.0) {
        // By a power of two, where f32 rounds nothing.
        let scale = |p: Vec3| p * 2.0f32.powi(30);
        let one = SphericalTriangle::new(corners, receiver);
        let other = SphericalTriangle::new(corners.map(scale), scale(receiver));
        prop_assert_eq!(one.map(|t| t.solid_angle()), other.map(|t| t.solid_angle()));
        prop_assert_eq!(one.map(|t| t.sample([u, v])), other.map(|t| t.sample([u, v])));
    }

    #[test]
    fn a_triangle_is_the_sum_of_its_parts((corners, receiver) in anything(), split in 0.0f32..1.0) {
        let [a, b, c] = corners;
        let d = a.lerp(b, split);
        // The point of the split is rounded, which may move it out of the plane.
        let whole = SphericalTriangle::new(corners, receiver).map_or(0.0, |t| t.solid_angle());
        let part = |corners| SphericalTriangle::new(corners, receiver).map_or(0.0, |t| t.solid_angle());
        let moved = f64::from(d.abs().max_element()) * 1e-7;
        let near = corners.iter().chain([&d]).map(|p| p.as_dvec3().distance(receiver.as_dvec3()));
        let near = near.fold(f64::INFINITY, f64::min);
        prop_assume!(near > 1e4 * moved);
        prop_assert!((part([a, d, c]) + part([d, b, c]) - whole).abs() <= 1e-2 * whole + 8.0 * moved / near);
    }
}

proptest! {
    #![proptest_config(config(300))]

    /// The mean of (area per steradian) × solid angle is the area: the density that is reported is the one
    /// that was used.
    #[test]
    fn the_density_is_the_one_reported((corners, receiver) in anything()) {
        let Some(triangle) = SphericalTriangle::new(corners, receiver) else { return Ok(()) };
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let area_vector = 0.5 * (b - a).cross(c - a);
        let to = corners.map(|p| p.as_dvec3() - receiver.as_dvec3());
        let (least, most) = (
            to.iter().map(|p| p.length()).fold(f64::INFINITY, f64::min),
            to.iter().map(|p| p.length()).fold(0.0, f64::max),
        );
        // Nearer, or seen more edge-on, the mean needs more points than these.
        let height = area_vector.normalize().dot(to[0]).abs();
        prop_assume!(height > 0.3 * most && least > 0.3 * most);
        const N: u32 = 128;
        let mut mean = 0.0;
        for i in 0..N * N {
            let [u, root] = [i % N, i / N].map(|k| (f64::from(k) + 0.5) / f64::from(N));
            // The second number squared: the way from a corner goes with its root, which the midpoint rule
            // does badly on.
            let p = at(corners, triangle.sample([u, root * root])) - receiver.as_dvec3();
            mean += 2.0 * root * p.length().powi(3) / area_vector.dot(p).abs() / f64::from(N * N);
        }
        let area_over_area = mean * triangle.solid_angle();
        prop_assert!((area_over_area - 1.0).abs() < 1e-2, "{}", area_over_area);
    }
}
