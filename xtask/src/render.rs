//! `cargo xtask render`: one scene, one method, one picture or one after another.

use std::path::PathBuf;
use std::time::Instant;

use clap::ValueEnum;
use scene::{Counts, Film, RenderParams, Scene, SceneRays};

use crate::failure::Failure;
use crate::frames::{self, Kept, Sequence};
use crate::methods::filter::Filter;
use crate::methods::{self, Method};
use crate::report::{self, Report, Seconds};
use crate::settings::Settings;
use crate::shot::{Gi, Plan};
use crate::{device, memory, output, source, stop};

/// What to render, and how.
#[derive(clap::Args)]
pub(crate) struct RenderArgs {
    /// A .glb or .gltf file, or a built-in scene with an optional number of lights: hall:10000, cornell,
    /// city:100000, glossy:1000, wall:1000000, and two that move: cornell-lights:12146, sun:100000
    #[arg(default_value = source::DEFAULT_SCENE)]
    scene: String,

    /// How direct light is found; --help-methods describes each
    #[arg(long, short, value_name = "M", default_value = "lightcut")]
    method: String,

    /// Turn a dial of the method, of the materials or of the camera, as often as you like; --help-methods
    /// lists them
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Camera samples per pixel; each method has its own default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    spp: Option<u32>,

    #[command(flatten)]
    look: LookArgs,

    /// Where to render: cpu, or gpu for the methods tree, cut, shared-cut, cut-cdf and cut-cdf-vis, on the
    /// best Vulkan adapter there is
    #[arg(long, value_name = "WHERE", default_value = "cpu")]
    device: Device,

    /// Frames, each with lights built anew and a seed of its own: more than one are written as FILE.0000.exr
    /// and so on
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,

    /// A picture of the same size to take the error against
    #[arg(long, value_name = "FILE.exr")]
    reference: Option<PathBuf>,

    /// Render only N pixels, drawn by the seed, and leave the rest black; errors are taken over those alone
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pixels: Option<u32>,

    /// Where the picture goes; a PNG goes beside it
    #[arg(long, short, value_name = "FILE.exr", default_value = "render.exr")]
    output: PathBuf,

    /// Print one JSON object as the last line of standard output
    #[arg(long)]
    json: bool,

    /// List the methods and their dials, and end
    #[arg(long)]
    help_methods: bool,
}

/// What a picture looks like, whatever the method.
#[derive(clap::Args)]
pub(crate) struct LookArgs {
    /// Light beyond the direct one: none, as virtual point lights, or by path tracing [default: none; path
    /// for --method path]
    #[arg(long, value_name = "HOW")]
    pub(crate) gi: Option<GiKind>,

    /// Virtual point lights for --gi vpl, about [default: 100000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=20_000_000))]
    vpls: Option<u32>,

    /// Indirect bounces for --gi vpl and --gi path [default: 5]
    #[arg(long, value_name = "B", value_parser = clap::value_parser!(u32).range(1..=1000))]
    bounces: Option<u32>,

    /// Width and height of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = size)]
    pub(crate) size: (u32, u32),

    /// Seed of every random number: the same seed gives the same picture, bit for bit
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub(crate) seed: u32,

    /// Threads; 0 takes as many as there are processors
    #[arg(long, value_name = "T", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) threads: u32,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum GiKind {
    None,
    Vpl,
    Path,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Device {
    Cpu,
    Gpu,
}

/// Most pixels of a picture: 16,384 × 8192, which takes some 5 GB to render and write.
const MOST_PIXELS: u64 = 1 << 27;

/// Reads `WIDTHxHEIGHT`.
pub(crate) fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parts {
        Some((width @ 1..=65_536, height @ 1..=65_536)) => {
            let pixels = u64::from(width) * u64::from(height);
            if pixels <= MOST_PIXELS {
                Ok((width, height))
            } else {
                Err(format!(
                    "{pixels} pixels would not fit into memory: {MOST_PIXELS} may be asked for, 16384x8192"
                ))
            }
        }
        _ => Err("write WIDTHxHEIGHT in pixels, each from 1 to 65536, such as 960x540".to_owned()),
    }
}

/// Renders one picture, or a few frames, and says what it took.
pub(crate) fn render(args: &RenderArgs) -> Result<(), Failure> {
    if args.help_methods {
        return output::print(&methods::help());
    }

    // Refuse what cannot work before any of the work is done.
    let total = Instant::now();
    let plan = plan(args)?;
    let params = params(args, plan.method);
    if args.device == Device::Gpu {
        device::check(&plan, &params)?;
    }
    check_memory(&plan, &params)?;
    args.look.note_unused(&plan);
    let materials = source::material_mode(&plan.settings)?;
    output::check(&args.output)?;
    let reference =
        args.reference.as_deref().map(|path| report::reference(path, args.look.size)).transpose()?;
    stop::listen()?;
    use_threads(args.look.threads)?;

    let device = (args.device == Device::Gpu).then(|| device::Device::new(&plan, &params)).transpose()?;

    // Set the stage.
    let (mut scene, load_seconds) = source::load(&args.scene, materials)?;
    let camera = source::camera(&scene, &plan.settings)?;
    let start = Instant::now();
    let mut rays =
        SceneRays::build(&scene).map_err(|error| Failure::failed(format!("{}: {error}", scene.name)))?;
    let mut seconds =
        Seconds { load: load_seconds, build_rays: start.elapsed().as_secs_f64(), ..Seconds::default() };

    // Take frame after frame, and write each.
    let sequence = Sequence {
        plan: &plan,
        camera: &camera,
        params: &params,
        reference: reference.as_ref(),
        frames: args.frames,
    };
    let (mut kept, mut counts, mut frames) = (Kept::on(device), Counts::default(), Vec::new());
    let mut exposure = plan.settings.number("exposure");
    let last = loop {
        let frame = frames.len() as u32;
        let mut taken = sequence.take(frame, &mut scene, &mut rays, &mut kept)?;
        frames::add(&mut seconds, &mut counts, &taken);
        // That of the first frame for all: a film must not flicker.
        let stops = *exposure.get_or_insert_with(|| scene::auto_exposure(&taken.rendered.film));
        let output = sequence.output(&args.output, frame);
        let mut about = plan.about(&scene.name, &camera.name, &params);
        if frame > 0 {
            about["frame"] = frame.into();
        }
        let png = output::picture(&output, &taken.rendered.film, stops, &about)?;
        taken.report.output = output;
        if args.frames > 1 {
            eprintln!("{}", taken.report.for_people());
        } else {
            eprintln!("wrote {} and {} (exposure {stops:+.2} stops)", args.output.display(), png.display());
        }
        if let Some(filtered) = &taken.report.filtered {
            eprintln!("{}", filtered.for_people());
        }
        frames.push(taken.report.json());
        if frame + 1 == args.frames || taken.rendered.cut_short {
            break taken;
        }
    };

    // Say what it took.
    seconds.total = total.elapsed().as_secs_f64();
    let report = Report {
        device: kept.device.as_ref(),
        scene: &scene,
        vpls: last.vpls,
        params: &params,
        plan: &plan,
        camera: &camera.name,
        exposure: exposure.unwrap_or_default(),
        threads: rayon::current_num_threads(),
        seconds,
        counts: &counts,
        light_tree_bytes: last.light_tree_bytes,
        rays_bytes: rays.bytes(),
        peak_rss: memory::peak_resident(),
        error: last.error,
        filter: last.report.filtered.map(|filtered| filtered.json()),
        output: &args.output,
        frames: (args.frames > 1).then_some(frames),
    };
    eprint!("{}", report.for_people());
    if !last.rendered.cut_short && last.rendered.film.pixels.iter().all(|p| p.max_element() <= 0.0) {
        eprintln!("note: the picture is black: {}", why_black(&scene));
    }
    if args.json {
        output::print(&format!("{}\n", report.json()))?;
    }
    if last.rendered.cut_short {
        return Err(Failure::Interrupted(format!(
            "{}: cut short; what was finished is written, the rest is black",
            last.report.output.display()
        )));
    }
    Ok(())
}

/// Says before any work that a picture will not fit into the memory there is.
fn check_memory(plan: &Plan, params: &RenderParams) -> Result<(), Failure> {
    // Measured: what is kept for each pixel beside the picture, and to write it.
    let bytes: u64 = match plan.method {
        Method::Gather | Method::PhotonCut => 300,
        _ if plan.settings.find("visibility").is_some() => 270,
        _ if Filter::is_in(&plan.settings) => 200,
        _ => 40,
    };
    let needed = u64::from(params.width) * u64::from(params.height) * bytes;
    let mebibytes = |bytes: u64| bytes >> 20;
    match memory::available() {
        Some(free) if needed > free => Err(Failure::failed(format!(
            "--size {}x{}: method `{}` needs about {} MiB for that many pixels, {} MiB are free: ask for fewer",
            params.width,
            params.height,
            plan.method.about().name,
            mebibytes(needed),
            mebibytes(free)
        ))),
        _ => Ok(()),
    }
}

/// What a person may do about a picture without light.
fn why_black(scene: &Scene) -> String {
    let name = &scene.name;
    if scene.triangle_count() == 0 {
        format!("{name} has no triangles")
    } else if scene.lights.is_empty() && scene.distant.is_empty() {
        format!("{name} has no lights: give it some, punctual ones or emissive materials")
    } else {
        let cameras = scene.cameras.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>().join(", ");
        let others = if cameras.is_empty() { String::new() } else { format!("; its cameras are {cameras}") };
        format!("no light gets to what the camera sees{others}")
    }
}

/// Everything that decides what the picture looks like, checked.
fn plan(args: &RenderArgs) -> Result<Plan, Failure> {
    let method = Method::named(&args.method)?;
    let settings = Settings::parse(&format!("method `{}`", args.method), &method.keys(), &args.set)?;
    if args.pixels.is_some() && Filter::is_in(&settings) {
        let line = "--pixels with --set filter: a filter needs the pixels around each; leave one of them out";
        return Err(Failure::usage(line));
    }
    args.look.plan(method, settings)
}

impl LookArgs {
    /// The plan of one method with this look.
    ///
    /// # Errors
    /// A usage error for a method that does not go with this light.
    pub(crate) fn plan(&self, method: Method, settings: Settings) -> Result<Plan, Failure> {
        method.check(&settings)?;
        let gi = match (self.gi, method) {
            (Some(GiKind::Vpl), Method::Path) => {
                let line = "method `path` with --gi vpl: a path tracer finds indirect light itself; use --gi path, or another method";
                return Err(Failure::usage(line));
            }
            (Some(GiKind::Vpl | GiKind::Path), Method::Gather | Method::PhotonCut) => {
                let line = "methods `gather` and `photoncut` find indirect light themselves; leave --gi out";
                return Err(Failure::usage(line));
            }
            (Some(GiKind::Vpl), _) => Gi::Vpl(self.vpls.unwrap_or(100_000) as usize),
            (Some(GiKind::Path), _) | (None, Method::Path) => Gi::Path,
            (Some(GiKind::None) | None, _) => Gi::None,
        };
        let bounces = self.bounces.unwrap_or(5);
        Ok(Plan { method, settings, gi, bounces, seed: self.seed, light_seed: self.seed })
    }

    /// Says which options of indirect light a plan doesn't look at.
    fn note_unused(&self, plan: &Plan) {
        if self.vpls.is_some() && !matches!(plan.gi, Gi::Vpl(_)) {
            eprintln!("note: --vpls is not looked at without --gi vpl");
        }
        let bounces = plan.gi != Gi::None || matches!(plan.method, Method::Gather | Method::PhotonCut);
        if self.bounces.is_some() && !bounces {
            eprintln!("note: --bounces is not looked at without --gi vpl or --gi path");
        }
    }
}

fn params(args: &RenderArgs, method: Method) -> RenderParams {
    let (width, height) = args.look.size;
    RenderParams {
        width,
        height,
        spp: args.spp.unwrap_or(method.about().spp),
        first_sample: 0,
        threads: args.look.threads as usize,
        pixels: args.pixels.map(|n| n as usize),
    }
}

/// Builders use the global pool; it gets as many threads as the renderer.
pub(crate) fn use_threads(threads: u32) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads as usize);
    pool.build_global()
        .map_err(|error| Failure::failed(format!("--threads {threads}: {error}; ask for fewer")))
}

/// Stops by which the PNG is brightened.
pub(crate) fn exposure(settings: &Settings, film: &Film) -> f32 {
    settings.number("exposure").unwrap_or_else(|| scene::auto_exposure(film))
}
