//! Photon maps of a frame, and the cut through the global one.

use std::time::Instant;

use lighttree::rng::pcg4d;
use photoncut::{DensityParams, IlluminationCut, Photon, PhotonError, PhotonMap, Split};
use scene::{Arrival, Frame, Purpose, SceneRays, WalkParams, WalkReport};

use super::density;
use crate::settings::Settings;

/// What is known of a scene's light, whatever the view.
pub(crate) struct Maps {
    /// All photons.
    pub(super) global: PhotonMap,
    /// Those that came by mirrors and glass alone.
    pub(super) caustic: PhotonMap,
    /// Through the global map; `None`: off.
    pub(super) cut: Option<IlluminationCut>,
    pub(super) density: DensityParams,
}

/// Paths of a pilot walk, which finds out how many arrivals a path has.
const PILOT: u64 = 4096;

/// Caustic photons may be rare: no more paths than this for each photon that is wanted.
const PATIENCE: u64 = 50;

impl Maps {
    /// Traces photons of `bounces` bounces and builds the maps; says on standard error what it took and where
    /// the power went.
    ///
    /// # Errors
    /// If the walk brings a photon that a map refuses.
    pub(crate) fn trace(
        frame: &Frame<'_, SceneRays>,
        bounces: u32,
        settings: &Settings,
    ) -> Result<Self, PhotonError> {
        let start = Instant::now();
        let seed = frame.seed ^ Purpose::Particles.salt();
        let (photons, report) =
            about(frame, settings.whole("photons"), bounces, seed, u64::MAX, |arrival| Some(photon(arrival)));
        let wanted = settings.whole("caustics");
        let most = u64::from(wanted) * PATIENCE;
        let by_specular = |arrival: &Arrival| arrival.is_caustic().then(|| photon(arrival));
        let (caustics, caustic_report) =
            about(frame, wanted, 1, pcg4d([seed, 2, 0, 0])[0], most, by_specular);
        let traced = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let global = PhotonMap::build(&photons)?;
        let caustic = PhotonMap::build(&caustics)?;
        let built = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let density = density(settings);
        let cut = (settings.find("cut") == Some("on")).then(|| {
            let nodes = settings.whole("nodes") as usize;
            let split = match settings.text("choice") {
                "difference" => Some(Split::Difference(1.2)),
                "ratio" => Some(Split::Ratio(2.2)),
                _ => None,
            };
            match split {
                Some(split) => {
                    IlluminationCut::as_published(&global, nodes, settings.whole("rounds"), split, &density)
                }
                None => IlluminationCut::of_size(&global, nodes, &density),
            }
        });
        say(&report, &caustic_report, &global, &caustic, [traced, built]);
        if let Some(cut) = &cut {
            eprintln!(
                "illumination cut: {} nodes, {} rounds, {:.2} s",
                cut.len(),
                cut.rounds(),
                start.elapsed().as_secs_f64()
            );
        }
        Ok(Self { global, caustic, cut, density })
    }

    /// Bytes of maps and cut.
    pub(crate) fn bytes(&self) -> usize {
        self.global.bytes() + self.caustic.bytes() + self.cut.as_ref().map_or(0, IlluminationCut::bytes)
    }
}

fn photon(arrival: &Arrival) -> Photon {
    let point = &arrival.point;
    Photon {
        position: point.position,
        normal: point.geometric_normal,
        direction: point.wo,
        power: arrival.shading_flux(),
    }
}

/// Walks as many paths as bring about `wanted` photons, `most` at most. The pilot that counts them has
/// numbers of its own, so that the walk stays unbiased.
fn about(
    frame: &Frame<'_, SceneRays>,
    wanted: u32,
    bounces: u32,
    seed: u32,
    most: u64,
    keep: impl Fn(&Arrival) -> Option<Photon> + Sync,
) -> (Vec<Photon>, WalkReport) {
    let pilot = WalkParams { paths: PILOT, bounces, seed: pcg4d([seed, 1, 0, 0])[0] };
    let (found, _) = scene::walk(frame, &pilot, &keep);
    if found.is_empty() || wanted == 0 {
        return (Vec::new(), WalkReport::default());
    }
    let paths = (f64::from(wanted) * PILOT as f64 / found.len() as f64).round().max(1.0) as u64;
    scene::walk(frame, &WalkParams { paths: paths.min(most), bounces, seed }, &keep)
}

/// Energy, photon by photon.
fn say(
    report: &WalkReport,
    caustic_report: &WalkReport,
    global: &PhotonMap,
    caustic: &PhotonMap,
    [traced, built]: [f64; 2],
) {
    let share = |power: f64| 100.0 * power / report.emitted.max(f64::MIN_POSITIVE);
    let stored: f64 = global.total_power().iter().sum();
    eprintln!(
        "photons: {} global of {} paths, {} caustic of {} paths; traced {traced:.2} s, built {built:.2} s",
        global.len(),
        report.paths,
        caustic.len(),
        caustic_report.paths
    );
    eprintln!(
        "power: absorbed {:.1} %, left the scene {:.1} %, under way when bounces were used up {:.2} %, by chance {:+.2} %; stored {:.1} % of what arrived",
        share(report.absorbed),
        share(report.escaped),
        share(report.cut_off),
        share(report.roulette),
        100.0 * stored / report.deposited.max(f64::MIN_POSITIVE)
    );
}
