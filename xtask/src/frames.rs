//! One frame after another: what moves between them, what they leave to the next, and what each took.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use lighttree::rng::pcg4d;
use lighttree::{Ray, RayQueries};
use scene::{Camera, Counts, Errors, Film, RayScratch, RenderParams, Rendered, Scene, SceneRays};
use serde_json::{Value, json};

use crate::device::Device;
use crate::failure::Failure;
use crate::methods::Learned;
use crate::methods::filter::{Filter, Filtered};
use crate::progress::Watched;
use crate::report::{self, Seconds};
use crate::settings::Settings;
use crate::shot::{Left, Plan, Stage};
use crate::trees::KeptMeshes;

/// What a frame leaves to the next one; nothing before the first. What a filter or a method wants to find
/// again has its place here.
#[derive(Default)]
pub(crate) struct Kept {
    /// The last picture.
    film: Option<Film>,
    /// What filters remember, if there are any.
    filter: Option<Filter>,
    /// What the method finds again.
    left: Left,
    /// Trees over the lights of meshes.
    meshes: KeptMeshes,
    /// What a method has learned.
    learned: Learned,
    /// Where pictures are taken with `--device gpu`.
    pub(crate) device: Option<Device>,
}

impl Kept {
    /// Before the first frame.
    pub(crate) fn on(device: Option<Device>) -> Self {
        Self { device, ..Self::default() }
    }
}

/// What all frames have in common.
pub(crate) struct Sequence<'a> {
    /// Of frame 0.
    pub(crate) plan: &'a Plan,
    /// Of frame 0.
    pub(crate) camera: &'a Camera,
    /// Of each frame.
    pub(crate) params: &'a RenderParams,
    /// To take errors against.
    pub(crate) reference: Option<&'a Film>,
    /// How many.
    pub(crate) frames: u32,
}

/// One frame, taken.
pub(crate) struct Taken {
    /// The picture.
    pub(crate) rendered: Rendered,
    /// Virtual lights of `--gi vpl`.
    pub(crate) vpls: usize,
    /// Of the light tree and what goes with it.
    pub(crate) light_tree_bytes: usize,
    /// Distance from the reference, if there is one.
    pub(crate) error: Option<Errors>,
    /// Its number, times and errors, for the report.
    pub(crate) report: FrameReport,
}

/// What scripts may ask about a frame.
pub(crate) struct FrameReport {
    frame: u32,
    seed: u32,
    /// Moving what moves, light that it makes included.
    moving: f64,
    /// `load` and `total` stay 0.
    pub(crate) seconds: Seconds,
    /// relMSE against the frame before; `None` for the first.
    change: Option<f64>,
    error: Option<Errors>,
    /// Where it was filtered.
    pub(crate) filtered: Option<Filtered>,
    /// Where it was written.
    pub(crate) output: PathBuf,
}

impl Sequence<'_> {
    /// Brings `scene` and `rays` to frame `frame` and takes the picture. `rays` of frame 0 are there already.
    ///
    /// # Errors
    /// If the scene's lights make no tree, or the threads cannot be started.
    pub(crate) fn take(
        &self,
        frame: u32,
        scene: &mut Scene,
        rays: &mut SceneRays,
        kept: &mut Kept,
    ) -> Result<Taken, Failure> {
        // Move what moves.
        let mut seconds = Seconds::default();
        let refuse = |name: &str, error| Failure::failed(format!("{name}: {error}"));
        let start = Instant::now();
        if frame > 0 {
            scene.go_to_frame(frame).map_err(|error| refuse(&scene.name, error))?;
        }
        let moving = start.elapsed().as_secs_f64();
        if frame > 0 && scene.motion.moves_geometry() {
            let start = Instant::now();
            *rays = SceneRays::build(scene).map_err(|error| refuse(&scene.name, error))?;
            seconds.build_rays = start.elapsed().as_secs_f64();
        }
        let camera = orbited(self.camera, rays, &self.plan.settings, frame);

        // Build its lights and take the picture.
        let reuses = self.plan.settings.find("reuse") == Some("on") && scene.motion.is_still();
        let seed = if reuses { self.plan.seed } else { seed_of(self.plan.seed, frame) };
        let plan = Plan { seed, light_seed: seed, ..self.plan.clone() };
        let stage = Stage { scene, rays, camera: &camera };
        let mut prepared = if kept.device.is_some() {
            stage.prepare_lights(&plan)
        } else {
            stage.prepare_after(&plan, &mut kept.meshes)?
        };
        if self.frames > 1 {
            prepared.learned = core::mem::take(&mut kept.learned).next_frame(stage.radius());
        }
        seconds.build_lights = prepared.seconds;
        let mut light_tree_bytes = prepared.bytes();
        if let Some(device) = &mut kept.device {
            seconds.build_rays += device.place(scene, scene.motion.moves_geometry())?;
        }
        let start = Instant::now();
        let watched = Watched::new(&self.name_of(frame));
        let mut rendered = match &mut kept.device {
            Some(device) => {
                let lit = stage.render_on(device, &plan, &prepared, self.params, &watched)?;
                seconds.build_lights += lit.build;
                seconds.render -= lit.build;
                light_tree_bytes = lit.tree_bytes;
                lit.rendered
            }
            None => stage.render_after(&plan, &prepared, self.params, &watched, &mut kept.left)?,
        };
        drop(watched);
        if !reuses {
            kept.left.view = None;
        }
        seconds.render += start.elapsed().as_secs_f64();

        kept.learned = core::mem::take(&mut prepared.learned);

        // Filter it.
        if frame == 0 {
            kept.filter = Filter::of(&plan.settings, kept.device.as_ref())?;
        }
        let filtered = match &mut kept.filter {
            Some(filter) if !rendered.cut_short => {
                Some(stage.filter(&plan, &prepared, self.params, filter, &mut rendered.film)?)
            }
            _ => None,
        };
        if let (Some(device), Some(filtered)) = (&mut kept.device, &filtered) {
            device.add_stage("guides (cpu)", filtered.guides);
            device.add_stage("filter", filtered.filter);
        }

        // Compare it with what there is, unless it was cut short before its first tile.
        let nothing = rendered.cut_short && rendered.mask.as_ref().is_some_and(|mask| !mask.contains(&true));
        let against = |film: &Film| report::errors(&rendered, film);
        let error = self.reference.filter(|_| !nothing).map(against).transpose()?;
        let change =
            kept.film.as_ref().filter(|_| !nothing).map(against).transpose()?.map(|errors| errors.relmse);
        if self.frames > 1 {
            kept.film = Some(rendered.film.clone());
        }
        let report = FrameReport {
            frame,
            seed: plan.seed,
            moving,
            seconds,
            change,
            error,
            filtered,
            output: PathBuf::new(),
        };
        let vpls = prepared.vpls;
        Ok(Taken { rendered, vpls, light_tree_bytes, error, report })
    }

    fn name_of(&self, frame: u32) -> String {
        let method = self.plan.method.about().name;
        if self.frames == 1 {
            method.to_owned()
        } else {
            format!("{method}, frame {frame} of {}", self.frames)
        }
    }

    /// Where frame `frame` is written: `output` itself if it is the only one, otherwise `NAME.0000.exr` and
    /// so on.
    pub(crate) fn output(&self, output: &Path, frame: u32) -> PathBuf {
        if self.frames == 1 { output.to_owned() } else { output.with_extension(format!("{frame:04}.exr")) }
    }
}

impl FrameReport {
    /// An entry of the array `frames`.
    pub(crate) fn json(&self) -> Value {
        let Seconds { build_rays, build_lights, render, .. } = self.seconds;
        let mut object = json!({
            "frame": self.frame,
            "seed": self.seed,
            "seconds": {
                "move": self.moving, "build_rays": build_rays, "build_lights": build_lights, "render": render,
                "total": self.total(),
            },
            "change": self.change,
        });
        if let Some(error) = &self.error {
            object["error"] = report::errors_json(error);
        }
        if let Some(filtered) = &self.filtered {
            object["filter"] = filtered.json();
        }
        object["output"] = json!(self.output.display().to_string());
        object
    }

    /// The same in a line.
    pub(crate) fn for_people(&self) -> String {
        let Seconds { build_rays, build_lights, render, .. } = self.seconds;
        format!(
            "frame {}: {:.3} s (move {:.3}, rays {build_rays:.3}, lights {build_lights:.4} or {:.1} %, render {render:.3}), {}",
            self.frame,
            self.total(),
            self.moving,
            100.0 * build_lights / self.total(),
            self.output.display()
        )
    }

    /// Everything but files.
    fn total(&self) -> f64 {
        let Seconds { build_rays, build_lights, render, .. } = self.seconds;
        let filter = self.filtered.map_or(0.0, |filtered| filtered.guides + filtered.filter);
        self.moving + build_rays + build_lights + render + filter
    }
}

/// Adds times and counts of one frame to those of the others.
pub(crate) fn add(seconds: &mut Seconds, counts: &mut Counts, taken: &Taken) {
    seconds.build_rays += taken.report.seconds.build_rays;
    seconds.build_lights += taken.report.seconds.build_lights;
    seconds.render += taken.report.seconds.render;
    counts.add(&taken.rendered.counts);
}

/// The user's own seed in frame 0, others after it.
fn seed_of(seed: u32, frame: u32) -> u32 {
    const SALT: u32 = 0x4652_414d;
    if frame == 0 { seed } else { pcg4d([seed, frame, SALT, 0])[0] }
}

/// The camera after so many frames of `--set orbit=`: round the vertical through what is in the middle of its
/// picture.
fn orbited(camera: &Camera, rays: &SceneRays, settings: &Settings, frame: u32) -> Camera {
    let degrees = settings.number("orbit").unwrap_or_default();
    if degrees == 0.0 || frame == 0 {
        return camera.clone();
    }
    let ray = Ray { origin: camera.position, direction: camera.forward, t_max: f32::INFINITY };
    let distance = rays.closest(&ray, &mut RayScratch::default()).map_or(0.0, |hit| hit.t);
    let angle = (f64::from(degrees) * f64::from(frame) % 360.0).to_radians() as f32;
    camera.turned_about(camera.position + distance * camera.forward, Vec3::Y, angle)
}

#[cfg(test)]
mod tests {
    use super::seed_of;

    #[test]
    fn the_first_frame_has_the_seed_asked_for_and_no_other_has() {
        let seeds: Vec<u32> = (0..100).map(|frame| seed_of(7, frame)).collect();
        assert_eq!(seeds[0], 7);
        assert_eq!(seeds.iter().collect::<std::collections::BTreeSet<_>>().len(), 100);
    }
}
