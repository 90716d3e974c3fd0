//! Distributions over shared cuts on the device against those of `stochastic`: the same lights, but for
//! counted ties; and what is learned.

mod common;
#[path = "common/scene.rs"]
mod scene;

use std::sync::LazyLock;

use glam::Vec3;
use lighttree::{
    BatchLightSampler, LightBounds, LightId, MortonBits, NodeId, PerReceiver, PerfectTree, SampleRequest,
    TreeSampler, WeightedLight, conformance,
};
use render_gpu::cdf::{BatchCdf, CdfDraws, CdfKernels, CdfOptions};
use render_gpu::draw::DrawRequest;
use render_gpu::records::NodeTag;
use render_gpu::tree::DeviceTree;
use render_gpu::{Gpu, GpuError, ReceiverRecord};
use scene::{allowed, contribution, device_tree, lights, receivers, ties};
use stochastic::{BlockGrid, CutCdf, CutScratch, NodeCdf, NodeLearning, ReceiverGroup, SharedCut};

static KERNELS: LazyLock<CdfKernels> =
    LazyLock::new(|| CdfKernels::new(common::gpu().expect("asked for with one")).unwrap());

const WIDTH: u32 = 45;
const HEIGHT: u32 = 22;

/// A floor with sky in it, and a block of nothing else.
fn picture() -> Vec<ReceiverRecord> {
    let all = receivers(8 * WIDTH * HEIGHT, 77);
    let sky = |i: u32| i % WIDTH > 30 && i / WIDTH < 9 || (i % WIDTH + i / WIDTH).is_multiple_of(11);
    // Neighbours are near one another, as in a picture.
    let place = |i: u32| [(i % WIDTH) as f32 * 0.4, (i / WIDTH) as f32 * 0.9];
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let [x, y] = place(i);
            let receiver = all[(8 * i + 3 + i % 5) as usize];
            let position = [x, y, receiver.position[2]];
            if sky(i) { ReceiverRecord::NONE } else { ReceiverRecord { position, ..receiver } }
        })
        .collect()
}

/// A picture's cuts and learning on the CPU.
struct Twin<'a> {
    tree: &'a PerfectTree,
    pixels: &'a [ReceiverRecord],
    grid: BlockGrid,
    cuts: Vec<SharedCut>,
    learning: Vec<NodeLearning>,
}

impl<'a> Twin<'a> {
    fn new(tree: &'a PerfectTree, pixels: &'a [ReceiverRecord], options: &CdfOptions) -> Self {
        let grid = BlockGrid::new(options.width, options.height, options.block);
        let mut scratch = CutScratch::default();
        let of_block = |block| {
            (0..options.width * options.height)
                .filter(move |&i| grid.block_of(i) == block)
                .map(|i| &pixels[i as usize])
                .filter(|pixel| **pixel != ReceiverRecord::NONE)
                .map(|pixel| (Vec3::from(pixel.position), Vec3::from(pixel.normal)))
        };
        let mut cuts = vec![];
        let mut learning = vec![];
        for block in 0..grid.blocks() {
            let mut cut = SharedCut::default();
            if let Some(group) = ReceiverGroup::of(of_block(block)) {
                cut.select(tree, &group, options.nodes as usize, &mut scratch);
            }
            learning.push(NodeLearning::default());
            learning.last_mut().unwrap().begin(cut.nodes().len());
            cuts.push(cut);
        }
        Self { tree, pixels, grid, cuts, learning }
    }

    /// What every pixel draws, and what it is to be learned by.
    fn draw(&self, options: &CdfOptions, request: &DrawRequest) -> Vec<WeightedLight> {
        let lights = options.lights;
        let mut rows = vec![WeightedLight::NONE; self.pixels.len() * lights as usize];
        let walk = TreeSampler::new(self.tree);
        let (mut weights, mut factors) = (vec![], vec![]);
        for ((pixel, row), i) in self.pixels.iter().zip(rows.chunks_mut(lights as usize)).zip(0..) {
            if *pixel == ReceiverRecord::NONE {
                continue;
            }
            let block = self.grid.block_of(i) as usize;
            let cut = &self.cuts[block];
            cut.records().estimate(pixel, &mut weights);
            self.learning[block].factors(&mut factors);
            let mut cdf = NodeCdf::default();
            if let (Some(defensive), false) = (options.learn, factors.is_empty()) {
                let sum = |of: &dyn Fn(usize) -> f32| (0..weights.len()).map(of).sum::<f32>();
                let plain = sum(&|i| weights[i]);
                let own = (1.0 - defensive) * plain / sum(&|i| weights[i] * factors[i]);
                let mixed: Vec<_> =
                    weights.iter().zip(&factors).map(|(w, f)| w * (own * f + defensive)).collect();
                cdf.build(&mixed, true);
            } else {
                cdf.build(&weights, false);
            }
            let sampler = CutCdf { walk: &walk, cut, cdf: &cdf };
            let request = SampleRequest {
                lights_per_receiver: lights,
                seed: request.seed,
                index: request.index,
                first_stream: request.first_stream + i,
            };
            PerReceiver::new(sampler).sample_batch(core::slice::from_ref(pixel), &request, row).unwrap();
        }
        rows
    }

    /// Learns from these rows, with what each entry gave.
    fn learn(&mut self, tags: &[NodeTag], outcomes: &[f32], lights: usize) {
        for ((tags, outcomes), i) in tags.chunks(lights).zip(outcomes.chunks(lights)).zip(0..) {
            let block = self.grid.block_of(i) as usize;
            for (tag, outcome) in tags.iter().zip(outcomes) {
                if tag.node != u32::MAX {
                    self.learning[block].drawn(tag.node as usize);
                    self.learning[block].gave(tag.node as usize, outcome * tag.scale);
                }
            }
        }
    }
}

struct Frame {
    receivers: wgpu::Buffer,
    draws: CdfDraws,
    drawn: wgpu::Buffer,
    entries: usize,
}

impl Frame {
    fn new(gpu: &Gpu, tree: &DeviceTree, pixels: &[ReceiverRecord], options: CdfOptions) -> Self {
        let receivers = gpu.upload("receivers", pixels).unwrap();
        let entries = pixels.len() * options.lights as usize;
        let drawn = gpu.upload("drawn", &vec![WeightedLight::NONE; entries]).unwrap();
        let draws = CdfDraws::new(gpu, &KERNELS, tree, options, &receivers, 48, &drawn).unwrap();
        gpu.run("cuts", |encoder| draws.encode_cuts(encoder)).unwrap();
        Self { receivers, draws, drawn, entries }
    }

    fn draw(&self, gpu: &Gpu, request: &DrawRequest) -> Vec<WeightedLight> {
        self.draws.set_request(gpu.queue(), request);
        gpu.run("draws", |encoder| self.draws.encode_draws(encoder)).unwrap();
        gpu.read(&self.drawn, self.entries).unwrap()
    }

    /// The cut of each block.
    fn cuts(&self, gpu: &Gpu, options: &CdfOptions) -> Vec<Vec<NodeId>> {
        let row = options.nodes as usize + 1;
        let words: Vec<u32> = gpu.read(self.draws.cuts(), self.draws.cuts().size() as usize / 4).unwrap();
        let cut = |words: &[u32]| words[1..][..words[0] as usize].iter().map(|&id| NodeId(id)).collect();
        words.chunks_exact(row).map(cut).collect()
    }

    /// What was learned of the nodes of each block's cut: samples, and squares.
    fn learned(&self, gpu: &Gpu, options: &CdfOptions) -> Vec<Vec<[f32; 2]>> {
        let all: Vec<[f32; 2]> =
            gpu.read(self.draws.learned(), self.draws.learned().size() as usize / 8).unwrap();
        let cuts = self.cuts(gpu, options);
        all.chunks_exact(options.nodes as usize).zip(cuts).map(|(l, cut)| l[..cut.len()].to_vec()).collect()
    }
}

fn options(nodes: u32, lights: u32, block: u32, learn: Option<f32>) -> CdfOptions {
    CdfOptions { nodes, lights, width: WIDTH, height: HEIGHT, block, learn }
}

#[test]
fn distributions_draw_the_lights_that_the_cpu_draws() {
    let gpu = gpu_or_skip!();
    let pixels = picture();
    for (count, nodes, block) in
        [(1, 8, 8), (7, 64, 8), (3000, 64, 8), (3000, 256, 8), (3000, 512, 8), (30_000, 100, 5), (500, 1, 16)]
    {
        let lights = lights(count, count);
        let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
        let device = device_tree(gpu, &lights);
        let options = options(nodes, 4, block, None);
        let frame = Frame::new(gpu, &device, &pixels, options);
        let twin = Twin::new(&tree, &pixels, &options);
        let ours = frame.cuts(gpu, &options);
        let other_cuts = ours.iter().zip(&twin.cuts).filter(|(a, b)| **a != b.nodes()).count();
        let request = DrawRequest { seed: 2, index: 5, first_stream: 9, ..DrawRequest::default() };
        let (ours, theirs) = (frame.draw(gpu, &request), twin.draw(&options, &request));
        // A cut that differs is one for a whole block.
        let ties = ties(&ours, &theirs, true).unwrap();
        eprintln!(
            "{count} lights, {nodes} nodes: {other_cuts} cuts and {ties} of {} entries differ",
            ours.len()
        );
        assert!(other_cuts <= 1, "{count} lights, {nodes} nodes: {other_cuts} cuts differ");
        assert!(
            ties <= 2 * allowed(ours.len()) + other_cuts * 64 * 4,
            "{count} lights, {nodes} nodes: {ties}"
        );
        assert!(ours.iter().filter(|entry| **entry != WeightedLight::NONE).count() > ours.len() / 3);
    }
}

/// Whether a light is seen: two thirds of the room are behind a wall.
fn sees(light: u32) -> bool {
    light >= 1300
}

fn outcomes(pixels: &[ReceiverRecord], lights: &[LightBounds], rows: &[WeightedLight]) -> Vec<f32> {
    let width = rows.len() / pixels.len();
    let gave = |(i, entry): (usize, &WeightedLight)| match entry.light {
        LightId::NONE => 0.0,
        LightId(light) if sees(light) => contribution(&pixels[i / width], &lights[light as usize]) as f32,
        _ => 0.0,
    };
    rows.iter().enumerate().map(gave).collect()
}

/// What all lights that are seen give each pixel.
fn truth(pixels: &[ReceiverRecord], lights: &[LightBounds]) -> Vec<f64> {
    let of = |pixel: &ReceiverRecord| {
        let seen = (0..lights.len()).filter(|&light| sees(light as u32));
        if *pixel == ReceiverRecord::NONE { 0.0 } else { seen.map(|l| contribution(pixel, &lights[l])).sum() }
    };
    pixels.iter().map(of).collect()
}

/// What a node of a new cut begins with: half of what the cut before has learned of it, of what is below it,
/// or its part of what is above it.
fn kept(node: NodeId, cut: &[NodeId], learned: &[[f32; 2]]) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for (other, learned) in cut.iter().zip(learned) {
        let [up, down] = [(node.0, other.0), (other.0, node.0)]
            .map(|(a, b): (u32, u32)| a.ilog2().checked_sub(b.ilog2()).filter(|d| a >> d == b));
        let share = match (down, up) {
            (Some(_), _) => 0.5,
            (None, Some(depth)) => 0.5 / f64::from(1u32 << depth),
            (None, None) => continue,
        };
        (0..2).for_each(|i| sum[i] += share * f64::from(learned[i]));
    }
    sum
}

#[test]
fn new_cuts_keep_what_earlier_ones_have_learned() {
    let gpu = gpu_or_skip!();
    let mut pixels = picture();
    let mut lights = lights(2000, 3);
    lights.sort_by(|a, b| a.min.x.total_cmp(&b.min.x));
    let device = device_tree(gpu, &lights);
    let options = options(64, 8, 8, Some(0.1));
    let frame = Frame::new(gpu, &device, &pixels, options);
    let buffer = gpu.buffer("outcomes", 4 * frame.entries as u64, wgpu::BufferUsages::empty()).unwrap();
    let learner = frame.draws.learner(gpu, &buffer).unwrap();
    for index in 0..6 {
        let rows = frame.draw(gpu, &DrawRequest { seed: 7, index, ..DrawRequest::default() });
        gpu.write(&buffer, &outcomes(&pixels, &lights, &rows)).unwrap();
        gpu.run("learn", |encoder| learner.encode(encoder)).unwrap();
    }
    let (cuts, learned) = (frame.cuts(gpu, &options), frame.learned(gpu, &options));

    // The camera moves: other cuts, with less noise than those that begin with nothing.
    for pixel in pixels.iter_mut().filter(|pixel| **pixel != ReceiverRecord::NONE) {
        pixel.position[0] += 0.7;
    }
    gpu.write(&frame.receivers, &pixels).unwrap();
    let truth = truth(&pixels, &lights);
    let squared_error = || -> f64 {
        let rows = frame.draw(gpu, &DrawRequest { seed: 7, index: 100, ..DrawRequest::default() });
        let gave = outcomes(&pixels, &lights, &rows);
        let sums = rows.chunks(8).zip(gave.chunks(8)).map(|(row, gave)| {
            row.iter().zip(gave).map(|(e, g)| f64::from(e.weight) * f64::from(*g)).sum::<f64>()
        });
        sums.zip(&truth).filter(|(_, t)| **t > 0.0).map(|(sum, t)| (sum / t - 1.0).powi(2)).sum()
    };
    gpu.run("cuts", |encoder| frame.draws.encode_cuts_keeping(encoder)).unwrap();
    let (new_cuts, new_learned) = (frame.cuts(gpu, &options), frame.learned(gpu, &options));
    assert!(cuts.iter().zip(&new_cuts).filter(|(a, b)| a != b).count() > cuts.len() / 2);
    for (block, (cut, found)) in new_cuts.iter().zip(&new_learned).enumerate() {
        for (&node, found) in cut.iter().zip(found) {
            let wanted = kept(node, &cuts[block], &learned[block]);
            for (found, wanted) in found.iter().zip(wanted) {
                let found = f64::from(*found);
                assert!((found - wanted).abs() <= 1e-5 * wanted, "block {block}: {found}, not {wanted}");
            }
        }
    }
    assert!(new_learned.iter().flatten().any(|[samples, _]| *samples > 0.0));
    let keeping = squared_error();

    // The control: cuts that forget.
    gpu.run("cuts", |encoder| frame.draws.encode_cuts(encoder)).unwrap();
    assert_eq!(frame.cuts(gpu, &options), new_cuts);
    assert!(frame.learned(gpu, &options).iter().flatten().all(|learned| *learned == [0.0; 2]));
    let forgetting = squared_error();
    eprintln!("squared error {keeping:.1} with what was learned, {forgetting:.1} without");
    assert!(keeping < 0.7 * forgetting);
}

/// Half of what is known of a node that has 65,536 samples or more.
fn halved([mut samples, mut squares]: [f32; 2]) -> [f32; 2] {
    while samples >= 65_536.0 {
        (samples, squares) = (0.5 * samples, 0.5 * squares);
    }
    [samples, squares]
}

#[test]
fn many_samples_do_not_end_learning() {
    let gpu = gpu_or_skip!();
    let mut pixels = picture();
    let lights = lights(2000, 3);
    let device = device_tree(gpu, &lights);
    let options = options(32, 8, 16, Some(0.1));
    let frame = Frame::new(gpu, &device, &pixels, options);
    let buffer = gpu.buffer("outcomes", 4 * frame.entries as u64, wgpu::BufferUsages::empty()).unwrap();
    let learner = frame.draws.learner(gpu, &buffer).unwrap();
    let blocks = BlockGrid::new(WIDTH, HEIGHT, 16);
    let fill = |told: [f32; 2]| {
        gpu.write(frame.draws.learned(), &vec![told; 32 * blocks.blocks() as usize]).unwrap();
        vec![[told; 32]; blocks.blocks() as usize]
    };

    // Some nodes pass the limit in the middle of a frame.
    let mut wanted = fill([65_500.0, 100_000.0]);
    let rows = frame.draw(gpu, &DrawRequest { seed: 7, ..DrawRequest::default() });
    let gave = outcomes(&pixels, &lights, &rows);
    gpu.write(&buffer, &gave).unwrap();
    gpu.run("learn", |encoder| learner.encode(encoder)).unwrap();
    let tags: Vec<NodeTag> = gpu.read(frame.draws.tags(), frame.entries).unwrap();
    for ((tag, gave), i) in tags.iter().zip(&gave).zip(0..).filter(|((tag, _), _)| tag.node != u32::MAX) {
        let told = &mut wanted[blocks.block_of(i / 8) as usize][tag.node as usize];
        *told = halved([told[0] + 1.0, told[1]]);
        told[1] += (gave * tag.scale).powi(2);
    }
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-4 * b;
    let mut passed = 0;
    for (found, wanted) in frame.learned(gpu, &options).iter().zip(&wanted) {
        for (found, wanted) in found.iter().zip(wanted) {
            assert!(found[0] == wanted[0] && near(found[1], wanted[1]), "{found:?}, not {wanted:?}");
            passed += usize::from(found[0] < 40_000.0);
        }
    }
    assert!(passed > 10, "{passed} nodes passed the limit");

    // Nodes of new cuts may take over more than that at once.
    fill([60_000.0, 90_000.0]);
    let learned = frame.learned(gpu, &options);
    let cuts = frame.cuts(gpu, &options);
    for pixel in pixels.iter_mut().filter(|pixel| **pixel != ReceiverRecord::NONE) {
        pixel.position[0] += 5.0;
    }
    gpu.write(&frame.receivers, &pixels).unwrap();
    gpu.run("cuts", |encoder| frame.draws.encode_cuts_keeping(encoder)).unwrap();
    let mut passed = 0;
    let (new_cuts, new_learned) = (frame.cuts(gpu, &options), frame.learned(gpu, &options));
    for (((cut, found), before), learned) in new_cuts.iter().zip(&new_learned).zip(&cuts).zip(&learned) {
        for (&node, found) in cut.iter().zip(found) {
            let all = kept(node, before, learned).map(|x| x as f32);
            let wanted = halved(all);
            assert!(near(found[0], wanted[0]) && near(found[1], wanted[1]), "{found:?}, not {wanted:?}");
            passed += usize::from(all != wanted);
        }
    }
    assert!(passed > 0, "no node took over more");
}

#[test]
fn what_is_learned_is_what_the_cpu_learns_and_saves_noise() {
    let gpu = gpu_or_skip!();
    let pixels = picture();
    let mut lights = lights(2000, 3);
    // Neighbours in the list are neighbours in space, so that what is hidden is hidden together.
    lights.sort_by(|a, b| a.min.x.total_cmp(&b.min.x));
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let device = device_tree(gpu, &lights);
    let options = options(64, 8, 8, Some(0.1));
    let frame = Frame::new(gpu, &device, &pixels, options);
    let mut twin = Twin::new(&tree, &pixels, &options);
    let buffer = gpu.buffer("outcomes", 4 * frame.entries as u64, wgpu::BufferUsages::empty()).unwrap();
    let learner = frame.draws.learner(gpu, &buffer).unwrap();

    let truth = truth(&pixels, &lights);
    let (mut error, mut means) = (vec![], vec![0.0; pixels.len()]);
    const FRAMES: u32 = 12;
    for index in 0..FRAMES {
        let request = DrawRequest { seed: 7, index, ..DrawRequest::default() };
        let ours = frame.draw(gpu, &request);
        let theirs = twin.draw(&options, &request);
        let ties = ties(&ours, &theirs, true).unwrap();
        assert!(ties <= allowed(ours.len()) + 30, "frame {index}: {ties} of {} differ", ours.len());

        let gave = outcomes(&pixels, &lights, &ours);
        let mut squared = 0.0;
        for (i, (row, gave)) in ours.chunks(8).zip(gave.chunks(8)).enumerate() {
            let sum: f64 = row.iter().zip(gave).map(|(e, g)| f64::from(e.weight) * f64::from(*g)).sum();
            means[i] += sum / f64::from(FRAMES);
            if truth[i] > 0.0 {
                squared += (sum / truth[i] - 1.0).powi(2);
            }
        }
        error.push(squared);

        gpu.write(&buffer, &gave).unwrap();
        gpu.run("learn", |encoder| learner.encode(encoder)).unwrap();
        let tags: Vec<NodeTag> = gpu.read(frame.draws.tags(), frame.entries).unwrap();
        twin.learn(&tags, &gave, 8);
    }
    let early = error[0];
    let late: f64 = error[6..].iter().sum::<f64>() / 6.0;
    eprintln!("squared error {early:.1} at first, {late:.1} after 6 frames");
    assert!(late < 0.7 * early, "{error:?}");
    let mean: f64 = means.iter().sum::<f64>() / truth.iter().sum::<f64>();
    assert!((mean - 1.0).abs() < 0.01, "what was learned biases: {mean}");
}

#[test]
fn the_batch_sampler_conforms() {
    let gpu = gpu_or_skip!();
    let lights = lights(60, 6);
    let device = device_tree(gpu, &lights);
    let receivers: Vec<_> = receivers(48, 8).into_iter().filter(|r| r.position[2] < 1.0).collect();
    let given = |receiver: &ReceiverRecord, light: LightId| contribution(receiver, &lights[light.0 as usize]);
    let mut batch = BatchCdf::new(gpu, &device, &KERNELS, 32);
    let request = SampleRequest { lights_per_receiver: 64, seed: 5, ..SampleRequest::default() };
    conformance::check_batch(&mut batch, &receivers, &request, 30, 60, given, 0.05).unwrap();
}

/// The negative control: a distribution that weighs something else draws other lights.
#[test]
fn a_distribution_that_differs_is_found() {
    let gpu = gpu_or_skip!();
    let pixels = picture();
    let lights = lights(3000, 3);
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let device = device_tree(gpu, &lights);
    let right = options(64, 4, 8, None);
    let request = DrawRequest::default();
    let theirs = Twin::new(&tree, &pixels, &right).draw(&right, &request);
    let mut brighter = pixels.clone();
    brighter.iter_mut().for_each(|pixel| pixel.diffuse += 0.01 * pixel.peak);
    for (pixels, options) in [(&pixels, options(63, 4, 8, None)), (&brighter, right)] {
        let ours = Frame::new(gpu, &device, pixels, options).draw(gpu, &request);
        assert!(ties(&ours, &theirs, true).unwrap() > allowed(ours.len()) + 256);
    }
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let gpu = gpu_or_skip!();
    let device = device_tree(gpu, &lights(10, 1));
    let receivers = gpu.upload("receivers", &picture()).unwrap();
    let drawn = gpu.buffer("drawn", 8 * u64::from(WIDTH * HEIGHT), wgpu::BufferUsages::empty()).unwrap();
    let new = |options| CdfDraws::new(gpu, &KERNELS, &device, options, &receivers, 48, &drawn);
    for options in
        [options(0, 1, 8, None), options(513, 1, 8, None), options(64, 0, 8, None), options(64, 1, 65, None)]
    {
        assert!(matches!(new(options), Err(GpuError::Range { .. })), "{options:?}");
    }
    assert!(matches!(new(options(64, 2, 8, None)), Err(GpuError::TooMany { what: "pixels", .. })));
    let draws = new(options(64, 1, 8, None)).unwrap();
    assert!(matches!(draws.learner(gpu, &drawn), Err(GpuError::Range { .. })), "nothing is to be learned");
}
