//! Rays against a whole scene: instances, holes, and the host's own numbering of triangles.

use glam::Vec3;
use lighttree::{Ray, RayHit, RayQueries, Segment};

use super::alpha::{AlphaMasks, Asked};
use super::build::{BuildStats, WideBvh};
use super::dispatch::Path;
use super::error::RaysError;
use super::primitives::Primitives;
use super::ray::Scratch;
use super::surface::{Surface, Surfaces, world_triangle};
use super::triangle::{AcceptAll, HitFilter};
use super::two_level::TwoLevel;
use crate::{Geometry, Scene};

/// How a scene is made ready for rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaysParams {
    /// Up to so many triangles, instances are written out in world space, which is fastest; with more, meshes
    /// and instances get a tree each. A million triangles written out hold 65 to 85 MB.
    pub max_flattened: u64,
}

impl Default for RaysParams {
    /// 8 million triangles: some 0.6 GB.
    fn default() -> Self {
        Self { max_flattened: 8_000_000 }
    }
}

/// A scene as rays see it. Implements [`RayQueries`].
///
/// Primitives are the triangles of all instances, one after the other in the scene's order; both sides count.
/// Every triangle stops rays, also one that transmits, except where an alpha mask has a hole. Segments, in
/// every kind of query, also pass blended surfaces where alpha is below
/// [`Material::SOLID_ALPHA`](crate::Material::SOLID_ALPHA), emitters excepted. A scene without holes pays
/// nothing for them.
#[derive(Clone, Debug)]
pub struct SceneRays {
    tree: Tree,
    primitives: Primitives,
    alpha: AlphaMasks,
    surfaces: Surfaces,
}

#[derive(Clone, Debug)]
enum Tree {
    Flattened(WideBvh),
    TwoLevel(TwoLevel),
}

impl SceneRays {
    /// Makes a scene ready for rays with the default parameters.
    ///
    /// # Errors
    /// [`RaysError`]: a vertex that isn't finite in world space, an index that leads nowhere, too many triangles.
    pub fn build(scene: &Scene) -> Result<Self, RaysError> {
        Self::build_with(scene, &RaysParams::default())
    }

    /// Makes a scene ready for rays.
    ///
    /// # Errors
    /// As [`build`](Self::build); [`RaysError::Singular`] only where `params` ask for two levels.
    pub fn build_with(scene: &Scene, params: &RaysParams) -> Result<Self, RaysError> {
        let primitives = Primitives::new(scene, u64::from(u32::MAX))?;
        let alpha = AlphaMasks::new(scene);
        let flatten = u64::from(primitives.count()) <= params.max_flattened;
        let tree = if flatten {
            Tree::Flattened(flattened(scene, &primitives, &alpha)?)
        } else {
            Tree::TwoLevel(TwoLevel::build(scene, &alpha)?)
        };
        let surfaces = Surfaces::new(scene, !flatten);
        Ok(Self { tree, primitives, alpha, surfaces })
    }

    /// Instance and triangle (indices into [`Scene::instances`] and that instance's
    /// [`Mesh::triangles`](crate::Mesh::triangles)) of a primitive.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn locate(&self, primitive: u32) -> (u32, u32) {
        self.primitives.locate(primitive)
    }

    /// The primitive of an instance's triangle: the inverse of [`locate`](Self::locate).
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn primitive(&self, instance: u32, triangle: u32) -> u32 {
        self.primitives.first(instance) + triangle
    }

    /// Triangles after instancing.
    pub fn primitive_count(&self) -> u32 {
        self.primitives.count()
    }

    /// What a hit means to a shader; `scene` is the one that this was built from.
    ///
    /// # Panics
    /// If the hit is none of this scene.
    pub fn surface(&self, scene: &Scene, ray: &Ray, hit: &RayHit) -> Surface {
        let (instance, triangle) = self.locate(hit.primitive);
        self.surfaces.at(scene, instance, triangle, [hit.u, hit.v], -ray.direction)
    }

    /// The surface at barycentric (`u`, `v`) of a triangle, seen from the direction `toward`: for points that
    /// no ray has found, on lights as a rule.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn surface_at(
        &self,
        scene: &Scene,
        instance: u32,
        triangle: u32,
        uv: [f32; 2],
        toward: Vec3,
    ) -> Surface {
        self.surfaces.at(scene, instance, triangle, uv, toward)
    }

    /// [`Surface::error`] of all points of a triangle: for those who compute positions themselves, once per
    /// light.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn surface_error(&self, scene: &Scene, instance: u32, triangle: u32) -> f32 {
        self.surfaces.error(scene, instance, triangle)
    }

    /// Whether there is a tree per mesh and one over instances, rather than one over everything.
    pub fn is_two_level(&self) -> bool {
        matches!(self.tree, Tree::TwoLevel(_))
    }

    /// What building the trees did, summed over them.
    pub fn stats(&self) -> BuildStats {
        match &self.tree {
            Tree::Flattened(tree) => *tree.stats(),
            Tree::TwoLevel(trees) => {
                trees.trees().fold(BuildStats::default(), |sum, tree| sum.with(tree.stats()))
            }
        }
    }

    /// Memory held, bytes.
    pub fn bytes(&self) -> usize {
        let tree = match &self.tree {
            Tree::Flattened(tree) => tree.bytes(),
            Tree::TwoLevel(trees) => trees.bytes(),
        };
        tree + self.primitives.bytes() + self.alpha.bytes() + self.surfaces.bytes()
    }

    /// Uses `path`, or the portable one where this processor lacks it: for tests and benches, since answers
    /// are the same.
    pub fn set_path(&mut self, path: Path) {
        match &mut self.tree {
            Tree::Flattened(tree) => tree.set_path(path),
            Tree::TwoLevel(trees) => trees.set_path(path),
        }
    }

    fn holes(&self, asked: Asked) -> Holes<'_> {
        Holes { masks: &self.alpha, primitives: &self.primitives, asked }
    }
}

fn flattened(scene: &Scene, primitives: &Primitives, alpha: &AlphaMasks) -> Result<WideBvh, RaysError> {
    let mut triangles = Vec::with_capacity(primitives.count() as usize);
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        triangles.extend(mesh.triangles.iter().map(|&t| world_triangle(mesh, instance, t)));
    }
    let masked =
        |primitive| alpha.is_masked(primitives.mesh(primitives.locate(primitive).0), Asked::Occlusion);
    let built = if alpha.any(Asked::Occlusion) {
        WideBvh::build_masked(&triangles, masked)
    } else {
        WideBvh::build(&triangles)
    };
    built.map_err(|error| match error {
        RaysError::NonFinite { triangle } => {
            let (instance, triangle) = primitives.locate(triangle);
            RaysError::NonFiniteVertex { instance, triangle }
        }
        other => other,
    })
}

impl Geometry for SceneRays {
    fn surface(&self, scene: &Scene, ray: &Ray, hit: &RayHit) -> Surface {
        self.surface(scene, ray, hit)
    }
}

/// Holes of the flattened scene.
struct Holes<'a> {
    masks: &'a AlphaMasks,
    primitives: &'a Primitives,
    asked: Asked,
}

impl HitFilter for Holes<'_> {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        let (instance, triangle) = self.primitives.locate(primitive);
        self.masks.is_solid(self.primitives.mesh(instance), triangle, u, v, self.asked)
    }
}

impl RayQueries for SceneRays {
    type Scratch = Scratch;

    fn closest(&self, ray: &Ray, scratch: &mut Scratch) -> Option<RayHit> {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Nearest) => {
                tree.closest(ray, &AcceptAll, scratch)
            }
            Tree::Flattened(tree) => tree.closest(ray, &self.holes(Asked::Nearest), scratch),
            Tree::TwoLevel(trees) => trees.closest(ray, &self.primitives, &self.alpha, scratch),
        }
    }

    fn occluded(&self, segment: &Segment, scratch: &mut Scratch) -> bool {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Occlusion) => {
                tree.occluded(segment, &AcceptAll, scratch)
            }
            Tree::Flattened(tree) => tree.occluded(segment, &self.holes(Asked::Occlusion), scratch),
            Tree::TwoLevel(trees) => {
                trees.occluded(segment, &self.primitives, &self.alpha, scratch).is_some()
            }
        }
    }

    fn closest_each(&self, rays: &[Ray], hits: &mut [Option<RayHit>], scratch: &mut Scratch) {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Nearest) => {
                tree.closest_each(rays, hits, &AcceptAll, scratch);
            }
            Tree::Flattened(tree) => tree.closest_each(rays, hits, &self.holes(Asked::Nearest), scratch),
            Tree::TwoLevel(_) => {
                assert_eq!(rays.len(), hits.len(), "one hit per ray");
                for (ray, hit) in rays.iter().zip(hits) {
                    *hit = self.closest(ray, scratch);
                }
            }
        }
    }

    fn occluded_each(&self, segments: &[Segment], occluded: &mut [bool], scratch: &mut Scratch) {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Occlusion) => {
                tree.occluded_each(segments, occluded, &AcceptAll, scratch);
            }
            Tree::Flattened(tree) => {
                tree.occluded_each(segments, occluded, &self.holes(Asked::Occlusion), scratch);
            }
            Tree::TwoLevel(_) => {
                assert_eq!(segments.len(), occluded.len(), "one answer per segment");
                for (segment, occluded) in segments.iter().zip(occluded) {
                    *occluded = self.occluded(segment, scratch);
                }
            }
        }
    }

    /// `blocker` is a leaf of the flattened tree, or an instance of two levels. Any value is allowed.
    fn occluded_via(&self, segment: &Segment, blocker: &mut u32, scratch: &mut Scratch) -> bool {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Occlusion) => {
                tree.occluded_via(segment, blocker, &AcceptAll, scratch)
            }
            Tree::Flattened(tree) => {
                tree.occluded_via(segment, blocker, &self.holes(Asked::Occlusion), scratch)
            }
            Tree::TwoLevel(trees) => {
                if trees.occluded_by(*blocker, segment, &self.primitives, &self.alpha, scratch) {
                    return true;
                }
                match trees.occluded(segment, &self.primitives, &self.alpha, scratch) {
                    Some(instance) => {
                        *blocker = instance;
                        true
                    }
                    None => false,
                }
            }
        }
    }

    fn occluded_from(&self, origin: Vec3, targets: &[Vec3], occluded: &mut [bool], scratch: &mut Scratch) {
        match &self.tree {
            Tree::Flattened(tree) if !self.alpha.any(Asked::Occlusion) => {
                tree.occluded_from(origin, targets, occluded, &AcceptAll, scratch);
            }
            Tree::Flattened(tree) => {
                tree.occluded_from(origin, targets, occluded, &self.holes(Asked::Occlusion), scratch);
            }
            Tree::TwoLevel(trees) => {
                assert_eq!(targets.len(), occluded.len(), "one answer per target");
                trees.occluded_from(origin, targets, occluded, &self.primitives, &self.alpha, scratch);
            }
        }
    }
}
