//! What a picture took, for people and for scripts.

use std::path::Path;

use scene::{Counts, Errors, Film, RenderParams, Rendered, Scene};
use serde_json::{Value, json};

use crate::device::Device;
use crate::failure::Failure;
use crate::provenance::provenance;
use crate::shot::Plan;

/// Wall-clock seconds of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seconds {
    /// Reading or making the scene.
    pub(crate) load: f64,
    /// The acceleration structure for rays.
    pub(crate) build_rays: f64,
    /// Virtual lights, light tree, and what a method keeps beside it.
    pub(crate) build_lights: f64,
    /// From the first camera ray to the last pixel.
    pub(crate) render: f64,
    /// All of it, with the files that were read and written.
    pub(crate) total: f64,
}

/// Everything about a run that scripts may ask for.
pub(crate) struct Report<'a> {
    /// `None`: the cpu.
    pub(crate) device: Option<&'a Device>,
    pub(crate) scene: &'a Scene,
    pub(crate) vpls: usize,
    pub(crate) params: &'a RenderParams,
    pub(crate) plan: &'a Plan,
    /// Its name.
    pub(crate) camera: &'a str,
    /// Stops by which the PNG is brightened.
    pub(crate) exposure: f32,
    pub(crate) threads: usize,
    pub(crate) seconds: Seconds,
    pub(crate) counts: &'a Counts,
    pub(crate) light_tree_bytes: usize,
    pub(crate) rays_bytes: usize,
    pub(crate) peak_rss: Option<u64>,
    pub(crate) error: Option<Errors>,
    pub(crate) output: &'a Path,
    /// What filtering the last frame took and met.
    pub(crate) filter: Option<Value>,
    /// Entries of the array `frames`, where more than one was asked for.
    pub(crate) frames: Option<Vec<Value>>,
}

impl Report<'_> {
    /// The object whose keys are fixed, because scripts outside the project read them.
    pub(crate) fn json(&self) -> Value {
        let Seconds { load, build_rays, build_lights, render, total } = self.seconds;
        let mut object = json!({
            "method": self.plan.method.about().name,
            "device": if self.device.is_some() { "gpu" } else { "cpu" },
            "scene": self.scene.name,
            "triangles": self.scene.triangle_count(),
            "lights": self.scene.lights.len() + self.scene.distant.len(),
            "vpls": self.vpls,
            "width": self.params.width,
            "height": self.params.height,
            "spp": self.params.spp,
            "seed": self.plan.seed,
            "threads": self.threads,
            "seconds": {
                "load": load, "build_rays": build_rays, "build_lights": build_lights, "render": render, "total": total,
            },
            "counts": counts(self.counts),
            "bytes": { "light_tree": self.light_tree_bytes, "rays": self.rays_bytes, "peak_rss": self.peak_rss },
        });
        if let Some(device) = self.device {
            object["adapter"] = json!(device.name());
            let stages = device.stages().iter().map(|(name, seconds)| (name.to_owned(), json!(seconds)));
            object["stages"] = Value::Object(stages.collect());
        }
        if let Some(error) = &self.error {
            object["error"] = errors_json(error);
        }
        if let Some(filter) = &self.filter {
            object["filter"] = filter.clone();
        }
        if let Some(frames) = &self.frames {
            object["frames"] = json!(frames);
        }
        object["output"] = json!(self.output.display().to_string());
        object["settings"] = self.plan.settings.json();
        object["gi"] = json!(self.plan.gi.name());
        object["bounces"] = json!(self.plan.bounces);
        object["camera"] = json!(self.camera);
        object["exposure"] = json!(self.exposure);
        object["made_by"] = provenance();
        object
    }

    /// The same in a few lines.
    pub(crate) fn for_people(&self) -> String {
        let Seconds { load, build_rays, build_lights, render, total } = self.seconds;
        let counts = self.counts;
        let samples = counts.samples.max(1) as f64;
        let mut text = format!(
            "{}: {render:.2} s to render (load {load:.2}, rays {build_rays:.2}, lights {build_lights:.2}, all {total:.2}) on {} threads\n",
            self.plan.method.about().name,
            self.threads
        );
        if let Some(device) = self.device {
            text += &format!("on {}, seconds by stage:\n", device.name());
            for (name, seconds) in device.stages().iter() {
                text += &format!("    {name:<16}{seconds:>10.4}\n");
            }
        }
        text += &format!(
            "{} shadow rays ({:.1} per camera sample), {} light evaluations",
            counts.shadow_rays,
            counts.shadow_rays as f64 / samples,
            counts.light_evaluations
        );
        if counts.cuts > 0 {
            let mean = counts.cut_nodes as f64 / counts.cuts as f64;
            text += &format!(", cuts of {mean:.0} nodes (largest {})", counts.cut_nodes_max);
        }
        text += "\n";
        if counts.clamped > 0 {
            let lost = counts.clamped_luminance / samples;
            let (what, fate) = if lost < 0.0 {
                ("were negative and are cut off", "are gained by that")
            } else {
                ("were clamped, as asked for", "are lost with them")
            };
            text += &format!(
                "{} contributions {what}; {:.3e} W/m2/sr of the picture's mean luminance {fate}\n",
                counts.clamped,
                lost.abs()
            );
        }
        if counts.non_finite > 0 {
            text += &format!(
                "{} samples were not finite and are left out: light beyond 3.4e38 W/m2/sr is, so scale the scene up or its lights down; if it is neither, please report the scene\n",
                counts.non_finite
            );
        }
        if counts.chains_cut > 0 {
            text += &format!(
                "{} chains of glass and mirrors were longer than {} and are cut\n",
                counts.chains_cut,
                scene::MAX_CHAIN
            );
        }
        if let Some(error) = &self.error {
            text += &format!("{}\n", errors_line(error));
        }
        text
    }
}

/// The counts that scripts read.
pub(crate) fn counts(counts: &Counts) -> Value {
    let mean = if counts.cuts > 0 { counts.cut_nodes as f64 / counts.cuts as f64 } else { 0.0 };
    json!({
        "shadow_rays": counts.shadow_rays,
        "closest_hit_rays": counts.closest_hit_rays,
        "light_evaluations": counts.light_evaluations,
        "node_visits": counts.node_visits,
        "cut_nodes_mean": mean,
        "cut_nodes_max": counts.cut_nodes_max,
        "fallbacks": counts.fallbacks,
        "clamped": counts.clamped,
        "non_finite": counts.non_finite,
    })
}

/// A picture of the size given, to compare with.
///
/// # Errors
/// A failure that names the file.
pub(crate) fn reference(path: &Path, size: (u32, u32)) -> Result<Film, Failure> {
    scene::read_exr(path, Some(size)).map_err(|error| Failure::failed(error.to_string()))
}

/// Distance of what was rendered from a reference of the same size.
///
/// # Errors
/// If no pixel was rendered.
pub(crate) fn errors(rendered: &Rendered, reference: &Film) -> Result<Errors, Failure> {
    scene::compare(&rendered.film, reference, rendered.mask.as_deref())
        .map_err(|error| Failure::failed(error.to_string()))
}

/// The errors that scripts read.
pub(crate) fn errors_json(errors: &Errors) -> Value {
    let Errors { mse, relmse, mape, bias, ssim, flip } = errors;
    json!({ "mse": mse, "relmse": relmse, "mape": mape, "ssim": ssim, "flip": flip, "bias": bias })
}

/// The errors in a line.
pub(crate) fn errors_line(errors: &Errors) -> String {
    let Errors { mse, relmse, mape, bias, ssim, flip } = errors;
    let mut text = format!("relMSE {relmse:.3e}, MSE {mse:.3e}, MAPE {mape:.4}, mean {:+.2} %", 100.0 * bias);
    if let Some(ssim) = ssim {
        text += &format!(", SSIM {ssim:.4}");
    }
    if let Some(flip) = flip {
        text += &format!(", FLIP {flip:.4}");
    }
    text
}
