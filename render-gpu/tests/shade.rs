//! Shading on the device against the reference host's materials, lights and rays: the same points on the same
//! lights.

mod common;

use glam::{DVec3, Vec3};
use lighttree::rng::{Random, pcg4d};
use lighttree::{Emitter, LightId, RayQueries, WeightedLight, luminance};
use render_gpu::Gpu;
use render_gpu::shade::{RadianceRecord, ShadeKernel, ShadeParams, Shading, SurfaceRecord};
use scene::{Counts, Frame, Light, RayScratch, RaysParams, SceneRays, ShadingPoint, camera_path, camera_ray};

use common::scenes::{Uploaded, records, upload, uploaded};

/// As `shaders/shade/shade.wgsl` has it.
const PLACES: u32 = 0x504c_4143;
const SEED: u32 = 9;
const INDEX: u32 = 3;
const LIGHTS: u32 = 6;

/// Points that a camera sees.
fn points(uploaded: &Uploaded, rays: &SceneRays) -> Vec<ShadingPoint> {
    let scene = &uploaded.scene;
    let frame = Frame::new(scene, rays, &scene.lights, SEED);
    let camera = scene.cameras.first().expect("built-in scenes have a camera");
    let (size, mut scratch, mut counts) = ((64, 40), RayScratch::default(), Counts::default());
    let seen = (0..size.0 * size.1).filter_map(|pixel| {
        let (ray, mut random) = camera_ray(camera, SEED, size, pixel, 0);
        let hit = rays.closest(&ray, &mut scratch);
        camera_path(&frame, &ray, hit, pixel, 0, &mut random, &mut scratch, &mut counts).point
    });
    seen.collect()
}

/// Rows of lights that somebody might have drawn, with gaps.
fn rows(points: usize, lights: u32) -> Vec<WeightedLight> {
    let mut random = Random::new(1, 0, 0);
    let mut entry = || {
        let (light, weight) = (random.u32() % (lights + 1), 0.5 + random.f32());
        if light == lights { WeightedLight::NONE } else { WeightedLight { light: LightId(light), weight } }
    };
    (0..points * LIGHTS as usize).map(|_| entry()).collect()
}

fn on_device(
    gpu: &Gpu,
    uploaded: &Uploaded,
    surfaces: &[SurfaceRecord],
    rows: &[WeightedLight],
) -> Vec<RadianceRecord> {
    let scene = &uploaded.scene;
    let emitters: Vec<_> = scene.lights.iter().map(|light| records::emitter(scene, light)).collect();
    let kernel = ShadeKernel::new(gpu, uploaded.geometry.source()).unwrap();
    let [surface_buffer, drawn] =
        [gpu.upload("surfaces", surfaces), gpu.upload("drawn", rows)].map(Result::unwrap);
    let emitter_buffer = gpu.upload("emitters", &emitters).unwrap();
    let outcomes = gpu.upload("outcomes", &vec![f32::NAN; rows.len()]).unwrap();
    let told = Some(&outcomes);
    let shading = Shading::new(gpu, &kernel, &surface_buffer, &emitter_buffer, &drawn, told).unwrap();
    let params = ShadeParams {
        surfaces: surfaces.len() as u32,
        lights: LIGHTS,
        seed: SEED,
        index: INDEX,
        emitters: emitters.len() as u32,
        tell: 1,
        spare0: 0,
        spare1: 0,
    };
    shading.set(gpu.queue(), &params).unwrap();
    gpu.run("shade", |encoder| shading.encode(encoder, &uploaded.geometry)).unwrap();
    let radiance = gpu.read(shading.radiance(), surfaces.len()).unwrap();
    let outcomes = gpu.read(&outcomes, rows.len()).unwrap();
    check_outcomes(&radiance, rows, &outcomes);
    radiance
}

/// What is told of the entries of a row sums up to the luminance of its radiance.
fn check_outcomes(radiance: &[RadianceRecord], rows: &[WeightedLight], outcomes: &[f32]) {
    const LIGHTS: usize = self::LIGHTS as usize;
    for ((lit, row), told) in radiance.iter().zip(rows.chunks(LIGHTS)).zip(outcomes.chunks(LIGHTS)) {
        let luminance = luminance(Vec3::from(lit.color));
        let sum: f32 = row.iter().zip(told).map(|(entry, told)| entry.weight * told).sum();
        assert!((sum - luminance).abs() <= 1e-4 * luminance, "{told:?} are {sum}, not {luminance}");
    }
}

/// The same in the host: radiance, shadow rays and lights looked at.
fn on_cpu(
    uploaded: &Uploaded,
    rays: &SceneRays,
    point: &ShadingPoint,
    row: &[WeightedLight],
) -> (DVec3, u32, u32) {
    let mut scratch = RayScratch::default();
    let (mut sum, mut shadow_rays, mut looked_at) = (DVec3::ZERO, 0, 0);
    for (j, entry) in row.iter().enumerate().filter(|(_, entry)| entry.light != LightId::NONE) {
        looked_at += 1;
        let words = pcg4d([SEED ^ PLACES, point.pixel, INDEX, j as u32]);
        let u = [words[0], words[1]].map(|word| (word >> 8) as f32 / (1 << 24) as f32);
        let light = uploaded.scene.lights[entry.light.0 as usize].point_by_area(&uploaded.scene, u);
        let value = point.contribution(&light);
        if value == Vec3::ZERO {
            continue;
        }
        shadow_rays += 1;
        if !rays.occluded(&point.segment(&light), &mut scratch) {
            sum += (value * entry.weight).as_dvec3();
        }
    }
    (sum, shadow_rays, looked_at)
}

/// Points whose radiance differs by more than `tolerance` of their own or a hundredth of the mean.
fn differ(device: &[RadianceRecord], host: &[(DVec3, u32, u32)], tolerance: f64) -> usize {
    let mean = host.iter().map(|(color, ..)| color.element_sum()).sum::<f64>() / host.len() as f64;
    let is_far = |(device, (color, ..)): (&RadianceRecord, &(DVec3, u32, u32))| {
        let away = (Vec3::from(device.color).as_dvec3() - *color).abs().element_sum();
        // Also where it is not a number.
        away.is_nan() || away > tolerance * color.element_sum().max(0.01 * mean)
    };
    device.iter().zip(host).filter(|&pair| is_far(pair)).count()
}

/// No built-in scene has spots: every third light is one, with a wide ramp.
fn some_spots(lights: &mut [Light]) {
    for (i, light) in lights.iter_mut().enumerate().filter(|(i, _)| i % 3 == 1) {
        let bounds = light.bounds();
        let axis = Vec3::new(0.3 * (i as f32).sin(), -1.0, 0.2).normalize();
        let position = 0.5 * (bounds.min + bounds.max) + 0.05 * axis;
        *light = Light::Spot { position, axis, intensity: Vec3::splat(20.0), cos_inner: 0.9, cos_outer: 0.1 };
    }
}

#[test]
fn surfaces_shine_as_in_the_reference_host() {
    let gpu = gpu_or_skip!();
    // Lambert, GGX and Phong; point lights, spots, triangles.
    for name in ["hall:200", "glossy:200", "cornell", "wall:300"] {
        let mut uploaded = uploaded(gpu, name, &RaysParams::default());
        some_spots(&mut uploaded.scene.lights);
        let rays = SceneRays::build(&uploaded.scene).unwrap();
        let points = points(&uploaded, &rays);
        let rows = rows(points.len(), uploaded.scene.lights.len() as u32);
        let surfaces: Vec<_> = points.iter().map(records::surface).collect();
        let device = on_device(gpu, &uploaded, &surfaces, &rows);
        let each = points.iter().zip(rows.chunks(LIGHTS as usize));
        let host: Vec<_> = each.map(|(point, row)| on_cpu(&uploaded, &rays, point, row)).collect();
        assert!(points.len() > 500 && host.iter().any(|(color, ..)| *color != DVec3::ZERO));
        // Shadow rays that pass an edge within rounding, one point in a hundred at most.
        let far = differ(&device, &host, 2e-3);
        eprintln!("{name}: {far} of {} points differ", points.len());
        assert!(far <= points.len() / 100, "{name}: {far} of {} points", points.len());
        let count = |of: &dyn Fn(usize) -> u32| (0..points.len()).map(|i| u64::from(of(i))).sum::<u64>();
        assert_eq!(count(&|i| device[i].counts >> 16), count(&|i| host[i].2));
        let (ours, theirs) = (count(&|i| device[i].counts & 0xffff), count(&|i| host[i].1));
        assert!(ours.abs_diff(theirs) <= theirs / 200 + 2, "{name}: {ours} shadow rays, {theirs} on the cpu");

        // Negative controls: surfaces a little darker, rougher, or turned.
        let changes: [fn(&mut SurfaceRecord); 2] = [
            |surface| surface.base.iter_mut().chain(&mut surface.f0).for_each(|value| *value *= 0.99),
            |surface| surface.normal = (Vec3::from(surface.normal) + 0.03 * Vec3::ONE).normalize().to_array(),
        ];
        for change in changes {
            let mut changed = surfaces.clone();
            changed.iter_mut().for_each(change);
            let far = differ(&on_device(gpu, &uploaded, &changed, &rows), &host, 2e-3);
            assert!(far > points.len() / 10, "{name}: {far} points changed");
        }
    }
}

/// Nothing between the device and an instance's transform: the same radiance from both layouts of the
/// geometry.
#[test]
fn two_levels_cast_the_same_shadows() {
    let gpu = gpu_or_skip!();
    let flat = uploaded(gpu, "hall:200", &RaysParams::default());
    let rays = SceneRays::build(&flat.scene).unwrap();
    let points = points(&flat, &rays);
    let rows = rows(points.len(), flat.scene.lights.len() as u32);
    let surfaces: Vec<_> = points.iter().map(records::surface).collect();
    let one = on_device(gpu, &flat, &surfaces, &rows);
    let arrays = scene::FlatRays::new(&flat.scene, &RaysParams { max_flattened: 0 }).unwrap();
    let two_levels = Uploaded { geometry: upload(gpu, &arrays), ..flat };
    let two = on_device(gpu, &two_levels, &surfaces, &rows);
    let differing = one.iter().zip(&two).filter(|(a, b)| a != b).count();
    assert!(differing <= points.len() / 100, "{differing} of {} points", points.len());
}
