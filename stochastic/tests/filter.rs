//! What the filters promise: nothing is made, lost, or carried over an edge; and what is not a number stays
//! where it is.

use glam::Vec3;
use lighttree::rng::Random;
use stochastic::filter::{
    Clip, FilterError, FilterInput, FilterReport, Mixing, Svgf, SvgfParams, Taa, TaaParams,
};

/// A frame that owns its slices: a flat wall unless a test changes it.
#[derive(Clone)]
struct Picture {
    width: u32,
    height: u32,
    color: Vec<Vec3>,
    emission: Vec<Vec3>,
    albedo: Vec<Vec3>,
    normal: Vec<Vec3>,
    depth: Vec<f32>,
    motion: Vec<Vec3>,
    mesh: Vec<u32>,
}

impl Picture {
    fn wall(width: u32, height: u32, color: impl Fn(u32, u32) -> Vec3) -> Self {
        let count = (width * height) as usize;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Self {
            width,
            height,
            color: pixels.map(|(x, y)| color(x, y)).collect(),
            emission: vec![Vec3::ZERO; count],
            albedo: vec![Vec3::splat(0.5); count],
            normal: vec![Vec3::Z; count],
            depth: vec![3.0; count],
            motion: vec![Vec3::ZERO; count],
            mesh: vec![0; count],
        }
    }

    fn input(&self) -> FilterInput<'_> {
        FilterInput {
            width: self.width,
            height: self.height,
            color: &self.color,
            emission: Some(&self.emission),
            albedo: &self.albedo,
            normal: &self.normal,
            depth: &self.depth,
            motion: Some(&self.motion),
            mesh: Some(&self.mesh),
        }
    }

    fn filtered(&self, params: SvgfParams) -> (Vec<Vec3>, FilterReport) {
        let mut out = vec![Vec3::NAN; self.color.len()];
        let report = Svgf::new(params).unwrap().filter(&self.input(), &mut out).unwrap();
        (out, report)
    }
}

/// Skewed noise of mean 1, as light samples have it: mostly dark, seldom bright.
fn noise(x: u32, y: u32, frame: u32) -> Vec3 {
    let u = Random::new(7, y * 4096 + x, frame).f32();
    let value = if u < 0.9 { 0.25 } else { 7.75 };
    Vec3::new(value, 0.8 * value, 0.5 * value)
}

fn mean(colors: &[Vec3]) -> f64 {
    colors.iter().map(|c| f64::from(c.x)).sum::<f64>() / colors.len() as f64
}

fn variance(colors: &[Vec3]) -> f64 {
    let mean = mean(colors);
    colors.iter().map(|c| (f64::from(c.x) - mean).powi(2)).sum::<f64>() / colors.len() as f64
}

const MIXINGS: [Mixing; 2] = [Mixing::Normalized, Mixing::Conserving];

#[test]
fn a_constant_stays_constant_in_any_size() {
    let color = Vec3::new(0.3, 0.2, 0.7);
    for (width, height) in [(1, 1), (1, 9), (13, 1), (3, 2), (65, 17), (128, 40)] {
        for mixing in MIXINGS {
            for interleaved in [1, 2, 3, 8] {
                let picture = Picture::wall(width, height, |_, _| color);
                let (out, report) =
                    picture.filtered(SvgfParams { mixing, interleaved, ..SvgfParams::default() });
                for (i, value) in out.iter().enumerate() {
                    assert!(
                        (*value - color).abs().max_element() < 1e-6,
                        "{width}x{height} pixel {i}: {value}"
                    );
                }
                let pixels = u64::from(width * height);
                assert_eq!(report, FilterReport { without_history: pixels, ..FilterReport::default() });
            }
        }
    }
}

#[test]
fn conserving_keeps_the_sum_and_the_paper_does_not() {
    let mut picture = Picture::wall(160, 90, |x, y| noise(x, y, 0));
    // A tilted half of another object beside it: sums are kept across stops of every kind.
    for i in 0..picture.color.len() {
        if i % 160 >= 80 {
            picture.normal[i] = Vec3::new(0.6, 0.0, 0.8);
            picture.depth[i] = 5.0 + (i % 160) as f32 * 0.05;
            picture.mesh[i] = 1;
        }
    }
    let before = mean(&picture.color);
    let conserving = SvgfParams { mixing: Mixing::Conserving, ..SvgfParams::default() };
    let (kept, _) = picture.filtered(conserving);
    assert!((mean(&kept) - before).abs() < 1e-5 * before, "{} became {}", before, mean(&kept));
    let left = variance(&kept) / variance(&picture.color);
    assert!(left < 0.2, "it leaves {left} of the variance");
    let (darker, _) = picture.filtered(SvgfParams::paper());
    assert!(mean(&darker) < 0.99 * before, "{} against {before}", mean(&darker));
}

#[test]
fn light_does_not_leak_over_an_edge() {
    type Edge = fn(&mut Picture, usize);
    let edges: [(&str, Edge); 4] = [
        ("depth", |p, i| p.depth[i] = 3.3),
        ("normal", |p, i| p.normal[i] = Vec3::X),
        ("object", |p, i| p.mesh[i] = 1),
        ("no surface", |p, i| p.depth[i] = f32::INFINITY),
    ];
    for (name, edge) in edges {
        for mixing in MIXINGS {
            for interleaved in [1, 4] {
                // A bright noisy half beside a black one, itself a hair from black so that it has variance.
                let mut picture =
                    Picture::wall(
                        64,
                        48,
                        |x, y| {
                            if x < 32 { 1e3 * noise(x, y, 0) } else { 1e-3 * noise(x, y, 1) }
                        },
                    );
                (0..picture.color.len()).filter(|i| i % 64 >= 32).for_each(|i| edge(&mut picture, i));
                let params = SvgfParams {
                    mixing,
                    interleaved,
                    sigma_luminance: f32::INFINITY,
                    ..SvgfParams::default()
                };
                let (out, _) = picture.filtered(params);
                let dark = out.iter().enumerate().filter(|(i, _)| i % 64 >= 32).map(|(_, c)| c.max_element());
                let brightest = dark.fold(0.0, f32::max);
                assert!(brightest <= 7.76e-3, "{name} leaks {brightest}");
            }
        }
    }
    // The same without an edge does mix.
    let picture =
        Picture::wall(64, 48, |x, y| if x < 32 { 1e3 * noise(x, y, 0) } else { 1e-3 * noise(x, y, 1) });
    let (out, _) = picture.filtered(SvgfParams { sigma_luminance: f32::INFINITY, ..SvgfParams::default() });
    assert!(out[40 * 64 + 33].x > 10.0);
}

#[test]
fn a_slope_is_no_edge() {
    let mut picture = Picture::wall(96, 96, |x, y| noise(x, y, 0));
    for i in 0..picture.depth.len() {
        picture.depth[i] = 2.0 + 0.3 * (i % 96) as f32 + 0.1 * (i / 96) as f32;
    }
    let (out, _) = picture.filtered(SvgfParams::default());
    let left = variance(&out) / variance(&picture.color);
    assert!(left < 0.2, "it leaves {left} of the variance");
}

#[test]
fn what_has_no_variance_is_left_alone() {
    // A step of luminance whose frames never vary: its variance over time is 0.
    let picture = Picture::wall(40, 30, |x, _| Vec3::splat(if x < 20 { 0.1 } else { 0.9 }));
    for mixing in MIXINGS {
        let mut svgf = Svgf::new(SvgfParams { feedback: false, mixing, ..SvgfParams::default() }).unwrap();
        let mut out = vec![Vec3::ZERO; picture.color.len()];
        for _ in 0..6 {
            svgf.filter(&picture.input(), &mut out).unwrap();
        }
        for (out, color) in out.iter().zip(&picture.color) {
            assert!((*out - *color).abs().max_element() < 1e-6 * color.x);
        }
    }
}

#[test]
fn what_is_not_a_number_is_counted_and_does_not_spread() {
    let mut picture = Picture::wall(50, 40, |x, y| noise(x, y, 0));
    picture.color[5 * 50 + 7] = Vec3::new(0.5, f32::NAN, 0.5);
    picture.color[9 * 50 + 20] = Vec3::splat(f32::INFINITY);
    picture.normal[12 * 50 + 3] = Vec3::NAN;
    picture.depth[20 * 50 + 30] = f32::NAN;
    picture.depth[21 * 50 + 30] = -1.0;
    picture.albedo[30 * 50 + 40] = Vec3::NAN;
    picture.emission[31 * 50 + 40] = Vec3::INFINITY;
    // No surface, and no number either.
    picture.depth[0] = f32::INFINITY;
    picture.color[0] = Vec3::NAN;
    // All of a block: nothing to fill it from.
    (0..12 * 12).for_each(|i| picture.color[(25 + i / 12) * 50 + i % 12] = Vec3::NEG_INFINITY);
    for mixing in MIXINGS {
        for interleaved in [1, 4] {
            let mut svgf = Svgf::new(SvgfParams { mixing, interleaved, ..SvgfParams::default() }).unwrap();
            let mut out = vec![Vec3::ZERO; picture.color.len()];
            let mut taa = Taa::new(TaaParams::default()).unwrap();
            for _ in 0..3 {
                let report = svgf.filter(&picture.input(), &mut out).unwrap();
                assert_eq!(report.non_finite, 8 + 144);
                assert!(out.iter().all(|c| c.is_finite() && c.max_element() < 8.0));
                assert!(out[5 * 50 + 7].max_element() > 0.0, "a hole is filled");
                let report = taa.filter(&picture.input(), &mut out).unwrap();
                assert_eq!(report.non_finite, 3 + 144);
                assert!(out.iter().all(|c| c.is_finite()));
            }
        }
    }
}

#[test]
fn a_static_scene_converges_as_one_over_n() {
    let frame = |n| Picture::wall(64, 64, |x, y| noise(x, y, n));
    let params = SvgfParams { levels: 0, alpha: 0.0, alpha_moments: 0.0, ..SvgfParams::default() };
    let mut svgf = Svgf::new(params).unwrap();
    let mut out = vec![Vec3::ZERO; 64 * 64];
    let one = variance(&frame(0).color);
    for n in 1..=64 {
        let report = svgf.filter(&frame(n).input(), &mut out).unwrap();
        assert_eq!(report.with_history, if n == 1 { 0 } else { 64 * 64 });
        if n.is_power_of_two() {
            let expected = one / f64::from(n);
            let found = variance(&out);
            assert!((found / expected - 1.0).abs() < 0.15, "{n} frames: {found} where {expected}");
        }
    }
    // A least share of a fifth stops at (2 - α)/α = 9 frames.
    let mut svgf = Svgf::new(SvgfParams { levels: 0, alpha: 0.2, ..SvgfParams::default() }).unwrap();
    (0..64).for_each(|n| {
        svgf.filter(&frame(n).input(), &mut out).unwrap();
    });
    assert!((variance(&out) / (one / 9.0) - 1.0).abs() < 0.15);
}

#[test]
fn the_filter_narrows_as_frames_accumulate() {
    let params = SvgfParams { alpha: 0.0, alpha_moments: 0.0, feedback: false, ..SvgfParams::default() };
    let mut svgf = Svgf::new(params).unwrap();
    // Noise over a shadow's edge, which a filter of fixed width would blur for ever.
    let truth = |x: u32| if x < 32 { 1.0 } else { 0.5 };
    let mut out = vec![Vec3::ZERO; 64 * 64];
    let mut errors = Vec::new();
    for n in 0..256u32 {
        let picture = Picture::wall(64, 64, |x, y| noise(x, y, n) * truth(x));
        svgf.filter(&picture.input(), &mut out).unwrap();
        if [0, 15, 255].contains(&n) {
            let error = |(i, c): (usize, &Vec3)| f64::from(c.x - truth(i as u32 % 64)).powi(2);
            errors.push(out.iter().enumerate().map(error).sum::<f64>() / 4096.0);
        }
    }
    assert!(errors[1] < 0.3 * errors[0] && errors[2] < 0.2 * errors[1], "{errors:?}");
}

/// Where noise is rare and bright, most pixels have seen none of it for some frames, and think that they
/// know.
#[test]
fn more_frames_make_rare_noise_better_and_not_worse() {
    let rare = |x, y, n| Vec3::splat(if Random::new(8, y * 4096 + x, n).f32() < 0.98 { 0.1 } else { 45.1 });
    for mixing in MIXINGS {
        let mut svgf = Svgf::new(SvgfParams { mixing, ..SvgfParams::default() }).unwrap();
        let mut out = vec![Vec3::ZERO; 64 * 64];
        let mut spread = Vec::new();
        for n in 0..16 {
            let picture = Picture::wall(64, 64, |x, y| rare(x, y, n));
            svgf.filter(&picture.input(), &mut out).unwrap();
            spread.push(variance(&out) / mean(&out).powi(2));
        }
        let late = spread[8..].iter().copied().fold(0.0, f64::max);
        assert!(late < 0.7 * spread[0], "{mixing:?}: {spread:?}");
    }
}

#[test]
fn disocclusion_starts_anew() {
    let mut svgf = Svgf::new(SvgfParams { levels: 0, ..SvgfParams::default() }).unwrap();
    let mut out = vec![Vec3::ZERO; 32 * 32];
    let before = Picture::wall(32, 32, |_, _| Vec3::splat(5.0));
    svgf.filter(&before.input(), &mut out).unwrap();

    // A tenth of the depth away, turned, another object, unknown motion, from off screen, and the same.
    let mut now = Picture::wall(32, 32, |_, _| Vec3::splat(1.0));
    for i in [330, 331, 332, 362, 363, 364, 394, 395, 396] {
        now.depth[i] = 3.5;
    }
    now.normal[100] = Vec3::Y;
    now.mesh[200] = 9;
    now.motion[300] = Vec3::NAN;
    now.motion[400] = Vec3::new(0.0, -20.0, 0.0);
    let report = svgf.filter(&now.input(), &mut out).unwrap();
    assert_eq!((report.without_history, report.with_history), (13, 32 * 32 - 13));
    for (i, value) in out.iter().enumerate() {
        let expected = if now.depth[i] == 3.5 || [100, 200, 300, 400].contains(&i) { 1.0 } else { 3.0 };
        assert!((value.x - expected).abs() < 1e-5, "pixel {i}: {value}");
    }

    // With the motion in depth that explains it, it is the same surface.
    let mut moved = before.clone();
    moved.depth.fill(3.5);
    moved.motion.fill(Vec3::new(0.0, 0.0, -0.5));
    svgf.reset();
    assert_eq!(svgf.filter(&before.input(), &mut out).unwrap().with_history, 0);
    assert_eq!(svgf.filter(&moved.input(), &mut out).unwrap().without_history, 0);
    // Another size knows nothing.
    let small = Picture::wall(16, 16, |_, _| Vec3::ONE);
    assert_eq!(svgf.filter(&small.input(), &mut out[..256]).unwrap().with_history, 0);
}

#[test]
fn history_follows_motion() {
    // A ramp that moves by whole and half pixels: bilinear history is exact on it.
    let mut svgf = Svgf::new(SvgfParams { levels: 0, ..SvgfParams::default() }).unwrap();
    let mut out = vec![Vec3::ZERO; 40 * 10];
    let ramp = |offset: f32| Picture::wall(40, 10, move |x, _| Vec3::splat(x as f32 + offset));
    svgf.filter(&ramp(0.0).input(), &mut out).unwrap();
    let mut now = ramp(2.5);
    now.motion.fill(Vec3::new(2.5, 0.0, 0.0));
    svgf.filter(&now.input(), &mut out).unwrap();
    for (i, value) in out.iter().enumerate().filter(|(i, _)| i % 40 < 36) {
        assert!((value.x - ((i % 40) as f32 + 2.5)).abs() < 1e-4, "pixel {i}: {value}");
    }
}

#[test]
fn the_interleaved_pattern_cancels() {
    for m in [2u32, 3, 4, 8] {
        // Each pixel of a block has its own part of the lights, m² times as bright; their mean is 1.
        let part = |x: u32, y: u32| (y % m) * m + x % m;
        let whole = (0..m * m).map(|p| p as f32 + 1.0).sum::<f32>() / (m * m) as f32;
        let mut picture = Picture::wall(96, 96, |x, y| Vec3::splat((part(x, y) as f32 + 1.0) / whole));
        // Two surfaces, whose mean must not mix.
        for i in 0..picture.color.len() {
            if i % 96 >= 48 {
                picture.mesh[i] = 1;
                picture.color[i] *= 3.0;
            }
        }
        let params = SvgfParams { levels: 0, interleaved: m, ..SvgfParams::default() };
        let (out, _) = picture.filtered(params);
        let (reach, mut worst) = (m / 2, 0.0f32);
        for y in reach..96 - reach {
            for x in (reach..48 - reach).chain(48 + reach..96 - reach) {
                let truth = if x < 48 { 1.0 } else { 3.0 };
                worst = worst.max((out[(y * 96 + x) as usize].x / truth - 1.0).abs());
            }
        }
        assert!(worst < 1e-5, "m = {m}: {worst}");
        // All of SVGF on it has no variance left to smooth with, and keeps it.
        let (out, _) = picture.filtered(SvgfParams { interleaved: m, ..SvgfParams::default() });
        assert!((out[48 * 96 + 24].x - 1.0).abs() < 1e-5);
        // As if it were noise, without knowing of the pattern, it does worse.
        let (out, _) = picture.filtered(SvgfParams::default());
        let off = (0..96 * 96).filter(|i| i % 96 < 44).map(|i| (out[i].x - 1.0).abs()).fold(0.0, f32::max);
        assert!(off > 1e-3, "m = {m}: {off}");
    }
}

#[test]
fn slices_of_the_wrong_length_are_refused_by_name() {
    let picture = Picture::wall(8, 4, |_, _| Vec3::ONE);
    let mut svgf = Svgf::new(SvgfParams::default()).unwrap();
    let mut taa = Taa::new(TaaParams::default()).unwrap();
    let mut out = vec![Vec3::ZERO; 32];
    let short = Picture { width: 8, ..Picture::wall(31, 1, |_, _| Vec3::ONE) };
    let good = picture.input();
    let bad = short.input();
    let cases = [
        ("color", FilterInput { color: bad.color, ..good }),
        ("emission", FilterInput { emission: bad.emission, ..good }),
        ("albedo", FilterInput { albedo: bad.albedo, ..good }),
        ("normal", FilterInput { normal: bad.normal, ..good }),
        ("depth", FilterInput { depth: bad.depth, ..good }),
        ("motion", FilterInput { motion: bad.motion, ..good }),
        ("mesh", FilterInput { mesh: bad.mesh, ..good }),
    ];
    for (name, input) in cases {
        let expected = FilterError::Length { field: name, length: 31, pixels: 32 };
        assert_eq!(svgf.filter(&input, &mut out), Err(expected.clone()));
        assert_eq!(taa.filter(&input, &mut out), Err(expected));
    }
    assert_eq!(
        svgf.filter(&good, &mut out[..31]),
        Err(FilterError::Length { field: "out", length: 31, pixels: 32 })
    );
    let empty = FilterInput { width: 0, ..good };
    assert_eq!(svgf.filter(&empty, &mut out), Err(FilterError::Size { width: 0, height: 4 }));
    let huge = FilterInput { width: u32::MAX, height: u32::MAX, ..good };
    assert!(matches!(svgf.filter(&huge, &mut out), Err(FilterError::Size { .. })));
    for params in [
        SvgfParams { alpha: f32::NAN, ..SvgfParams::default() },
        SvgfParams { depth_floor: 0.0, ..SvgfParams::default() },
        SvgfParams { interleaved: 0, ..SvgfParams::default() },
        SvgfParams { levels: 40, ..SvgfParams::default() },
    ] {
        assert!(matches!(Svgf::new(params), Err(FilterError::Parameter { .. })));
    }
    assert!(Taa::new(TaaParams { clip: Clip::Deviations(f32::NAN), ..TaaParams::default() }).is_err());
}

#[test]
fn scale_changes_nothing() {
    let picture = Picture::wall(48, 32, |x, y| noise(x, y, 3));
    let (reference, _) = picture.filtered(SvgfParams::default());
    for exponent in [-100, -40, 40, 100] {
        let scale = 2.0f32.powi(exponent);
        let mut scaled = picture.clone();
        scaled.color.iter_mut().for_each(|c| *c *= scale);
        let (out, _) = scaled.filtered(SvgfParams::default());
        for (a, b) in out.iter().zip(&reference) {
            assert_eq!(*a / scale, *b, "2^{exponent}");
        }
        // Nor does the scene's unit of length.
        let mut far = picture.clone();
        far.depth.iter_mut().for_each(|d| *d *= scale);
        assert_eq!(far.filtered(SvgfParams::default()).0, reference);
    }
}

#[test]
fn history_survives_a_change_of_brightness_by_many_magnitudes() {
    let mut svgf = Svgf::new(SvgfParams { levels: 0, ..SvgfParams::default() }).unwrap();
    let mut out = vec![Vec3::ZERO; 16];
    for (n, value) in [1e-20f32, 1e20, 1e-20].into_iter().enumerate() {
        let picture = Picture::wall(4, 4, |_, _| Vec3::splat(value));
        svgf.filter(&picture.input(), &mut out).unwrap();
        let expected = [1e-20, 5e19, 3.333_333_3e19][n];
        assert!((out[5].x / expected - 1.0).abs() < 1e-5, "{n}: {}", out[5]);
    }
}

#[test]
fn threads_change_no_bit() {
    let picture = Picture::wall(150, 70, |x, y| noise(x, y, 5));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut svgf = Svgf::new(SvgfParams { interleaved: 2, ..SvgfParams::default() }).unwrap();
            let mut taa = Taa::new(TaaParams::default()).unwrap();
            let (mut out, mut smooth) = (vec![Vec3::ZERO; 150 * 70], vec![Vec3::ZERO; 150 * 70]);
            for _ in 0..2 {
                svgf.filter(&picture.input(), &mut out).unwrap();
                taa.filter(&FilterInput { color: &out, ..picture.input() }, &mut smooth).unwrap();
            }
            smooth.iter().flat_map(|c| c.to_array().map(f32::to_bits)).collect::<Vec<_>>()
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn texture_and_emitters_stay_sharp() {
    // The same light on a plain wall and on a chequered one with a lamp in the middle.
    let plain = Picture::wall(64, 64, |x, y| 0.5 * noise(x, y, 0));
    let mut picture = plain.clone();
    for i in 0..64 * 64 {
        let albedo = if (i % 64 / 4 + i / 64 / 4) % 2 == 0 { 0.9 } else { 0.1 };
        picture.albedo[i] = Vec3::splat(albedo);
        picture.color[i] *= albedo / 0.5;
    }
    picture.emission[32 * 64 + 32] = Vec3::splat(1e3);
    picture.color[32 * 64 + 32] += Vec3::splat(1e3);
    let ((out, _), (light, _)) =
        (picture.filtered(SvgfParams::default()), plain.filtered(SvgfParams::default()));
    for (i, (value, light)) in out.iter().zip(&light).enumerate() {
        let lamp = picture.emission[i].x;
        let found = (value.x - lamp) / picture.albedo[i].x;
        assert!((found - light.x / 0.5).abs() < 1e-3, "pixel {i}: {found}, {}", light.x / 0.5);
    }
}

#[test]
fn memory_is_as_stated() {
    let picture = Picture::wall(37, 21, |x, y| noise(x, y, 0));
    let (pixels, mut out) = (37 * 21, vec![Vec3::ZERO; 37 * 21]);
    let mut svgf = Svgf::new(SvgfParams::default()).unwrap();
    let mut taa = Taa::new(TaaParams::default()).unwrap();
    assert_eq!((svgf.bytes(), taa.bytes()), (0, 0));
    for _ in 0..3 {
        svgf.filter(&picture.input(), &mut out).unwrap();
        taa.filter(&picture.input(), &mut out).unwrap();
    }
    assert_eq!(svgf.bytes(), Svgf::BYTES_PER_PIXEL * pixels);
    assert_eq!(taa.bytes(), 24 * pixels);
}

#[test]
fn anti_aliasing_averages_what_stands_and_drops_what_is_gone() {
    let noisy = |n| Picture::wall(48, 48, move |x, y| Vec3::ONE + 0.1 * (noise(x, y, n) - Vec3::ONE));
    let mut taa = Taa::new(TaaParams { clip: Clip::Off, ..TaaParams::default() }).unwrap();
    let mut out = vec![Vec3::ZERO; 48 * 48];
    for n in 0..60 {
        let report = taa.filter(&noisy(n).input(), &mut out).unwrap();
        assert_eq!(report.clipped, 0);
    }
    // A moving mean of share α has α / (2 - α) of the variance.
    let expected = variance(&noisy(0).color) / 19.0;
    assert!((variance(&out) / expected - 1.0).abs() < 0.2, "{} where {expected}", variance(&out));

    // When the light goes out, history goes with it at once, and that is counted.
    for clip in [Clip::Extremes, Clip::Deviations(1.0)] {
        let mut taa = Taa::new(TaaParams { clip, ..TaaParams::default() }).unwrap();
        taa.filter(&noisy(0).input(), &mut out).unwrap();
        let dark = Picture::wall(48, 48, |_, _| Vec3::splat(0.01));
        let report = taa.filter(&dark.input(), &mut out).unwrap();
        assert_eq!(report.clipped, 48 * 48);
        assert!(out.iter().all(|c| (c.x - 0.01).abs() < 1e-4), "{}", out[0]);
    }
}

#[test]
fn anti_aliasing_looks_history_up_where_it_was() {
    let ramp = |offset: f32| Picture::wall(40, 10, move |x, _| Vec3::splat(x as f32 + offset));
    let mut taa = Taa::new(TaaParams::default()).unwrap();
    let mut out = vec![Vec3::ZERO; 400];
    taa.filter(&ramp(0.0).input(), &mut out).unwrap();
    let mut now = ramp(2.5);
    now.motion.fill(Vec3::new(2.5, 0.0, 0.0));
    let report = taa.filter(&now.input(), &mut out).unwrap();
    assert_eq!(report.without_history, 30, "what came in from the right");
    for (i, value) in out.iter().enumerate().filter(|(i, _)| (2..35).contains(&(i % 40))) {
        assert!((value.x - ((i % 40) as f32 + 2.5)).abs() < 1e-3, "pixel {i}: {value}");
    }
}
