//! How the device draws lights: what a plan asks for, and the kernels and buffers that do it.

use lighttree::ChildChoice;
use render_gpu::cdf::{CdfDraws, CdfKernels, CdfOptions, Learner, MOST_CDF_NODES};
use render_gpu::draw::{
    CutOptions, DrawKernels, DrawOptions, DrawRequest, Draws, Guard, LightTrees, MOST_NODES, Method as Walks,
};
use render_gpu::{DEFAULT_RECEIVER, Gpu, GpuError, ReceiverRecord, StageTimes};
use wgpu::{Buffer, CommandEncoder};

use super::{is_two_level, refused};
use crate::failure::Failure;
use crate::methods::Method;
use crate::shot::Plan;

/// Side of the blocks of pixels that share a distribution's cut, as on the CPU.
const CDF_BLOCK: u32 = 8;

/// What is drawn for the pixels of a picture, or of some of its rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Drawing {
    /// Walks from the root or from the nodes of a cut.
    Walks(Walks),
    /// By distributions over cuts.
    Cdf(CdfOptions),
}

impl Drawing {
    /// What this plan asks of the device.
    ///
    /// # Errors
    /// A usage error that names what the device does not do.
    pub(super) fn of(plan: &Plan, (width, height): (u32, u32)) -> Result<Self, Failure> {
        let settings = &plan.settings;
        match plan.method {
            Method::Tree => Ok(Self::Walks(Walks::Tree { lights: settings.whole("lights") })),
            Method::Cut => Ok(Self::Walks(Walks::Cut(cut(plan, 1)?))),
            Method::SharedCut => {
                let guard = (settings.text("guard") == "on").then(Guard::default);
                let interleave = settings.whole("m");
                let cut = cut(plan, interleave * interleave)?;
                let block = settings.whole("k");
                Ok(Self::Walks(Walks::SharedCut { cut, width, height, block, interleave, guard }))
            }
            Method::CutCdf | Method::CutCdfVis => {
                if is_two_level(plan) {
                    return Err(refused(
                        "distributions are over cuts of a tree of one level; leave --set builder out, or take tree, cut or shared-cut",
                    ));
                }
                let nodes = settings.whole("nodes");
                if nodes > MOST_CDF_NODES {
                    return Err(refused(&format!(
                        "cuts with distributions have at most {MOST_CDF_NODES} nodes there, not {nodes}; set nodes to less"
                    )));
                }
                let learn = plan.method == Method::CutCdfVis;
                Ok(Self::Cdf(CdfOptions {
                    nodes,
                    lights: settings.whole("lights"),
                    width,
                    height,
                    block: CDF_BLOCK,
                    learn: learn.then(|| settings.number("defensive").unwrap_or(1.0)),
                }))
            }
            other => Err(refused(&format!(
                "method `{}` is not on the device; take tree, cut, shared-cut, cut-cdf or cut-cdf-vis, or --device cpu",
                other.about().name
            ))),
        }
    }

    /// Entries for each pixel.
    pub(super) fn lights(&self) -> u32 {
        match self {
            Self::Walks(walks) => walks.lights(),
            Self::Cdf(options) => options.lights,
        }
    }

    /// Rows of pixels that have to stay together.
    pub(super) const fn block(&self) -> u32 {
        match *self {
            Self::Walks(Walks::SharedCut { block, .. }) | Self::Cdf(CdfOptions { block, .. }) => block,
            Self::Walks(_) => 1,
        }
    }

    /// Whether it learns from what shadow rays find.
    pub(super) const fn learns(&self) -> bool {
        matches!(self, Self::Cdf(CdfOptions { learn: Some(_), .. }))
    }

    /// The same for so many rows.
    pub(super) const fn of_rows(self, height: u32) -> Self {
        match self {
            Self::Walks(Walks::SharedCut { cut, width, block, interleave, guard, .. }) => {
                Self::Walks(Walks::SharedCut { cut, width, height, block, interleave, guard })
            }
            Self::Walks(_) => self,
            Self::Cdf(options) => Self::Cdf(CdfOptions { height, ..options }),
        }
    }
}

/// A cut that is drawn from by `parts` pixels together.
fn cut(plan: &Plan, parts: u32) -> Result<CutOptions, Failure> {
    let settings = &plan.settings;
    let lights = settings.whole("lights") * parts;
    let nodes = settings.number("nodes").map_or(lights, |nodes| nodes as u32);
    if nodes > MOST_NODES {
        return Err(refused(&format!(
            "cuts on the device have at most {MOST_NODES} subtrees, not {nodes}; set nodes or lights to less"
        )));
    }
    let distance_floor = settings.number("distance_floor").unwrap_or_default();
    Ok(CutOptions { nodes, per_node: lights / nodes, distance_floor })
}

/// The kernels that a plan needs.
pub(super) enum Kernels {
    Walks(DrawKernels),
    Cdf(CdfKernels),
}

impl Kernels {
    /// Compiles them.
    pub(super) fn new(
        gpu: &Gpu,
        drawing: &Drawing,
        choice: ChildChoice,
        two_level: bool,
    ) -> Result<Self, GpuError> {
        Ok(match drawing {
            Drawing::Walks(walks) => {
                let guard = matches!(walks, Walks::SharedCut { guard: Some(_), .. });
                let options = DrawOptions { choice, guard, two_level, ..DrawOptions::default() };
                Self::Walks(DrawKernels::with_options(gpu, &options)?)
            }
            Drawing::Cdf(_) => Self::Cdf(CdfKernels::with(gpu, choice, DEFAULT_RECEIVER)?),
        })
    }
}

/// What draws for the pixels of a band.
pub(super) enum Drawer {
    Walks(Box<Draws>),
    Cdf(Box<CdfDrawer>),
}

/// Distributions, and what learns for them.
pub(super) struct CdfDrawer {
    draws: CdfDraws,
    learner: Option<Learner>,
    /// Whether a frame before this one has learned.
    has_learned: bool,
}

impl Drawer {
    /// For the receivers of one buffer, into another; what lights gave will be in `outcomes`, where anything
    /// learns from it.
    pub(super) fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        tree: LightTrees<'_>,
        drawing: Drawing,
        receivers: &Buffer,
        [drawn, outcomes]: [&Buffer; 2],
    ) -> Result<Self, GpuError> {
        let stride = size_of::<ReceiverRecord>() as u64;
        match (kernels, drawing, tree) {
            (Kernels::Walks(kernels), Drawing::Walks(walks), tree) => {
                Ok(Self::Walks(Box::new(Draws::new(gpu, kernels, tree, walks, receivers, stride, drawn)?)))
            }
            (Kernels::Cdf(kernels), Drawing::Cdf(options), LightTrees::One(tree)) => {
                let draws = CdfDraws::new(gpu, kernels, tree, options, receivers, stride, drawn)?;
                let learner = options.learn.map(|_| draws.learner(gpu, outcomes)).transpose()?;
                Ok(Self::Cdf(Box::new(CdfDrawer { draws, learner, has_learned: false })))
            }
            _ => unreachable!("kernels were made for the plan"),
        }
    }

    /// What is drawn from the next submission on.
    pub(super) fn set_request(&self, gpu: &Gpu, request: &DrawRequest) -> Result<(), GpuError> {
        match self {
            Self::Walks(draws) => draws.set_request(gpu.queue(), request),
            Self::Cdf(cdf) => {
                cdf.draws.set_request(gpu.queue(), request);
                Ok(())
            }
        }
    }

    /// Records the draws; before those of a frame's first sample, cuts, which keep what was learned by those
    /// before them.
    pub(super) fn encode(&self, encoder: &mut CommandEncoder, times: &mut StageTimes, is_first: bool) {
        match self {
            Self::Walks(draws) => draws.encode(encoder),
            Self::Cdf(cdf) => {
                if is_first {
                    if cdf.has_learned {
                        cdf.draws.encode_cuts_keeping(encoder);
                    } else {
                        cdf.draws.encode_cuts(encoder);
                    }
                    times.mark(encoder, "cuts");
                }
                cdf.draws.encode_draws(encoder);
            }
        }
        times.mark(encoder, "draw");
    }

    /// Records that what the lights gave is learned.
    pub(super) fn encode_learning(&mut self, encoder: &mut CommandEncoder, times: &mut StageTimes) {
        let Self::Cdf(cdf) = self else { return };
        if let Some(learner) = &cdf.learner {
            learner.encode(encoder);
            times.mark(encoder, "learn");
            cdf.has_learned = true;
        }
    }
}
