//! Runs `examples/foreign.rs` and holds its picture against every lamp, so that the example cannot rot.

#[path = "../examples/foreign.rs"]
#[expect(dead_code, reason = "an example included as a module")]
mod foreign;

use foreign::{SIZE, lamps, render, transfer};
use glam::Vec3;

#[test]
fn the_foreign_renderer_is_right_and_sublinear() {
    let lamps = lamps(1000);
    let picture = render(&lamps, 0.01);
    let lit: Vec<_> = picture.iter().flatten().collect();
    assert!(lit.len() > SIZE * SIZE / 2, "the floor fills the picture");
    let (mut error, mut truth) = (0.0, 0.0);
    for (hit, lit) in lit.iter().step_by(50) {
        let one = |lamp| {
            let t = transfer(hit, lamp);
            t.arrived * lamp.1
        };
        let exact: Vec3 = lamps.iter().map(one).sum();
        error += f64::from((lit.radiance - exact).length_squared());
        truth += f64::from(exact.length_squared());
    }
    let relative = (error / truth).sqrt();
    assert!(truth > 0.0 && relative < 0.02, "relative error {relative}");
    let asked: u32 = lit.iter().map(|(_, lit)| lit.transfers).sum();
    assert!((asked as usize) < 400 * lit.len(), "{} of 1000 lamps per pixel", asked as usize / lit.len());
}
