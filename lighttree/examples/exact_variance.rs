//! Which tree and which way down it is best for a scene? The exact oracle tells, without a single random
//! number: the relative variance of one sample, which is its relMSE, as a median over receivers.
//!
//! `cargo run --release -p lighttree --example exact_variance`

use glam::Vec3;
use lighttree::{
    BuildParams, ChildChoice, LambertReceiver, LightBounds, LightId, LightTree, PowerSampler, TreeSampler,
    oracle::Distribution, rng::Random,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Clusters of lamps of log-normal intensity over a floor of 20 × 20.
    let lamp = |i: u32| {
        let (mut cluster, mut own) = (Random::new(1, i % 40, 0), Random::new(2, i, 0));
        let mut offset = || own.f32() - 0.5;
        let at = Vec3::new(20.0 * cluster.f32(), 3.0, 20.0 * cluster.f32());
        let spread = offset() + offset() + offset();
        LightBounds::point(at + Vec3::new(offset(), offset(), offset()), (2.0 * spread).exp())
    };
    let lamps: Vec<LightBounds> = (0..3000).map(lamp).collect();
    let receiver = |i: u32| {
        let mut random = Random::new(3, i, 0);
        let position = Vec3::new(20.0 * random.f32(), 0.0, 20.0 * random.f32());
        LambertReceiver { position, normal: Vec3::Y, albedo: 0.5 }
    };
    let contribution = |receiver: &LambertReceiver, light: LightId| {
        let (lamp, n) = (&lamps[light.0 as usize], receiver.normal.as_dvec3());
        let to_lamp = (lamp.min - receiver.position).as_dvec3();
        f64::from(lamp.intensity) * to_lamp.normalize().dot(n).max(0.0) / to_lamp.length_squared()
    };
    let median = |distribution: &dyn Fn(&LambertReceiver) -> Distribution| {
        let one = |i| {
            let receiver = receiver(i);
            distribution(&receiver).moments(|light| contribution(&receiver, light)).relative_variance()
        };
        let mut all: Vec<f64> = (0..60).map(one).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };

    let power = PowerSampler::new(&lamps)?;
    println!("by intensity alone: {:.2}", median(&|r| Distribution::of(&power, r, lamps.len() as u32)));
    let builders = [
        ("median", BuildParams::median()),
        ("saoh", BuildParams::saoh()),
        ("agglomerative", BuildParams::agglomerative()),
        ("morton", BuildParams::morton()),
    ];
    let choices =
        [ChildChoice::MinMaxAverage, ChildChoice::Yuksel2019, ChildChoice::Center, ChildChoice::Upper];
    println!("{:>14} {}", "", choices.map(|choice| format!("{:>14}", format!("{choice:?}"))).join(" "));
    for (name, params) in builders {
        let tree = LightTree::build(&lamps, &params)?;
        print!("{name:>14}");
        for choice in choices {
            let sampler = TreeSampler::new(&tree).with_choice(choice);
            print!(" {:>14.2}", median(&|r| Distribution::of_tree(&sampler, r)));
        }
        println!();
    }
    Ok(())
}
