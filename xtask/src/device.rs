//! `--device gpu`: the tree, the draws, the shading and the rays of a picture on a wgpu device.
//!
//! What the camera sees is found as on the CPU: its rays are traced on the device, what their hits mean
//! (textures, glass, mirrors) is the reference host's. Then the device draws lights for every pixel, shades
//! and casts shadow rays; a pixel's radiance comes back.

mod draws;
mod filters;
mod lights;
mod records;
mod stages;

use std::time::Instant;

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{BatchRayQueries, Ray, RayHit, WeightedLight};
use rayon::prelude::*;
use render_gpu::draw::DrawRequest;
use render_gpu::rays::{DeviceRays, RayGeometry};
use render_gpu::shade::{RadianceRecord, ShadeKernel, ShadeParams, Shading, SurfaceRecord};
use render_gpu::{Gpu, GpuError, ReceiverRecord, StageTimes};
use scene::{
    Camera, CameraPath, Counts, Film, FlatRays, Frame, Light, Progress, Purpose, RayScratch, RaysParams,
    RenderParams, Rendered, Scene, SceneRays, camera_path, camera_ray,
};
use wgpu::{Buffer, BufferUsages};

use self::draws::{Drawer, Drawing, Kernels};
pub(crate) use self::filters::DeviceFilters;
use self::lights::{DeviceLights, TreeBuilder};
use self::stages::Stages;
use crate::failure::Failure;
use crate::shot::{Gi, Plan};
use crate::trees;

/// A device and what is kept on it from frame to frame.
pub(crate) struct Device {
    gpu: Gpu,
    kernels: Kernels,
    trees: TreeBuilder,
    /// Of the last frame.
    rays: Option<DeviceRays>,
    shade: Option<ShadeKernel>,
    /// Lights and buffers of the last frame.
    room: Option<Room>,
    times: StageTimes,
    /// What each stage of all frames took.
    stages: Stages,
}

/// Most stages of one submission.
const STAGES: u32 = 4;

/// Pixels that are on the device at once, and what they are given.
struct Band {
    first: u32,
    pixels: u32,
    drawer: Drawer,
}

/// Lights with their tree, and buffers that bands take turns with.
struct Room {
    /// What the bands are for.
    drawing: Drawing,
    lights: DeviceLights,
    receivers: Buffer,
    surfaces: Buffer,
    shading: Shading,
    bands: Vec<Band>,
}

/// What a pixel is known to show before its lights are drawn.
struct Seen {
    emission: DVec3,
    /// What the lit point's radiance is multiplied by.
    throughput: Vec3,
    /// Of lights without a place.
    distant: DVec3,
    is_lit: bool,
}

/// Whether lights are drawn from a tree of two levels.
fn is_two_level(plan: &Plan) -> bool {
    plan.settings.find("builder") == Some("two-level")
}

fn failed(error: &dyn std::fmt::Display) -> Failure {
    Failure::failed(format!("--device gpu: {error}"))
}

fn refused(what: &str) -> Failure {
    Failure::usage(format!("--device gpu: {what}"))
}

/// That a plan can be carried out on a device at all: before any of the work is done.
///
/// # Errors
/// A usage error that names what can't.
pub(crate) fn check(plan: &Plan, params: &RenderParams) -> Result<(), Failure> {
    Drawing::of(plan, (params.width, params.height))?;
    if plan.gi == Gi::Path {
        return Err(refused("--gi path walks on the cpu alone; take --gi vpl or none"));
    }
    if params.pixels.is_some() {
        return Err(refused("--pixels is for the cpu; leave it out"));
    }
    if plan.settings.number("clamp").is_some_and(f32::is_finite) {
        return Err(refused("virtual lights are not clamped there; leave --set clamp out"));
    }
    match plan.settings.find("builder") {
        None | Some("perfect" | "two-level") => {}
        Some(builder) if builder == trees::BUILDER.default => {}
        Some(builder) => {
            return Err(refused(&format!(
                "the device builds perfect and two-level trees, not {builder}; leave --set builder out"
            )));
        }
    }
    Ok(())
}

/// That the device has what a scene asks for.
///
/// # Errors
/// A failure that names what it lacks.
fn check_scene(scene: &Scene) -> Result<(), Failure> {
    let textured = scene.lights.iter().any(|light| {
        let Light::Triangle { instance, .. } = light else { return false };
        let mesh = scene.instances.get(*instance as usize).map(|placed| placed.mesh as usize);
        let material = mesh.and_then(|mesh| scene.meshes.get(mesh)).map(|mesh| mesh.material as usize);
        material.and_then(|m| scene.materials.get(m)).is_some_and(|m| m.emissive_texture.is_some())
    });
    if textured {
        return Err(refused("an emitter of the scene has a texture, which it does not look up; use the cpu"));
    }
    Ok(())
}

impl Device {
    /// The best adapter there is.
    ///
    /// # Errors
    /// A failure that says what is missing: as a rule the driver.
    pub(crate) fn new(plan: &Plan, params: &RenderParams) -> Result<Self, Failure> {
        let drawing = Drawing::of(plan, (params.width, params.height))?;
        let gpu = Gpu::request().map_err(|error| failed(&error))?;
        let two_level = is_two_level(plan);
        let kernels = Kernels::new(&gpu, &drawing, trees::choice(&plan.settings), two_level);
        let kernels = kernels.map_err(|error| failed(&error))?;
        let trees = TreeBuilder::new(&gpu, two_level).map_err(|error| failed(&error))?;
        let times = StageTimes::new(&gpu, STAGES).map_err(|error| failed(&error))?;
        let (rays, shade, room) = (None, None, None);
        Ok(Self { gpu, kernels, trees, rays, shade, room, times, stages: Stages::default() })
    }

    /// Filters of pictures on it.
    ///
    /// # Errors
    /// If its kernels are refused.
    pub(crate) fn filters(&self) -> Result<DeviceFilters, Failure> {
        DeviceFilters::new(&self.gpu).map_err(|error| failed(&error))
    }

    /// What it calls itself.
    pub(crate) fn name(&self) -> String {
        self.gpu.device().adapter_info().name
    }

    /// What each stage of all frames took.
    pub(crate) const fn stages(&self) -> &Stages {
        &self.stages
    }

    /// Adds what a stage took that others look after.
    pub(crate) fn add_stage(&mut self, name: &'static str, seconds: f64) {
        self.stages.add(name, seconds);
    }

    /// Brings geometry to the device, unless what is there is still right. Returns seconds.
    ///
    /// # Errors
    /// A failure that names what does not fit, or is not there: alpha masks.
    pub(crate) fn place(&mut self, scene: &Scene, moved: bool) -> Result<f64, Failure> {
        if self.rays.is_some() && !moved {
            return Ok(0.0);
        }
        let start = Instant::now();
        check_scene(scene)?;
        // As many as a binding holds; beyond, a tree per mesh may still do.
        let most = self.gpu.device().limits().max_storage_buffer_binding_size / 48;
        let flat =
            FlatRays::new(scene, &RaysParams { max_flattened: most }).map_err(|error| failed(&error))?;
        if flat.masked > 0 {
            return Err(refused(&format!(
                "{} meshes of the scene have alpha masks, which its rays do not look up; use the cpu, or --set materials=diffuse",
                flat.masked
            )));
        }
        let geometry = records::geometry(&flat, |geometry| RayGeometry::new(&self.gpu, geometry));
        let geometry = geometry.map_err(|error| failed(&error))?;
        let source = geometry.source().clone();
        let had = self.rays.as_ref().map(|rays| rays.geometry().has_instances());
        // Kernels are for geometry of one kind.
        if had.is_some_and(|had| had != geometry.has_instances()) {
            (self.shade, self.room) = (None, None);
        }
        self.rays = Some(DeviceRays::new(&self.gpu, geometry).map_err(|error| failed(&error))?);
        if self.shade.is_none() {
            self.shade = Some(ShadeKernel::new(&self.gpu, &source).map_err(|error| failed(&error))?);
        }
        let seconds = start.elapsed().as_secs_f64();
        self.stages.add("geometry up", seconds);
        Ok(seconds)
    }

    /// Takes one picture.
    ///
    /// # Errors
    /// What keeps the device from it.
    pub(crate) fn render(
        &mut self,
        plan: &Plan,
        frame: &Frame<'_, SceneRays>,
        camera: &Camera,
        params: &RenderParams,
        progress: &impl Progress,
    ) -> Result<Lit, Failure> {
        let (Some(shade), Some(_)) = (self.shade.clone(), &self.rays) else {
            return Err(failed(&"no geometry on the device"));
        };
        let drawing = Drawing::of(plan, (params.width, params.height))?;

        // Build the tree.
        let start = Instant::now();
        let mut room = self.room(&shade, frame, drawing, params).map_err(|error| failed(&error))?;
        self.build(&room).map_err(|error| failed(&error))?;
        let build = start.elapsed().as_secs_f64();

        // Light sample after sample, band after band.
        let pixels = params.width as usize * params.height as usize;
        let mut sums = vec![(DVec3::ZERO, 0u32); pixels];
        let (mut counts, mut cut_short) = (Counts::default(), false);
        let total = room.bands.len() * params.spp as usize;
        'frame: for sample in params.first_sample..params.first_sample + params.spp {
            for done in 0..room.bands.len() {
                if progress.cancelled() {
                    cut_short = true;
                    break 'frame;
                }
                let Band { first, pixels, .. } = room.bands[done];
                let sums = &mut sums[first as usize..][..pixels as usize];
                self.sample(frame, camera, params, &mut room, done, sample, sums, &mut counts)?;
                let before = (sample - params.first_sample) as usize * room.bands.len();
                progress.report(before + done + 1, total);
            }
        }

        // Take the means.
        let mut film = Film::new(params.width, params.height);
        for (pixel, &(sum, count)) in film.pixels.iter_mut().zip(&sums) {
            *pixel = if count > 0 { (sum / f64::from(count)).as_vec3() } else { Vec3::ZERO };
        }
        let mask = cut_short.then(|| sums.iter().map(|&(_, count)| count > 0).collect());
        let bytes = room.lights.tree_bytes() as usize;
        self.room = Some(room);
        Ok(Lit { rendered: Rendered { film, counts, mask, cut_short }, build, tree_bytes: bytes })
    }

    /// Uploads the lights, into the buffers of the last frame where they do.
    fn room(
        &mut self,
        shade: &ShadeKernel,
        frame: &Frame<'_, SceneRays>,
        drawing: Drawing,
        params: &RenderParams,
    ) -> Result<Room, GpuError> {
        let upload = Instant::now();
        let (lights, scene) = (frame.lights, frame.scene);
        let mut room = self.room.take().filter(|room| room.drawing == drawing);
        if let Some(last) = &room
            && !last.lights.update(&self.gpu, lights, scene)?
        {
            room = None;
        }
        let room = match room {
            Some(room) => room,
            None => {
                let lights = DeviceLights::new(&self.gpu, &self.trees, lights, scene)?;
                self.new_room(shade, lights, drawing, params)?
            }
        };
        self.stages.add("lights up", upload.elapsed().as_secs_f64());
        Ok(room)
    }

    /// Builds the tree over the lights.
    fn build(&mut self, room: &Room) -> Result<(), GpuError> {
        let start = Instant::now();
        let times = &mut self.times;
        self.gpu.run("tree", |encoder| {
            times.begin(encoder);
            room.lights.encode_build(encoder);
            times.mark(encoder, "tree");
            times.end(encoder);
        })?;
        self.add_times("tree", start)
    }

    /// Adds what the device's clock says of the last submission, or else what it took since `start` as the
    /// stage `all`.
    fn add_times(&mut self, all: &'static str, start: Instant) -> Result<(), GpuError> {
        let wall = start.elapsed().as_secs_f64();
        let spans = self.times.seconds(&self.gpu)?;
        if spans.is_empty() {
            self.stages.add(all, wall);
        }
        spans.into_iter().for_each(|(name, seconds)| self.stages.add(name, seconds));
        Ok(())
    }

    /// Buffers for these lights and for bands of pixels.
    fn new_room(
        &self,
        shade: &ShadeKernel,
        lights: DeviceLights,
        drawing: Drawing,
        params: &RenderParams,
    ) -> Result<Room, GpuError> {
        let gpu = &self.gpu;
        let row = drawing.lights() as usize * size_of::<WeightedLight>();
        let most = gpu.device().limits().max_storage_buffer_binding_size as usize;
        let fit = most / row.max(size_of::<SurfaceRecord>());
        // Whole blocks of pixels that share a cut.
        let block = drawing.block();
        let rows =
            ((fit / params.width as usize) as u32 / block * block).clamp(block, params.height.max(block));
        let pixels = (rows.min(params.height) * params.width) as usize;
        let buffer = |label, bytes: usize| gpu.buffer(label, (pixels * bytes) as u64, BufferUsages::empty());
        let receivers = buffer("receivers", size_of::<ReceiverRecord>())?;
        let surfaces = buffer("surfaces", size_of::<SurfaceRecord>())?;
        let drawn = buffer("drawn", row)?;
        let outcomes = buffer("outcomes", if drawing.learns() { row / 2 } else { 0 })?;
        let told = drawing.learns().then_some(&outcomes);
        let shading = Shading::new(gpu, shade, &surfaces, lights.emitters(), &drawn, told)?;
        let mut bands = Vec::new();
        for top in (0..params.height).step_by(rows as usize) {
            let height = rows.min(params.height - top);
            let drawing = drawing.of_rows(height);
            let drawer =
                Drawer::new(gpu, &self.kernels, lights.tree(), drawing, &receivers, [&drawn, &outcomes])?;
            bands.push(Band { first: top * params.width, pixels: height * params.width, drawer });
        }
        Ok(Room { drawing, lights, receivers, surfaces, shading, bands })
    }

    /// One camera sample of each pixel of a band.
    #[expect(clippy::too_many_arguments, reason = "the body of one loop")]
    fn sample(
        &mut self,
        frame: &Frame<'_, SceneRays>,
        camera: &Camera,
        params: &RenderParams,
        room: &mut Room,
        band: usize,
        sample: u32,
        sums: &mut [(DVec3, u32)],
        counts: &mut Counts,
    ) -> Result<(), Failure> {
        // See.
        let size = (params.width, params.height);
        let Band { first, pixels, .. } = room.bands[band];
        let (rays, randoms): (Vec<Ray>, Vec<Random>) = (first..first + pixels)
            .into_par_iter()
            .map(|pixel| camera_ray(camera, frame.seed, size, pixel, sample))
            .unzip();
        let mut hits = vec![None; rays.len()];
        let Some(tracer) = &mut self.rays else { return Err(failed(&"no geometry on the device")) };
        self.stages
            .time("camera rays", || tracer.closest_batch(&rays, &mut hits))
            .map_err(|error| failed(&error))?;
        let looked = Instant::now();
        let views = look(frame, first, sample, &rays, &hits, randoms);
        counts.closest_hit_rays += rays.len() as u64;
        let (mut receivers, mut surfaces) = (Vec::with_capacity(rays.len()), Vec::with_capacity(rays.len()));
        let mut seen = Vec::with_capacity(rays.len());
        for (view, receiver, surface, view_counts) in views {
            counts.add(&view_counts);
            seen.push(view);
            receivers.push(receiver);
            surfaces.push(surface);
        }
        self.stages.add("surfaces (cpu)", looked.elapsed().as_secs_f64());

        // Light.
        let is_first = sample == params.first_sample;
        let lit = self
            .light(frame, room, band, (sample, is_first), camera.position, &receivers, &surfaces)
            .map_err(|error| failed(&error))?;

        // Add what is a number.
        counts.samples += lit.len() as u64;
        for ((sum, seen), lit) in sums.iter_mut().zip(&seen).zip(&lit) {
            let mut radiance = seen.emission;
            if seen.is_lit {
                counts.shadow_rays += u64::from(lit.counts & 0xffff);
                counts.light_evaluations += u64::from(lit.counts >> 16);
                let lights = Vec3::from(lit.color).as_dvec3() + seen.distant;
                radiance += seen.throughput.as_dvec3() * lights;
            }
            if radiance.as_vec3().is_finite() {
                *sum = (sum.0 + radiance, sum.1 + 1);
            } else {
                counts.non_finite += 1;
            }
        }
        Ok(())
    }

    /// Draws lights for a band's points, shades them, and reads the radiance back.
    #[expect(clippy::too_many_arguments, reason = "the body of one loop, as `sample`")]
    fn light(
        &mut self,
        frame: &Frame<'_, SceneRays>,
        room: &mut Room,
        band: usize,
        (sample, is_first): (u32, bool),
        eye: Vec3,
        receivers: &[ReceiverRecord],
        surfaces: &[SurfaceRecord],
    ) -> Result<Vec<RadianceRecord>, GpuError> {
        let Some(tracer) = &self.rays else { return Err(GpuError::DeviceLost) };
        let gpu = &self.gpu;
        let up = Instant::now();
        gpu.write(&room.receivers, receivers)?;
        gpu.write(&room.surfaces, surfaces)?;
        let seed = frame.light_seed ^ Purpose::Lights.salt();
        let learns = room.drawing.learns();
        let Band { first, pixels, drawer } = &mut room.bands[band];
        let request = DrawRequest {
            receivers: Some(*pixels),
            seed,
            index: sample,
            first_stream: *first,
            eye: eye.to_array(),
        };
        drawer.set_request(gpu, &request)?;
        let params = ShadeParams {
            surfaces: *pixels,
            lights: room.drawing.lights(),
            seed,
            index: sample,
            emitters: frame.lights.len() as u32,
            tell: learns.into(),
            spare0: 0,
            spare1: 0,
        };
        room.shading.set(gpu.queue(), &params)?;
        self.stages.add("points up", up.elapsed().as_secs_f64());
        let run = Instant::now();
        let times = &mut self.times;
        gpu.run("lights", |encoder| {
            times.begin(encoder);
            drawer.encode(encoder, times, is_first);
            room.shading.encode(encoder, tracer.geometry());
            times.mark(encoder, "shade");
            drawer.encode_learning(encoder, times);
            times.end(encoder);
        })?;
        self.add_times("draw and shade", run)?;
        let gpu = &self.gpu;
        let back = Instant::now();
        let lit = gpu.read(room.shading.radiance(), *pixels as usize)?;
        self.stages.add("radiance back", back.elapsed().as_secs_f64());
        Ok(lit)
    }
}

/// A picture, and what of it is told apart.
pub(crate) struct Lit {
    pub(crate) rendered: Rendered,
    /// Seconds that uploading the lights and building the tree took.
    pub(crate) build: f64,
    /// Bytes of the tree on the device.
    pub(crate) tree_bytes: usize,
}

/// What the first hits of a band's camera rays lead to, pixel by pixel.
fn look(
    frame: &Frame<'_, SceneRays>,
    first: u32,
    sample: u32,
    rays: &[Ray],
    hits: &[Option<RayHit>],
    randoms: Vec<Random>,
) -> Vec<(Seen, ReceiverRecord, SurfaceRecord, Counts)> {
    let one = |scratch: &mut RayScratch, i: usize, mut random: Random| {
        let mut counts = Counts::default();
        let pixel = first + i as u32;
        let CameraPath { emission, point } =
            camera_path(frame, &rays[i], hits[i], pixel, sample, &mut random, scratch, &mut counts);
        let mut seen = Seen {
            emission: emission.as_dvec3(),
            throughput: Vec3::ONE,
            distant: DVec3::ZERO,
            is_lit: point.is_some(),
        };
        let (receiver, surface) = match &point {
            Some(point) => {
                seen.throughput = point.throughput;
                seen.distant = scene::distant_light(frame, point, scratch, &mut counts);
                (records::receiver(point), records::surface(point))
            }
            None => (ReceiverRecord::NONE, records::NO_SURFACE),
        };
        (seen, receiver, surface, counts)
    };
    randoms
        .into_par_iter()
        .enumerate()
        .map_init(RayScratch::default, |scratch, (i, random)| one(scratch, i, random))
        .collect()
}
