//! Imports the shared scenes: counts as their README says.

mod sound;

use std::path::PathBuf;
use std::time::Instant;

use scene::{ImportOptions, Light, Scene, load};

/// The folder of shared scenes; `None`, said on stderr, where there is none.
fn shared(file: &str) -> Option<PathBuf> {
    let folder = match std::env::var_os("LIGHTTREE_SCENES") {
        Some(folder) => PathBuf::from(folder),
        None => PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
    };
    let path = folder.join(file);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: no {}; set LIGHTTREE_SCENES to the folder of shared scenes", path.display());
    None
}

fn load_shared(file: &str) -> Option<Scene> {
    let path = shared(file)?;
    let start = Instant::now();
    let scene = load(&path, &ImportOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    eprintln!(
        "{file}: {:.3} s, {} triangles, {} lights",
        start.elapsed().as_secs_f64(),
        scene.triangle_count(),
        scene.lights.len()
    );
    for note in &scene.notes {
        eprintln!("  {note}");
    }
    sound::assert_sound(&scene);
    Some(scene)
}

#[test]
fn shared_scenes_have_the_counts_that_their_readme_says() {
    // file, triangles, emissive triangles, of which black under their texture, punctual lights, directional, cameras
    let table = [
        ("cornell-box.glb", 38, 2, 0, 0, 0, 1),
        ("sponza.glb", 66_449, 4, 0, 0, 0, 3),
        ("sponza-lanterns.glb", 93_565, 27_120, 0, 0, 0, 3),
        ("living-room.glb", 400_379, 8, 0, 0, 0, 1),
        ("kitchen.glb", 1_050_722, 8, 0, 0, 0, 1),
        ("classroom.glb", 103_860, 30, 0, 0, 1, 1),
        ("dragon.glb", 206_570, 3_846, 0, 0, 0, 2),
        ("town-night.glb", 384_964, 3_296, 632, 72, 1, 3),
        ("labyrinth.glb", 157_858, 0, 0, 194, 0, 3),
        ("flight-helmet/FlightHelmet.gltf", 94_722, 0, 0, 0, 0, 0),
        ("mixed-lighting/MixedLightingExample.gltf", 40_898, 0, 0, 0, 1, 0),
    ];
    for (file, triangles, emissive, black, punctual, distant, cameras) in table {
        let Some(scene) = load_shared(file) else { continue };
        let area = scene.lights.iter().filter(|light| matches!(light, Light::Triangle { .. })).count();
        assert_eq!(scene.triangle_count(), triangles, "{file}");
        assert_eq!(area, emissive - black, "{file}");
        assert_eq!(scene.lights.len() - area, punctual, "{file}");
        assert_eq!(scene.distant.len(), distant, "{file}");
        assert_eq!(scene.cameras.len(), cameras, "{file}");
        let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
        eprintln!("  cameras {names:?}");
    }
}
