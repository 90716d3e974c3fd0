//! From what a person writes for SCENE to a scene that can be rendered.

use std::time::Instant;

use scene::{Camera, ImportLimits, ImportOptions, ImportProblem, MaterialMode, Scene, SceneError};

use crate::failure::Failure;
use crate::settings::Settings;

/// What is rendered when nothing is said.
pub(crate) const DEFAULT_SCENE: &str = "hall:10000";

/// Reads a `.glb` or `.gltf` file, or makes a built-in scene. Says on standard error what it is and what was
/// decided.
///
/// # Errors
/// A usage error for a built-in name or count that there is not, a failure for a file that cannot be read.
pub(crate) fn load(what: &str, materials: MaterialMode) -> Result<(Scene, f64), Failure> {
    let start = Instant::now();
    // A file that a person named may be larger than one from anywhere: a million nodes are 100 MB of JSON.
    let limits =
        ImportLimits { max_json_bytes: 512 << 20, max_json_structures: 16 << 20, ..ImportLimits::default() };
    let options = ImportOptions { materials, limits, ..ImportOptions::default() };
    let scene = scene::open(what, &options).map_err(|error| match &error {
        SceneError::Builtin(_) => Failure::usage(error.to_string()),
        SceneError::Import(import) => Failure::failed(match &import.problem {
            ImportProblem::Limit { at, found, limit, .. } => format!(
                "{}: {at}: needs {found} where {limit} is the limit: merge its meshes or split the file",
                import.file.display()
            ),
            _ => error.to_string(),
        }),
    })?;
    let seconds = start.elapsed().as_secs_f64();
    eprintln!(
        "{}: {} triangles, {} lights, {} distant lights, loaded in {seconds:.2} s",
        scene.name,
        scene.triangle_count(),
        scene.lights.len(),
        scene.distant.len()
    );
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    Ok((scene, seconds))
}

/// What `--set materials=` means.
///
/// # Errors
/// A usage error for anything else.
pub(crate) fn material_mode(settings: &Settings) -> Result<MaterialMode, Failure> {
    let text = settings.text("materials");
    let exponent =
        text.strip_prefix("phong:").and_then(|n| n.parse().ok()).filter(|n| (0.0..=1e6).contains(n));
    match (text, exponent) {
        ("gltf", _) => Ok(MaterialMode::Gltf),
        ("diffuse", _) => Ok(MaterialMode::Diffuse),
        (_, Some(exponent)) => Ok(MaterialMode::Phong(exponent)),
        _ => Err(Failure::usage(format!(
            "--set materials={text}: it is gltf, diffuse or phong:EXPONENT with an exponent from 0 to 1000000"
        ))),
    }
}

/// The camera that `--set camera=` names: the scene's first one, or one that frames the scene where it has
/// none.
///
/// # Errors
/// A usage error that lists the scene's cameras.
pub(crate) fn camera(scene: &Scene, settings: &Settings) -> Result<Camera, Failure> {
    let name = settings.text("camera");
    if let Some(camera) = scene.cameras.iter().find(|camera| camera.name == name) {
        return Ok(camera.clone());
    }
    if name != "first" {
        let names: Vec<_> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(Failure::usage(format!(
            "--set camera={name}: {} has no such camera; there are: {names}",
            scene.name
        )));
    }
    Ok(scene.cameras.first().cloned().unwrap_or_else(|| {
        eprintln!("note: {} has no camera; this one frames the scene's bounds", scene.name);
        scene.framing_camera()
    }))
}
