//! Filters on the device against those of `stochastic`, frame after frame.

mod common;

use glam::{Quat, Vec3};
use lighttree::rng::Random;
use render_gpu::GpuError;
use render_gpu::filter::{
    Clip, FilterFrame, FilterInputs, FilterReport, Mixing, Svgf, SvgfKernels, SvgfParams, Taa, TaaKernels,
    TaaParams,
};
use stochastic::filter as cpu;

/// Sizes that fill neither workgroups nor strips.
const WIDTH: u32 = 93;
const HEIGHT: u32 = 61;

/// A noisy film of a sphere before a slanted wall, with texture, an emitter, sky, and motion.
struct Film {
    color: Vec<Vec3>,
    emission: Vec<Vec3>,
    albedo: Vec<Vec3>,
    normal: Vec<Vec3>,
    depth: Vec<f32>,
    motion: Vec<Vec3>,
    mesh: Vec<u32>,
}

impl Film {
    fn frame(index: u32, brightness: f32) -> Self {
        let pixels = (WIDTH * HEIGHT) as usize;
        let mut film = Self {
            color: vec![Vec3::ZERO; pixels],
            emission: vec![Vec3::ZERO; pixels],
            albedo: vec![Vec3::ZERO; pixels],
            normal: vec![Vec3::ZERO; pixels],
            depth: vec![f32::INFINITY; pixels],
            motion: vec![Vec3::ZERO; pixels],
            mesh: vec![0; pixels],
        };
        let center = 40.0 + 1.7 * index as f32;
        for i in 0..pixels {
            let (x, y) = ((i as u32 % WIDTH) as f32, (i as u32 / WIDTH) as f32);
            let mut random = Random::new(3, i as u32, index);
            let (dx, dy) = ((x - center) / 22.0, (y - 30.0) / 22.0);
            let inside = 1.0 - dx * dx - dy * dy;
            if inside > 0.0 {
                let z = inside.sqrt();
                film.normal[i] = Vec3::new(dx, dy, -z);
                film.depth[i] = 6.0 - z;
                film.mesh[i] = 7;
                film.albedo[i] = Vec3::new(0.8, 0.5, 0.2);
                film.motion[i] = Vec3::new(-1.7, 0.0, 0.0);
            } else if y > 8.0 {
                // It turns and moves back in every other frame, column by column and row by row more: up to
                // and beyond what is still the same surface.
                let (turn, back) = if index % 2 == 1 { (0.0075 * x, 0.006 * y) } else { (0.0, 0.0) };
                film.normal[i] = Quat::from_rotation_y(turn) * Vec3::new(0.0, 0.3, -1.0).normalize();
                film.depth[i] = 9.0 + 0.03 * y + 0.01 * x + back;
                film.albedo[i] =
                    Vec3::splat(if (x as u32 / 5 + y as u32 / 5).is_multiple_of(2) { 0.7 } else { 0.005 });
                film.emission[i] = if x > 80.0 { Vec3::splat(5.0) } else { Vec3::ZERO };
            }
            // Rare and bright, as samples of lights are.
            let spike = if random.f32() < 0.1 { 6.0 } else { 0.3 };
            let light = brightness * spike * (0.5 + random.f32());
            film.color[i] = film.albedo[i] * light * Vec3::new(1.0, 0.9, 0.7) + film.emission[i];
            if film.depth[i] == f32::INFINITY {
                film.color[i] = Vec3::new(0.2, 0.3, 0.6);
            }
            match i % 997 {
                5 => film.color[i].y = f32::NAN,
                6 => film.color[i].x = f32::INFINITY,
                7 => film.depth[i] = -1.0,
                8 => film.motion[i].z = f32::NAN,
                9 => film.normal[i].x = f32::NAN,
                _ => {}
            }
        }
        film
    }

    fn cpu(&self) -> cpu::FilterInput<'_> {
        cpu::FilterInput {
            width: WIDTH,
            height: HEIGHT,
            color: &self.color,
            emission: Some(&self.emission),
            albedo: &self.albedo,
            normal: &self.normal,
            depth: &self.depth,
            motion: Some(&self.motion),
            mesh: Some(&self.mesh),
        }
    }

    fn device(&self) -> FilterFrame<'_> {
        FilterFrame {
            color: &self.color,
            emission: Some(&self.emission),
            albedo: &self.albedo,
            normal: &self.normal,
            depth: &self.depth,
            motion: Some(&self.motion),
            mesh: Some(&self.mesh),
        }
    }
}

/// Largest difference of two pictures relative to the first's mean, and how many pixels differ by more than
/// `tolerance` of that.
fn difference(a: &[Vec3], b: &[Vec3], tolerance: f32) -> (f32, usize) {
    let mean = a.iter().map(|c| c.element_sum() / 3.0).sum::<f32>() / a.len() as f32;
    let largest = |a: &Vec3, b: &Vec3| {
        // NaN anywhere is as far as it gets.
        let away = (*a - *b).abs().max_element() / mean;
        if away.is_nan() { f32::INFINITY } else { away }
    };
    let differences: Vec<f32> = a.iter().zip(b).map(|(a, b)| largest(a, b)).collect();
    let beyond = differences.iter().filter(|&&d| d > tolerance).count();
    (differences.into_iter().fold(0.0, f32::max), beyond)
}

fn same(report: FilterReport, reference: cpu::FilterReport) {
    let cpu::FilterReport { non_finite, with_history, without_history, clipped } = reference;
    assert_eq!(
        (report.non_finite, report.with_history, report.without_history),
        (non_finite, with_history, without_history)
    );
    // Whether a history is just beyond the range is up to rounding.
    assert!(report.clipped.abs_diff(clipped) <= 3, "{} and {clipped} clipped", report.clipped);
}

/// The dials that are compared, in both crates' types.
fn dials() -> Vec<(SvgfParams, cpu::SvgfParams)> {
    let paper = (SvgfParams::paper(), cpu::SvgfParams::paper());
    let with = |change: fn(&mut SvgfParams), same: fn(&mut cpu::SvgfParams)| {
        let (mut device, mut cpu) = paper;
        change(&mut device);
        same(&mut cpu);
        (device, cpu)
    };
    vec![
        paper,
        with(
            |p| (p.mixing, p.feedback) = (Mixing::Conserving, false),
            |p| (p.mixing, p.feedback) = (cpu::Mixing::Conserving, false),
        ),
        with(|p| (p.interleaved, p.levels) = (2, 3), |p| (p.interleaved, p.levels) = (2, 3)),
        with(|p| (p.interleaved, p.least_frames) = (3, 2), |p| (p.interleaved, p.least_frames) = (3, 2)),
        with(|p| (p.levels, p.alpha) = (0, 0.0), |p| (p.levels, p.alpha) = (0, 0.0)),
        with(
            |p| (p.sigma_luminance, p.sigma_depth) = (f32::INFINITY, f32::INFINITY),
            |p| (p.sigma_luminance, p.sigma_depth) = (f32::INFINITY, f32::INFINITY),
        ),
    ]
}

/// What one refuses the other refuses, by the same name and range.
#[test]
fn dials_end_where_those_of_the_cpu_do() {
    let gpu = gpu_or_skip!();
    let inputs = FilterInputs::new(gpu, 8, 8).unwrap();
    let kernels = SvgfKernels::new(gpu).unwrap();
    macro_rules! agree {
        ($($dial:ident: $($value:expr),+;)+) => {$($(
            let device = SvgfParams { $dial: $value, ..SvgfParams::default() };
            let cpu = cpu::SvgfParams { $dial: $value, ..cpu::SvgfParams::default() };
            let ours = Svgf::new(gpu, &kernels, &device, &inputs).err().map(|error| error.to_string());
            let theirs = cpu::Svgf::new(cpu).err().map(|error| error.to_string());
            let part = |line: &Option<String>| line.as_ref().map(|line| line.contains(concat!("`", stringify!($dial), "`")));
            assert_eq!(part(&ours), part(&theirs), "{} = {:?}: {ours:?} and {theirs:?}", stringify!($dial), $value);
        )+)+};
    }
    agree! {
        levels: 0, 16, 17;
        sigma_luminance: -1.0, 0.0, f32::INFINITY, f32::NAN;
        sigma_depth: 0.0, 1e-30, f32::INFINITY, f32::NAN;
        depth_floor: 0.0, 1e-30, f32::INFINITY, f32::NAN;
        normal_power: -1.0, 0.0, f32::INFINITY, f32::NAN;
        alpha: -0.1, 0.0, 1.0, 1.1, f32::NAN;
        alpha_moments: -0.1, 0.0, 1.0, 1.1, f32::NAN;
        least_frames: 1, 2;
        interleaved: 0, 1, 64, 65;
        albedo_floor: 0.0, 1e-30, f32::INFINITY, f32::NAN;
    }
    let kernels = TaaKernels::new(gpu).unwrap();
    for (alpha, deviations, white) in [
        (0.0, 1.0, 1.0),
        (1.0, 0.0, f32::INFINITY),
        (1.1, 1.0, 1.0),
        (0.5, -1.0, 1.0),
        (0.5, f32::NAN, 1.0),
        (0.5, 1.0, 0.0),
        (f32::NAN, 1.0, 1.0),
    ] {
        let ours = TaaParams { alpha, clip: Clip::Deviations(deviations), white };
        let theirs = cpu::TaaParams { alpha, clip: cpu::Clip::Deviations(deviations), white };
        assert_eq!(
            Taa::new(gpu, &kernels, &ours, &inputs).is_ok(),
            cpu::Taa::new(theirs).is_ok(),
            "{ours:?}"
        );
    }
}

#[test]
fn svgf_gives_the_pictures_of_the_cpu() {
    let gpu = gpu_or_skip!();
    let kernels = SvgfKernels::new(gpu).unwrap();
    for (params, reference) in dials() {
        let inputs = FilterInputs::new(gpu, WIDTH, HEIGHT).unwrap();
        let mut device = Svgf::new(gpu, &kernels, &params, &inputs).unwrap();
        let mut cpu = cpu::Svgf::new(reference).unwrap();
        let pixels = (WIDTH * HEIGHT) as usize;
        let (mut ours, mut theirs) = (vec![Vec3::ZERO; pixels], vec![Vec3::ZERO; pixels]);
        for index in 0..6 {
            // Brightness jumps, so that scales change from frame to frame.
            let film = Film::frame(index, [1.0, 1.0, 40.0, 40.0, 0.01, 0.01][index as usize]);
            let report = device.filter(gpu, &film.device(), &mut ours).unwrap();
            same(report, cpu.filter(&film.cpu(), &mut theirs).unwrap());
            let (most, beyond) = difference(&theirs, &ours, 1e-3);
            assert!(
                most < 1e-3,
                "{params:?}, frame {index}: {most:e} of the mean, {beyond} pixels beyond 1e-3"
            );
        }
    }
}

/// The negative control: another dial is another picture, a picture of one pixel's difference is found.
#[test]
fn svgf_of_another_dial_is_told_apart() {
    let gpu = gpu_or_skip!();
    let kernels = SvgfKernels::new(gpu).unwrap();
    let inputs = FilterInputs::new(gpu, WIDTH, HEIGHT).unwrap();
    let film = Film::frame(0, 1.0);
    let mut theirs = vec![Vec3::ZERO; film.color.len()];
    cpu::Svgf::new(cpu::SvgfParams::paper()).unwrap().filter(&film.cpu(), &mut theirs).unwrap();
    let changes: [fn(&mut SvgfParams); 5] = [
        |p| p.sigma_luminance *= 1.05,
        |p| p.normal_power *= 1.1,
        |p| p.levels -= 1,
        |p| p.albedo_floor *= 2.0,
        |p| p.depth_floor *= 2.0,
    ];
    for change in changes {
        let mut params = SvgfParams::paper();
        change(&mut params);
        let mut ours = theirs.clone();
        Svgf::new(gpu, &kernels, &params, &inputs).unwrap().filter(gpu, &film.device(), &mut ours).unwrap();
        assert!(difference(&theirs, &ours, 1e-3).0 > 1e-3, "{params:?}");
    }
    let mut one = theirs.clone();
    one[77] *= 1.5;
    assert_eq!(difference(&theirs, &one, 1e-3).1, 1);
}

#[test]
fn taa_gives_the_pictures_of_the_cpu() {
    let gpu = gpu_or_skip!();
    let kernels = TaaKernels::new(gpu).unwrap();
    let dials = [
        (TaaParams::default(), cpu::TaaParams::default()),
        (
            TaaParams { clip: Clip::Extremes, white: 2.0, alpha: 0.2 },
            cpu::TaaParams { clip: cpu::Clip::Extremes, white: 2.0, alpha: 0.2 },
        ),
        (
            TaaParams { clip: Clip::Off, ..TaaParams::default() },
            cpu::TaaParams { clip: cpu::Clip::Off, ..cpu::TaaParams::default() },
        ),
    ];
    let pixels = (WIDTH * HEIGHT) as usize;
    for (params, reference) in dials {
        let inputs = FilterInputs::new(gpu, WIDTH, HEIGHT).unwrap();
        let mut device = Taa::new(gpu, &kernels, &params, &inputs).unwrap();
        let mut cpu = cpu::Taa::new(reference).unwrap();
        let (mut ours, mut theirs) = (vec![Vec3::ZERO; pixels], vec![Vec3::ZERO; pixels]);
        for index in 0..5 {
            let film = Film::frame(index, 1.0);
            let report = device.filter(gpu, &film.device(), &mut ours).unwrap();
            same(report, cpu.filter(&film.cpu(), &mut theirs).unwrap());
            let (most, beyond) = difference(&theirs, &ours, 1e-3);
            assert!(
                most < 1e-3,
                "{params:?}, frame {index}: {most:e} of the mean, {beyond} pixels beyond 1e-3"
            );
        }
        // Negative control: the next frame with another share.
        let film = Film::frame(5, 1.0);
        let other = cpu::TaaParams { alpha: reference.alpha * 1.1, ..reference };
        let mut cpu = cpu::Taa::new(other).unwrap();
        for index in 0..5 {
            cpu.filter(&Film::frame(index, 1.0).cpu(), &mut theirs).unwrap();
        }
        cpu.filter(&film.cpu(), &mut theirs).unwrap();
        device.filter(gpu, &film.device(), &mut ours).unwrap();
        assert!(difference(&theirs, &ours, 1e-3).0 > 1e-3);
    }
}

#[test]
fn frames_that_are_forgotten_leave_nothing() {
    let gpu = gpu_or_skip!();
    let inputs = FilterInputs::new(gpu, WIDTH, HEIGHT).unwrap();
    let mut svgf = Svgf::new(gpu, &SvgfKernels::new(gpu).unwrap(), &SvgfParams::paper(), &inputs).unwrap();
    let mut taa = Taa::new(gpu, &TaaKernels::new(gpu).unwrap(), &TaaParams::default(), &inputs).unwrap();
    let film = Film::frame(0, 1.0);
    let mut first = [vec![Vec3::ZERO; film.color.len()], vec![Vec3::ZERO; film.color.len()]];
    svgf.filter(gpu, &film.device(), &mut first[0]).unwrap();
    taa.filter(gpu, &film.device(), &mut first[1]).unwrap();
    let mut again = first.clone();
    assert!(svgf.filter(gpu, &film.device(), &mut again[0]).unwrap().with_history > 0);
    gpu.run("reset", |encoder| {
        svgf.encode_reset(encoder);
        taa.encode_reset(encoder);
    })
    .unwrap();
    let report = svgf.filter(gpu, &film.device(), &mut again[0]).unwrap();
    assert_eq!(report.with_history, 0);
    taa.filter(gpu, &film.device(), &mut again[1]).unwrap();
    // The same bits: nothing on the device depends on the order of threads.
    assert_eq!(first, again);
}

#[test]
fn what_cannot_be_filtered_is_named() {
    let gpu = gpu_or_skip!();
    assert!(matches!(FilterInputs::new(gpu, 0, 5), Err(GpuError::TooMany { what: "pixels", .. })));
    let mut inputs = FilterInputs::new(gpu, WIDTH, HEIGHT).unwrap();
    let film = Film::frame(0, 1.0);
    let short = FilterFrame { depth: &film.depth[1..], ..film.device() };
    assert!(matches!(inputs.write(gpu, &short), Err(GpuError::TooMany { what: "depths", .. })));
    let kernels = SvgfKernels::new(gpu).unwrap();
    let params = SvgfParams { alpha: f32::NAN, ..SvgfParams::paper() };
    let error = Svgf::new(gpu, &kernels, &params, &inputs).unwrap_err();
    assert_eq!(error, GpuError::Parameter { name: "alpha", range: "from 0 to 1" });
    let params = TaaParams { alpha: 0.0, ..TaaParams::default() };
    let error = Taa::new(gpu, &TaaKernels::new(gpu).unwrap(), &params, &inputs).unwrap_err();
    assert!(error.to_string().contains("`alpha`"));
}
