//! Photon-mapped indirect light: final gather at every pixel, or at few, from all photons, or from a cut
//! through them. What a host writes to use the crates `clustering` and `photoncut`.

mod gathering;
mod maps;
mod nearness;
mod sparse;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::{DVec3, Vec3};
use photoncut::{Area, DensityParams, GatherScratch, Guide, PhotonScratch, RadianceSh, SampleScratch};
use scene::bsdf::{Bsdf, Transport};
use scene::{Counts, Frame, Geometry, IndirectLighting, ShadingPoint};

pub(crate) use maps::Maps;
pub(crate) use sparse::Sparse;

use crate::settings::{Key, Range, Settings};
use crate::trees;

const PHOTONS: Key = Key {
    name: "photons",
    default: "250000",
    range: Range::Whole(1, 100_000_000),
    trades: "photons in the global map, about: less blur and blotches, for time to trace them and memory",
};
const CAUSTICS: Key = Key {
    name: "caustics",
    default: "100000",
    range: Range::Whole(0, 100_000_000),
    trades: "photons in the caustic map, about: sharper caustics, for time to trace them; 0 leaves caustics out",
};
const CAUSTIC_RADIUS: Key = Key {
    name: "caustic_radius",
    default: "0.02",
    range: Range::Number(1e-6, 1.0),
    trades: "farthest photon of a caustic in radii of the scene: smaller is sharper and noisier",
};
const NEAREST: Key = Key {
    name: "nearest",
    default: "100",
    range: Range::Whole(2, 4096),
    trades: "photons in a density estimate: less noise, for blur and time",
};
const AREA: Key = Key {
    name: "area",
    default: "hull",
    range: Range::OneOf(&["hull", "disk"]),
    trades: "what a density is taken over: disk is a little faster and dark along edges",
};
const FLATTEN: Key = Key {
    name: "flatten",
    default: "1.5",
    range: Range::Number(1.0, 1000.0),
    trades: "how much more photons off a surface's plane count as far: more keeps light of shelves and frames apart, and thins it out on what is round",
};
const RAYS: Key = Key {
    name: "rays",
    default: "400",
    range: Range::Whole(1, 65_536),
    trades: "gather rays at each point: less noise, for time",
};
pub(super) const DIRECT: Key = Key {
    name: "direct",
    default: "on",
    range: Range::OneOf(&["on", "off"]),
    trades: "off leaves direct light out, so that indirect light can be compared alone",
};
const LIGHTS: Key = Key {
    name: "lights",
    default: "1",
    range: Range::Whole(1, 4096),
    trades: "light samples per camera sample for direct light: less noise, for as many more shadow rays",
};

/// Dials of `gather`.
pub(super) const GATHER_KEYS: [Key; 10] =
    [PHOTONS, CAUSTICS, CAUSTIC_RADIUS, NEAREST, AREA, FLATTEN, RAYS, DIRECT, LIGHTS, trees::BUILDER];

/// Dials of `photoncut`.
pub(super) const PHOTONCUT_KEYS: [Key; 30] = [
    PHOTONS,
    CAUSTICS,
    CAUSTIC_RADIUS,
    NEAREST,
    AREA,
    FLATTEN,
    Key { default: "200", ..RAYS },
    DIRECT,
    LIGHTS,
    trees::BUILDER,
    Key {
        name: "cut",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "off asks all photons where a gather ray ends: 10 times slower there, without the cut's blur",
    },
    Key {
        name: "nodes",
        default: "6000",
        range: Range::Whole(1, 10_000_000),
        trades: "nodes of the illumination cut: less blur, for noise (fewer photons each) and time",
    },
    Key {
        name: "choice",
        default: "power",
        range: Range::OneOf(&["power", "difference", "ratio"]),
        trades: "how the cut is found: power splits the brightest node until there are `nodes`; difference is the paper's rule, ratio the same both ways, and neither says how many nodes it takes",
    },
    Key {
        name: "rounds",
        default: "4",
        range: Range::Whole(0, 64),
        trades: "rounds of refinement for choice=difference and choice=ratio: more nodes where the estimate is off",
    },
    Key {
        name: "clusters",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "off gathers at every camera sample: hundreds of times slower, without interpolation",
    },
    Key {
        name: "samples",
        default: "3000",
        range: Range::Whole(1, 10_000_000),
        trades: "points where light is gathered: finer indirect shadows, for time",
    },
    Key {
        name: "doubtful",
        default: "0.5",
        range: Range::Number(0.0, 0.95),
        trades: "share of the points that is chosen where what the others foretell disagrees: gaps, creases and edges, for coarser clusters elsewhere; 0 is the paper's",
    },
    Key {
        name: "finer",
        default: "4",
        range: Range::Whole(1, 64),
        trades: "how many times fewer rays each doubtful point casts, and how many times more of them there are: more finds smaller gaps, for noise",
    },
    Key {
        name: "own",
        default: "0.2",
        range: Range::Number(0.0, f32::INFINITY),
        trades: "doubt from which on a camera sample gathers for itself, too, with as many rays as a doubtful point, and for itself alone from twice that: less brings more of the light of edges that no gathered point is at, for rays at each sample; inf never does",
    },
    Key {
        name: "guide",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "on sends most gather rays where those of points nearby met light: less noise where windows and bright spots light a room, for 16 bytes a ray",
    },
    Key {
        name: "probes",
        default: "1",
        range: Range::Whole(0, 64),
        trades: "rays of each pixel that ask how near things are, beside those that gather: keeps light out of gaps that no gathered point is in; 0 asks none",
    },
    Key {
        name: "follow",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "on keeps the points of one of --frames in the next where they still fit: less flicker, for clusters that are not as good as new ones",
    },
    Key {
        name: "alpha",
        default: "0.3",
        range: Range::Number(0.0, 1000.0),
        trades: "weight of distance against normals in clusters: more puts fewer clusters at edges and on round things",
    },
    Key {
        name: "neighbours",
        default: "8",
        range: Range::Whole(1, 32),
        trades: "gathered points that a pixel's light is interpolated from: smoother, for detail",
    },
    Key {
        name: "planes",
        default: "8",
        range: Range::Number(0.0, 1000.0),
        trades: "how much farther a gathered point off a pixel's plane counts as: more keeps light of shelves, steps and frames apart, and takes neighbours away on what is round",
    },
    Key {
        name: "noise",
        default: "3",
        range: Range::Number(0.0, 1000.0),
        trades: "what the noise of a single ray counts as beside distance: more averages gathered points that are near each other, 0 lets each speak alone where it is",
    },
    Key {
        name: "gradients",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "on lets a gathered point foretell its surroundings to first order: half the error between points from some hundred rays on; fewer make gradients noisy",
    },
    Key {
        name: "clamp_neighbours",
        default: "on",
        range: Range::OneOf(&["on", "off"]),
        trades: "off lets a gathered point reach as far as its own rays went, though its neighbour saw something near",
    },
    Key {
        name: "gloss_rays",
        default: "0",
        range: Range::Whole(0, 4096),
        trades: "rays per camera sample that follow glossy lobes; 0 takes spherical harmonics of what was gathered: no noise, but only broad lobes are right",
    },
    Key {
        name: "window",
        default: "inf",
        range: Range::Number(1.0, f32::INFINITY),
        trades: "width of the window on spherical harmonics, in bands: 4 takes most of the ringing away, and sharpness with it",
    },
];

/// How densities are estimated.
pub(super) fn density(settings: &Settings) -> DensityParams {
    let area = if settings.text("area") == "disk" { Area::Disk } else { Area::Hull };
    let flatten = settings.number("flatten").unwrap_or(1.0);
    DensityParams { area, flatten, ..DensityParams::nearest(settings.whole("nearest") as usize) }
}

/// Directions in which a glossy surface looks a sample's harmonics up.
const GLOSS_DIRECTIONS: u32 = 32;

/// Indirect light and caustics from photon maps.
pub(crate) struct PhotonLight<'a> {
    maps: &'a Maps,
    /// Light gathered at few points; `None`: at every camera sample.
    sparse: Option<&'a Sparse>,
    caustic: DensityParams,
    rays: u32,
    gloss_rays: u32,
    /// Doubt from which on a camera sample gathers for itself, too.
    own: f32,
    /// Rays that it casts then.
    own_rays: u32,
    /// Camera samples that did.
    own_gathers: AtomicU64,
    memory: Pool,
}

/// Memory of a thread.
#[derive(Default)]
pub(crate) struct Memory {
    pub(crate) gather: GatherScratch,
    pub(crate) guide: Guide,
    pub(crate) photons: PhotonScratch,
    samples: SampleScratch,
}

/// Memory that no thread has at the moment.
#[derive(Default)]
pub(crate) struct Pool(Mutex<Vec<Memory>>);

impl Pool {
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut Memory) -> R) -> R {
        let mut memory = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        let result = work(&mut memory);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
        result
    }
}

impl<'a> PhotonLight<'a> {
    /// For frames of a scene of this radius.
    pub(crate) fn new(maps: &'a Maps, sparse: Option<&'a Sparse>, settings: &Settings, radius: f32) -> Self {
        let reach = settings.number("caustic_radius").unwrap_or(1.0) * radius;
        Self {
            maps,
            sparse,
            caustic: DensityParams { max_radius: reach, area: Area::Disk, ..density(settings) },
            rays: settings.whole("rays"),
            own: settings.find("own").and_then(|_| settings.number("own")).unwrap_or(f32::INFINITY),
            own_rays: settings
                .find("finer")
                .map_or(0, |_| settings.whole("rays").div_ceil(settings.whole("finer"))),
            own_gathers: AtomicU64::new(0),
            gloss_rays: settings.find("gloss_rays").map_or(0, |_| settings.whole("gloss_rays")),
            memory: Pool::default(),
        }
    }

    /// Says on standard error how many camera samples gathered for themselves where others interpolate.
    pub(crate) fn say(&self) {
        if self.sparse.is_some() {
            let own = self.own_gathers.load(Ordering::Relaxed);
            eprintln!("camera samples that gathered for themselves: {own}, {} rays each", self.own_rays);
        }
    }

    /// What the caustic map gives at a point.
    fn caustics(&self, point: &ShadingPoint, memory: &mut Memory) -> Vec3 {
        let normal = point.geometric_normal;
        // The density has the photons' cosine in it, and so has `scatter`.
        let reflect = |wi: Vec3| {
            let cos = point.normal.dot(wi);
            if cos > 0.0 {
                point.bsdf.scatter(point.normal, point.wo, wi) / cos.max(1e-3)
            } else {
                Vec3::ZERO
            }
        };
        let map = &self.maps.caustic;
        map.estimate(point.position, normal, &self.caustic, &mut memory.photons, reflect).irradiance
    }
}

impl<Q: Geometry> IndirectLighting<Q> for PhotonLight<'_> {
    type Scratch = ();

    fn radiance(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        (): &mut (),
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3 {
        self.memory.with(|memory| {
            let caustics = self.caustics(point, memory);
            let gathered = match self.sparse {
                None => gathering::reflected(frame, self.maps, point, self.rays, rays, memory, counts),
                Some(_) if point.bsdf.is_glossy() && self.gloss_rays > 0 => {
                    gathering::along_lobes(frame, self.maps, point, self.gloss_rays, rays, memory, counts)
                }
                Some(sparse) => self.interpolated(sparse, frame, point, rays, memory, counts),
            };
            (caustics + gathered).as_dvec3()
        })
    }
}

impl PhotonLight<'_> {
    /// What a point reflects of what samples foretell, and, the more these are in doubt, of what it gathers for
    /// itself.
    fn interpolated<Q: Geometry>(
        &self,
        sparse: &Sparse,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        rays: &mut Q::Scratch,
        memory: &mut Memory,
        counts: &mut Counts,
    ) -> Vec3 {
        let foretold = sparse.samples.foretell(&sparse.nearness.place(point), &mut memory.samples);
        // Continuous, and by no number that the rays cast here decide: so right in the mean as these are.
        let part = (foretold.doubt / self.own - 1.0).clamp(0.0, 1.0);
        let mut own = |memory: &mut Memory, counts: &mut Counts| {
            self.own_gathers.fetch_add(1, Ordering::Relaxed);
            let shares = memory.samples.shares();
            let guided = sparse.point(&mut memory.guide, point, shares);
            gathering::reflected_guided(frame, self.maps, point, self.own_rays, guided, rays, memory, counts)
        };
        if part >= 1.0 {
            return own(memory, counts);
        }
        let interpolated = if let (true, Some(harmonics)) = (point.bsdf.is_glossy(), sparse.harmonics()) {
            let mut around = RadianceSh::default();
            for share in memory.samples.shares() {
                around.add_scaled(&harmonics[share.index as usize], share.weight);
            }
            glossy(point, &around, counts)
        } else {
            let diffuse = diffuse(point);
            count_cut_off(diffuse * foretold.cut_off, point, counts);
            diffuse * foretold.irradiance
        };
        if part > 0.0 { interpolated.lerp(own(memory, counts), part) } else { interpolated }
    }
}

/// Radiance per irradiance, sr⁻¹.
fn diffuse(point: &ShadingPoint) -> Vec3 {
    point.bsdf.diffuse_albedo(point.normal, point.wo) * core::f32::consts::FRAC_1_PI
}

/// The product of a surface's scattering with harmonics around it, by directions drawn from the former: the
/// same for every point, so that it is smooth. What ringing makes negative is cut off and counted.
fn glossy(point: &ShadingPoint, around: &RadianceSh, counts: &mut Counts) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for i in 0..GLOSS_DIRECTIONS {
        // Roberts' R2 sequence, and strata for the choice of the lobe.
        let u = [
            (i as f32 + 0.5) / GLOSS_DIRECTIONS as f32,
            (0.5 + 0.754_877_7 * i as f32).fract(),
            (0.5 + 0.569_840_3 * i as f32).fract(),
        ];
        if let Some(step) = sample(point, u) {
            sum += step.1 * around.radiance(step.0);
        }
    }
    let mean = sum / GLOSS_DIRECTIONS as f32;
    count_cut_off((-mean).max(Vec3::ZERO), point, counts);
    mean.max(Vec3::ZERO)
}

/// Radiance below zero that is cut off brings light that is not there.
fn count_cut_off(below_zero: Vec3, point: &ShadingPoint, counts: &mut Counts) {
    if below_zero != Vec3::ZERO {
        counts.clamped += 1;
        counts.clamped_luminance -= f64::from(scene::luminance(below_zero * point.throughput));
    }
}

/// A direction and its weight, above the surface.
pub(crate) fn sample(point: &ShadingPoint, u: [f32; 3]) -> Option<(Vec3, Vec3)> {
    let step = point.bsdf.sample(point.normal, point.wo, u, Transport::Radiance)?;
    (point.geometric_normal.dot(step.wi) > 0.0).then_some((step.wi, step.weight))
}

/// Whether a surface's reflection is one number.
pub(crate) const fn is_lambert(bsdf: &Bsdf) -> bool {
    matches!(bsdf, Bsdf::Lambert { .. })
}
