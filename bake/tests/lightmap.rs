//! Lightmaps do what their users miss elsewhere: they come back to the bit, and don't leak.

mod host;

use bake::lightmap::{
    ImageParams, LayoutParams, Lightmap, LightmapError, LightmapParams, Work, directional_irradiance,
};
use bake::{GeometryVersion, Places, Polygon, Profile, Shape, Update, VirtualLight};
use glam::{Affine3A, Quat, Vec3};
use host::{Mesh, Soup, add, contribution, lightmap, subtract};
use lighttree::rng::Random;

fn params(texels_per_unit: f32) -> LightmapParams {
    let layout = LayoutParams { texels_per_unit, ..LayoutParams::default() };
    LightmapParams { layout, ..LightmapParams::default() }
}

fn point(position: Vec3, flux: f32, seed: u32) -> VirtualLight {
    let shape = Shape::Point { position, profile: Profile::Lambert, frame: Quat::IDENTITY };
    VirtualLight { shape, flux: Vec3::new(flux, 0.5 * flux, 0.25 * flux), seed }
}

fn sky(irradiance: f32, seed: u32) -> VirtualLight {
    let shape = Shape::Sky {
        frame: Quat::from_rotation_arc(Vec3::Z, Vec3::Y),
        cos: [-1.0, 1.0],
        around: [0.0, core::f32::consts::TAU],
    };
    VirtualLight { shape, flux: Vec3::splat(irradiance), seed }
}

fn disk(random: &mut Random) -> VirtualLight {
    let place = |r: &mut Random| Vec3::new(4.0 * r.f32(), 3.0 * r.f32(), 4.0 * r.f32());
    let normal = (place(random) - 2.0).normalize_or(Vec3::Y);
    let shape = Shape::Disk { position: place(random), normal, radius: 0.1 };
    VirtualLight { shape, flux: Vec3::splat(10f32.powf(8.0 * random.f32() - 4.0)), seed: random.u32() }
}

/// A room with a block in it.
fn room() -> Vec<Mesh> {
    vec![
        Mesh::default().cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), false),
        Mesh::default().cuboid(Vec3::new(1.0, 0.0, 1.0), Vec3::new(2.0, 1.0, 2.0), true),
    ]
}

fn sums(map: &Lightmap<Soup>) -> Vec<i64> {
    map.sums().collect()
}

/// The irradiance of a point light on a floor is `I cos θ / d²`, at every texel that sees it.
#[test]
fn irradiance_is_what_it_should_be() {
    let floor = [Mesh::default().quad(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0)];
    let mut map = lightmap(&floor, &params(4.0));
    let light = point(Vec3::new(2.0, 1.5, 2.0), 4.0 * core::f32::consts::PI, 1);
    map.apply(&add(&light, 0)).unwrap();
    let image = map.image(0, &ImageParams::default());
    let brightest = image.values.iter().copied().fold(0.0, f32::max);
    let nearest = 1.5 / (1.5f32.powi(2) + 2.0 * 0.125f32.powi(2)).powf(1.5);
    assert!((brightest / nearest - 1.0).abs() < 0.02, "{brightest} {nearest}");
    assert_eq!(map.counts(), bake::lightmap::FixedPointCounts::default());
}

/// Hundreds of random adds, then the same taken away in another order, leave every bit as it was: for one
/// thread and for two.
#[test]
fn undo_is_exact_for_any_order_and_threads() {
    let meshes = room();
    let mut ends = Vec::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut random = Random::new(3, 0, 0);
            let mut map = lightmap(&meshes, &params(1.0));
            let lasting = point(Vec3::new(0.5, 2.5, 3.0), 10.0, 5);
            map.apply(&add(&lasting, 0)).unwrap();
            let before = sums(&map);
            assert!(before.iter().any(|&sum| sum > 0));
            let lights: Vec<_> = (0..600).map(|_| disk(&mut random)).collect();
            // Some by some, as updates have them.
            for part in lights.chunks(7) {
                let add = part.iter().map(|light| contribution(light, 0)).collect();
                map.apply(&Update { add, subtract: Vec::new() }).unwrap();
            }
            ends.push(sums(&map));
            assert_ne!(ends[ends.len() - 1], before);
            let mut order: Vec<usize> = (0..lights.len()).collect();
            order.sort_by_key(|&i| lights[i].seed);
            for part in order.chunks(11) {
                let subtract = part.iter().map(|&i| contribution(&lights[i], 0)).collect();
                map.apply(&Update { subtract, add: Vec::new() }).unwrap();
            }
            assert_eq!(sums(&map), before);
            assert_eq!(map.live(), 1);
        });
    }
    assert_eq!(ends[0], ends[1], "threads change no bit");
}

/// 10⁵ lights of eight decades come and go in another order: not a bit is left of them, for one thread and
/// for two.
#[test]
fn a_hundred_thousand_lights_leave_no_trace() {
    let floor = [Mesh::default().quad(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0)];
    let mut ends = Vec::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut random = Random::new(9, 0, 0);
            let mut map = lightmap(&floor, &params(1.0));
            map.apply(&add(&point(Vec3::ONE, 1.0, 1), 0)).unwrap();
            let before = sums(&map);
            let mut lights: Vec<_> = (0..100_000).map(|_| disk(&mut random)).collect();
            for part in lights.chunks(100) {
                let add = part.iter().map(|light| contribution(light, 0)).collect();
                map.apply(&Update { add, subtract: Vec::new() }).unwrap();
            }
            ends.push(sums(&map));
            lights.sort_by_key(|light| light.seed);
            for part in lights.chunks(77) {
                let subtract = part.iter().map(|light| contribution(light, 0)).collect();
                map.apply(&Update { subtract, add: Vec::new() }).unwrap();
            }
            assert_eq!(sums(&map), before);
            assert_eq!(map.counts(), bake::lightmap::FixedPointCounts::default());
        });
    }
    assert_eq!(ends[0], ends[1]);
}

/// A block moves away and back: the same bits, and the version in between is let go of when its light is.
#[test]
fn moving_away_and_back_is_exact() {
    let meshes = room();
    let mut map = lightmap(&meshes, &params(2.0));
    let light = point(Vec3::new(0.5, 2.5, 0.4), 50.0, 1);
    map.apply(&add(&light, 0)).unwrap();
    let before = sums(&map);
    let stands = |x: f32| vec![Some(Affine3A::IDENTITY), Some(Affine3A::from_translation(Vec3::X * x))];
    for (version, x) in [(1, 1.5), (2, 0.0)] {
        map.set_geometry(GeometryVersion(version), Soup::new(&meshes, &stands(x)), &stands(x)).unwrap();
        let update = Update {
            subtract: vec![contribution(&light, version - 1)],
            add: vec![contribution(&light, version)],
        };
        assert_eq!(map.versions().count(), 2, "both are needed for the update");
        map.apply(&update).unwrap();
        assert_eq!(map.versions().collect::<Vec<_>>(), [GeometryVersion(version)]);
        assert_eq!(sums(&map) == before, version == 2);
    }
    // Absent: no light falls on it, and none is stopped.
    let gone = vec![Some(Affine3A::IDENTITY), None];
    map.set_geometry(GeometryVersion(3), Soup::new(&meshes, &gone), &gone).unwrap();
    map.apply(&Update { subtract: vec![contribution(&light, 2)], add: vec![contribution(&light, 3)] })
        .unwrap();
    assert_ne!(sums(&map), before);
    map.apply(&subtract(&light, 3)).unwrap();
    assert!(map.sums().all(|sum| sum == 0));
}

/// A light in the place of another goes through the texels once, and leaves the bits that subtracting and
/// adding leave: dimmed or not, with a block moved in between or not.
#[test]
fn one_pass_leaves_the_bits_of_two() {
    let meshes = room();
    let stands = |x: f32| vec![Some(Affine3A::IDENTITY), Some(Affine3A::from_translation(Vec3::X * x))];
    let corners = [[0.2, 0.2], [0.9, 0.2], [0.9, 0.9], [0.2, 0.9]].map(|[x, z]| Vec3::new(x, 2.9, z));
    let polygon = Polygon::new(&corners).unwrap();
    let places: Vec<Vec3> = corners.iter().map(|&corner| corner * 0.99).collect();
    let shapes = [
        Shape::Point { position: Vec3::new(0.5, 2.5, 0.4), profile: Profile::Lambert, frame: Quat::IDENTITY },
        Shape::Polygon(polygon),
        Shape::Patch { polygon, places: Places::new(&places).unwrap().into() },
        Shape::Disk { position: Vec3::new(3.9, 1.0, 2.0), normal: Vec3::NEG_X, radius: 0.2 },
        sky(1.0, 0).shape,
    ];
    for (samples, directional) in [(1, false), (3, false), (2, true)] {
        let params = LightmapParams { samples, directional, ..params(3.0) };
        let (mut once, mut twice) = (lightmap(&meshes, &params), lightmap(&meshes, &params));
        let lights: Vec<VirtualLight> = (0..15)
            .map(|i| VirtualLight {
                shape: shapes[i % 5].clone(),
                flux: Vec3::new(9.0, 3.0, 1.0),
                seed: i as u32,
            })
            .collect();
        for map in [&mut once, &mut twice] {
            lights.iter().for_each(|light| map.apply(&add(light, 0)).unwrap());
            map.set_geometry(GeometryVersion(1), Soup::new(&meshes, &stands(1.2)), &stands(1.2)).unwrap();
        }
        for (i, light) in lights.iter().enumerate() {
            let (scale, version) = [(1.0, 1), (0.25, 1), (0.5, 0)][i / 5];
            let other = VirtualLight { flux: light.flux * Vec3::new(scale, 1.0, scale), ..light.clone() };
            let (old, new) = (contribution(light, 0), contribution(&other, version));
            let both = Update { subtract: vec![old.clone()], add: vec![new.clone()] };
            assert_eq!((both.accumulations(), both.passes().len()), (1, 1));
            // Another name has other jitter.
            let renamed = VirtualLight { seed: 99, ..other.clone() };
            let two = Update { add: vec![contribution(&renamed, version)], ..both.clone() };
            assert_eq!((two.accumulations(), two.passes().len()), (2, 2));
            once.apply(&both).unwrap();
            twice.apply(&Update { add: vec![new], ..Update::default() }).unwrap();
            twice.apply(&Update { subtract: vec![old], ..Update::default() }).unwrap();
            assert!(sums(&once) == sums(&twice), "light {i}, {samples} samples, {directional}");
            assert_eq!(once.published().values, twice.published().values);
        }
        assert_eq!(once.counts(), twice.counts());
    }
}

/// Where nothing that moved is between a light and a texel, neither is a shadow ray.
#[test]
fn what_nothing_moved_before_takes_no_rays() {
    let meshes = [
        Mesh::default().cuboid(Vec3::ZERO, Vec3::new(8.0, 3.0, 2.0), false),
        Mesh::default().cuboid(Vec3::new(6.5, 0.0, 0.5), Vec3::new(7.0, 0.5, 1.0), true),
    ];
    let mut map = lightmap(&meshes, &params(4.0));
    let light = point(Vec3::new(0.5, 2.5, 1.0), 50.0, 1);
    let asked = |map: &Lightmap<Soup>| -> usize {
        map.versions().map(|version| map.rays(version).unwrap().asked()).sum()
    };
    map.apply(&add(&light, 0)).unwrap();
    let all = asked(&map);
    // It keeps the first version.
    map.apply(&add(&point(Vec3::ONE, 1.0, 2), 0)).unwrap();
    let stands = [Some(Affine3A::IDENTITY), Some(Affine3A::from_translation(Vec3::X * 0.3))];
    map.set_geometry(GeometryVersion(1), Soup::new(&meshes, &stands), &stands).unwrap();
    let before = asked(&map);
    map.apply(&Update { subtract: vec![contribution(&light, 0)], add: vec![contribution(&light, 1)] })
        .unwrap();
    let rays = asked(&map) - before;
    // Two passes would ask twice as many as one.
    assert!(rays > 0 && rays < 2 * all / 4, "{rays} rays of {all} in a pass");
}

/// Readers see whole updates, however often the work is interrupted.
#[test]
fn readers_never_see_half_an_update() {
    let mut map = lightmap(&room(), &params(12.0));
    let light = point(Vec3::new(0.5, 2.5, 0.4), 50.0, 1);
    map.begin(add(&light, 0)).unwrap();
    let before = map.published();
    let mut steps = 0;
    while map.work(|| false) == Work::UnderWay {
        steps += 1;
        assert!(map.published().values.iter().all(|&v| v == 0.0) && map.published().updates == 0);
        assert_eq!(map.begin(Update::default()), Err(LightmapError::Busy));
    }
    assert!(steps > 2, "{steps} interruptions");
    assert!(before.values.iter().all(|&v| v == 0.0), "a reader keeps what it has");
    let after = map.published();
    assert_eq!(after.updates, 1);
    let channels = map.channels();
    let fixed = map.fixed_point();
    let expected: Vec<f32> = map.sums().map(|sum| fixed.value(sum) as f32).collect();
    assert_eq!((after.values.len() / channels, &after.values), (map.texels(), &expected));
}

/// A closed box of walls with an inside, under a sky of 10⁶ W·m⁻²: not a photon comes in.
#[test]
fn a_closed_box_under_a_bright_sky_is_black_inside() {
    let meshes = [
        Mesh::default().cuboid(Vec3::ZERO, Vec3::ONE, false),
        Mesh::default().cuboid(Vec3::splat(-0.05), Vec3::splat(1.05), true),
        // One that stands through the floor and the wall.
        Mesh::default().cuboid(Vec3::new(0.3, -0.02, 0.9), Vec3::new(0.7, 0.5, 1.02), true),
    ];
    let mut map = lightmap(&meshes, &LightmapParams { samples: 2, ..params(12.0) });
    for seed in 0..24 {
        map.apply(&add(&sky(1e6, seed), 0)).unwrap();
    }
    let image = map.image(0, &ImageParams { dilate: 0, stitch: false });
    let light_of = |object: usize| {
        let (min, max) = map.layout().objects[object].as_ref().unwrap().pixels();
        let rows = (min[1]..max[1]).flat_map(|y| (min[0]..max[0]).map(move |x| (x, y)));
        rows.map(|(x, y)| image.values[(y * image.width + x) as usize * 3]).fold(0.0, f32::max)
    };
    assert_eq!(light_of(0), 0.0, "inside");
    assert_eq!(light_of(2), 0.0, "what stands inside");
    assert!(light_of(1) > 1e5, "outside");
}

/// Two rooms with 10⁻³ between their walls: the light of one is not in the other.
#[test]
fn a_thin_wall_does_not_leak() {
    let meshes = [
        Mesh::default().cuboid(Vec3::ZERO, Vec3::new(2.0, 2.0, 2.0), false),
        Mesh::default().cuboid(Vec3::new(2.001, 0.0, 0.0), Vec3::new(4.0, 2.0, 2.0), false),
    ];
    let mut map = lightmap(&meshes, &LightmapParams { samples: 4, ..params(6.0) });
    for seed in 0..4 {
        map.apply(&add(&point(Vec3::new(1.9, 1.0, 0.5 * seed as f32 + 0.2), 1e6, seed), 0)).unwrap();
    }
    let image = map.image(0, &ImageParams::default());
    let (min, max) = map.layout().objects[1].as_ref().unwrap().pixels();
    for y in min[1]..max[1] {
        for x in min[0]..max[0] {
            assert_eq!(image.values[(y * image.width + x) as usize * 3], 0.0, "({x}, {y})");
        }
    }
    assert!(image.values.iter().any(|&v| v > 1e4), "the lit room is lit");
}

/// A crate stands on a floor. No texel of the floor beside it is darkened because its middle is under the
/// crate: all that is dark lies deep under it.
#[test]
fn texels_are_pushed_out_of_what_stands_on_them() {
    let floor = Mesh::default().quad(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0);
    let block = Mesh::default().cuboid(Vec3::new(1.1, -0.1, 1.1), Vec3::new(2.9, 1.0, 2.9), true);
    // From straight above, everywhere the same.
    let frame = Quat::from_rotation_arc(Vec3::Z, Vec3::Y);
    let sun = VirtualLight {
        shape: Shape::Sky { frame, cos: [1.0, 1.0], around: [0.0, 0.0] },
        flux: Vec3::ONE,
        seed: 0,
    };
    let lit = |map: &Lightmap<Soup>| {
        let image = map.image(0, &ImageParams { dilate: 0, stitch: false });
        let (min, max) = map.layout().objects[0].as_ref().unwrap().pixels();
        let texels = (min[1]..max[1]).flat_map(|y| (min[0]..max[0]).map(move |x| (x, y)));
        texels.filter(|&(x, y)| image.values[(y * image.width + x) as usize * 3] > 0.99).count()
    };
    let mut map = lightmap(&[floor.clone(), block], &params(2.0));
    map.apply(&add(&sun, 0)).unwrap();
    let receivers = map.receivers();
    // The crate holds 3.6 × 3.6 texels, and 1.6 × 1.6 that are more than one from its sides.
    assert!(receivers.pushed >= 6 && (1..=9).contains(&receivers.dead), "{receivers:?}");
    let mut empty = lightmap(&[floor], &params(2.0));
    empty.apply(&add(&sun, 0)).unwrap();
    assert_eq!(lit(&map) as u64 + receivers.dead, lit(&empty) as u64);
}

/// A smooth cylinder of one surface, unwrapped: across its seam the light is the same to 1/255.
#[test]
fn the_seam_of_a_cylinder_is_not_to_be_seen() {
    let mut tube = Mesh::default();
    let sides = 32;
    for i in 0..sides {
        let angle = core::f32::consts::TAU * i as f32 / sides as f32;
        let normal = Vec3::new(angle.cos(), 0.0, angle.sin());
        for y in [0.0, 1.0, 2.0] {
            tube.positions.push(0.5 * normal + Vec3::Y * y);
            tube.normals.push(normal);
        }
    }
    for i in 0..sides {
        let next = (i + 1) % sides;
        for row in 0..2 {
            let (a, b) = (3 * i + row, 3 * next + row);
            tube.triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
        }
    }
    let mut map = lightmap(&[tube], &LightmapParams { samples: 4, ..params(10.0) });
    let lamp = Polygon::new(&[
        Vec3::new(2.0, 0.5, -1.0),
        Vec3::new(2.0, 0.5, 1.0),
        Vec3::new(2.0, 1.5, 1.0),
        Vec3::new(2.0, 1.5, -1.0),
    ]);
    let lamp = lamp.unwrap().flipped();
    for (seed, polygon) in [lamp, lamp.flipped()].into_iter().enumerate() {
        let shape = Shape::Polygon(polygon);
        map.apply(&add(&VirtualLight { shape, flux: Vec3::splat(100.0), seed: seed as u32 }, 0)).unwrap();
    }
    for seed in 2..40 {
        map.apply(&add(&sky(1.0, seed), 0)).unwrap();
    }
    let rough = map.image(0, &ImageParams { stitch: false, ..ImageParams::default() });
    let image = map.image(0, &ImageParams::default());
    let stitched = image.stitched;
    assert!(stitched.seams >= 2 && stitched.points > 40, "{stitched:?}");
    assert!(stitched.before > 1.0 / 255.0, "there is something to stitch: {stitched:?}");
    assert!(stitched.after <= 1.0 / 255.0, "{stitched:?}");
    // It moves as little as it can.
    let moved = image.values.iter().zip(&rough.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let brightest = image.values.iter().copied().fold(0.0, f32::max);
    assert!(moved < 0.2 * brightest, "{moved} of {brightest}");
}

/// Irradiance out of four coefficients is that of the map without them where light comes along the normal,
/// and each texel costs what is stated.
#[test]
fn directional_maps_agree_with_irradiance() {
    let floor = || [Mesh::default().quad(Vec3::ZERO, Vec3::Z, Vec3::X)];
    let light = point(Vec3::new(0.5, 50.0, 0.5), 1e5, 1);
    let mut plain = lightmap(&floor(), &params(8.0));
    let mut directional = lightmap(&floor(), &LightmapParams { directional: true, ..params(8.0) });
    plain.apply(&add(&light, 0)).unwrap();
    directional.apply(&add(&light, 0)).unwrap();
    let (a, b) = (plain.published(), directional.published());
    for (irradiance, coefficients) in a.values.chunks_exact(3).zip(b.values.as_chunks::<12>().0) {
        let up = directional_irradiance(coefficients, Vec3::Y);
        // π Y00² + 2π/3 Y1² = 1/4 + 1/2: two bands hold three quarters of a cosine lobe at its middle.
        assert!((up.x / irradiance[0] - 0.75).abs() < 1e-3, "{up} {irradiance:?}");
        assert!(directional_irradiance(coefficients, Vec3::X).x < up.x);
        assert_eq!(directional_irradiance(coefficients, Vec3::NEG_Y), Vec3::ZERO);
    }
}

#[test]
fn a_texel_costs_what_is_stated() {
    for (samples, directional) in [(1, false), (4, false), (2, true)] {
        let floor = [Mesh::default().quad(Vec3::ZERO, Vec3::Z * 8.0, Vec3::X * 8.0)];
        let map = lightmap(&floor, &LightmapParams { samples, directional, ..params(16.0) });
        assert!(map.texels() >= 128 * 128);
        let each = map.bytes() as f64 / map.texels() as f64;
        let stated = 40.0 + 28.0 * f64::from(samples) + if directional { 108.0 } else { 0.0 };
        assert!(each >= stated && each < stated + 2.5, "{each} of {stated}");
    }
}

#[test]
fn mistakes_are_named() {
    let meshes = room();
    let mut map = lightmap(&meshes, &params(1.0));
    let light = point(Vec3::ONE, 1.0, 1);
    let version = GeometryVersion(7);
    assert_eq!(map.apply(&add(&light, 7)), Err(LightmapError::Version { version }));
    let stands = vec![Some(Affine3A::IDENTITY); 2];
    let soup = || Soup::new(&meshes, &stands);
    assert!(matches!(map.set_geometry(version, soup(), &stands[..1]), Err(LightmapError::Objects { .. })));
    assert!(matches!(
        map.set_geometry(GeometryVersion(0), soup(), &stands),
        Err(LightmapError::Again { .. })
    ));
    assert!(map.resume(&[1, 2, 3], []).is_err());
    let sums = sums(&map);
    assert_eq!(map.resume(&sums, [&contribution(&light, 7)]), Err(LightmapError::Version { version }));
}

/// Saved sums go on where they were: what is in them can be taken away again.
#[test]
fn saved_sums_are_taken_up_again() {
    let meshes = room();
    let light = point(Vec3::new(0.5, 2.5, 0.4), 50.0, 1);
    let mut map = lightmap(&meshes, &params(2.0));
    map.apply(&add(&light, 0)).unwrap();
    let saved = sums(&map);
    let mut again = lightmap(&meshes, &params(2.0));
    again.resume(&saved, [&contribution(&light, 0)]).unwrap();
    assert_eq!((again.published().values.clone(), again.live()), (map.published().values.clone(), 1));
    // What cannot be taken up changes nothing.
    assert!(again.resume(&saved, [&contribution(&light, 0), &contribution(&light, 7)]).is_err());
    assert_eq!((again.published().values.clone(), again.live()), (map.published().values.clone(), 1));
    again.apply(&subtract(&light, 0)).unwrap();
    assert!(again.sums().all(|sum| sum == 0));
}
