//! The built-in scenes: counts, determinism, sound data, errors.

mod sound;

use lighttree::Emitter;
use scene::{BUILTIN_SCENES, BuiltinError, Light, MAX_BUILTIN_LIGHTS, Motion, Scene, builtin};

use sound::{assert_sound, bits};

#[test]
fn every_scene_is_sound_and_says_its_counts() {
    for (name, default) in BUILTIN_SCENES {
        let counts = if default.is_some() { vec![":1", ":2", ":7", ":1000"] } else { vec![""] };
        for count in counts {
            let spec = format!("{name}{count}");
            let scene = builtin(&spec).unwrap();
            assert_sound(&scene);
            assert_eq!(scene.name, spec, "the name carries the count");
            assert!(!scene.cameras.is_empty(), "{spec} has a camera");
            let said = format!("{} triangles, {} lights", scene.triangle_count(), scene.lights.len());
            assert!(scene.notes[0].contains(&said), "{spec}: {:?}", scene.notes);
        }
    }
}

#[test]
fn counts_of_lights_are_what_was_asked_for() {
    assert_eq!(builtin("hall").unwrap().lights.len(), 10_000);
    assert_eq!(builtin("hall:17").unwrap().lights.len(), 17);
    assert_eq!(builtin("glossy").unwrap().lights.len(), 1_000);
    assert_eq!(builtin("wall:4321").unwrap().lights.len(), 4_321);
    assert_eq!(builtin("cornell").unwrap().lights.len(), 2);
    for count in [1, 5, 12, 1_000, 12_146] {
        assert_eq!(builtin(&format!("cornell-lights:{count}")).unwrap().lights.len(), count);
    }
    let sun = builtin("sun:20000").unwrap().lights.len() as f64;
    assert!((sun / 20_000.0 - 1.0).abs() < 0.1, "about as many as asked for: {sun}");
    for count in [1, 2, 3, 1_000, 12_345] {
        let city = builtin(&format!("city:{count}")).unwrap();
        assert_eq!(city.lights.len(), 2 * count, "quads are pairs of triangles");
    }
}

#[test]
fn the_hall_is_a_small_scene_whatever_its_lights() {
    let triangles = builtin("hall:1").unwrap().triangle_count();
    assert!((2_500..3_500).contains(&triangles), "{triangles} triangles");
    assert_eq!(triangles, builtin("hall:5000").unwrap().triangle_count());
}

#[test]
fn the_same_name_gives_the_same_scene() {
    for spec in ["hall:100", "cornell", "city:100", "glossy:100", "wall:100", "cornell-lights:100", "sun:100"]
    {
        assert_eq!(bits(&builtin(spec).unwrap()), bits(&builtin(spec).unwrap()), "{spec}");
    }
}

/// A city grows with its lights; the others share one total out, so their pictures stay as bright.
#[test]
fn brightness_does_not_depend_on_the_count() {
    let total = |scene: &Scene| -> f64 { scene.lights.iter().map(|l| f64::from(l.bounds().intensity)).sum() };
    for name in ["hall", "glossy", "wall", "cornell-lights"] {
        let few = total(&builtin(&format!("{name}:10")).unwrap());
        let many = total(&builtin(&format!("{name}:20000")).unwrap());
        assert!((few / many - 1.0).abs() < 1e-4, "{name}: {few} and {many}");
    }
}

/// The published table: size of the room, the lamp's area and its direction.
#[test]
fn the_cornell_box_is_the_published_one() {
    let scene = builtin("cornell").unwrap();
    assert_eq!(scene.triangle_count(), 38);
    let (min, max) = scene.bounds().unwrap();
    assert_eq!((min.to_array(), max.to_array()), ([0.0; 3], [0.556, 0.5488, 0.5592]));
    let mut area = 0.0;
    for light in &scene.lights {
        let Light::Triangle { vertices: [a, b, c], radiance, two_sided, .. } = *light else {
            panic!("{light:?}")
        };
        let normal = (b - a).cross(c - a);
        assert!(normal.y < 0.0 && normal.x == 0.0 && normal.z == 0.0, "the lamp shines down");
        assert_eq!((radiance.to_array(), two_sided), ([17.0, 12.0, 4.0], false));
        area += 0.5 * normal.length();
    }
    assert!((area - 0.13 * 0.105).abs() < 1e-7);
    assert!((scene.cameras[0].vertical_fov - 39.31_f32.to_radians()).abs() < 1e-3);
    assert_eq!(scene.cameras[0].right.x, -1.0, "the table's x grows to the left");
}

#[test]
fn a_bad_name_or_count_is_an_error_of_one_line() {
    let message = |spec: &str| {
        let message = builtin(spec).unwrap_err().to_string();
        assert!(!message.contains('\n'));
        message
    };
    for spec in ["", "hal", "Hall", "hall ", "sponza"] {
        assert_eq!(builtin(spec).unwrap_err(), BuiltinError::UnknownName(spec.to_owned()));
        assert!(message(spec).contains("hall:10000, cornell, city:100000, glossy:1000, wall:1000000"));
    }
    let too_many = format!("{}", MAX_BUILTIN_LIGHTS + 1);
    for count in ["0", "-1", "", "ten", "1e4", "99999999999999999999", &too_many] {
        let spec = format!("wall:{count}");
        assert_eq!(
            builtin(&spec).unwrap_err(),
            BuiltinError::BadCount { name: "wall", count: count.to_owned() }
        );
        assert!(message(&spec).contains("from 1 to 20000000"));
    }
    assert_eq!(builtin("cornell:2").unwrap_err(), BuiltinError::NoCount { name: "cornell" });
}

/// A frame is a function of its number, whatever came before; the first one is the scene as it was made.
#[test]
fn frames_can_be_made_in_any_order() {
    for spec in ["cornell-lights:300", "sun:300"] {
        let first = builtin(spec).unwrap();
        let mut scene = first.clone();
        scene.go_to_frame(7).unwrap();
        let seventh = bits(&scene);
        assert_sound(&scene);
        assert_ne!(seventh, bits(&first), "{spec}: nothing moves");
        scene.go_to_frame(1_000_000_000).unwrap();
        assert_sound(&scene);
        scene.go_to_frame(7).unwrap();
        assert_eq!(bits(&scene), seventh, "{spec}");
        scene.go_to_frame(0).unwrap();
        assert_eq!(bits(&scene), bits(&first), "{spec}");
    }
    let mut still = builtin("hall:10").unwrap();
    assert!(still.motion.is_still());
    let before = bits(&still);
    still.go_to_frame(3).unwrap();
    assert_eq!(bits(&still), before);
}

/// Bodies stay in the box, clear of its blocks and of one another, all the way round.
#[test]
fn bodies_meet_nothing_on_their_way() {
    let mut scene = builtin("cornell-lights").unwrap();
    let Motion::Bodies { count } = scene.motion else { panic!("{:?}", scene.motion) };
    let first = scene.instances.len() - count;
    let white = &scene.meshes[0];
    // The two blocks, as the box of their corners each: the last ten quads of the first mesh.
    let corners = |quads: std::ops::Range<usize>| &white.positions[4 * quads.start..4 * quads.end];
    let blocks = [corners(3..8), corners(8..13)].map(|corners| {
        let none = (glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY);
        corners.iter().fold(none, |(min, max), &p| (min.min(p), max.max(p)))
    });
    let (low, high) = (glam::Vec3::ZERO, glam::Vec3::new(0.549, 0.5488, 0.5592));
    for frame in 0..240 {
        scene.go_to_frame(frame).unwrap();
        let balls: Vec<(glam::Vec3, f32)> = (scene.instances[first..].iter())
            .map(|body| (body.to_world.translation.into(), 1.06 * body.to_world.matrix3.x_axis.length()))
            .collect();
        for (i, &(at, radius)) in balls.iter().enumerate() {
            assert!(
                (at - radius).cmpgt(low).all() && (at + radius).cmplt(high).all(),
                "{i} leaves in {frame}"
            );
            for (min, max) in blocks {
                assert!(at.distance(at.clamp(min, max)) > radius, "{i} meets a block in {frame}");
            }
            for (j, &(other, size)) in balls[..i].iter().enumerate() {
                assert!(at.distance(other) > radius + size, "{i} meets {j} in {frame}");
            }
        }
    }
}
