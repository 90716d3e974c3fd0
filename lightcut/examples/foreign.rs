//! A renderer of another kind in eighty lines: its own triangles and ray loop, its own material, its own
//! lamps. Of this workspace it uses `lighttree` and `lightcut`, nothing else. Writes a PPM if the first
//! argument names one.

use glam::Vec3;
use lightcut::{Choice, Lightcut, LightcutParams, Lit, Representatives, Transfer};
use lighttree::{BuildParams, Emitter, GeometricBound, LightBounds, LightId, LightTree, Receiver, Toward};

pub(crate) const SIZE: usize = 96;
const TRIANGLES: [[Vec3; 3]; 3] = [
    [Vec3::new(-40.0, 0.0, -40.0), Vec3::new(0.0, 0.0, 80.0), Vec3::new(40.0, 0.0, -40.0)],
    [Vec3::new(-3.0, 0.0, 2.0), Vec3::new(2.0, 0.0, 4.0), Vec3::new(-1.0, 3.0, 4.0)],
    [Vec3::new(2.0, 0.0, 1.0), Vec3::new(4.0, 0.0, 3.0), Vec3::new(4.0, 2.5, 1.5)],
];
pub(crate) struct Lamp(pub(crate) Vec3, pub(crate) Vec3); // position, colour
impl Emitter for Lamp {
    fn bounds(&self) -> LightBounds {
        LightBounds::point(self.0, self.1.max_element())
    }
}
pub(crate) struct Hit(Vec3, Vec3, Vec3); // position, normal, reflectance
impl Receiver for Hit {
    fn position(&self) -> Vec3 {
        self.0
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.2.max_element() * toward.max_cos(self.1).max(0.0)
    }
}
fn trace(origin: Vec3, direction: Vec3, t_max: f32) -> Option<(f32, Vec3)> {
    let hit = |[a, b, c]: [Vec3; 3]| {
        let (ab, ac, s) = (b - a, c - a, origin - a);
        let (p, q) = (direction.cross(ac), s.cross(ab));
        let (u, v, t) = (s.dot(p) / ab.dot(p), direction.dot(q) / ab.dot(p), ac.dot(q) / ab.dot(p));
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-4 && t < t_max).then(|| (t, ab.cross(ac).normalize()))
    };
    TRIANGLES.into_iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
}
fn camera_hit(pixel: usize) -> Option<Hit> {
    let (x, y) = ((pixel % SIZE) as f32 / SIZE as f32 - 0.5, 0.5 - (pixel / SIZE) as f32 / SIZE as f32);
    let (eye, direction) = (Vec3::new(0.0, 3.0, -6.0), Vec3::new(x, y - 0.2, 1.0).normalize());
    let (t, normal) = trace(eye, direction, f32::INFINITY)?;
    Some(Hit(eye + t * direction, normal * -normal.dot(direction).signum(), Vec3::new(0.3, 0.25, 0.2)))
}
/// What a lamp of intensity 1 does to a hit: the one thing that a lightcut asks for.
pub(crate) fn transfer(hit: &Hit, lamp: &Lamp) -> Transfer {
    let (origin, cos) = (hit.0 + 1e-4 * hit.1, (lamp.0 - hit.0).normalize().dot(hit.1).max(0.0));
    let visible = cos > 0.0 && trace(origin, lamp.0 - origin, 1.0).is_none();
    Transfer::new(hit.2 * cos / hit.0.distance_squared(lamp.0), f32::from(visible))
}
pub(crate) fn render(lamps: &[Lamp], threshold: f32) -> Vec<Option<(Hit, Lit)>> {
    let tree = LightTree::build(lamps, &BuildParams::default()).expect("lamps are finite");
    let representatives = Representatives::choose(&tree, Choice::Random { seed: 1 }, |l| lamps[l.index()].1)
        .expect("and not negative");
    let params = LightcutParams::with_threshold(threshold);
    let (lightcut, mut scratch) =
        (Lightcut { tree, representatives: &representatives, params }, Default::default());
    let mut shade = |hit: Hit| {
        let ask = |light: LightId| transfer(&hit, &lamps[light.index()]);
        let lit = lightcut.shade(&hit, &GeometricBound, ask, &mut scratch);
        (hit, lit)
    };
    (0..SIZE * SIZE).map(|pixel| camera_hit(pixel).map(&mut shade)).collect()
}
/// A spiral of coloured lamps over the floor.
pub(crate) fn lamps(count: usize) -> Vec<Lamp> {
    let lamp = |i| {
        let (turn, share) = (i as f32 * 2.4, (i as f32 + 0.5) / count as f32);
        let (x, z) = (8.0 * share.sqrt() * turn.cos(), 4.0 + 8.0 * share.sqrt() * turn.sin());
        Lamp(Vec3::new(x, 1.0 + 3.0 * share, z), Vec3::new(1.0, 0.6, 1.0 - share) * (50.0 / count as f32))
    };
    (0..count).map(lamp).collect()
}
fn main() -> std::io::Result<()> {
    let picture = render(&lamps(3000), 0.01);
    let asked: u32 = picture.iter().flatten().map(|(_, lit)| lit.transfers).sum();
    println!("{} of 3000 lamps looked at per pixel", asked as usize / picture.iter().flatten().count());
    let Some(path) = std::env::args_os().nth(1) else { return Ok(()) };
    let encode = |c: f32| (255.0 * c.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
    let radiance = picture.iter().map(|p| p.as_ref().map_or(Vec3::ZERO, |(_, lit)| lit.radiance));
    let bytes: Vec<u8> = radiance.flat_map(|c| c.to_array()).map(encode).collect();
    std::fs::write(path, [format!("P6 {SIZE} {SIZE} 255\n").as_bytes(), &bytes].concat())
}
