use glam::Vec3;
use lighttree::rng::Random;
use lighttree::*;
use std::time::Instant;
fn lights(count: u32, seed: u32) -> Vec<LightBounds> {
    let mut random = Random::new(seed, 0, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    (0..count)
        .map(|_| {
            let p = vec3();
            LightBounds::surface(
                p,
                p + 0.001 * vec3(),
                (vec3() - 0.5).normalize_or(Vec3::Z),
                false,
                vec3().x + 0.1,
            )
        })
        .collect()
}
fn time<R>(n: u32, mut f: impl FnMut() -> R) -> f64 {
    (0..n)
        .map(|_| {
            let t = Instant::now();
            std::hint::black_box(f());
            t.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}
fn main() {
    for count in [100_000u32, 1_000_000] {
        let l = lights(count, 1);
        for p in
            [BuildParams::agglomerative(), BuildParams::saoh(), BuildParams::median(), BuildParams::morton()]
        {
            let t = time(3, || LightTree::build(&l, &p).unwrap());
            println!("{count} {:?} {:.1} ms {:.2} M/s", p.method, t * 1e3, count as f64 / t / 1e6);
        }
        let t = time(5, || PerfectTree::build(&l, MortonBits::Thirty).unwrap());
        println!("{count} perfect {:.1} ms {:.2} M/s", t * 1e3, count as f64 / t / 1e6);
    }
    let l = lights(10_000_000, 1);
    let t = time(3, || PerfectTree::build(&l, MortonBits::Thirty).unwrap());
    println!("1e7 perfect {:.1} ms {:.2} M/s", t * 1e3, 1e1 / t);
}
