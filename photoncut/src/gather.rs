//! Final gather at one point: rays spread by a lattice over the cosine or over a guide's density, and what
//! follows from them.
//!
//! Ward, Rubinstein and Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988; gradients: Ward
//! and Heckbert, "Irradiance Gradients", 1992, section 3. Differs from the paper for which this is (Wang et
//! al. 2009): rays are a lattice of rank 1 by the golden ratio, with a shift of its own for each point
//! (Cranley and Patterson, "Randomization of Number Theoretic Methods for Multiple Integration", 1976), which
//! has less noise than Ward's strata; they may go where a [`Guide`] says that light is; gradients are those
//! of the means of cells with some rays each, so that no strata are needed; and the harmonics are weighted so
//! that each ring counts as its solid angle, where π ÷ cosine alone has no bound at the horizon.

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::rng::{Random, unit_f32};

use crate::RadianceSh;
use crate::guide::{self, Guide, Met};

/// How to gather. Any values may be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GatherParams {
    /// Rays: 250 to 500 in the paper; 0 counts as 1, and more than 2²⁰ as that.
    pub rays: u32,
    /// Of the lattice's shift.
    pub seed: u32,
}

impl GatherParams {
    /// Rays that are cast.
    pub fn count(&self) -> u32 {
        self.rays.clamp(1, 1 << 20)
    }
}

/// Rings and sectors of about `cells` cells of like solid angle times cosine, about π times as many sectors
/// as rings (Ward 1988).
fn grid(cells: u32) -> (u32, u32) {
    let rings = ((cells as f32 / PI).sqrt().round() as u32).max(1);
    (rings, cells.div_ceil(rings).max(1))
}

/// Rays to a cell whose mean tells gradients: few make them noisy, many blur them.
const RAYS_PER_CELL: u32 = 4;

/// What comes along one gather ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incoming {
    /// W·m⁻²·sr⁻¹ per channel.
    pub radiance: Vec3,
    /// How far away it comes from, in the scene's length unit; infinite where nothing was hit.
    pub distance: f32,
}

/// What was gathered at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GatherSample {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// W·m⁻² per channel.
    pub irradiance: Vec3,
    /// Harmonic mean of the distances, in the scene's length unit; infinite where no ray hit anything.
    pub mean_distance: f32,
    /// How the irradiance changes as the normal turns: for a turn by the vector ω (axis × radians) channel
    /// `c` changes by ω · `rotation[c]`.
    pub rotation: [Vec3; 3],
    /// How it changes as the point moves within the surface, per length unit, channel by channel.
    pub translation: [Vec3; 3],
    /// Rays that it is from: what it is worth beside others.
    pub rays: u32,
}

/// Memory of a gather, reused from point to point.
#[derive(Clone, Debug, Default)]
pub struct GatherScratch {
    rays: Vec<Cast>,
    cells: Vec<Cell>,
    /// Shares of the rays of each ring.
    rings: Vec<f32>,
}

impl GatherScratch {
    /// Where the rays of the last gather, which was at `position`, ended, for [`Guide::toward`]. What hit
    /// nothing is very far away.
    pub fn met(&self, position: Vec3) -> impl ExactSizeIterator<Item = Met> + '_ {
        self.rays.iter().map(move |ray| {
            let far = ray.found.distance.min(0.1 * f32::MAX);
            Met { position: position + far * ray.direction, radiance: ray.found.radiance.element_sum() / 3.0 }
        })
    }
}

/// A ray that was cast.
#[derive(Clone, Copy, Debug)]
struct Cast {
    direction: Vec3,
    /// sin² θ and φ ÷ 2π.
    at: [f32; 2],
    /// Inverse of its density against the cosine's.
    weight: f32,
    found: Incoming,
}

/// Weighted means of the rays of a part of the hemisphere.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    radiance: Vec3,
    inverse_distance: f32,
    /// 0: no ray went there.
    weight: f32,
}

/// Casts rays from `position` over the hemisphere of the unit `normal`, in proportion to the cosine or to the
/// density of `guide`, and asks `incoming` what comes from each unit direction. `index` is the number of the
/// point: together with the seed it decides all random numbers, of which `incoming` may take more.
///
/// The irradiance is right in the mean with any guide that knows nothing of these very rays. With `radiance`,
/// the harmonics of what comes in are added to it: 16 × 3 sums per ray.
#[expect(clippy::too_many_arguments, reason = "where, how, by what, into what, and what is there")]
pub fn gather(
    position: Vec3,
    normal: Vec3,
    index: u32,
    params: &GatherParams,
    guide: Option<&Guide>,
    scratch: &mut GatherScratch,
    radiance: Option<&mut RadianceSh>,
    mut incoming: impl FnMut(Vec3, &mut Random) -> Incoming,
) -> GatherSample {
    let rays = params.count();
    let (x, y) = normal.any_orthonormal_pair();
    let mut random = Random::new(params.seed, index, 0);
    let (shift, turn) = (random.f32(), random.u32());
    scratch.rays.clear();
    let mut sum = glam::DVec3::ZERO;
    let mut inverse_distance = 0.0f64;
    for ray in 0..rays {
        let along = ((ray as f32 + shift) / rays as f32).min(1.0 - f32::EPSILON);
        let even = [along, unit_f32(turn.wrapping_add(ray.wrapping_mul(GOLDEN)))];
        let (at, density) = guide.map_or((even, 1.0), |guide| guide.draw(even));
        let direction = guide::direction(at, [x, y, normal]);
        let found = incoming(direction, &mut random);
        let weight = 1.0 / density;
        sum += f64::from(weight) * found.radiance.as_dvec3();
        inverse_distance += f64::from(weight) / f64::from(found.distance);
        scratch.rays.push(Cast { direction, at, weight, found });
    }
    if let Some(sh) = radiance {
        add_harmonics(scratch, sh);
    }
    let (rotation, translation) = gradients(scratch, x, y);
    let count = f64::from(rays);
    GatherSample {
        position,
        normal,
        irradiance: (sum * (core::f64::consts::PI / count)).as_vec3(),
        mean_distance: (count / inverse_distance) as f32,
        rotation,
        translation,
        rays,
    }
}

/// 2³² over the golden ratio.
const GOLDEN: u32 = 0x9e37_79b9;

/// Adds the harmonics of what was found: each ring counts as its solid angle, and a ray of it in proportion
/// to its weight over its cosine.
fn add_harmonics(scratch: &mut GatherScratch, sh: &mut RadianceSh) {
    let GatherScratch { rays, rings: shares, .. } = scratch;
    let (rings, _) = grid(rays.len() as u32);
    let ring_of = |ray: &Cast| ((ray.at[0] * rings as f32) as usize).min(rings as usize - 1);
    let share = |ray: &Cast| ray.weight / (1.0 - ray.at[0]).max(0.0).sqrt().max(1e-4);
    shares.clear();
    shares.resize(rings as usize, 0.0);
    rays.iter().for_each(|ray| shares[ring_of(ray)] += share(ray));
    // Sine squared is uniform for cosine rays.
    let edge = |ring: usize| (1.0 - ring as f32 / rings as f32).sqrt();
    let solid_angle = |ring: usize| edge(ring) - edge(ring + 1);
    // Rings without a ray are spoken for by the others.
    let seen: f32 = (0..rings as usize).filter(|&ring| shares[ring] > 0.0).map(solid_angle).sum();
    for ray in rays.iter() {
        let ring = ring_of(ray);
        let part = 2.0 * PI * solid_angle(ring) / seen * (share(ray) / shares[ring]);
        sh.add(ray.direction, ray.found.radiance, part);
    }
}

/// Puts the rays in cells, ring by ring; the numbers of rings and sectors. Where no ray went, a cell is as
/// those beside it are.
fn fill_cells(scratch: &mut GatherScratch) -> (u32, u32) {
    let GatherScratch { rays, cells, .. } = scratch;
    let (rings, sectors) = grid(rays.len() as u32 / RAYS_PER_CELL);
    let index = |x: f32, parts: u32| ((x * parts as f32) as u32).min(parts - 1);
    cells.clear();
    cells.resize((rings * sectors) as usize, Cell::default());
    let mut all = Cell::default();
    for ray in rays.iter() {
        let place = index(ray.at[0], rings) * sectors + index(ray.at[1], sectors);
        for cell in [&mut cells[place as usize], &mut all] {
            cell.add(&Cell {
                radiance: ray.weight * ray.found.radiance,
                inverse_distance: ray.weight / ray.found.distance,
                weight: ray.weight,
            });
        }
    }
    cells.iter_mut().chain([&mut all]).for_each(Cell::divide);
    for i in 0..cells.len() as u32 {
        if cells[i as usize].weight > 0.0 {
            continue;
        }
        let (ring, sector) = (i / sectors, i % sectors);
        let mut beside = Cell::default();
        let [before, after] = [sector + sectors - 1, sector + 1].map(|s| ring * sectors + s % sectors);
        let [inner, outer] = [ring.checked_sub(1), (ring + 1 < rings).then_some(ring + 1)]
            .map(|ring| ring.map(|ring| ring * sectors + sector));
        for place in [Some(before), Some(after), inner, outer].into_iter().flatten() {
            let cell = &cells[place as usize];
            if cell.weight > 0.0 {
                beside.add(&Cell { weight: 1.0, ..*cell });
            }
        }
        beside.divide();
        let known = if beside.weight > 0.0 { beside } else { all };
        // It counts as empty still, so that what is filled in goes no farther.
        cells[i as usize] = Cell { weight: 0.0, ..known };
    }
    (rings, sectors)
}

impl Cell {
    fn add(&mut self, other: &Self) {
        self.radiance += other.radiance;
        self.inverse_distance += other.inverse_distance;
        self.weight += other.weight;
    }

    /// Sums to means.
    fn divide(&mut self) {
        if self.weight > 0.0 {
            self.radiance /= self.weight;
            self.inverse_distance /= self.weight;
        }
    }
}

/// Ward and Heckbert 1992, equations for the rotational and the translational gradient, with the means of
/// cells for what their single rays have.
fn gradients(scratch: &mut GatherScratch, x: Vec3, y: Vec3) -> ([Vec3; 3], [Vec3; 3]) {
    let (rings, sectors) = fill_cells(scratch);
    let cells = &scratch.cells;
    let at = |ring: u32, sector: u32| &cells[(ring * sectors + sector) as usize];
    let (mut rotation, mut translation) = ([Vec3::ZERO; 3], [Vec3::ZERO; 3]);
    let around = |turn: f32| {
        let (sin, cos) = (2.0 * PI * turn / sectors as f32).sin_cos();
        cos * x + sin * y
    };
    // Between cells whose rays ended near, light moves fast.
    let nearer = |a: &Cell, b: &Cell| a.inverse_distance.max(b.inverse_distance).min(1e20);
    for sector in 0..sectors {
        let middle = around(sector as f32 + 0.5);
        let across = around(sector as f32 + 0.5 + 0.25 * sectors as f32);
        let across_edge = around(sector as f32 + 0.25 * sectors as f32);
        let before = (sector + sectors - 1) % sectors;
        for ring in 0..rings {
            let here = at(ring, sector);
            let sin_low = (ring as f32 / rings as f32).sqrt();
            let sin_high = ((ring + 1) as f32 / rings as f32).sqrt();
            // Rotation: what is low over the horizon gains most. tan θ in the middle of the ring.
            let u = (ring as f32 + 0.5) / rings as f32;
            let tan = (u / (1.0 - u)).sqrt();
            let turn = PI / (rings * sectors) as f32 * tan * here.radiance;
            // Translation across sectors and across rings.
            let side = at(ring, before);
            let along = (sin_high - sin_low) * nearer(here, side) * (here.radiance - side.radiance);
            let mut outward = Vec3::ZERO;
            if ring > 0 {
                let inner = at(ring - 1, sector);
                let cos_squared = 1.0 - sin_low * sin_low;
                outward = 2.0 * PI / sectors as f32
                    * sin_low
                    * cos_squared
                    * nearer(here, inner)
                    * (here.radiance - inner.radiance);
            }
            for c in 0..3 {
                rotation[c] += turn[c] * across;
                translation[c] += outward[c] * middle + along[c] * across_edge;
            }
        }
    }
    (rotation, translation)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A guide leaves cells without a ray: they are as those beside them, and not dark.
    #[test]
    fn empty_cells_are_filled() {
        let found = Incoming { radiance: Vec3::ONE, distance: 2.0 };
        let ray = Cast { direction: Vec3::Z, at: [0.01, 0.01], weight: 0.5, found };
        let mut scratch = GatherScratch { rays: vec![ray; 40], ..GatherScratch::default() };
        let (rings, sectors) = fill_cells(&mut scratch);
        assert_eq!((rings * sectors) as usize, scratch.cells.len());
        assert!(scratch.cells.iter().all(|cell| cell.radiance == Vec3::ONE && cell.inverse_distance == 0.5));
    }
}
