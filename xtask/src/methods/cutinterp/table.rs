//! The table of `docs/cutinterp.md`: every mode against `lightcut`, in one run over one set of virtual lights
//! and one tree.
//!
//!     LIGHTTREE_TABLE=sponza:diffuse,sponza:phong:150 cargo test --release -p xtask -- --ignored --nocapture
//!     table_of_modes
//!
//! `LIGHTTREE_MODES=interpolated,adaptive` leaves the other modes out, and the small pictures with them.
//!
//! `LIGHTTREE_MAPS=FOLDER` keeps the small pictures, where each mode is off (white: half of a pixel's light),
//! and what the method does.
//!
//! `LIGHTTREE_WORST=5` names the five pixels that are farthest off in each mode.
//!
//! `LIGHTTREE_SIZE=1920x1080` is the size of the pictures; 512x512 without it.
//!
//! References are pictures by `brute` with the same seed, size and pixels, `SCENE-diffuse.exr` or
//! `SCENE-phong.exr` in the folder `LIGHTTREE_REFERENCES`; without them there is no error column.
//!
//! Ratios are against the mean of lightcuts taken just before and just after, because a machine's clock
//! changes within minutes; times are the processor's, of all threads, of which there is one.

use std::path::{Path, PathBuf};

use nix::sys::resource::{UsageWho, getrusage};
use scene::{Camera, Film, RenderParams, Rendered, Scene, SceneRays, compare};

use crate::methods::Method;
use crate::settings::Settings;
use crate::shot::{Gi, Left, Plan, Prepared, Stage};
use crate::{report, source};

/// Pixels of a row and of a column where nobody says otherwise; the paper has 1024.
const SIZE: (u32, u32) = (512, 512);

/// Pixels that `brute` was asked for.
const JUDGED: usize = 250;

/// Pixels by which a whole `lightcut` is timed, drawn by the seed.
const TIMED: usize = 4096;

/// Side of the pictures that are compared by eye (FLIP), with a whole picture by `lightcut`.
const SEEN: (u32, u32) = (128, 128);

/// What is measured: a method, its dials, and a name.
const MODES: [(&str, &[&str], &str); 6] = [
    ("cutinterp", &["guard=inf"], "full-unguarded"),
    ("cutinterp", &[], "full"),
    ("cutinterp", &["visibility=adaptive", "guard=inf"], "adaptive-unguarded"),
    ("cutinterp", &["visibility=adaptive"], "adaptive"),
    ("cutinterp-vis", &["guard=inf"], "interpolated-unguarded"),
    ("cutinterp-vis", &[], "interpolated"),
];

/// What is left out unless `LIGHTTREE_MODES` names it.
const UNGUARDED: &str = "-unguarded";

/// Rows of the curve, each some dials.
const DIALS: &str = "visibility=adaptive trust=0.002 ray_share=0.0001;visibility=adaptive trust=0.001 ray_share=0.0001;\
    visibility=adaptive trust=0.0005 ray_share=0.0001;visibility=adaptive trust=0.0001 ray_share=0.00003;\
    visibility=full guard=4;visibility=full guard=2;visibility=full guard=1;visibility=adaptive guard=2;\
    visibility=full threshold=0.007;visibility=full coverage=0.5";

struct Table {
    name: String,
    scene: Scene,
    rays: SceneRays,
    camera: Camera,
    material: String,
    size: (u32, u32),
    reference: Option<Film>,
}

impl Table {
    /// `NAME:MATERIALS`, such as `sponza:phong:150`.
    fn open(what: &str) -> Option<Self> {
        let (name, material) = what.split_once(':').expect("write scene:materials");
        let folder = std::env::var("LIGHTTREE_SCENES").map_or_else(
            |_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
            PathBuf::from,
        );
        let file = folder.join(format!("{name}.glb"));
        if !file.exists() {
            eprintln!("skipped: there is no {}", file.display());
            return None;
        }
        let settings = settings("lightcut", material, &[]);
        let mode = source::material_mode(&settings).unwrap();
        let scene = source::load(file.to_str().unwrap(), mode).unwrap().0;
        let camera = source::camera(&scene, &settings).unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let size = std::env::var("LIGHTTREE_SIZE").map_or(SIZE, |size| {
            let (width, height) = size.split_once('x').expect("write widthxheight");
            (width.parse().expect("a number of pixels"), height.parse().expect("a number of pixels"))
        });
        let kind = material.split(':').next().unwrap_or_default();
        let reference = std::env::var("LIGHTTREE_REFERENCES").ok().map(|folder| {
            let file = Path::new(&folder).join(format!("{name}-{kind}.exr"));
            report::reference(&file, size).unwrap()
        });
        Some(Self {
            name: what.to_owned(),
            scene,
            rays,
            camera,
            material: material.to_owned(),
            size,
            reference,
        })
    }

    fn stage(&self) -> Stage<'_> {
        Stage { scene: &self.scene, rays: &self.rays, camera: &self.camera }
    }

    fn plan(&self, method: &str, dials: &[&str]) -> Plan {
        let settings = settings(method, &self.material, dials);
        let method = Method::named(method).unwrap();
        Plan { method, settings, gi: Gi::Vpl(1_000_000), bounces: 5, seed: 1, light_seed: 1 }
    }

    /// One picture, and the seconds of one processor that it took.
    fn take(
        &self,
        prepared: &Prepared<'_>,
        plan: &Plan,
        (width, height): (u32, u32),
        pixels: Option<usize>,
        left: &mut Left,
    ) -> (Rendered, f64) {
        let params = RenderParams { width, height, threads: 1, pixels, ..RenderParams::default() };
        let start = processor_seconds();
        let rendered = self.stage().render_after(plan, prepared, &params, &(), left).unwrap();
        (rendered, processor_seconds() - start)
    }

    /// RMSE and relative RMSE on the pixels of the reference.
    fn error(&self, film: &Film, mask: &[bool]) -> String {
        let Some(reference) = &self.reference else { return "no reference".to_owned() };
        let errors = compare(film, reference, Some(mask)).unwrap();
        self.name_worst(film, reference, mask);
        format!(
            "{:.3e} | {:.2} % | {:.2} %",
            errors.mse.sqrt(),
            100.0 * errors.relmse.sqrt(),
            100.0 * errors.mape
        )
    }
}

impl Table {
    /// The pixels that hold most of the squared error.
    fn name_worst(&self, film: &Film, reference: &Film, mask: &[bool]) {
        let count =
            std::env::var("LIGHTTREE_WORST").map_or(0, |count| count.parse().expect("a number of pixels"));
        let off = |i: usize| (film.pixels[i] - reference.pixels[i]).element_sum() / 3.0;
        let mut worst: Vec<usize> = (0..mask.len()).filter(|&i| mask[i]).collect();
        worst.sort_by(|&a, &b| off(b).abs().total_cmp(&off(a).abs()));
        for &i in &worst[..count.min(worst.len())] {
            let width = self.size.0 as usize;
            let (x, y, truth) = (i % width, i / width, reference.pixels[i].element_sum() / 3.0);
            eprintln!("    pixel {x}, {y}: {truth:.4} is off by {:.4}", off(i));
        }
    }
}

impl Table {
    /// Writes a picture, if there is a folder for it.
    fn keep(&self, name: &str, film: &Film, stops: f32) {
        let Ok(folder) = std::env::var("LIGHTTREE_MAPS") else { return };
        let file = Path::new(&folder).join(format!("{}-{name}.png", self.name.replace(':', "-")));
        scene::write_png(film, &file, stops).unwrap();
    }
}

/// Difference of brightness as a share of it, what is darker than a twentieth of the mean taken as that.
fn off_by(film: &Film, truth: &Film) -> Film {
    let bright = |film: &Film, i: usize| scene::luminance(film.pixels[i]);
    let count = film.pixels.len();
    let mean = (0..count).map(|i| bright(truth, i)).sum::<f32>() / count as f32;
    let off = |i: usize| (bright(film, i) - bright(truth, i)).abs() / bright(truth, i).max(0.05 * mean);
    let mut out = Film::new(film.width, film.height);
    out.pixels = (0..count).map(|i| glam::Vec3::splat(off(i))).collect();
    out
}

fn settings(method: &str, material: &str, dials: &[&str]) -> Settings {
    let mut set = vec![format!("materials={material}"), "clamp=1".to_owned()];
    let method = Method::named(method).unwrap();
    set.extend(dials.iter().map(|&dial| dial.to_owned()));
    if method == Method::Lightcut && !dials.iter().any(|dial| dial.starts_with("threshold")) {
        set.push("threshold=0.01".to_owned());
    }
    Settings::parse("the table", &method.keys(), &set).unwrap()
}

fn processor_seconds() -> f64 {
    let usage = getrusage(UsageWho::RUSAGE_SELF).unwrap();
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    seconds(usage.user_time()) + seconds(usage.system_time())
}

/// What a point of `lightcut` takes, asked again and again.
struct Yardstick<'a> {
    table: &'a Table,
    prepared: &'a Prepared<'a>,
    plan: Plan,
    /// Seconds of a point.
    last: f64,
    /// Least and largest so far.
    range: (f64, f64),
}

impl<'a> Yardstick<'a> {
    /// Takes it for the first time.
    fn new(table: &'a Table, prepared: &'a Prepared<'a>) -> Self {
        let plan = table.plan("lightcut", &[]);
        let mut yardstick = Self { table, prepared, plan, last: 0.0, range: (f64::INFINITY, 0.0) };
        let timed = yardstick.measure();
        eprintln!(
            "{}",
            row("lightcut", &timed, yardstick.last * timed.counts.samples as f64, yardstick.last)
        );
        yardstick
    }

    fn measure(&mut self) -> Rendered {
        let Self { table, prepared, plan, .. } = self;
        let (timed, seconds) = table.take(prepared, plan, table.size, Some(TIMED), &mut Left::default());
        self.last = seconds / timed.counts.samples as f64;
        self.range = (self.range.0.min(self.last), self.range.1.max(self.last));
        timed
    }

    /// Runs `what`, and says what a point of `lightcut` took meanwhile: the mean of before and after.
    fn beside<T>(&mut self, what: impl FnOnce() -> T) -> (T, f64) {
        let before = self.last;
        let result = what();
        self.measure();
        (result, 0.5 * (before + self.last))
    }
}

impl Drop for Yardstick<'_> {
    fn drop(&mut self) {
        let (least, largest) = self.range;
        eprintln!("lightcut took {:.1} to {:.1} us a point", 1e6 * least, 1e6 * largest);
    }
}

/// Most nodes with which a lightcut takes `seconds` a point.
fn nodes_for_equal_time(table: &Table, prepared: &Prepared<'_>, seconds: f64) -> u32 {
    let takes = |nodes: u32| {
        let plan = table.plan("lightcut", &[&format!("max_nodes={nodes}")]);
        let (timed, seconds) = table.take(prepared, &plan, table.size, Some(2 * TIMED), &mut Left::default());
        seconds / timed.counts.samples as f64
    };
    let (mut low, mut high) = (1, 1024);
    while high - low > 1 + low / 32 {
        let middle = (low + high) / 2;
        *(if takes(middle) > seconds { &mut high } else { &mut low }) = middle;
    }
    low
}

fn row(name: &str, rendered: &Rendered, seconds: f64, of: f64) -> String {
    let counts = &rendered.counts;
    let points = counts.samples as f64;
    format!(
        "{name}: {seconds:.2} s, {:.1} us a point, {:.2} times faster; {:.1} rays, {:.1} visits a point; cuts of {:.0}; {} fallbacks",
        1e6 * seconds / points,
        of / (seconds / points),
        counts.shadow_rays as f64 / points,
        counts.node_visits as f64 / points,
        counts.cut_nodes as f64 / counts.cuts.max(1) as f64,
        counts.fallbacks,
    )
}

fn scenes() -> Vec<Table> {
    let scenes = std::env::var("LIGHTTREE_TABLE").unwrap_or_else(|_| "sponza:diffuse".to_owned());
    scenes.split(',').filter_map(Table::open).collect()
}

#[test]
#[ignore = "some minutes a scene"]
fn table_of_modes() {
    for table in scenes() {
        let prepared = table.stage().prepare(&table.plan("cutinterp", &[])).unwrap();
        let lightcut = table.plan("lightcut", &[]);
        let mut none = Left::default();
        eprintln!("== {}", table.name);
        let (judged, _) = table.take(&prepared, &lightcut, table.size, Some(JUDGED), &mut none);
        let mask = judged.mask.clone().unwrap();
        let mut yardstick = Yardstick::new(&table, &prepared);
        eprintln!("error lightcut | {}", table.error(&judged.film, &mask));
        let only = std::env::var("LIGHTTREE_MODES");
        for (method, dials, name) in MODES {
            let wanted = match &only {
                Ok(only) => only.split(',').any(|wanted| wanted == name),
                Err(_) => !name.ends_with(UNGUARDED),
            };
            if !wanted {
                continue;
            }
            let plan = table.plan(method, dials);
            let whole = || table.take(&prepared, &plan, table.size, None, &mut Left::default());
            let ((whole, seconds), each) = yardstick.beside(whole);
            eprintln!("{}", row(name, &whole, seconds, each));
            eprintln!("error {name} | {}", table.error(&whole.film, &mask));
        }
        drop(yardstick);
        if only.is_ok() {
            continue;
        }

        // The error of `recon` on the same pixels; whose time is taken from small pictures, because blocks
        // that are divided down to single pixels take as long as a lightcut.
        let recon = table.plan("recon", &[]);
        let (judged, _) = table.take(&prepared, &recon, table.size, Some(JUDGED), &mut none);
        eprintln!("error recon | {}", table.error(&judged.film, &mask));
        small_pictures(&table, &prepared);
    }
}

/// Small pictures by all modes, for the eye: how much they differ from a whole picture by `lightcut`.
#[test]
#[ignore = "some minutes a scene"]
fn table_of_small_pictures() {
    for table in scenes() {
        let prepared = table.stage().prepare(&table.plan("cutinterp", &[])).unwrap();
        eprintln!("== {}", table.name);
        small_pictures(&table, &prepared);
    }
}

fn small_pictures(table: &Table, prepared: &Prepared<'_>) {
    let lightcut = table.plan("lightcut", &[]);
    let (seen, seconds) = table.take(prepared, &lightcut, SEEN, None, &mut Left::default());
    let each = seconds / seen.counts.samples as f64;
    eprintln!("{}", row("lightcut, small", &seen, seconds, each));
    let stops = scene::auto_exposure(&seen.film);
    table.keep("lightcut", &seen.film, stops);
    let modes = MODES.into_iter().filter(|(.., name)| !name.ends_with(UNGUARDED));
    for (method, dials, name) in modes.chain([("recon", &[][..], "recon")]) {
        let plan = table.plan(method, dials);
        let (small, seconds) = table.take(prepared, &plan, SEEN, None, &mut Left::default());
        let flip = compare(&small.film, &seen.film, None).unwrap().flip.unwrap_or(f64::NAN);
        eprintln!("FLIP {flip:.4} {}", row(&format!("{name}, small"), &small, seconds, each));
        table.keep(name, &small.film, stops);
        table.keep(&format!("{name}-off"), &off_by(&small.film, &seen.film), 1.0);
    }
    if std::env::var("LIGHTTREE_MAPS").is_ok() {
        for shown in ["records", "weights", "cut-size", "visibility"] {
            let plan = table.plan("cutinterp-vis", &[&format!("show={shown}")]);
            let (small, _) = table.take(prepared, &plan, SEEN, None, &mut Left::default());
            table.keep(shown, &small.film, 0.0);
        }
    }
}

/// What dials are worth: each row of `LIGHTTREE_DIALS` (between semicolons) is a method and its dials,
/// between spaces; `equal-time` is a lightcut of as many nodes as fit in the time of the row before.
#[test]
#[ignore = "some minutes a scene"]
fn curve_of_speed() {
    for table in scenes() {
        let prepared = table.stage().prepare(&table.plan("cutinterp", &[])).unwrap();
        let lightcut = table.plan("lightcut", &[]);
        eprintln!("== {}", table.name);
        let (judged, _) = table.take(&prepared, &lightcut, table.size, Some(JUDGED), &mut Left::default());
        let mask = judged.mask.clone().unwrap();
        let mut yardstick = Yardstick::new(&table, &prepared);
        eprintln!("    | {}", table.error(&judged.film, &mask));
        let rows = std::env::var("LIGHTTREE_DIALS").unwrap_or_else(|_| "cutinterp-vis".to_owned());
        let mut last = 0.0;
        for dials in rows.split(';') {
            let tuned = (dials == "equal-time").then(|| nodes_for_equal_time(&table, &prepared, last));
            let dials = tuned.map_or(dials.to_owned(), |nodes| format!("lightcut max_nodes={nodes}"));
            let parts: Vec<_> = dials.split(' ').collect();
            let plan = table.plan(parts[0], &parts[1..]);
            // Lightcuts of any fineness are for equal time.
            let pixels = (parts[0] == "lightcut").then_some(TIMED);
            let whole = || table.take(&prepared, &plan, table.size, pixels, &mut Left::default());
            let ((whole, seconds), each) = yardstick.beside(whole);
            last = seconds / whole.counts.samples as f64;
            let judged = match pixels {
                Some(_) => table.take(&prepared, &plan, table.size, Some(JUDGED), &mut Left::default()).0,
                None => whole.clone(),
            };
            eprintln!("{} | {}", row(&dials, &whole, seconds, each), table.error(&judged.film, &mask));
        }
    }
}

/// What rays are worth to the adaptive mode.
#[test]
#[ignore = "some minutes a scene"]
fn curve_of_adaptive_visibility() {
    for table in scenes() {
        let prepared = table.stage().prepare(&table.plan("cutinterp", &[])).unwrap();
        let (judged, _) = table.take(
            &prepared,
            &table.plan("lightcut", &[]),
            table.size,
            Some(JUDGED),
            &mut Left::default(),
        );
        let mask = judged.mask.clone().unwrap();
        eprintln!("== {}\nlightcut | {}", table.name, table.error(&judged.film, &mask));
        let mut left = Left::default();
        let mut take = |dials: &[&str]| {
            let plan = table.plan("cutinterp", dials);
            // These do not move records.
            let about_points = ["visibility", "trust", "ray_share", "guard"];
            if !dials.iter().all(|dial| about_points.iter().any(|name| dial.starts_with(name))) {
                left = Left::default();
            }
            let (taken, _) = table.take(&prepared, &plan, table.size, Some(JUDGED), &mut left);
            let rays = taken.counts.shadow_rays as f64 / taken.counts.samples as f64;
            eprintln!("{dials:?}: {rays:.0} rays | {}", table.error(&taken.film, &mask));
        };
        take(&["visibility=interpolated"]);
        take(&["visibility=full"]);
        // Dials that move records must not find those of the last row.
        let dials = std::env::var("LIGHTTREE_DIALS").unwrap_or_else(|_| DIALS.to_owned());
        for dials in dials.split(';') {
            take(&dials.split(' ').collect::<Vec<_>>());
        }
        take(&["visibility=adaptive"]);
    }
}
