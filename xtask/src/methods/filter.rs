//! `--set filter=`: noise taken out of a finished picture, with what the frames before it knew.

use std::time::Instant;

use glam::Affine3A;
use scene::{Camera, Film, Frame, GBuffer, LastFrame, RenderParams, SceneRays};
use serde_json::{Value, json};
use stochastic::filter::{FilterError, FilterInput, FilterReport, Mixing, Svgf, SvgfParams, Taa, TaaParams};

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
    svgf: Svgf,
    taa: Option<Taa>,
    /// Camera and transforms of the last frame.
    last: Option<(Camera, Vec<Affine3A>)>,
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

    /// The filters that were asked for, if any.
    ///
    /// # Errors
    /// If a dial is out of the filter's range.
    pub(crate) fn of(settings: &Settings) -> Result<Option<Self>, Failure> {
        let taa = match settings.find("filter") {
            None | Some("off") => return Ok(None),
            Some(name) => name == "svgf+taa",
        };
        let mixing = match settings.text("filter_mixing") {
            "conserving" => Mixing::Conserving,
            _ => Mixing::Normalized,
        };
        let params = SvgfParams {
            levels: settings.whole("filter_levels"),
            interleaved: settings.find("m").map_or(1, |_| settings.whole("m")),
            mixing,
            ..SvgfParams::default()
        };
        let svgf = Svgf::new(params).map_err(|error| refused(&error))?;
        let taa = taa.then(|| Taa::new(TaaParams::default())).transpose().map_err(|error| refused(&error))?;
        Ok(Some(Self { svgf, taa, last: None }))
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
        let mut report = self.svgf.filter(&input, &mut out).map_err(|error| refused(&error))?;
        if let Some(taa) = &mut self.taa {
            let mut smooth = out.clone();
            let anti_aliased = taa
                .filter(&FilterInput { color: &out, ..input }, &mut smooth)
                .map_err(|error| refused(&error))?;
            report.clipped = anti_aliased.clipped;
            out = smooth;
        }
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

fn refused(error: &FilterError) -> Failure {
    Failure::failed(format!("filter: {error}"))
}
