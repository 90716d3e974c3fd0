//! What a bake leaves behind: maps as EXR, the scene as .glb with the coordinates to look them up, and a JSON
//! file that says which is whose.

use std::path::Path;

use bake::lightmap::{Image, Layout};
use glam::{Vec2, Vec3};
use scene::{ExrDepth, Film, LightmappedMesh, LightmappedNode};
use serde_json::{Value, json};

use super::world::World;
use crate::failure::Failure;
use crate::output;

/// One map for all objects of a page, or one for each object.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Maps {
    Atlas,
    Objects,
}

/// What was written.
pub(crate) struct Written {
    /// File names within the folder.
    pub(crate) files: Vec<String>,
    /// Values that half floats could not hold.
    pub(crate) saturated: u64,
    /// Multiplier for a value × albedo that makes a picture of middle brightness.
    pub(crate) exposure: f32,
}

/// Suffixes of the four coefficients' files.
const COEFFICIENTS: [&str; 4] = ["sh0", "sh1y", "sh1z", "sh1x"];

pub(crate) fn write(
    folder: &Path,
    world: &World,
    layout: &Layout,
    pages: &[Image],
    maps: Maps,
    half: bool,
    stops: Option<f32>,
) -> Result<Written, Failure> {
    let stops = stops.unwrap_or_else(|| exposure(pages));
    let exposure = stops.exp2() * core::f32::consts::FRAC_1_PI;
    let mut written = Written { files: Vec::new(), saturated: 0, exposure };
    let mut objects = vec![Value::Null; layout.objects.len()];
    let placed = layout.objects.iter().enumerate().filter_map(|(object, place)| Some((object, (*place)?)));
    match maps {
        Maps::Atlas => {
            let names: Vec<_> = (0..pages.len())
                .map(|page| if pages.len() == 1 { "lightmap".to_owned() } else { format!("lightmap.{page}") })
                .collect();
            for (name, page) in names.iter().zip(pages) {
                write_map(folder, name, page, [0, 0], [page.width, page.height], half, &mut written)?;
            }
            let size = Vec2::new(layout.size[0] as f32, layout.size[1] as f32);
            for (object, place) in placed {
                let page = &pages[place.page as usize];
                objects[object] =
                    describe(&names[place.page as usize], page.channels, place.min / size, place.max / size);
            }
        }
        Maps::Objects => {
            for (object, place) in placed {
                let page = &pages[place.page as usize];
                let (low, high) = place.pixels();
                let high = [high[0].min(page.width), high[1].min(page.height)];
                let name = format!("object.{object}");
                write_map(folder, &name, page, low, high, half, &mut written)?;
                let low = Vec2::new(low[0] as f32, low[1] as f32);
                let size = Vec2::new(high[0] as f32, high[1] as f32) - low;
                objects[object] =
                    describe(&name, page.channels, (place.min - low) / size, (place.max - low) / size);
            }
        }
    }
    write_scene(folder, world, layout, &objects, &mut written)?;
    let lights: Vec<Value> = world
        .lamps
        .iter()
        .enumerate()
        .map(|(key, lamp)| {
            let at: Vec3 = lamp.light.transform.translation.into();
            json!({ "light": key, "kind": lamp.what, "present": lamp.present, "object": lamp.object,
                "position": at.to_array(), "flux": lamp.light.flux.to_array() })
        })
        .collect();
    let listed: Vec<Value> = objects
        .into_iter()
        .enumerate()
        .map(|(object, map)| {
            let mesh = &world.scene.meshes[world.scene.instances[object].mesh as usize];
            json!({ "object": object, "present": world.objects[object].is_some(),
                "material": world.scene.materials[mesh.material as usize].name, "lightmap": map })
        })
        .collect();
    let sidecar = json!({
        "scene": world.scene.name,
        "glb": "scene.glb",
        "texcoord": "TEXCOORD_1, within uv_rect ([u0, v0, u1, v1]; v grows downwards with the rows of the map)",
        "unit": "irradiance, W/m2: reflected radiance = albedo * value / pi",
        "exposure": exposure,
        "objects": listed,
        "lights": lights,
    });
    let text = serde_json::to_string_pretty(&sidecar).map_err(|error| Failure::failed(error.to_string()))?;
    output::text(&folder.join("lightmap.json"), &(text + "\n"))?;
    written.files.push("lightmap.json".to_owned());
    Ok(written)
}

fn describe(name: &str, channels: usize, min: Vec2, max: Vec2) -> Value {
    let rect = [min.x, min.y, max.x, max.y];
    if channels == 3 {
        return json!({ "map": format!("{name}.exr"), "uv_rect": rect });
    }
    let maps: Vec<String> = COEFFICIENTS.iter().map(|suffix| format!("{name}.{suffix}.exr")).collect();
    json!({ "maps": maps, "uv_rect": rect })
}

/// A rectangle of a page as one file, or as four.
fn write_map(
    folder: &Path,
    name: &str,
    page: &Image,
    low: [u32; 2],
    high: [u32; 2],
    half: bool,
    written: &mut Written,
) -> Result<(), Failure> {
    let size = (high[0] - low[0], high[1] - low[1]);
    let depth = if half { ExrDepth::Half } else { ExrDepth::Full };
    for (coefficient, suffix) in COEFFICIENTS.iter().enumerate().take(page.channels / 3) {
        let color = |x: u32, y: u32| {
            let texel = ((low[1] + y) * page.width + low[0] + x) as usize;
            Vec3::from_slice(&page.values[texel * page.channels + 3 * coefficient..][..3])
        };
        let file = match page.channels {
            3 => format!("{name}.exr"),
            _ => format!("{name}.{suffix}.exr"),
        };
        let saturated = scene::write_exr_from(&folder.join(&file), size, depth, color);
        written.saturated +=
            saturated.map_err(|error| Failure::failed(format!("{error}: choose another place with -o")))?;
        written.files.push(file);
    }
    Ok(())
}

/// The scene as it stands, every mesh with its lightmap coordinates.
fn write_scene(
    folder: &Path,
    world: &World,
    layout: &Layout,
    maps: &[Value],
    written: &mut Written,
) -> Result<(), Failure> {
    let mut scene = world.scene.clone();
    let mut meshes: Vec<LightmappedMesh<'_>> = layout
        .meshes
        .iter()
        .map(|mesh| LightmappedMesh {
            mesh: mesh.mesh,
            material: scene.meshes[mesh.mesh as usize].material,
            vertices: &mesh.vertices,
            uvs: &mesh.uvs,
            triangles: &mesh.triangles,
        })
        .collect();
    let mut nodes = Vec::new();
    for (object, place) in layout.objects.iter().enumerate() {
        let (Some(place), Some(to_world)) = (place, world.objects[object]) else { continue };
        let mut mesh = place.charted;
        if let Some(colour) = world.colours[object] {
            // A material of its own, plain: an edit gives the whole albedo.
            let own = meshes[mesh as usize];
            let mut material = scene.materials[own.material as usize].clone();
            material.base_color = colour;
            material.base_color_texture = None;
            scene.materials.push(material);
            meshes.push(LightmappedMesh { material: scene.materials.len() as u32 - 1, ..own });
            mesh = meshes.len() as u32 - 1;
        }
        let extras = json!({ "lightmap": maps[object] });
        nodes.push(LightmappedNode { mesh, name: format!("object {object}"), to_world, extras });
    }
    let path = folder.join("scene.glb");
    scene::write_glb(&scene, &meshes, &nodes, &path)
        .map_err(|error| Failure::failed(format!("{error}: choose another place with -o")))?;
    written.files.push("scene.glb".to_owned());
    Ok(())
}

/// Stops that make the median of what a grey surface reflects middle grey; of a large map, that of a sample
/// of its texels.
fn exposure(pages: &[Image]) -> f32 {
    const GREY: f32 = 0.5 * core::f32::consts::FRAC_1_PI;
    const SAMPLE: usize = 1 << 18;
    let step = (pages.iter().map(|page| page.values.len() / page.channels).sum::<usize>() / SAMPLE).max(1);
    let texels = pages.iter().flat_map(|page| page.values.chunks_exact(page.channels)).step_by(step);
    let pixels: Vec<Vec3> = texels.map(|texel| GREY * Vec3::from_slice(&texel[..3])).collect();
    scene::auto_exposure(&Film { width: pixels.len() as u32, height: 1, pixels })
}
