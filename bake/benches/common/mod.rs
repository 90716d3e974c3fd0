//! A host for benches: built-in scenes with a crate and a partition that edits move, rays by the reference
//! host's tree.
#![allow(dead_code, reason = "each bench uses a part")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use bake::{
    Aperture, BakeParams, Baker, Bounds, Contribution, GeometryVersion, Light, LightKey, ObjectChange,
    Profile, StepBudget, SurfaceHit, Target,
};
use glam::{Affine3A, Quat, Vec2, Vec3};
use lighttree::rng::{pcg4d, unit_f32};
use lighttree::{Ray, RayQueries, Segment};
use scene::{Instance, Material, Mesh, RayScratch, Scene, SceneRays, builtin};

/// A scene and its rays in one version.
pub(crate) struct Stand {
    pub(crate) scene: Scene,
    pub(crate) rays: SceneRays,
}

impl Stand {
    fn new(scene: Scene) -> Arc<Self> {
        let rays = SceneRays::build(&scene).expect("a sound scene");
        Arc::new(Self { scene, rays })
    }

    pub(crate) fn closest(&self, ray: &Ray, scratch: &mut RayScratch) -> Option<SurfaceHit> {
        let hit = self.rays.closest(ray, scratch)?;
        let surface = self.rays.surface(&self.scene, ray, &hit);
        let look =
            self.scene.materials[surface.material as usize].look(&self.scene, [surface.uv, surface.uv1]);
        Some(SurfaceHit {
            position: surface.offset(-ray.direction),
            normal: surface.facing_normal(),
            // Emitters are seen as lights, and metals as matte.
            albedo: look.base_color.clamp(Vec3::ZERO, Vec3::ONE),
            object: surface.instance,
        })
    }

    /// Box of an instance.
    pub(crate) fn bounds(&self, object: usize) -> Bounds {
        let instance = &self.scene.instances[object];
        let points = self.scene.meshes[instance.mesh as usize].positions.iter();
        let points = points.map(|&p| instance.to_world.transform_point3(p));
        let (min, max) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        Bounds { min, max }
    }
}

/// All versions that count.
pub(crate) struct Host {
    pub(crate) versions: BTreeMap<GeometryVersion, Arc<Stand>>,
    pub(crate) current: GeometryVersion,
}

impl Host {
    pub(crate) fn new(scene: Scene) -> Self {
        let current = GeometryVersion::default();
        Self { versions: [(current, Stand::new(scene))].into(), current }
    }

    pub(crate) fn now(&self) -> &Arc<Stand> {
        &self.versions[&self.current]
    }

    pub(crate) fn trace(&self) -> impl Fn(&[Ray], &mut [Option<SurfaceHit>]) + Sync + use<> {
        let stand = Arc::clone(self.now());
        move |rays, hits| {
            let mut scratch = RayScratch::default();
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = stand.closest(ray, &mut scratch);
            }
        }
    }

    /// Another state of one object: `edit` changes the scene.
    pub(crate) fn change(&mut self, baker: &mut Baker, object: usize, edit: impl FnOnce(&mut Scene)) {
        let mut scene = self.now().scene.clone();
        let before = (object < scene.instances.len()).then(|| self.now().bounds(object));
        edit(&mut scene);
        let stand = Stand::new(scene);
        let after = (object < stand.scene.instances.len()).then(|| stand.bounds(object));
        let change = ObjectChange { object: object as u32, before, after };
        self.current = baker.change_geometry(&[change]).expect("sound boxes");
        self.versions.insert(self.current, stand);
    }

    /// Another colour of one object.
    pub(crate) fn paint(&mut self, baker: &mut Baker, object: usize, color: Vec3) {
        let mut scene = self.now().scene.clone();
        let mesh = scene.instances[object].mesh;
        let material = scene.meshes[mesh as usize].material;
        scene.materials[material as usize].base_color = color;
        scene.materials[material as usize].base_color_texture = None;
        self.versions.insert(self.current, Stand::new(scene));
        baker.recolour(&[object as u32]);
    }
}

/// A box as a mesh around the origin of its foot.
fn add_box(scene: &mut Scene, size: Vec3, foot: Vec3, color: Vec3, name: &str) {
    let corner = |i: u32| {
        let [x, y, z] = [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| bit as f32);
        Vec3::new((x - 0.5) * size.x, y * size.y, (z - 0.5) * size.z)
    };
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    scene.materials.push(Material { name: name.to_owned(), base_color: color, ..Material::default() });
    let material = (scene.materials.len() - 1) as u32;
    scene.meshes.push(Mesh {
        positions: (0..8).map(corner).collect(),
        triangles,
        material,
        ..Mesh::default()
    });
    let mesh = (scene.meshes.len() - 1) as u32;
    scene.instances.push(Instance { mesh, to_world: Affine3A::from_translation(foot) });
}

/// Shelves in rows under a low roof.
fn warehouse() -> Scene {
    let mut scene = Scene { name: "warehouse".to_owned(), ..Scene::default() };
    let grey = Vec3::splat(0.55);
    for (size, foot) in [
        (Vec3::new(60.0, 0.2, 36.0), Vec3::new(0.0, -0.2, 0.0)),
        (Vec3::new(60.0, 0.2, 36.0), Vec3::new(0.0, 8.0, 0.0)),
        (Vec3::new(0.2, 8.0, 36.0), Vec3::new(-30.1, 0.0, 0.0)),
        (Vec3::new(0.2, 8.0, 36.0), Vec3::new(30.1, 0.0, 0.0)),
        (Vec3::new(60.0, 8.0, 0.2), Vec3::new(0.0, 0.0, -18.1)),
        (Vec3::new(60.0, 8.0, 0.2), Vec3::new(0.0, 0.0, 18.1)),
    ] {
        add_box(&mut scene, size, foot, grey, "shell");
    }
    for row in 0..5 {
        for bay in 0..8 {
            let foot = Vec3::new(-24.5 + 7.0 * bay as f32, 0.0, -14.0 + 7.0 * row as f32);
            let height = 3.0 + ((row * 7 + bay * 5) % 4) as f32;
            let color = Vec3::new(0.3 + 0.1 * (bay % 4) as f32, 0.35, 0.6 - 0.1 * (row % 4) as f32);
            add_box(&mut scene, Vec3::new(5.2, height, 2.2), foot, color, "shelf");
        }
    }
    for lamp in 0..24 {
        let at = Vec3::new(-26.0 + 10.4 * (lamp % 6) as f32, 7.6, -10.5 + 7.0 * (lamp / 6) as f32);
        scene.lights.push(scene::Light::Point { position: at, intensity: Vec3::splat(60.0) });
    }
    let eye = Vec3::new(-28.0, 2.2, 10.5);
    scene.cameras.push(scene::Camera::look_at("aisle", eye, Vec3::new(10.0, 1.5, 5.0), Vec3::Y, 1.1));
    scene
}

/// A stage of its kind, with a crate and then a partition as its last instances.
pub(crate) fn stage(name: &str, lights: usize) -> Scene {
    let (mut scene, crate_at, wall_at, wall) = match name {
        "museum" => {
            let scene = builtin(&format!("hall:{lights}")).expect("a built-in scene");
            (scene, Vec3::new(-1.2, 0.0, 9.0), Vec3::new(0.0, 0.0, 4.5), Vec3::new(4.0, 3.0, 0.2))
        }
        "town" => {
            let scene = builtin(&format!("city:{lights}")).expect("a built-in scene");
            let camera = &scene.cameras[0];
            let ahead = (camera.forward * Vec3::new(1.0, 0.0, 1.0)).normalize();
            let at = |d: f32| Vec3::new(camera.position.x, 0.05, camera.position.z) + d * ahead;
            let (near, far) = (at(14.0), at(30.0));
            (scene, near, far, Vec3::new(8.0, 5.0, 0.4))
        }
        _ => (warehouse(), Vec3::new(-18.0, 0.0, 10.5), Vec3::new(-7.0, 0.0, 10.5), Vec3::new(0.3, 6.0, 4.0)),
    };
    let size = if name == "museum" { 1.2 } else { 2.2 };
    add_box(&mut scene, Vec3::splat(size), crate_at, Vec3::new(0.6, 0.45, 0.2), "crate");
    add_box(&mut scene, wall, wall_at, Vec3::splat(0.7), "partition");
    scene
}

/// `lighttree-clustering` groups directions.
pub(crate) fn group(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32> {
    clustering::angular_clusters(directions, weights, count, 16).expect("sound directions").cluster_of
}

/// A bake of all lights of a scene with so many paths.
pub(crate) fn baker(
    scene: &Scene,
    paths: u32,
    clusters: usize,
    tune: impl Fn(BakeParams) -> BakeParams,
) -> Baker {
    let (min, max) = scene.bounds().expect("a scene");
    let lights: Vec<Light> = scene.lights.iter().map(light).collect();
    let flux: f64 = lights.iter().map(|light| f64::from(light.flux.element_sum()) / 3.0).sum();
    let power = flux / f64::from(paths);
    let params = BakeParams { clusters, ..BakeParams::new(Bounds { min, max }, power, group) };
    let mut baker = Baker::new(tune(params)).expect("sound dials");
    for (key, light) in lights.into_iter().enumerate() {
        let paths = light.paths_for(power);
        baker.add_light(LightKey(key as u32), Light { paths, ..light }).expect("a sound light");
    }
    baker
}

fn light(light: &scene::Light) -> Light {
    let plain = Light {
        aperture: Aperture::Point,
        profile: Profile::Lambert,
        flux: light.flux(),
        transform: Affine3A::IDENTITY,
        paths: 1,
    };
    match *light {
        scene::Light::Point { position, .. } => {
            Light { transform: Affine3A::from_translation(position), ..plain }
        }
        scene::Light::Spot { position, axis, cos_inner, cos_outer, .. } => Light {
            profile: Profile::Spot { cos_inner, cos_outer },
            transform: Affine3A::from_rotation_translation(
                Quat::from_rotation_arc(Vec3::NEG_Z, axis),
                position,
            ),
            ..plain
        },
        scene::Light::Triangle { vertices, two_sided, .. } => {
            Light { aperture: Aperture::polygon(&vertices, two_sided), ..plain }
        }
        scene::Light::Vpl { .. } => unreachable!("scenes have no virtual lights of their own"),
    }
}

/// So many points of what the camera of a view of this size sees, spread over its picture, not in rows: a row
/// of pixels lies in a strip of shadow as a whole or not at all (the sequence R2, Roberts 2018).
pub(crate) fn spread(stand: &Stand, size: (u32, u32), count: u32) -> Vec<(Vec3, Vec3)> {
    let whole = Vec2::new(size.0 as f32, size.1 as f32);
    let step = |i: u32| glam::DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_2) * f64::from(i);
    seen(stand, size, (0..count).map(|i| (step(i) + 0.5).fract().as_vec2() * whole))
}

/// Points that a camera sees there, and normals.
fn seen(stand: &Stand, size: (u32, u32), pixels: impl Iterator<Item = Vec2>) -> Vec<(Vec3, Vec3)> {
    let camera = stand.scene.cameras.first().cloned().unwrap_or_else(|| stand.scene.framing_camera());
    let mut scratch = RayScratch::default();
    pixels
        .filter_map(|at| stand.closest(&camera.ray(at, size.0, size.1), &mut scratch))
        .map(|hit| (hit.position, hit.normal))
        .collect()
}

/// What a camera sees, as receivers: irradiance there is added up in f64, which is near enough for curves.
#[derive(Clone, Default)]
pub(crate) struct View {
    pub(crate) points: Vec<(Vec3, Vec3)>,
    pub(crate) sums: Vec<f64>,
    pub(crate) accumulations: usize,
}

impl View {
    pub(crate) fn new(stand: &Stand, size: (u32, u32)) -> Self {
        let pixels =
            (0..size.0 * size.1).map(|i| Vec2::new((i % size.0) as f32 + 0.5, (i / size.0) as f32 + 0.5));
        let points = seen(stand, size, pixels);
        Self { sums: vec![0.0; points.len()], points, accumulations: 0 }
    }

    pub(crate) fn add(&mut self, host: &Host, contribution: &Contribution, sign: f64) {
        let stand = &host.versions[&contribution.version];
        let diagonal = 4.0 * stand.scene.bounds().map_or(1.0, |(a, b)| a.distance(b));
        let mut scratch = RayScratch::default();
        for (index, (&(position, normal), sum)) in self.points.iter().zip(&mut self.sums).enumerate() {
            let words = pcg4d([contribution.light.seed, index as u32, 0, 0]);
            let u = [unit_f32(words[0]), unit_f32(words[1])];
            let Some(incident) = contribution.light.incident(position, normal, u) else { continue };
            let to = match incident.target {
                Target::At(point) => point,
                Target::Toward(direction) => position + diagonal * direction,
            };
            if !stand.rays.occluded(&Segment { from: position, to }, &mut scratch) {
                *sum += sign * f64::from(incident.irradiance.element_sum()) / 3.0;
            }
        }
    }
}

/// Steps until nothing is left; `each` sees the view after every update.
pub(crate) fn finish(
    baker: &mut Baker,
    host: &Host,
    view: &mut View,
    budget: StepBudget,
    mut each: impl FnMut(&View),
) {
    let trace = host.trace();
    loop {
        let progress = baker.step(budget, &trace, &mut |update| {
            update.subtract.iter().for_each(|contribution| view.add(host, contribution, -1.0));
            update.add.iter().for_each(|contribution| view.add(host, contribution, 1.0));
            view.accumulations += update.accumulations();
            each(view);
        });
        if progress.is_done {
            return;
        }
    }
}

/// CPU time of all threads of this program, which other work on the machine does not stretch; the time of day
/// where there is no such clock.
pub(crate) fn cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
    }
    #[cfg(not(unix))]
    std::time::UNIX_EPOCH.elapsed().expect("a clock that runs")
}
