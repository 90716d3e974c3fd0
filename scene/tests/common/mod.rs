//! A host as dumb as possible: every ray against every triangle, in double precision. Independent of
//! `scene`'s rays, so that the renderer's tests do not rest on what they do not test.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own part")]

use glam::{DVec3, Vec2, Vec3};
use lighttree::rng::Decisions;
use lighttree::{LightId, LightSample, LightSampler, Ray, RayHit, RayQueries, Segment};
use scene::{
    BruteForce, Camera, Frame, Geometry, Instance, Light, Material, Mesh, NoIndirect, RenderParams, Rendered,
    Scene, Surface, render,
};

pub struct Loop {
    triangles: Vec<([DVec3; 3], u32, u32)>,
}

impl Loop {
    pub fn new(scene: &Scene) -> Self {
        let mut triangles = Vec::new();
        for (i, instance) in scene.instances.iter().enumerate() {
            let mesh = &scene.meshes[instance.mesh as usize];
            for (t, corners) in mesh.triangles.iter().enumerate() {
                let corner = |k: usize| {
                    instance.to_world.transform_point3(mesh.positions[corners[k] as usize]).as_dvec3()
                };
                triangles.push(([corner(0), corner(1), corner(2)], i as u32, t as u32));
            }
        }
        Self { triangles }
    }

    fn hit(&self, origin: Vec3, direction: DVec3, t_max: f64) -> Option<(f64, u32, f64, f64)> {
        let origin = origin.as_dvec3();
        let mut best: Option<(f64, u32, f64, f64)> = None;
        for (index, ([a, b, c], ..)) in self.triangles.iter().enumerate() {
            let (e1, e2) = (b - a, c - a);
            let p = direction.cross(e2);
            let det = e1.dot(p);
            if det == 0.0 {
                continue;
            }
            let s = origin - a;
            let u = s.dot(p) / det;
            let q = s.cross(e1);
            let v = direction.dot(q) / det;
            let t = e2.dot(q) / det;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < best.map_or(t_max, |b| b.0) {
                best = Some((t, index as u32, u, v));
            }
        }
        best
    }
}

impl RayQueries for Loop {
    type Scratch = ();

    fn closest(&self, ray: &Ray, (): &mut ()) -> Option<RayHit> {
        self.hit(ray.origin, ray.direction.as_dvec3(), f64::from(ray.t_max))
            .map(|(t, primitive, u, v)| RayHit { t: t as f32, primitive, u: u as f32, v: v as f32 })
    }

    fn occluded(&self, segment: &Segment, (): &mut ()) -> bool {
        self.hit(segment.from, segment.to.as_dvec3() - segment.from.as_dvec3(), 1.0).is_some()
    }
}

impl Geometry for Loop {
    fn surface(&self, scene: &Scene, ray: &Ray, hit: &RayHit) -> Surface {
        let ([a, b, c], instance, triangle) = self.triangles[hit.primitive as usize];
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let normal = (b - a).cross(c - a).normalize().as_vec3();
        let mesh = &scene.meshes[scene.instances[instance as usize].mesh as usize];
        let corners = mesh.triangles[triangle as usize];
        let uv = |k: usize| mesh.uvs.get(corners[k] as usize).copied().unwrap_or(Vec2::ZERO);
        let uv = uv(0) * (1.0 - hit.u - hit.v) + uv(1) * hit.u + uv(2) * hit.v;
        let extent = a.abs().max(b.abs()).max(c.abs()).max_element();
        Surface {
            position: (a + (b - a) * u + (c - a) * v).as_vec3(),
            geometric_normal: normal,
            shading_normal: normal,
            uv,
            uv1: uv,
            material: mesh.material,
            instance,
            triangle,
            front: normal.dot(ray.direction) < 0.0,
            error: 64.0 * f32::EPSILON * extent as f32,
        }
    }
}

/// Adds a quadrilateral, counter-clockwise from its front; emissive ones become lights.
pub fn add_quad(scene: &mut Scene, corners: [Vec3; 4], material: Material) {
    let instance = scene.instances.len() as u32;
    let triangles = [[0, 1, 2], [0, 2, 3]];
    if material.emissive != Vec3::ZERO {
        for (triangle, t) in triangles.iter().enumerate() {
            scene.lights.push(Light::Triangle {
                vertices: t.map(|k: u32| corners[k as usize]),
                radiance: material.emissive,
                two_sided: material.double_sided,
                instance,
                triangle: triangle as u32,
            });
        }
    }
    scene.meshes.push(Mesh {
        positions: corners.to_vec(),
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: triangles.to_vec(),
        material: scene.materials.len() as u32,
        ..Mesh::default()
    });
    scene.materials.push(material);
    scene.instances.push(Instance { mesh: instance, to_world: glam::Affine3A::IDENTITY });
}

/// A Lambert material.
pub fn lambert(albedo: Vec3) -> Material {
    Material { base_color: albedo, ..Material::default() }
}

/// A one-sided emitter that reflects nothing.
pub fn emitter(radiance: Vec3) -> Material {
    Material { base_color: Vec3::ZERO, emissive: radiance, double_sided: false, ..Material::default() }
}

/// The floor z = 0, `half` in both directions, seen from above.
pub fn floor(scene: &mut Scene, half: f32, material: Material) {
    let c = |x: f32, y: f32| Vec3::new(x * half, y * half, 0.0);
    add_quad(scene, [c(-1.0, -1.0), c(1.0, -1.0), c(1.0, 1.0), c(-1.0, 1.0)], material);
}

/// Looks straight down at the origin with a tiny angle of view.
pub fn down_from(height: f32, fov: f32) -> Camera {
    Camera::look_at("down", Vec3::Z * height, Vec3::ZERO, Vec3::Y, fov)
}

/// Each of the first so many lights with the same probability.
#[derive(Clone, Copy)]
pub struct Uniform(pub usize);

impl<R> LightSampler<R> for Uniform {
    fn sample(&self, _: &R, random: &mut Decisions) -> Option<LightSample> {
        let mut left = 0..self.0 as u32;
        while left.len() > 1 {
            let half = left.len() / 2;
            let q = (half as u64 * (1 << 32) / left.len() as u64) as u32;
            left = if random.choose(q) {
                left.start..left.start + half as u32
            } else {
                left.start + half as u32..left.end
            };
        }
        let light = LightId(left.next()?);
        Some(LightSample { light, pmf: 1.0 / self.0 as f64 })
    }

    fn pmf(&self, _: &R, light: LightId) -> f64 {
        if (light.0 as usize) < self.0 { 1.0 / self.0 as f64 } else { 0.0 }
    }
}

/// Direct light by brute force, rays by [`Loop`].
pub fn brute(scene: &Scene, camera: &Camera, params: &RenderParams) -> Rendered {
    let rays = Loop::new(scene);
    let frame = Frame::new(scene, &rays, &scene.lights, 1);
    render(&frame, camera, params, &BruteForce, &NoIndirect, &()).unwrap()
}
