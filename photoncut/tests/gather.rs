//! Final gather and what is interpolated from it.

mod common;

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{
    DensityParams, GatherParams, GatherSample, GatherScratch, Guide, IlluminationCut, Incoming,
    InterpolationParams, IrradianceSamples, PhotonScratch, Place, RadianceSh, SampleScratch, gather,
};

const PARAMS: GatherParams = GatherParams { rays: 400, seed: 1 };

fn at(position: Vec3, normal: Vec3, rays: u32, light: impl Fn(Vec3) -> Incoming) -> GatherSample {
    let params = GatherParams { rays, seed: 1 };
    gather(position, normal, 0, &params, None, &mut GatherScratch::default(), None, |d, _| light(d))
}

/// E51: in a closed box whose walls emit radiance 1 and reflect half, irradiance is 2π everywhere, of which
/// half is gathered. Every approximation on its own.
#[test]
fn white_furnace() {
    const ALBEDO: f32 = 0.5;
    let map = common::map(&common::furnace(Vec3::splat(ALBEDO), 200_000, 1));
    let density = DensityParams::nearest(64);
    let cut = IlluminationCut::of_size(&map, 3000, &density);
    let expected = 2.0 * PI * ALBEDO;
    let (mut photons, mut lookup, mut scratch) =
        (PhotonScratch::default(), PhotonScratch::default(), GatherScratch::default());
    let mut random = Random::new(3, 0, 0);
    let mut samples = Vec::new();
    let (mut full, mut by_cut) = (0.0, 0.0);
    const POINTS: u32 = 150;
    for index in 0..POINTS {
        let (position, normal) = common::wall_point(&mut random);
        let origin = position + 1e-5 * normal;
        let exact = gather(position, normal, index, &PARAMS, None, &mut scratch, None, |d, _| {
            let (distance, place, facing) = common::hit(origin, d);
            let irradiance = map.irradiance(place, facing, &density, &mut photons).irradiance;
            Incoming { radiance: irradiance * (ALBEDO / PI), distance }
        });
        let sparse = gather(position, normal, index, &PARAMS, None, &mut scratch, None, |d, _| {
            let (distance, place, facing) = common::hit(origin, d);
            let irradiance = cut.irradiance_or_density(&map, place, facing, &density, &mut lookup).0;
            Incoming { radiance: irradiance * (ALBEDO / PI), distance }
        });
        full += exact.irradiance.x / POINTS as f32;
        by_cut += sparse.irradiance.x / POINTS as f32;
        samples.push(sparse);
    }
    assert!((full / expected - 1.0).abs() < 0.01, "full map: {}", full / expected - 1.0);
    assert!((by_cut / expected - 1.0).abs() < 0.01, "cut: {}", by_cut / expected - 1.0);

    // Between the samples.
    let (samples, left_out) = IrradianceSamples::new(&samples, &InterpolationParams::new(0.9));
    assert_eq!(left_out, 0);
    let mut scratch = SampleScratch::default();
    let mut between = 0.0;
    for _ in 0..1000 {
        let (point, normal) = common::wall_point(&mut random);
        between += samples.irradiance(&Place::new(point, normal), &mut scratch).0.x / 1000.0;
    }
    assert!((between / expected - 1.0).abs() < 0.01, "between samples: {}", between / expected - 1.0);
}

#[test]
fn constant_light_is_exact_and_so_are_its_harmonics() {
    let mut sh = RadianceSh::default();
    let constant = |_: Vec3, _: &mut Random| Incoming { radiance: Vec3::ONE, distance: 2.0 };
    let sample =
        gather(Vec3::ZERO, Vec3::Z, 0, &PARAMS, None, &mut GatherScratch::default(), Some(&mut sh), constant);
    assert!((sample.irradiance.x - PI).abs() < 1e-5 && (sample.mean_distance - 2.0).abs() < 1e-5);
    // The mean over the whole sphere is half: exact, for strata have their solid angles.
    assert!((sh.0[0].x * 0.282_094_79 - 0.5).abs() < 1e-5);
    // A hemisphere in four bands: 1/2 + 3/4 - 7/16 at the zenith.
    assert!(
        (sh.radiance(Vec3::Z).x - 0.8125).abs() < 0.06 && (sh.radiance(Vec3::NEG_Z).x - 0.1875).abs() < 0.06
    );
    let none = at(Vec3::ZERO, Vec3::Z, 0, |_| Incoming { radiance: Vec3::ZERO, distance: f32::INFINITY });
    assert_eq!((none.irradiance, none.mean_distance), (Vec3::ZERO, f32::INFINITY));
}

/// A guide changes neither the mean of irradiance, harmonics and distance, nor which light makes it, and
/// takes most of the noise of a window away.
#[test]
fn a_guide_is_right_in_the_mean() {
    // A bright window low to one side of a dim room, nearer than the walls.
    let room = |d: Vec3, _: &mut Random| {
        let window = (d - Vec3::new(0.8, 0.1, 0.6).normalize()).length_squared() < 0.03;
        let (radiance, distance) = if window { (Vec3::new(30.0, 20.0, 10.0), 1.0) } else { (Vec3::ONE, 4.0) };
        Incoming { radiance, distance }
    };
    let mut scratch = GatherScratch::default();
    let all = |guide: Option<&Guide>, first: u32, scratch: &mut GatherScratch| {
        const POINTS: u32 = 600;
        let params = GatherParams { rays: 64, seed: 5 };
        let (mut mean, mut square, mut distance, mut sh) = (0.0, 0.0, 0.0, RadianceSh::default());
        for index in first..first + POINTS {
            let mut own = RadianceSh::default();
            let s = gather(Vec3::ZERO, Vec3::Z, index, &params, guide, scratch, Some(&mut own), room);
            sh.add_scaled(&own, 1.0 / POINTS as f32);
            let e = f64::from(s.irradiance.x);
            (mean, square) = (mean + e / f64::from(POINTS), square + e * e / f64::from(POINTS));
            distance += 1.0 / f64::from(s.mean_distance) / f64::from(POINTS);
        }
        ((mean, square - mean * mean), distance, sh)
    };
    let truth = gather(
        Vec3::ZERO,
        Vec3::Z,
        0,
        &GatherParams { rays: 1 << 20, seed: 1 },
        None,
        &mut scratch,
        None,
        room,
    );
    let ((_, noise), ..) = all(None, 0, &mut scratch);
    let few = GatherParams { rays: 300, seed: 8 };
    gather(Vec3::ZERO, Vec3::Z, 0, &few, None, &mut scratch, None, room);
    let mut guide = Guide::default();
    guide.toward(Vec3::ZERO, Vec3::Z, scratch.met(Vec3::ZERO));
    let ((mean, guided_noise), distance, sh) = all(Some(&guide), 1000, &mut scratch);
    assert!(guided_noise < 0.3 * noise, "variance {guided_noise}, without a guide {noise}");
    let off = (mean - f64::from(truth.irradiance.x)).abs();
    assert!(off < 4.0 * (guided_noise / 600.0).sqrt() + 2e-3, "{mean} and {}", truth.irradiance.x);
    assert!((distance * f64::from(truth.mean_distance) - 1.0).abs() < 0.01, "{distance}");
    // Harmonics against those of many rays without a guide.
    let mut plain = RadianceSh::default();
    gather(
        Vec3::ZERO,
        Vec3::Z,
        0,
        &GatherParams { rays: 1 << 16, seed: 1 },
        None,
        &mut scratch,
        Some(&mut plain),
        room,
    );
    for (c, (a, b)) in sh.0.iter().zip(plain.0).enumerate() {
        assert!((*a - b).length() < 0.05 * plain.0[0].length(), "harmonic {c}: {a} and {b}");
    }
}

/// Gradients against finite differences: a bright patch on a ceiling one unit above.
#[test]
fn gradients_foretell_neighbours() {
    let patch = |eye: Vec3| {
        move |d: Vec3| {
            if d.z <= 0.0 {
                return Incoming { radiance: Vec3::ZERO, distance: f32::INFINITY };
            }
            let distance = (1.0 - eye.z) / d.z;
            let place = eye + distance * d;
            // Smooth, so that few rays do.
            let radiance =
                Vec3::ONE * (-2.0 * (place.truncate() - glam::Vec2::new(0.5, 0.2)).length_squared()).exp();
            Incoming { radiance, distance }
        }
    };
    const RAYS: u32 = 40_000;
    let here = at(Vec3::ZERO, Vec3::Z, RAYS, patch(Vec3::ZERO));
    // Those of guided rays are the same.
    let mut scratch = GatherScratch::default();
    let light = |d: Vec3, _: &mut Random| patch(Vec3::ZERO)(d);
    gather(Vec3::ZERO, Vec3::Z, 0, &PARAMS, None, &mut scratch, None, light);
    let mut guide = Guide::default();
    guide.toward(Vec3::ZERO, Vec3::Z, scratch.met(Vec3::ZERO));
    let params = GatherParams { rays: RAYS, seed: 2 };
    let guided = gather(Vec3::ZERO, Vec3::Z, 0, &params, Some(&guide), &mut scratch, None, light);
    for (a, b) in [(guided.rotation[0], here.rotation[0]), (guided.translation[0], here.translation[0])] {
        assert!((a - b).length() < 0.03 * b.length(), "{a} and {b}");
    }
    let step = 0.05;
    for way in [Vec3::X, Vec3::Y, Vec3::new(-0.6, 0.8, 0.0)] {
        let ahead = at(step * way, Vec3::Z, RAYS, patch(step * way)).irradiance.x;
        let behind = at(-step * way, Vec3::Z, RAYS, patch(-step * way)).irradiance.x;
        let measured = (ahead - behind) / (2.0 * step);
        let foretold = here.translation[0].dot(way);
        assert!(
            (measured - foretold).abs() < 0.05 * measured.abs() + 0.02,
            "moved {way}: {measured} and {foretold}"
        );

        let turned = |angle: f32| (Vec3::Z + angle * way).normalize();
        let [ahead, behind] =
            [step, -step].map(|a| at(Vec3::ZERO, turned(a), RAYS, patch(Vec3::ZERO)).irradiance.x);
        let measured = (ahead - behind) / (2.0 * step);
        let foretold = Vec3::Z.cross(way).dot(here.rotation[0]);
        assert!(
            (measured - foretold).abs() < 0.05 * measured.abs() + 0.02,
            "turned {way}: {measured} and {foretold}"
        );
    }
}

fn sample(position: Vec3, irradiance: f32) -> GatherSample {
    GatherSample {
        position,
        normal: Vec3::Y,
        irradiance: Vec3::splat(irradiance),
        mean_distance: 0.5,
        rotation: [Vec3::ZERO; 3],
        translation: [Vec3::X; 3],
        rays: 100,
    }
}

/// Samples without noise, four to a mean.
const fn exact(radius: f32) -> InterpolationParams {
    InterpolationParams { neighbours: 4, noise: 0.0, ..InterpolationParams::new(radius) }
}

/// D11, E50: exact at a sample, continuous between them, never undefined.
#[test]
fn interpolation_is_continuous() {
    let mut random = Random::new(1, 0, 0);
    let samples: Vec<_> =
        (0..200).map(|_| sample(Vec3::new(random.f32(), 0.0, random.f32()), random.f32())).collect();
    let mut scratch = SampleScratch::default();
    for neighbours in [1, 3, 8, 32] {
        let params = InterpolationParams { neighbours, ..exact(1.0) };
        let (index, _) = IrradianceSamples::new(&samples, &params);
        for sample in &samples {
            assert_eq!(
                index.irradiance(&Place::new(sample.position, Vec3::Y), &mut scratch).0,
                sample.irradiance
            );
        }
        for i in 0..100 {
            let shares = index.shares(&Place::new(Vec3::splat(i as f32 * 0.3), Vec3::Y), &mut scratch);
            let sum: f32 = shares.iter().map(|share| share.weight).sum();
            assert!((sum - 1.0).abs() < 1e-5 && shares.len() <= neighbours as usize);
        }
        if neighbours > 1 {
            // Along a line in tiny steps; a sample is a cusp at worst, never a jump.
            let along = |i: u32| Vec3::new(i as f32 * 1e-4, 0.0, 0.37);
            let values: Vec<f32> = (0..10_000)
                .map(|i| index.irradiance(&Place::new(along(i), Vec3::Y), &mut scratch).0.x)
                .collect();
            let jump = values.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f32::max);
            assert!(jump < 0.05, "{neighbours} neighbours: a jump of {jump}");
        }
    }
}

/// A shelf above: nearer, but of another plane.
#[test]
fn planes_keep_shelves_apart() {
    let own = sample(Vec3::X, 1.0);
    let above = sample(0.5 * Vec3::Y, 9.0);
    let mut scratch = SampleScratch::default();
    for (planes, expected) in [(0.0, 9.0), (f32::NAN, 9.0), (4.0, 1.0), (f32::INFINITY, 1.0)] {
        let params = InterpolationParams { neighbours: 1, planes, ..exact(1.0) };
        let (index, _) = IrradianceSamples::new(&[own, above], &params);
        let found = index.irradiance(&Place::new(Vec3::ZERO, Vec3::Y), &mut scratch).0.x;
        // The other one takes its own weight off: e is 2 and 1, or 2 and 5.
        assert!((found - expected).abs() < 1e-5, "planes {planes}: {found}");
    }
}

/// A place in a gap sees near things, and then what lies in the open beside it is far, whatever that sees.
#[test]
fn a_gap_takes_its_own_light() {
    let open = GatherSample { mean_distance: 1.0, ..sample(0.2 * Vec3::X, 9.0) };
    let gap = GatherSample { mean_distance: 0.05, ..sample(0.1 * Vec3::Z, 1.0) };
    let params = InterpolationParams { neighbours: 1, clamp_neighbours: false, ..exact(1.0) };
    let (index, _) = IrradianceSamples::new(&[open, gap], &params);
    let mut scratch = SampleScratch::default();
    let mut found = |mean_distance: f32| {
        let place = Place { mean_distance, ..Place::new(Vec3::ZERO, Vec3::Y) };
        (index.irradiance(&place, &mut scratch).0.x, index.doubt(&place, &mut scratch))
    };
    // e of open and gap: 0.2 and 2, or 4 and 2, or, at the least R of a thousandth, 200 and 100.
    for (distance, light, least) in [
        (f32::INFINITY, 9.0, 0.2),
        (f32::NAN, 9.0, 0.2),
        (1.0, 9.0, 0.2),
        (0.05, 1.0, 2.0),
        (0.0, 1.0, 100.0),
        (-1.0, 1.0, 100.0),
    ] {
        let (irradiance, doubt) = found(distance);
        assert_eq!(irradiance, light, "a place of R {distance}");
        assert!((doubt - 0.05 * least).abs() < 1e-5 * least, "a place of R {distance}: doubt {doubt}");
    }
}

/// The samples of least error of all, whatever was asked before.
#[test]
fn the_search_misses_nothing() {
    let mut random = Random::new(5, 0, 0);
    let mut any = || Vec3::new(random.f32(), random.f32(), random.f32());
    let samples: Vec<_> = (0..300)
        .map(|_| {
            let normal = (any() - 0.5).normalize();
            GatherSample {
                normal,
                rays: 1 << (any().x * 8.0) as u32,
                mean_distance: any().x.powi(3),
                ..sample(any().round() * 0.9 + 0.1 * any(), 1.0)
            }
        })
        .collect();
    let params = InterpolationParams { clamp_neighbours: false, noise: 2.0, ..exact(1.0) };
    let (index, _) = IrradianceSamples::new(&samples, &params);
    let mut used = SampleScratch::default();
    for i in 0..500 {
        let mean_distance = if i % 2 == 0 { f32::INFINITY } else { any().x.powi(2) };
        let place = Place { mean_distance, ..Place::new(any(), (any() - 0.5).normalize()) };
        let error = |s: &GatherSample| {
            let offset = place.position - s.position;
            let way = offset.length() + params.planes * offset.dot(s.normal).abs();
            let e = way / s.mean_distance.clamp(1e-3, 1.0).min(mean_distance.max(1e-3))
                + place.normal.distance(s.normal);
            e * e + 4.0 / s.rays as f32
        };
        let mut all: Vec<_> = (0..).zip(&samples).map(|(k, s)| (error(s), k)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut expected: Vec<u32> = all[..4].iter().map(|&(_, k)| k).collect();
        let shares = index.shares(&place, &mut used).to_vec();
        assert_eq!(
            shares,
            index.shares(&place, &mut SampleScratch::default()),
            "what was asked before shows"
        );
        let mut found: Vec<u32> = shares.iter().map(|share| share.index).collect();
        found.sort_unstable();
        expected.sort_unstable();
        assert_eq!(found, expected, "place {i}");
    }
    // A scratch that knows more samples than there are now.
    let (few, _) = IrradianceSamples::new(&samples[..2], &params);
    assert_eq!(few.shares(&Place::new(Vec3::ZERO, Vec3::Y), &mut used).len(), 2);
}

/// Samples near each other are averaged by their rays, and one is not the less exact for having many.
#[test]
fn noise_is_averaged() {
    let mut scratch = SampleScratch::default();
    let mut at_the_first = |noise: f32, rays: [u32; 2]| {
        let samples: Vec<_> = [(0.0, 1.0), (0.05, 3.0), (100.0, 0.0)]
            .into_iter()
            .zip([rays[0], rays[1], 1])
            .map(|((x, irradiance), rays)| GatherSample { rays, ..sample(x * Vec3::X, irradiance) })
            .collect();
        let (index, _) =
            IrradianceSamples::new(&samples, &InterpolationParams { noise, neighbours: 2, ..exact(1.0) });
        index.irradiance(&Place::new(Vec3::ZERO, Vec3::Y), &mut scratch).0.x
    };
    assert_eq!(at_the_first(0.0, [100, 100]), 1.0, "without noise a sample speaks alone");
    // R is 0.5, so the second is at an e of 0.1: squared errors are 0.09 and 0.09 + 0.01.
    let expected = (1.0 / 0.09 + 3.0 / 0.1) / (1.0 / 0.09 + 1.0 / 0.1);
    let found = at_the_first(3.0, [100, 100]);
    assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
    assert!(at_the_first(3.0, [100, 400]) > found && at_the_first(3.0, [400, 100]) < found);
    assert!(at_the_first(3.0, [0, 100]) > 2.9, "none counts as one");
    for noise in [-1.0, f32::NAN] {
        assert_eq!(at_the_first(noise, [100, 100]), 1.0);
    }
    let far = at_the_first(f32::INFINITY, [100, 100]);
    assert!((far - 2.0).abs() < 1e-3, "all noise: a plain mean, and not {far}");
}

/// Doubt is what samples disagree by, over the largest of them, and a twentieth of how far they are.
#[test]
fn doubt_is_disagreement() {
    let params = InterpolationParams { neighbours: 2, ..exact(1.0) };
    let mut scratch = SampleScratch::default();
    let mut between = |a: f32, b: f32, at: f32| {
        let (index, _) = IrradianceSamples::new(&[sample(Vec3::ZERO, a), sample(Vec3::X, b)], &params);
        index.doubt(&Place::new(at * Vec3::X, Vec3::Y), &mut scratch)
    };
    // R is 0.5, so e is 1.
    assert!((between(1.0, 3.0, 0.5) - (1.0f32 / 9.0 + 0.0025).sqrt()).abs() < 1e-6);
    assert!((between(2.0, 2.0, 0.5) - 0.05).abs() < 1e-3 && (between(0.0, 0.0, 0.5) - 0.05).abs() < 1e-6);
    assert_eq!(between(1.0, 3.0, 0.0), 0.0, "at a sample there is none");
    let (none, _) = IrradianceSamples::new(&[], &params);
    assert_eq!(none.doubt(&Place::new(Vec3::ZERO, Vec3::Y), &mut scratch), 0.0);
}

#[test]
fn interpolation_at_extremes() {
    let mut scratch = SampleScratch::default();
    let params = exact(1.0);
    let (none, _) = IrradianceSamples::new(&[], &params);
    assert_eq!(none.irradiance(&Place::new(Vec3::ZERO, Vec3::Y), &mut scratch).0, Vec3::ZERO);
    let (one, _) = IrradianceSamples::new(&[sample(Vec3::ZERO, 3.0)], &params);
    assert_eq!(one.irradiance(&Place::new(Vec3::X * 9.0, Vec3::NEG_Y), &mut scratch).0, Vec3::splat(3.0));
    // All in one place, and all equally far.
    let same = [sample(Vec3::ZERO, 2.0); 20];
    let (index, _) = IrradianceSamples::new(&same, &params);
    assert_eq!(index.irradiance(&Place::new(Vec3::X, Vec3::Y), &mut scratch).0, Vec3::splat(2.0));
    let bad = GatherSample { irradiance: Vec3::splat(f32::NAN), ..same[0] };
    assert_eq!(IrradianceSamples::new(&[bad, same[0]], &params).1, 1);
    // All-miss and zero distances.
    let far = GatherSample { mean_distance: f32::INFINITY, ..same[0] };
    let near = GatherSample { mean_distance: 0.0, ..sample(Vec3::X, 1.0) };
    for clamp_neighbours in [false, true] {
        let params = InterpolationParams { clamp_neighbours, min_distance: 0.0, ..params };
        let (index, _) = IrradianceSamples::new(&[far, near], &params);
        assert!(index.irradiance(&Place::new(Vec3::X * 0.5, Vec3::Y), &mut scratch).0.is_finite());
    }
    // Gradients: to first order, no farther than R, here 0.5; no steeper than the split sphere's, and cut off
    // at zero.
    let params = InterpolationParams { gradients: true, neighbours: 1, ..params };
    let (index, _) = IrradianceSamples::new(&[sample(Vec3::ZERO, 1.0)], &params);
    assert_eq!(
        index.irradiance(&Place::new(Vec3::X * 0.5, Vec3::Y), &mut scratch),
        (Vec3::splat(1.5), Vec3::ZERO)
    );
    assert_eq!(index.irradiance(&Place::new(Vec3::X * -2.0, Vec3::Y), &mut scratch).0, Vec3::splat(0.5));
    let steep = GatherSample { translation: [Vec3::X * 100.0; 3], ..sample(Vec3::ZERO, 1.0) };
    let (index, _) = IrradianceSamples::new(&[steep], &params);
    let (irradiance, below) = index.irradiance(&Place::new(Vec3::X * -2.0, Vec3::Y), &mut scratch);
    assert!(irradiance == Vec3::ZERO && (below.x - (4.0 / PI - 1.0)).abs() < 1e-5, "{below}");
    let turned = GatherSample { rotation: [Vec3::X * 100.0; 3], ..sample(Vec3::ZERO, 1.0) };
    let (index, _) = IrradianceSamples::new(&[turned], &params);
    let (irradiance, _) = index.irradiance(&Place::new(Vec3::ZERO, Vec3::Z), &mut scratch);
    assert!((irradiance.x - (1.0 + core::f32::consts::SQRT_2)).abs() < 1e-5, "{irradiance}");
}
