//! `cargo xtask bake`: a scene's light into maps, and edits of the scene after it.

mod args;
mod edits;
mod output;
mod state;
mod summary;
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

pub(crate) use self::args::BakeArgs;
use self::args::KEYS;
use self::edits::{Edit, Outcome};
use self::output::Maps;
use self::state::{State, fnv, hash_scene};
use self::summary::{Seconds, summary};
use self::world::{Geometry, World};
use crate::failure::Failure;
use crate::settings::{Key, Settings};
use crate::{render, source, stop};

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
        let dial =
            |key: Key| format!("  {}={} ({})\n      {}\n", key.name, key.default, key.range, key.trades);
        return crate::output::print(&KEYS.map(dial).concat());
    }
    let total = Instant::now();
    let settings = Settings::parse("bake", &KEYS, &args.set)?;
    let folder = args.output.as_deref().unwrap_or(Path::new("."));
    if args.texels_per_unit.is_some_and(|d| !(d > 0.0 && d.is_finite())) {
        return Err(Failure::usage("--texels-per-unit: a positive number is needed"));
    }
    crate::output::check_folder(folder)?;
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

    if bake.map.texels() == 0 && bake.world.scene.triangle_count() > 0 {
        eprintln!(
            "note: no texel is lit: the map is too coarse for what is there; give more --texels-per-unit"
        );
    }
    crate::output::make_folder(folder)?;

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
    let seconds =
        Seconds { load, unwrap, bake: baking, write: writing, total: total.elapsed().as_secs_f64() };
    let summary = summary(&bake, &pages, &written, &seconds);
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
        crate::output::print(&format!("{summary}\n"))?;
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

        if let Some(key) = world.lamps.iter().position(|lamp| !lamp.light.flux.is_finite()) {
            let line = "its flux is more than 3.4e38 W: make it darker, or the scene smaller";
            return Err(Failure::failed(format!("{name}: light {key}: {line}")));
        }

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
            patience: settings.number("patience").map_or(1.5, f64::from),
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
        if self.done < self.edits.len() {
            self.watch(camera)?;
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

    /// From now on what the camera sees comes first.
    fn watch(&mut self, camera: &scene::Camera) -> Result<(), Failure> {
        let size = self.args.size;
        let points = view::looked_at(&self.geometry, camera, size, self.settings.whole("watch"));
        self.baker.watch(&points).map_err(|error| Failure::failed(format!("--set watch: {error}")))?;
        // One look at what is baked, before it changes.
        let (world, geometry) = (&self.world, &self.geometry);
        let budget = StepBudget { paths: 0, accumulations: 0 };
        self.baker.step(budget, &|rays, hits| world.trace(geometry, rays, hits), &mut |_| {});
        Ok(())
    }

    /// Steps until all is up to date, or so many updates were made since the last edit; whether it came so
    /// far.
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
        let about = json!({
            "scene": self.world.scene.name, "camera": camera.name, "width": size.0, "height": size.1, "spp": spp,
            "settings": self.settings.json(), "edits": self.done, "updates": self.updates,
            "unit": "linear RGB radiance, W/m2/sr, lit by the lightmap alone",
        });
        let png = crate::output::picture(path, &film, stops, &about)?;
        eprintln!("wrote {} and {} (exposure {stops:+.2} stops)", path.display(), png.display());
        Ok(())
    }
}
