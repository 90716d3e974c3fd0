//! `cargo xtask bake`: a scene's light into maps, and edits of the scene after it.

mod edits;
mod output;
mod state;
mod view;
mod world;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bake::lightmap::{ImageParams, LayoutParams, Lightmap, LightmapParams};
use bake::{Aperture, BakeParams, Baker, GeometryVersion, LightKey, StepBudget, Update};
use glam::Vec3;
use scene::MaterialMode;
use serde_json::json;

use self::edits::{Edit, Outcome};
use self::output::Maps;
use self::state::{Fnv, State, fnv};
use self::world::{Geometry, World};
use crate::failure::Failure;
use crate::settings::{Key, Range, Settings};
use crate::{memory, render, source, stop};

/// What to bake, and how.
#[derive(clap::Args)]
pub(crate) struct BakeArgs {
    /// A .glb or .gltf file, or a built-in scene with an optional number of lights; materials are read as diffuse
    #[arg(default_value = "cornell")]
    scene: String,

    /// Edits to follow after the first bake, a list of objects in JSON; docs/bake.md says which there are
    #[arg(long, value_name = "FILE.json")]
    edits: Option<PathBuf>,

    /// Texels of the maps along a unit of length; without it, as many as make some 60000 in all
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    texels_per_unit: Option<f32>,

    /// Go on from a saved bake: the file bake.state that each run keeps in its folder
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,

    /// Turn a dial, as often as you like; --help-dials lists them
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Width and height of the picture that --set view=1 makes
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = render::size)]
    size: (u32, u32),

    /// Threads; 0 takes as many as there are processors. The result is the same for any number
    #[arg(long, value_name = "T", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1024))]
    threads: u32,

    /// Folder for maps, scene, sidecar and the saved bake; made if it isn't there
    #[arg(long, short, value_name = "DIR", required_unless_present = "help_dials")]
    output: Option<PathBuf>,

    /// Print one JSON object as the last line of standard output
    #[arg(long)]
    json: bool,

    /// List the dials, and end
    #[arg(long)]
    help_dials: bool,
}

const KEYS: [Key; 17] = [
    Key {
        name: "clusters",
        default: "600",
        range: Range::Whole(1, 1_000_000),
        trades: "virtual lights: accuracy of indirect light and soft shadows against time",
    },
    Key {
        name: "paths",
        default: "100000",
        range: Range::Whole(1, 1 << 26),
        trades: "light paths: accuracy of indirect light against time and 64 bytes a surface that they meet",
    },
    Key {
        name: "bounces",
        default: "3",
        range: Range::Whole(1, 16),
        trades: "surfaces that a path meets: light of corners against time",
    },
    Key {
        name: "samples",
        default: "1",
        range: Range::Whole(1, 16),
        trades: "points of each texel: smooth edges of shadows against time and 28 bytes a texel",
    },
    Key {
        name: "directional",
        default: "0",
        range: Range::Whole(0, 1),
        trades: "1: four coefficients of spherical harmonics for normal maps, at 108 bytes a texel",
    },
    Key {
        name: "charts",
        default: "new",
        range: Range::OneOf(&["new", "keep"]),
        trades: "keep: meshes with TEXCOORD_1 are baked with it",
    },
    Key {
        name: "page",
        default: "4096",
        range: Range::Whole(64, 16_384),
        trades: "largest side of a map, texels",
    },
    Key {
        name: "padding",
        default: "2",
        range: Range::Whole(0, 7),
        trades: "empty texels around charts: 2 for bicubic lookups, 1 for bilinear ones",
    },
    Key {
        name: "stitch",
        default: "1",
        range: Range::Whole(0, 1),
        trades: "0: seams between charts stay as they are",
    },
    Key {
        name: "maps",
        default: "atlas",
        range: Range::OneOf(&["atlas", "objects"]),
        trades: "objects: one map for each object",
    },
    Key {
        name: "format",
        default: "f32",
        range: Range::OneOf(&["f32", "f16"]),
        trades: "f16: half the size, at most 65504 W/m2",
    },
    Key {
        name: "view",
        default: "0",
        range: Range::Whole(0, 1),
        trades: "1: also a picture of what a camera sees, lit by the maps; one more after each \"bake\" edit",
    },
    Key {
        name: "spp",
        default: "4",
        range: Range::Whole(1, 4096),
        trades: "samples of a pixel of that picture",
    },
    Key {
        name: "camera",
        default: "first",
        range: Range::Words("first or a camera's name"),
        trades: "whose picture it is",
    },
    Key {
        name: "exposure",
        default: "auto",
        range: Range::WordOrNumber("auto", -40.0, 40.0),
        trades: "stops by which pictures are brightened",
    },
    Key {
        name: "save",
        default: "10",
        range: Range::Number(0.0, f32::INFINITY),
        trades: "seconds between saved bakes: what a kill costs against writing",
    },
    Key {
        name: "seed",
        default: "1",
        range: Range::Whole(0, u32::MAX as u64),
        trades: "seed of all random numbers",
    },
];

/// Texels that a bake has when nothing is said.
const TEXELS: f64 = 60_000.0;

/// A bake under way.
struct Bake<'a> {
    world: World,
    baker: Baker,
    map: Lightmap<Geometry>,
    geometry: Geometry,
    edits: Vec<Edit>,
    hashes: Vec<u64>,
    /// Edits that are done.
    done: usize,
    /// Updates since the last of these.
    since: u64,
    scene_hash: u64,
    settings_hash: u64,
    state_path: PathBuf,
    save_every: f32,
    last_saved: Instant,
    accumulations: u64,
    updates: u64,
    args: &'a BakeArgs,
    settings: &'a Settings,
}

/// Bakes.
pub(crate) fn bake(args: &BakeArgs) -> Result<(), Failure> {
    if args.help_dials {
        for key in KEYS {
            println!("  {}={} ({})\n      {}", key.name, key.default, key.range, key.trades);
        }
        return Ok(());
    }
    let total = Instant::now();
    let settings = Settings::parse("bake", &KEYS, &args.set)?;
    let folder = args.output.as_deref().unwrap_or(Path::new("."));
    if args.texels_per_unit.is_some_and(|d| !(d > 0.0 && d.is_finite())) {
        return Err(Failure::usage("--texels-per-unit: a positive number is needed"));
    }
    render::use_threads(args.threads)?;
    stop::listen()?;
    let saved = args.resume.as_deref().map(State::read).transpose()?;

    // Read, unwrap, and take up what was saved.
    let (scene, load) = source::load(&args.scene, MaterialMode::Diffuse)?;
    let camera = source::camera(&scene, &settings)?;
    let scene_hash = hash_scene(&scene);
    let world = World::new(scene);
    let (edits, hashes) = match &args.edits {
        Some(path) => {
            let edits = edits::read(path, &world)?;
            (edits.list, edits.hashes)
        }
        None => (Vec::new(), Vec::new()),
    };
    let start = Instant::now();
    let mut bake = Bake::new(args, &settings, world, edits, hashes, scene_hash, folder)?;
    let unwrap = start.elapsed().as_secs_f64();
    if let (Some(state), Some(path)) = (saved, &args.resume) {
        bake.take_up(&state).map_err(|why| Failure::failed(format!("{}: {why}", path.display())))?;
    }
    eprintln!(
        "{} objects on {} page(s) of {}x{}, {} texels in {} charts; {} lights",
        bake.world.objects.len(),
        bake.map.layout().pages,
        bake.map.layout().size[0],
        bake.map.layout().size[1],
        bake.map.texels(),
        bake.map.layout().charts,
        bake.world.lamps.len(),
    );
    std::fs::create_dir_all(folder).map_err(|error| {
        Failure::failed(format!("{}: {error}: choose another place with -o", folder.display()))
    })?;

    // Bake, edit, bake.
    let start = Instant::now();
    let cut_short = !bake.run(folder, &camera)?;
    let baking = start.elapsed().as_secs_f64();
    bake.save()?;

    // Write what there is.
    let start = Instant::now();
    let pages = bake.pages();
    let maps = if settings.text("maps") == "objects" { Maps::Objects } else { Maps::Atlas };
    let half = settings.text("format") == "f16";
    let stops = settings.number("exposure");
    let written = output::write(folder, &bake.world, bake.map.layout(), &pages, maps, half, stops)?;
    if settings.whole("view") == 1 {
        bake.view(&folder.join("view.exr"), &camera)?;
    }
    let writing = start.elapsed().as_secs_f64();
    let (coverage, receivers, counts) = (bake.map.coverage(), bake.map.receivers(), bake.map.counts());
    let (stats, layout) = (bake.baker.stats(), bake.map.layout());
    let stitched = pages.iter().map(|page| page.stitched);
    let worst = |pick: fn(&bake::lightmap::StitchReport) -> f64| {
        pages.iter().map(|p| pick(&p.stitched)).fold(0.0, f64::max)
    };
    let summary = json!({
        "scene": bake.world.scene.name,
        "triangles": bake.world.scene.triangle_count(),
        "objects": bake.world.objects.len(),
        "lights": bake.world.lamps.iter().filter(|lamp| lamp.present).count(),
        "edits": bake.edits.len(),
        "size": layout.size, "pages": layout.pages, "charts": layout.charts,
        "texels": bake.map.texels(), "texels_per_unit": layout_params(args, &settings, &bake.world).texels_per_unit,
        "clusters": bake.baker.clusters(), "virtual_lights": bake.map.live(), "path_vertices": bake.baker.path_vertices(),
        "updates": bake.updates, "accumulations": bake.accumulations,
        "paths": { "validated": stats.paths_validated, "traced": stats.paths_traced, "changed": stats.paths_changed },
        "seconds": { "load": load, "unwrap": unwrap, "bake": baking, "write": writing, "total": total.elapsed().as_secs_f64() },
        "counts": {
            "flat_triangles": coverage.flat_triangles, "overlapping": coverage.overlapping, "outside": coverage.outside,
            "pushed": receivers.pushed, "dead": receivers.dead, "cut_off": counts.cut_off, "non_finite": counts.non_finite,
            "wrapped": counts.wrapped, "unsound_hits": stats.unsound_hits, "saturated": written.saturated,
            "dilated": pages.iter().map(|page| page.dilated).sum::<u64>(),
        },
        "seams": { "edges": stitched.map(|s| s.seams).sum::<u64>(), "before": worst(|s| s.before), "after": worst(|s| s.after) },
        "bytes": { "lightmap": bake.map.bytes(), "baker": bake.baker.bytes(), "rays": bake.geometry.0.rays.bytes(), "peak_rss": memory::peak_resident() },
        "sums": format!("{:016x}", hash_sums(&bake.map)),
        "exposure": written.exposure,
        "output": written.files,
    });
    eprintln!(
        "{} virtual lights of {} clusters; {} accumulations in {} updates, {baking:.1} s; wrote {} in {}",
        bake.map.live(),
        bake.baker.clusters(),
        bake.accumulations,
        bake.updates,
        written.files.join(", "),
        folder.display()
    );
    if written.saturated > 0 {
        eprintln!(
            "note: {} values are larger than half floats hold and were cut off at 65504",
            written.saturated
        );
    }
    if args.json {
        println!("{summary}");
    }
    if cut_short {
        return Err(Failure::Interrupted(format!(
            "{}: cut short; go on with --resume {}",
            folder.display(),
            bake.state_path.display()
        )));
    }
    Ok(())
}

fn layout_params(args: &BakeArgs, settings: &Settings, world: &World) -> LayoutParams {
    let texels_per_unit = args.texels_per_unit.unwrap_or_else(|| {
        let area: f64 = world
            .scene
            .instances
            .iter()
            .map(|instance| {
                let mesh = &world.scene.meshes[instance.mesh as usize];
                let corners =
                    |t: &[u32; 3]| t.map(|v| instance.to_world.transform_point3(mesh.positions[v as usize]));
                let triangle =
                    |[a, b, c]: [Vec3; 3]| 0.5 * (b - a).as_dvec3().cross((c - a).as_dvec3()).length();
                mesh.triangles.iter().map(|t| triangle(corners(t))).sum::<f64>()
            })
            .sum();
        if area > 0.0 { (TEXELS / area).sqrt() as f32 } else { 1.0 }
    });
    LayoutParams {
        texels_per_unit,
        page_size: settings.whole("page"),
        padding: settings.whole("padding"),
        ..LayoutParams::default()
    }
}

/// A group of directions for the bake.
fn group(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32> {
    clustering::angular_clusters(directions, weights, count, 20).map_or_else(
        // What is no direction is counted by the bake before; one cluster for all is always right.
        |_| vec![0; directions.len()],
        |clusters| clusters.cluster_of,
    )
}

impl<'a> Bake<'a> {
    fn new(
        args: &'a BakeArgs,
        settings: &'a Settings,
        mut world: World,
        edits: Vec<Edit>,
        hashes: Vec<u64>,
        scene_hash: u64,
        folder: &Path,
    ) -> Result<Self, Failure> {
        let name = world.scene.name.clone();
        let layout = layout_params(args, settings, &world);
        let bounds = world.whole_box();

        // Equal power for every path: as many for each lamp as its share asks for.
        let radius = 0.5 * (bounds.max - bounds.min).length();
        let power = |lamp: &world::Lamp| {
            let mean = lamp.light.flux.as_dvec3().element_sum() / 3.0;
            let disk = core::f64::consts::PI * f64::from(radius).powi(2);
            if matches!(lamp.light.aperture, Aperture::Sky { .. }) { mean * disk } else { mean }
        };
        let total: f64 = world.lamps.iter().map(power).sum();
        let path_power = if total > 0.0 { total / f64::from(settings.whole("paths")) } else { 1.0 };
        for lamp in &mut world.lamps {
            lamp.light.paths =
                (power(lamp) / path_power).round().clamp(1.0, f64::from(bake::Light::MAX_PATHS)) as u32;
        }

        // All light on one texel is more than any will have.
        let largest = world.lamps.iter().map(|lamp| f64::from(lamp.light.flux.max_element())).sum::<f64>();
        let map_params = LightmapParams {
            layout,
            samples: settings.whole("samples"),
            directional: settings.whole("directional") == 1,
            peak: largest * (1.0 + f64::from(layout.texels_per_unit).powi(2)),
        };
        let keep = settings.text("charts") == "keep";
        let mut map = Lightmap::new(&world.meshes(keep), &world.object_views(), &map_params)
            .map_err(|error| Failure::failed(format!("{name}: {error}")))?;
        let geometry = world.geometry()?;
        map.set_geometry(GeometryVersion(0), geometry.clone(), &world.objects)
            .map_err(|error| Failure::failed(format!("{name}: {error}")))?;
        let params = BakeParams {
            bounces: settings.whole("bounces"),
            clusters: settings.whole("clusters") as usize,
            seed: settings.whole("seed"),
            ..BakeParams::new(bounds, path_power, group)
        };
        let mut baker = Baker::new(params).map_err(|error| Failure::failed(format!("{name}: {error}")))?;
        for (key, lamp) in world.lamps.iter().enumerate() {
            baker
                .add_light(LightKey(key as u32), lamp.light.clone())
                .map_err(|error| Failure::failed(format!("{name}: {error}")))?;
        }
        let decisive = format!("{map_params:?} {keep} {:?}", settings.text("seed"));
        Ok(Self {
            world,
            baker,
            map,
            geometry,
            edits,
            hashes,
            done: 0,
            since: 0,
            scene_hash,
            settings_hash: fnv(decisive.as_bytes()),
            state_path: folder.join("bake.state"),
            save_every: settings.number("save").unwrap_or(10.0),
            last_saved: Instant::now(),
            accumulations: 0,
            updates: 0,
            args,
            settings,
        })
    }

    /// Puts what was saved in place of a bake that has just begun.
    fn take_up(&mut self, state: &State) -> Result<(), String> {
        if state.scene != self.scene_hash {
            return Err("this bake is of another scene: bake anew without --resume".to_owned());
        }
        if state.settings != self.settings_hash {
            let what = "texels, samples, directional, charts, page, padding or seed";
            return Err(format!(
                "this bake was made with other {what}: give the same, or bake anew without --resume"
            ));
        }
        if let Some(index) = (0..state.edits.len()).find(|&i| self.hashes.get(i) != Some(&state.edits[i])) {
            return Err(format!(
                "edits[{index}] was another one when this was saved: give the same --edits, and new ones after them"
            ));
        }
        let params = *self.baker.params();
        let baker = Baker::load(&state.bake, self.scene_hash, params).map_err(|error| error.to_string())?;

        // Bring the world to where it was, and give the map the versions that its light is of.
        let needed: BTreeSet<GeometryVersion> = baker.contributions().map(|c| c.version).collect();
        let mut version = GeometryVersion(0);
        for edit in &self.edits[..state.edits.len()] {
            let outcome =
                edit.apply(&mut self.world, params.path_power, None).map_err(|error| error.to_string())?;
            if outcome == Outcome::NewGeometry {
                version.0 += 1;
                if needed.contains(&version) || version == baker.version() {
                    self.geometry = self.world.geometry().map_err(|failure| failure.to_string())?;
                    let given = self.map.set_geometry(version, self.geometry.clone(), &self.world.objects);
                    given.map_err(|error| error.to_string())?;
                }
            }
        }
        if version != baker.version() {
            return Err("its edits don't lead to where it is: bake anew without --resume".to_owned());
        }
        self.map.resume(&state.sums, baker.contributions()).map_err(|error| error.to_string())?;
        self.baker = baker;
        self.done = state.edits.len();
        self.since = state.since;
        Ok(())
    }

    /// Bakes, and does the edits; whether it came to the end.
    fn run(&mut self, folder: &Path, camera: &scene::Camera) -> Result<bool, Failure> {
        // The first bake belongs to no edit.
        if self.done == 0 && !self.settle(None)? {
            return Ok(false);
        }
        let mut pictures = 0;
        let shows = |edit: &Edit| matches!(edit, Edit::Bake { .. });
        while self.done < self.edits.len() {
            let edit = self.edits[self.done].clone();
            if let Edit::Bake { updates } = edit {
                if !self.settle(updates)? {
                    return Ok(false);
                }
            } else {
                let outcome = edit
                    .apply(&mut self.world, self.baker.params().path_power, Some(&mut self.baker))
                    .map_err(|error| Failure::failed(format!("edits[{}]: {error}", self.done)))?;
                if outcome == Outcome::NewGeometry {
                    self.geometry = self.world.geometry()?;
                    self.map
                        .set_geometry(self.baker.version(), self.geometry.clone(), &self.world.objects)
                        .map_err(|error| Failure::failed(error.to_string()))?;
                }
            }
            self.done += 1;
            self.since = 0;
            if shows(&edit) && self.settings.whole("view") == 1 {
                self.view(&folder.join(format!("view.{pictures}.exr")), camera)?;
                pictures += 1;
            }
        }
        self.settle(None)
    }

    /// Steps until all is up to date, or so many updates were made since the last edit; whether it came so far.
    fn settle(&mut self, updates: Option<u64>) -> Result<bool, Failure> {
        let budget = StepBudget { paths: 1 << 16, accumulations: if updates.is_some() { 1 } else { 32 } };
        let mut said = Instant::now();
        loop {
            if updates.is_some_and(|most| self.since >= most) {
                return Ok(true);
            }
            let (world, geometry, map) = (&self.world, &self.geometry, &mut self.map);
            let (mut failed, mut made, mut lights) = (None, 0, 0);
            let progress = self.baker.step(
                budget,
                &|rays, hits| world.trace(geometry, rays, hits),
                &mut |update: &Update| {
                    made += 1;
                    lights += update.accumulations() as u64;
                    if let Err(error) = map.apply(update) {
                        failed.get_or_insert(error);
                    }
                },
            );
            if let Some(error) = failed {
                return Err(Failure::failed(format!(
                    "internal: {error}; please report it with the command line"
                )));
            }
            self.since += made;
            self.updates += made;
            self.accumulations += lights;
            if progress.is_done {
                return Ok(true);
            }
            if self.last_saved.elapsed().as_secs_f32() >= self.save_every {
                self.save()?;
            }
            if stop::asked() {
                return Ok(false);
            }
            if said.elapsed().as_secs() >= 10 {
                said = Instant::now();
                eprintln!(
                    "{} accumulations so far; {} paths to validate, {} clusters to update",
                    self.accumulations, progress.paths_pending, progress.updates_pending
                );
            }
        }
    }

    fn save(&mut self) -> Result<(), Failure> {
        let state = State {
            scene: self.scene_hash,
            settings: self.settings_hash,
            edits: self.hashes[..self.done].to_vec(),
            since: self.since,
            bake: self.baker.save(self.scene_hash),
            sums: Vec::new(),
        };
        state.write(&self.state_path, || self.map.sums())?;
        self.last_saved = Instant::now();
        Ok(())
    }

    fn pages(&self) -> Vec<bake::lightmap::Image> {
        let params = ImageParams { stitch: self.settings.whole("stitch") == 1, ..ImageParams::default() };
        self.map.images(&params)
    }

    fn view(&self, path: &Path, camera: &scene::Camera) -> Result<(), Failure> {
        let pages = self.pages();
        let (size, spp) = (self.args.size, self.settings.whole("spp"));
        let film = view::view(&self.world, &self.geometry, self.map.layout(), &pages, camera, size, spp);
        let stops = render::exposure(self.settings, &film);
        let png = crate::output::picture(path, &film, stops)?;
        eprintln!("wrote {} and {} (exposure {stops:+.2} stops)", path.display(), png.display());
        Ok(())
    }
}

fn hash_sums(map: &Lightmap<Geometry>) -> u64 {
    let mut hash = Fnv::default();
    map.sums().for_each(|sum| hash.bytes(&sum.to_le_bytes()));
    hash.0
}

/// Everything of a scene that light depends on.
fn hash_scene(scene: &scene::Scene) -> u64 {
    let mut hash = Fnv::default();
    let vectors = |hash: &mut Fnv, values: &[Vec3]| {
        values.iter().flat_map(|v| v.to_array()).for_each(|x| hash.bytes(&x.to_le_bytes()));
    };
    for mesh in &scene.meshes {
        vectors(&mut hash, &mesh.positions);
        vectors(&mut hash, &mesh.normals);
        mesh.uvs
            .iter()
            .chain(&mesh.uvs1)
            .flat_map(|uv| uv.to_array())
            .for_each(|x| hash.bytes(&x.to_le_bytes()));
        mesh.triangles.iter().flatten().for_each(|v| hash.bytes(&v.to_le_bytes()));
        hash.bytes(&mesh.material.to_le_bytes());
    }
    let texts = [
        format!("{:?}", scene.instances),
        format!("{:?}", scene.materials),
        format!("{:?}", scene.lights),
        format!("{:?}", scene.distant),
    ];
    texts.iter().for_each(|text| hash.bytes(text.as_bytes()));
    scene.textures.iter().for_each(|texture| hash.bytes(texture.texels.as_flattened()));
    hash.0
}
