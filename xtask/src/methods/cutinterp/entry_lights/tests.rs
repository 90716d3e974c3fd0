use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{GeometricBound, LightBounds, LightId, NodeBound};
use scene::bsdf::{Bsdf, Phong};
use scene::{Counts, Frame, Light, SceneRays, ShadingPoint, builtin};

use super::super::super::lightcut::peak_intensity;
use super::super::lights::one;
use super::{Chosen, EntryLights, Kind, LANES, Lanes, NodeLight, QuickBounds};

/// Several lights at once are what each of them is by itself: below horizons, clamped, at the point
/// itself, in and out of the lobe, whose exponent may be a whole number or none.
#[test]
fn lanes_are_single_lights() {
    let scene = builtin("cornell").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    let mut random = Random::new(3, 0, 0);
    let mut unit = || {
        let mut any = || 2.0 * random.f32() - 1.0;
        Vec3::new(any(), any(), any()).try_normalize().unwrap_or(Vec3::Y)
    };
    let (mut lit, mut clamped, mut glossy) = (0, 0, 0);
    for i in 0..8000u32 {
        let normal = unit();
        let wo = unit();
        let albedo = Vec3::new(0.5, 0.6, 0.7);
        let bsdf = match i % 4 {
            0 => Bsdf::Lambert { albedo },
            1 => Bsdf::Phong(Phong::over(albedo, 20.5)),
            2 => Bsdf::Phong(Phong::over(albedo, 150.0)),
            _ => Bsdf::Phong(Phong::over(albedo, 20.0)),
        };
        let point = ShadingPoint {
            position: unit(),
            geometric_normal: normal,
            normal,
            wo: if wo.dot(normal) < 0.0 { -wo } else { wo },
            bsdf,
            throughput: Vec3::ONE,
            pixel: 0,
            sample: 0,
            offset: 0.0,
        };
        let (at, intensity) = (i as usize % 11, Vec3::new(3.0, 2.0, 1.0));
        let mirrored = 2.0 * normal.dot(point.wo) * normal - point.wo;
        let position = match i % 50 {
            0 => point.position,
            1..10 => point.position + mirrored + 0.1 * unit(),
            _ => unit(),
        };
        let normal = unit();
        let lights = [Light::Vpl { position, normal, intensity }];
        let frame = Frame { vpl_clamp: 1.0, ..Frame::new(&scene, &rays, &lights, 1) };
        let (light, kind) = (LightId(0), Kind::Virtual);
        let node = NodeLight { position, light, normal, kind, intensity, near_squared: 0.0 };
        let mut entries = EntryLights {
            lanes: vec![Lanes::default(); 2],
            intensity: vec![intensity; 11],
            ids: vec![LightId(0); 11],
            kinds: vec![Kind::Virtual; 11],
            near_squared: vec![0.0; 11],
            with_area: vec![],
            bounds: QuickBounds::default(),
            plain_scale: true,
            skips_area: false,
        };
        entries.lanes[at / LANES].set(at % LANES, &node);
        let chosen: Vec<Chosen> = (0..11).map(|entry| Chosen { entry, visibility: 1.0 }).collect();
        let (mut out, mut counts, mut alone) = (vec![], Counts::default(), Counts::default());
        entries.unoccluded(&frame, &point, &chosen, &mut vec![], &mut out, &mut vec![], &mut counts);
        let (expected, _) = one(&frame, &point, (LightId(0), intensity), 1.0, &mut alone);
        let error = (out[at] - expected).abs().max_element();
        assert!(error <= 1e-4 * expected.max_element() + 1e-6, "{i}: {} is not {expected}", out[at]);
        let off = (counts.clamped_luminance - alone.clamped_luminance).abs();
        assert!(off <= 1e-3 * alone.clamped_luminance + 1e-4, "{i}: {counts:?} is not {alone:?}");
        assert!(counts.clamped == alone.clamped || (off < 1e-4 && error < 1e-4));
        out.remove(at);
        assert!(out.iter().all(|&other| other == Vec3::ZERO), "what was not set is dark");
        lit += u32::from(expected != Vec3::ZERO);
        clamped += counts.clamped;
        let in_lobe = mirrored.dot((position - point.position).normalize_or_zero()) > 0.95;
        glossy += u32::from(in_lobe && i % 4 > 0 && expected != Vec3::ZERO);
    }
    assert!(lit > 1000 && clamped > 50 && glossy > 100, "{lit} lit, {clamped} clamped, {glossy} glossy");
}

/// No entry that may break the bound goes unnoticed, and most others do.
#[test]
fn what_is_not_above_is_below_its_bound() {
    let mut random = Random::new(4, 0, 0);
    let (mut above, mut missed, mut noticed) = (vec![], 0, 0);
    for i in 0..500u32 {
        let mut any = || Vec3::new(random.f32(), random.f32(), random.f32()) * 2.0 - 1.0;
        let nodes: Vec<LightBounds> = (0..21)
            .map(|_| {
                let (at, size) = (3.0 * any(), 0.1 * any().abs());
                LightBounds::surface(at - size, at + size, any().normalize_or(Vec3::Y), false, any().x.abs())
            })
            .collect();
        let (normal, wo, albedo) = (any().normalize_or(Vec3::Y), any(), Vec3::new(0.2, 0.8, 0.5));
        let wo = if wo.dot(normal) < 0.0 { -wo } else { wo }.normalize_or(normal);
        let glossy = Bsdf::Phong(Phong::over(albedo, 150.0));
        let point = ShadingPoint {
            position: 0.1 * any(),
            geometric_normal: normal,
            normal,
            wo,
            bsdf: if i % 2 == 0 { Bsdf::Lambert { albedo } } else { glossy },
            throughput: Vec3::ONE,
            pixel: 0,
            sample: 0,
            offset: 0.0,
        };
        let mut entries = EntryLights { plain_scale: true, ..EntryLights::default() };
        nodes.iter().for_each(|node| entries.bounds.push(node));
        let exact: Vec<f64> = nodes.iter().map(|node| GeometricBound.bound(node, &point).upper).collect();
        let mut in_order = exact.clone();
        in_order.sort_by(f64::total_cmp);
        let limit = in_order[15];
        entries.above(&point, limit, &mut above);
        for (j, exact) in exact.iter().enumerate() {
            let suspected = above[j / 8] >> (j % 8) & 1 != 0;
            assert!(suspected || *exact <= limit, "{i}: {exact} is above {limit}");
            noticed += u32::from(!suspected);
            missed += u32::from(suspected && *exact < limit);
        }
        entries.plain_scale = false;
        entries.above(&point, limit, &mut above);
        assert!(above.is_empty(), "nobody can say");
    }
    assert!(noticed > 4 * missed, "{missed} asked for nothing, {noticed} not asked");
}

/// The middle of a triangle far away gives what the mean of many places on it does; near by, and from
/// both sides, nobody takes it.
#[test]
fn a_far_triangle_is_its_middle() {
    let scene = builtin("cornell").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    let mut random = Random::new(5, 0, 0);
    let (mut far, mut near) = (0, 0);
    for i in 0..600u32 {
        let mut any = || Vec3::new(random.f32(), random.f32(), random.f32()) * 2.0 - 1.0;
        let (middle, size) = (4.0 * any(), [0.02, 0.5][i as usize % 2]);
        let vertices = [(); 3].map(|()| middle + size * any());
        let two_sided = i % 5 == 4;
        let radiance = Vec3::new(3.0, 2.0, 1.0);
        let light = Light::Triangle { vertices, radiance, two_sided, instance: u32::MAX, triangle: 0 };
        let lights = [light];
        let frame = Frame { vpl_clamp: 1e-6, ..Frame::new(&scene, &rays, &lights, 1) };
        let normal = any().normalize_or(Vec3::Y);
        let bsdf = Bsdf::Lambert { albedo: Vec3::new(0.5, 0.6, 0.7) };
        let point = ShadingPoint {
            position: Vec3::ZERO,
            geometric_normal: normal,
            normal,
            wo: normal,
            bsdf,
            throughput: Vec3::ONE,
            pixel: 0,
            sample: 0,
            offset: 0.0,
        };
        let intensity = peak_intensity(&lights[0]);
        let node = NodeLight::of_light(&lights[0], LightId(0), intensity);
        let mut entries = EntryLights { plain_scale: true, ..EntryLights::default() };
        entries.push(&node, None);
        let chosen = [Chosen { entry: 0, visibility: 1.0 }];
        let (mut out, mut asked, mut counts) = (vec![], vec![], Counts::default());
        entries.unoccluded(&frame, &point, &chosen, &mut vec![], &mut out, &mut asked, &mut counts);
        assert_eq!(counts.clamped, 0, "lamps are not clamped");
        let is_near = lights[0].is_near(point.position, 0.0);
        assert_eq!(entries.is_near(0, &point), is_near || two_sided, "{i}");
        if is_near || two_sided {
            near += 1;
            continue;
        }
        let mut sum = Vec3::ZERO;
        for place in 0..256 {
            let u = [(place as f32 + 0.5) / 256.0, (place as f32 * 0.618_034).fract()];
            sum += point.contribution(&lights[0].point_by_area(&scene, u));
        }
        let mean = sum / 256.0;
        // What the light's horizon or the point's cuts through varies without a bound.
        let peak = intensity / middle.length_squared() * 0.7 / core::f32::consts::PI;
        let off = (out[0] - mean).abs().max_element();
        assert!(off <= 0.01 * mean.max_element() + 0.02 * peak.max_element(), "{i}: {} {mean}", out[0]);
        far += u32::from(mean != Vec3::ZERO);
    }
    assert!(far > 40 && near > 100, "{far} far, {near} near");
}

#[test]
fn lights_with_an_area_are_found_among_the_chosen() {
    let entries = EntryLights {
        intensity: (0..9).map(|i| Vec3::splat(i as f32)).collect(),
        ids: (10..19).map(LightId).collect(),
        with_area: vec![0, 3, 4, 8],
        ..EntryLights::default()
    };
    let chosen = [0, 1, 4, 5, 7].map(|entry| Chosen { entry, visibility: 1.0 });
    let mut found = vec![7];
    entries.chosen_with_area(&chosen, &mut found);
    assert_eq!(found, [0, 2]);
    assert_eq!(entries.light(4), (LightId(14), Vec3::splat(4.0)));
    entries.chosen_with_area(&[], &mut found);
    assert!(found.is_empty());
}
