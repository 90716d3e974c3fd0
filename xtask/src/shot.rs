//! One picture: method, light tree, virtual lights and global illumination put together.

mod dials;
mod plan;

use std::borrow::Cow;
use std::time::Instant;

use clustering::Clusters;
use cutinterp::{LevelMetric, Levels, ReconstructionParams, WeightParams};
use lightcut::Representatives;
use lighttree::{LightHierarchy, LightSampler, PowerSampler, TreeSampler, UniformSampler};
use scene::{
    BruteForce, Camera, DirectLighting, Drawn, Film, Frame, IndirectLighting, Light, NextEvent, NoDirect,
    NoIndirect, PathTracer, Progress, RenderParams, Rendered, Sampled, Scene, SceneRays, ShadingPoint,
    WalkReport, Walked,
};
use stochastic::{EnergySpread, TwoLevelSampler};

use self::dials::{cutinterp_params, lightcut_params};
pub(crate) use self::plan::{Gi, Plan};
use crate::device::{Device, Lit};
use crate::failure::Failure;
use crate::methods::filter::{Filter, Filtered};
use crate::methods::{
    CutCdfMethod, CutInterpMethod, Learned, LightcutMethod, Maps, Method, NextEventCells, NextEventSubtrees,
    PhotonLight, REPRESENTATIVES, ReconMethod, RisMethod, SharedCutMethod, Sparse, SubtreesMethod, View,
    cut_sampler, next_event_lights, representatives, split_sampler,
};
use crate::trees::{self, KeptMeshes, Tree, either};

/// What a picture is taken of.
#[derive(Clone, Copy)]
pub(crate) struct Stage<'a> {
    /// Geometry, materials, lights.
    pub(crate) scene: &'a Scene,
    /// Rays against it.
    pub(crate) rays: &'a SceneRays,
    /// Where from.
    pub(crate) camera: &'a Camera,
}

/// What a plan needs beside the scene, made once for any number of pictures.
pub(crate) struct Prepared<'a> {
    lights: Cow<'a, [Light]>,
    /// For methods that walk one, and for the bounces of paths.
    tree: Option<Tree>,
    tool: Tool,
    /// What earlier frames tell, and what this one will, where the method keeps anything.
    pub(crate) learned: Learned,
    /// Virtual lights among the lights.
    pub(crate) vpls: usize,
    /// Seconds that all of it took.
    pub(crate) seconds: f64,
}

/// What a picture leaves to the next one of a sequence; nothing before the first.
#[derive(Default)]
pub(crate) struct Left {
    /// Where light was gathered.
    pub(crate) clusters: Option<Clusters>,
    /// Records, for another picture of the same lights, tree and geometry.
    pub(crate) view: Option<View>,
}

/// What a method has beside the tree.
enum Tool {
    Nothing,
    Uniform(UniformSampler),
    Power(PowerSampler),
    Representatives(Representatives),
    Spread(EnergySpread),
    Photons(Box<Maps>),
    CutInterp(Representatives, Levels),
}

impl Prepared<'_> {
    /// Bytes of the light tree, with what the method keeps per node.
    pub(crate) fn bytes(&self) -> usize {
        let beside = match &self.tool {
            Tool::Representatives(representatives) => representatives.bytes(),
            Tool::Spread(spread) => spread.bytes(),
            Tool::Photons(maps) => maps.bytes(),
            Tool::CutInterp(representatives, levels) => representatives.bytes() + levels.bytes(),
            Tool::Nothing | Tool::Uniform(_) | Tool::Power(_) => 0,
        };
        self.tree.as_ref().map_or(0, Tree::bytes) + beside
    }
}

impl<'a> Stage<'a> {
    /// Traces virtual lights and builds the method's tree.
    ///
    /// # Errors
    /// The light that the tree refuses, named by the scene and its index.
    pub(crate) fn prepare(&self, plan: &Plan) -> Result<Prepared<'a>, Failure> {
        self.prepare_after(plan, &mut KeptMeshes::default())
    }

    /// The same for a frame after others, which have left trees of meshes that may not have changed.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    pub(crate) fn prepare_after(&self, plan: &Plan, kept: &mut KeptMeshes) -> Result<Prepared<'a>, Failure> {
        let start = Instant::now();
        let name = &self.scene.name;
        let Prepared { lights, vpls, .. } = self.prepare_lights(plan);
        // What draws lights: the method itself, or what a path tracer draws them by.
        let drawing = match plan.method {
            Method::Path => Method::of_next_event(&plan.settings),
            method => method,
        };
        let of_other_paths = plan.gi == Gi::Path && plan.method != Method::Path;
        let needs_tree = drawing.needs_tree() || of_other_paths;
        let mut build = || {
            let builder = plan.settings.find("builder").unwrap_or(trees::BUILDER.default);
            Tree::build(builder, &lights, self.scene, kept)
                .map_err(|error| Failure::failed(format!("{name}: no light tree: {error}")))
        };
        let tree = needs_tree.then(&mut build).transpose()?;
        let refuse =
            |error: &dyn std::fmt::Display| Failure::failed(format!("{name}: {error}; mend it in the file"));
        let tool = match (drawing, &tree) {
            (Method::Uniform, _) => Tool::Uniform(UniformSampler { count: lights.len() as u32 }),
            (Method::Power, _) => Tool::Power(PowerSampler::new(&lights).map_err(|error| refuse(&error))?),
            (Method::Lightcut, Some(tree)) => {
                let choice = plan.settings.find("representatives").unwrap_or(REPRESENTATIVES.default);
                let chosen = representatives(tree, &lights, choice, plan.seed);
                let chosen = chosen.map_err(|error| refuse(&error))?;
                Tool::Representatives(chosen)
            }
            (Method::Gather | Method::PhotonCut, _) => {
                let frame = self.frame(plan, &lights);
                let maps = Maps::trace(&frame, plan.bounces, &plan.settings);
                Tool::Photons(Box::new(maps.map_err(|error| refuse(&error))?))
            }
            (Method::Split, Some(tree)) => Tool::Spread(EnergySpread::of(tree)),
            (Method::CutInterp | Method::CutInterpVis | Method::Recon, Some(tree)) => {
                let choice = plan.settings.find("representatives").unwrap_or(REPRESENTATIVES.default);
                let chosen =
                    representatives(tree, &lights, choice, plan.seed).map_err(|error| refuse(&error))?;
                let metric = match plan.settings.find("metric").unwrap_or_default() {
                    "width" => LevelMetric::Log2Width,
                    "intensity" => LevelMetric::LogIntensity,
                    _ => LevelMetric::Depth,
                };
                Tool::CutInterp(chosen, Levels::measure(tree, metric))
            }
            _ => Tool::Nothing,
        };
        Ok(Prepared {
            lights,
            tree,
            tool,
            learned: Learned::default(),
            vpls,
            seconds: start.elapsed().as_secs_f64(),
        })
    }

    /// Traces virtual lights, and builds nothing: for a device, which builds by itself.
    pub(crate) fn prepare_lights(&self, plan: &Plan) -> Prepared<'a> {
        let start = Instant::now();
        let mut lights = Cow::Borrowed(&self.scene.lights[..]);
        let mut vpls = 0;
        if let Gi::Vpl(count) = plan.gi {
            let (made, report) = scene::virtual_lights(&self.frame(plan, &lights), count, plan.bounces);
            vpls = made.len();
            say_what_was_lost(&report);
            lights = Cow::Owned([&self.scene.lights[..], &made].concat());
        }
        let learned = Learned::default();
        let seconds = start.elapsed().as_secs_f64();
        Prepared { lights, tree: None, tool: Tool::Nothing, learned, vpls, seconds }
    }

    /// Takes one picture on a device, which has the scene's geometry.
    ///
    /// # Errors
    /// What keeps the device from it.
    pub(crate) fn render_on(
        &self,
        device: &mut Device,
        plan: &Plan,
        prepared: &Prepared<'_>,
        params: &RenderParams,
        progress: &impl Progress,
    ) -> Result<Lit, Failure> {
        device.render(plan, &self.frame(plan, &prepared.lights), self.camera, params, progress)
    }

    /// Takes one picture.
    ///
    /// # Errors
    /// If it has no pixels, or the threads cannot be started.
    pub(crate) fn render(
        &self,
        plan: &Plan,
        prepared: &Prepared<'_>,
        params: &RenderParams,
        progress: &impl Progress,
    ) -> Result<Rendered, Failure> {
        self.render_after(plan, prepared, params, progress, &mut Left::default())
    }

    /// Takes one picture of a sequence: with what the one before it left in `left`, which is replaced by this
    /// one's.
    ///
    /// # Errors
    /// If it has no pixels, or the threads cannot be started.
    pub(crate) fn render_after(
        &self,
        plan: &Plan,
        prepared: &Prepared<'_>,
        params: &RenderParams,
        progress: &impl Progress,
        left: &mut Left,
    ) -> Result<Rendered, Failure> {
        let shot = Shot { stage: self, plan, prepared, params, progress };
        match (&prepared.tool, &prepared.tree) {
            _ if plan.method == Method::Path => shot.paths(),
            (Tool::Uniform(sampler), _) => shot.sampled(sampler),
            (Tool::Power(sampler), _) => shot.sampled(sampler),
            (Tool::Representatives(representatives), Some(tree)) => {
                let params = lightcut_params(&plan.settings);
                shot.direct(&LightcutMethod { tree, representatives, params })
            }
            (Tool::Photons(maps), Some(tree)) => shot.photons(maps, tree, &mut left.clusters),
            (Tool::Spread(spread), Some(tree)) => {
                shot.direct(&Drawn(SubtreesMethod::split(tree, spread, &plan.settings)))
            }
            (_, Some(tree)) if plan.method == Method::Tree => {
                let choice = trees::choice(&plan.settings);
                // Once, instead of at each step of a walk.
                match tree {
                    Tree::Oriented(tree) => shot.walked(TreeSampler::new(tree).with_choice(choice)),
                    Tree::Perfect(tree) => shot.walked(TreeSampler::new(tree).with_choice(choice)),
                    Tree::TwoLevel(tree) => shot.sampled(TwoLevelSampler::new(tree).with_choice(choice)),
                }
            }
            (_, Some(tree)) if plan.method == Method::Cut => {
                shot.direct(&Drawn(SubtreesMethod::cut(tree, &plan.settings)?))
            }
            (_, Some(tree)) if plan.method == Method::SharedCut => {
                let frame = self.frame(plan, &prepared.lights);
                let size = (params.width, params.height);
                shot.direct(&Drawn(SharedCutMethod::new(tree, &plan.settings, &frame, self.camera, size)?))
            }
            (Tool::CutInterp(representatives, levels), Some(tree)) => {
                let lightcut =
                    LightcutMethod { tree, representatives, params: lightcut_params(&plan.settings) };
                match plan.method {
                    // Whatever was prepared for interpolation.
                    Method::Lightcut => shot.direct(&lightcut),
                    Method::Recon => shot.reconstructed(lightcut, levels),
                    _ => shot.interpolated(lightcut, levels, &mut left.view),
                }
            }
            (_, Some(tree)) if plan.method == Method::Ris => {
                let frame = self.frame(plan, &prepared.lights);
                shot.direct(&Drawn(RisMethod::new(tree, &plan.settings, &frame)))
            }
            (_, Some(tree)) if matches!(plan.method, Method::CutCdf | Method::CutCdfVis) => {
                let learn = plan.method == Method::CutCdfVis;
                either!(tree, tree => shot.direct(&Drawn(CutCdfMethod::new(tree, &plan.settings, learn, &prepared.learned))))
            }
            _ => shot.direct(&BruteForce),
        }
    }

    /// Filters a whole picture that was taken with these arguments.
    ///
    /// # Errors
    /// If the film is not of the size that the parameters say.
    pub(crate) fn filter(
        &self,
        plan: &Plan,
        prepared: &Prepared<'_>,
        params: &RenderParams,
        filter: &mut Filter,
        film: &mut Film,
    ) -> Result<Filtered, Failure> {
        filter.apply(&self.frame(plan, &prepared.lights), self.camera, params, film)
    }

    /// Radius of a sphere around the geometry.
    pub(crate) fn radius(&self) -> f32 {
        let (min, max) = self.scene.bounds().unwrap_or_default();
        0.5 * min.distance(max)
    }

    fn frame<'f>(&'f self, plan: &Plan, lights: &'f [Light]) -> Frame<'f, SceneRays> {
        let vpl_clamp = plan.settings.number("clamp").unwrap_or(f32::INFINITY);
        Frame {
            vpl_clamp,
            light_seed: plan.light_seed,
            ..Frame::new(self.scene, self.rays, lights, plan.seed)
        }
    }
}

/// One call of the renderer; its types depend on the method.
struct Shot<'a, P> {
    stage: &'a Stage<'a>,
    plan: &'a Plan,
    prepared: &'a Prepared<'a>,
    params: &'a RenderParams,
    progress: &'a P,
}

impl<P: Progress> Shot<'_, P> {
    fn sampled(&self, sampler: impl LightSampler<ShadingPoint> + Sync) -> Result<Rendered, Failure> {
        self.direct(&Drawn(Sampled { sampler, samples: self.plan.settings.whole("lights") }))
    }

    fn walked(&self, sampler: TreeSampler<'_, impl LightHierarchy + Sync>) -> Result<Rendered, Failure> {
        self.direct(&Drawn(Walked { sampler, samples: self.plan.settings.whole("lights") }))
    }

    fn direct(&self, direct: &impl DirectLighting<SceneRays>) -> Result<Rendered, Failure> {
        match &self.prepared.tree {
            Some(tree) if self.plan.gi == Gi::Path => {
                let lights = &self.prepared.lights;
                self.take(direct, &PathTracer::new(lights, TreeSampler::new(tree), self.plan.bounces, false))
            }
            _ => self.take(direct, &NoIndirect),
        }
    }

    /// All light by paths, which draw lights as `nee` has it.
    fn paths(&self) -> Result<Rendered, Failure> {
        let settings = &self.plan.settings;
        let samples = next_event_lights(settings);
        match (&self.prepared.tool, &self.prepared.tree) {
            (Tool::Uniform(sampler), _) => self.traced(Sampled { sampler, samples }),
            (Tool::Power(sampler), _) => self.traced(Sampled { sampler, samples }),
            (Tool::Spread(spread), Some(tree)) => {
                self.traced(NextEventSubtrees(split_sampler(tree, spread, settings, samples)))
            }
            (_, Some(tree)) => match Method::of_next_event(settings) {
                Method::Cut => self.traced(NextEventSubtrees(cut_sampler(tree, settings, samples))),
                Method::CutCdf | Method::CutCdfVis => {
                    let frame = self.stage.frame(self.plan, &self.prepared.lights);
                    self.traced(NextEventCells::new(tree, settings, frame.radius))
                }
                _ => {
                    let sampler = TreeSampler::new(tree).with_choice(trees::choice(settings));
                    self.traced(Sampled { sampler, samples })
                }
            },
            (_, None) => unreachable!("a tree was built for whatever else draws from one"),
        }
    }

    fn traced(&self, next_event: impl NextEvent) -> Result<Rendered, Failure> {
        let bounces = if self.plan.gi == Gi::Path { self.plan.bounces } else { 0 };
        let direct_too = self.plan.settings.find("direct") != Some("off");
        self.take(&NoDirect, &PathTracer::new(&self.prepared.lights, next_event, bounces, direct_too))
    }

    /// Finds the cuts of the blocks' corners before the picture is taken.
    fn reconstructed(&self, lightcut: LightcutMethod<'_>, levels: &Levels) -> Result<Rendered, Failure> {
        self.has_pixels()?;
        let frame = self.stage.frame(self.plan, &self.prepared.lights);
        let number = |key| self.plan.settings.number(key).unwrap_or_default();
        let dials = ReconstructionParams { threshold: number("agree"), largest: number("largest") };
        let method = ReconMethod::prepare(&frame, self.stage.camera, self.params, lightcut, levels, dials);
        let mut rendered = self.direct(&method)?;
        rendered.counts.add(method.counts());
        eprintln!("{} corners of {} bytes in all", method.corners(), method.bytes());
        Ok(rendered)
    }

    fn has_pixels(&self) -> Result<(), Failure> {
        if self.params.width == 0 || self.params.height == 0 || self.params.spp == 0 {
            return Err(Failure::usage(scene::RenderError::Size.to_string()));
        }
        Ok(())
    }

    /// Places records before the picture is taken, beside those of `view`, and leaves all of them there.
    fn interpolated(
        &self,
        lightcut: LightcutMethod<'_>,
        levels: &Levels,
        view: &mut Option<View>,
    ) -> Result<Rendered, Failure> {
        self.has_pixels()?;
        let frame = self.stage.frame(self.plan, &self.prepared.lights);
        let mut dials = cutinterp_params(&self.plan.settings)?;
        let (width, height) = (self.params.width, self.params.height);
        let share = self.plan.settings.number("r_share").unwrap_or(WeightParams::PICTURE_SHARE);
        dials.placement.weights = dials.placement.weights.in_picture(width, height, share);
        let last = view.take();
        let Self { stage: Stage { camera, .. }, params, .. } = self;
        let method = CutInterpMethod::prepare(&frame, camera, params, lightcut, levels, dials, last.as_ref());
        let mut rendered = self.direct(&method)?;
        rendered.counts.add(method.counts());
        eprintln!("{}", method.summary());
        *view = Some(method.into_view());
        Ok(rendered)
    }

    /// Indirect light from photon maps; direct light by walks down the tree.
    fn photons(
        &self,
        maps: &Maps,
        tree: &Tree,
        clusters: &mut Option<Clusters>,
    ) -> Result<Rendered, Failure> {
        let settings = &self.plan.settings;
        if settings.find("follow") == Some("off") {
            *clusters = None;
        }
        let frame = self.stage.frame(self.plan, &self.prepared.lights);
        let sparse = (settings.find("clusters") == Some("on"))
            .then(|| Sparse::gather(&frame, self.stage.camera, self.params, maps, settings, clusters))
            .transpose()
            .map_err(|error| Failure::failed(format!("{}: {error}", self.stage.scene.name)))?;
        let indirect = PhotonLight::new(maps, sparse.as_ref(), settings, frame.radius);
        let mut rendered = if settings.text("direct") == "on" {
            let sampled = Sampled { sampler: TreeSampler::new(tree), samples: settings.whole("lights") };
            self.take(&Drawn(sampled), &indirect)
        } else {
            self.take(&NoDirect, &indirect)
        }?;
        indirect.say();
        if let Some(sparse) = &sparse {
            rendered.counts.add(&sparse.counts);
        }
        Ok(rendered)
    }

    fn take(
        &self,
        direct: &impl DirectLighting<SceneRays>,
        indirect: &impl IndirectLighting<SceneRays>,
    ) -> Result<Rendered, Failure> {
        let frame = self.stage.frame(self.plan, &self.prepared.lights);
        scene::render(&frame, self.stage.camera, self.params, direct, indirect, self.progress)
            .map_err(|error| Failure::usage(error.to_string()))
    }
}

/// Virtual lights leave out what glossy lobes send on; a person who waits for them to agree with paths should
/// know.
fn say_what_was_lost(report: &WalkReport) {
    if report.deposited_glossy > 0.0 {
        eprintln!(
            "note: {:.0} % of the light that paths bring arrives on surfaces that have a glossy lobe as well; virtual lights stand for their diffuse part alone",
            100.0 * report.deposited_glossy / report.deposited
        );
    }
}
