//! Where light is looked at: which updates a viewer would miss most.
//!
//! Luksch, Wimmer and Schwärzler 2019 leave this open (section 7). Here a cluster counts as much as its
//! update will change at what is looked at: the irradiance of its lights as they are baked, with the shadow
//! rays of that time, against that of the flux it has now, with the shadow rays of now. Only rays that cross
//! the box of something that moved are asked again. Flux of paths that end elsewhere, which the paper goes
//! by, is what some dozen paths a cluster say, wherever they lead.

use core::f32::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec3};
use lighttree::Ray;
use lighttree::rng::{pcg4d, unit_f32};

use crate::baker::{Baker, Lamp};
use crate::forest::{Node, Place};
use crate::sums::{GRID, Sums, Units};
use crate::trace::Trace;
use crate::validate::crosses;
use crate::{BakeError, Bounds, Contribution, GeometryVersion, Incident, Shape, Target, VirtualLight};

/// Points that are looked at, with their unit normals, and what moved.
#[derive(Clone, Debug, Default)]
pub(crate) struct Attention {
    points: Vec<(Vec3, Vec3)>,
    /// Boxes of what moved, with the version that it moved in, in order.
    moved: Vec<(GeometryVersion, Bounds)>,
    /// The version that all views are of; none before any was made.
    seen: Option<GeometryVersion>,
}

/// What the points see of the lights of one cluster: irradiance, W·m⁻², mean of the channels.
#[derive(Clone, Debug)]
pub(crate) struct Views {
    /// As it is baked.
    baked: Vec<f32>,
    /// As the same lights would be now.
    now: Vec<f32>,
    /// Which points see each light, in the order of lights.
    lights: Vec<Seen>,
    /// What "now" is.
    version: GeometryVersion,
}

/// Which points see a light: a bit each, in words of 64 points.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    /// When it was baked.
    then: Box<[u64]>,
    now: Box<[u64]>,
}

impl Seen {
    /// Baked now.
    pub(crate) fn renewed(&self) -> Self {
        Self { then: self.now.clone(), now: self.now.clone() }
    }
}

/// What of a cluster is out of date, in units of flux.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Invalid<'a> {
    /// Flux when it was baked.
    pub(crate) flux_at_bake: i64,
    /// Flux of paths that end elsewhere now, or of a lamp that is elsewhere.
    pub(crate) absolute: i64,
    /// What is seen of it, if it is baked and anybody looks.
    pub(crate) views: Option<&'a Views>,
}

/// The most points that are looked at, whatever a cluster takes for each of them.
const MOST_POINTS: usize = 4096;
/// The most points of all clusters together, eight bytes each.
const MOST_VIEWS: usize = 1 << 23;

impl Views {
    /// Which points see each light, in the order of lights.
    pub(crate) fn lights(&self) -> &[Seen] {
        &self.lights
    }
}

impl Attention {
    pub(crate) fn log(&mut self, version: GeometryVersion, bounds: Bounds) {
        if !self.points.is_empty() {
            self.moved.push((version, bounds));
        }
    }

    /// Whether views are to be brought up to date.
    pub(crate) fn is_behind(&self, version: GeometryVersion) -> bool {
        !self.points.is_empty() && self.seen != Some(version)
    }

    /// All views are of this version.
    pub(crate) fn has_seen(&mut self, version: GeometryVersion) {
        self.seen = Some(version);
        self.moved.clear();
    }

    /// What is known of lights that were looked at, put together anew.
    pub(crate) fn assemble(
        &self,
        lights: &[Contribution],
        seen: Vec<Seen>,
        version: GeometryVersion,
    ) -> Option<Box<Views>> {
        if self.points.is_empty() || lights.is_empty() {
            return None;
        }
        let none = vec![0.0; self.points.len()];
        let mut views = Views { baked: none.clone(), now: none, lights: Vec::new(), version };
        for (contribution, seen) in lights.iter().zip(seen) {
            self.put_in(&mut views, &contribution.light, seen);
        }
        Some(Box::new(views))
    }

    /// One light more, the last.
    pub(crate) fn put_in(&self, views: &mut Views, light: &VirtualLight, seen: Seen) {
        self.shine(light, &seen.then, |i, irradiance| views.baked[i] += irradiance);
        self.shine(light, &seen.now, |i, irradiance| views.now[i] += irradiance);
        views.lights.push(seen);
    }

    /// The light of this number is none of the cluster's any more; those after it move up.
    pub(crate) fn take_out(&self, views: &mut Views, number: usize, light: &VirtualLight) {
        let seen = views.lights.remove(number);
        self.shine(light, &seen.then, |i, irradiance| views.baked[i] -= irradiance);
        self.shine(light, &seen.now, |i, irradiance| views.now[i] -= irradiance);
    }

    /// What a light is for the points that saw it when it was baked.
    pub(crate) fn shine_as_baked(&self, light: &VirtualLight, seen: &Seen, to: impl FnMut(usize, f32)) {
        self.shine(light, &seen.then, to);
    }

    fn shine(&self, light: &VirtualLight, mask: &[u64], mut to: impl FnMut(usize, f32)) {
        for (i, &point) in self.points.iter().enumerate() {
            if mask[i / 64] >> (i % 64) & 1 != 0
                && let Some(incident) = incident_at(light, i, point)
            {
                to(i, mean(incident.irradiance));
            }
        }
    }

    /// How many points are looked at.
    pub(crate) const fn points(&self) -> usize {
        self.points.len()
    }

    /// What is seen of lights that are baked now.
    pub(crate) fn look(
        &self,
        lights: &[Contribution],
        version: GeometryVersion,
        trace: &Trace<'_>,
    ) -> Option<Box<Views>> {
        if self.points.is_empty() || lights.is_empty() {
            return None;
        }
        let none = vec![0.0; self.points.len()];
        let dark: Box<[u64]> = vec![0; self.points.len().div_ceil(u64::BITS as usize)].into();
        let unseen = vec![Seen { then: dark.clone(), now: dark }; lights.len()];
        let mut views = Views { baked: Vec::new(), now: none, lights: unseen, version };
        self.ask(&mut views, lights, trace, |_| true);
        views.baked.clone_from(&views.now);
        views.lights.iter_mut().for_each(|seen| seen.then.clone_from(&seen.now));
        Some(Box::new(views))
    }

    /// Brings views up to date, asking again what crosses something that moved.
    pub(crate) fn look_again(
        &self,
        views: &mut Views,
        lights: &[Contribution],
        version: GeometryVersion,
        trace: &Trace<'_>,
    ) {
        let since = self.moved.partition_point(|&(moved, _)| moved <= views.version);
        let moved = &self.moved[since..];
        views.version = version;
        self.ask(views, lights, trace, |&(from, to)| {
            moved.iter().any(|(_, bounds)| crosses(bounds, from, to, false))
        });
    }

    /// Asks whether points see lights, and changes the views by what is seen otherwise than before.
    fn ask(
        &self,
        views: &mut Views,
        lights: &[Contribution],
        trace: &Trace<'_>,
        is_asked: impl Fn(&(Vec3, Vec3)) -> bool,
    ) {
        let (mut asked, mut rays) = (Vec::new(), Vec::new());
        for (number, Contribution { light, .. }) in lights.iter().enumerate() {
            for (i, &(position, normal)) in self.points.iter().enumerate() {
                let Some(incident) = incident_at(light, i, (position, normal)) else { continue };
                let (direction, distance) = match incident.target {
                    Target::At(to) => ((to - position).normalize_or_zero(), to.distance(position)),
                    Target::Toward(direction) => (direction, f32::INFINITY),
                };
                let to = position + direction * distance.min(1e30);
                if direction != Vec3::ZERO && is_asked(&(position, to)) {
                    asked.push((number, i, mean(incident.irradiance), distance));
                    rays.push(Ray { origin: position, direction, t_max: f32::INFINITY });
                }
            }
        }
        let mut hits = vec![None; rays.len()];
        trace(&rays, &mut hits);
        for ((number, i, irradiance, distance), hit) in asked.into_iter().zip(hits) {
            // Nearly at the light is at it: it lies just off its surface.
            let is_seen =
                hit.is_none_or(|hit| hit.position.distance(self.points[i].0) >= (1.0 - 1e-3) * distance);
            let word = &mut views.lights[number].now[i / 64];
            let was_seen = *word >> (i % 64) & 1 != 0;
            if is_seen != was_seen {
                *word ^= 1 << (i % 64);
                views.now[i] += if is_seen { irradiance } else { -irradiance };
            }
        }
    }

    /// How much an update of the node will change, and of how much: irradiance at the points; or flux, where
    /// nobody looks.
    pub(crate) fn worth(
        &self,
        node: &Node,
        invalid: &Invalid<'_>,
        units: &Units,
        lamp: Option<&Lamp>,
    ) -> (f64, f64) {
        let flux = node.sums.flux;
        if self.points.is_empty() {
            let any = (flux - invalid.flux_at_bake).abs().saturating_add(invalid.absolute);
            return (any as f64, flux.max(invalid.flux_at_bake) as f64);
        }
        let of_points = |at: &dyn Fn(usize) -> f64| {
            let squares: f64 = (0..self.points.len()).map(|i| at(i).powi(2)).sum();
            (squares / self.points.len() as f64).sqrt()
        };
        let scale = flux as f64 / invalid.flux_at_bake.max(1) as f64;
        // A lamp that moved brings other light, as one that is new.
        let comes_anew = matches!(node.place, Place::Piece { .. }) && invalid.absolute > 0;
        match invalid.views {
            Some(views) if !comes_anew => {
                let now = |i: usize| scale * f64::from(views.now[i]);
                let baked = |i: usize| f64::from(views.baked[i]);
                (of_points(&|i| now(i) - baked(i)), of_points(&|i| now(i).max(baked(i))))
            }
            views => {
                let source = Source::of_node(node, units, lamp);
                let comes = flux as f64 * units.flux;
                let goes = |i: usize| views.map_or(0.0, |views| f64::from(views.baked[i]));
                let all = of_points(&|i| goes(i) + comes * f64::from(source.reaches(self.points[i])));
                (all, all)
            }
        }
    }
}

/// Light that comes to point number `i`, from the place on the light that is this point's.
fn incident_at(light: &VirtualLight, i: usize, (position, normal): (Vec3, Vec3)) -> Option<Incident> {
    let [u, v, ..] = pcg4d([light.seed, i as u32, 0x6c6f_6f6b, 0]);
    light.incident(position, normal, [unit_f32(u), unit_f32(v)])
}

/// Mean of the channels.
fn mean(irradiance: Vec3) -> f32 {
    irradiance.element_sum() / 3.0
}

/// A cluster as seen from afar.
struct Source {
    position: Vec3,
    /// Mean normal: shorter where normals differ, and nothing for what shines every way.
    normal: Vec3,
    radius: f32,
}

impl Source {
    fn of_sums(sums: &Sums, units: &Units) -> Self {
        let position = (units.origin + sums.mean_position() * units.length).as_vec3();
        Self { position, normal: sums.mean_normal().as_vec3(), radius: (sums.radius() * units.length) as f32 }
    }

    fn of_node(node: &Node, units: &Units, lamp: Option<&Lamp>) -> Self {
        match (node.place, lamp) {
            (Place::Piece { piece, .. }, Some(lamp)) => {
                let piece = &lamp.tree.pieces[piece as usize];
                Self::of_shape(&piece.shape, piece.size as f32, units)
            }
            _ => Self::of_sums(&node.sums, units),
        }
    }

    fn of_shape(shape: &Shape, radius: f32, units: &Units) -> Self {
        let all_ways = |position| Self { position, normal: Vec3::ZERO, radius };
        match shape {
            Shape::Point { position, .. } => all_ways(*position),
            Shape::Sphere { center, .. } => all_ways(*center),
            Shape::ShapedPolygon { polygon, .. } => all_ways(polygon.centroid()),
            Shape::Disk { position, normal, .. } => Self { position: *position, normal: *normal, radius },
            Shape::Polygon(polygon) | Shape::Patch { polygon, .. } => {
                Self { position: polygon.centroid(), normal: polygon.normal(), radius }
            }
            // A disk above the world, whose watts are those that come in.
            Shape::Sky { frame, .. } => {
                let side = (units.length * f64::from(GRID)) as f32;
                let middle = (units.origin + DVec3::splat(0.5 * f64::from(side))).as_vec3();
                let up = *frame * Vec3::Z;
                Self { position: middle + side * up, normal: -up, radius: side }
            }
        }
    }

    /// Irradiance of a watt, m⁻²: Lambertian for what the normals agree in, even for the rest, and as on the
    /// axis of a disk where it is near.
    fn reaches(&self, (point, normal): (Vec3, Vec3)) -> f32 {
        let towards = self.position - point;
        let squared = towards.length_squared() + self.radius * self.radius;
        if squared <= 0.0 {
            return 0.0;
        }
        let direction = towards / squared.sqrt();
        // A part of what is large is above the horizon, though its middle is not.
        let widening = self.radius / squared.sqrt();
        let cos = (normal.dot(direction) + widening).clamp(0.0, 1.0);
        let agreed = self.normal.length();
        let lambert = (self.normal.dot(-direction) + widening * agreed).clamp(0.0, agreed) * FRAC_1_PI;
        let even = (1.0 - agreed).max(0.0) / (4.0 * PI);
        cos * (lambert + even) / squared
    }
}

impl Baker {
    /// Says what is looked at: points just off surfaces, and unit normals; a few hundred of what a camera
    /// sees, say. From now on updates come first that will change most there; without points (as at first)
    /// those of the most invalid flux. Where the bake ends does not depend on it, and it is not saved.
    ///
    /// The next [`step`](Self::step) asks a ray for each point and each baked light, as later ones do for
    /// lights that they bake or foresee; so say it before an edit, and again when the camera has moved far.
    /// A point costs about what a texel does. The more points, the less falls between them
    /// (`docs/bake.md` has the curve), and the less so where they are not in rows, which strips of shadow may
    /// miss; of more than 4096, or than 8 million over [`clusters`](crate::BakeParams::clusters), as many are
    /// taken evenly. A cluster takes eight bytes for each point and a quarter of one for each of its lights,
    /// and up to eight more for each light while its change is foreseen.
    ///
    /// # Errors
    /// [`BakeError::Watched`]: a point that is not finite, or a normal that is not of unit length. Then
    /// nothing has changed.
    pub fn watch(&mut self, points: &[(Vec3, Vec3)]) -> Result<(), BakeError> {
        let sound = |(point, normal): &(Vec3, Vec3)| {
            point.is_finite() && (normal.length_squared() - 1.0).abs() < 0.01
        };
        if let Some(index) = points.iter().position(|point| !sound(point)) {
            return Err(BakeError::Watched { index });
        }
        let most = (MOST_VIEWS / self.params.clusters.max(1)).clamp(1, MOST_POINTS);
        let count = points.len().min(most);
        let evenly = (0..count).map(|i| points[i * points.len() / count]);
        self.attention = Attention { points: evenly.collect(), ..Attention::default() };
        self.foresight = None;
        self.cut.forget_views();
        self.refresh();
        Ok(())
    }
}

impl Sums {
    /// Mean position of members, in units of length; the origin where there are none.
    fn mean_position(&self) -> DVec3 {
        let [x, y, z] = self.positions();
        DVec3::new(x, y, z) / f64::from(self.count.max(1))
    }
}

impl Baker {
    /// Brings what is seen of all baked lights up to date with the geometry.
    pub(crate) fn look_around(&mut self, trace: &Trace<'_>) {
        if !self.attention.is_behind(self.version) {
            return;
        }
        for state in &mut self.cut.states {
            match &mut state.views {
                Some(views) => self.attention.look_again(views, &state.baked, self.version, trace),
                none => *none = self.attention.look(&state.baked, self.version, trace),
            }
        }
        self.attention.has_seen(self.version);
        self.cut.touch_all();
        self.refresh();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Behind a wall, or above a lamp's back, nobody misses a light; near ones are missed more.
    #[test]
    fn what_is_near_and_faces_the_viewer_counts() {
        let source = |x: f32, normal: Vec3| Source { position: Vec3::new(x, 2.0, 0.0), normal, radius: 0.1 };
        let floor = (Vec3::ZERO, Vec3::Y);
        let facing = source(0.0, Vec3::NEG_Y).reaches(floor);
        assert!((facing - 1.0 / (4.01 * PI)).abs() < 0.02 * facing, "{facing}");
        assert_eq!(source(0.0, Vec3::Y).reaches(floor), 0.0);
        assert_eq!(source(0.0, Vec3::NEG_Y).reaches((Vec3::ZERO, Vec3::NEG_Y)), 0.0);
        assert!(source(3.0, Vec3::NEG_Y).reaches(floor) < 0.2 * facing);
        let bulb = source(0.0, Vec3::ZERO).reaches(floor);
        assert!((bulb - facing / 4.0).abs() < 0.1 * bulb, "{bulb}");
    }
}
