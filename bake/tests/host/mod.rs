//! A host in a hundred lines, for tests: triangles, and rays against all of them.

#![allow(dead_code, reason = "each test file uses a part")]

use core::sync::atomic::{AtomicUsize, Ordering};

use bake::lightmap::{Lightmap, LightmapParams, LightmapRays, MeshView, ObjectView};
use bake::{Contribution, GeometryVersion, Update, VirtualLight};
use glam::{Affine3A, DVec3, Vec3};
use lighttree::{Ray, RayHit, RayQueries, Segment};

#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A parallelogram whose front is where `u × v` points.
    pub(crate) fn quad(mut self, corner: Vec3, u: Vec3, v: Vec3) -> Self {
        let first = self.positions.len() as u32;
        self.positions.extend([corner, corner + u, corner + u + v, corner + v]);
        self.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        self
    }

    /// A box that faces outwards, or inwards.
    pub(crate) fn cuboid(self, min: Vec3, max: Vec3, outwards: bool) -> Self {
        let d = max - min;
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        let faces =
            [(min, z, y), (min + x, y, z), (min, x, z), (min + y, z, x), (min, y, x), (min + z, x, y)];
        faces.into_iter().fold(
            self,
            |mesh, (corner, u, v)| {
                if outwards { mesh.quad(corner, u, v) } else { mesh.quad(corner, v, u) }
            },
        )
    }

    pub(crate) fn view(&self) -> MeshView<'_> {
        MeshView {
            positions: &self.positions,
            normals: &self.normals,
            triangles: &self.triangles,
            kept_uvs: &[],
        }
    }
}

/// Every triangle, asked one after the other, in f64; and how many shadow rays were asked.
pub(crate) struct Soup(Vec<[DVec3; 3]>, AtomicUsize);

impl Soup {
    pub(crate) fn new(meshes: &[Mesh], objects: &[Option<Affine3A>]) -> Self {
        let world = meshes.iter().zip(objects).filter_map(|(mesh, at)| at.map(|at| (mesh, at)));
        let triangles = world.flat_map(|(mesh, at)| {
            mesh.triangles
                .iter()
                .map(move |t| t.map(|v| at.transform_point3(mesh.positions[v as usize]).as_dvec3()))
        });
        Self(triangles.collect(), AtomicUsize::new(0))
    }

    pub(crate) fn asked(&self) -> usize {
        self.1.load(Ordering::Relaxed)
    }

    fn hit(&self, i: usize, ray: &Ray) -> Option<RayHit> {
        let [a, b, c] = self.0[i];
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (ab, ac) = (b - a, c - a);
        let p = d.cross(ac);
        let det = ab.dot(p);
        if det == 0.0 {
            return None;
        }
        let u = (o - a).dot(p) / det;
        let q = (o - a).cross(ab);
        let v = d.dot(q) / det;
        let t = ac.dot(q) / det;
        // Edges count to both sides, so that nothing slips between.
        let inside = u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9;
        (inside && t > 0.0 && t < f64::from(ray.t_max)).then_some(RayHit {
            t: t as f32,
            primitive: i as u32,
            u: u as f32,
            v: v as f32,
        })
    }
}

impl RayQueries for Soup {
    type Scratch = ();

    fn closest(&self, ray: &Ray, (): &mut ()) -> Option<RayHit> {
        (0..self.0.len()).filter_map(|i| self.hit(i, ray)).min_by(|a, b| a.t.total_cmp(&b.t))
    }

    fn occluded(&self, segment: &Segment, (): &mut ()) -> bool {
        self.1.fetch_add(1, Ordering::Relaxed);
        let direction = segment.to - segment.from;
        let ray = Ray { origin: segment.from, direction, t_max: 1.0 };
        (0..self.0.len()).any(|i| self.hit(i, &ray).is_some())
    }
}

impl LightmapRays for Soup {
    fn is_back(&self, ray: &Ray, hit: &RayHit) -> bool {
        let [a, b, c] = self.0[hit.primitive as usize];
        (b - a).cross(c - a).dot(ray.direction.as_dvec3()) > 0.0
    }
}

/// A lightmap of meshes that each stand once, where they are.
pub(crate) fn lightmap(meshes: &[Mesh], params: &LightmapParams) -> Lightmap<Soup> {
    let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
    let objects: Vec<_> =
        (0..meshes.len() as u32).map(|mesh| ObjectView { mesh, to_world: Affine3A::IDENTITY }).collect();
    let mut map = Lightmap::new(&views, &objects, params).unwrap();
    let standing = vec![Some(Affine3A::IDENTITY); meshes.len()];
    map.set_geometry(GeometryVersion(0), Soup::new(meshes, &standing), &standing).unwrap();
    map
}

pub(crate) fn contribution(light: &VirtualLight, version: u32) -> Contribution {
    Contribution { light: light.clone(), version: GeometryVersion(version) }
}

pub(crate) fn add(light: &VirtualLight, version: u32) -> Update {
    Update { subtract: Vec::new(), add: vec![contribution(light, version)] }
}

pub(crate) fn subtract(light: &VirtualLight, version: u32) -> Update {
    Update { subtract: vec![contribution(light, version)], add: Vec::new() }
}
