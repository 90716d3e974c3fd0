//! `--set filter=`: noise taken out of a finished picture, with what the frames before it knew.

use std::time::Instant;

use glam::{Affine3A, Vec3};
use scene::{Camera, Film, Frame, GBuffer, LastFrame, RenderParams, SceneRays};
use serde_json::{Value, json};
use stochastic::filter::{FilterInput, FilterReport, Mixing, Svgf, SvgfParams, Taa, TaaParams};

use crate::device::{Device, DeviceFilters};
use crate::failure::Failure;
use crate::settings::{Key, Range, Settings};

/// Of every method: even those that look at every light draw points on them.
pub(crate) const KEYS: [Key; 3] = [
    Key {
        name: "filter",
        default: "off",
        range: Range::OneOf(&["off", "svgf", "svgf+taa"]),
        trades: "svgf smooths what is noise and not what is an edge, over the frames of --frames as well; taa averages finished frames. Less noise, for bias: soft shadows, lag, missing glints",
    },
    Key {
        name: "filter_levels",
        default: "5",
        range: Range::Whole(0, 16),
        trades: "levels of svgf's wavelet, each twice as wide as the one before: less noise, for wider blur",
    },
    Key {
        name: "filter_mixing",
        default: "normalized",
        range: Range::OneOf(&["normalized", "conserving"]),
        trades: "normalized, as published, outvotes single bright pixels: least error, and darker; conserving keeps the picture's light to rounding, as blotches",
    },
];

/// Filters with what they remember from frame to frame.
pub(crate) struct Filter {
    engine: Engine,
    /// Camera and transforms of the last frame.
    last: Option<(Camera, Vec<Affine3A>)>,
}

/// Where it is done.
enum Engine {
    Cpu { svgf: Box<Svgf>, taa: Option<Taa> },
    Device { filters: Box<DeviceFilters>, svgf: SvgfParams, taa: Option<TaaParams> },
}

impl Engine {
    /// # Errors
    /// If a dial is out of the filter's range, or the device has something against it.
    fn filter(&mut self, input: &FilterInput<'_>, out: &mut [Vec3]) -> Result<FilterReport, Failure> {
        match self {
            Self::Cpu { svgf, taa } => {
                let mut report = svgf.filter(input, out).map_err(|error| refused(&error))?;
                if let Some(taa) = taa {
                    let smooth = out.to_vec();
                    let anti_aliased = taa.filter(&FilterInput { color: &smooth, ..*input }, out);
                    report.clipped = anti_aliased.map_err(|error| refused(&error))?.clipped;
                }
                Ok(report)
            }
            Self::Device { filters, svgf, taa } => {
                filters.filter(svgf, taa.as_ref(), input, out).map_err(|error| refused(&error))
            }
        }
    }
}

/// What filtering one frame took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filtered {
    /// What the filters met.
    pub(crate) report: FilterReport,
    /// Seconds for depth, normals and so on.
    pub(crate) guides: f64,
    /// Seconds for the filters themselves.
    pub(crate) filter: f64,
}

impl Filter {
    /// Whether these settings ask for a filter.
    pub(crate) fn is_in(settings: &Settings) -> bool {
        settings.find("filter").is_some_and(|name| name != "off")
    }

    /// The filters that were asked for, if any: on the device, where pictures are taken on one.
    ///
    /// # Errors
    /// If a dial is out of the filter's range.
    pub(crate) fn of(settings: &Settings, device: Option<&Device>) -> Result<Option<Self>, Failure> {
        let taa = match settings.find("filter") {
            None | Some("off") => return Ok(None),
            Some(name) => name == "svgf+taa",
        };
        let mixing = match settings.text("filter_mixing") {
            "conserving" => Mixing::Conserving,
            _ => Mixing::Normalized,
        };
        let svgf = SvgfParams {
            levels: settings.whole("filter_levels"),
            interleaved: settings.find("m").map_or(1, |_| settings.whole("m")),
            mixing,
            ..SvgfParams::default()
        };
        let taa = taa.then(TaaParams::default);
        let engine = match device {
            Some(device) => Engine::Device { filters: Box::new(device.filters()?), svgf, taa },
            None => Engine::Cpu {
                svgf: Box::new(Svgf::new(svgf).map_err(|error| refused(&error))?),
                taa: taa.map(Taa::new).transpose().map_err(|error| refused(&error))?,
            },
        };
        Ok(Some(Self { engine, last: None }))
    }

    /// Filters a whole picture that was rendered with these arguments, in place.
    ///
    /// # Errors
    /// If the film is not of the size that the parameters say.
    pub(crate) fn apply(
        &mut self,
        frame: &Frame<'_, SceneRays>,
        camera: &Camera,
        params: &RenderParams,
        film: &mut Film,
    ) -> Result<Filtered, Failure> {
        // See again what the picture saw.
        let start = Instant::now();
        let to_world: Vec<_> = frame.scene.instances.iter().map(|instance| instance.to_world).collect();
        let last = self.last.as_ref().filter(|(_, then)| then.len() == to_world.len());
        let last = last.map(|(camera, then)| LastFrame {
            camera,
            to_world: (*then != to_world).then_some(then.as_slice()),
        });
        let guides = GBuffer::render(frame, camera, params, last.as_ref());
        let guides_seconds = start.elapsed().as_secs_f64();

        // Filter.
        let start = Instant::now();
        let input = FilterInput {
            width: guides.width,
            height: guides.height,
            color: &film.pixels,
            emission: Some(&guides.emission),
            albedo: &guides.albedo,
            normal: &guides.normal,
            depth: &guides.depth,
            motion: Some(&guides.motion),
            mesh: Some(&guides.instance),
        };
        let mut out = film.pixels.clone();
        let report = self.engine.filter(&input, &mut out)?;
        film.pixels = out;
        self.last = Some((camera.clone(), to_world));
        Ok(Filtered { report, guides: guides_seconds, filter: start.elapsed().as_secs_f64() })
    }
}

impl Filtered {
    /// What it took and met, for scripts.
    pub(crate) fn json(&self) -> Value {
        let FilterReport { non_finite, with_history, without_history, clipped } = self.report;
        json!({
            "seconds": { "guides": self.guides, "filter": self.filter },
            "pixels": {
                "with_history": with_history, "without_history": without_history, "clipped": clipped,
                "non_finite": non_finite,
            },
        })
    }

    /// What it took and met, in a line.
    pub(crate) fn for_people(&self) -> String {
        let FilterReport { non_finite, with_history, without_history, clipped } = self.report;
        let mut line = format!(
            "filtered in {:.1} ms (guides {:.1} ms); {with_history} pixels had a history, {without_history} had none",
            1e3 * self.filter,
            1e3 * self.guides
        );
        if clipped > 0 {
            line += &format!(", {clipped} were moved into their neighbourhood's range");
        }
        if non_finite > 0 {
            line += &format!(", {non_finite} were not finite and are filled in");
        }
        line
    }
}

fn refused(error: &dyn std::fmt::Display) -> Failure {
    Failure::failed(format!("filter: {error}"))
}
