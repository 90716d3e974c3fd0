//! Built-in scenes: made by code, the same every time, no file needed.
//!
//! | name | what | lights |
//! |---|---|---|
//! | `hall` | a pillared room with arches, statues and clutter | point lights of log-normal intensity |
//! | `cornell` | the Cornell box, published data | one quad |
//! | `city` | street canyons at night | emissive quads: windows, shops, street lamps |
//! | `glossy` | GGX, Phong, mirror and glass on a table | coloured point lights |
//! | `wall` | a plain room that faces a wall of lights | virtual point lights |
//! | `cornell-lights` | the Cornell box with 12 bodies that fly around in it | their emissive triangles |
//! | `sun` | a courtyard under a moving sun | the virtual point lights that the sun makes, about |
//! | `glass-cube` | a glass cube with a ring inside, and its caustic | one small quad |
//! | `water` | waves over things under water, lit through them alone | one small quad |
//!
//! All but `cornell`, `glass-cube` and `water` take a count of lights after a colon, `hall:10000`; their
//! brightness does not depend on it (`city` grows instead). `cornell-lights` and `sun` move:
//! [`Scene::go_to_frame`].

mod caustics;
mod city;
mod cornell;
mod cornell_lights;
mod glossy;
mod hall;
mod motion;
mod palette;
mod shapes;
mod sun;
mod wall;

use std::fmt;

use glam::Affine3A;

pub use self::motion::Motion;
use self::shapes::Shapes;
use crate::{Instance, Material, Mesh, Scene, nearest};

/// Names and default counts of the built-in scenes, in the order in which they should be listed. A count of
/// `None` means that the scene takes none.
pub const BUILTIN_SCENES: [(&str, Option<usize>); 9] = [
    ("hall", Some(10_000)),
    ("cornell", None),
    ("city", Some(100_000)),
    ("glossy", Some(1_000)),
    ("wall", Some(1_000_000)),
    // As in Lin and Yuksel 2020, section 5.
    ("cornell-lights", Some(12_146)),
    ("sun", Some(100_000)),
    ("glass-cube", None),
    ("water", None),
];

/// The largest count that a built-in scene takes: 20 million.
pub const MAX_BUILTIN_LIGHTS: usize = 20_000_000;

/// Why a built-in scene cannot be made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BuiltinError {
    /// There is no scene of this name.
    UnknownName(String),
    /// The scene takes no count.
    NoCount {
        /// The scene's name.
        name: &'static str,
    },
    /// What follows the colon is not a whole number from 1 to [`MAX_BUILTIN_LIGHTS`].
    BadCount {
        /// The scene's name.
        name: &'static str,
        /// What followed the colon.
        count: String,
    },
}

impl fmt::Display for BuiltinError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownName(name) => {
                let names = BUILTIN_SCENES.map(|(name, count)| match count {
                    Some(count) => format!("{name}:{count}"),
                    None => name.to_owned(),
                });
                write!(f, "no built-in scene is called {name:?}")?;
                if let Some(meant) = nearest(name, BUILTIN_SCENES.map(|(name, _)| name)) {
                    write!(f, "; did you mean {meant}?")?;
                }
                write!(f, ": there are {}; a file's name ends in .glb or .gltf", names.join(", "))
            }
            Self::NoCount { name } => write!(f, "built-in scene {name} takes no count: write just {name}"),
            Self::BadCount { name, count } => write!(
                f,
                "built-in scene {name}: {count:?} is no count of lights: write a whole number from 1 to {MAX_BUILTIN_LIGHTS}"
            ),
        }
    }
}

impl std::error::Error for BuiltinError {}

/// Makes the built-in scene that `spec` names, e.g. `hall` or `hall:10000`; see the module's table.
///
/// # Errors
/// The name is unknown, or the count is not a number from 1 to [`MAX_BUILTIN_LIGHTS`], or the scene takes
/// none.
pub fn builtin(spec: &str) -> Result<Scene, BuiltinError> {
    let (name, count) = match spec.split_once(':') {
        Some((name, count)) => (name, Some(count)),
        None => (spec, None),
    };
    let &(name, default) = (BUILTIN_SCENES.iter())
        .find(|(known, _)| *known == name)
        .ok_or_else(|| BuiltinError::UnknownName(name.to_owned()))?;
    let count = match (count, default) {
        (None, default) => default.unwrap_or(0),
        (Some(_), None) => return Err(BuiltinError::NoCount { name }),
        (Some(text), Some(_)) => (text.parse().ok())
            .filter(|count| (1..=MAX_BUILTIN_LIGHTS).contains(count))
            .ok_or_else(|| BuiltinError::BadCount { name, count: text.to_owned() })?,
    };
    let mut scene = match name {
        "hall" => hall::hall(count),
        "cornell" => cornell::cornell(),
        "city" => city::city(count),
        "glossy" => glossy::glossy(count),
        "cornell-lights" => cornell_lights::cornell_lights(count),
        "sun" => sun::sun(count),
        "glass-cube" => caustics::glass_cube(),
        "water" => caustics::water(),
        _ => wall::wall(count),
    };
    let counts = format!("{} triangles, {} lights", scene.triangle_count(), scene.lights.len());
    scene.notes.insert(0, format!("built-in scene {}: {counts}", scene.name));
    Ok(scene)
}

impl Scene {
    /// Adds `shapes` of one material, standing where they were made; nothing if they are empty.
    fn add(&mut self, shapes: Shapes, material: Material) {
        self.add_mesh(shapes.into_mesh(0), material);
    }

    /// Adds a mesh of one material, whatever the mesh says, standing where it was made; nothing if it is
    /// empty.
    fn add_mesh(&mut self, mesh: Mesh, material: Material) {
        if mesh.triangles.is_empty() {
            return;
        }
        let mesh = Mesh { material: self.materials.len() as u32, ..mesh };
        self.materials.push(material);
        self.instances.push(Instance { mesh: self.meshes.len() as u32, to_world: Affine3A::IDENTITY });
        self.meshes.push(mesh);
    }
}
