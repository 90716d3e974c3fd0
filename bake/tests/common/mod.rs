//! A host as small as can be: boxes, rays by brute force, and receivers that add up fixed-point numbers.
#![allow(dead_code, reason = "each test uses a part")]

use std::collections::BTreeMap;

use bake::{
    Aperture, BakeParams, Baker, Bounds, Contribution, GeometryVersion, Light, LightKey, ObjectChange,
    Profile, Progress, StepBudget, SurfaceHit, Target, Update, VirtualLight,
};
use glam::{Affine3A, Vec3};
use lighttree::Ray;
use lighttree::rng::{pcg4d, unit_f32};

/// An axis-aligned box, its faces seen from outside; or a room, seen from inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Solid {
    pub(crate) min: Vec3,
    pub(crate) max: Vec3,
    pub(crate) albedo: Vec3,
    pub(crate) inside_out: bool,
}

pub(crate) fn solid(min: [f32; 3], max: [f32; 3], albedo: f32) -> Solid {
    Solid { min: min.into(), max: max.into(), albedo: Vec3::splat(albedo), inside_out: false }
}

impl Solid {
    pub(crate) fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max }
    }

    /// Nearest hit: distance and normal.
    fn hit(&self, ray: &Ray) -> Option<(f32, Vec3)> {
        let inverse = ray.direction.recip();
        let (a, b) = ((self.min - ray.origin) * inverse, (self.max - ray.origin) * inverse);
        let (near, far) = (a.min(b), a.max(b));
        let (enter, leave) = (near.max_element(), far.min_element());
        let t = if self.inside_out { leave } else { enter };
        if !(enter <= leave && t > 0.0) {
            return None;
        }
        let axis = if self.inside_out { far.min_position() } else { near.max_position() };
        let mut normal = Vec3::ZERO;
        normal[axis] = -ray.direction[axis].signum();
        Some((t, normal))
    }
}

/// Objects by number, in every version.
#[derive(Clone, Debug, Default)]
pub(crate) struct World {
    pub(crate) versions: BTreeMap<GeometryVersion, Vec<Option<Solid>>>,
    pub(crate) current: GeometryVersion,
}

impl World {
    pub(crate) fn new(solids: Vec<Solid>) -> Self {
        let version = GeometryVersion::default();
        Self { versions: [(version, solids.into_iter().map(Some).collect())].into(), current: version }
    }

    pub(crate) fn solids(&self) -> &[Option<Solid>] {
        &self.versions[&self.current]
    }

    pub(crate) fn closest(&self, version: GeometryVersion, ray: &Ray) -> Option<SurfaceHit> {
        let mut best: Option<(f32, Vec3, u32)> = None;
        for (object, solid) in self.versions[&version].iter().enumerate() {
            let Some((t, normal)) = solid.as_ref().and_then(|solid| solid.hit(ray)) else { continue };
            if t < ray.t_max && best.is_none_or(|(nearest, ..)| t < nearest) {
                best = Some((t, normal, object as u32));
            }
        }
        best.map(|(t, normal, object)| SurfaceHit {
            position: ray.origin + t * ray.direction + 1e-4 * normal,
            normal,
            albedo: self.versions[&version][object as usize].unwrap().albedo,
            object,
        })
    }

    pub(crate) fn occluded(&self, version: GeometryVersion, from: Vec3, to: Vec3) -> bool {
        // Both ends are off their surfaces by more than rounding.
        self.closest(version, &Ray { origin: from, direction: to - from, t_max: 1.0 - 1e-5 }).is_some()
    }

    pub(crate) fn trace(&self) -> impl Fn(&[Ray], &mut [Option<SurfaceHit>]) + Sync + '_ {
        |rays, hits| {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = self.closest(self.current, ray);
            }
        }
    }

    /// Puts `solid` in the place of an object, as an edit.
    pub(crate) fn put(&mut self, baker: &mut Baker, object: usize, solid: Option<Solid>) {
        let mut solids = self.solids().to_vec();
        let before = solids[object].map(|solid| solid.bounds());
        solids[object] = solid;
        let change = ObjectChange { object: object as u32, before, after: solid.map(|solid| solid.bounds()) };
        self.current = baker.change_geometry(&[change]).unwrap();
        self.versions.insert(self.current, solids);
    }

    pub(crate) fn recolour(&mut self, baker: &mut Baker, object: usize, albedo: Vec3) {
        self.versions.get_mut(&self.current).unwrap()[object].as_mut().unwrap().albedo = albedo;
        baker.recolour(&[object as u32]);
    }
}

/// Points that light is added up at.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Receivers {
    pub(crate) points: Vec<(Vec3, Vec3)>,
    pub(crate) sums: Vec<[i64; 3]>,
    pub(crate) accumulations: usize,
    pub(crate) updates: usize,
}

impl Receivers {
    /// Points on a horizontal plane.
    pub(crate) fn plane(min: [f32; 2], max: [f32; 2], y: f32, n: usize) -> Self {
        let at = |i: usize, axis: usize| min[axis] + (i as f32 + 0.5) / n as f32 * (max[axis] - min[axis]);
        let points = (0..n * n).map(|i| (Vec3::new(at(i % n, 0), y, at(i / n, 1)), Vec3::Y)).collect();
        Self { points, sums: vec![[0; 3]; n * n], accumulations: 0, updates: 0 }
    }

    pub(crate) fn irradiance(
        world: &World,
        light: &VirtualLight,
        version: GeometryVersion,
        index: usize,
        at: (Vec3, Vec3),
    ) -> Vec3 {
        let words = pcg4d([light.seed, index as u32, 0, 0]);
        let Some(incident) = light.incident(at.0, at.1, [unit_f32(words[0]), unit_f32(words[1])]) else {
            return Vec3::ZERO;
        };
        let to = match incident.target {
            Target::At(point) => point,
            Target::Toward(direction) => at.0 + 1e3 * direction,
        };
        if world.occluded(version, at.0, to) { Vec3::ZERO } else { incident.irradiance }
    }

    fn add(&mut self, world: &World, contribution: &Contribution, sign: i64) {
        for (i, (&at, sum)) in self.points.iter().zip(&mut self.sums).enumerate() {
            let irradiance = Self::irradiance(world, &contribution.light, contribution.version, i, at);
            for (sum, e) in sum.iter_mut().zip(irradiance.to_array()) {
                *sum += sign * (f64::from(e) * 1e9).round() as i64;
            }
        }
    }

    pub(crate) fn apply(&mut self, world: &World, update: &Update) {
        update.subtract.iter().for_each(|contribution| self.add(world, contribution, -1));
        update.add.iter().for_each(|contribution| self.add(world, contribution, 1));
        self.accumulations += update.accumulations();
        self.updates += 1;
    }

    pub(crate) fn of(&self, i: usize) -> f64 {
        self.sums[i][0] as f64 * 1e-9
    }
}

/// `lighttree-clustering` groups directions.
pub(crate) fn group(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32> {
    clustering::angular_clusters(directions, weights, count, 16).expect("sound directions").cluster_of
}

pub(crate) fn params(path_power: f64) -> BakeParams {
    let world = Bounds { min: Vec3::splat(-8.0), max: Vec3::splat(8.0) };
    BakeParams { clusters: 60, ..BakeParams::new(world, path_power, group) }
}

/// A room of 10 × 4 × 10 with two boxes in it; objects 0 to 2.
pub(crate) fn room() -> World {
    let mut walls = solid([-5.0, 0.0, -5.0], [5.0, 4.0, 5.0], 0.6);
    walls.inside_out = true;
    let first = solid([-2.0, 0.0, -1.0], [-1.0, 2.0, 0.0], 0.5);
    let second = solid([1.5, 0.0, 1.0], [3.0, 1.0, 2.5], 0.7);
    World::new(vec![walls, first, second])
}

/// A square lamp that looks down.
pub(crate) fn lamp(at: [f32; 3], flux: f32, paths: u32) -> Light {
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    Light {
        aperture: Aperture::polygon(
            &[corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)],
            false,
        ),
        profile: Profile::Lambert,
        flux: Vec3::splat(flux),
        transform: Affine3A::from_translation(at.into()),
        paths,
    }
}

pub(crate) fn bulb(at: [f32; 3], flux: f32, paths: u32) -> Light {
    Light { aperture: Aperture::Point, ..lamp(at, flux, paths) }
}

/// Steps until nothing is left.
pub(crate) fn finish(baker: &mut Baker, world: &World, receivers: &mut Receivers) -> Progress {
    let budget = StepBudget { paths: 1000, accumulations: 40 };
    for _ in 0..100_000 {
        let progress = baker.step(budget, &world.trace(), &mut |update| receivers.apply(world, update));
        if progress.is_done {
            return progress;
        }
    }
    panic!("the bake does not end");
}

/// A bake of the room with a lamp and a bulb, finished.
pub(crate) fn baked_room(params: BakeParams) -> (World, Baker, Receivers) {
    let world = room();
    let mut baker = Baker::new(params).unwrap();
    baker.add_light(LightKey(1), lamp([0.0, 3.9, 0.0], 100.0, 2000)).unwrap();
    baker.add_light(LightKey(7), bulb([-3.0, 3.0, 3.0], 40.0, 800)).unwrap();
    let mut receivers = Receivers::plane([-4.9, -4.9], [4.9, 4.9], 1e-3, 12);
    finish(&mut baker, &world, &mut receivers);
    (world, baker, receivers)
}
