//! From the camera to the points that have to be lit: hits, specular chains, shading points.

use glam::{Vec2, Vec3, Vec4};
use lighttree::rng::{Random, pcg4d, unit_f32};
use lighttree::{LightId, Ray, RayHit, RayQueries, Receiver, ScatterLobes, Segment, Toward};

use crate::bsdf::{Bsdf, Dielectric, Ggx, Phong, Transport};
use crate::light::{LightPoint, Profile};
use crate::render::{Counts, Frame};
use crate::{Camera, DistantLight, Material, Scene, Surface, TextureSlot};

/// Rays against a [`Scene`], and what their answers mean to a shader.
///
/// Nearest hits are those of all surfaces, but for the holes of alpha masks. Segments pass blended surfaces
/// where these have less than [`Material::SOLID_ALPHA`], too.
pub trait Geometry: RayQueries + Sync {
    /// The surface that `hit` of `ray` found.
    fn surface(&self, scene: &Scene, ray: &Ray, hit: &RayHit) -> Surface;
}

/// A point to be lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingPoint {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal of the triangle, on the viewer's side.
    pub geometric_normal: Vec3,
    /// Unit shading normal, on the viewer's side: the viewer is never below its horizon.
    pub normal: Vec3,
    /// Unit direction to the viewer, or to the last vertex of the path.
    pub wo: Vec3,
    /// What the surface does; never specular.
    pub bsdf: Bsdf,
    /// What the specular chain between camera and point lets through, per channel.
    pub throughput: Vec3,
    /// Index of the pixel, row by row.
    pub pixel: u32,
    /// Index of the camera sample within the pixel.
    pub sample: u32,
    /// Distance along the geometric normal that takes a ray's start safely off the surface.
    pub offset: f32,
}

impl Receiver for ShadingPoint {
    fn position(&self) -> Vec3 {
        self.position
    }

    /// Excludes [`throughput`](ShadingPoint::throughput), which is the same for every light.
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.bsdf.scatter_bound(self.position, self.normal, self.wo, toward)
    }

    fn scatter_importance(&self, toward: &Toward) -> f32 {
        self.bsdf.scatter_importance(self.position, self.normal, self.wo, toward)
    }

    #[inline]
    fn lobes(&self) -> Option<ScatterLobes> {
        self.bsdf.lobes(self.position, self.normal, self.wo)
    }
}

impl ShadingPoint {
    /// Random numbers of this camera sample for `purpose`, which keeps the streams of different stages apart.
    pub const fn random(&self, seed: u32, purpose: Purpose) -> Random {
        Random::new(seed ^ purpose.salt(), self.pixel, self.sample)
    }

    /// Where on light `id` point `number` of the `count` points lies that this camera sample takes: for
    /// [`Light::point`](crate::Light::point), which has a use for it where the light has an area.
    ///
    /// Over points and samples of a pixel an Owen-scrambled Sobol sequence (Burley 2020), another one for
    /// each light, so that few points are spread evenly over each light.
    #[inline]
    pub fn place_on_light(&self, seed: u32, id: LightId, number: u32, count: u32) -> [f32; 2] {
        // The sequence ends after 2¹⁶ points; what lies beyond gets another.
        let at = u64::from(self.sample) * u64::from(count) + u64::from(number);
        let (index, epoch) = ((at & 0xffff) as u32, (at >> 16) as u32);
        let seed = pcg4d([seed ^ Purpose::Lights.salt(), self.pixel, id.0, epoch])[0];
        let [u, v, ..] = sobol_burley::sample_4d(index, 0, seed);
        [u, v]
    }

    /// Where a ray that leaves the surface on the viewer's side starts.
    #[inline]
    pub fn origin(&self) -> Vec3 {
        self.position + self.offset * self.geometric_normal
    }

    /// What `light` contributes per channel, unoccluded, for the point's `throughput` = 1: `f_s` · cos θ · I
    /// / d². Zero where either side faces away, the geometric side included.
    #[inline]
    pub fn contribution(&self, light: &LightPoint) -> Vec3 {
        // The cheapest question first: about half of all lights are below the surface.
        let to = light.position.as_dvec3() - self.position.as_dvec3();
        if self.geometric_normal.as_dvec3().dot(to) <= 0.0 {
            return Vec3::ZERO;
        }
        // In f64, where squares and differences of f32 lose neither digits nor range.
        let inverse_squared = 1.0 / to.length_squared();
        let wi = (to * inverse_squared.sqrt()).as_vec3();
        let intensity = light.intensity_toward(-wi);
        if intensity == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let scatter = self.bsdf.scatter(self.normal, self.wo, wi);
        (scatter.as_dvec3() * intensity.as_dvec3() * inverse_squared).as_vec3()
    }

    /// [`contribution`](Self::contribution), with that of a virtual point light cut off: its geometry term
    /// cos θ cos θl / d² counts as at most `clamp` (per squared length unit; infinite: unchanged). Also
    /// returns what the cut took away.
    #[inline]
    pub fn clamped_contribution(&self, light: &LightPoint, clamp: f32) -> (Vec3, Vec3) {
        let full = self.contribution(light);
        let Profile::Cosine { normal, virtual_light: true, .. } = light.profile else {
            return (full, Vec3::ZERO);
        };
        if clamp == f32::INFINITY || full == Vec3::ZERO {
            return (full, Vec3::ZERO);
        }
        let Some((wi, squared)) = light.from(self.position) else { return (full, Vec3::ZERO) };
        let geometry = f64::from(self.normal.dot(wi) * -normal.dot(wi)) / squared;
        if geometry <= f64::from(clamp) {
            return (full, Vec3::ZERO);
        }
        let kept = full * (f64::from(clamp) / geometry) as f32;
        (kept, full - kept)
    }

    /// What parallel light gives per channel, unoccluded, for the point's `throughput` = 1.
    pub fn distant_contribution(&self, light: &DistantLight) -> Vec3 {
        let wi = -light.direction;
        if self.geometric_normal.dot(wi) <= 0.0 {
            return Vec3::ZERO;
        }
        self.bsdf.scatter(self.normal, self.wo, wi) * light.irradiance
    }

    /// The segment that a shadow ray to `light` has to be clear along.
    #[inline]
    pub fn segment(&self, light: &LightPoint) -> Segment {
        Segment { from: self.origin(), to: light.end_toward(self.position) }
    }
}

/// What random numbers are for: one stream each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Place in the pixel, coverage, reflection or transmission up to the shading point.
    Camera,
    /// Choice of lights and of points on them.
    Lights,
    /// Paths beyond the shading point.
    Path,
    /// Particles from the lights.
    Particles,
    /// Which pixels are drawn.
    Pixels,
    /// Which pixel speaks for a block of them.
    Blocks,
}

impl Purpose {
    /// Xored to the seed.
    pub const fn salt(self) -> u32 {
        (self as u32).wrapping_mul(0x9e37_79b9)
    }
}

/// A material with its textures looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLook {
    /// Linear RGB.
    pub base_color: Vec3,
    /// In [0, 1].
    pub alpha: f32,
    /// In [0, 1].
    pub metallic: f32,
    /// In [0, 1].
    pub roughness: f32,
    /// Emitted radiance on the emitting side, W·m⁻²·sr⁻¹.
    pub emission: Vec3,
}

impl Material {
    /// Textures looked up at `uvs` (both sets).
    pub fn look(&self, scene: &Scene, uvs: [Vec2; 2]) -> SurfaceLook {
        let sample = |slot: Option<TextureSlot>| {
            slot.map_or(Vec4::ONE, |slot| {
                let uv = slot.transform.transform_point2(uvs[usize::from(slot.uv_set.min(1))]);
                scene.textures[slot.texture as usize].sample(uv)
            })
        };
        let base = sample(self.base_color_texture);
        let rough = sample(self.metallic_roughness_texture);
        SurfaceLook {
            base_color: self.base_color * base.truncate(),
            alpha: self.alpha * base.w,
            metallic: self.metallic * rough.z,
            roughness: self.roughness * rough.y,
            emission: if self.emissive == Vec3::ZERO {
                Vec3::ZERO
            } else {
                self.emissive * sample(self.emissive_texture).truncate()
            },
        }
    }

    /// What the surface does to light where it looks like `look`, seen on its front or back. A transmissive
    /// material is glass with the probability of what it transmits: `u` in [0, 1) decides.
    pub fn bsdf(&self, look: &SurfaceLook, front: bool, u: f32) -> Bsdf {
        if self.mirror {
            return Bsdf::Mirror { reflectance: look.base_color };
        }
        if u < self.transmission * (1.0 - look.metallic) {
            let eta = if front || self.thin { self.ior } else { 1.0 / self.ior };
            return Bsdf::Dielectric(Dielectric { eta, thin: self.thin, tint: look.base_color });
        }
        if let Some(exponent) = self.phong_exponent {
            return Bsdf::Phong(Phong::over(look.base_color, exponent));
        }
        if look.metallic == 0.0 && self.specular == 0.0 {
            return Bsdf::Lambert { albedo: look.base_color };
        }
        Bsdf::Ggx(Ggx::new(
            look.base_color,
            look.metallic,
            look.roughness,
            self.ior,
            self.specular,
            self.specular_color,
        ))
    }

    /// Radiance that leaves the surface on one side where it looks like `look`.
    pub fn emission(&self, look: &SurfaceLook, front: bool) -> Vec3 {
        if front || self.double_sided { look.emission } else { Vec3::ZERO }
    }
}

/// What a ray of a path meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// The point, with its BSDF, which may be specular here; throughput 1.
    pub point: ShadingPoint,
    /// Emitted radiance towards where the ray came from.
    pub emission: Vec3,
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index into that instance's triangles.
    pub triangle: u32,
}

/// How a ray treats `BLEND` surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// By chance, in proportion to alpha: what the camera sees.
    Stochastic,
    /// Solid from [`Material::SOLID_ALPHA`], absent below, as shadow rays have it: a path and a shadow ray
    /// must agree on what is lit.
    Threshold,
}

/// Steps of one chain after which it is given up and counted: more glass and mirrors than a picture shows.
pub const MAX_CHAIN: u32 = 64;

/// The first surface on `ray` that is there for it. Counts the rays cast.
pub fn vertex<Q: Geometry>(
    frame: &Frame<'_, Q>,
    mut ray: Ray,
    coverage: Coverage,
    random: &mut Random,
    scratch: &mut Q::Scratch,
    counts: &mut Counts,
) -> Option<Vertex> {
    for _ in 0..MAX_CHAIN {
        counts.closest_hit_rays += 1;
        let hit = frame.rays.closest(&ray, scratch)?;
        match found(frame, &ray, &hit, coverage, random) {
            Found::Surface(vertex) => return Some(vertex),
            Found::Nothing(next) => ray = next,
        }
    }
    counts.chains_cut += 1;
    None
}

/// What a hit turned out to be.
enum Found {
    Surface(Vertex),
    /// Not covered: go on with this ray.
    Nothing(Ray),
}

/// Makes a vertex of a hit, or a ray beyond it.
fn found<Q: Geometry>(
    frame: &Frame<'_, Q>,
    ray: &Ray,
    hit: &RayHit,
    coverage: Coverage,
    random: &mut Random,
) -> Found {
    let surface = frame.rays.surface(frame.scene, ray, hit);
    let material = &frame.scene.materials[surface.material as usize];
    let look = material.look(frame.scene, [surface.uv, surface.uv1]);
    let covered = match coverage {
        Coverage::Stochastic => !material.is_blended() || random.f32() < look.alpha,
        Coverage::Threshold => material.shadow_cutoff().is_none_or(|cutoff| look.alpha >= cutoff),
    };
    if !covered {
        return Found::Nothing(Ray { origin: surface.offset(ray.direction), ..*ray });
    }
    let wo = -ray.direction.normalize();
    let geometric_normal = surface.facing_normal();
    let choice = if material.transmission > 0.0 { random.f32() } else { 0.0 };
    let point = ShadingPoint {
        position: surface.position,
        geometric_normal,
        normal: visible_normal(surface.facing_shading_normal(), geometric_normal, wo),
        wo,
        bsdf: material.bsdf(&look, surface.front, choice),
        throughput: Vec3::ONE,
        pixel: 0,
        sample: 0,
        offset: surface.error,
    };
    let emission = material.emission(&look, surface.front);
    Found::Surface(Vertex { point, emission, instance: surface.instance, triangle: surface.triangle })
}

/// The shading normal, turned as little as needed where it faces away from a viewer who sees the surface: at
/// silhouettes of smooth-shaded meshes.
fn visible_normal(shading: Vec3, geometric: Vec3, wo: Vec3) -> Vec3 {
    let cos = shading.dot(wo);
    if cos > 0.0 {
        return shading;
    }
    // To just above the horizon of `wo`; the geometric normal where even that fails.
    let turned = (shading + (1e-3 - cos) * wo).normalize_or(geometric);
    if turned.dot(wo) > 0.0 { turned } else { geometric }
}

impl Vertex {
    /// The ray that goes on in the direction `wi`.
    pub fn leave(&self, wi: Vec3) -> Ray {
        self.point.leave(wi)
    }
}

impl ShadingPoint {
    /// The ray that leaves in the direction `wi`, to either side.
    pub fn leave(&self, wi: Vec3) -> Ray {
        let side = if self.geometric_normal.dot(wi) >= 0.0 { self.offset } else { -self.offset };
        Ray { origin: self.position + side * self.geometric_normal, direction: wi, t_max: f32::INFINITY }
    }
}

/// 2^32 ÷ g and 2^32 ÷ g², g³ = g + 1.
const R2: [u32; 2] = [0xc13f_a9a9, 0x91e1_0da6];

/// The ray of camera sample `sample` of a pixel, given by its index, and the random numbers for what it
/// meets: the same wherever it is asked for.
///
/// Places in the pixel follow Roberts' R2 sequence ("The Unreasonable Effectiveness of Quasirandom
/// Sequences", 2018) from a random start in each pixel: any number of samples is spread evenly, and each is
/// uniform by itself.
pub fn camera_ray(
    camera: &Camera,
    seed: u32,
    (width, height): (u32, u32),
    pixel: u32,
    sample: u32,
) -> (Ray, Random) {
    let random = Random::new(seed ^ Purpose::Camera.salt(), pixel, sample);
    let corner = Vec2::new((pixel % width) as f32, (pixel / width) as f32);
    let [start_x, start_y, ..] = pcg4d([seed ^ Purpose::Camera.salt(), pixel, 0, u32::MAX]);
    let spread = |start: u32, step: u32| unit_f32(start.wrapping_add(sample.wrapping_mul(step)));
    let at = corner + Vec2::new(spread(start_x, R2[0]), spread(start_y, R2[1]));
    (camera.ray(at, width, height), random)
}

/// What the camera sees along one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPath {
    /// Radiance of emitters seen directly, through glass or in mirrors.
    pub emission: Vec3,
    /// What has to be lit, if anything.
    pub point: Option<ShadingPoint>,
}

/// Follows a camera ray, whose first hit is known already, through mirrors and glass to a point to be lit.
#[expect(clippy::too_many_arguments, reason = "the caller's own state, not worth a struct for two callers")]
pub fn camera_path<Q: Geometry>(
    frame: &Frame<'_, Q>,
    ray: &Ray,
    first: Option<RayHit>,
    pixel: u32,
    sample: u32,
    random: &mut Random,
    scratch: &mut Q::Scratch,
    counts: &mut Counts,
) -> CameraPath {
    let mut path = CameraPath { emission: Vec3::ZERO, point: None };
    let mut throughput = Vec3::ONE;
    let Some(hit) = first else { return path };
    let mut next = match found(frame, ray, &hit, Coverage::Stochastic, random) {
        Found::Surface(vertex) => Some(vertex),
        Found::Nothing(ray) => vertex(frame, ray, Coverage::Stochastic, random, scratch, counts),
    };
    for _ in 0..MAX_CHAIN {
        let Some(found) = next else { return path };
        path.emission += throughput * found.emission;
        let point = found.point;
        if !point.bsdf.is_specular() {
            path.point = Some(ShadingPoint { throughput, pixel, sample, ..point });
            return path;
        }
        let u = [random.f32(), 0.0, 0.0];
        let Some(step) = point.bsdf.sample(point.normal, point.wo, u, Transport::Radiance) else {
            return path;
        };
        throughput *= step.weight;
        if throughput == Vec3::ZERO {
            return path;
        }
        next = vertex(frame, point.leave(step.wi), Coverage::Stochastic, random, scratch, counts);
    }
    counts.chains_cut += 1;
    path
}
