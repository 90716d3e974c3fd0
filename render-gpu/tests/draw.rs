//! Lights drawn on the device against those that `lighttree` and `stochastic` draw: the same, but for counted
//! ties.

mod common;
#[path = "common/scene.rs"]
mod scene;

use std::collections::BTreeSet;
use std::sync::LazyLock;

use scene::{TREES, allowed, contribution, device_tree, lights, receivers, ties};

use glam::Vec3;
use lighttree::rng::{Decisions, Random};
use lighttree::strategies::{self, AnyReceiver};
use lighttree::{
    BatchLightSampler, ChildChoice, LightBounds, LightId, MortonBits, NodeId, PerReceiver, PerfectTree,
    SampleRequest, TreeSampler, WeightedLight, conformance,
};
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use render_gpu::draw::{
    BLOCK_SALT, BatchDraws, CutOptions, DrawKernels, DrawOptions, DrawRequest, Draws, Guard, Method,
};
use render_gpu::records::LightRecord;
use render_gpu::tree::{DeviceTree, Sort};
use render_gpu::{DEFAULT_RECEIVER, GpuError, ReceiverRecord};
use stochastic::{BlockGrid, CutParams, CutSampler, Interleave, Selection, SurfacePoint};

static DRAWS: LazyLock<DrawKernels> =
    LazyLock::new(|| DrawKernels::new(common::gpu().expect("asked for with one")).unwrap());

static GUARDED: LazyLock<DrawKernels> = LazyLock::new(|| {
    let options = DrawOptions { guard: true, ..DrawOptions::default() };
    DrawKernels::with_options(common::gpu().expect("asked for with one"), &options).unwrap()
});

#[test]
fn walks_draw_the_lights_that_the_cpu_draws() {
    let gpu = gpu_or_skip!();
    let few = [1, 2, 3, 30_000].into_iter().zip(ChildChoice::ALL);
    for (count, choice) in few.chain(ChildChoice::ALL.map(|choice| (1000, choice))) {
        let (lights, receivers) = (lights(count, count), receivers(2000, count));
        let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
        let device = device_tree(gpu, &lights);
        let kernels = DrawKernels::with(gpu, choice, DEFAULT_RECEIVER).unwrap();
        let request = SampleRequest { lights_per_receiver: 5, seed: 3, index: 7, first_stream: 1000 };
        let mut rows = [0; 2].map(|_| vec![WeightedLight::NONE; 5 * receivers.len()]);
        let sampler = TreeSampler::new(&tree).with_choice(choice);
        PerReceiver::new(sampler).sample_batch(&receivers, &request, &mut rows[0]).unwrap();
        BatchDraws::new(gpu, &device, &kernels, None)
            .sample_batch(&receivers, &request, &mut rows[1])
            .unwrap();
        let ties = ties(&rows[1], &rows[0], false).unwrap_or_else(|e| panic!("{count}, {choice:?}: {e}"));
        eprintln!("{count} lights, {choice:?}: {ties} of {} entries differ", rows[0].len());
        assert!(ties <= allowed(rows[0].len()), "{count} lights, {choice:?}: {ties}");
    }
}

/// What a row of a cut is on the CPU: `Subtrees::draw`, with the slots that gave nothing.
fn cut_row(
    cut: &CutSampler<'_, PerfectTree>,
    nodes: &[NodeId],
    receiver: &ReceiverRecord,
    (part, interleave, per_node): (u32, Interleave, u32),
    random: Random,
    row: &mut [WeightedLight],
) {
    let all = nodes.len() as u64 * u64::from(per_node);
    let slots = interleave.share(part, all);
    let count = f64::from(per_node) / f64::from(interleave.parts());
    row.fill(WeightedLight::NONE);
    let mut random = Decisions::new(random);
    let mut reported = Vec::new();
    let subtrees = cut.subtrees(nodes);
    subtrees
        .draw(receiver, slots.clone(), per_node, &mut random.clone(), |_, sample, _| reported.push(sample));

    let offset = random.stream().u64();
    let (stratum, step) = (u64::MAX / u64::from(per_node), u64::MAX / all.max(1));
    let mut reported = reported.into_iter();
    for (slot, entry) in slots.zip(row) {
        let (node, draw) = (slot / u64::from(per_node), slot % u64::from(per_node));
        random.restart(offset.wrapping_add(draw * stratum).wrapping_add(node * step));
        if let Some(sample) = cut.walk().sample_below(nodes[node as usize], receiver, &mut random).0 {
            assert_eq!(Some(sample), reported.next(), "the reference of this test draws as `Subtrees` does");
            *entry = WeightedLight { light: sample.light, weight: (1.0 / (sample.pmf * count)) as f32 };
        }
    }
}

#[test]
fn cuts_draw_the_lights_that_the_cpu_draws() {
    let gpu = gpu_or_skip!();
    // Of lights that are all alike every node is as bad as its neighbours: the lowest number decides.
    let alike = vec![LightBounds::point(Vec3::new(9.0, 8.0, 3.0), 0.1); 64];
    let spread = |count| lights(count, count);
    for (lights, nodes, per_node) in [
        (spread(1), 8, 1),
        (spread(5), 8, 2),
        (spread(1000), 1, 3),
        (spread(1000), 8, 1),
        (spread(30_000), 32, 1),
        (alike, 5, 1),
    ] {
        let count = lights.len() as u32;
        let receivers = receivers(1000, count);
        let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
        let device = device_tree(gpu, &lights);
        let options = CutOptions { nodes, per_node, distance_floor: 0.02 };
        let width = nodes * per_node;
        let request = SampleRequest { lights_per_receiver: width, seed: 3, index: 7, first_stream: 1000 };
        let mut ours = vec![WeightedLight::NONE; width as usize * receivers.len()];
        BatchDraws::new(gpu, &device, &DRAWS, Some(options))
            .sample_batch(&receivers, &request, &mut ours)
            .unwrap();

        let mut theirs = vec![WeightedLight::NONE; ours.len()];
        let cut = CutSampler::new(&tree, CutParams { nodes, distance_floor: 0.02 });
        let mut selection = Selection::default();
        for ((receiver, row), i) in receivers.iter().zip(theirs.chunks_mut(width as usize)).zip(0..) {
            cut.select(receiver, &mut selection);
            let random = Random::new(3, 1000 + i, 7);
            cut_row(&cut, selection.nodes(), receiver, (0, Interleave::new(1), per_node), random, row);
        }
        let ties = ties(&ours, &theirs, true).unwrap_or_else(|e| panic!("{count}, {nodes}: {e}"));
        eprintln!("{count} lights, {nodes} x {per_node}: {ties} of {} entries differ", ours.len());
        assert!(ties <= allowed(ours.len()), "{count} lights, {nodes} nodes: {ties}");
    }
}

#[test]
fn shared_cuts_draw_the_lights_that_the_cpu_draws() {
    let gpu = gpu_or_skip!();
    let (width, height) = (45, 30);
    let lights = lights(5000, 5);
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let device = device_tree(gpu, &lights);
    // A picture with sky in it, and blocks of nothing else.
    let mut pixels = receivers(width * height, 77);
    for (pixel, i) in pixels.iter_mut().zip(0..) {
        let (x, y) = (i % width, i / width);
        if x > 30 && y < 9 || (x + y) % 11 == 0 {
            *pixel = ReceiverRecord::NONE;
        }
    }
    let buffer = gpu.upload("receivers", &pixels).unwrap();
    let guard = Some(Guard { min_normal_cos: 0.2, max_distance: 0.8, ..Guard::default() });
    let eye = [10.0, -5.0, 1.5];
    let mut admitted = [0; 2];
    for (block, interleave, nodes, per_node, frame, guard) in [
        (8, 1, 8, 1, 0, None),
        (8, 2, 32, 1, 5, None),
        (7, 1, 4, 2, 1, None),
        (8, 4, 8, 1, 3, None),
        (64, 8, 32, 2, 60, None),
        (1, 1, 8, 1, 9, None),
        (8, 1, 8, 1, 0, guard),
        (7, 7, 32, 1, 4, guard),
        (3, 1, 8, 1, 6, guard),
        (
            8,
            1,
            8,
            1,
            2,
            Some(Guard {
                min_normal_cos: -1.0,
                max_plane_distance: f32::INFINITY,
                max_distance: f32::INFINITY,
            }),
        ),
    ] {
        let cut = CutOptions { nodes, per_node, distance_floor: 0.02 };
        let method = Method::SharedCut { cut, width, height, block, interleave, guard };
        let row = method.lights() as usize;
        let drawn = gpu.upload("drawn", &vec![WeightedLight::NONE; row * pixels.len()]).unwrap();
        let kernels = if guard.is_some() { &*GUARDED } else { &*DRAWS };
        let draws = Draws::new(gpu, kernels, &device, method, &buffer, 48, &drawn).unwrap();
        let request = DrawRequest { seed: 11, index: frame, eye, ..DrawRequest::default() };
        draws.set_request(gpu.queue(), &request).unwrap();
        gpu.run("draw", |encoder| draws.encode(encoder)).unwrap();
        let ours: Vec<WeightedLight> = gpu.read(&drawn, row * pixels.len()).unwrap();

        let grid = BlockGrid::new(width, height, block);
        let interleave = Interleave::new(interleave);
        let sampler = CutSampler::new(&tree, CutParams { nodes, distance_floor: 0.02 });
        let mut selection = Selection::default();
        let seen = |pixel: &ReceiverRecord| {
            let [position, normal] = [pixel.position, pixel.normal].map(Vec3::from);
            SurfacePoint { position, normal, depth: position.distance(Vec3::from(eye)) }
        };
        let cuts: Vec<(Vec<NodeId>, Option<SurfacePoint>)> = (0..grid.blocks())
            .map(|block| {
                let mut random = Random::new(11 ^ BLOCK_SALT, block, frame);
                let lit = |pixel: &u32| pixels[*pixel as usize] != ReceiverRecord::NONE;
                let representative = grid.candidates(block, &mut random).find(lit);
                representative.map_or((vec![], None), |pixel| {
                    let pixel = &pixels[pixel as usize];
                    (sampler.select(pixel, &mut selection).to_vec(), Some(seen(pixel)))
                })
            })
            .collect();
        let guard = guard.map(|Guard { min_normal_cos, max_plane_distance, max_distance }| {
            stochastic::Guard { min_normal_cos, max_plane_distance, max_distance }
        });
        let mut theirs = vec![WeightedLight::NONE; ours.len()];
        for ((pixel, row), i) in pixels.iter().zip(theirs.chunks_mut(row)).zip(0..) {
            if *pixel != ReceiverRecord::NONE {
                let part = interleave.part(i % width, i / width, frame);
                let (shared, representative) = &cuts[grid.block_of(i) as usize];
                let representative = representative.as_ref().expect("a block with a pixel has one");
                let admits = guard.is_none_or(|guard| guard.admits(representative, &seen(pixel)));
                if guard.is_some() {
                    admitted[usize::from(admits)] += 1;
                }
                let own = if admits { vec![] } else { sampler.select(pixel, &mut selection).to_vec() };
                let nodes = if admits { shared } else { &own };
                cut_row(&sampler, nodes, pixel, (part, interleave, per_node), Random::new(11, i, frame), row);
            }
        }
        let ties = ties(&ours, &theirs, true).unwrap_or_else(|e| panic!("{method:?}: {e}"));
        eprintln!("{method:?}: {ties} of {} entries differ", ours.len());
        // A cut that differs is one for a whole block, so there may be few of those.
        assert!(ties <= allowed(ours.len()) + row * (block * block).min(64) as usize, "{method:?}: {ties}");
        let rows = ours.chunks(row).zip(theirs.chunks(row)).zip(0..);
        let other =
            rows.filter(|((ours, theirs), _)| ours.iter().zip(*theirs).any(|(a, b)| a.light != b.light));
        let blocks: BTreeSet<u32> = other.map(|(_, pixel)| grid.block_of(pixel)).collect();
        assert!(blocks.len() <= 2 + grid.blocks() as usize / 100, "{method:?}: {blocks:?}");
        assert!(ours.iter().filter(|entry| **entry != WeightedLight::NONE).count() > ours.len() / 3);
    }
    eprintln!("guards sent away {} of {} pixels", admitted[0], admitted[0] + admitted[1]);
    assert!(admitted[0] > 300 && admitted[1] > 300, "{admitted:?}");
}

/// The negative controls of cuts: another kernel, guard or number of nodes draws other lights.
#[test]
fn a_cut_that_differs_is_found() {
    let gpu = gpu_or_skip!();
    let (width, height) = (40, 25);
    let (lights, pixels) = (lights(2000, 5), receivers(width * height, 7));
    let device = device_tree(gpu, &lights);
    let buffer = gpu.upload("receivers", &pixels).unwrap();
    let draw = |kernels: &DrawKernels, method: Method, eye: [f32; 3]| {
        let drawn = gpu.upload("drawn", &vec![WeightedLight::NONE; 8 * pixels.len()]).unwrap();
        let draws = Draws::new(gpu, kernels, &device, method, &buffer, 48, &drawn).unwrap();
        draws.set_request(gpu.queue(), &DrawRequest { eye, ..DrawRequest::default() }).unwrap();
        gpu.run("draw", |encoder| draws.encode(encoder)).unwrap();
        gpu.read::<WeightedLight>(&drawn, 8 * pixels.len()).unwrap()
    };
    let wrong = DEFAULT_RECEIVER.replace("return scattered;", "return scattered * (1.0 + 0.01 * box.low.x);");
    let wrong = DrawKernels::with(gpu, ChildChoice::MinMaxAverage, &wrong).unwrap();
    let cut = CutOptions::default();
    let near = CutOptions { distance_floor: 0.5, ..cut };
    let shared = |cut, block, guard| Method::SharedCut { cut, width, height, block, interleave: 1, guard };
    let differ = |a: &[WeightedLight], b: &[WeightedLight]| ties(a, b, true).unwrap() > allowed(a.len()) + 64;
    for (right, others) in [
        (Method::Cut(cut), vec![Method::Cut(near)]),
        (shared(cut, 8, None), vec![shared(near, 8, None), shared(cut, 4, None)]),
    ] {
        let rows = draw(&DRAWS, right, [0.0; 3]);
        assert!(!differ(&rows, &draw(&DRAWS, right, [0.0; 3])));
        assert!(differ(&rows, &draw(&wrong, right, [0.0; 3])), "{right:?}: a kernel that weighs wrong");
        for other in others {
            assert!(differ(&rows, &draw(&DRAWS, other, [0.0; 3])), "{other:?}");
        }
    }
    let guarded = |guard, eye| draw(&GUARDED, shared(cut, 8, Some(guard)), eye);
    let rows = guarded(Guard::default(), [0.0; 3]);
    assert!(differ(&rows, &draw(&DRAWS, shared(cut, 8, None), [0.0; 3])), "without a guard");
    assert!(differ(&rows, &guarded(Guard { max_distance: 0.3, ..Guard::default() }, [0.0; 3])));
    assert!(differ(&rows, &guarded(Guard::default(), [60.0, 0.0, 0.0])), "a camera elsewhere");
}

#[test]
fn the_batch_samplers_conform() {
    let gpu = gpu_or_skip!();
    let lights = lights(60, 6);
    let device = device_tree(gpu, &lights);
    let receivers: Vec<_> = receivers(64, 8).into_iter().filter(|r| r.position[2] < 1.0).collect();
    let given = |receiver: &ReceiverRecord, light: LightId| contribution(receiver, &lights[light.0 as usize]);
    for (cut, width) in [(None, 64), (Some(CutOptions { per_node: 8, ..CutOptions::default() }), 64)] {
        let mut batch = BatchDraws::new(gpu, &device, &DRAWS, cut);
        let request = SampleRequest { lights_per_receiver: width, seed: 5, ..SampleRequest::default() };
        conformance::check_batch(&mut batch, &receivers, &request, 60, 60, given, 0.05)
            .unwrap_or_else(|error| panic!("{cut:?}: {error}"));
    }
    // The negative control: contributions that the sampler was not made for.
    let mut batch = BatchDraws::new(gpu, &device, &DRAWS, None);
    let request = SampleRequest { lights_per_receiver: 64, seed: 5, ..SampleRequest::default() };
    let without = |receiver: &ReceiverRecord, light: LightId| {
        if light.0 == 7 { 0.0 } else { given(receiver, light) * 1.1 }
    };
    assert!(conformance::check_batch(&mut batch, &receivers, &request, 1, 60, without, 0.01).is_err());
}

/// Guards are `stochastic`'s, and so is where they begin.
#[test]
fn guards_begin_where_those_of_the_cpu_do() {
    let Guard { min_normal_cos, max_plane_distance, max_distance } = Guard::default();
    let same = stochastic::Guard { min_normal_cos, max_plane_distance, max_distance };
    assert_eq!(same, stochastic::Guard::default());
}

/// The negative control of parity: a kernel that is a little wrong, and receivers that are, are found.
#[test]
fn a_kernel_that_differs_is_found() {
    let gpu = gpu_or_skip!();
    let (lights, receivers) = (lights(1000, 1), receivers(1000, 1));
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let device = device_tree(gpu, &lights);
    let request = SampleRequest { lights_per_receiver: 5, ..SampleRequest::default() };
    let mut theirs = vec![WeightedLight::NONE; 5 * receivers.len()];
    PerReceiver::new(TreeSampler::new(&tree)).sample_batch(&receivers, &request, &mut theirs).unwrap();
    let differs = |kernels: &DrawKernels, receivers: &[ReceiverRecord]| {
        let mut ours = vec![WeightedLight::NONE; theirs.len()];
        BatchDraws::new(gpu, &device, kernels, None).sample_batch(receivers, &request, &mut ours).unwrap();
        ties(&ours, &theirs, false).map_or(true, |ties| ties > allowed(theirs.len()))
    };
    assert!(!differs(&DRAWS, &receivers));
    let wrong = DEFAULT_RECEIVER.replace("return scattered;", "return scattered * (1.0 + 0.01 * box.low.x);");
    assert_ne!(wrong, DEFAULT_RECEIVER);
    let wrong = DrawKernels::with(gpu, ChildChoice::MinMaxAverage, &wrong).unwrap();
    assert!(differs(&wrong, &receivers), "a kernel that weighs one per cent wrong");
    let other = DrawKernels::with(gpu, ChildChoice::Center, DEFAULT_RECEIVER).unwrap();
    assert!(differs(&other, &receivers), "another choice");
    let mut moved = receivers.clone();
    moved.iter_mut().for_each(|receiver| receiver.position[0] += 0.01);
    assert!(differs(&DRAWS, &moved), "receivers elsewhere");
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let gpu = gpu_or_skip!();
    let device = device_tree(gpu, &lights(10, 1));
    let receivers = gpu.upload("receivers", &receivers(100, 1)).unwrap();
    let drawn = gpu.buffer("drawn", 100 * 8 * 8, wgpu::BufferUsages::empty()).unwrap();
    let new = |method| Draws::new(gpu, &DRAWS, &device, method, &receivers, 48, &drawn).map(drop);
    let cut = CutOptions::default();
    let shared = |width, height, block, interleave| Method::SharedCut {
        cut,
        width,
        height,
        block,
        interleave,
        guard: None,
    };
    assert_eq!(new(Method::Tree { lights: 8 }), Ok(()));
    for method in [
        Method::Tree { lights: 0 },
        Method::Tree { lights: 65536 },
        Method::Cut(CutOptions { nodes: 33, ..cut }),
        Method::Cut(CutOptions { nodes: 0, ..cut }),
        Method::Cut(CutOptions { per_node: 5000, ..cut }),
        shared(10, 10, 65, 1),
        shared(10, 10, 8, 3),
        shared(0, 10, 8, 1),
    ] {
        assert!(matches!(new(method), Err(GpuError::Range { .. })), "{method:?}");
    }
    assert_eq!(new(shared(10, 10, 8, 2)), Ok(()));
    assert_eq!(new(shared(10, 11, 8, 1)), Err(GpuError::TooMany { what: "pixels", count: 110, most: 100 }));
    let guard = Some(Guard::default());
    let guarded = Method::SharedCut { cut, width: 10, height: 10, block: 8, interleave: 1, guard };
    assert!(matches!(new(guarded), Err(GpuError::Refused { .. })), "these kernels have no guard");
    let broken = DrawKernels::with(gpu, ChildChoice::Center, "fn receiver_position() {}");
    assert!(matches!(broken, Err(GpuError::Refused { .. })), "{broken:?}");
}

/// Scenes and receivers of `lighttree`'s strategies, which aim at trouble, many in one submission.
#[test]
fn a_thousand_random_scenes_draw_the_same_lights() {
    const SCENES: usize = 40;
    const RECEIVERS: usize = 8;
    const LIGHTS: u32 = 4;
    const ROWS: usize = RECEIVERS * LIGHTS as usize;
    let gpu = gpu_or_skip!();
    let mut runner =
        TestRunner::new_with_rng(Config::default(), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let place = (strategies::receiver(), 0..200usize, strategies::position());
    let scene =
        (strategies::lights(1..200), proptest::collection::vec(place, RECEIVERS), strategies::scales());
    let usage = wgpu::BufferUsages::empty();
    let results = gpu.buffer("results", (8 * ROWS * SCENES) as u64, usage).unwrap();
    let frames: Vec<_> = (0..SCENES)
        .map(|_| {
            let lights = gpu.buffer("lights", 200 * 32, usage).unwrap();
            let receivers = gpu.buffer("receivers", 48 * RECEIVERS as u64, usage).unwrap();
            let drawn = gpu.buffer("drawn", 8 * ROWS as u64, usage).unwrap();
            let tree = DeviceTree::new(gpu, &TREES, &lights, Sort::Radix).unwrap();
            let method = Method::Tree { lights: LIGHTS };
            let draws = Draws::new(gpu, &DRAWS, &tree, method, &receivers, 48, &drawn).unwrap();
            (lights, receivers, drawn, tree, draws)
        })
        .collect();
    let (mut differ, mut entries) = (0, 0);
    for part in 0..1000 / SCENES as u32 {
        let scenes: Vec<_> = (0..SCENES)
            .map(|_| {
                let (lights, receivers, placement) = scene.new_tree(&mut runner).expect("a scene").current();
                let lights: Vec<_> = lights.iter().map(|light| placement.bounds(light)).collect();
                // Near one of the lights, in units of the distance to another.
                let at = |(receiver, i, offset): (AnyReceiver, usize, Vec3)| {
                    let (a, b) = (lights[i % lights.len()].center(), lights[(i + 1) % lights.len()].center());
                    let away = (a.distance(b) * 0.2).max(a.abs().max_element() * 1e-3);
                    ReceiverRecord::new(&receiver.at(a + offset.normalize_or_zero() * away))
                };
                let receivers: Vec<_> =
                    receivers.into_iter().map(|r| at(r).unwrap_or(ReceiverRecord::NONE)).collect();
                (lights, receivers)
            })
            .collect();
        for ((lights, receivers), frame) in scenes.iter().zip(&frames) {
            let records: Vec<_> = lights.iter().map(LightRecord::new).collect();
            gpu.write(&frame.0, &records).unwrap();
            gpu.write(&frame.1, receivers).unwrap();
            frame.3.set_lights(gpu.queue(), lights.len() as u32).unwrap();
            let request = DrawRequest { seed: 4, index: part, ..DrawRequest::default() };
            frame.4.set_request(gpu.queue(), &request).unwrap();
        }
        gpu.run("frames", |encoder| {
            for (frame, i) in frames.iter().zip(0..) {
                frame.3.encode_build(encoder);
                frame.4.encode(encoder);
                encoder.copy_buffer_to_buffer(&frame.2, 0, &results, i * 8 * ROWS as u64, 8 * ROWS as u64);
            }
        })
        .unwrap();
        let ours: Vec<WeightedLight> = gpu.read(&results, ROWS * SCENES).unwrap();
        for ((lights, receivers), ours) in scenes.iter().zip(ours.chunks(ROWS)) {
            let tree = PerfectTree::build(lights, MortonBits::Thirty).unwrap();
            let request = SampleRequest {
                lights_per_receiver: LIGHTS,
                seed: 4,
                index: part,
                ..SampleRequest::default()
            };
            let mut theirs = vec![WeightedLight::NONE; ROWS];
            PerReceiver::new(TreeSampler::new(&tree)).sample_batch(receivers, &request, &mut theirs).unwrap();
            for ((receiver, ours), theirs) in
                receivers.iter().zip(ours.chunks(LIGHTS as usize)).zip(theirs.chunks(LIGHTS as usize))
            {
                if *receiver == ReceiverRecord::NONE {
                    assert!(ours.iter().all(|entry| *entry == WeightedLight::NONE));
                    continue;
                }
                entries += ours.len();
                for (a, b) in ours.iter().zip(theirs) {
                    let same = a.light == b.light && (a.weight - b.weight).abs() <= 2e-4 * b.weight;
                    differ += usize::from(!same);
                    // What the device never draws nobody gets.
                    assert!(a.light == LightId::NONE || a.weight > 0.0, "{a:?} for {receiver:?}, {lights:?}");
                }
            }
        }
    }
    eprintln!("{differ} of {entries} entries differ");
    assert!(entries > 10_000, "{entries}");
    assert!(differ <= entries / 50, "{differ} of {entries} differ");
}
