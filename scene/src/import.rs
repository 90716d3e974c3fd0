//! glTF 2.0 import: `.glb`, and `.gltf` with data URIs or files beside it.
//!
//! Read are triangles, node transforms, instances, metallic-roughness materials with the extensions that
//! [`Material`] knows, PNG and JPEG images, `KHR_lights_punctual`, perspective cameras. What is not read is
//! said in [`Scene::notes`]; an extension that the file *requires* and the importer does not know is an
//! error.
//!
//! The file is not trusted: whatever it holds, [`load`] returns a [`Scene`] that keeps its promises or an
//! error of one line. Every size is checked against the bytes that are there and against [`ImportLimits`]
//! before memory is taken.

mod accessor;
mod container;
mod error;
mod files;
mod materials;
mod meshes;
mod nodes;
mod scan;
mod textures;

use std::collections::BTreeMap;
use std::collections::HashMap;
use std::path::Path;

use glam::{Affine3A, DAffine3, Vec3};
use gltf::Document;

use self::accessor::Buffers;
use self::files::Files;
use self::textures::TextureTable;
use crate::{Instance, Material, MaterialMode, Mesh, Scene};

pub use self::error::{ImportError, ImportProblem};

/// How to import.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// How materials are read.
    pub materials: MaterialMode,
    /// Which of the file's scenes.
    pub scene: SceneChoice,
    /// How much a file may ask for.
    pub limits: ImportLimits,
}

/// Which of a file's scenes are imported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SceneChoice {
    /// The default one, the first where none is named.
    #[default]
    Default,
    /// All, as one.
    All,
}

/// How much a file may ask for; each is checked before the memory is taken. The defaults admit scenes of some
/// 20 million stored triangles and keep a hostile file of a few bytes below about 3 GB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImportLimits {
    /// Bytes of the file and all files that it names. Default 4 GiB.
    pub max_bytes: u64,
    /// Bytes of JSON text. Default 64 MiB.
    pub max_json_bytes: u64,
    /// Objects and arrays in the JSON text; the largest takes about a kilobyte. Default 2 Mi.
    pub max_json_structures: u64,
    /// Accessor elements read (positions, normals, texture coordinates, indices), all together. Default 128
    /// Mi.
    pub max_accessor_elements: u64,
    /// Texels of all textures together, four bytes each. Default 256 Mi.
    pub max_texture_pixels: u64,
    /// Primitives placed by nodes. Default 4 Mi.
    pub max_instances: u64,
    /// Triangles after instancing. Default 1 Gi.
    pub max_triangles: u64,
    /// Triangles after instancing whose material emits: each becomes a light of 64 bytes. Default 32 Mi.
    pub max_emissive_triangles: u64,
    /// Nodes from the root to the deepest one. Default 1024.
    pub max_node_depth: u32,
}

impl Default for ImportLimits {
    fn default() -> Self {
        Self {
            max_bytes: 4 << 30,
            max_json_bytes: 64 << 20,
            max_json_structures: 2 << 20,
            max_accessor_elements: 128 << 20,
            max_texture_pixels: 256 << 20,
            max_instances: 4 << 20,
            max_triangles: 1 << 30,
            max_emissive_triangles: 32 << 20,
            max_node_depth: 1024,
        }
    }
}

/// Imports a `.glb` or `.gltf` file.
///
/// # Errors
/// The file, or one that it names, cannot be read, is malformed, holds numbers that make no sense, or asks
/// for more than `options.limits` admits.
pub fn load(path: &Path, options: &ImportOptions) -> Result<Scene, ImportError> {
    import(path, options).map_err(|problem| problem.of(path))
}

fn import(path: &Path, options: &ImportOptions) -> Result<Scene, ImportProblem> {
    let limits = &options.limits;
    let mut notes = Notes::default();
    if let MaterialMode::Phong(exponent) = options.materials
        && !(exponent >= 0.0 && exponent.is_finite())
    {
        let why = format!("Phong exponent is {exponent}");
        return Err(ImportProblem::invalid(
            "material mode",
            why,
            "give a finite number that is not negative",
        ));
    }

    let (mut files, bytes) = Files::open(path, limits)?;
    let (document, bin) = container::parse(&bytes, limits)?;
    let mut buffers = Buffers::load(&document, bin, &mut files, limits)?;
    nodes::check_lights(&document)?;
    note_extensions(&document, &mut notes);

    let placed = nodes::place(&document, options.scene, limits, &mut notes)?;
    let mut import = Import { options, scene: Scene::default(), textures: TextureTable::default(), notes };
    import.place_meshes(&document, &placed.meshes, &mut buffers)?;
    let Import { mut scene, textures, mut notes, .. } = import;
    scene.textures = textures.decode(&document, &buffers, &mut files, limits)?;
    scene.lights = placed.lights;
    scene.distant = placed.distant;
    scene.cameras = placed.cameras;
    scene.name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();

    note_missing_uvs(&scene, &mut notes);
    add_emitters(&mut scene, limits, &mut notes)?;
    notes.finish(&mut scene.notes);
    Ok(scene)
}

/// The part of an import that geometry and materials share.
struct Import<'o> {
    options: &'o ImportOptions,
    scene: Scene,
    textures: TextureTable,
    notes: Notes,
}

impl Import<'_> {
    /// Converts the meshes that nodes use, once each, and puts an instance of every primitive where a node
    /// does.
    fn place_meshes(
        &mut self,
        document: &Document,
        placed: &[(usize, DAffine3, String)],
        buffers: &mut Buffers<'_>,
    ) -> Result<(), ImportProblem> {
        let sources: Vec<gltf::Mesh<'_>> = document.meshes().collect();
        let mut meshes: HashMap<usize, Vec<u32>> = HashMap::new();
        let mut materials: HashMap<Option<usize>, Option<u32>> = HashMap::new();
        let mut triangles = 0;
        for (index, to_world, node) in placed {
            let source = &sources[*index];
            if !meshes.contains_key(index) {
                let converted = self.convert_mesh(source, &mut materials, buffers)?;
                meshes.insert(*index, converted);
            }
            let primitives = &meshes[index];
            if primitives.is_empty() {
                continue;
            }
            let Some(to_world) = self.instance_transform(to_world, primitives, node)? else { continue };
            for &mesh in primitives {
                triangles += self.scene.meshes[mesh as usize].triangles.len() as u64;
                self.scene.instances.push(Instance { mesh, to_world });
            }
            let limits = &self.options.limits;
            check_limit(node, self.scene.instances.len() as u64, limits.max_instances, "max_instances")?;
            check_limit(node, triangles, limits.max_triangles, "max_triangles")?;
        }
        Ok(())
    }

    /// Indices into [`Scene::meshes`] of a glTF mesh's primitives.
    fn convert_mesh(
        &mut self,
        source: &gltf::Mesh<'_>,
        materials: &mut HashMap<Option<usize>, Option<u32>>,
        buffers: &mut Buffers<'_>,
    ) -> Result<Vec<u32>, ImportProblem> {
        let mut indices = Vec::new();
        for primitive in source.primitives() {
            let material = primitive.material();
            let material = match materials.get(&material.index()) {
                Some(&known) => known,
                None => {
                    let new = self.convert_material(&material)?;
                    materials.insert(material.index(), new);
                    new
                }
            };
            let Some(material) = material else {
                self.notes.count("see-through primitives are left out, as the material mode asks".to_owned());
                continue;
            };
            if let Some(mesh) = meshes::convert(source, &primitive, buffers, &mut self.notes)? {
                indices.push(self.scene.meshes.len() as u32);
                self.scene.meshes.push(Mesh { material, ..mesh });
            }
        }
        Ok(indices)
    }

    /// Index into [`Scene::materials`]; `None` where the mode leaves the material's surfaces out.
    fn convert_material(&mut self, source: &gltf::Material<'_>) -> Result<Option<u32>, ImportProblem> {
        let converted =
            materials::convert(source, self.options.materials, &mut self.textures, &mut self.notes)?;
        Ok(converted.map(|material| {
            self.scene.materials.push(material);
            self.scene.materials.len() as u32 - 1
        }))
    }

    /// The transform in single precision; `None`, with a note, where it is singular.
    fn instance_transform(
        &mut self,
        to_world: &DAffine3,
        primitives: &[u32],
        node: &str,
    ) -> Result<Option<Affine3A>, ImportProblem> {
        let matrix = to_world.matrix3.as_mat3();
        let single = Affine3A::from_mat3_translation(matrix, to_world.translation.as_vec3());
        // What is flattened to a plane or a line has no inverse, which normals and ray queries need.
        let invertible = matrix.determinant() != 0.0 && single.is_finite() && single.inverse().is_finite();
        if !invertible {
            self.notes.say(format!("{node}: left out, since its transform is singular"));
            return Ok(None);
        }
        let farthest = (primitives.iter().flat_map(|&mesh| &self.scene.meshes[mesh as usize].positions))
            .fold(Vec3::ZERO, |farthest, p| farthest.max(p.abs()));
        let reach = to_world.matrix3.x_axis.abs() * f64::from(farthest.x)
            + to_world.matrix3.y_axis.abs() * f64::from(farthest.y)
            + to_world.matrix3.z_axis.abs() * f64::from(farthest.z)
            + to_world.translation.abs();
        if reach.max_element() > MAX_COORDINATE {
            let why = format!("its vertices reach {:e}", reach.max_element());
            return Err(ImportProblem::invalid(node, why, "scale the scene down: coordinates go up to 1e18"));
        }
        Ok(Some(single))
    }
}

/// The largest world coordinate: squares of differences and their products stay inside single precision.
const MAX_COORDINATE: f64 = 1e18;

fn check_limit(at: &str, found: u64, limit: u64, parameter: &'static str) -> Result<(), ImportProblem> {
    if found <= limit {
        return Ok(());
    }
    Err(ImportProblem::Limit { at: at.to_owned(), found, limit, parameter })
}

/// Adds emissive triangles as lights and says how many.
fn add_emitters(scene: &mut Scene, limits: &ImportLimits, notes: &mut Notes) -> Result<(), ImportProblem> {
    let meshes = scene.instances.iter().map(|instance| &scene.meshes[instance.mesh as usize]);
    let emits = |mesh: &&Mesh| scene.materials[mesh.material as usize].emissive != Vec3::ZERO;
    let emissive: u64 = meshes.filter(emits).map(|mesh| mesh.triangles.len() as u64).sum();
    check_limit("emissive surfaces", emissive, limits.max_emissive_triangles, "max_emissive_triangles")?;
    let punctual = scene.lights.len();
    let summary = scene.add_emissive_triangles();
    if punctual > 0 || !scene.distant.is_empty() {
        notes.say(format!("{punctual} point and spot lights, {} directional", scene.distant.len()));
    }
    if summary.emissive_triangles > 0 {
        notes.say(format!(
            "{} of {} emissive triangles are lights ({} black under their texture, {} without area)",
            scene.lights.len() - punctual,
            summary.emissive_triangles,
            summary.black,
            summary.without_area
        ));
    }
    Ok(())
}

/// Extensions that are used but not read.
fn note_extensions(document: &Document, notes: &mut Notes) {
    const READ: [&str; 7] = [
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_texture_transform",
    ];
    for name in document.extensions_used().filter(|name| !READ.contains(name)) {
        notes.say(format!("extension {name} is ignored"));
    }
}

/// Meshes whose material looks up texture coordinates that they do not have.
fn note_missing_uvs(scene: &Scene, notes: &mut Notes) {
    let lacks = |mesh: &Mesh, material: &Material| {
        let slots =
            [material.base_color_texture, material.metallic_roughness_texture, material.emissive_texture];
        slots
            .into_iter()
            .flatten()
            .any(|slot| if slot.uv_set == 0 { mesh.uvs.is_empty() } else { mesh.uvs1.is_empty() })
    };
    for mesh in scene.meshes.iter().filter(|mesh| lacks(mesh, &scene.materials[mesh.material as usize])) {
        let name = &scene.materials[mesh.material as usize].name;
        notes.count(format!(
            "textured meshes of material \"{name}\" have no texture coordinates: one texel is taken"
        ));
    }
}

/// Gathers [`Scene::notes`]: what happens often is counted, and the list is of bounded length.
#[derive(Default)]
struct Notes {
    said: Vec<String>,
    unsaid: usize,
    counted: BTreeMap<String, usize>,
}

impl Notes {
    const LONGEST: usize = 100;

    /// Adds a sentence.
    fn say(&mut self, note: String) {
        if self.said.len() < Self::LONGEST {
            self.said.push(note);
        } else {
            self.unsaid += 1;
        }
    }

    /// Counts one more of `what`.
    fn count(&mut self, what: String) {
        if self.counted.len() < Self::LONGEST || self.counted.contains_key(&what) {
            *self.counted.entry(what).or_default() += 1;
        } else {
            self.unsaid += 1;
        }
    }

    fn finish(self, notes: &mut Vec<String>) {
        let counted = self.counted.into_iter().map(|(what, times)| format!("{what} ({times} times)"));
        notes.extend(self.said.into_iter().chain(counted).map(|note| error::one_line(&note)));
        if self.unsaid > 0 {
            notes.push(format!("and {} notes more", self.unsaid));
        }
    }
}
