//! A preview in another renderer: its own rays, material and lamps, exact lightcuts at some hundred places,
//! and everywhere else the cuts between them. Checks its light against every lamp. Exact cuts are the crate
//! `lightcut`'s here; any others will do.

use core::f32::consts::{FRAC_1_PI, TAU};

use cutinterp::{
    Hidden, LevelMetric, Levels, MergeCache, PlacementParams, Point, PointImage, Record, RecordGrid, Records,
    Selection, Visibility, place, sum_up,
};
use glam::Vec3;
use lightcut::{Choice, Lightcut, LightcutParams, Representatives, Scratch, Transfer};
use lighttree::rng::Random;
use lighttree::{BuildParams, Cut, GeometricBound, LambertReceiver, LightBounds, LightId, LightTree};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const EYE: Vec3 = Vec3::new(0.0, 2.5, 7.0);
const ALBEDO: f32 = 0.7;
/// Balls on a floor, y = 0: centre and radius.
const BALLS: [(Vec3, f32); 3] =
    [(Vec3::new(-1.5, 0.8, 0.0), 0.8), (Vec3::new(1.2, 0.5, 1.0), 0.5), (Vec3::new(0.4, 1.2, -2.5), 1.2)];

/// Distance and normal of the nearest surface.
fn trace(origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
    let floor = (direction.y < 0.0).then(|| (-origin.y / direction.y, Vec3::Y));
    let balls = BALLS.iter().filter_map(|&(center, radius)| {
        let to = origin - center;
        let b = to.dot(direction);
        let t = -b - (b * b - to.length_squared() + radius * radius).sqrt();
        (t > 0.0).then(|| (t, (to + t * direction) / radius))
    });
    floor.into_iter().chain(balls).min_by(|a, b| a.0.total_cmp(&b.0))
}

struct Surface {
    at: Vec3,
    normal: Vec3,
}

impl Surface {
    fn receiver(&self) -> LambertReceiver {
        LambertReceiver { position: self.at, normal: self.normal, albedo: ALBEDO }
    }
    /// What a lamp of intensity 1 would give without shadows.
    fn unoccluded(&self, lamp: Vec3) -> f32 {
        let to = lamp - self.at;
        ALBEDO * FRAC_1_PI * to.normalize().dot(self.normal).max(0.0) / to.length_squared()
    }
    fn sees(&self, lamp: Vec3) -> bool {
        let (from, distance) = (self.at + 1e-3 * self.normal, lamp.distance(self.at));
        trace(from, (lamp - from).normalize()).is_none_or(|(t, _)| t > distance)
    }
    /// Harmonic mean distance to what is around, by a few short rays.
    fn openness(&self, pixel: u32, limit: f32) -> f32 {
        const RAYS: u32 = 12;
        let (u, v) = self.normal.any_orthonormal_pair();
        let inverse = |ray| {
            let mut random = Random::new(5, pixel, ray);
            let (z, turn) = (random.f32(), TAU * random.f32());
            let out = (1.0 - z * z).sqrt();
            let direction = out * turn.cos() * u + out * turn.sin() * v + z * self.normal;
            let hit = trace(self.at + 1e-3 * self.normal, direction).filter(|&(t, _)| t < limit);
            hit.map_or(0.0, |(t, _)| 1.0 / t)
        };
        RAYS as f32 / (0..RAYS).map(inverse).sum::<f32>()
    }
}

fn main() -> Result<(), Box<dyn core::error::Error>> {
    // The host: lamps over the floor, and what each pixel sees.
    let lamps: Vec<Vec3> = (0..3000)
        .map(|i| {
            let mut random = Random::new(1, i, 0);
            Vec3::new(10.0 * random.f32() - 5.0, 4.5 + random.f32(), 10.0 * random.f32() - 7.0)
        })
        .collect();
    let color = Vec3::new(1.0, 0.8, 0.5) / lamps.len() as f32;
    let surfaces: Vec<Option<Surface>> = (0..WIDTH * HEIGHT)
        .map(|pixel| {
            let x = ((pixel % WIDTH) as f32 + 0.5) / WIDTH as f32 - 0.5;
            let y = (0.5 - ((pixel / WIDTH) as f32 + 0.5) / HEIGHT as f32) * HEIGHT as f32 / WIDTH as f32;
            let direction = Vec3::new(x, y - 0.35, -1.0).normalize();
            trace(EYE, direction).map(|(t, normal)| Surface { at: EYE + t * direction, normal })
        })
        .collect();

    // Trees, and the cuts that are to be interpolated.
    let bounds: Vec<_> = lamps.iter().map(|&at| LightBounds::point(at, color.max_element())).collect();
    let tree = LightTree::build(&bounds, &BuildParams::default())?;
    let representatives = Representatives::choose(&tree, Choice::Random { seed: 1 }, |_| color)?;
    let exact =
        Lightcut { tree: &tree, representatives: &representatives, params: LightcutParams::default() };
    let levels = Levels::measure(&tree, LevelMetric::default());

    // Choose places for records: dense in corners, sparse on open floor.
    let point = |surface: &Surface| {
        let to_eye = EYE - surface.at;
        let (side, cos) = (to_eye.length() / WIDTH as f32, to_eye.normalize().dot(surface.normal));
        let footprint = side / cos.max(0.01).sqrt();
        Point { position: surface.at, normal: surface.normal, footprint, spacing: side }
    };
    let points: Vec<_> = surfaces.iter().map(|surface| surface.as_ref().map(point)).collect();
    let image = PointImage { width: WIDTH, points: &points };
    let params = PlacementParams::default();
    let surface = |pixel: u32| surfaces[pixel as usize].as_ref().expect("a record is on a surface");
    let placed = place(&params, &image, &[], || (), |(), pixel, limit| surface(pixel).openness(pixel, limit));

    // Make an exact cut at each.
    let (mut records, mut cut, mut scratch) = (Records::default(), Cut::default(), Scratch::default());
    for at in &placed {
        let here = surface(at.pixel);
        let transfer = |light: LightId| {
            let lamp = lamps[light.index()];
            Transfer::new(Vec3::splat(here.unoccluded(lamp)), f32::from(here.sees(lamp)))
        };
        exact.cut(&here.receiver(), &GeometricBound, transfer, &mut scratch, &mut cut);
        let brightness: f64 = cut.values().iter().map(|estimate| estimate.luminance()).sum();
        let nodes = cut.iter().map(|(node, estimate)| (node, estimate.seen() > 0.5));
        let record = Record {
            site: at.site(),
            harmonic_mean: at.harmonic_mean,
            footprint: point(here).footprint,
            brightness: brightness as f32,
        };
        records.push(record, nodes);
    }
    let sites: Vec<_> = placed.iter().map(|at| image.image_site(at)).collect();
    let grid = RecordGrid::new(WIDTH, HEIGHT, 8, &sites);
    let canopy = records.settle(&tree, &levels);

    // Interpolate everywhere else.
    // Shadow rays for all nodes; `Visibility::Adaptive` asks for some, and `Interpolated`, for flat and
    // finely covered things, for none.
    let visibility = Visibility::Full;
    let (mut cache, mut chosen) = (MergeCache::<()>::new(64), Vec::new());
    let (mut rays, mut without, mut squares, mut all) = (0, 0, 0.0, 0.0);
    for (pixel, here) in (0..).zip(&surfaces).filter_map(|(i, s)| Some((i, s.as_ref()?))) {
        let near = grid.at(pixel % WIDTH, pixel / WIDTH).iter();
        let weigh = |&id| (id, params.weights.weight(here.at, here.normal, &records.get(id).site));
        let Some(used) = Selection::best(near.map(weigh), params.weights.epsilon) else {
            // A host makes an exact cut here.
            without += 1;
            continue;
        };
        let (merged, ()) = cache.get(used.records(), |merged, ()| {
            let inputs: Vec<_> = used.records().iter().map(|&id| records.cut(id)).collect();
            merged.merge_in(&canopy, &inputs, Hidden::Keep);
        });
        merged.select(used.weights(), f32::INFINITY, &mut chosen);
        let node = |of: &cutinterp::Chosen| canopy.in_tree(merged.node(of.entry));
        let lamp = |of| lamps[representatives.light(&tree, node(of)).index()];
        let light = |of| representatives.intensity(&tree, node(of)) * here.unoccluded(lamp(of));
        let unoccluded: Vec<Vec3> = chosen.iter().map(light).collect();
        let lit = sum_up(visibility, &chosen, &unoccluded, |at| !here.sees(lamp(&chosen[at])));
        rays += lit.rays;

        // Every lamp, at some pixels.
        if pixel % 41 == 0 {
            let give = |&lamp: &Vec3| f64::from(here.sees(lamp)) * f64::from(here.unoccluded(lamp));
            let truth = color.as_dvec3() * lamps.iter().map(give).sum::<f64>();
            squares += (lit.radiance - truth).length_squared();
            all += truth.length_squared();
        }
    }
    let error = f64::sqrt(squares / all);
    println!(
        "{} records, {rays} shadow rays, {without} pixels without a record, off by {:.1} %",
        records.len(),
        100.0 * error
    );
    assert!(error < 0.05, "interpolated light is off by {error}");
    Ok(())
}
