//! `cargo xtask inspect`: what a scene holds, and what a light tree over it looks like.

use std::time::Instant;

use lighttree::{Hierarchy, LightHierarchy, NodeId};
use scene::{Light, MaterialMode, Requirements, Scene, SceneRays};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::trees::{BUILDERS, KeptMeshes, Tree};
use crate::{memory, output, source};

/// What to look at.
#[derive(clap::Args)]
pub(crate) struct InspectArgs {
    /// A .glb or .gltf file, or a built-in scene with an optional number of lights: hall:10000, cornell,
    /// city:100000, glossy:1000, wall:1000000
    scene: String,

    /// Print one JSON object as the last line of standard output
    #[arg(long)]
    json: bool,
}

/// Most lights for which the slow builders are tried as well.
const FEW: usize = 300_000;

/// Loads the scene and says what it is.
pub(crate) fn inspect(args: &InspectArgs) -> Result<(), Failure> {
    let (scene, load) = source::load(&args.scene, MaterialMode::Gltf)?;
    let start = Instant::now();
    let rays =
        SceneRays::build(&scene).map_err(|error| Failure::failed(format!("{}: {error}", scene.name)))?;
    let build_rays = start.elapsed().as_secs_f64();
    let trees = BUILDERS
        .iter()
        .filter(|&&builder| builder != "agglomerative" || scene.lights.len() <= FEW)
        .map(|&builder| tree(&scene, builder))
        .collect::<Result<Vec<_>, _>>()?;
    let summary = summary(&scene, &rays, load, build_rays, &trees);
    if args.json {
        eprint!("{}", for_people(&summary));
        output::print(&format!("{summary}\n"))
    } else {
        output::print(&for_people(&summary))
    }
}

/// Everything, for scripts.
fn summary(scene: &Scene, rays: &SceneRays, load: f64, build_rays: f64, trees: &[Value]) -> Value {
    let kind = |is: fn(&Light) -> bool| scene.lights.iter().filter(|light| is(light)).count();
    let bounds = scene.bounds().map(|(min, max)| json!({ "min": min.to_array(), "max": max.to_array() }));
    let texels: usize = scene.textures.iter().map(|texture| texture.texels.len()).sum();
    let requirements = Requirements::new(scene, &scene.lights);
    json!({
        "scene": scene.name,
        "triangles": scene.triangle_count(),
        "meshes": scene.meshes.len(),
        "instances": scene.instances.len(),
        "materials": scene.materials.len(),
        "textures": { "count": scene.textures.len(), "texels": texels },
        "cameras": scene.cameras.iter().map(|camera| camera.name.clone()).collect::<Vec<_>>(),
        "bounds": bounds,
        "lights": {
            "total": scene.lights.len() + scene.distant.len(),
            "point": kind(|light| matches!(light, Light::Point { .. })),
            "spot": kind(|light| matches!(light, Light::Spot { .. })),
            "triangle": kind(|light| matches!(light, Light::Triangle { .. })),
            "virtual": kind(|light| matches!(light, Light::Vpl { .. })),
            "distant": scene.distant.len(),
        },
        "requires": {
            "cones": requirements.needs_cones(),
            "points_on_lights": requirements.has_area_lights(),
            "glossy_materials": requirements.glossy_materials,
            "specular_materials": requirements.specular_materials,
            "masked_materials": requirements.masked_materials,
            "blended_materials": requirements.blended_materials,
            "shared_meshes": requirements.shared_meshes,
            "textured_lights": requirements.textured_lights,
            "diffuse_only": requirements.is_diffuse(),
        },
        "notes": scene.notes,
        "seconds": { "load": load, "build_rays": build_rays },
        "bytes": { "rays": rays.bytes(), "lights": size_of_val(&scene.lights[..]), "peak_rss": memory::peak_resident() },
        "trees": trees,
    })
}

/// One light tree, and how it turned out.
fn tree(scene: &Scene, builder: &str) -> Result<Value, Failure> {
    let start = Instant::now();
    let tree = Tree::build(builder, &scene.lights, scene, &mut KeptMeshes::default())
        .map_err(|error| Failure::failed(format!("{}: no light tree: {error}", scene.name)))?;
    let seconds = start.elapsed().as_secs_f64();
    let shape = Shape::of(&tree);
    Ok(json!({
        "builder": builder,
        "seconds": seconds,
        "nodes": shape.nodes,
        "leaves": shape.leaves,
        "depth": shape.depth,
        "mean_leaf_depth": shape.leaf_depths as f64 / shape.leaves.max(1) as f64,
        "mean_cos_theta_o": shape.cosines / (shape.nodes - shape.leaves).max(1) as f64,
        "dark_lights_left_out": tree.dropped(),
        "bytes": tree.bytes(),
    }))
}

/// Counts over all nodes of a tree.
#[derive(Default)]
struct Shape {
    nodes: usize,
    leaves: usize,
    depth: usize,
    leaf_depths: usize,
    /// Sum over inner nodes of the cosine of their cone of normals: 1 where a cluster's lights all face one
    /// way.
    cosines: f64,
}

impl Shape {
    fn of(tree: &Tree) -> Self {
        let mut shape = Self::default();
        let mut stack: Vec<(NodeId, usize)> = tree.root().into_iter().map(|root| (root, 0)).collect();
        while let Some((node, depth)) = stack.pop() {
            shape.nodes += 1;
            shape.depth = shape.depth.max(depth);
            let children = tree.children(node);
            if children.is_empty() {
                shape.leaves += 1;
                shape.leaf_depths += depth;
            } else {
                shape.cosines += f64::from(tree.bounds(node).cos_theta_o);
            }
            stack.extend(children.map(|child| (NodeId(child), depth + 1)));
        }
        shape
    }
}

/// The same in lines.
fn for_people(summary: &Value) -> String {
    let lights = &summary["lights"];
    let mebibytes = |bytes: &Value| bytes.as_f64().unwrap_or_default() / f64::from(1 << 20);
    let mut text = format!(
        "{}\n  geometry   {} triangles, {} meshes, {} instances, {} materials, {} textures ({} texels)\n",
        summary["scene"].as_str().unwrap_or_default(),
        summary["triangles"],
        summary["meshes"],
        summary["instances"],
        summary["materials"],
        summary["textures"]["count"],
        summary["textures"]["texels"],
    );
    if summary["bounds"].is_object() {
        text += &format!("  bounds     {} to {}\n", summary["bounds"]["min"], summary["bounds"]["max"]);
    }
    text += &format!(
        "  lights     {}: {} point, {} spot, {} emissive triangles, {} virtual, {} distant\n",
        lights["total"],
        lights["point"],
        lights["spot"],
        lights["triangle"],
        lights["virtual"],
        lights["distant"]
    );
    let cameras: Vec<_> =
        summary["cameras"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    text += &format!(
        "  cameras    {}\n",
        if cameras.is_empty() { "none".to_owned() } else { cameras.join(", ") }
    );
    let requires = &summary["requires"];
    text += &format!(
        "  requires   cones: {}, points on lights: {} ({} textured); materials: {} glossy, {} specular, {} with holes, {} blended; shared meshes: {}\n",
        requires["cones"],
        requires["points_on_lights"],
        requires["textured_lights"],
        requires["glossy_materials"],
        requires["specular_materials"],
        requires["masked_materials"],
        requires["blended_materials"],
        requires["shared_meshes"],
    );
    text += &format!(
        "  memory     rays {:.1} MiB, lights {:.1} MiB\n",
        mebibytes(&summary["bytes"]["rays"]),
        mebibytes(&summary["bytes"]["lights"])
    );
    text += "  trees      builder           seconds      nodes  depth  mean leaf depth  mean cos of cones      MiB\n";
    for tree in summary["trees"].as_array().into_iter().flatten() {
        text += &format!(
            "             {:<14} {:>10.4} {:>10} {:>6} {:>16.1} {:>18.3} {:>8.1}\n",
            tree["builder"].as_str().unwrap_or_default(),
            tree["seconds"].as_f64().unwrap_or_default(),
            tree["nodes"],
            tree["depth"],
            tree["mean_leaf_depth"].as_f64().unwrap_or_default(),
            tree["mean_cos_theta_o"].as_f64().unwrap_or_default(),
            mebibytes(&tree["bytes"]),
        );
    }
    text
}
