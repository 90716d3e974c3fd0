//! What must hold of the pictures of every method that draws lights from a tree: no bias anywhere, the same
//! bits for any number of threads, and a part of a picture as in the whole.

use scene::{RenderParams, Rendered, SceneRays, builtin};
use stochastic::Interleave;

use super::{Learned, Method};
use crate::settings::Settings;
use crate::shot::{Gi, Plan, Stage};

const SIZE: (u32, u32) = (24, 16);

/// Everything that one picture depends on, but for the method.
struct Set {
    scene: scene::Scene,
    rays: SceneRays,
    camera: scene::Camera,
}

impl Set {
    fn new(name: &str) -> Self {
        let scene = builtin(name).unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let camera = scene.cameras.first().cloned().unwrap_or_else(|| scene.framing_camera());
        Self { scene, rays, camera }
    }

    fn picture(&self, method: &str, set: &[&str], seed: u32, params: &RenderParams) -> Rendered {
        self.lit(method, set, Gi::None, seed, params)
    }

    fn lit(&self, method: &str, set: &[&str], gi: Gi, seed: u32, params: &RenderParams) -> Rendered {
        let method = Method::named(method).unwrap();
        let set: Vec<_> = set.iter().map(|&assignment| assignment.to_owned()).collect();
        let settings = Settings::parse("x", &method.keys(), &set).unwrap();
        method.check(&settings).unwrap();
        let stage = Stage { scene: &self.scene, rays: &self.rays, camera: &self.camera };
        let plan = Plan { method, settings, gi, bounces: 2, seed, light_seed: seed };
        stage.render(&plan, &stage.prepare(&plan).unwrap(), params, &()).unwrap()
    }
}

fn params(spp: u32) -> RenderParams {
    RenderParams { width: SIZE.0, height: SIZE.1, spp, threads: 2, ..RenderParams::default() }
}

/// Mean brightness of each block of 8 × 8 pixels.
fn blocks(picture: &Rendered) -> Vec<f64> {
    let mut sums = vec![0.0; (SIZE.0 / 8 * SIZE.1 / 8) as usize];
    for (i, pixel) in (0..).zip(&picture.film.pixels) {
        let (x, y) = (i % SIZE.0, i / SIZE.0);
        sums[(y / 8 * (SIZE.0 / 8) + x / 8) as usize] += f64::from(pixel.element_sum()) / 64.0;
    }
    sums
}

/// The dials that pictures are taken with. `choice=upper` has a test of its own: its bright draws are too
/// rare for two dozen pictures to tell its spread.
const DRAWN: [(&str, &[&str]); 20] = [
    ("uniform", &["lights=8"]),
    ("power", &["lights=4"]),
    ("ris", &["lights=2"]),
    ("cut-cdf", &["nodes=9"]),
    ("cut-cdf-vis", &["nodes=16", "lights=2"]),
    ("tree", &["lights=2", "choice=center"]),
    ("split", &["threshold=0.95"]),
    ("split", &["lights=3", "choice=center"]),
    ("cut", &[]),
    ("cut", &["lights=6", "nodes=2", "choice=yuksel", "builder=perfect"]),
    ("cut", &["lights=1", "distance_floor=0"]),
    ("shared-cut", &[]),
    ("shared-cut", &["k=1"]),
    ("shared-cut", &["k=3", "guard=on"]),
    ("shared-cut", &["k=5", "builder=perfect"]),
    ("shared-cut", &["k=64"]),
    ("shared-cut", &["k=16", "guard=on", "choice=yuksel"]),
    ("shared-cut", &["m=2", "lights=2"]),
    ("shared-cut", &["m=4", "lights=1", "nodes=5"]),
    ("shared-cut", &["m=8", "lights=1", "nodes=40", "guard=on"]),
];

/// Camera samples in which a pixel sees the whole of a cut: m². A single one of them shows a part, and which
/// part depends on the seed: right in the mean, but where one light of a cut does all, two dozen pictures see
/// it in one frame or in none.
fn turn(dials: &[&str]) -> u32 {
    let side = dials.iter().find_map(|dial| dial.strip_prefix("m=")).map_or(1, |m| m.parse().unwrap());
    side * side
}

/// Both methods see the same points for one seed, so that only the choice of lights differs.
#[test]
fn no_block_of_pixels_is_biased() {
    const SEEDS: u32 = 24;
    for scene in ["hall:60", "city:30"] {
        let set = Set::new(scene);
        for turn in [1, 4, 16, 64] {
            // Whole turns, of fewer pixels.
            let pixels = (SIZE.0 * SIZE.1 / u32::max(turn / 4, 1)) as usize;
            let part = RenderParams { pixels: Some(pixels), ..params(turn) };
            let pictures = |method: &str, dials: &[&str]| -> Vec<_> {
                (0..SEEDS).map(|seed| blocks(&set.picture(method, dials, seed, &part))).collect()
            };
            // Every light, and the same points on it: what remains is the noise of choosing.
            let exact = pictures("brute", &[]);
            for (method, dials) in DRAWN.into_iter().filter(|(_, dials)| self::turn(dials) == turn) {
                if let Some(found) = bias(&pictures(method, dials), &exact) {
                    panic!("{scene}, {method} {dials:?}, {found}");
                }
            }
        }
    }
}

/// Camera samples that go by what those before them learned, in three phases, after one of one light and one
/// of several. Negative control, run by hand: lights that count 3 % too much are found in the hall.
#[test]
fn learning_leaves_no_bias_in_pictures() {
    const SEEDS: u32 = 24;
    for scene in ["hall:60", "city:30"] {
        let set = Set::new(scene);
        let pictures = |method: &str, dials: &[&str]| -> Vec<_> {
            (0..SEEDS).map(|seed| blocks(&set.picture(method, dials, seed, &params(6)))).collect()
        };
        let exact = pictures("brute", &[]);
        for dials in [&["nodes=16", "pilot=1", "defensive=0.02"][..], &["nodes=9", "pilot=5", "lights=2"]] {
            if let Some(found) = bias(&pictures("cut-cdf-vis", dials), &exact) {
                panic!("{scene}, {dials:?}, {found}");
            }
        }
    }
}

/// Where a turn begins depends on the seed, evenly: so one frame of interleaved parts is right in the mean
/// over seeds.
#[test]
fn a_single_frame_takes_each_part_as_often() {
    const SEEDS: u32 = 4096;
    for side in [2, 8] {
        let mut counts = vec![0; (side * side) as usize];
        for seed in 0..SEEDS {
            let part = Interleave::new(side).part(5, 3, super::cut::first_turn(seed));
            counts[part as usize] += 1;
        }
        let even = f64::from(SEEDS) / counts.len() as f64;
        assert!(
            counts.iter().all(|&count| (f64::from(count) - even).abs() < 5.0 * even.sqrt()),
            "{counts:?}"
        );
    }
}

/// The first block in which these pictures differ from those by more than 4 standard errors, if there is one.
fn bias(drawn: &[Vec<f64>], exact: &[Vec<f64>]) -> Option<String> {
    let n = drawn.len() as f64;
    (0..exact[0].len()).find_map(|block| {
        let differences: Vec<f64> = drawn.iter().zip(exact).map(|(d, e)| d[block] - e[block]).collect();
        let mean = differences.iter().sum::<f64>() / n;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let error = (variance / n).sqrt();
        (mean.abs() > 4.0 * error).then(|| format!("block {block}: {mean} ± {error}"))
    })
}

/// Weights by the nearest point alone draw what matters rarely, and then it is bright: thousands of samples
/// of a few pixels, in batches that are large enough for their means to be about normal.
#[test]
fn rare_bright_draws_are_not_biased() {
    const SEEDS: u32 = 16;
    let set = Set::new("city:30");
    let few = RenderParams { pixels: Some(48), ..params(250) };
    let means = |method: &str, dials: &[&str]| -> Vec<_> {
        let mean = |seed| {
            let picture = set.picture(method, dials, seed, &few);
            vec![picture.film.pixels.iter().map(|pixel| f64::from(pixel.element_sum())).sum::<f64>() / 48.0]
        };
        (0..SEEDS).map(mean).collect()
    };
    let exact = means("brute", &[]);
    for (method, lights) in [("split", "lights=8"), ("cut", "lights=8")] {
        if let Some(found) = bias(&means(method, &[lights, "choice=upper"]), &exact) {
            panic!("{method} {lights}, choice=upper: {found}");
        }
    }
}

/// All ways of drawing lights at the vertices of paths.
const NEXT_EVENTS: [&[&str]; 8] = [
    &["nee=power", "lights=3"],
    &["nee=tree"],
    &["nee=split", "lights=3"],
    &["nee=cut"],
    &["nee=cut-cdf", "nodes=7"],
    &["nee=cut-cdf", "nodes=16", "lights=2", "cells=2"],
    &["nee=cut-cdf-vis", "nodes=16", "cells=4"],
    &["nee=cut-cdf-vis", "nodes=9", "lights=3", "cells=9", "defensive=0.01"],
];

/// Paths whose lights are drawn in any way show what those do whose lights are drawn evenly, and the same
/// bits for any number of threads. Windows are drawn and hit, so that weights of both count.
#[test]
fn paths_are_not_biased_by_how_they_draw_lights() {
    const SEEDS: u32 = 24;
    for scene in ["cornell-lights:60", "city:30"] {
        let set = Set::new(scene);
        let pictures = |dials: &[&str], first: u32| -> Vec<_> {
            let seeds = first..first + SEEDS;
            seeds.map(|seed| blocks(&set.lit("path", dials, Gi::Path, seed, &params(6)))).collect()
        };
        let evenly = pictures(&["nee=uniform", "lights=2"], 1000);
        for dials in NEXT_EVENTS {
            if let Some(found) = bias(&pictures(dials, 0), &evenly) {
                panic!("{scene}, {dials:?}, {found}");
            }
            let [many, alone] = [2, 1]
                .map(|threads| set.lit("path", dials, Gi::Path, 3, &RenderParams { threads, ..params(6) }));
            assert_eq!(many.counts, alone.counts, "{scene}, {dials:?}");
            assert!(many.film == alone.film, "{scene}, {dials:?}: threads show");
        }
    }
}

#[test]
fn threads_and_parts_of_pictures_do_not_show() {
    let set = Set::new("hall:60");
    for (method, dials) in DRAWN {
        let whole = set.picture(method, dials, 5, &params(2));
        let alone = set.picture(method, dials, 5, &RenderParams { threads: 1, ..params(2) });
        assert_eq!((&whole.film, &whole.counts), (&alone.film, &alone.counts), "{method} {dials:?}");
        // A block's cut is chosen by those of its pixels that are asked for.
        if method.starts_with("cut-cdf") {
            continue;
        }
        let few = set.picture(method, dials, 5, &RenderParams { pixels: Some(90), ..params(2) });
        let mask = few.mask.unwrap();
        for (i, _) in mask.iter().enumerate().filter(|(_, rendered)| **rendered) {
            assert_eq!(few.film.pixels[i], whole.film.pixels[i], "{method} {dials:?}, pixel {i}");
        }
    }
}

/// One cut for a block and sample, whatever the size of the block, and none shared where each pixel has its
/// own.
#[test]
fn cuts_are_made_once_a_block() {
    let set = Set::new("hall:60");
    let cuts = |dials: &[&str]| {
        let counts = set.picture("shared-cut", dials, 1, &params(1)).counts;
        assert_eq!(counts.cut_nodes, 8 * counts.cuts);
        counts.cuts
    };
    let all = u64::from(SIZE.0 * SIZE.1);
    assert_eq!(
        (cuts(&["k=1"]), cuts(&["k=2"]), cuts(&["k=4"]), cuts(&["k=8"])),
        (all, all / 4, all / 16, all / 64)
    );
    assert!(cuts(&["k=3"]) < all / 4);
    assert_eq!(cuts(&["k=64"]), all / 64, "one for each unit of 64 pixels");
    assert!(cuts(&["k=8", "guard=on"]) > all / 64, "pixels across an edge have their own");
}

#[test]
fn dials_that_do_not_go_together_are_refused() {
    let refuse = |method: &str, set: &[&str]| {
        let method = Method::named(method).unwrap();
        let set: Vec<_> = set.iter().map(|&assignment| assignment.to_owned()).collect();
        let settings = Settings::parse("x", &method.keys(), &set).unwrap();
        method.check(&settings).unwrap_err().to_string()
    };
    assert!(refuse("cut", &["lights=4", "nodes=5"]).contains("nodes=5"));
    assert!(refuse("shared-cut", &["k=8", "m=3"]).contains("have to divide"));
    assert!(refuse("shared-cut", &["k=4", "m=8"]).contains("have to divide"));
}

/// The second frame of two: what the first learned leaves it unbiased, and does not depend on threads.
/// Without the first it is the picture that it always was.
#[test]
fn what_a_frame_learned_is_no_bias_in_the_next() {
    const SEEDS: u32 = 16;
    let set = Set::new("city:200");
    let stage = Stage { scene: &set.scene, rays: &set.rays, camera: &set.camera };
    let method = Method::CutCdfVis;
    let settings = Settings::parse("x", &method.keys(), &["nodes=64".to_owned()]).unwrap();
    let frame = |seed: u32, learned: Learned, params: &RenderParams| {
        let plan =
            Plan { method, settings: settings.clone(), gi: Gi::None, bounces: 1, seed, light_seed: seed };
        let mut prepared = stage.prepare(&plan).unwrap();
        prepared.learned = learned.next_frame(stage.radius());
        let picture = stage.render(&plan, &prepared, params, &()).unwrap();
        (picture, prepared.learned)
    };
    let second = |seed: u32, threads: usize| {
        let before = RenderParams { threads, ..params(16) };
        let (_, learned) = frame(1000 + seed, Learned::default(), &before);
        frame(seed, learned, &RenderParams { threads, ..params(1) })
    };
    let (picture, learned) = second(3, 1);
    assert!(learned.known() > 0, "cells of the first frame");
    let together = second(3, 2).0;
    assert_eq!(picture.counts, together.counts);
    assert!(picture.film == together.film, "threads show");

    let alone = |seed| set.picture("cut-cdf-vis", &["nodes=64"], seed, &params(1));
    assert!(frame(3, Learned::default(), &params(1)).0.film == alone(3).film, "nothing to recall");
    let (mut exact, mut with) = (Vec::new(), Vec::new());
    for seed in 0..SEEDS {
        exact.push(blocks(&set.picture("brute", &[], seed, &params(1))));
        with.push(blocks(&second(seed, 2).0));
    }
    assert_eq!(bias(&with, &exact), None);
}
