//! The truth to compare with, and how far from it the truth itself may be.

use std::time::Instant;

use scene::{Film, RenderParams};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::methods::Method;
use crate::progress::Watched;
use crate::report;
use crate::settings::Settings;
use crate::shot::{Gi, Plan, Stage};
use crate::stop;

/// A reference picture.
pub(super) struct Reference {
    pub(super) film: Film,
    /// Pixels it has; `None`: all.
    pub(super) mask: Option<Vec<bool>>,
    made: Option<Made>,
}

/// How a reference was made.
struct Made {
    method: &'static str,
    spp: u32,
    seconds: f64,
    pixels: usize,
    /// Estimated mean squared error of the reference itself.
    mse: f64,
    /// The same as relMSE.
    relmse: f64,
}

/// Pixels that are rendered first, to learn what one costs.
const PROBE: usize = 64;

/// Least pixels that a reference is made over.
const FEWEST: usize = 256;

/// Number of a reference's first camera sample: beyond all that methods take, so that it shares none of their
/// luck at edges of things. The seed is theirs, for it decides virtual lights.
const FIRST_SAMPLE: u32 = 1 << 24;

impl Reference {
    /// One that the user has.
    pub(super) fn given(film: Film) -> Self {
        Self { film, mask: None, made: None }
    }

    /// Renders two independent halves with the method that is exact for the plan's light, and takes their
    /// mean. Within about `seconds`: over all pixels with as many samples as fit, or over fewer pixels with
    /// one each.
    ///
    /// The halves' difference tells the noise: two pictures with variance V each differ by 2 V in the mean
    /// square, and their mean has variance V / 2, a quarter of that.
    pub(super) fn make(
        stage: &Stage<'_>,
        like: &Plan,
        params: &RenderParams,
        seconds: f64,
    ) -> Result<Self, Failure> {
        let method = if like.gi == Gi::Path { Method::Path } else { Method::Brute };
        let keep = |key: &str| format!("{key}={}", like.settings.text(key));
        let settings =
            Settings::parse("the reference", &method.keys(), &["camera", "materials", "clamp"].map(keep))?;
        let plan = Plan { method, settings, ..like.clone() };
        let prepared = stage.prepare(&plan)?;
        let start = Instant::now();

        // Learn what a pixel costs, and spend the rest of the time by it.
        let all = params.width as usize * params.height as usize;
        let probe = RenderParams { pixels: Some(PROBE.min(all)), first_sample: FIRST_SAMPLE, ..*params };
        stage.render(&plan, &prepared, &probe, &())?;
        let per_pixel = start.elapsed().as_secs_f64() / PROBE.min(all) as f64;
        let affordable = (0.5 * seconds / per_pixel).max(FEWEST as f64);
        let spp = (affordable / all as f64).floor().clamp(1.0, 65_536.0) as u32;
        let pixels = (affordable < all as f64).then_some(affordable as usize);

        // Render two halves: the same pixels, other samples.
        let half = |first_sample: u32, name: &str| {
            let params = RenderParams { spp, first_sample, pixels, ..*params };
            stage.render(&plan, &prepared, &params, &Watched::new(name))
        };
        let first = half(FIRST_SAMPLE, "reference, first half")?;
        let second = half(FIRST_SAMPLE + spp, "reference, second half")?;
        if stop::asked() {
            return Err(Failure::Interrupted(
                "cut short before the reference was finished; nothing is written".to_owned(),
            ));
        }
        let apart = report::errors(&first, &second.film)?;
        let rendered = first.mask.as_ref().map_or(all, |mask| mask.iter().filter(|&&m| m).count());
        let mut film = first.film;
        blend(&mut film, 1, &second.film, 1);
        let seconds = start.elapsed().as_secs_f64();
        let made = Made {
            method: method.about().name,
            spp: 2 * spp,
            seconds,
            pixels: rendered,
            mse: 0.25 * apart.mse,
            relmse: 0.25 * apart.relmse,
        };
        Ok(Self { film, mask: first.mask, made: Some(made) })
    }

    /// In a sentence.
    pub(super) fn describe(&self) -> String {
        let Some(Made { method, spp, seconds, pixels, relmse, .. }) = &self.made else {
            return "given; its own noise is not known".to_owned();
        };
        format!(
            "`{method}`, {spp} samples per pixel over {pixels} of {} pixels in {seconds:.1} s; its own noise is {relmse:.2e} relMSE: no smaller error is meaningful",
            self.film.pixels.len()
        )
    }

    /// For other programs.
    pub(super) fn json(&self) -> Value {
        let made = self.made.as_ref().map(|made| {
            json!({
                "method": made.method, "spp": made.spp, "first_sample": FIRST_SAMPLE, "seconds": made.seconds,
                "pixels": made.pixels,
                "noise": { "mse": made.mse, "relmse": made.relmse },
            })
        });
        json!({ "picture": "reference.png", "description": self.describe(), "made": made })
    }
}

/// Weighted mean of two pictures, into the first.
pub(crate) fn blend(film: &mut Film, weight: u32, other: &Film, other_weight: u32) {
    let share = other_weight as f32 / (weight + other_weight) as f32;
    for (pixel, &other) in film.pixels.iter_mut().zip(&other.pixels) {
        *pixel = pixel.lerp(other, share);
    }
}
