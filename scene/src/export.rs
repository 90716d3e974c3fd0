//! A scene with lightmap coordinates as a `.glb`: what engines load beside the baked maps.

use core::fmt;
use std::fs::File;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use glam::{Affine3A, Mat4, Vec2, Vec3};
use serde_json::{Map, Value, json};

use crate::whole_file::whole_file;
use crate::{AlphaMode, Material, Scene, Texture, TextureSlot, Wrap};

/// A mesh whose vertices have lightmap coordinates; those on chart borders are there more than once.
#[derive(Clone, Copy, Debug)]
pub struct LightmappedMesh<'a> {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::materials`]: that of the scene's mesh, or another.
    pub material: u32,
    /// For each vertex, the scene's vertex that it is.
    pub vertices: &'a [u32],
    /// For each vertex, `TEXCOORD_1`.
    pub uvs: &'a [Vec2],
    /// Triangles by index into `vertices`.
    pub triangles: &'a [[u32; 3]],
}

/// An object: a mesh, where it stands, and what is to be said of it.
#[derive(Clone, Debug)]
pub struct LightmappedNode {
    /// Index into the meshes that are written.
    pub mesh: u32,
    /// Name of the node.
    pub name: String,
    /// Mesh to world.
    pub to_world: Affine3A,
    /// The node's `extras`.
    pub extras: Value,
}

/// Why a scene could not be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportError {
    /// The file.
    pub path: PathBuf,
    /// Why not.
    pub why: String,
}

impl fmt::Display for ExportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: cannot be written: {}", self.path.display(), self.why)
    }
}

impl std::error::Error for ExportError {}

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes meshes with both sets of texture coordinates, materials with their base colour and emission,
/// cameras, and a node for each object. The file is there whole or not at all. Lights are not written: they
/// are in the maps.
///
/// # Errors
/// [`ExportError`]: the file cannot be written, or would be larger than glTF's 4 GiB.
pub fn write_glb(
    scene: &Scene,
    meshes: &[LightmappedMesh<'_>],
    nodes: &[LightmappedNode],
    path: &Path,
) -> Result<(), ExportError> {
    let fail = |why: String| ExportError { path: path.to_owned(), why };
    let mut file = Writer::default();
    let images = scene.textures.iter().map(|texture| file.texture(texture)).collect::<Result<Vec<_>, _>>();
    let images = images.map_err(fail)?;
    let meshes: Vec<Value> = meshes.iter().map(|mesh| file.mesh(scene, mesh)).collect();
    let cameras: Vec<Value> = scene.cameras.iter().map(|camera| {
        json!({ "type": "perspective", "name": camera.name, "perspective": { "yfov": camera.vertical_fov, "znear": 0.01 } })
    }).collect();
    let mut all: Vec<Value> = nodes
        .iter()
        .map(|node| {
            let matrix = Mat4::from(node.to_world).to_cols_array();
            json!({ "name": node.name, "mesh": node.mesh, "matrix": matrix, "extras": node.extras })
        })
        .collect();
    all.extend(scene.cameras.iter().enumerate().map(|(index, camera)| {
        let axes = glam::Mat3::from_cols(camera.right, camera.up, -camera.forward);
        let matrix = Mat4::from_translation(camera.position) * Mat4::from_mat3(axes);
        json!({ "name": camera.name, "camera": index, "matrix": matrix.to_cols_array() })
    }));
    let roots: Vec<usize> = (0..all.len()).collect();

    let mut root = Map::new();
    root.insert("asset".into(), json!({ "version": "2.0", "generator": "lighttree" }));
    let used = ["KHR_materials_emissive_strength"];
    root.insert("extensionsUsed".into(), json!(used));
    root.insert("scene".into(), json!(0));
    root.insert("scenes".into(), json!([{ "nodes": roots }]));
    // glTF allows no empty arrays.
    let (samplers, textures): (Vec<Value>, Vec<Value>) = images
        .iter()
        .zip(&scene.textures)
        .enumerate()
        .map(|(index, (_, texture))| {
            let wrap = texture.wrap.map(|wrap| match wrap {
                Wrap::Repeat => 10497,
                Wrap::Mirror => 33648,
                Wrap::Clamp => 33071,
            });
            (json!({ "wrapS": wrap[0], "wrapT": wrap[1] }), json!({ "source": index, "sampler": index }))
        })
        .unzip();
    for (name, values) in [
        ("nodes", all),
        ("meshes", meshes),
        ("materials", scene.materials.iter().map(material).collect()),
        ("cameras", cameras),
        ("images", images),
        ("samplers", samplers),
        ("textures", textures),
        ("accessors", core::mem::take(&mut file.accessors)),
        ("bufferViews", core::mem::take(&mut file.views)),
    ] {
        if !values.is_empty() {
            root.insert(name.into(), Value::Array(values));
        }
    }
    file.align();
    if !file.bytes.is_empty() {
        root.insert("buffers".into(), json!([{ "byteLength": file.bytes.len() }]));
    }
    let text = Value::Object(root).to_string();
    write_container(path, &text, &file.bytes).map_err(fail)
}

/// The binary part, and what of the JSON describes it.
#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Writer {
    fn align(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.align();
        let mut view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes, Some(target));
        self.accessors
            .push(json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }));
        self.accessors.len() - 1
    }

    fn vec3(&mut self, values: &[Vec3]) -> usize {
        self.accessor(bytemuck::cast_slice(values), ARRAY_BUFFER, FLOAT, "VEC3", values.len())
    }

    fn vec2(&mut self, values: &[Vec2]) -> usize {
        self.accessor(bytemuck::cast_slice(values), ARRAY_BUFFER, FLOAT, "VEC2", values.len())
    }

    fn mesh(&mut self, scene: &Scene, own: &LightmappedMesh<'_>) -> Value {
        let mesh = &scene.meshes[own.mesh as usize];
        let picked =
            |values: &[Vec3]| -> Vec<Vec3> { own.vertices.iter().map(|&v| values[v as usize]).collect() };
        let positions = picked(&mesh.positions);
        let (min, max) = positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
        let position = self.vec3(&positions);
        self.accessors[position]["min"] = json!(min.to_array());
        self.accessors[position]["max"] = json!(max.to_array());
        let mut attributes = Map::new();
        attributes.insert("POSITION".into(), json!(position));
        if !mesh.normals.is_empty() {
            let normals = picked(&mesh.normals);
            attributes.insert("NORMAL".into(), json!(self.vec3(&normals)));
        }
        // TEXCOORD_1 may not be there without TEXCOORD_0.
        let uvs: Vec<Vec2> =
            own.vertices.iter().map(|&v| mesh.uvs.get(v as usize).copied().unwrap_or_default()).collect();
        attributes.insert("TEXCOORD_0".into(), json!(self.vec2(&uvs)));
        attributes.insert("TEXCOORD_1".into(), json!(self.vec2(own.uvs)));
        let indices = self.accessor(
            bytemuck::cast_slice(own.triangles),
            ELEMENT_ARRAY_BUFFER,
            UNSIGNED_INT,
            "SCALAR",
            3 * own.triangles.len(),
        );
        json!({ "primitives": [{ "attributes": attributes, "indices": indices, "material": own.material }] })
    }

    fn texture(&mut self, texture: &Texture) -> Result<Value, String> {
        let mut png = Cursor::new(Vec::new());
        let bytes = texture.texels.as_flattened();
        image::write_buffer_with_format(
            &mut png,
            bytes,
            texture.width,
            texture.height,
            image::ExtendedColorType::Rgba8,
            image::ImageFormat::Png,
        )
        .map_err(|error| error.to_string())?;
        let view = self.view(png.get_ref(), None);
        Ok(json!({ "bufferView": view, "mimeType": "image/png" }))
    }
}

fn material(material: &Material) -> Value {
    let texture = |slot: TextureSlot| json!({ "index": slot.texture, "texCoord": slot.uv_set });
    let mut surface = json!({
        "baseColorFactor": [material.base_color.x, material.base_color.y, material.base_color.z, material.alpha],
        "metallicFactor": material.metallic,
        "roughnessFactor": material.roughness,
    });
    // A lookup in the second set would read lightmap coordinates.
    if let Some(slot) = material.base_color_texture.filter(|slot| slot.uv_set == 0) {
        surface["baseColorTexture"] = texture(slot);
    }
    let mut value = json!({
        "name": material.name,
        "pbrMetallicRoughness": surface,
        "doubleSided": material.double_sided,
    });
    match material.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            value["alphaMode"] = json!("MASK");
            value["alphaCutoff"] = json!(cutoff);
        }
        AlphaMode::Blend => value["alphaMode"] = json!("BLEND"),
    }
    let strength = material.emissive.max_element();
    if strength > 0.0 {
        let scale = strength.max(1.0);
        value["emissiveFactor"] = json!((material.emissive / scale).to_array());
        value["extensions"] = json!({ "KHR_materials_emissive_strength": { "emissiveStrength": scale } });
        if let Some(slot) = material.emissive_texture.filter(|slot| slot.uv_set == 0) {
            value["emissiveTexture"] = texture(slot);
        }
    }
    value
}

fn write_container(path: &Path, json: &str, binary: &[u8]) -> Result<(), String> {
    let text = json.len().next_multiple_of(4);
    let total = 12 + 8 + text + if binary.is_empty() { 0 } else { 8 + binary.len() };
    let total = u32::try_from(total).map_err(|_| format!("{total} bytes: a .glb holds at most 4 GiB"))?;
    let write = |temporary: &Path| -> std::io::Result<()> {
        let mut file = std::io::BufWriter::new(File::create(temporary)?);
        file.write_all(b"glTF")?;
        file.write_all(&2u32.to_le_bytes())?;
        file.write_all(&total.to_le_bytes())?;
        file.write_all(&(text as u32).to_le_bytes())?;
        file.write_all(b"JSON")?;
        file.write_all(json.as_bytes())?;
        file.write_all(&b"   "[..text - json.len()])?;
        if !binary.is_empty() {
            file.write_all(&(binary.len() as u32).to_le_bytes())?;
            file.write_all(b"BIN\0")?;
            file.write_all(binary)?;
        }
        file.flush()
    };
    whole_file(path, |temporary| write(temporary).map_err(|error| error.to_string()))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{ImportOptions, builtin, load};

    /// What is written is read back by the importer: same triangles, places, colours and lightmap
    /// coordinates.
    #[test]
    fn a_scene_comes_back() {
        let scene = builtin("cornell").unwrap();
        let vertices: Vec<Vec<u32>> =
            scene.meshes.iter().map(|mesh| (0..mesh.positions.len() as u32).collect()).collect();
        let uvs: Vec<Vec<Vec2>> = scene
            .meshes
            .iter()
            .map(|mesh| (0..mesh.positions.len()).map(|i| Vec2::new(0.001 * i as f32, 0.5)).collect())
            .collect();
        let meshes: Vec<_> = (0..scene.meshes.len())
            .map(|i| LightmappedMesh {
                mesh: i as u32,
                material: scene.meshes[i].material,
                vertices: &vertices[i],
                uvs: &uvs[i],
                triangles: &scene.meshes[i].triangles,
            })
            .collect();
        let node = |instance: &crate::Instance| LightmappedNode {
            mesh: instance.mesh,
            name: format!("object {}", instance.mesh),
            to_world: instance.to_world,
            extras: json!({ "lightmap": { "map": "lightmap.exr" } }),
        };
        let nodes: Vec<_> = scene.instances.iter().map(node).collect();
        let folder = std::env::temp_dir().join(format!("lighttree-export-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("scene.glb");
        write_glb(&scene, &meshes, &nodes, &path).unwrap();
        let read = load(&path, &ImportOptions::default()).unwrap();
        assert_eq!(
            (read.triangle_count(), read.instances.len()),
            (scene.triangle_count(), scene.instances.len())
        );
        assert_eq!(read.lights.len(), scene.lights.len(), "emitters still shine");
        assert_eq!(read.cameras[0].name, scene.cameras[0].name);
        assert!(read.cameras[0].position.distance(scene.cameras[0].position) < 1e-6);
        for (instance, before) in read.instances.iter().zip(&scene.instances) {
            let (mesh, before) = (&read.meshes[instance.mesh as usize], &scene.meshes[before.mesh as usize]);
            assert_eq!(mesh.positions, before.positions);
            assert!((mesh.uvs1[2].x - 0.002).abs() < 1e-7);
            let colour =
                |scene: &Scene, mesh: &crate::Mesh| scene.materials[mesh.material as usize].base_color;
            assert!((colour(&read, mesh) - colour(&scene, before)).length() < 1e-6);
        }
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        assert!(write_glb(&scene, &meshes, &nodes, &folder.join("none/scene.glb")).is_err());
        fs::remove_dir_all(folder).unwrap();
    }
}
