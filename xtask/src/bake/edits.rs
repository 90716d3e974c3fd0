//! Lists of edits: what a designer does to a scene, as JSON.
//!
//! `{"edits": [{"op": "move_object", "object": 3, "by": [0.5, 0, 0]}, ...]}`; `docs/bake.md` lists the
//! operations.

use std::path::Path;

use bake::{Aperture, BakeError, Baker, Light, LightKey, Profile, photometry};
use glam::{Affine3A, Quat, Vec3};
use serde_json::{Map, Value};

use super::world::{Lamp, World};
use crate::failure::Failure;

/// One edit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Edit {
    /// An object moves, vanishes or comes back.
    Object { object: u32, to: Place },
    /// Another colour for an object, or for all objects of a material.
    Recolour { objects: Vec<u32>, colour: Vec3 },
    /// A lamp moves.
    MoveLight { light: u32, by: Vec3 },
    /// A lamp is brighter or dimmer by this factor, or has this flux.
    Dim { light: u32, by: Strength },
    /// A lamp shines as a photometric file says.
    Profile { light: u32, profile: Profile, axis: Vec3 },
    /// A lamp goes out, or on again.
    Switch { light: u32, on: bool },
    /// A new lamp.
    AddLight(Light),
    /// Bake before the next edit: so many updates, or all.
    Bake { updates: Option<u64> },
}

/// What becomes of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    /// By a vector, after a turn about the vertical through its middle, radians.
    Moved { by: Vec3, turn: f32 },
    /// It goes.
    Gone,
    /// It comes back to where it was.
    Back,
}

/// How bright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Strength {
    Times(f32),
    Flux(Vec3),
}

/// Edits of a file, checked against the scene as it is when each is reached. `hash` of each is that of its
/// text, for saved bakes.
pub(crate) struct Edits {
    pub(crate) list: Vec<Edit>,
    pub(crate) hashes: Vec<u64>,
}

/// Reads and checks a list.
///
/// # Errors
/// One line that names the file, the edit by its index, and the mend.
pub(crate) fn read(path: &Path, world: &World) -> Result<Edits, Failure> {
    let fail = |why: String| Failure::failed(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
    let value: Value = serde_json::from_str(&text).map_err(|error| fail(format!("no JSON: {error}")))?;
    let list = value.get("edits").and_then(Value::as_array);
    let list = list.ok_or_else(|| fail("write it as {\"edits\": [...]}".to_owned()))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut reader = Reader { world, folder, lights: world.lamps.len() as u32 };
    let mut edits = Edits { list: Vec::new(), hashes: Vec::new() };
    for (index, value) in list.iter().enumerate() {
        let edit = reader.edit(value).map_err(|why| fail(format!("edits[{index}]: {why}")))?;
        reader.lights += u32::from(matches!(edit, Edit::AddLight(_)));
        // The debug text holds the tables of photometric files, too.
        edits.hashes.push(super::state::fnv(format!("{edit:?}").as_bytes()));
        edits.list.push(edit);
    }
    Ok(edits)
}

/// Reads edits one after the other; lights that earlier ones add are there for later ones.
struct Reader<'a> {
    world: &'a World,
    folder: &'a Path,
    lights: u32,
}

impl Reader<'_> {
    fn edit(&mut self, value: &Value) -> Result<Edit, String> {
        let fields = value.as_object().ok_or("an edit is an object such as {\"op\": \"bake\"}")?;
        let op = fields.get("op").and_then(Value::as_str).ok_or("it has no \"op\"")?;
        let (edit, known): (_, &[&str]) = match op {
            "move_object" => {
                let by = optional(fields, "by", vector)?.unwrap_or(Vec3::ZERO);
                let turn = optional(fields, "turn", number)?.unwrap_or(0.0).to_radians();
                let to = Place::Moved { by, turn };
                (Edit::Object { object: self.object(fields)?, to }, &["object", "by", "turn"])
            }
            "remove_object" => (Edit::Object { object: self.object(fields)?, to: Place::Gone }, &["object"]),
            "restore_object" => (Edit::Object { object: self.object(fields)?, to: Place::Back }, &["object"]),
            "recolour" => {
                let colour = required(fields, "colour", vector)?;
                if !(colour.min_element() >= 0.0 && colour.max_element() <= 1.0) {
                    return Err(format!("\"colour\" {colour}: each channel lies in [0, 1]"));
                }
                let objects = if fields.contains_key("material") {
                    self.of_material(fields)?
                } else {
                    vec![self.object(fields)?]
                };
                (Edit::Recolour { objects, colour }, &["object", "material", "colour"])
            }
            "move_light" => {
                let by = required(fields, "by", vector)?;
                (Edit::MoveLight { light: self.light(fields)?, by }, &["light", "by"])
            }
            "set_light" => {
                let times = optional(fields, "times", number)?.map(Strength::Times);
                let flux = optional(fields, "flux", vector)?.map(Strength::Flux);
                let by = times.xor(flux).ok_or("give either \"times\" or \"flux\"")?;
                let sound = match by {
                    Strength::Times(times) => times >= 0.0,
                    Strength::Flux(flux) => flux.min_element() >= 0.0,
                };
                if !sound {
                    return Err("a light cannot be negative".to_owned());
                }
                (Edit::Dim { light: self.light(fields)?, by }, &["light", "times", "flux"])
            }
            "profile" => {
                let profile = self.profile(fields)?;
                let axis = self.axis(fields)?;
                (Edit::Profile { light: self.light(fields)?, profile, axis }, &["light", "file", "axis"])
            }
            "remove_light" => (Edit::Switch { light: self.light(fields)?, on: false }, &["light"]),
            "restore_light" => (Edit::Switch { light: self.light(fields)?, on: true }, &["light"]),
            "add_light" => {
                (Edit::AddLight(self.new_light(fields)?), &["position", "flux", "radius", "file", "axis"])
            }
            "bake" => {
                let whole = |value: &Value| value.as_u64().ok_or("is no whole number".to_owned());
                (Edit::Bake { updates: optional(fields, "updates", whole)? }, &["updates"])
            }
            other => {
                return Err(format!(
                    "there is no \"op\" {other:?}: there are move_object, remove_object, restore_object, recolour, \
                     move_light, set_light, profile, remove_light, restore_light, add_light and bake"
                ));
            }
        };
        match fields.keys().find(|key| *key != "op" && !known.contains(&key.as_str())) {
            Some(key) => Err(format!("{op} has no {key:?}: it has {}", known.join(", "))),
            None => Ok(edit),
        }
    }

    fn object(&self, fields: &Map<String, Value>) -> Result<u32, String> {
        let count = self.world.objects.len();
        required(fields, "object", |value| {
            let index = value.as_u64().filter(|&index| (index as usize) < count);
            let index = index.ok_or_else(|| format!("is none of the {count} objects, which count from 0"))?;
            Ok(index as u32)
        })
    }

    fn light(&self, fields: &Map<String, Value>) -> Result<u32, String> {
        let count = self.lights;
        required(fields, "light", |value| {
            let index = value.as_u64().filter(|&index| index < u64::from(count));
            let index = index.ok_or_else(|| format!("is none of the {count} lights, which count from 0"))?;
            Ok(index as u32)
        })
    }

    fn of_material(&self, fields: &Map<String, Value>) -> Result<Vec<u32>, String> {
        let scene = &self.world.scene;
        required(fields, "material", |value| {
            let name = value.as_str().ok_or("is no name")?;
            let is = |mesh: u32| scene.materials[scene.meshes[mesh as usize].material as usize].name == name;
            let objects: Vec<u32> =
                (0..scene.instances.len() as u32).filter(|&o| is(scene.instances[o as usize].mesh)).collect();
            if !objects.is_empty() {
                return Ok(objects);
            }
            let names = || scene.materials.iter().map(|material| material.name.as_str());
            let meant = scene::nearest(name, names());
            let meant = meant.map_or_else(String::new, |meant| format!("; did you mean {meant:?}?"));
            let names: Vec<_> = names().filter(|name| !name.is_empty()).take(20).collect();
            Err(format!("{name:?} is on no object{meant}: there are {}", names.join(", ")))
        })
    }

    fn axis(&self, fields: &Map<String, Value>) -> Result<Vec3, String> {
        let axis = optional(fields, "axis", vector)?.unwrap_or(Vec3::NEG_Y);
        axis.try_normalize().ok_or_else(|| "\"axis\" has no direction".to_owned())
    }

    fn profile(&self, fields: &Map<String, Value>) -> Result<Profile, String> {
        let name = required(fields, "file", |value| {
            value.as_str().map(str::to_owned).ok_or("is no name".to_owned())
        })?;
        let path = self.folder.join(&name);
        let bytes = std::fs::read(&path).map_err(|error| format!("{name}: {error}"))?;
        let extension = path.extension().map(|e| e.to_ascii_lowercase());
        let luminaire = match extension.as_ref().and_then(|e| e.to_str()) {
            Some("ies") => photometry::ies(&bytes),
            Some("ldt") => photometry::eulumdat(&bytes),
            _ => return Err(format!("{name}: photometric files end in .ies or .ldt")),
        };
        let luminaire = luminaire.map_err(|error| format!("{name}: {error}"))?;
        Ok(Profile::Table(luminaire.table.into()))
    }

    fn new_light(&self, fields: &Map<String, Value>) -> Result<Light, String> {
        let position = required(fields, "position", vector)?;
        let flux = required(fields, "flux", vector)?;
        if flux.min_element() < 0.0 {
            return Err("a light cannot be negative".to_owned());
        }
        let profile = if fields.contains_key("file") { self.profile(fields)? } else { Profile::Lambert };
        let aperture = match optional(fields, "radius", number)? {
            Some(radius) if radius > 0.0 => Aperture::Sphere { radius },
            Some(radius) => return Err(format!("\"radius\" {radius}: it is positive, or left out")),
            None => Aperture::Point,
        };
        let turn = Quat::from_rotation_arc(Vec3::NEG_Z, self.axis(fields)?);
        let transform = Affine3A::from_rotation_translation(turn, position);
        Ok(Light { aperture, profile, flux, transform, paths: 1 })
    }
}

fn required<T>(
    fields: &Map<String, Value>,
    key: &str,
    read: impl Fn(&Value) -> Result<T, String>,
) -> Result<T, String> {
    let value = fields.get(key).ok_or_else(|| format!("{key:?} is missing"))?;
    read(value).map_err(|why| format!("{key:?} {}", why.trim_start()))
}

fn optional<T>(
    fields: &Map<String, Value>,
    key: &str,
    read: impl Fn(&Value) -> Result<T, String>,
) -> Result<Option<T>, String> {
    fields.contains_key(key).then(|| required(fields, key, read)).transpose()
}

fn number(value: &Value) -> Result<f32, String> {
    let number = value.as_f64().map(|x| x as f32).filter(|x| x.is_finite());
    number.ok_or_else(|| "is no number".to_owned())
}

fn vector(value: &Value) -> Result<Vec3, String> {
    let values = value.as_array().filter(|values| values.len() == 3).ok_or("is no [x, y, z]")?;
    let [x, y, z] = [0, 1, 2].map(|i| number(&values[i]));
    Ok(Vec3::new(x?, y?, z?))
}

/// Whether the geometry has a new version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Shadows and receivers are as they were.
    SameGeometry,
    /// They are not: the bake counts a new version.
    NewGeometry,
}

impl Edit {
    /// Does the edit to the world, and tells the bake if there is one: without, this only brings a world to
    /// where a saved bake has it.
    ///
    /// # Errors
    /// What the bake refuses.
    pub(crate) fn apply(
        &self,
        world: &mut World,
        path_power: f64,
        mut baker: Option<&mut Baker>,
    ) -> Result<Outcome, BakeError> {
        match self {
            Self::Object { object, to } => {
                let index = *object as usize;
                let stood = world.stood[index];
                let to = match *to {
                    // Not by way of its middle: there and back is to be exactly where it was.
                    Place::Moved { by, turn: 0.0 } => Some(Affine3A::from_translation(by) * stood),
                    Place::Moved { by, turn } => {
                        let at = world.box_of(*object, stood);
                        let middle = 0.5 * at.min + 0.5 * at.max;
                        let turned = Affine3A::from_translation(middle + by)
                            * Affine3A::from_rotation_y(turn)
                            * Affine3A::from_translation(-middle);
                        Some(turned * stood)
                    }
                    Place::Gone => None,
                    Place::Back => Some(stood),
                };
                let (change, carried) = world.put(*object, to);
                if let Some(baker) = &mut baker {
                    baker.change_geometry(&[change])?;
                }
                for key in carried {
                    tell(world, key, &mut baker)?;
                }
                return Ok(Outcome::NewGeometry);
            }
            Self::Recolour { objects, colour } => {
                for &object in objects {
                    world.colours[object as usize] = Some(*colour);
                }
                if let Some(baker) = &mut baker {
                    baker.recolour(objects);
                }
            }
            Self::MoveLight { light, by } => {
                world.lamps[*light as usize].light.transform.translation += glam::Vec3A::from(*by);
                tell(world, LightKey(*light), &mut baker)?;
            }
            Self::Dim { light, by } => {
                let lamp = &mut world.lamps[*light as usize].light;
                match by {
                    Strength::Times(times) => lamp.flux *= *times,
                    Strength::Flux(flux) => lamp.flux = *flux,
                }
                tell(world, LightKey(*light), &mut baker)?;
            }
            Self::Profile { light, profile, axis } => {
                let lamp = &mut world.lamps[*light as usize].light;
                lamp.profile = profile.clone();
                let position = lamp.transform.translation.into();
                let turn = Quat::from_rotation_arc(Vec3::NEG_Z, *axis);
                lamp.transform = Affine3A::from_rotation_translation(turn, position);
                tell(world, LightKey(*light), &mut baker)?;
            }
            Self::Switch { light, on } => {
                world.lamps[*light as usize].present = *on;
                tell(world, LightKey(*light), &mut baker)?;
            }
            Self::AddLight(light) => {
                let mut light = light.clone();
                light.paths = light.paths_for(path_power);
                world.lamps.push(Lamp { light, present: true, object: None, what: "added" });
                tell(world, LightKey(world.lamps.len() as u32 - 1), &mut baker)?;
            }
            Self::Bake { .. } => {}
        }
        Ok(Outcome::SameGeometry)
    }
}

/// Brings the bake's light of that name to what the world has.
fn tell(world: &World, key: LightKey, baker: &mut Option<&mut Baker>) -> Result<(), BakeError> {
    let Some(baker) = baker else { return Ok(()) };
    let lamp = &world.lamps[key.0 as usize];
    match (baker.light(key).is_some(), lamp.present) {
        (true, true) => baker.set_light(key, lamp.light.clone()),
        (false, true) => baker.add_light(key, lamp.light.clone()),
        (true, false) => baker.remove_light(key),
        (false, false) => Ok(()),
    }
}
