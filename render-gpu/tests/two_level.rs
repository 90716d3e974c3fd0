//! Trees of two levels on the device: against walks of `lighttree` over the same levels as one tree, and
//! against `stochastic`'s.

mod common;
#[path = "common/scene.rs"]
mod scene;

use core::ops::Range;
use std::sync::LazyLock;

use bytemuck::bytes_of;
use glam::{Affine3A, EulerRot, Mat3A, Quat, Vec3};
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BatchLightSampler, BuildParams, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, LightSample,
    LightSampler, MortonBits, NodeId, PerReceiver, PerfectNode, PerfectTree, SampleRequest, TreeSampler,
    WeightedLight,
};
use render_gpu::draw::{CutOptions, DrawKernels, DrawOptions, DrawRequest, Draws, Method};
use render_gpu::records::{LightRecord, TreeHeader};
use render_gpu::tree::Sort;
use render_gpu::two_level::{Keeps, LightInstance, LightMesh, TwoLevelKernels, TwoLevelTree};
use render_gpu::{Gpu, GpuError, ReceiverRecord};
use scene::{allowed, contribution, device_tree, receivers, ties};

static KERNELS: LazyLock<TwoLevelKernels> =
    LazyLock::new(|| TwoLevelKernels::new(common::gpu().expect("asked for with one")).unwrap());

static DRAWS: LazyLock<DrawKernels> = LazyLock::new(|| {
    let options = DrawOptions { two_level: true, ..DrawOptions::default() };
    DrawKernels::with_options(common::gpu().expect("asked for with one"), &options).unwrap()
});

/// Lamps of one, of a few and of many lights, of which some do not shine; and one of which none does.
fn meshes() -> Vec<Vec<LightBounds>> {
    let mut random = Random::new(8, 0, 0);
    let mut light = |i: u32| {
        let at = Vec3::new(random.f32() - 0.5, 2.0 * random.f32() - 1.0, random.f32() - 0.5);
        let size = if i.is_multiple_of(2) { 0.0 } else { 0.1 * random.f32() };
        let intensity = if i % 7 == 3 { 0.0 } else { 0.1 + random.f32() };
        LightBounds::omnidirectional(at, at + Vec3::splat(size), intensity)
    };
    [1, 6, 300, 0]
        .map(|count| {
            if count == 0 {
                vec![LightBounds::point(Vec3::ONE, 0.0)]
            } else {
                (0..count).map(&mut light).collect()
            }
        })
        .into()
}

/// Instances of them, turned, mirrored and scaled, in part unequally.
fn instances(count: u32, seed: u32) -> Vec<LightInstance> {
    let mut random = Random::new(seed, 1, 0);
    let mut instance = |i: u32| {
        let mut angle = || random.f32() * 6.0;
        let turn = Mat3A::from_quat(Quat::from_euler(EulerRot::XYZ, angle(), angle(), angle()));
        let scale = match i % 4 {
            0 => Vec3::splat(0.3 + random.f32()),
            1 => Vec3::new(-1.0, 1.0, 1.0),
            2 => Vec3::new(0.5, 1.5, 1.0),
            _ => Vec3::ONE,
        };
        let at = Vec3::new(random.f32() * 20.0, random.f32() * 20.0, 3.0 + random.f32());
        let to_world = Affine3A::from_mat3_translation((turn * Mat3A::from_diagonal(scale)).into(), at);
        LightInstance { mesh: if i % 13 == 5 { 3 } else { i % 3 }, to_world }
    };
    (0..count).map(&mut instance).collect()
}

/// The box around a transformed box, as `shaders/lib/in_world.wgsl` has it.
fn in_world(to_world: &Affine3A, low: Vec3, high: Vec3) -> (Vec3, Vec3) {
    const PLACING_ERROR: f32 = 4.768_371_6e-7;
    let (center, half) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
    let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
    for axis in 0..3 {
        let row: Vec3 = to_world.matrix3.row(axis).into();
        let offset = to_world.translation[axis];
        let weights = row.abs();
        let middle = row.x * center.x + row.y * center.y + row.z * center.z + offset;
        let magnitude = weights.dot(center.abs()) + offset.abs();
        let reach = weights.x * half.x + weights.y * half.y + weights.z * half.z;
        let away = reach + PLACING_ERROR * (magnitude + reach);
        (min[axis], max[axis]) = (middle - away, middle + away);
    }
    (min, max)
}

/// Both levels as one tree in world space. A node of the mesh below instance `i` is `(i + 1) << 16 | its id`,
/// and its slots begin at the instance's slot << 16.
struct Twin {
    top: PerfectTree,
    meshes: Vec<PerfectTree>,
    instances: Vec<LightInstance>,
    first_light: Vec<u32>,
}

impl Twin {
    fn new(meshes: &[Vec<LightBounds>], instances: &[LightInstance], keeps: Keeps) -> Self {
        let trees: Vec<_> =
            meshes.iter().map(|mesh| PerfectTree::build(mesh, MortonBits::Thirty).unwrap()).collect();
        let of = |instance: &LightInstance| {
            let Some(root) = trees[instance.mesh as usize].root() else {
                return LightBounds::point(Vec3::ZERO, 0.0);
            };
            let bounds = trees[instance.mesh as usize].bounds(root);
            let (min, max) = in_world(&instance.to_world, bounds.min, bounds.max);
            LightBounds::omnidirectional(min, max, bounds.intensity * strength(instance, keeps))
        };
        let top: Vec<_> = instances.iter().map(of).collect();
        let first_light = instances.iter().scan(0, |next, instance| {
            Some(std::mem::replace(next, *next + meshes[instance.mesh as usize].len() as u32))
        });
        Self {
            first_light: first_light.collect(),
            top: PerfectTree::build(&top, MortonBits::Thirty).unwrap(),
            meshes: trees,
            instances: instances.to_vec(),
        }
    }

    fn mesh(&self, instance: u32) -> &PerfectTree {
        &self.meshes[self.instances[instance as usize].mesh as usize]
    }

    /// The instance that a node is of, and its id in the mesh.
    fn place(&self, node: NodeId) -> Option<(u32, NodeId)> {
        if node.0 >= 1 << 16 {
            return Some(((node.0 >> 16) - 1, NodeId(node.0 & 0xffff)));
        }
        let is_instance = self.top.children(node).is_empty();
        is_instance.then(|| (self.top.light_at(self.top.items(node).start).0, NodeId(1)))
    }
}

fn strength(instance: &LightInstance, keeps: Keeps) -> f32 {
    if keeps == Keeps::Intensity {
        return 1.0;
    }
    let m = instance.to_world.matrix3;
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.as_dvec3());
    let squares = [y.cross(z), z.cross(x), x.cross(y)].map(|normal| normal.length_squared());
    (squares.iter().sum::<f64>() / 3.0).sqrt() as f32
}

impl Hierarchy for Twin {
    fn root(&self) -> Option<NodeId> {
        self.top.root()
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        let Some((instance, id)) = self.place(node) else { return self.top.children(node) };
        let Range { start, end } = self.mesh(instance).children(id);
        let first = (instance + 1) << 16;
        if start == end { 0..0 } else { first + start..first + end }
    }
}

impl ItemRanges for Twin {
    fn items(&self, node: NodeId) -> Range<u32> {
        let Some((instance, id)) = self.place(node) else {
            let Range { start, end } = self.top.items(node);
            return start << 16..end << 16;
        };
        let first = self.top.slot_of(LightId(instance)).unwrap() << 16;
        let Range { start, end } = self.mesh(instance).items(id);
        first + start..first + end
    }
}

impl LightHierarchy for Twin {
    fn bounds(&self, node: NodeId) -> LightBounds {
        match self.place(node) {
            Some((instance, id)) if node.0 >= 1 << 16 => {
                let bounds = self.mesh(instance).bounds(id);
                let to_world = &self.instances[instance as usize].to_world;
                let (min, max) = in_world(to_world, bounds.min, bounds.max);
                LightBounds { min, max, ..bounds }
            }
            _ => self.top.bounds(node),
        }
    }
    fn light_at(&self, slot: u32) -> LightId {
        let LightId(instance) = self.top.light_at(slot >> 16);
        let LightId(light) = self.mesh(instance).light_at(slot & 0xffff);
        LightId(self.first_light[instance as usize] + light)
    }
    fn slot_of(&self, _: LightId) -> Option<u32> {
        unreachable!("walks do not ask")
    }
    fn node_count(&self) -> usize {
        unreachable!("walks do not ask")
    }
}

fn device(gpu: &Gpu, meshes: &[Vec<LightBounds>], keeps: Keeps, most: u32) -> TwoLevelTree {
    let buffers: Vec<_> = meshes
        .iter()
        .map(|mesh| {
            let records: Vec<_> = mesh.iter().map(LightRecord::new).collect();
            gpu.upload("lights of a mesh", &records).unwrap()
        })
        .collect();
    let meshes: Vec<_> = buffers.iter().map(|lights| LightMesh { lights, keeps }).collect();
    TwoLevelTree::new(gpu, &KERNELS, &meshes, most, Sort::default()).unwrap()
}

/// A frame: instances placed, the tree over them, and draws.
fn draw(gpu: &Gpu, tree: &TwoLevelTree, method: Method, pixels: &[ReceiverRecord]) -> Vec<WeightedLight> {
    let buffer = gpu.upload("receivers", pixels).unwrap();
    let row = method.lights() as usize;
    let drawn = gpu.upload("drawn", &vec![WeightedLight::NONE; row * pixels.len()]).unwrap();
    let draws = Draws::new(gpu, &DRAWS, tree, method, &buffer, 48, &drawn).unwrap();
    draws.set_request(gpu.queue(), &DrawRequest { seed: 3, index: 7, ..DrawRequest::default() }).unwrap();
    gpu.run("frame", |encoder| {
        tree.encode_build(encoder);
        draws.encode(encoder);
    })
    .unwrap();
    gpu.read(&drawn, row * pixels.len()).unwrap()
}

const LIGHTS: u32 = 5;

/// What the CPU draws by walks over both levels.
fn walks(twin: &Twin, pixels: &[ReceiverRecord]) -> Vec<WeightedLight> {
    let request = SampleRequest { lights_per_receiver: LIGHTS, seed: 3, index: 7, first_stream: 0 };
    let mut rows = vec![WeightedLight::NONE; LIGHTS as usize * pixels.len()];
    PerReceiver::new(TreeSampler::new(twin)).sample_batch(pixels, &request, &mut rows).unwrap();
    rows
}

#[test]
fn walks_down_both_levels_draw_the_lights_that_the_cpu_draws() {
    let gpu = gpu_or_skip!();
    let (meshes, pixels) = (meshes(), receivers(2000, 5));
    for keeps in [Keeps::Radiance, Keeps::Intensity] {
        let tree = device(gpu, &meshes, keeps, 60);
        // Frames in which instances move and are more or fewer; the meshes' trees stay.
        for (count, seed) in [(60, 1), (60, 2), (17, 3), (1, 4)] {
            let instances = instances(count, seed);
            let twin = Twin::new(&meshes, &instances, keeps);
            assert_eq!(tree.set_instances(gpu.queue(), &instances).unwrap(), twin.first_light);
            let ours = draw(gpu, &tree, Method::Tree { lights: LIGHTS }, &pixels);
            let header: TreeHeader = gpu.read(tree.top().header(), 1).unwrap()[0];
            assert_eq!((header.len as usize, header.invalid), (twin.top.len(), 0));
            let ties = ties(&ours, &walks(&twin, &pixels), true).unwrap();
            eprintln!("{count} instances, {keeps:?}: {ties} of {} entries differ", ours.len());
            assert!(ties <= 2 * allowed(ours.len()), "{count} instances, {keeps:?}: {ties}");
        }
    }
}

/// The negative control: an instance that is not where it should be, or another strength.
#[test]
fn an_instance_elsewhere_is_found() {
    let gpu = gpu_or_skip!();
    let (meshes, pixels, right) = (meshes(), receivers(2000, 5), instances(60, 1));
    let twin = Twin::new(&meshes, &right, Keeps::Radiance);
    let differs = |instances: &[LightInstance], keeps| {
        let tree = device(gpu, &meshes, keeps, 60);
        tree.set_instances(gpu.queue(), instances).unwrap();
        let ours = draw(gpu, &tree, Method::Tree { lights: LIGHTS }, &pixels);
        ties(&ours, &walks(&twin, &pixels), true).unwrap() > 2 * allowed(ours.len())
    };
    assert!(!differs(&right, Keeps::Radiance));
    assert!(differs(&right, Keeps::Intensity));
    let mut moved = right.clone();
    moved[7].to_world.translation.x += 0.3;
    assert!(differs(&moved, Keeps::Radiance));
    let mut turned = right.clone();
    turned[11].to_world.matrix3 *= Mat3A::from_rotation_x(0.2);
    assert!(differs(&turned, Keeps::Radiance));
}

/// Meshes' trees are the CPU's, to the bit, and stay what they are.
#[test]
fn trees_of_meshes_have_the_same_bits() {
    let gpu = gpu_or_skip!();
    let meshes = meshes();
    let tree = device(gpu, &meshes, Keeps::Radiance, 10);
    let all: Vec<PerfectNode> = gpu.read(tree.mesh_nodes(), tree.mesh_nodes().size() as usize / 32).unwrap();
    let mut first = 0;
    for (i, mesh) in meshes.iter().enumerate() {
        let cpu = PerfectTree::build(mesh, MortonBits::Thirty).unwrap();
        let found = all[first..]
            .windows(cpu.nodes().len().max(1))
            .position(|window| window.iter().zip(cpu.nodes()).all(|(a, b)| bytes_of(a) == bytes_of(b)));
        first += found.unwrap_or_else(|| panic!("the tree of mesh {i} is not there"));
    }
}

/// World-space lights of all instances, in the order of their ids.
fn in_the_world(meshes: &[Vec<LightBounds>], instances: &[LightInstance]) -> Vec<LightBounds> {
    let of = |instance: &LightInstance| {
        let (to_world, factor) = (instance.to_world, strength(instance, Keeps::Radiance));
        let place = move |light: &LightBounds| {
            LightBounds::point(to_world.transform_point3(light.min), light.intensity * factor)
        };
        meshes[instance.mesh as usize].iter().map(place).collect::<Vec<_>>()
    };
    instances.iter().flat_map(of).collect()
}

/// Every method's mean is the sum over all lights, and walks are about as good as `stochastic`'s, which take
/// receivers to mesh space.
#[test]
fn all_methods_see_all_lights_as_those_of_stochastic_do() {
    let gpu = gpu_or_skip!();
    // Lights are points here, whose contributions are known.
    let mut meshes = meshes();
    meshes.iter_mut().flatten().for_each(|light| light.max = light.min);
    let instances: Vec<_> = instances(60, 6).into_iter().filter(|i| i.mesh < 3).collect();
    let tree = device(gpu, &meshes, Keeps::Radiance, 60);
    tree.set_instances(gpu.queue(), &instances).unwrap();
    let world = in_the_world(&meshes, &instances);
    let pixels: Vec<_> = receivers(400, 8).into_iter().filter(|r| r.position[2] < 1.0).collect();
    let truth: Vec<f64> =
        pixels.iter().map(|pixel| world.iter().map(|light| contribution(pixel, light)).sum()).collect();
    // Mean of estimate ÷ truth, and mean squared error of that.
    let score = |rows: &[WeightedLight]| {
        let width = rows.len() / pixels.len();
        let (mut mean, mut squared, mut count) = (0.0, 0.0, 0.0);
        for ((row, pixel), truth) in rows.chunks(width).zip(&pixels).zip(&truth) {
            let drawn = row.iter().filter(|entry| entry.light != LightId::NONE);
            let sum: f64 =
                drawn.map(|e| f64::from(e.weight) * contribution(pixel, &world[e.light.0 as usize])).sum();
            if *truth > 0.0 {
                (mean, squared, count) =
                    (mean + sum / truth, squared + (sum / truth - 1.0).powi(2), count + 1.0);
            }
        }
        (mean / count, squared / count)
    };
    let cut = CutOptions { nodes: 8, per_node: 8, distance_floor: 0.02 };
    let shared = Method::SharedCut {
        cut,
        width: pixels.len() as u32,
        height: 1,
        block: 8,
        interleave: 1,
        guard: None,
    };
    let mut errors = vec![];
    for method in [Method::Tree { lights: 64 }, Method::Cut(cut), shared] {
        let (mean, error) = score(&draw(gpu, &tree, method, &pixels));
        eprintln!("{method:?}: mean {mean:.4}, squared error {error:.4}");
        assert!((mean - 1.0).abs() < 0.02, "{method:?}: {mean}");
        errors.push(error);
    }

    let light_meshes = meshes.iter().map(|mesh| {
        let tree = PerfectTree::build(mesh, MortonBits::Thirty).unwrap();
        stochastic::LightMesh::new(tree, mesh.len() as u32)
    });
    let placed: Vec<_> =
        instances.iter().map(|i| stochastic::LightInstance { mesh: i.mesh, to_world: i.to_world }).collect();
    let cpu =
        stochastic::TwoLevelTree::build(light_meshes.collect(), &placed, &BuildParams::morton()).unwrap();
    let sampler = stochastic::TwoLevelSampler::new(&cpu);
    let mut rows = vec![WeightedLight::NONE; 64 * pixels.len()];
    for ((pixel, row), i) in pixels.iter().zip(rows.chunks_mut(64)).zip(0..) {
        for (entry, j) in row.iter_mut().zip(0..) {
            let sample = sampler.sample(pixel, &mut Decisions::new(Random::new(9, i, j)));
            if let Some(LightSample { light, pmf }) = sample {
                *entry = WeightedLight { light, weight: (1.0 / (64.0 * pmf)) as f32 };
            }
        }
    }
    let (mean, error) = score(&rows);
    eprintln!("stochastic: mean {mean:.4}, squared error {error:.4}");
    assert!((mean - 1.0).abs() < 0.02, "{mean}");
    assert!(errors[0] < 1.5 * error, "{} on the device, {error} on the cpu", errors[0]);
}

#[test]
fn memory_and_what_cannot_be() {
    let gpu = gpu_or_skip!();
    let meshes = meshes();
    let [few, many] = [100, 10_100].map(|most| device(gpu, &meshes, Keeps::Radiance, most));
    // Less a part of the sort's that does not grow, and more by its rounding.
    let each = (many.bytes() - few.bytes()) as f64 / 10_000.0;
    assert!(each <= 161.0, "{each} bytes an instance");

    let all = instances(101, 1);
    let error = few.set_instances(gpu.queue(), &all).unwrap_err();
    assert_eq!(error, GpuError::TooMany { what: "instances", count: 101, most: 100 });
    let odd = [LightInstance { mesh: 9, to_world: Affine3A::IDENTITY }];
    let error = few.set_instances(gpu.queue(), &odd).unwrap_err();
    assert!(matches!(error, GpuError::Range { count: 9, most: 3, .. }), "{error}");

    // What is not finite is left out, and counted.
    let mut instances = instances(20, 1);
    instances[4].to_world.translation.y = f32::NAN;
    instances[6].to_world.matrix3.x_axis.x = f32::INFINITY;
    few.set_instances(gpu.queue(), &instances).unwrap();
    gpu.run("build", |encoder| few.encode_build(encoder)).unwrap();
    let header: TreeHeader = gpu.read(few.top().header(), 1).unwrap()[0];
    assert_eq!((header.invalid, header.len + header.dropped), (2, 18));

    // Kernels are for one kind of tree.
    let flat = device_tree(gpu, &meshes[2]);
    let buffer = gpu.buffer("receivers", 4800, wgpu::BufferUsages::empty()).unwrap();
    let error = Draws::new(gpu, &DRAWS, &flat, Method::Tree { lights: 1 }, &buffer, 48, &buffer).unwrap_err();
    assert!(matches!(error, GpuError::Refused { .. }), "{error}");
}
