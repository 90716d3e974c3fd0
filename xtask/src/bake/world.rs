//! The scene as edits change it, seen from the bake: objects, lamps, rays.

use std::sync::Arc;

use bake::lightmap::{LightmapRays, MeshView, ObjectView};
use bake::{Aperture, Bounds, Light, LightKey, ObjectChange, Profile, SurfaceHit};
use glam::{Affine3A, Quat, Vec3};
use lighttree::{Ray, RayHit, RayQueries, Segment};
use rayon::prelude::*;
use scene::{Instance, RayScratch, Scene, SceneRays};

use crate::failure::Failure;

/// A scene under edits. Objects are its instances, by index; lights have names that count up.
pub(crate) struct World {
    /// Everything but what edits change.
    pub(crate) scene: Scene,
    /// Where objects stand; `None`: absent.
    pub(crate) objects: Vec<Option<Affine3A>>,
    /// Where they stood when they were last there.
    pub(crate) stood: Vec<Affine3A>,
    /// Colour that an object has in place of its material's.
    pub(crate) colours: Vec<Option<Vec3>>,
    /// Lamps, by their name; those that are out are kept.
    pub(crate) lamps: Vec<Lamp>,
    bounds: Vec<(Vec3, Vec3)>,
}

/// A lamp of the scene or of an edit.
#[derive(Clone, Debug)]
pub(crate) struct Lamp {
    /// What it is.
    pub(crate) light: Light,
    /// Whether it shines.
    pub(crate) present: bool,
    /// The object that it is a part of and moves with.
    pub(crate) object: Option<u32>,
    /// For people.
    pub(crate) what: &'static str,
}

impl World {
    pub(crate) fn new(scene: Scene) -> Self {
        let bounds = scene.meshes.iter().map(|mesh| bounds(mesh.positions.iter().copied())).collect();
        let stood: Vec<Affine3A> = scene.instances.iter().map(|instance| instance.to_world).collect();
        let objects = stood.iter().copied().map(Some).collect();
        let lamps = lamps(&scene);
        Self { colours: vec![None; stood.len()], scene, objects, stood, lamps, bounds }
    }

    pub(crate) fn meshes(&self, keep_uvs: bool) -> Vec<MeshView<'_>> {
        self.scene
            .meshes
            .iter()
            .map(|mesh| MeshView {
                positions: &mesh.positions,
                normals: &mesh.normals,
                triangles: &mesh.triangles,
                kept_uvs: if keep_uvs { &mesh.uvs1 } else { &[] },
            })
            .collect()
    }

    pub(crate) fn object_views(&self) -> Vec<ObjectView> {
        let placed = self.scene.instances.iter().zip(&self.stood);
        placed.map(|(instance, &to_world)| ObjectView { mesh: instance.mesh, to_world }).collect()
    }

    /// World-space box of an object that stands at `at`.
    pub(crate) fn box_of(&self, object: u32, at: Affine3A) -> Bounds {
        let (low, high) = self.bounds[self.scene.instances[object as usize].mesh as usize];
        let corner = |i: u32| {
            let pick = |bit: u32, low: f32, high: f32| if i & bit == 0 { low } else { high };
            at.transform_point3(Vec3::new(
                pick(1, low.x, high.x),
                pick(2, low.y, high.y),
                pick(4, low.z, high.z),
            ))
        };
        let (min, max) = bounds((0..8).map(corner));
        Bounds { min, max }
    }

    /// The box of everything that stands, and a bit around it for what will.
    pub(crate) fn whole_box(&self) -> Bounds {
        let boxes =
            (0..self.objects.len() as u32).filter_map(|o| Some(self.box_of(o, self.objects[o as usize]?)));
        let whole = boxes.reduce(|a, b| Bounds { min: a.min.min(b.min), max: a.max.max(b.max) });
        let whole = whole.unwrap_or(Bounds { min: Vec3::splat(-1.0), max: Vec3::ONE });
        let margin = Vec3::splat(0.05 * (whole.max - whole.min).max_element());
        Bounds { min: whole.min - margin, max: whole.max + margin }
    }

    /// Puts an object somewhere, or takes it away, with the lamps that it carries. Says what changed for the
    /// bake.
    pub(crate) fn put(&mut self, object: u32, to: Option<Affine3A>) -> (ObjectChange, Vec<LightKey>) {
        let index = object as usize;
        let before = self.objects[index];
        let change = ObjectChange {
            object,
            before: before.map(|at| self.box_of(object, at)),
            after: to.map(|at| self.box_of(object, at)),
        };
        let mut carried = Vec::new();
        for (key, lamp) in self.lamps.iter_mut().enumerate().filter(|(_, lamp)| lamp.object == Some(object)) {
            if let Some(at) = to {
                lamp.light.transform = at;
            }
            lamp.present = to.is_some();
            carried.push(LightKey(key as u32));
        }
        self.objects[index] = to;
        if let Some(at) = to {
            self.stood[index] = at;
        }
        (change, carried)
    }

    /// Rays against what stands now.
    pub(crate) fn geometry(&self) -> Result<Geometry, Failure> {
        let standing: Vec<u32> =
            (0..self.objects.len() as u32).filter(|&o| self.objects[o as usize].is_some()).collect();
        let instances = standing.iter().map(|&object| Instance {
            mesh: self.scene.instances[object as usize].mesh,
            to_world: self.objects[object as usize].unwrap_or_default(),
        });
        let mut scene = Scene { lights: Vec::new(), ..self.scene.clone() };
        scene.instances = instances.collect();
        let rays =
            SceneRays::build(&scene).map_err(|error| Failure::failed(format!("{}: {error}", scene.name)))?;
        let fronts = (0..rays.primitive_count()).map(|primitive| {
            let (instance, triangle) = rays.locate(primitive);
            let instance = &scene.instances[instance as usize];
            let mesh = &scene.meshes[instance.mesh as usize];
            let solid = !scene.materials[mesh.material as usize].double_sided;
            let [a, b, c] = mesh.triangles[triangle as usize]
                .map(|v| instance.to_world.transform_point3(mesh.positions[v as usize]));
            let normal = (b - a).cross(c - a);
            if !solid {
                Vec3::ZERO
            } else if instance.is_mirrored() {
                -normal
            } else {
                normal
            }
        });
        let fronts = fronts.collect();
        Ok(Geometry(Arc::new(Standing { scene, rays, standing, fronts })))
    }

    /// The albedo of an object's surface.
    pub(crate) fn albedo(&self, object: u32, look: Vec3) -> Vec3 {
        self.colours[object as usize].unwrap_or(look).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Answers the bake's rays.
    pub(crate) fn trace(&self, geometry: &Geometry, rays: &[Ray], hits: &mut [Option<SurfaceHit>]) {
        let Standing { scene, rays: tree, standing, .. } = &*geometry.0;
        rays.par_chunks(256).zip(hits.par_chunks_mut(256)).for_each_init(
            || (RayScratch::default(), vec![None; 256]),
            |(scratch, found), (rays, hits)| {
                let found = &mut found[..rays.len()];
                tree.closest_each(rays, found, scratch);
                for ((ray, found), hit) in rays.iter().zip(found).zip(hits) {
                    *hit = found.map(|found| {
                        let surface = tree.surface(scene, ray, &found);
                        let material = &scene.materials[surface.material as usize];
                        let look = material.look(scene, [surface.uv, surface.uv1]);
                        let object = standing[surface.instance as usize];
                        SurfaceHit {
                            position: surface.offset(-ray.direction),
                            normal: surface.facing_normal(),
                            albedo: self.albedo(object, look.base_color),
                            object,
                        }
                    });
                }
            },
        );
    }
}

/// Rays against a scene as it stood at some moment; kept for as long as light is baked under it.
#[derive(Clone)]
pub(crate) struct Geometry(pub(crate) Arc<Standing>);

/// See [`Geometry`].
pub(crate) struct Standing {
    pub(crate) scene: Scene,
    pub(crate) rays: SceneRays,
    /// The object of each instance.
    pub(crate) standing: Vec<u32>,
    /// Where the front of each primitive looks, at any length; zero where both sides are lit.
    fronts: Vec<Vec3>,
}

impl RayQueries for Geometry {
    type Scratch = RayScratch;

    fn closest(&self, ray: &Ray, scratch: &mut RayScratch) -> Option<RayHit> {
        self.0.rays.closest(ray, scratch)
    }

    fn occluded(&self, segment: &Segment, scratch: &mut RayScratch) -> bool {
        self.0.rays.occluded(segment, scratch)
    }

    fn closest_each(&self, rays: &[Ray], hits: &mut [Option<RayHit>], scratch: &mut RayScratch) {
        self.0.rays.closest_each(rays, hits, scratch);
    }

    fn occluded_each(&self, segments: &[Segment], occluded: &mut [bool], scratch: &mut RayScratch) {
        self.0.rays.occluded_each(segments, occluded, scratch);
    }
}

impl LightmapRays for Geometry {
    fn is_back(&self, ray: &Ray, hit: &RayHit) -> bool {
        self.0.fronts[hit.primitive as usize].dot(ray.direction) > 0.0
    }
}

/// Lamps of a scene: punctual lights one by one, emissive objects whole, then those without a place.
fn lamps(scene: &Scene) -> Vec<Lamp> {
    let mut lamps = Vec::new();
    let mut surfaces: Vec<(u32, Vec<[Vec3; 3]>, Vec3, bool)> = Vec::new();
    let lamp = |light, object, what| Lamp { light, present: true, object, what };
    for light in &scene.lights {
        let flux = light.flux();
        match *light {
            scene::Light::Point { position, .. } => {
                let transform = Affine3A::from_translation(position);
                let light =
                    Light { aperture: Aperture::Point, profile: Profile::Lambert, flux, transform, paths: 1 };
                lamps.push(lamp(light, None, "point"));
            }
            scene::Light::Spot { position, axis, cos_inner, cos_outer, .. } => {
                let turn = Quat::from_rotation_arc(Vec3::NEG_Z, axis);
                let transform = Affine3A::from_rotation_translation(turn, position);
                let profile = Profile::Spot { cos_inner, cos_outer };
                let light = Light { aperture: Aperture::Point, profile, flux, transform, paths: 1 };
                lamps.push(lamp(light, None, "spot"));
            }
            scene::Light::Triangle { instance, triangle, two_sided, .. } => {
                let mesh = &scene.meshes[scene.instances[instance as usize].mesh as usize];
                let corners = mesh.triangles[triangle as usize].map(|v| mesh.positions[v as usize]);
                match surfaces.last_mut() {
                    Some((last, triangles, sum, _)) if *last == instance => {
                        triangles.push(corners);
                        *sum += flux;
                    }
                    _ => surfaces.push((instance, vec![corners], flux, two_sided)),
                }
            }
            scene::Light::Vpl { .. } => {}
        }
    }
    for (instance, triangles, flux, two_sided) in surfaces {
        let placed = &scene.instances[instance as usize];
        let flip = |[a, b, c]: [Vec3; 3]| if placed.is_mirrored() { [a, c, b] } else { [a, b, c] };
        let triangles = triangles.into_iter().map(flip).collect();
        let aperture = Aperture::Mesh { triangles, two_sided };
        let transform = placed.to_world;
        let light = Light { aperture, profile: Profile::Lambert, flux, transform, paths: 1 };
        lamps.push(lamp(light, Some(instance), "surface"));
    }
    for distant in &scene.distant {
        let transform = Affine3A::from_quat(Quat::from_rotation_arc(Vec3::Z, distant.direction));
        let aperture = Aperture::Sky { half_angle: 0.0 };
        let light =
            Light { aperture, profile: Profile::Lambert, flux: distant.irradiance, transform, paths: 1 };
        lamps.push(lamp(light, None, "distant"));
    }
    lamps
}

pub(crate) fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (min, max) = points.fold(none, |(min, max), p| (min.min(p), max.max(p)));
    if min.cmple(max).all() { (min, max) } else { (Vec3::ZERO, Vec3::ZERO) }
}
