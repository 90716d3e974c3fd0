//! A path tracer of another kind: its own triangles, rays, material and lamps. Of this workspace it uses
//! `lighttree` and `stochastic`, nothing else.
//!
//! At each vertex of a path it draws a light from each subtree of a cut, and a direction from its material; a
//! lamp that either may find is weighed by the balance heuristic (Veach 1997), for which the sampler says how
//! often it would have drawn the lamp that a ray ran into. Writes a PPM if the first argument names one.

use core::f32::consts::{PI, TAU};

use glam::{Quat, Vec3};
use lighttree::rng::{Decisions, Random};
use lighttree::{BuildParams, Emitter, LightBounds, LightId, LightTree, Receiver, Toward};
use stochastic::{CutParams, CutSampler, Selection};

pub(crate) const SIZE: u32 = 96;

/// Who finds lamps: draws of lights, directions of the material, or both.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum FoundBy {
    Lights,
    Material,
    Both,
}

pub(crate) struct Triangle {
    pub(crate) corners: [Vec3; 3],
    albedo: Vec3,
    gloss: f32,                // share of light that goes into a Phong lobe
    pub(crate) radiance: Vec3, // of its front; lamps reflect nothing
}
const EXPONENT: f32 = 60.0;

impl Triangle {
    fn area_vector(&self) -> Vec3 {
        let [a, b, c] = self.corners;
        0.5 * (b - a).cross(c - a)
    }
    /// The point at (u, v) of the unit square, uniform by area.
    pub(crate) fn point(&self, u: f32, v: f32) -> Vec3 {
        let ([a, b, c], root) = (self.corners, u.sqrt());
        a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v)
    }
}
impl Emitter for Triangle {
    fn bounds(&self) -> LightBounds {
        let ([a, b, c], n) = (self.corners, self.area_vector());
        let intensity = n.length() * self.radiance.max_element();
        LightBounds::surface(a.min(b).min(c), a.max(b).max(c), n.normalize(), false, intensity)
    }
}

pub(crate) struct Hit {
    pub(crate) at: Vec3,
    normal: Vec3, // towards the viewer
    mirrored: Vec3,
    albedo: Vec3,
    gloss: f32,
    pub(crate) triangle: usize,
    pub(crate) front: bool,
}
impl Hit {
    /// BSDF × cosine.
    pub(crate) fn scatter(&self, to: Vec3) -> Vec3 {
        let lobe = (EXPONENT + 2.0) / TAU * self.mirrored.dot(to).max(0.0).powf(EXPONENT);
        (self.albedo * ((1.0 - self.gloss) / PI) + self.gloss * lobe) * self.normal.dot(to).max(0.0)
    }
    /// A direction and how probable it is, per steradian.
    fn sample(&self, random: &mut Random) -> (Vec3, f32) {
        let (axis, power) =
            if random.f32() < self.gloss { (self.mirrored, EXPONENT) } else { (self.normal, 1.0) };
        let (cos, turn) = ((1.0 - random.f32()).powf(1.0 / (power + 1.0)), TAU * random.f32());
        let aside = (1.0 - cos * cos).max(0.0).sqrt();
        let to =
            Quat::from_rotation_arc(Vec3::Z, axis) * Vec3::new(aside * turn.cos(), aside * turn.sin(), cos);
        (to, self.density(to))
    }
    fn density(&self, to: Vec3) -> f32 {
        let lobe = (EXPONENT + 1.0) / TAU * self.mirrored.dot(to).max(0.0).powf(EXPONENT);
        (1.0 - self.gloss) * self.normal.dot(to).max(0.0) / PI + self.gloss * lobe
    }
}
impl Receiver for Hit {
    fn position(&self) -> Vec3 {
        self.at
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        let lobe = (EXPONENT + 2.0) / TAU * toward.max_cos(self.mirrored).max(0.0).powf(EXPONENT);
        let diffuse = self.albedo.max_element() * (1.0 - self.gloss) / PI;
        (diffuse + self.gloss * lobe) * toward.max_cos(self.normal).max(0.0)
    }
}

/// Triangles, of which the first are lamps.
pub(crate) struct World {
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) lamps: usize,
}
impl World {
    /// A room with a glossy floor, a box, and panels of lamps of many colours and sizes under the ceiling and
    /// along a wall.
    pub(crate) fn new(lamps: usize) -> Self {
        let mut triangles = Vec::new();
        let rows = lamps.div_ceil(10);
        for i in 0..lamps {
            let (column, row) = ((i % 10) as f32, (i / 10) as f32 * 4.2 / rows as f32 + 0.2);
            let (share, hue) = ((0.618 * i as f32).fract(), (0.37 * i as f32).fract());
            let size = (0.2 + 0.7 * share) * (4.2 / rows as f32).min(0.4);
            let (at, u, v) = match i % 3 {
                0 => (Vec3::new(1.99, 0.4 + 0.2 * column, row), Vec3::Y, Vec3::Z),
                _ => (Vec3::new(0.4 * column - 1.9, 2.9, row), Vec3::X, Vec3::Z),
            };
            let radiance = Vec3::new(1.0, hue, 1.0 - hue) * (30.0 / lamps as f32 / size);
            let corners = if i % 3 == 0 {
                [at, at + size * v, at + size * u]
            } else {
                [at, at + size * u, at + size * v]
            };
            triangles.push(Triangle { corners, albedo: Vec3::ZERO, gloss: 0.0, radiance });
        }
        let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 3.0, Vec3::Z * 5.0);
        let (corner, white) = (Vec3::new(-2.0, 0.0, 0.0), Vec3::splat(0.7));
        let (foot, u, v) = (Vec3::new(-1.0, 0.0, 2.8), Vec3::new(1.0, 0.0, 0.4), Vec3::new(-0.4, 0.0, 1.0));
        for (at, u, v, albedo, gloss) in [
            (corner, z, x, Vec3::new(0.4, 0.35, 0.3), 0.4),
            (corner + y, x, z, white, 0.0),
            (corner + z, y, x, white, 0.0),
            (corner, y, z, Vec3::new(0.6, 0.2, 0.1), 0.0),
            (corner + x, z, y, white, 0.0),
            (foot, u, Vec3::Y, white, 0.0),
            (foot, Vec3::Y, v, white, 0.0),
            (foot + Vec3::Y, u, v, white, 0.5),
        ] {
            for corners in [[at, at + u, at + u + v], [at, at + u + v, at + v]] {
                triangles.push(Triangle { corners, albedo, gloss, radiance: Vec3::ZERO });
            }
        }
        Self { triangles, lamps }
    }
    pub(crate) fn trace(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Hit)> {
        let distance = |triangle: &Triangle| {
            let [a, b, c] = triangle.corners;
            let (ab, ac, s) = (b - a, c - a, origin - a);
            let (p, q) = (direction.cross(ac), s.cross(ab));
            let (u, v, t) = (s.dot(p) / ab.dot(p), direction.dot(q) / ab.dot(p), ac.dot(q) / ab.dot(p));
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-4).then_some(t)
        };
        let hits = self.triangles.iter().enumerate().filter_map(|(i, t)| Some((distance(t)?, i)));
        let (t, index) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let triangle = &self.triangles[index];
        let along = triangle.area_vector().normalize();
        let front = along.dot(direction) < 0.0;
        let normal = if front { along } else { -along };
        let mirrored = direction - 2.0 * normal.dot(direction) * normal;
        let at = origin + t * direction + 1e-4 * normal;
        Some((
            t,
            Hit {
                at,
                normal,
                mirrored,
                albedo: triangle.albedo,
                gloss: triangle.gloss,
                triangle: index,
                front,
            },
        ))
    }
    pub(crate) fn visible(&self, from: Vec3, to: Vec3) -> bool {
        self.trace(from, to - from).is_none_or(|(t, _)| t > 0.999)
    }
    /// Per steradian as seen from `from`, of a point at `at` that is uniform on lamp `lamp`; 0 if that is
    /// turned away.
    fn solid_angle_density(&self, lamp: usize, from: Vec3, at: Vec3) -> f32 {
        let (to, area) = (at - from, self.triangles[lamp].area_vector());
        let facing = -area.dot(to.normalize());
        if facing > 0.0 { to.length_squared() / facing } else { 0.0 }
    }
}

/// Light along a ray over so many bounces.
pub(crate) fn radiance(
    (world, sampler): (&World, &CutSampler<'_, LightTree>),
    (mut origin, mut direction): (Vec3, Vec3),
    (bounces, find): (u32, FoundBy),
    random: &mut Decisions,
    selection: &mut Selection,
) -> Vec3 {
    let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
    let mut last: Option<(Hit, f32)> = None; // where the ray comes from, and how probable its direction was
    for bounce in 0..=bounces {
        let Some((_, hit)) = world.trace(origin, direction) else { break };

        // A lamp: how often would the cut of the last vertex have drawn it?
        if hit.triangle < world.lamps {
            let weight = match &last {
                _ if !hit.front => 0.0,
                None => 1.0,
                Some(_) if find == FoundBy::Lights => 0.0,
                Some(_) if find == FoundBy::Material => 1.0,
                Some((from, by_material)) => {
                    let drawn = sampler.density(selection.nodes(), from, LightId(hit.triangle as u32)) as f32;
                    by_material
                        / (by_material + drawn * world.solid_angle_density(hit.triangle, from.at, hit.at))
                }
            };
            sum += weight * throughput * world.triangles[hit.triangle].radiance;
            break;
        }
        if bounce == bounces {
            break;
        }

        // One lamp from each subtree of a cut.
        sampler.select(&hit, selection);
        if find != FoundBy::Material {
            sampler.subtrees(selection.nodes()).draw_each(&hit, random, |_, sample, random| {
                let lamp = sample.light.0 as usize;
                let numbers = random.stream();
                let at = world.triangles[lamp].point(numbers.f32(), numbers.f32());
                let density = sample.pmf as f32 * world.solid_angle_density(lamp, hit.at, at);
                let to = (at - hit.at).normalize();
                let value = hit.scatter(to) * world.triangles[lamp].radiance;
                if density > 0.0 && value != Vec3::ZERO && world.visible(hit.at, at) {
                    let by_material = if find == FoundBy::Both { hit.density(to) } else { 0.0 };
                    sum += throughput * value / (density + by_material);
                }
            });
        }

        // One direction from the material.
        let (to, density) = hit.sample(random.stream());
        throughput *= hit.scatter(to) / density;
        if throughput == Vec3::ZERO {
            break;
        }
        (origin, direction) = (hit.at, to);
        last = Some((hit, density));
    }
    sum
}

pub(crate) fn camera_ray(x: f32, y: f32) -> (Vec3, Vec3) {
    let at = Vec3::new(2.0 * x / SIZE as f32 - 1.0, 0.85 - 2.0 * y / SIZE as f32, 1.3);
    (Vec3::new(0.0, 1.4, 0.1), at.normalize())
}

pub(crate) fn cuts(tree: &LightTree) -> CutSampler<'_, LightTree> {
    CutSampler::new(tree, CutParams::with_nodes(4))
}

fn main() -> std::io::Result<()> {
    let world = World::new(300);
    let tree =
        LightTree::build(&world.triangles[..world.lamps], &BuildParams::default()).expect("lamps are finite");
    let (sampler, mut selection) = (cuts(&tree), Selection::default());
    let mut picture = Vec::new();
    for pixel in 0..SIZE * SIZE {
        let mut sum = Vec3::ZERO;
        for sample in 0..16 {
            let mut random = Decisions::new(Random::new(1, pixel, sample));
            let stream = random.stream();
            let (x, y) = ((pixel % SIZE) as f32 + stream.f32(), (pixel / SIZE) as f32 + stream.f32());
            sum += radiance(
                (&world, &sampler),
                camera_ray(x, y),
                (4, FoundBy::Both),
                &mut random,
                &mut selection,
            );
        }
        picture.push(sum / 16.0);
    }
    println!("{} lamps, mean {:.3}", world.lamps, picture.iter().sum::<Vec3>() / picture.len() as f32);
    let Some(path) = std::env::args_os().nth(1) else { return Ok(()) };
    let encode = |c: f32| (255.0 * c.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
    let mut bytes = format!("P6 {SIZE} {SIZE} 255\n").into_bytes();
    bytes.extend(picture.iter().flat_map(|c| c.to_array()).map(encode));
    std::fs::write(path, bytes)
}
