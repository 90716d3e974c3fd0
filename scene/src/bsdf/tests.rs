//! Sampling, densities, energy, reciprocity and bounds of all scattering models.

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::Toward;
use lighttree::rng::Random;

use super::{Bsdf, Dielectric, Ggx, Phong, Transport, fresnel_dielectric};

fn ggx(base: f32, metallic: f32, roughness: f32) -> Bsdf {
    Bsdf::Ggx(Ggx::new(Vec3::splat(base), metallic, roughness, 1.5, 1.0, Vec3::ONE))
}

/// As bright as each model can be.
fn white() -> Vec<(&'static str, Bsdf)> {
    vec![
        ("lambert", Bsdf::Lambert { albedo: Vec3::ONE }),
        ("rough plastic", ggx(1.0, 0.0, 0.8)),
        ("plastic", ggx(1.0, 0.0, 0.5)),
        ("smooth plastic", ggx(1.0, 0.0, 0.35)),
        ("metal", ggx(1.0, 1.0, 0.5)),
        ("half metal", ggx(1.0, 0.5, 0.7)),
        ("dense plastic", Bsdf::Ggx(Ggx::new(Vec3::ONE, 0.0, 0.4, 2.5, 1.0, Vec3::ONE))),
        ("weak specular", Bsdf::Ggx(Ggx::new(Vec3::ONE, 0.0, 0.5, 1.5, 0.4, Vec3::new(1.0, 0.5, 0.2)))),
        ("phong", Bsdf::Phong(Phong::over(Vec3::ONE, 30.0))),
        ("pure phong", Bsdf::Phong(Phong { diffuse: Vec3::ZERO, specular: Vec3::ONE, exponent: 150.0 })),
    ]
}

fn viewers() -> impl Iterator<Item = Vec3> {
    [0.0_f32, 0.4, 0.9, 1.2, 1.45].into_iter().map(|t| Vec3::new(t.sin() * 0.6, t.sin() * 0.8, t.cos()))
}

/// Directions of a midpoint rule over the hemisphere, even in θ and φ, and their solid angles.
fn directions() -> impl Iterator<Item = (Vec3, f64)> {
    const N: usize = 256;
    let step = core::f64::consts::PI / N as f64;
    (0..N).flat_map(move |i| {
        let (sin, cos) = (0.5 * step * (i as f64 + 0.5)).sin_cos();
        (0..2 * N).map(move |j| {
            let (y, x) = (step * (j as f64 + 0.5)).sin_cos();
            (glam::DVec3::new(sin * x, sin * y, cos).as_vec3(), sin * 0.5 * step * step)
        })
    })
}

fn integrate(f: impl Fn(Vec3) -> f32) -> f64 {
    directions().map(|(wi, weight)| f64::from(f(wi)) * weight).sum()
}

fn samples(bsdf: &Bsdf, wo: Vec3, count: u32) -> impl Iterator<Item = Option<super::BsdfSample>> + '_ {
    (0..count).map(move |i| {
        let [a, b, c, _] = sobol_burley::sample_4d(i, 0, 7);
        bsdf.sample(Vec3::Z, wo, [a, b, c], Transport::Radiance)
    })
}

const COUNT: u32 = 1 << 15;

#[test]
fn densities_integrate_to_what_is_not_lost() {
    for (name, bsdf) in white() {
        for wo in viewers() {
            let kept = samples(&bsdf, wo, COUNT).flatten().count() as f64 / f64::from(COUNT);
            let integral = integrate(|wi| bsdf.pdf(Vec3::Z, wo, wi));
            assert!((integral - kept).abs() < 4e-3, "{name} {wo}: ∫ pdf = {integral}, kept {kept}");
        }
    }
}

#[test]
fn samples_follow_their_density() {
    // Edges between those of the quadrature's cells.
    const RINGS: usize = 8;
    const SECTORS: usize = 16;
    for (name, bsdf) in white() {
        for wo in viewers() {
            let bin = |wi: Vec3| {
                let ring = ((wi.z.acos() / (0.5 * PI) * RINGS as f32) as usize).min(RINGS - 1);
                let turn = (wi.y.atan2(wi.x) / (2.0 * PI)).rem_euclid(1.0);
                ring * SECTORS + ((turn * SECTORS as f32) as usize).min(SECTORS - 1)
            };
            let mut expected = [0.0; RINGS * SECTORS];
            for (wi, weight) in directions() {
                expected[bin(wi)] += f64::from(bsdf.pdf(Vec3::Z, wo, wi)) * weight;
            }
            let mut found = [0.0; RINGS * SECTORS];
            let mut random = Random::new(3, 0, 0);
            for _ in 0..COUNT {
                let u = [random.f32(), random.f32(), random.f32()];
                if let Some(s) = bsdf.sample(Vec3::Z, wo, u, Transport::Radiance) {
                    found[bin(s.wi)] += 1.0;
                }
            }
            let (mut chi2, mut bins) = (0.0, 0.0);
            for (&e, &f) in expected.iter().zip(&found) {
                let e = e * f64::from(COUNT);
                if e > 10.0 {
                    chi2 += (f - e) * (f - e) / e;
                    bins += 1.0;
                }
            }
            // Mean and deviation of chi² with as many degrees of freedom; the quadrature's own error is part
            // of the slack.
            let sigmas = (chi2 - bins) / f64::sqrt(2.0 * bins);
            assert!(sigmas < 5.0, "{name} {wo}: chi² = {chi2} over {bins} bins");
        }
    }
}

#[test]
fn weights_are_scattering_over_density() {
    for (name, bsdf) in white() {
        for wo in viewers() {
            for s in samples(&bsdf, wo, 1000).flatten() {
                assert_eq!(s.pdf, bsdf.pdf(Vec3::Z, wo, s.wi), "{name}");
                let product = s.weight * s.pdf;
                let scatter = bsdf.scatter(Vec3::Z, wo, s.wi);
                assert!((product - scatter).abs().max_element() <= 1e-5 * scatter.max_element(), "{name}");
            }
        }
    }
}

#[test]
fn no_more_leaves_than_arrives() {
    for (name, bsdf) in white() {
        for wo in viewers() {
            let by_samples = samples(&bsdf, wo, COUNT).flatten().map(|s| f64::from(s.weight.x)).sum::<f64>();
            let by_samples = by_samples / f64::from(COUNT);
            let by_quadrature = integrate(|wi| bsdf.scatter(Vec3::Z, wo, wi).x);
            assert!(
                (by_samples - by_quadrature).abs() < 5e-3,
                "{name} {wo}: {by_samples} or {by_quadrature}"
            );
            assert!(by_samples <= 1.0 + 2e-4, "{name} {wo}: albedo {by_samples}");
        }
    }
    // Down to the narrowest lobes, where only the samples can tell.
    let mut highest = 0.0_f64;
    for roughness in [0.0, 0.05, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.7, 1.0] {
        for (base, metallic, ior) in
            [(1.0, 0.0, 1.1), (1.0, 0.0, 1.5), (1.0, 0.0, 2.5), (1.0, 1.0, 1.5), (0.2, 0.3, 1.5)]
        {
            let bsdf = Bsdf::Ggx(Ggx::new(Vec3::splat(base), metallic, roughness, ior, 1.0, Vec3::ONE));
            for wo in viewers().chain([Vec3::new(1.0, 0.0, 1e-3).normalize(), Vec3::new(0.8, 0.0, 0.6)]) {
                let sum = samples(&bsdf, wo, 1 << 13).flatten().map(|s| f64::from(s.weight.x)).sum::<f64>();
                let albedo = sum / f64::from(1 << 13);
                assert!(albedo > 0.0 && albedo <= 1.0 + 2e-4, "roughness {roughness} {ior} {wo}: {albedo}");
                highest = highest.max(albedo);
            }
        }
    }
    assert!(highest > 0.99, "white surfaces reflect nearly all, not {highest}");
}

/// A smooth interface over a Lambert base: what is not reflected at the first surface reaches the base.
#[test]
fn the_base_gets_what_the_interface_lets_through() {
    let Bsdf::Ggx(model) = ggx(0.6, 0.0, 0.0) else { unreachable!() };
    for wo in viewers() {
        let base = integrate(|wi| {
            let through = (1.0 - super::ggx::schlick(model.interface, wo.z))
                * (1.0 - super::ggx::schlick(model.interface, wi.z));
            model.base.x * through * wi.z
        });
        let albedo = f64::from(Bsdf::Ggx(model).diffuse_albedo(Vec3::Z, wo).x);
        assert!((base / albedo - 1.0).abs() < 1e-3, "{base} is not {albedo}");
    }
}

#[test]
fn light_may_go_either_way() {
    let mut random = Random::new(1, 2, 3);
    for (name, bsdf) in white() {
        for _ in 0..1000 {
            let mut direction = || super::cosine_hemisphere(Vec3::Z, random.f32(), random.f32());
            let (a, b) = (direction(), direction());
            let there = bsdf.scatter(Vec3::Z, a, b) / b.z;
            let back = bsdf.scatter(Vec3::Z, b, a) / a.z;
            let difference = (there - back).abs().max_element();
            assert!(difference <= 2e-3 * there.max_element() + 1e-6, "{name}: {there} there, {back} back");
        }
    }
}

#[test]
fn nothing_from_below() {
    for (_, bsdf) in white() {
        for wo in viewers() {
            let below = Vec3::new(0.3, 0.1, -0.2).normalize();
            assert_eq!(bsdf.scatter(Vec3::Z, wo, below), Vec3::ZERO);
            assert_eq!(bsdf.pdf(Vec3::Z, wo, below), 0.0);
        }
    }
}

/// Scattering towards any point of a box is at most the bound for the box.
#[test]
fn bounds_hold() {
    let mut random = Random::new(11, 0, 0);
    let sharp =
        [("sharp metal", ggx(0.9, 1.0, 0.05)), ("sharp phong", Bsdf::Phong(Phong::over(Vec3::ONE, 1e4)))];
    let mut tightest = f32::INFINITY;
    for (name, bsdf) in white().into_iter().chain(sharp) {
        for _ in 0..2000 {
            let mut point =
                |scale: f32| scale * Vec3::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5);
            let (position, center, half) = (point(4.0), point(6.0), point(1.0).abs());
            let normal = point(1.0).normalize();
            let wo = super::cosine_hemisphere(normal, random.f32(), random.f32());
            // Half of the boxes lie about where the lobe goes.
            let center =
                if random.f32() < 0.5 { position + super::reflect(wo, normal) * 3.0 } else { center };
            let (min, max) = (center - half, center + half);
            let bound = bsdf.scatter_bound(position, normal, wo, &Toward::new(position, min, max));
            for _ in 0..16 {
                let at = min + (max - min) * Vec3::new(random.f32(), random.f32(), random.f32());
                let wi = (at - position).normalize();
                let scatter = bsdf.scatter(normal, wo, wi).max_element();
                assert!(scatter <= bound * (1.0 + 1e-3) + 1e-7, "{name}: {scatter} > {bound}");
                if scatter > 0.1 {
                    tightest = tightest.min(bound / scatter);
                }
            }
        }
    }
    assert!(tightest < 1.1, "a bound of {tightest} times the truth at best");
}

#[test]
fn glass_obeys_snell_and_fresnel() {
    assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
    assert_eq!(fresnel_dielectric(0.5, 1.0 / 1.5), 1.0, "beyond the critical angle");
    let brewster = (1.5_f32).atan().cos();
    let half_of_perpendicular = 0.5 * ((1.5_f32.powi(2) - 1.0) / (1.5_f32.powi(2) + 1.0)).powi(2);
    assert!((fresnel_dielectric(brewster, 1.5) - half_of_perpendicular).abs() < 1e-5);
    for wo in viewers() {
        let into = Dielectric { eta: 1.5, thin: false, tint: Vec3::ONE };
        let inside = into.sample(Vec3::Z, wo, 0.999_999, Transport::Radiance);
        assert!((inside.wi.truncate().length() * 1.5 - wo.truncate().length()).abs() < 1e-5);
        assert!((inside.weight.x * 2.25 - 1.0).abs() < 1e-5, "radiance is squeezed");
        // And out again, where it came from.
        let out_of = Dielectric { eta: 1.0 / 1.5, ..into };
        let outside = out_of.sample(-Vec3::Z, inside.wi, 0.999_999, Transport::Radiance);
        assert!(outside.wi.distance(wo) < 1e-3, "{} is not {wo}", outside.wi);
        assert!((inside.weight.x * outside.weight.x - 1.0).abs() < 1e-5);
        assert_eq!(into.sample(Vec3::Z, wo, 0.999_999, Transport::Flux).weight, Vec3::ONE);
        let pane = Dielectric { thin: true, ..into };
        assert_eq!(pane.sample(Vec3::Z, wo, 0.999_999, Transport::Radiance).wi, -wo);
    }
}

#[test]
fn a_mirror_mirrors() {
    let mirror = Bsdf::Mirror { reflectance: Vec3::splat(0.9) };
    let wo = Vec3::new(0.6, 0.0, 0.8);
    let sample = mirror.sample(Vec3::Z, wo, [0.5; 3], Transport::Radiance).unwrap();
    assert!(sample.wi.distance(Vec3::new(-0.6, 0.0, 0.8)) < 1e-6);
    assert!(sample.is_specular() && mirror.is_specular());
}
