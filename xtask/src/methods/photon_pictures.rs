//! What must hold of pictures made of photons: as much light as paths find, each approximation on its own;
//! the same bits for any number of threads; and points that stay where they are from frame to frame.

use clustering::Clusters;
use scene::{RenderParams, Rendered, Scene, SceneRays, builtin};

use super::Method;
use crate::settings::Settings;
use crate::shot::{Gi, Left, Plan, Stage};

/// A built-in scene and rays against it.
struct Room {
    scene: Scene,
    rays: SceneRays,
}

impl Room {
    fn new(name: &str) -> Self {
        let scene = builtin(name).unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        Self { scene, rays }
    }

    fn picture(&self, method: &str, set: &[&str], params: &RenderParams) -> Rendered {
        self.after(method, set, 1, params, &mut None)
    }

    fn after(
        &self,
        method: &str,
        set: &[&str],
        seed: u32,
        params: &RenderParams,
        clusters: &mut Option<Clusters>,
    ) -> Rendered {
        let method = Method::named(method).unwrap();
        let set: Vec<_> = set.iter().map(|&assignment| assignment.to_owned()).collect();
        let settings = Settings::parse("x", &method.keys(), &set).unwrap();
        let gi = if method == Method::Path { Gi::Path } else { Gi::None };
        let plan = Plan { method, settings, gi, bounces: 3, seed, light_seed: seed };
        let stage = Stage { scene: &self.scene, rays: &self.rays, camera: &self.scene.cameras[0] };
        let mut left = Left { clusters: clusters.take(), ..Left::default() };
        let picture =
            stage.render_after(&plan, &stage.prepare(&plan).unwrap(), params, &(), &mut left).unwrap();
        *clusters = left.clusters;
        picture
    }
}

fn params(spp: u32) -> RenderParams {
    RenderParams { width: 24, height: 24, spp, threads: 2, ..RenderParams::default() }
}

fn mean(picture: &Rendered) -> f64 {
    let pixels = &picture.film.pixels;
    pixels.iter().map(|p| f64::from(p.element_sum())).sum::<f64>() / pixels.len() as f64
}

const FEW: [&str; 4] = ["photons=30000", "nodes=1000", "rays=100", "direct=off"];

#[test]
fn photons_bring_as_much_light_as_paths() {
    let room = Room::new("cornell");
    let photons = ["photons=60000", "nearest=20", "direct=off"];
    // The same camera rays, so that the lamp in the picture is the same.
    let truth = mean(&room.picture("path", &["direct=off"], &params(64)));
    let off = |method, set: &[&str]| mean(&room.picture(method, set, &params(64))) / truth - 1.0;
    let gather = off("gather", &[&photons[..], &["rays=4"]].concat());
    assert!(gather.abs() < 0.03, "gather: mean off by {gather}");
    for approximation in [&["clusters=off", "rays=4"], &["cut=off", "rays=100"], &["cut=on", "rays=100"]] {
        let off = off("photoncut", &[&photons[..], &["nodes=3000", "samples=150"], approximation].concat());
        assert!(off.abs() < 0.03, "{approximation:?}: mean off by {off}");
    }
}

/// Camera samples that gather for themselves bring the light that few points miss, mirrors and lobes included,
/// and where they are not wanted there are none.
#[test]
fn own_gathers_bring_missing_light() {
    let room = Room::new("cornell");
    let truth = room.picture("photoncut", &[&FEW[..], &["clusters=off"]].concat(), &params(4));
    let error = |own: &str| {
        let picture =
            room.picture("photoncut", &[&FEW[..], &["samples=30", "finer=2", own]].concat(), &params(4));
        let pairs = picture.film.pixels.iter().zip(&truth.film.pixels);
        let squares: f64 = pairs.map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
        (squares, picture.counts.closest_hit_rays)
    };
    let (none, some, all) = (error("own=inf"), error("own=0.1"), error("own=0"));
    assert!(some.0 < 0.7 * none.0 && some.1 > none.1, "{some:?} and {none:?}");
    // Everywhere: a gather of 50 rays at each of 4 × 576 camera samples.
    assert!(all.1 > none.1 + 90_000, "{all:?} and {none:?}");
}

/// What is glossy follows its own lobes where it gathers for itself: from doubt 0 on everywhere, the very rays
/// of a picture without clusters; in between, in part.
#[test]
fn glossy_points_gather_along_their_lobes() {
    let mut room = Room::new("cornell");
    room.scene.materials.iter_mut().for_each(|material| material.phong_exponent = Some(20.0));
    // Half as many rays as `FEW` has.
    let truth = [&FEW[..], &["clusters=off", "rays=50"]].concat();
    let truth = room.picture("photoncut", &truth, &params(2));
    let picture = |own: &str| {
        room.picture("photoncut", &[&FEW[..], &["samples=60", "finer=2", own]].concat(), &params(2)).film
    };
    assert_eq!(picture("own=0").pixels, truth.film.pixels);
    let off = |film: &scene::Film| -> f64 {
        let pairs = film.pixels.iter().zip(&truth.film.pixels);
        pairs.map(|(a, b)| f64::from((*a - *b).length_squared())).sum()
    };
    let (none, some) = (off(&picture("own=inf")), off(&picture("own=0.1")));
    assert!(none > 0.0 && some < 0.8 * none, "{some} and {none}");
}

#[test]
fn threads_do_not_show() {
    let room = Room::new("glass-cube");
    let set = ["photons=5000", "caustics=2000", "nodes=200", "rays=30", "samples=60"];
    for method in ["gather", "photoncut"] {
        let set = if method == "gather" { &set[..2] } else { &set[..] };
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                room.picture(method, set, &RenderParams { threads, width: 12, height: 12, ..params(1) })
            })
        };
        let (one, three) = (with(1), with(3));
        assert_eq!((&one.film, &one.counts), (&three.film, &three.counts), "{method}");
    }
}

/// Light moves from frame to frame as photons fall elsewhere; where it is gathered does not, unless that is
/// asked for.
#[test]
fn clusters_stay_from_frame_to_frame() {
    let room = Room::new("cornell");
    // Half of the points are the clusters'.
    let set = [&FEW[..], &["samples=60", "doubtful=0.5"]].concat();
    let mut clusters = None;
    room.after("photoncut", &set, 1, &params(1), &mut clusters);
    let first = clusters.clone().unwrap();
    room.after("photoncut", &set, 2, &params(1), &mut clusters);
    let stayed = |now: &Clusters| now.centres().iter().filter(|c| first.centres().contains(c)).count();
    let (kept, all) = (stayed(clusters.as_ref().unwrap()), first.len());
    assert!(kept > all / 2 && first.len() == 30, "{kept} of {all} stayed");
    room.after("photoncut", &[&set[..], &["follow=off"]].concat(), 2, &params(1), &mut clusters);
    assert_eq!(stayed(clusters.as_ref().unwrap()), 0);
}
