//! Runs `examples/foreign.rs`, so that the example cannot rot.

#[path = "../examples/foreign.rs"]
#[expect(dead_code, unreachable_pub, reason = "an example included as a module")]
mod foreign;

#[test]
fn the_foreign_renderer_is_right_and_sublinear() {
    let (picture, mean_cut, error) = foreign::render(1000);
    assert!(picture.iter().all(|c| c.is_finite()));
    assert!(picture.iter().filter(|c| c.length() > 0.0).count() > picture.len() / 3, "something is lit");
    assert!(error < 0.02, "relative error {error}");
    assert!(mean_cut < 500.0, "{mean_cut} of 1000 lamps per pixel");
}
