//! A renderer with a device, kernels and materials of its own adds many lights: one tree and one set of
//! draws, recorded into its own encoder.
//!
//! Each frame is one submission: the renderer moves its lights, the tree is built over them, the renderer's
//! own pass fills its own records of what pixels see, lights are drawn for them, and the renderer shades.
//! Nothing is read back but what this example prints.

use lighttree::{ChildChoice, WeightedLight};
use render_gpu::draw::{CutOptions, DrawKernels, DrawRequest, Draws, Method};
use render_gpu::tree::{DeviceTree, Sort, TreeKernels};
use render_gpu::{Gpu, GpuError, StageTimes, required_limits};
use wgpu::{BufferUsages, Features};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;
const LIGHTS: u32 = 10_000;
const DRAWN: u32 = 8;

/// The renderer's pixels, which it also reads itself: 32 bytes, a material's number among them.
const PIXEL: &str = "
struct Receiver {
    position: vec3f,
    material: u32,
    // Octahedral, two signed 16-bit numbers.
    normal: u32,
    pad: vec3u,
}

fn host_normal(receiver: Receiver) -> vec3f {
    let p = unpack2x16snorm(receiver.normal);
    let z = 1.0 - abs(p.x) - abs(p.y);
    let folded = (1.0 - abs(p.yx)) * select(vec2f(-1.0), vec2f(1.0), p >= vec2f(0.0));
    return normalize(vec3f(select(folded, p, z >= 0.0), z));
}

// Two materials: grey floor, and leaves that light falls through.
fn host_albedo(material: u32) -> vec3f {
    return select(vec3f(0.6), vec3f(0.2, 0.7, 0.3), material == 1u);
}

fn receiver_position(receiver: Receiver) -> vec3f {
    return receiver.position;
}

fn receiver_scatter(receiver: Receiver, box: Toward) -> f32 {
    if (receiver.material == 1u) {
        return max(toward_cos(box, host_normal(receiver)), toward_cos(box, -host_normal(receiver)));
    }
    return toward_cos(box, host_normal(receiver));
}
";

/// The renderer's own kernels. `Toward` and `toward_cos` are named by its receivers, which it shares with the
/// draws, so it names stand-ins.
const HOST: &str = "
struct Light { min: vec3f, intensity: f32, max: vec3f, user: u32 }
struct Drawn { light: u32, weight: f32 }
struct Toward { unused: f32 }
fn toward_cos(box: Toward, normal: vec3f) -> f32 { return 1.0; }

@group(0) @binding(0) var<uniform> frame: vec4u;
@group(0) @binding(1) var<storage, read_write> lights: array<Light>;
@group(0) @binding(2) var<storage, read_write> pixels: array<Receiver>;
@group(0) @binding(3) var<storage, read_write> drawn: array<Drawn>;
@group(0) @binding(4) var<storage, read_write> picture: array<vec4f>;

fn random(a: u32, b: u32) -> f32 {
    var x = a * 0x9e3779b9u + b * 0x85ebca6bu;
    x = (x ^ (x >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    return f32((x ^ (x >> 16u)) >> 8u) / 16777216.0;
}

@compute @workgroup_size(64)
fn move_lights(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= arrayLength(&lights)) { return; }
    let sway = 0.2 * sin(f32(frame.x) * 0.3 + 6.28 * random(id.x, 3u));
    let position = vec3f(random(id.x, 0u) * 16.0 + sway, 0.5 + 2.0 * random(id.x, 1u), random(id.x, 2u) * 9.0);
    lights[id.x] = Light(position, 0.02 * random(id.x, 4u), position, 0u);
}

@compute @workgroup_size(64)
fn see(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= frame.y * frame.z) { return; }
    let x = f32(id.x % frame.y) / 6.0;
    let z = f32(id.x / frame.y) / 6.0;
    let is_leaf = (id.x % 16u) < 4u;
    let normal = pack2x16snorm(vec2f(0.0, 1.0));
    pixels[id.x] = Receiver(vec3f(x, select(0.0, 1.0, is_leaf), z), u32(is_leaf), normal, vec3u(0u));
}

fn lit_by(pixel: Receiver, light: Light) -> vec3f {
    let to_light = light.min - pixel.position;
    let squared = max(dot(to_light, to_light), 1e-6);
    let cosine = dot(host_normal(pixel), to_light) / sqrt(squared);
    let lit = select(max(cosine, 0.0), abs(cosine), pixel.material == 1u);
    return host_albedo(pixel.material) / 3.14159265 * lit * light.intensity / squared;
}

@compute @workgroup_size(64)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= frame.y * frame.z) { return; }
    var sum = vec3f(0.0);
    for (var i = 0u; i < frame.w; i++) {
        let entry = drawn[id.x * frame.w + i];
        if (entry.light != 0xffffffffu) {
            sum += lit_by(pixels[id.x], lights[entry.light]) * entry.weight;
        }
    }
    picture[id.x] = vec4f(sum, 1.0);
}

// The truth, to compare with.
@compute @workgroup_size(64)
fn shade_all(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= frame.y * frame.z) { return; }
    var sum = vec3f(0.0);
    for (var i = 0u; i < arrayLength(&lights); i++) {
        sum += lit_by(pixels[id.x], lights[i]);
    }
    picture[id.x] = vec4f(sum, 1.0);
}
";

fn main() -> Result<(), Box<dyn core::error::Error>> {
    // What a renderer has already.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_limits: required_limits(),
        // Only to see how long stages take.
        required_features: adapter.features() & Features::TIMESTAMP_QUERY,
        ..Default::default()
    }))?;
    let (mean, truth) = run(&device, &queue, 16)?;
    println!("mean of 16 frames {mean:.5}, of all {LIGHTS} lights {truth:.5}");
    Ok(())
}

/// Mean value of the pictures of so many frames, and that of the last one with all lights.
pub fn run(device: &wgpu::Device, queue: &wgpu::Queue, frames: u32) -> Result<(f64, f64), GpuError> {
    let storage = |label, size, usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: BufferUsages::STORAGE | usage,
            mapped_at_creation: false,
        })
    };
    let pixels = u64::from(WIDTH * HEIGHT);
    let lights = storage("lights", 32 * u64::from(LIGHTS), BufferUsages::empty());
    let receivers = storage("pixels", 32 * pixels, BufferUsages::empty());
    let drawn_bytes = pixels * u64::from(DRAWN) * size_of::<WeightedLight>() as u64;
    let drawn = storage("drawn", drawn_bytes, BufferUsages::empty());
    let picture = storage("picture", 16 * pixels, BufferUsages::COPY_SRC);
    let frame = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("frame"),
        size: 16,
        usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("host"),
        source: wgpu::ShaderSource::Wgsl(format!("{HOST}{PIXEL}").into()),
    });
    let entries: Vec<_> = (0..5)
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: if binding == 0 {
                    wgpu::BufferBindingType::Uniform
                } else {
                    wgpu::BufferBindingType::Storage { read_only: false }
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("host"),
        entries: &entries,
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("host"),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let pipeline = |entry| {
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    };
    let buffers = [&frame, &lights, &receivers, &drawn, &picture];
    let bound: Vec<_> = buffers
        .iter()
        .zip(0..)
        .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("host"),
        layout: &layout,
        entries: &bound,
    });
    let own = |encoder: &mut wgpu::CommandEncoder, pipeline: &wgpu::ComputePipeline, threads: u32| {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(threads.div_ceil(64), 1, 1);
    };
    let [move_lights, see, shade, shade_all] = ["move_lights", "see", "shade", "shade_all"].map(pipeline);

    // What this crate adds: made once.
    let gpu = Gpu::new(device, queue)?;
    let tree = DeviceTree::new(&gpu, &TreeKernels::new(&gpu)?, &lights, Sort::default())?;
    let kernels = DrawKernels::with(&gpu, ChildChoice::default(), PIXEL)?;
    let cut = CutOptions { nodes: DRAWN, ..CutOptions::default() };
    let method =
        Method::SharedCut { cut, width: WIDTH, height: HEIGHT, block: 8, interleave: 1, guard: None };
    let draws = Draws::new(&gpu, &kernels, &tree, method, &receivers, 32, &drawn)?;

    let value = |picture: &[[f32; 4]]| {
        picture.iter().flat_map(|pixel| &pixel[..3]).map(|&x| f64::from(x)).sum::<f64>()
            / (3.0 * pixels as f64)
    };
    let mut times = StageTimes::new(&gpu, 4)?;
    let mut mean = 0.0;
    for number in 0..frames {
        queue.write_buffer(&frame, 0, bytemuck::bytes_of(&[number, WIDTH, HEIGHT, DRAWN]));
        draws.set_request(queue, &DrawRequest { seed: 1, index: number, ..DrawRequest::default() })?;

        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        times.begin(&mut encoder);
        own(&mut encoder, &move_lights, LIGHTS);
        own(&mut encoder, &see, WIDTH * HEIGHT);
        times.mark(&mut encoder, "the host's own");
        tree.encode_build(&mut encoder);
        times.mark(&mut encoder, "light tree");
        draws.encode(&mut encoder);
        times.mark(&mut encoder, "light samples");
        own(&mut encoder, &shade, WIDTH * HEIGHT);
        times.mark(&mut encoder, "shading");
        times.end(&mut encoder);
        queue.submit([encoder.finish()]);
        mean += value(&gpu.read(&picture, pixels as usize)?) / f64::from(frames);
    }
    for (stage, seconds) in times.seconds(&gpu)? {
        println!("{stage:<16} {:8.3} ms", 1e3 * seconds);
    }
    gpu.run("truth", |encoder| own(encoder, &shade_all, WIDTH * HEIGHT))?;
    Ok((mean, value(&gpu.read(&picture, pixels as usize)?)))
}
