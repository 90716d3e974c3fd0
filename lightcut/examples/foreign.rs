//! A renderer of another kind in some sixty lines: its own triangles, its own ray loop, its own two-toned material and
//! its own lamps. Of this workspace it uses `lighttree` and `lightcut`, and nothing else.
//!
//! `cargo run --release -p lighttree-lightcut --example foreign > foreign.ppm`

use std::io::Write;

use glam::Vec3;
use lightcut::{Lightcut, LightcutParams, Lit, Representatives, Transfer};
use lighttree::{BuildParams, Emitter, GeometricBound, LightBounds, LightTree, Receiver, Toward};

const SIZE: usize = 96;
/// A floor and a leaning wall.
const TRIANGLES: [[Vec3; 3]; 3] = [
    [Vec3::new(-40.0, 0.0, -40.0), Vec3::new(0.0, 0.0, 80.0), Vec3::new(40.0, 0.0, -40.0)],
    [Vec3::new(-3.0, 0.0, 2.0), Vec3::new(2.0, 0.0, 4.0), Vec3::new(-1.0, 3.0, 4.0)],
    [Vec3::new(2.0, 0.0, 1.0), Vec3::new(4.0, 0.0, 3.0), Vec3::new(4.0, 2.5, 1.5)],
];

struct Lamp {
    at: Vec3,
    color: Vec3,
}
impl Emitter for Lamp {
    fn bounds(&self) -> LightBounds {
        LightBounds::point(self.at, self.color.max_element())
    }
}

/// A shading point with a material the library has never heard of.
struct Hit {
    at: Vec3,
    normal: Vec3,
    albedo: Vec3,
}
impl Receiver for Hit {
    fn position(&self) -> Vec3 {
        self.at
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.albedo.max_element() * toward.max_cos(self.normal).max(0.0)
    }
}

/// Nearest hit by the plainest of loops.
fn trace(origin: Vec3, direction: Vec3, t_max: f32) -> Option<(f32, Vec3)> {
    let hit = |[a, b, c]: [Vec3; 3]| {
        let (ab, ac) = (b - a, c - a);
        let (p, s) = (direction.cross(ac), origin - a);
        let (det, q) = (ab.dot(p), s.cross(ab));
        let (u, v, t) = (s.dot(p) / det, direction.dot(q) / det, ac.dot(q) / det);
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-4 && t < t_max).then(|| (t, ab.cross(ac).normalize()))
    };
    TRIANGLES.into_iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// What a lamp of intensity 1 does to a hit: the one closure that a lightcut asks for.
fn transfer(hit: &Hit, lamp: &Lamp) -> Transfer {
    let to_lamp = lamp.at - hit.at;
    let cos = to_lamp.normalize().dot(hit.normal).max(0.0);
    let seen = cos > 0.0 && trace(hit.at, to_lamp, 0.9999).is_none();
    Transfer::new(hit.albedo * cos / to_lamp.length_squared(), f32::from(seen))
}

/// Renders the picture; returns it with the mean number of lamps looked at and the relative error of every 50th pixel.
pub fn render(lamp_count: u32) -> (Vec<Vec3>, f64, f64) {
    // A spiral of coloured lamps over the floor.
    let lamp = |i: u32| {
        let (turn, share) = (i as f32 * 2.399_963, (i as f32 + 0.5) / lamp_count as f32);
        let at = Vec3::new(
            8.0 * share.sqrt() * turn.cos(),
            1.0 + 3.0 * share,
            4.0 + 8.0 * share.sqrt() * turn.sin(),
        );
        Lamp { at, color: Vec3::new(1.0, 0.5 + 0.5 * turn.sin(), 1.0 - share) * (50.0 / lamp_count as f32) }
    };
    let lamps: Vec<Lamp> = (0..lamp_count).map(lamp).collect();
    let tree = LightTree::build(&lamps, &BuildParams::default()).expect("lamps are finite");
    let representatives =
        Representatives::choose(&tree, 1, |l| lamps[l.0 as usize].color).expect("and not negative");
    let lightcut = Lightcut {
        tree: &tree,
        representatives: &representatives,
        params: LightcutParams::with_threshold(0.01),
    };

    let hits: Vec<Option<Hit>> = (0..SIZE * SIZE).map(camera_hit).collect();
    let lit_hits: Vec<&Hit> = hits.iter().flatten().collect();
    let mut lit = vec![Lit::default(); lit_hits.len()];
    let ask = |(): &mut (), hit: &&Hit, light: lighttree::LightId| transfer(hit, &lamps[light.0 as usize]);
    lightcut.shade_each(&lit_hits, &GeometricBound, || (), ask, &mut lit);

    let exact = |hit: &Hit| -> Vec3 {
        lamps.iter().map(|l| (transfer(hit, l), l.color)).map(|(t, i)| t.unoccluded * t.visibility * i).sum()
    };
    let judged = || lit_hits.iter().zip(&lit).step_by(50).map(|(hit, lit)| (exact(hit), lit.radiance));
    let error = judged().map(|(e, l)| f64::from((e - l).length_squared())).sum::<f64>();
    let truth = judged().map(|(e, _)| f64::from(e.length_squared())).sum::<f64>();
    let mean_cut = lit.iter().map(|l| f64::from(l.nodes)).sum::<f64>() / lit.len() as f64;
    let mut shaded = lit.iter().map(|l| l.radiance);
    let mut color = |hit: Option<Hit>| hit.map_or(Vec3::ZERO, |_| shaded.next().unwrap_or_default());
    (hits.into_iter().map(&mut color).collect(), mean_cut, (error / truth).sqrt())
}

fn camera_hit(pixel: usize) -> Option<Hit> {
    let (x, y) = ((pixel % SIZE) as f32 / SIZE as f32 - 0.5, 0.5 - (pixel / SIZE) as f32 / SIZE as f32);
    let (eye, direction) = (Vec3::new(0.0, 3.0, -6.0), Vec3::new(x, y - 0.2, 1.0).normalize());
    let (t, normal) = trace(eye, direction, f32::INFINITY)?;
    let (at, normal) = (eye + t * direction, if normal.dot(direction) > 0.0 { -normal } else { normal });
    let checker = (at.x.floor() + at.z.floor()).rem_euclid(2.0);
    Some(Hit { at: at + 1e-4 * normal, normal, albedo: Vec3::new(0.3, 0.25, 0.2) * (0.5 + 0.5 * checker) })
}

/// Writes the picture to standard output.
pub fn main() -> std::io::Result<()> {
    let (picture, mean_cut, error) = render(3000);
    eprintln!("3000 lamps, {mean_cut:.0} looked at per pixel, {:.3} % relative error", 100.0 * error);
    let bytes =
        picture.iter().flat_map(|c| c.to_array()).map(|c| (255.0 * c.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8);
    let mut out = std::io::stdout().lock();
    writeln!(out, "P6 {SIZE} {SIZE} 255")?;
    out.write_all(&bytes.collect::<Vec<u8>>())
}
