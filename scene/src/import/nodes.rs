//! The node hierarchy: where meshes, lights and cameras stand.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use gltf::khr_lights_punctual::{Kind, Light as GltfLight};
use gltf::scene::Transform;
use gltf::{Document, Node, camera};

use super::error::{one_line, thing};
use super::{ImportLimits, ImportProblem, Notes, SceneChoice};
use crate::{Camera, DistantLight, Light};

const REPAIR: &str = "export the file again";

/// What stands where, in the order of a depth-first walk.
#[derive(Default)]
pub(super) struct Placed {
    /// Index of a glTF mesh, where it stands, and its node's name for messages.
    pub(super) meshes: Vec<(usize, DAffine3, String)>,
    pub(super) lights: Vec<Light>,
    pub(super) distant: Vec<DistantLight>,
    pub(super) cameras: Vec<Camera>,
}

/// Walks the chosen scenes. Each node belongs to one parent, as the specification demands: so a cycle shows
/// as a node reached twice, and the walk ends.
pub(super) fn place(
    document: &Document,
    choice: SceneChoice,
    limits: &ImportLimits,
    notes: &mut Notes,
) -> Result<Placed, ImportProblem> {
    let nodes: Vec<Node<'_>> = document.nodes().collect();
    let mut reached = vec![false; nodes.len()];
    let mut placed = Placed::default();
    // (node, transform of its parent, depth), the next one on top.
    let mut stack: Vec<(usize, DAffine3, u32)> = Vec::new();
    for scene in chosen_scenes(document, choice, notes) {
        let roots: Vec<usize> = scene.nodes().map(|node| node.index()).collect();
        // A node may be the root of several scenes, but is placed once.
        stack.extend(roots.iter().rev().filter(|&&root| !reached[root]).map(|&r| (r, DAffine3::IDENTITY, 1)));
        while let Some((index, parent, depth)) = stack.pop() {
            let node = &nodes[index];
            let at = thing("node", index, node.name());
            if std::mem::replace(&mut reached[index], true) {
                let why = "is reached twice, by a cycle or from two parents";
                return Err(ImportProblem::invalid(at, why, "give each node one parent"));
            }
            if depth > limits.max_node_depth {
                return Err(ImportProblem::Limit {
                    at,
                    found: u64::from(depth),
                    limit: u64::from(limits.max_node_depth),
                    parameter: "max_node_depth",
                });
            }
            let to_world = parent * local_transform(node, &at)?;
            if !to_world.is_finite() {
                return Err(ImportProblem::invalid(at, "transform to the world overflows", "scale it down"));
            }
            place_node(node, &to_world, &at, &mut placed, notes)?;
            let children: Vec<usize> = node.children().map(|child| child.index()).collect();
            stack.extend(children.iter().rev().map(|&child| (child, to_world, depth + 1)));
        }
    }
    Ok(placed)
}

fn chosen_scenes<'a>(document: &'a Document, choice: SceneChoice, notes: &mut Notes) -> Vec<gltf::Scene<'a>> {
    match (choice, document.default_scene()) {
        (SceneChoice::All, _) => document.scenes().collect(),
        (SceneChoice::Default, Some(scene)) => vec![scene],
        (SceneChoice::Default, None) => {
            if document.scenes().len() > 1 {
                notes.say("the file names no default scene: the first one is taken".to_owned());
            }
            document.scenes().take(1).collect()
        }
    }
}

fn place_node(
    node: &Node<'_>,
    to_world: &DAffine3,
    at: &str,
    placed: &mut Placed,
    notes: &mut Notes,
) -> Result<(), ImportProblem> {
    if let Some(mesh) = node.mesh() {
        if node.skin().is_some() {
            notes.count("skins are ignored: meshes stand in their bind pose".to_owned());
        }
        placed.meshes.push((mesh.index(), *to_world, at.to_owned()));
    }
    if let Some(light) = node.light() {
        place_light(&light, to_world, at, placed, notes)?;
    }
    if let Some(camera) = node.camera() {
        place_camera(node, &camera, to_world, at, placed, notes)?;
    }
    Ok(())
}

/// A node's own transform. A matrix must be affine; a quaternion of any length is normalised.
fn local_transform(node: &Node<'_>, at: &str) -> Result<DAffine3, ImportProblem> {
    let not_finite = || ImportProblem::invalid(at, "transform is not finite", "write finite numbers");
    match node.transform() {
        Transform::Matrix { matrix } => {
            let matrix = DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from)));
            if !matrix.is_finite() {
                return Err(not_finite());
            }
            if matrix.row(3) != glam::DVec4::W {
                let why = format!("matrix has the last row {}", matrix.row(3));
                return Err(ImportProblem::invalid(at, why, "write an affine matrix, last row 0 0 0 1"));
            }
            Ok(DAffine3::from_mat4(matrix))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            let [translation, scale] = [translation, scale].map(|v| DVec3::from_array(v.map(f64::from)));
            if !(translation.is_finite() && rotation.is_finite() && scale.is_finite()) {
                return Err(not_finite());
            }
            if rotation.length_squared() == 0.0 {
                return Err(ImportProblem::invalid(at, "rotation is a quaternion of length 0", REPAIR));
            }
            Ok(DAffine3::from_scale_rotation_translation(scale, rotation.normalize(), translation))
        }
    }
}

/// Every light that the file defines, used or not, has to be sound.
pub(super) fn check_lights(document: &Document) -> Result<(), ImportProblem> {
    for light in document.lights().into_iter().flatten() {
        let at = thing("light", light.index(), light.name());
        let bad =
            |why: String| Err(ImportProblem::invalid(&at, why, "write a finite number that is not negative"));
        let intensity = light.intensity();
        if !intensity.is_finite() || intensity < 0.0 {
            return bad(format!("intensity is {intensity}"));
        }
        let color = Vec3::from(light.color());
        if !color.is_finite() || color.min_element() < 0.0 {
            return bad(format!("colour is {color}"));
        }
        if !(color * intensity).is_finite() {
            return bad(format!("intensity {intensity} × colour {color} overflows"));
        }
        if let Kind::Spot { inner_cone_angle: inner, outer_cone_angle: outer } = light.kind() {
            let in_range = 0.0 <= inner && inner <= outer && outer <= std::f32::consts::FRAC_PI_2 + 1e-5;
            if !in_range {
                let why = format!("cone angles are {inner} inner, {outer} outer");
                let mend = "write 0 <= inner < outer <= pi/2 radians";
                return Err(ImportProblem::invalid(&at, why, mend));
            }
        }
    }
    Ok(())
}

/// `KHR_lights_punctual`: at the node's origin, along its -Z; scale does not change the intensity.
fn place_light(
    light: &GltfLight<'_>,
    to_world: &DAffine3,
    at: &str,
    placed: &mut Placed,
    notes: &mut Notes,
) -> Result<(), ImportProblem> {
    let intensity = Vec3::from(light.color()) * light.intensity();
    if intensity == Vec3::ZERO {
        notes.count("lights of zero intensity are left out".to_owned());
        return Ok(());
    }
    let position = to_world.translation.as_vec3();
    if !position.is_finite() {
        return Err(ImportProblem::invalid(at, "its light's position overflows", "scale the scene down"));
    }
    if light.range().is_some() {
        notes.count("lights' range is ignored".to_owned());
    }
    let axis =
        to_world.transform_vector3(DVec3::NEG_Z).try_normalize().map(|axis| axis.as_vec3().normalize());
    match (light.kind(), axis) {
        (Kind::Point, _) => placed.lights.push(Light::Point { position, intensity }),
        (_, None) => {
            notes.say(format!("{at}: its light has no direction, since the transform is singular: left out"));
        }
        (Kind::Directional, Some(direction)) => {
            placed.distant.push(DistantLight { direction, irradiance: intensity });
        }
        (Kind::Spot { inner_cone_angle, outer_cone_angle }, Some(axis)) => {
            let (cos_inner, cos_outer) = (inner_cone_angle.cos(), outer_cone_angle.cos());
            placed.lights.push(Light::Spot { position, axis, intensity, cos_inner, cos_outer });
        }
    }
    Ok(())
}

/// Looks along the node's -Z, +Y up; named after the node, or else the camera.
fn place_camera(
    node: &Node<'_>,
    source: &gltf::Camera<'_>,
    to_world: &DAffine3,
    at: &str,
    placed: &mut Placed,
    notes: &mut Notes,
) -> Result<(), ImportProblem> {
    let camera::Projection::Perspective(perspective) = source.projection() else {
        notes.say(format!("{at}: its camera is orthographic, which is not supported: left out"));
        return Ok(());
    };
    let fov = perspective.yfov();
    if !(fov > 0.0 && fov < std::f32::consts::PI) {
        let camera = thing("camera", source.index(), source.name());
        let why = format!("vertical angle of view is {fov}");
        return Err(ImportProblem::invalid(camera, why, "write an angle between 0 and pi radians"));
    }
    let forward = to_world.transform_vector3(DVec3::NEG_Z).try_normalize();
    let up = to_world.transform_vector3(DVec3::Y).try_normalize();
    let right = forward.zip(up).and_then(|(forward, up)| forward.cross(up).try_normalize());
    let position = to_world.translation.as_vec3();
    let (Some(forward), Some(right), true) = (forward, right, position.is_finite()) else {
        notes.say(format!("{at}: its camera is left out, since the transform is singular"));
        return Ok(());
    };
    let name = match (node.name(), source.name()) {
        (Some(name), _) | (None, Some(name)) => one_line(name),
        (None, None) => format!("camera {}", source.index()),
    };
    let up = right.cross(forward);
    let [forward, right, up] = [forward, right, up].map(|v| v.as_vec3());
    placed.cameras.push(Camera { name, position, forward, right, up, vertical_fov: fov });
    Ok(())
}
